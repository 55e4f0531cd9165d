//! Access control: the bearer token, the Host header, and pages of other sites.

use std::future::pending;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::SystemTime;

use crate::audit::Audit;
use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderValue, Method, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use case::Client;
use futures_util::StreamExt as _;
use tokio::sync::watch;

use crate::audited::Recorder;
use crate::error::AccessError;
use crate::origins::Origins;
use crate::proxy::{ASKED_AGAIN_AFTER, SignInProxy};
use crate::routes::ScopeTable;
use crate::tokens::{Holder, Mismatch, NamedToken, Tokens};
use http::listen::{ByProxy, is_endless};

/// The fewest characters of a bearer token: 16 random ones cannot be guessed.
pub const MIN_TOKEN_LENGTH: usize = 16;

/// Where DICOMweb clients ask.
const DICOMWEB: &str = "/dicomweb/";

/// Asks for the token as a password.
const BASIC: HeaderValue = HeaderValue::from_static("Basic realm=\"isocortex\", charset=\"UTF-8\"");

/// The access rules.
///
/// With a token, every request under `/v1` must carry it, under any host name. Without a token, the server listens on
/// this machine only and accepts only its names as Host, which defeats DNS rebinding: a page of another site whose name
/// resolves to 127.0.0.1.
#[derive(Debug, Clone, Default)]
pub struct Access {
    /// `None` if none is required. All clones share them, because they can be replaced.
    tokens: Arc<watch::Sender<Option<Tokens>>>,
    /// Which headers of a proxy open beside these.
    proxy: Option<SignInProxy>,
    origins: Origins,
}

/// The token is too weak.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the token must be at least {MIN_TOKEN_LENGTH} printable ASCII characters without spaces")]
pub struct BadToken;

impl Access {
    /// Everyone on this machine has access.
    pub fn of_this_machine() -> Self {
        Self::default()
    }

    /// Everyone with the token has access to everything.
    ///
    /// # Errors
    /// If the token is too short, or cannot be sent in a header.
    pub fn with_token(token: &str) -> Result<Self, BadToken> {
        Ok(Self::with_tokens(vec![unnamed(token)?]))
    }

    /// Everyone with one of the tokens has the access that its scopes give.
    pub fn with_tokens(tokens: Vec<NamedToken>) -> Self {
        Self {
            tokens: Arc::new(watch::Sender::new(Some(Tokens::new(tokens)))),
            ..Self::default()
        }
    }

    /// The same, for pages of other origins too.
    #[must_use]
    pub fn with_origins(self, origins: Origins) -> Self {
        Self { origins, ..self }
    }

    /// The same, for whomever a proxy has signed in too.
    #[must_use]
    pub fn with_proxy(self, proxy: Option<SignInProxy>) -> Self {
        Self { proxy, ..self }
    }

    /// How people sign in by a proxy, if they do.
    pub fn proxy(&self) -> Option<&SignInProxy> {
        self.proxy.as_ref()
    }

    /// The origins whose pages have access.
    pub fn origins(&self) -> &Origins {
        &self.origins
    }

    /// Accepts the tokens of other rules from now on, and those of before no longer. Whether a token is required stays as
    /// it was.
    pub fn replace_tokens(&self, other: &Self) {
        let tokens = other.tokens.borrow().clone();
        if self.wants_token() && tokens.is_some() {
            self.tokens.send_replace(tokens);
        }
    }

    /// When the next of the tokens ends, if one does.
    pub fn next_end(&self) -> Option<SystemTime> {
        self.tokens.borrow().as_ref().and_then(Tokens::next_end)
    }

    /// Whether a token is required.
    pub fn wants_token(&self) -> bool {
        self.tokens.borrow().is_some()
    }

    /// The token of a request; `None` if none is required.
    fn check_token(&self, headers: &HeaderMap) -> Result<Option<NamedToken>, AccessError> {
        let tokens = self.tokens.borrow();
        let Some(tokens) = &*tokens else {
            return Ok(None);
        };
        let given = given_token(headers).ok_or(AccessError::Unauthorized)?;
        match tokens.open(&given) {
            Ok(token) => Ok(Some(token.clone())),
            Err(Mismatch::Unknown) => Err(AccessError::Unauthorized),
            Err(Mismatch::Ended) => Err(AccessError::TokenEnded),
        }
    }

    /// Who asks, by the headers of a proxy, if they are believed, or else by a token; `None` if no token is required.
    fn identify(
        &self,
        headers: &HeaderMap,
        believes_proxy: bool,
    ) -> Result<Option<Opened>, AccessError> {
        if let Some(proxy) = self.proxy.as_ref().filter(|_| believes_proxy)
            && let Some(holder) = proxy.open(headers)?
        {
            return Ok(Some(Opened {
                holder,
                by: OpenedBy::Proxy,
            }));
        }
        Ok(self.check_token(headers)?.map(|token| Opened {
            holder: token.holder.clone(),
            by: OpenedBy::Token(token),
        }))
    }

    /// Resolves when a request would no longer open what this one has opened.
    async fn no_longer(self, opened: Opened) {
        match opened.by {
            OpenedBy::Token(token) => self.closed(token).await,
            OpenedBy::Proxy => tokio::time::sleep(ASKED_AGAIN_AFTER).await,
        }
    }

    /// Resolves when a token no longer opens what it has opened: it has ended, was withdrawn, or has other scopes.
    fn closed(&self, token: NamedToken) -> impl Future<Output = ()> + Send + use<> {
        let mut tokens = self.tokens.subscribe();
        async move {
            loop {
                let ends = match tokens.borrow_and_update().as_ref() {
                    None => None,
                    Some(tokens) => match tokens.with_digest(&token.digest) {
                        Ok(found) if found.holder == token.holder => found.ends,
                        _ => return,
                    },
                };
                let ended = async {
                    match ends {
                        Some(end) => until(end).await,
                        None => pending().await,
                    }
                };
                tokio::select! {
                    // An error means that the server ends.
                    changed = tokens.changed() => if changed.is_err() { return },
                    () = ended => {}
                }
            }
        }
    }

    fn check_host(&self, uri: &Uri, headers: &HeaderMap) -> Result<(), AccessError> {
        if self.wants_token() {
            return Ok(());
        }
        let named = headers.get(header::HOST).map(|host| host.to_str());
        let named = match named {
            None => None,
            Some(host) => Some(host.map_err(|_| AccessError::WrongHost)?),
        };
        let of_this_machine = |host: &str| is_name_of_this_machine(without_port(host));
        if named.is_none_or(of_this_machine) && uri.host().is_none_or(is_name_of_this_machine) {
            Ok(())
        } else {
            Err(AccessError::WrongHost)
        }
    }
}

/// Somebody who may ask.
struct Opened {
    holder: Holder,
    by: OpenedBy,
}

enum OpenedBy {
    /// A token of this server, which may be withdrawn.
    Token(NamedToken),
    /// The headers of a proxy, which is asked again after a while.
    Proxy,
}

impl OpenedBy {
    /// The header of a request for whose value alone a browser keeps an answer. It gets no header of a proxy, which knows people by a cookie.
    fn kept_for(&self) -> HeaderValue {
        HeaderValue::from_static(match self {
            Self::Proxy => "cookie",
            Self::Token(_) => "authorization",
        })
    }
}

async fn until(end: SystemTime) {
    let left = end.duration_since(SystemTime::now());
    tokio::time::sleep(left.unwrap_or_default()).await;
}

/// A token without a name, which opens everything.
///
/// # Errors
/// If it is too short, or cannot be sent in a header.
pub fn unnamed(token: &str) -> Result<NamedToken, BadToken> {
    let sendable = token.bytes().all(|byte| byte.is_ascii_graphic());
    if token.len() < MIN_TOKEN_LENGTH || !sendable {
        return Err(BadToken);
    }
    Ok(NamedToken {
        holder: Holder::of_everything(),
        digest: blake3::hash(token.as_bytes()),
        ends: None,
    })
}

/// The scheme of the header with the token of a request.
fn given_scheme(headers: &HeaderMap) -> Option<&[u8]> {
    let value = headers.get(header::AUTHORIZATION)?.as_bytes();
    value.split(|&byte| byte == b' ').next()
}

/// The token in a request: a bearer token, or the password of `Basic`, which is all that some programs can send.
fn given_token(headers: &HeaderMap) -> Option<Vec<u8>> {
    // Of two, a proxy may have checked the other one.
    let mut values = headers.get_all(header::AUTHORIZATION).iter();
    let (value, None) = (values.next()?.as_bytes(), values.next()) else {
        return None;
    };
    let space = value.iter().position(|&byte| byte == b' ')?;
    let (scheme, given) = (&value[..space], value[space..].trim_ascii());
    if scheme.eq_ignore_ascii_case(b"Bearer") {
        return Some(given.to_vec());
    }
    if !scheme.eq_ignore_ascii_case(b"Basic") {
        return None;
    }
    let both = BASE64_STANDARD.decode(given).ok()?;
    let colon = both.iter().position(|&byte| byte == b':')?;
    Some(both[colon + 1..].to_vec())
}

/// `localhost:80` → `localhost`, `[::1]:80` → `[::1]`.
fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

pub(crate) fn is_name_of_this_machine(host: &str) -> bool {
    let address = host
        .strip_prefix('[')
        .and_then(|rest| rest.strip_suffix(']'))
        .unwrap_or(host);
    host.eq_ignore_ascii_case("localhost")
        || address.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

/// Whether a page of another site requests a change, according to its browser.
fn is_cross_site_change(method: &Method, uri: &Uri, headers: &HeaderMap) -> bool {
    !method.is_safe() && is_cross_site(uri, headers)
}

/// Whether a page of another site asks, according to its browser.
///
/// `Sec-Fetch-Site` decides if it is present; it is correct even behind a proxy that changes `Host`. Browsers omit it
/// on plain HTTP to other machines, and old browsers always; then the `Origin` must match the authority of the request.
/// A request with neither header does not come from a page.
fn is_cross_site(uri: &Uri, headers: &HeaderMap) -> bool {
    match headers.get("sec-fetch-site") {
        Some(site) => site != "same-origin" && site != "none",
        None => headers
            .get_all(header::ORIGIN)
            .iter()
            .any(|origin| !is_own_origin(origin, uri, headers)),
    }
}

/// Whether an origin has the host and port of the request. The scheme may differ, because a proxy may have terminated
/// TLS.
fn is_own_origin(origin: &HeaderValue, uri: &Uri, headers: &HeaderMap) -> bool {
    let host = headers
        .get(header::HOST)
        .and_then(|host| host.to_str().ok());
    let asked = host.or_else(|| uri.authority().map(Authority::as_str));
    let origin = origin.to_str().ok().and_then(|text| text.split_once("://"));
    let (Some((scheme, named)), Some(asked)) = (origin, asked) else {
        return false;
    };
    let usual_port = match scheme {
        "http" => ":80",
        "https" => ":443",
        _ => return false,
    };
    let [named, asked] =
        [named, asked].map(|authority| authority.strip_suffix(usual_port).unwrap_or(authority));
    named.eq_ignore_ascii_case(asked)
}

/// Rejects requests with another Host, and changes requested by pages of other sites.
///
/// # Errors
/// [`AccessError::WrongHost`], [`AccessError::CrossSite`].
pub async fn guard_origin(
    State(access): State<Access>,
    request: Request,
    next: Next,
) -> Result<Response, AccessError> {
    access.check_host(request.uri(), request.headers())?;
    let is_cross_site = is_cross_site_change(request.method(), request.uri(), request.headers());
    if is_cross_site && access.origins.allowed(request.headers()).is_none() {
        return Err(AccessError::CrossSite);
    }
    Ok(next.run(request).await)
}

/// The guard of routes: who may ask, and for what.
#[derive(Debug, Clone)]
pub struct Guard {
    pub access: Access,
    /// What each route needs, and what is recorded of it.
    pub scopes: Arc<ScopeTable>,
    /// Where it is recorded.
    pub audit: Audit,
}

/// Rejects requests without a token, if one is required, and those whose token lacks the scope of the route; what is answered is
/// recorded. A stream of events ends with the token that has opened it. Tokens are too long to be guessed at any rate. Handlers find the [`Holder`] in the extensions of the request.
///
/// # Errors
/// [`AccessError::Unauthorized`], [`AccessError::TokenEnded`], [`AccessError::ProxyRefused`], [`AccessError::CrossSite`], [`AccessError::MissingScope`],
/// [`AccessError::AuditFull`].
pub async fn require_token(
    State(Guard {
        access,
        scopes,
        audit,
    }): State<Guard>,
    mut request: Request,
    next: Next,
) -> Result<Response, AccessError> {
    let ByProxy(is_of_proxy) = ByProxy::of(request.extensions());
    // A page of another site may ask with a token that it has, if its origin is listed; not with what the browser of a person adds by
    // itself, which is the cookie that the proxy knows the person by, or a password that the browser remembers.
    let is_cross_site = is_cross_site(request.uri(), request.headers());
    let is_of_browser = match given_scheme(request.headers()) {
        None => is_of_proxy && access.proxy.is_some(),
        Some(scheme) => scheme.eq_ignore_ascii_case(b"Basic"),
    };
    let is_listed = access.origins.allowed(request.headers()).is_some();
    let believes_proxy = is_of_proxy && !is_cross_site;
    let identified = match is_cross_site && is_of_browser && !is_listed {
        true => Err(AccessError::CrossSite),
        false => access.identify(request.headers(), believes_proxy),
    };
    let refusal = match identified {
        Ok(opened) => {
            let holder = match &opened {
                Some(opened) => opened.holder.clone(),
                None => Holder::anybody(),
            };
            let path = request.extensions().get::<MatchedPath>();
            let path = path.map_or("", MatchedPath::as_str);
            let (scope, audited) = scopes.row(request.method(), path);
            let recorder = Recorder::new(&audit, &holder.name, audited, &request);
            if !holder.scopes.contains(&scope) {
                recorder.refuses(request).await;
                return Err(AccessError::MissingScope { holder, scope });
            }
            // The token without a name may be that of everybody.
            if holder.is_named() {
                let client = Client::named(&holder.name);
                request.extensions_mut().insert(client);
            }
            request.extensions_mut().insert(holder);
            let mut response = recorder.answer(request, next).await;
            if let Some(opened) = &opened {
                // A browser keeps answers for whoever has asked alone.
                let headers = response.headers_mut();
                headers.append(header::VARY, opened.by.kept_for());
            }
            return Ok(match opened {
                Some(opened) if is_endless(&response) => ending(response, access.no_longer(opened)),
                _ => response,
            });
        }
        Err(refusal) => refusal,
    };
    let mut response = refusal.into_response();
    // Some DICOMweb clients send a password only if they are asked for one. A browser would ask its user, so the page,
    // which never asks here, must not see this.
    if request.uri().path().starts_with(DICOMWEB) {
        let headers = response.headers_mut();
        headers.append(header::WWW_AUTHENTICATE, BASIC);
    }
    Ok(response)
}

/// The same response, which ends early once `end` resolves.
fn ending(response: Response, end: impl Future<Output = ()> + Send + 'static) -> Response {
    response.map(|body| Body::from_stream(body.into_data_stream().take_until(end)))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn with_header(name: header::HeaderName, value: &str) -> HeaderMap {
        HeaderMap::from_iter([(name, value.parse().unwrap())])
    }

    #[test]
    fn a_token_is_replaced_for_all_clones_and_never_removed() {
        let access = Access::with_token("0123456789abcdef").unwrap();
        let clone = access.clone();
        let opens = |token: &str| {
            let header = with_header(header::AUTHORIZATION, &format!("Bearer {token}"));
            clone.check_token(&header).is_ok()
        };
        access.replace_tokens(&Access::with_token("fedcba9876543210").unwrap());
        assert!(opens("fedcba9876543210") && !opens("0123456789abcdef"));
        access.replace_tokens(&Access::of_this_machine());
        assert!(opens("fedcba9876543210") && !opens(""));
    }

    #[tokio::test]
    async fn what_a_token_has_opened_ends_with_it() {
        let token = |ends: Option<SystemTime>| NamedToken {
            ends,
            ..unnamed("0123456789abcdef").unwrap()
        };
        let replace = |access: &Access, tokens: Vec<NamedToken>| {
            access.replace_tokens(&Access::with_tokens(tokens));
        };
        let access = Access::with_tokens(vec![token(None)]);
        let mut closed = Box::pin(access.closed(token(None)));
        let is_closed =
            async |closed: &mut _| tokio::time::timeout(Duration::ZERO, closed).await.is_ok();
        assert!(!is_closed(&mut closed).await);
        replace(
            &access,
            vec![token(None), unnamed("fedcba9876543210").unwrap()],
        );
        assert!(!is_closed(&mut closed).await, "it is still there");
        replace(&access, vec![unnamed("fedcba9876543210").unwrap()]);
        assert!(is_closed(&mut closed).await, "it was withdrawn");

        let soon = SystemTime::now() + Duration::from_millis(20);
        let access = Access::with_tokens(vec![token(Some(soon))]);
        access.closed(token(Some(soon))).await;
        assert!(SystemTime::now() >= soon);

        let access = Access::with_tokens(vec![token(None)]);
        let mut closed = Box::pin(access.closed(token(None)));
        let mut less = token(None);
        less.holder.scopes.clear();
        replace(&access, vec![less]);
        assert!(is_closed(&mut closed).await, "it has fewer scopes");
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
        let basic = |text: &str| format!("Basic {}", BASE64_STANDARD.encode(text));
        assert!(allowed(&basic("anybody:0123456789abcdef")));
        assert!(!allowed(&basic("0123456789abcdef:")));
        assert!(!allowed(&basic("0123456789abcdef")));
        assert!(access.check_token(&HeaderMap::new()).is_err());
        let mut two = with_header(header::AUTHORIZATION, "Bearer 0123456789abcdef");
        assert!(access.check_token(&two).is_ok());
        two.append(header::AUTHORIZATION, HeaderValue::from_static("Bearer x"));
        assert!(access.check_token(&two).is_err(), "which one counts?");
    }

    #[test]
    fn short_and_unsendable_tokens_are_refused() {
        assert!(Access::with_token("0123456789abcde").is_err());
        assert!(Access::with_token("0123456789abcdef").is_ok());
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

    fn crosses(method: &Method, headers: &HeaderMap) -> bool {
        is_cross_site_change(method, &Uri::from_static("/v1/cases"), headers)
    }

    #[test]
    fn pages_of_other_sites_may_not_change_anything() {
        let site = |value| with_header("sec-fetch-site".parse().unwrap(), value);
        assert!(crosses(&Method::POST, &site("cross-site")));
        assert!(crosses(&Method::DELETE, &site("same-site")));
        assert!(!crosses(&Method::POST, &site("same-origin")));
        assert!(!crosses(&Method::GET, &site("cross-site")));
        assert!(!crosses(&Method::POST, &HeaderMap::new()));
    }

    #[test]
    fn without_fetch_metadata_the_origin_must_be_the_host() {
        let change = |origin, host| {
            let mut headers = with_header(header::ORIGIN, origin);
            headers.insert(header::HOST, HeaderValue::from_static(host));
            headers
        };
        for (origin, host) in [
            ("http://127.0.0.1:8640", "127.0.0.1:8640"),
            ("https://MRI.example.org", "mri.example.org"),
            ("https://mri.example.org", "mri.example.org:443"),
            ("http://[::1]:8640", "[::1]:8640"),
        ] {
            assert!(!crosses(&Method::DELETE, &change(origin, host)), "{origin}");
        }
        for (origin, host) in [
            ("null", "127.0.0.1:8640"),
            ("", "127.0.0.1:8640"),
            ("http://127.0.0.1:8641", "127.0.0.1:8640"),
            ("http://localhost:8640", "127.0.0.1:8640"),
            ("https://example.org", "mri.example.org"),
            ("https://mri.example.org:444", "mri.example.org"),
            ("file://127.0.0.1", "127.0.0.1"),
        ] {
            let headers = change(origin, host);
            for method in [Method::POST, Method::PUT, Method::DELETE] {
                assert!(crosses(&method, &headers), "{method} {origin}");
            }
            assert!(!crosses(&Method::GET, &headers), "{origin}");
        }
        let mut trusted = change("https://mri.example.org", "127.0.0.1:8640");
        assert!(crosses(&Method::POST, &trusted));
        trusted.insert("sec-fetch-site", HeaderValue::from_static("same-origin"));
        assert!(!crosses(&Method::POST, &trusted));
        let nowhere = with_header(header::ORIGIN, "http://127.0.0.1");
        assert!(crosses(&Method::POST, &nowhere));
        let address = Uri::from_static("http://127.0.0.1/v1/cases");
        assert!(!is_cross_site_change(&Method::POST, &address, &nowhere));
    }
}
