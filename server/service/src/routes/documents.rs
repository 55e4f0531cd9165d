//! The page, the interface's description and its manual: static documents, all from this program.

use std::future::{Ready, ready};
use std::sync::Arc;

use axum::Router;
use axum::http::{HeaderMap, HeaderValue, Method};
use axum::response::Response;
use axum::routing::get;
use bytes::Bytes;
use serde::Deserialize;
use utoipa::openapi::OpenApi;

use crate::state::AppState;
use access::audited::Audited;
use access::routes::ScopeTable;
use access::scopes::Scope;
use http::conditional::{
    EntityTag, PUBLIC_IMMUTABLE, PUBLIC_REVALIDATE, Representation, coding_among,
};
use http::negotiate::Coding;
use http::problem::AppError;
use http::query::{ApiQuery, Asked, NoQuery};

mod manual;

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const JAVASCRIPT: &str = "text/javascript; charset=utf-8";
const JSON: &str = "application/json";

/// A file of the page, as it is and as it was compressed while building.
struct PageFile {
    name: &'static str,
    address: &'static str,
    /// Whether its address changes with its content.
    is_immutable: bool,
    bytes: &'static [u8],
    brotli: &'static [u8],
    gzip: &'static [u8],
}

/// The files that `make web` makes.
const PAGE: &[PageFile] = include!(concat!(env!("OUT_DIR"), "/page_files.rs"));

impl PageFile {
    fn media_type(&self) -> &'static str {
        match self.name.rsplit_once('.').map(|(_, ending)| ending) {
            Some("html") => HTML,
            Some("css") => CSS,
            Some("js") => JAVASCRIPT,
            _ => JSON,
        }
    }

    fn document(&self) -> Document {
        let codings = [
            (Coding::Brotli, self.brotli),
            (Coding::Gzip, self.gzip),
            (Coding::Identity, self.bytes),
        ];
        Document {
            media_type: self.media_type(),
            // A new version of the program appears at once: its documents name other files.
            cache_control: if self.is_immutable {
                PUBLIC_IMMUTABLE
            } else {
                PUBLIC_REVALIDATE
            },
            codings: codings
                .map(|(coding, body)| {
                    let tag = EntityTag::of_bytes(self.bytes, coding);
                    (coding, tag, Bytes::from_static(body))
                })
                .into(),
        }
    }
}

/// A document in each of its codings, with its tags; the last is [`Coding::Identity`].
struct Document {
    media_type: &'static str,
    cache_control: HeaderValue,
    codings: Vec<(Coding, EntityTag, Bytes)>,
}

impl Document {
    /// A document that the program writes at its start.
    fn written(media_type: &'static str, bytes: Bytes) -> Self {
        let codings = Coding::WHILE_RUNNING.into_iter().chain([Coding::Identity]);
        Self {
            media_type,
            cache_control: PUBLIC_REVALIDATE,
            codings: codings
                .map(|coding| {
                    let tag = EntityTag::of_bytes(&bytes, coding);
                    (coding, tag, coding.compress_well(&bytes))
                })
                .collect(),
        }
    }

    fn answer(&self, request: &HeaderMap) -> Result<Response, AppError> {
        let offered: Vec<_> = self.codings.iter().map(|(coding, ..)| *coding).collect();
        let wanted = coding_among(&offered, request);
        let found = self.codings.iter().find(|(coding, ..)| *coding == wanted);
        let (coding, tag, body) = found.expect("every document has its plain form");
        Representation {
            tag: tag.clone(),
            media_type: self.media_type,
            coding: *coding,
            body: body.clone(),
            headers: HeaderMap::new(),
            vary: "accept-encoding",
            cache_control: self.cache_control.clone(),
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

/// The documents about the interface.
const WRITTEN: [&str; 3] = ["/openapi.json", "/docs", "/docs.css"];

/// What the tokens of these documents must permit, if they need one.
pub fn scopes() -> ScopeTable {
    ScopeTable::of(&WRITTEN.map(|address| (Method::GET, address, Scope::Read, Audited::No)))
}

/// The routes of the documents about the interface.
pub fn written(openapi: &OpenApi) -> Router<AppState> {
    let description = serde_json::to_value(openapi).unwrap_or_default();
    let manual = manual::html(&description);
    let written = [
        (JSON, description.to_string().into()),
        (HTML, manual.into()),
        (CSS, Bytes::from_static(manual::STYLE.as_bytes())),
    ];
    let written = written.map(|(media_type, bytes)| Document::written(media_type, bytes));
    served(WRITTEN.into_iter().zip(written))
}

/// The routes of the page.
pub fn page() -> Router<AppState> {
    served(PAGE.iter().map(|file| (file.address, file.document())))
}

fn served(documents: impl Iterator<Item = (&'static str, Document)>) -> Router<AppState> {
    documents.fold(Router::new(), |router, (address, document)| {
        let document = Arc::new(document);
        let answer = match address {
            "/" => get(answering::<PageQuery>(document)),
            // Its query names a study, which the page itself sends on.
            "/launch" => get(move |request: HeaderMap| ready(document.answer(&request))),
            _ => get(answering::<NoQuery>(document)),
        };
        router.route(address, answer)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(name: &str) -> &'static str {
        let found = PAGE.iter().find(|file| file.name == name);
        std::str::from_utf8(found.unwrap().bytes).unwrap()
    }

    /// The files of this page that a text of it names.
    fn named_in(name: &str) -> impl Iterator<Item = &'static str> {
        text(name)
            .split('"')
            .filter_map(|word| word.strip_prefix("./"))
    }

    #[test]
    fn every_file_that_a_document_names_is_served_for_ever() {
        for document in ["index.html", "compare.html", "launch.html"] {
            let named: Vec<_> = named_in(document).collect();
            for kind in [".css", ".js"] {
                assert!(named.iter().any(|name| name.ends_with(kind)), "{named:?}");
            }
            for name in named {
                let found = PAGE.iter().find(|file| file.name == name);
                assert!(found.unwrap().is_immutable, "{name}");
            }
        }
    }

    #[test]
    fn the_page_holds_no_inline_script_or_style() {
        for document in ["index.html", "compare.html", "launch.html"] {
            for forbidden in ["<style", " style=", "<script>", " onclick="] {
                assert!(!text(document).contains(forbidden), "{forbidden}");
            }
        }
    }

    #[test]
    fn what_was_compressed_while_building_is_what_it_was_made_of() {
        for file in PAGE {
            let mut plain = Vec::new();
            let mut reader = flate2::read::GzDecoder::new(file.gzip);
            std::io::Read::read_to_end(&mut reader, &mut plain).unwrap();
            assert!(plain == file.bytes, "{}", file.name);
            assert!(file.brotli.len() < file.bytes.len(), "{}", file.name);
        }
    }
}
