//! Answers that never change: strong entity tags, 304, ranges and content codings.

use axum::body::Body;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;

use crate::negotiate::Coding;
use crate::problem::AppError;

/// Part of every entity tag: raised when the bytes of any answer to the same request change.
const FORMAT_VERSION: u8 = 6;

/// How long answers stay fresh: a pure function of id and query never goes stale.
const IMMUTABLE: HeaderValue = HeaderValue::from_static("private, max-age=31536000, immutable");

/// The client stores the answer and validates it before each use; it gets 304 if nothing has changed.
pub const REVALIDATE: HeaderValue = HeaderValue::from_static("private, no-cache");

/// No cache may store the answer, because it states a patient. The client may still ask whether it has changed.
pub const NO_STORE: HeaderValue = HeaderValue::from_static("no-store");

/// As [`REVALIDATE`], for what holds nothing of a case.
pub const PUBLIC_REVALIDATE: HeaderValue = HeaderValue::from_static("no-cache");

/// For what holds nothing of a case and changes its address with its content.
pub const PUBLIC_IMMUTABLE: HeaderValue =
    HeaderValue::from_static("public, max-age=31536000, immutable");

/// A strong entity tag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EntityTag(HeaderValue);

impl EntityTag {
    /// The tag of an answer about a subject: a digest of the subject, the route, the checked query and what was negotiated.
    ///
    /// `query` is the checked query; equal queries have equal tags, in any order and spelling.
    pub fn of_answer(
        subject: &str,
        route: &str,
        query: &impl serde::Serialize,
        negotiated: (&str, Coding),
    ) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&[FORMAT_VERSION]);
        let coding = negotiated.1.name().unwrap_or_default();
        for part in [subject, route, negotiated.0, coding] {
            // With their lengths, no two lists of parts give the same bytes.
            hasher.update(&(part.len() as u32).to_le_bytes());
            hasher.update(part.as_bytes());
        }
        hasher.update(&serde_json::to_vec(query).unwrap_or_default());
        Self::from_digest(&hasher.finalize())
    }

    pub fn header(&self) -> HeaderValue {
        self.0.clone()
    }

    /// The tag of bytes that belong to the program, such as a file of the page.
    pub fn of_bytes(bytes: &[u8], coding: Coding) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(coding.name().unwrap_or_default().as_bytes());
        hasher.update(&[0]);
        hasher.update(bytes);
        Self::from_digest(&hasher.finalize())
    }

    /// The tag of what has a digest.
    pub fn from_digest(digest: &blake3::Hash) -> Self {
        let text = format!("\"{}\"", &digest.to_hex()[..32]);
        Self(HeaderValue::from_str(&text).expect("hexadecimal digits and quotes are a header"))
    }

    /// Whether the client has this answer already (`If-None-Match`).
    pub fn is_known_to(&self, request: &HeaderMap) -> bool {
        let own = self.0.as_bytes();
        request
            .get_all(header::IF_NONE_MATCH)
            .into_iter()
            .flat_map(|value| value.as_bytes().split(|&byte| byte == b','))
            .map(<[u8]>::trim_ascii)
            .any(|tag| tag == b"*" || tag.strip_prefix(b"W/").unwrap_or(tag) == own)
    }

    /// Whether a range of this answer may be sent (`If-Range`, if present).
    fn allows_range(&self, request: &HeaderMap) -> bool {
        request
            .get(header::IF_RANGE)
            .is_none_or(|condition| condition == self.0)
    }
}

/// The format of an answer.
#[derive(Debug)]
pub struct Format {
    media_type: &'static str,
    /// A name that distinguishes answers to one question; by default the media type.
    variant: String,
    /// Facts about the case in the answer that can change.
    named: Option<String>,
    coding: Coding,
    vary: &'static str,
    cache_control: HeaderValue,
}

impl Format {
    /// A media type that was negotiated, not compressed.
    pub fn of(media_type: &'static str) -> Self {
        Self {
            media_type,
            variant: media_type.to_owned(),
            named: None,
            coding: Coding::Identity,
            vary: "accept",
            cache_control: IMMUTABLE,
        }
    }

    /// The only media type, compressed as the client prefers.
    pub fn compressed(media_type: &'static str, request: &HeaderMap) -> Self {
        Self {
            coding: coding_for(request),
            vary: "accept-encoding",
            ..Self::of(media_type)
        }
    }

    /// The format, distinguished by a name other than its media type.
    #[must_use]
    pub fn variant(self, variant: impl Into<String>) -> Self {
        Self {
            variant: variant.into(),
            ..self
        }
    }

    /// The form for answers that a later version of this program may change: caches must validate them before each use.
    #[must_use]
    pub fn revalidated(self) -> Self {
        Self {
            cache_control: REVALIDATE,
            ..self
        }
    }

    /// The form for answers with facts about the case that can change: the client must validate them before each use.
    #[must_use]
    pub fn named(self, named: Option<String>) -> Self {
        match named {
            None => self,
            Some(_) => Self {
                named,
                ..self.revalidated()
            },
        }
    }

    /// How the answer is compressed.
    pub fn coding(&self) -> Coding {
        self.coding
    }

    /// Answers a request: with 304 and without any work if the client has the answer, otherwise with the result of `work`.
    /// `tag_of` makes the entity tag, given what was negotiated.
    ///
    /// # Errors
    /// As [`Representation::respond`], and those of `work`.
    pub async fn respond(
        self,
        request: &HeaderMap,
        tag_of: impl Fn((&str, Coding)) -> EntityTag,
        work: impl AsyncFnOnce() -> Result<Content, AppError>,
    ) -> Result<Response, AppError> {
        let tag_of = |variant: &str| {
            let named = self.named.as_deref().unwrap_or_default();
            let variant = format!("{variant} {named}");
            tag_of((variant.trim_end(), self.coding))
        };
        let tag = tag_of(&self.variant);
        if tag.is_known_to(request) {
            return Ok(not_modified(&tag, self.vary, self.cache_control));
        }
        let content = work().await?;
        Representation {
            tag: content.variant.as_deref().map_or(tag, tag_of),
            media_type: self.media_type,
            coding: self.coding,
            body: content.body,
            headers: content.headers,
            vary: self.vary,
            cache_control: self.cache_control,
        }
        .respond(request)
    }
}

/// The result of the work for an answer.
#[derive(Debug, Default)]
pub struct Content {
    /// The bytes, in the coding of the format.
    pub body: Bytes,
    pub headers: HeaderMap,
    /// The variant of the format, if the work chose another one.
    pub variant: Option<String>,
}

impl From<Bytes> for Content {
    fn from(body: Bytes) -> Self {
        Self {
            body,
            ..Self::default()
        }
    }
}

/// The coding of an answer that is compressed while the program runs, as [`coding_among`].
fn coding_for(request: &HeaderMap) -> Coding {
    coding_among(&Coding::WHILE_RUNNING, request)
}

/// The coding of the answer, of those offered. A range request is answered without one, so that ranges refer to the documented bytes.
pub fn coding_among(offered: &[Coding], request: &HeaderMap) -> Coding {
    if request.contains_key(header::RANGE) {
        Coding::Identity
    } else {
        Coding::preferred(request, offered)
    }
}

/// An answer that never changes.
#[derive(Debug)]
pub struct Representation {
    pub tag: EntityTag,
    pub media_type: &'static str,
    /// How `body` is compressed.
    pub coding: Coding,
    /// The bytes, in that coding.
    pub body: Bytes,
    pub headers: HeaderMap,
    /// The request headers on which the answer depends, for `Vary`.
    pub vary: &'static str,
    /// How long it stays fresh.
    pub cache_control: HeaderValue,
}

impl Representation {
    /// The answer to a request: complete (200), the requested range (206), or unchanged (304).
    ///
    /// # Errors
    /// An error if the range begins beyond the end.
    pub fn respond(self, request: &HeaderMap) -> Result<Response, AppError> {
        if self.tag.is_known_to(request) {
            return Ok(not_modified(&self.tag, self.vary, self.cache_control));
        }
        let length = self.body.len() as u64;
        let wanted = range_of(request, length).filter(|_| self.tag.allows_range(request));
        let mut response = match wanted {
            None => Body::from(self.body).into_response(),
            Some(Err(())) => {
                let detail = format!("the range begins beyond the {length} bytes of this answer");
                let status = StatusCode::RANGE_NOT_SATISFIABLE;
                let error = AppError::new(status, "range-not-satisfiable", detail);
                return Err(match HeaderValue::from_str(&format!("bytes */{length}")) {
                    Ok(range) => error.with_header(header::CONTENT_RANGE, range),
                    Err(_) => error,
                });
            }
            Some(Ok((first, last))) => {
                let part = self.body.slice(first as usize..=last as usize);
                let mut response = (StatusCode::PARTIAL_CONTENT, Body::from(part)).into_response();
                insert(
                    response.headers_mut(),
                    header::CONTENT_RANGE,
                    &format!("bytes {first}-{last}/{length}"),
                );
                response
            }
        };
        let headers = response.headers_mut();
        headers.extend(self.headers);
        let media_type = match self.media_type {
            "text/csv" => "text/csv; charset=utf-8",
            other => other,
        };
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type));
        headers.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        if let Some(name) = self.coding.name() {
            headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static(name));
        }
        about(headers, &self.tag, self.vary, self.cache_control);
        Ok(response)
    }
}

/// The answer to a client that already has it.
fn not_modified(tag: &EntityTag, vary: &'static str, cache_control: HeaderValue) -> Response {
    let mut response = StatusCode::NOT_MODIFIED.into_response();
    about(response.headers_mut(), tag, vary, cache_control);
    response
}

fn about(headers: &mut HeaderMap, tag: &EntityTag, vary: &'static str, cache_control: HeaderValue) {
    headers.insert(header::ETAG, tag.0.clone());
    headers.insert(header::CACHE_CONTROL, cache_control);
    headers.insert(header::VARY, HeaderValue::from_static(vary));
}

/// Sets a header to a printable text.
pub fn insert(headers: &mut HeaderMap, name: HeaderName, text: &str) {
    if let Ok(value) = HeaderValue::from_str(text) {
        headers.insert(name, value);
    }
}

/// The one byte range asked for, first and last byte; `Err` where it cannot be satisfied.
///
/// `None` if there is none, or it is malformed, or there are several: the whole is sent then (RFC 9110, section 14.2).
fn range_of(request: &HeaderMap, length: u64) -> Option<Result<(u64, u64), ()>> {
    let text = request.get(header::RANGE)?.to_str().ok()?;
    let (first, last) = text.trim().strip_prefix("bytes=")?.split_once('-')?;
    let range = if first.is_empty() {
        let count: u64 = last.parse().ok()?;
        (length.saturating_sub(count), length.checked_sub(1)?)
    } else {
        let first: u64 = first.parse().ok()?;
        let last = if last.is_empty() {
            u64::MAX
        } else {
            last.parse().ok()?
        };
        if last < first {
            return None;
        }
        (first, last.min(length.saturating_sub(1)))
    };
    Some(if range.0 < length { Ok(range) } else { Err(()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(range: Option<&str>) -> Result<Response, AppError> {
        let mut request = HeaderMap::new();
        if let Some(range) = range {
            request.insert(header::RANGE, range.parse().unwrap());
        }
        let body = Bytes::from_static(b"0123456789");
        let tag = EntityTag::of_bytes(&body, Coding::Identity);
        Representation {
            tag,
            media_type: "text/plain",
            coding: Coding::Identity,
            body,
            headers: HeaderMap::new(),
            vary: "accept",
            cache_control: IMMUTABLE,
        }
        .respond(&request)
    }

    fn content_range(range: &str) -> String {
        let response = answer(Some(range)).unwrap();
        assert_eq!(response.status(), StatusCode::PARTIAL_CONTENT);
        response.headers()[header::CONTENT_RANGE]
            .to_str()
            .unwrap()
            .to_owned()
    }

    #[test]
    fn ranges_are_cut_from_the_body() {
        assert_eq!(content_range("bytes=2-4"), "bytes 2-4/10");
        assert_eq!(content_range("bytes=7-"), "bytes 7-9/10");
        assert_eq!(content_range("bytes=-3"), "bytes 7-9/10");
        assert_eq!(content_range("bytes=-99"), "bytes 0-9/10");
        assert_eq!(content_range("bytes=0-999"), "bytes 0-9/10");
    }

    #[test]
    fn a_range_beyond_the_end_is_refused_and_a_malformed_one_ignored() {
        let refused = answer(Some("bytes=10-")).unwrap_err().into_response();
        assert_eq!(refused.status(), StatusCode::RANGE_NOT_SATISFIABLE);
        assert_eq!(refused.headers()[header::CONTENT_RANGE], "bytes */10");
        for malformed in ["bytes=4-2", "bytes=a-b", "lines=1-2", "bytes=1-2,4-5"] {
            assert_eq!(answer(Some(malformed)).unwrap().status(), StatusCode::OK);
        }
    }

    #[test]
    fn a_known_tag_is_not_sent_again() {
        let tag = EntityTag::of_bytes(b"x", Coding::Identity);
        let known = |text: String| {
            tag.is_known_to(&HeaderMap::from_iter([(
                header::IF_NONE_MATCH,
                text.parse().unwrap(),
            )]))
        };
        let text = tag.0.to_str().unwrap();
        assert!(known(text.to_owned()));
        assert!(known(format!("\"other\", W/{text}")));
        assert!(known("*".to_owned()));
        assert!(!known("\"other\"".to_owned()));
    }

    #[test]
    fn each_coding_has_its_own_tag() {
        assert_ne!(
            EntityTag::of_bytes(b"x", Coding::Zstd),
            EntityTag::of_bytes(b"x", Coding::Gzip)
        );
    }
}
