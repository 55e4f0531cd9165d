//! Pages of other sites that may read answers (CORS), such as a viewer on another host.
//!
//! Only listed origins are answered, never all of them, and never with cookies, which this server does not have.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};

/// What a page may send.
const METHODS: HeaderValue = HeaderValue::from_static("GET, HEAD, POST, PUT, PATCH, DELETE");
const REQUEST_HEADERS: HeaderValue =
    HeaderValue::from_static("accept, authorization, content-type, if-none-match, range");

/// What a page may read of an answer beside its body.
const ANSWER_HEADERS: HeaderValue = HeaderValue::from_static(
    "content-location, content-range, etag, location, retry-after, x-isocortex-depth-clamped, \
     x-isocortex-closed, x-isocortex-depth-mm, x-isocortex-quality, x-request-id",
);

/// For how long a browser need not ask again, in seconds.
const MAX_AGE: HeaderValue = HeaderValue::from_static("600");

/// Origins whose pages may read answers. Cheap to clone.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Origins(Arc<[HeaderValue]>);

/// A text is no origin.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is no origin; write a scheme, a host and perhaps a port, such as `https://viewer.example:8443`, without a path"
)]
pub struct NotAnOrigin(pub String);

impl Origins {
    /// Parses a list of origins.
    ///
    /// # Errors
    /// [`NotAnOrigin`], for `*` too.
    pub fn parse(texts: &[String]) -> Result<Self, NotAnOrigin> {
        let parse = |text: &String| parsed(text).ok_or_else(|| NotAnOrigin(text.clone()));
        Ok(Self(texts.iter().map(parse).collect::<Result<_, _>>()?))
    }

    /// The origins, as they are written.
    pub fn iter(&self) -> impl Iterator<Item = &HeaderValue> {
        self.0.iter()
    }

    /// The origin of a request, if its pages have access.
    pub fn allowed(&self, headers: &HeaderMap) -> Option<&HeaderValue> {
        let mut given = headers.get_all(header::ORIGIN).iter();
        let (origin, others) = (given.next()?, given.next());
        self.0
            .iter()
            .find(|known| *known == origin && others.is_none())
    }
}

fn parsed(text: &str) -> Option<HeaderValue> {
    let uri: Uri = text.parse().ok()?;
    let is_web = matches!(uri.scheme_str(), Some("http" | "https"));
    let authority = uri.authority()?.as_str();
    let plain = format!("{}://{authority}", uri.scheme_str()?);
    let is_plain = is_web && !authority.contains(['@', '*']) && text == plain;
    let is_lower_case = !text.bytes().any(|byte| byte.is_ascii_uppercase());
    (is_plain && is_lower_case)
        .then(|| HeaderValue::from_str(text).ok())
        .flatten()
}

/// Lets pages of listed origins read answers, and answers their question beforehand.
pub async fn share(State(origins): State<Origins>, request: Request, next: Next) -> Response {
    if origins.0.is_empty() {
        return next.run(request).await;
    }
    let origin = origins.allowed(request.headers()).cloned();
    let is_question = request.method() == Method::OPTIONS
        && (request.headers()).contains_key(header::ACCESS_CONTROL_REQUEST_METHOD);
    let mut response = match origin.is_some() && is_question {
        true => {
            let mut response = StatusCode::NO_CONTENT.into_response();
            let headers = response.headers_mut();
            headers.insert(header::ACCESS_CONTROL_ALLOW_METHODS, METHODS);
            headers.insert(header::ACCESS_CONTROL_ALLOW_HEADERS, REQUEST_HEADERS);
            headers.insert(header::ACCESS_CONTROL_MAX_AGE, MAX_AGE);
            response
        }
        false => next.run(request).await,
    };
    let headers = response.headers_mut();
    headers.append(header::VARY, HeaderValue::from_static("origin"));
    if let Some(origin) = origin {
        headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, origin);
        headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, ANSWER_HEADERS);
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origins(texts: &[&str]) -> Result<Origins, NotAnOrigin> {
        let texts: Vec<_> = texts.iter().map(|&text| text.to_owned()).collect();
        Origins::parse(&texts)
    }

    #[test]
    fn an_origin_is_a_scheme_a_host_and_a_port() {
        assert!(origins(&["https://viewer.example", "http://localhost:3000"]).is_ok());
        for text in [
            "*",
            "viewer.example",
            "https://viewer.example/",
            "https://viewer.example/path",
            "https://user@viewer.example",
            "https://*.example",
            "https://Viewer.example",
            "ftp://viewer.example",
            "null",
        ] {
            let refused = origins(&[text]).unwrap_err();
            assert_eq!(refused, NotAnOrigin(text.to_owned()));
        }
    }

    #[test]
    fn only_what_is_listed_is_allowed() {
        let listed = origins(&["https://viewer.example"]).unwrap();
        let allowed = |values: &[&'static str]| {
            let mut headers = HeaderMap::new();
            for value in values {
                headers.append(header::ORIGIN, HeaderValue::from_static(value));
            }
            listed.allowed(&headers).is_some()
        };
        assert!(allowed(&["https://viewer.example"]));
        for values in [
            &["http://viewer.example"][..],
            &["https://viewer.example:8443"],
            &["https://viewer.example.evil"],
            &["null"],
            &[],
            &["https://viewer.example", "https://evil.example"],
        ] {
            assert!(!allowed(values), "{values:?}");
        }
    }
}
