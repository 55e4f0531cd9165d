//! The page, the interface's description and its manual: static documents, all from this program.

use std::future::{Ready, ready};
use std::sync::Arc;

use axum::Router;
use axum::http::{HeaderMap, HeaderValue};
use axum::response::Response;
use axum::routing::get;
use bytes::Bytes;
use serde::Deserialize;
use utoipa::openapi::OpenApi;

use super::query::{ApiQuery, Asked, NoQuery};
use crate::conditional::{EntityTag, Representation, coding_for};
use crate::negotiate::Coding;
use crate::problem::AppError;
use crate::state::AppState;

mod manual;

/// Asked for again each time, and answered by 304: a new version of the program shows at once.
const REVALIDATE: HeaderValue = HeaderValue::from_static("no-cache");

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const JAVASCRIPT: &str = "text/javascript; charset=utf-8";
const JSON: &str = "application/json";

/// A file of the page, bundled by `make web`: its address, media type and bytes.
macro_rules! page_file {
    ($address:literal, $kind:expr, $file:literal) => {
        (
            $address,
            $kind,
            include_bytes!(concat!("../../../../web/dist/", $file)).as_slice(),
        )
    };
}

/// The files of the page.
const PAGE: &[(&str, &str, &[u8])] = &[
    page_file!("/", HTML, "index.html"),
    page_file!("/style.css", CSS, "style.css"),
    page_file!("/main.js", JAVASCRIPT, "main.js"),
    page_file!("/words.en.json", JSON, "words.en.json"),
    page_file!("/words.pt-BR.json", JSON, "words.pt-BR.json"),
    page_file!("/shaders.json", JSON, "shaders.json"),
];

/// A document in every coding, with its tags.
struct Document {
    media_type: &'static str,
    codings: [(Coding, EntityTag, Bytes); 3],
}

impl Document {
    fn new(media_type: &'static str, bytes: impl Into<Bytes>) -> Self {
        let bytes: Bytes = bytes.into();
        let codings = [Coding::Identity, Coding::Zstd, Coding::Gzip];
        Self {
            media_type,
            codings: codings.map(|coding| {
                let tag = EntityTag::of_bytes(&bytes, coding);
                (coding, tag, coding.compress(&bytes))
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
            cache_control: REVALIDATE,
        }
        .respond(request)
    }
}

/// What the page reads of its own address; the server answers the same whatever it is.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct PageQuery {
    /// `server` keeps the page from drawing by itself.
    #[serde(default, rename = "renderer")]
    _renderer: Option<PageRenderer>,
}

/// Who draws the page's pictures, where it is not left to the page.
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
        ("/openapi.json", JSON, description.to_string().into()),
        ("/docs", HTML, Bytes::from(manual)),
        (
            "/docs.css",
            CSS,
            Bytes::from_static(manual::STYLE.as_bytes()),
        ),
    ];
    documents.extend(
        PAGE.iter()
            .map(|&(address, kind, bytes)| (address, kind, Bytes::from_static(bytes))),
    );
    documents
        .into_iter()
        .fold(Router::new(), |router, (address, kind, bytes)| {
            let document = Arc::new(Document::new(kind, bytes));
            if address == "/" {
                router.route(address, get(answering::<PageQuery>(document)))
            } else {
                router.route(address, get(answering::<NoQuery>(document)))
            }
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_that_the_page_names_is_served() {
        let text = |name: &str| {
            let found = PAGE.iter().find(|(address, ..)| *address == name);
            std::str::from_utf8(found.unwrap().2).unwrap()
        };
        let named = text("/").split('"').filter(|word| word.starts_with("./"));
        let named: Vec<_> = named.map(|word| &word[1..]).collect();
        assert_eq!(named.len(), 2, "a style and a script: {named:?}");
        for address in named {
            assert!(!text(address).is_empty());
        }
    }

    #[test]
    fn the_page_holds_no_inline_script_or_style() {
        let (_, _, bytes) = PAGE.iter().find(|(address, ..)| *address == "/").unwrap();
        let text = std::str::from_utf8(bytes).unwrap();
        for forbidden in ["<style", " style=", "<script>", " onclick="] {
            assert!(!text.contains(forbidden), "{forbidden}");
        }
    }

    /// The page is to be there at once over a slow line.
    #[test]
    fn the_script_is_at_most_45_kb_gzipped() {
        let (_, _, bytes) = PAGE
            .iter()
            .find(|(address, ..)| *address == "/main.js")
            .unwrap();
        let gzipped = Coding::Gzip.compress(&Bytes::from_static(bytes)).len();
        assert!(gzipped <= 45_000, "{gzipped} bytes");
    }
}
