//! Who may ask: the bearer token, the Host header, and pages of other sites.

use std::net::IpAddr;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, Method, Uri, header};
use axum::middleware::Next;
use axum::response::Response;

use crate::problem::AppError;

/// The fewest characters of a bearer token: 16 random ones cannot be guessed.
pub const MIN_TOKEN_LENGTH: usize = 16;

/// Who may ask.
///
/// With a token every request under `/v1` must carry it, whatever name the server was reached by. Without one the server
/// listens on this machine alone, and answers only to the names of this machine: a page of another site that has its
/// own name resolve to 127.0.0.1 (DNS rebinding) is refused by its Host header.
#[derive(Debug, Clone, Default)]
pub struct Access {
    /// A digest: digests are compared in constant time, and tokens of any length in the same.
    token: Option<blake3::Hash>,
}

/// The token cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the token must be at least {MIN_TOKEN_LENGTH} printable ASCII characters without spaces")]
pub struct BadToken;

impl Access {
    /// Anyone on this machine may ask.
    pub fn of_this_machine() -> Self {
        Self::default()
    }

    /// Whoever knows the token may ask.
    ///
    /// # Errors
    /// When the token is too short, or cannot be sent in a header.
    pub fn with_token(token: &str) -> Result<Self, BadToken> {
        let sendable = token.bytes().all(|byte| byte.is_ascii_graphic());
        if token.len() < MIN_TOKEN_LENGTH || !sendable {
            return Err(BadToken);
        }
        Ok(Self {
            token: Some(blake3::hash(token.as_bytes())),
        })
    }

    /// Whether a token is wanted.
    pub fn wants_token(&self) -> bool {
        self.token.is_some()
    }

    fn check_token(&self, headers: &HeaderMap) -> Result<(), AppError> {
        let Some(expected) = &self.token else {
            return Ok(());
        };
        let given = bearer_token(headers).ok_or(AppError::Unauthorized)?;
        if blake3::hash(given) == *expected {
            Ok(())
        } else {
            Err(AppError::Unauthorized)
        }
    }

    fn check_host(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), AppError> {
        if self.wants_token() {
            return Ok(());
        }
        let named = headers.get(header::HOST).map(|host| host.to_str());
        let named = match named {
            None => None,
            Some(host) => Some(host.map_err(|_| AppError::WrongHost)?),
        };
        let of_this_machine = |host: &str| is_name_of_this_machine(without_port(host));
        if named.is_none_or(of_this_machine) && uri.host().is_none_or(is_name_of_this_machine) {
            Ok(())
        } else {
            Err(AppError::WrongHost)
        }
    }
}

fn bearer_token(headers: &HeaderMap) -> Option<&[u8]> {
    let value = headers.get(header::AUTHORIZATION)?.as_bytes();
    let (scheme, token) = value.split_at_checked(b"Bearer ".len())?;
    scheme
        .eq_ignore_ascii_case(b"Bearer ")
        .then(|| token.trim_ascii())
}

/// `localhost:80` → `localhost`, `[::1]:80` → `[::1]`.
fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

fn is_name_of_this_machine(host: &str) -> bool {
    let address = host
        .strip_prefix('[')
        .and_then(|rest| rest.strip_suffix(']'))
        .unwrap_or(host);
    host.eq_ignore_ascii_case("localhost")
        || address.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

/// Whether a browser says that a page of another site wants to change something.
fn is_cross_site_change(method: &Method, headers: &HeaderMap) -> bool {
    let site = headers.get("sec-fetch-site");
    !method.is_safe() && site.is_some_and(|site| site != "same-origin" && site != "none")
}

/// Refuses requests that name another machine, and changes asked for by pages of other sites.
///
/// # Errors
/// [`AppError::WrongHost`], [`AppError::CrossSite`].
pub async fn guard_origin(
    State(access): State<Access>,
    request: Request,
    next: Next,
) -> Result<Response, AppError> {
    access.check_host(request.uri(), request.headers())?;
    if is_cross_site_change(request.method(), request.headers()) {
        return Err(AppError::CrossSite);
    }
    Ok(next.run(request).await)
}

/// Refuses requests without the token, where one is configured.
///
/// # Errors
/// [`AppError::Unauthorized`].
pub async fn require_token(
    State(access): State<Access>,
    request: Request,
    next: Next,
) -> Result<Response, AppError> {
    access.check_token(request.headers())?;
    Ok(next.run(request).await)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_header(name: header::HeaderName, value: &str) -> HeaderMap {
        HeaderMap::from_iter([(name, value.parse().unwrap())])
    }

    #[test]
    fn the_token_and_nothing_else_opens() {
        let access = Access::with_token("0123456789abcdef").unwrap();
        let allowed = |value: &str| {
            access
                .check_token(&with_header(header::AUTHORIZATION, value))
                .is_ok()
        };
        assert!(allowed("Bearer 0123456789abcdef"));
        assert!(allowed("bearer 0123456789abcdef"));
        assert!(!allowed("Bearer 0123456789abcdeF"));
        assert!(!allowed("Bearer "));
        assert!(!allowed("Basic 0123456789abcdef"));
        assert!(access.check_token(&HeaderMap::new()).is_err());
    }

    #[test]
    fn short_and_unsendable_tokens_are_refused() {
        assert!(Access::with_token("short").is_err());
        assert!(Access::with_token("0123456789 abcdef").is_err());
        assert!(Access::with_token("0123456789abcdé0123").is_err());
    }

    #[test]
    fn only_names_of_this_machine_are_answered_without_a_token() {
        let access = Access::of_this_machine();
        let allowed = |host: &str| {
            access
                .check_host(&Uri::from_static("/"), &with_header(header::HOST, host))
                .is_ok()
        };
        for host in [
            "localhost",
            "LOCALHOST:8640",
            "127.0.0.1:1",
            "[::1]:8640",
            "[::1]",
        ] {
            assert!(allowed(host), "{host}");
        }
        for host in [
            "example.org",
            "localhost.example.org:80",
            "10.0.0.1",
            "127.0.0.1.nip.io",
        ] {
            assert!(!allowed(host), "{host}");
        }
    }

    #[test]
    fn pages_of_other_sites_may_not_change_anything() {
        let site = |value| with_header("sec-fetch-site".parse().unwrap(), value);
        assert!(is_cross_site_change(&Method::POST, &site("cross-site")));
        assert!(is_cross_site_change(&Method::DELETE, &site("same-site")));
        assert!(!is_cross_site_change(&Method::POST, &site("same-origin")));
        assert!(!is_cross_site_change(&Method::GET, &site("cross-site")));
        assert!(!is_cross_site_change(&Method::POST, &HeaderMap::new()));
    }
}
