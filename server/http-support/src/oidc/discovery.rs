//! What an issuer publishes of itself: where people sign in, and its keys.

use std::time::{Duration, Instant};

use axum::http::{Request, StatusCode, Uri, header};
use bytes::Bytes;
use http_body_util::{BodyExt as _, Full, Limited};
use serde::Deserialize;
use serde_json::Value;

use super::keys::Key;
use crate::client::HttpClient;

/// How long to wait for an answer of the issuer.
const ANSWER: Duration = Duration::from_secs(5);

/// The longest answer.
const MAX_BYTES: usize = 1 << 20;

/// Why nothing is known of an issuer. It is for the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Away {
    #[error("it does not answer")]
    Silent,
    #[error("it answers with the status {0}")]
    Status(u16),
    #[error("its answer cannot be read")]
    Unreadable,
    #[error("it calls itself by another name than `oidc.issuer`")]
    OtherName,
    #[error("it names an address that is not safe: it must begin with https://")]
    Unsafe,
    #[error("it has no key that signs by RS256, PS256, ES256 or EdDSA")]
    NoKeys,
}

/// What is known of an issuer.
#[derive(Debug)]
pub(super) struct Known {
    pub(super) keys: Vec<Key>,
    pub(super) endpoints: Endpoints,
    pub(super) read: Instant,
}

impl Known {
    /// Whether a token could be signed by one of the keys, by the id that it names.
    pub(super) fn names(&self, id: Option<&str>) -> bool {
        self.keys.iter().any(|key| key.is_named(id))
    }
}

/// The document of an issuer (OpenID Connect Discovery 1.0), as far as it is used.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Endpoints {
    issuer: String,
    jwks_uri: String,
    pub(super) authorization_endpoint: Option<String>,
    pub(super) token_endpoint: Option<String>,
    pub(super) end_session_endpoint: Option<String>,
    pub(super) revocation_endpoint: Option<String>,
    #[serde(default)]
    pub(super) authorization_response_iss_parameter_supported: bool,
}

impl Endpoints {
    fn are_safe(&self) -> bool {
        let further = [
            &self.authorization_endpoint,
            &self.token_endpoint,
            &self.end_session_endpoint,
            &self.revocation_endpoint,
        ];
        let mut all = further.into_iter().flatten().chain([&self.jwks_uri]);
        all.all(|address| is_safe(address))
    }
}

/// Reads what an issuer publishes.
pub(super) async fn read(client: &HttpClient, issuer: &str) -> Result<Known, Away> {
    let place = issuer.trim_end_matches('/');
    let document = get(client, &format!("{place}/.well-known/openid-configuration")).await?;
    let endpoints: Endpoints = serde_json::from_value(document).map_err(|_| Away::Unreadable)?;
    if endpoints.issuer != issuer {
        return Err(Away::OtherName);
    }
    if !endpoints.are_safe() {
        return Err(Away::Unsafe);
    }
    let keys = Key::all_of(&get(client, &endpoints.jwks_uri).await?);
    if keys.is_empty() {
        return Err(Away::NoKeys);
    }
    Ok(Known {
        keys,
        endpoints,
        read: Instant::now(),
    })
}

/// Whether nobody on the way can change what comes from an address: by TLS, or without leaving this machine.
pub(super) fn is_safe(address: &str) -> bool {
    let Ok(uri) = address.parse::<Uri>() else {
        return false;
    };
    let Some(authority) = uri.authority() else {
        return false;
    };
    let is_own = crate::auth::is_name_of_this_machine(authority.host());
    let is_by_tls = uri.scheme_str() == Some("https");
    let is_plain = uri.scheme_str() == Some("http") && is_own;
    (is_by_tls || is_plain) && !authority.as_str().contains('@')
}

async fn get(client: &HttpClient, address: &str) -> Result<Value, Away> {
    let request = Request::get(address)
        .header(header::ACCEPT, "application/json")
        .body(Full::<Bytes>::default())
        .map_err(|_| Away::Unreadable)?;
    let answered = async {
        let answer = client.request(request).await.map_err(|_| Away::Silent)?;
        if answer.status() != StatusCode::OK {
            return Err(Away::Status(answer.status().as_u16()));
        }
        let body = Limited::new(answer.into_body(), MAX_BYTES).collect().await;
        let body = body.map_err(|_| Away::Unreadable)?.to_bytes();
        serde_json::from_slice(&body).map_err(|_| Away::Unreadable)
    };
    let answered = tokio::time::timeout(ANSWER, answered).await;
    answered.unwrap_or(Err(Away::Silent))
}
