//! Who asks, and how people sign in.

use axum::Extension;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;

use http_support::auth::Access;
use http_support::fresh::fresh_json;
use http_support::listen::ByProxy;
use http_support::oidc::SignIn;
use http_support::problem::{AppError, Problem};
use http_support::proxy::PREFIX;
use http_support::query::{ApiQuery, NoQuery};
use http_support::tokens::Holder;

/// Who asks.
#[derive(Debug, Serialize, ToSchema)]
pub struct Session {
    /// The name of the token; `oidc:` and the subject for somebody who has signed in at the issuer; `token` for the token without a
    /// name; `proxy:` and the name of the user for somebody whom a proxy has signed in; `anybody` if no token is required.
    name: String,
    /// What the token permits.
    scopes: Vec<&'static str>,
    /// Where the page goes so that the proxy signs the person out; none if nobody was signed in by a proxy, or it has no such place.
    #[serde(skip_serializing_if = "Option::is_none")]
    sign_out: Option<String>,
}

/// Who asks, and what the token permits
#[utoipa::path(get, path = "/v1/session", tag = "service", responses((status = 200, description = "The holder of the token", body = Session)))]
pub async fn get_session(
    State(access): State<Access>,
    Extension(holder): Extension<Holder>,
    _no_query: ApiQuery<NoQuery>,
) -> Response {
    let proxy = access.proxy().filter(|_| holder.name.starts_with(PREFIX));
    let session = Session {
        name: holder.name.as_ref().to_owned(),
        scopes: holder.scopes.iter().map(|scope| scope.name()).collect(),
        sign_out: proxy.and_then(|proxy| proxy.options().sign_out.clone()),
    };
    fresh_json(StatusCode::OK, &session)
}

/// Where and how the page signs in
///
/// By authorization code with PKCE at the issuer of the configuration, or by a proxy in front of the server (`by_proxy`). Without either, the
/// page asks for a token.
#[utoipa::path(get, path = "/sign-in", tag = "service", responses(
    (status = 200, description = "The issuer, if the page signs in by one", body = SignIn),
    (status = 503, description = "The issuer does not answer", body = Problem, content_type = "application/problem+json"),
))]
pub async fn get_sign_in(
    State(access): State<Access>,
    ByProxy(by_proxy): ByProxy,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    let sign_in = match access.issuer() {
        Some(issuer) => issuer.sign_in().await?,
        None => SignIn::default(),
    };
    let sign_in = sign_in.by_proxy(by_proxy && access.proxy().is_some());
    Ok(fresh_json(StatusCode::OK, &sign_in))
}
