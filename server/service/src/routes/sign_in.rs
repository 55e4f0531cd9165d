//! Who asks, and how people sign in.

use axum::Extension;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;

use access::auth::Access;
use access::tokens::Holder;
use access::tokens::PROXY_PREFIX;
use http::fresh::fresh_json;
use http::listen::ByProxy;
use http::query::{ApiQuery, NoQuery};

/// Who asks.
#[derive(Debug, Serialize, ToSchema)]
pub struct Session {
    /// The name of the token; `token` for the token without a name; `proxy:` and the name of the user for somebody whom a proxy has
    /// signed in; `anybody` if no token is required.
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
    let proxy = access
        .proxy()
        .filter(|_| holder.name.starts_with(PROXY_PREFIX));
    let session = Session {
        name: holder.name.as_ref().to_owned(),
        scopes: holder.scopes.iter().map(|scope| scope.name()).collect(),
        sign_out: proxy.and_then(|proxy| proxy.options().sign_out.clone()),
    };
    fresh_json(StatusCode::OK, &session)
}

/// How people sign in.
#[derive(Debug, Serialize, ToSchema)]
pub struct SignIn {
    /// Whether the request came through a proxy that signs people in. Otherwise the page asks for a token.
    by_proxy: bool,
}

/// How people sign in
#[utoipa::path(get, path = "/sign-in", tag = "service", responses((status = 200, description = "Whether a proxy signs people in", body = SignIn)))]
pub async fn get_sign_in(
    State(access): State<Access>,
    ByProxy(by_proxy): ByProxy,
    _no_query: ApiQuery<NoQuery>,
) -> Response {
    let by_proxy = by_proxy && access.proxy().is_some();
    fresh_json(StatusCode::OK, &SignIn { by_proxy })
}
