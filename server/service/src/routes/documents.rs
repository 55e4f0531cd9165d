//! The page, the interface's description and its manual: static documents, all from this program.

use std::future::{Ready, ready};
use std::sync::Arc;

use axum::Router;
use axum::http::HeaderMap;
use axum::response::Response;
use axum::routing::get;
use bytes::Bytes;
use serde::Deserialize;
use utoipa::openapi::OpenApi;

use super::query::{ApiQuery, Asked, NoQuery};
use crate::state::AppState;
use http_support::conditional::{EntityTag, PUBLIC_REVALIDATE, Representation, coding_for};
use http_support::negotiate::Coding;
use http_support::problem::AppError;

mod manual;

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const JAVASCRIPT: &str = "text/javascript; charset=utf-8";
const JSON: &str = "application/json";

/// The files of the page, bundled by `make web`: names, bytes, and bytes gzipped while building.
const PAGE: &[(&str, &[u8], &[u8])] = include!(concat!(env!("OUT_DIR"), "/page_files.rs"));

/// The address and the media type of a file of the page.
fn address_and_type(name: &str) -> (String, &'static str) {
    let kind = match name.rsplit_once('.').map(|(_, ending)| ending) {
        Some("html") => HTML,
        Some("css") => CSS,
        Some("js") => JAVASCRIPT,
        _ => JSON,
    };
    match name {
        "index.html" => ("/".to_owned(), kind),
        "compare.html" => ("/compare".to_owned(), kind),
        _ => (format!("/{name}"), kind),
    }
}

/// A document in every coding, with its tags.
struct Document {
    media_type: &'static str,
    codings: [(Coding, EntityTag, Bytes); 3],
}

impl Document {
    /// `gzipped` is what was compressed before, if anything.
    fn new(media_type: &'static str, bytes: Bytes, gzipped: Option<&'static [u8]>) -> Self {
        let codings = [Coding::Identity, Coding::Zstd, Coding::Gzip];
        Self {
            media_type,
            codings: codings.map(|coding| {
                let tag = EntityTag::of_bytes(&bytes, coding);
                let body = match (coding, gzipped) {
                    (Coding::Gzip, Some(packed)) => Bytes::from_static(packed),
                    _ => coding.compress_well(&bytes),
                };
                (coding, tag, body)
            }),
        }
    }

    fn answer(&self, request: &HeaderMap) -> Result<Response, AppError> {
        let wanted = coding_for(request);
        let found = self.codings.iter().find(|(coding, ..)| *coding == wanted);
        let (coding, tag, body) = found.unwrap_or(&self.codings[0]);
        Representation {
            tag: tag.clone(),
            media_type: self.media_type,
            coding: *coding,
            body: body.clone(),
            headers: HeaderMap::new(),
            vary: "accept-encoding",
            // So that a new version of the program appears at once.
            cache_control: PUBLIC_REVALIDATE,
        }
        .respond(request)
    }
}

/// The query of the page, which the page itself reads; the server ignores it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct PageQuery {
    /// `server`: the server draws instead of the page.
    #[serde(default, rename = "renderer")]
    _renderer: Option<PageRenderer>,
}

/// The renderer of the page, unless the page chooses.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum PageRenderer {
    Server,
}

impl Asked for PageQuery {
    type Values = ();

    fn checked(&self) -> Result<(), AppError> {
        Ok(())
    }
}

/// The handler of a document.
fn answering<Query: Asked>(
    document: Arc<Document>,
) -> impl Fn(ApiQuery<Query>, HeaderMap) -> Ready<Result<Response, AppError>>
+ Clone
+ Send
+ Sync
+ 'static {
    move |_query, request| ready(document.answer(&request))
}

/// The routes of the documents.
pub fn routes(openapi: &OpenApi) -> Router<AppState> {
    let description = serde_json::to_value(openapi).unwrap_or_default();
    let manual = manual::html(&description);
    let mut documents = vec![
        (
            "/openapi.json".to_owned(),
            JSON,
            Bytes::from(description.to_string()),
            None,
        ),
        ("/docs".to_owned(), HTML, Bytes::from(manual), None),
        (
            "/docs.css".to_owned(),
            CSS,
            Bytes::from_static(manual::STYLE.as_bytes()),
            None,
        ),
    ];
    documents.extend(PAGE.iter().map(|&(name, bytes, gzipped)| {
        let (address, kind) = address_and_type(name);
        (address, kind, Bytes::from_static(bytes), Some(gzipped))
    }));
    documents
        .into_iter()
        .fold(Router::new(), |router, (address, kind, bytes, gzipped)| {
            let document = Arc::new(Document::new(kind, bytes, gzipped));
            if address == "/" {
                router.route(&address, get(answering::<PageQuery>(document)))
            } else {
                router.route(&address, get(answering::<NoQuery>(document)))
            }
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(name: &str) -> &'static str {
        let found = PAGE.iter().find(|(file, ..)| *file == name);
        std::str::from_utf8(found.unwrap().1).unwrap()
    }

    /// The files of this page that a text of it names, each once.
    fn named_in(name: &str) -> Vec<&'static str> {
        let mut named: Vec<_> = text(name)
            .split('"')
            .filter_map(|word| word.strip_prefix("./"))
            .collect();
        named.sort_unstable();
        named.dedup();
        named
    }

    #[test]
    fn every_file_that_the_page_names_is_served() {
        let named = named_in("index.html");
        assert!(
            named.contains(&"style.css") && named.contains(&"main.js"),
            "{named:?}"
        );
        for name in named {
            assert!(!text(name).is_empty());
        }
    }

    #[test]
    fn the_page_holds_no_inline_script_or_style() {
        for forbidden in ["<style", " style=", "<script>", " onclick="] {
            assert!(!text("index.html").contains(forbidden), "{forbidden}");
        }
    }

    /// The page is to be there at once over a slow line: its document names all that it begins with.
    #[test]
    fn the_first_scripts_are_at_most_45_kb_gzipped_and_all_are_at_most_60() {
        let gzipped = |name: &str| {
            let found = PAGE.iter().find(|(file, ..)| *file == name);
            found.unwrap().2.len()
        };
        let first = named_in("index.html").into_iter();
        let first: usize = first
            .filter(|name| name.ends_with(".js"))
            .map(gzipped)
            .sum();
        // The page that compares two cases has a script of its own.
        const COMPARING: &str = "compare.js";
        let scripts = PAGE
            .iter()
            .filter(|(name, ..)| name.ends_with(".js") && *name != COMPARING);
        let all: usize = scripts.clone().map(|(name, ..)| gzipped(name)).sum();
        assert!(first <= 45_000, "{first} bytes");
        assert!(all <= 60_000, "{all} bytes");
        assert!(gzipped(COMPARING) <= 6000, "{} bytes", gzipped(COMPARING));
        assert!(
            scripts.count() > 1 && first < all,
            "some of it is fetched on demand"
        );
    }
}
