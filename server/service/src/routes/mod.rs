//! The routes of the service.

pub mod acquired;
pub mod asked;
pub mod bodies;
pub mod candidates;
pub mod cases;
pub mod dicom;
pub mod documents;
pub mod events;
pub mod findings;
pub(crate) mod guarded;
pub mod health;
pub mod layers;
pub mod masks;
pub mod mesh;
pub mod nifti;
pub mod preferences;
pub mod readings;
pub mod registration;
pub mod render;
pub mod renders;
pub mod report;
pub mod search;
pub mod share;
pub mod sign_in;
pub mod slices;
pub mod textures;
pub mod upload;
mod versioned;

use std::sync::Arc;

use axum::Router;
use axum::extract::{DefaultBodyLimit, FromRef as _, RawPathParams, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::middleware::{self, Next};
use axum::response::Response;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use ::cases::Cases;
use ::cases::pictures::{ShownDepth, surface_version};
use ::render::RESEARCH_USE_NOTICE;
use case::{CaseId, SurfaceName};

use crate::state::{AnswerTimeout, AppState, GuardAll, Uploads};
use access::audited::Audited;
use access::auth::{self, Access, Guard};
use access::routes::{GuardedRoutes, ScopeTable};
use access::scopes::Scope;
use http::conditional::{self, Format};
use http::listen::client_of;
use http::problem::AppError;
use http::sent::MAX_BODY_BYTES;
use storage::tables::cases::closed;

/// The header that says why the case behind an answer is closed.
const CLOSED: HeaderName = HeaderName::from_static("x-isocortex-closed");

/// The header with the quality of the mask behind an answer.
const QUALITY: HeaderName = HeaderName::from_static("x-isocortex-quality");

/// Room in an upload for everything but files: boundaries, part headers, parameters.
const FORM_OVERHEAD_BYTES: u64 = 1 << 20;

/// The title page of the interface's description.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "Isocortex",
        description = introduction()
    ),
    servers((url = "/", description = "This server")),
    tags(
        (name = "cases", description = "Heads: upload, progress, list, delete"),
        (name = "meshes", description = "The mesh at a depth, or at all depths"),
        (name = "masks", description = "Brain masks: download, replace, quality"),
        (name = "textures", description = "Voxels, for clients that render"),
        (name = "layers", description = "Further volumes of the same head, maps of the junction of grey and white matter, and the places that stand out in them"),
        (name = "findings", description = "What readers have marked and written, and their signed readings"),
        (name = "pictures", description = "PNG pictures made by the server"),
        (name = "service", description = "The server itself"),
    )
)]
struct Description;

fn introduction() -> String {
    format!(
        "The cortex of the brain as curved cuts at any depth below the dura. {RESEARCH_USE_NOTICE}\n\n\
         Lengths are in mm, coordinates in the patient space of DICOM (LPS), angles in degrees. Unknown query keys are an \
         error. Errors are application/problem+json (RFC 9457) with a stable `type`. Everything under a case is immutable \
         and carries a strong ETag, except its state, its events, its findings, its readings, annotated pictures, lists of pictures and what depends on its layers."
    )
}

/// The routes that need a token. Each states what the token must permit, and what is recorded: of a path below `/v1/cases/`, with its `id`.
fn guarded_routes(state: &AppState) -> GuardedRoutes<AppState> {
    let counts = || middleware::from_fn_with_state(state.cases.clone(), add_state_of_case);
    let answers = GuardedRoutes::default()
        .with(Scope::Read, Audited::No, routes!(sign_in::get_session))
        .with(Scope::Read, Audited::Query, routes!(cases::list_cases))
        .with(Scope::Read, Audited::View, routes!(cases::get_case))
        .with(Scope::Write, Audited::Change, routes!(cases::patch_case))
        .with(Scope::Write, Audited::Delete, routes!(cases::delete_case))
        .with(Scope::Read, Audited::Identity, routes!(dicom::get_dicom))
        .with(Scope::Read, Audited::View, routes!(mesh::get_mesh))
        .with(Scope::Read, Audited::View, routes!(mesh::get_triangles))
        .with(Scope::Read, Audited::View, routes!(mesh::get_paths))
        .with(Scope::Read, Audited::View, routes!(textures::get_volume))
        .with(Scope::Read, Audited::View, routes!(textures::get_distance))
        .with(Scope::Read, Audited::View, routes!(render::get_render))
        .with(Scope::Read, Audited::View, routes!(slices::get_slice))
        .with(Scope::Read, Audited::View, routes!(acquired::get_acquired))
        .with(Scope::Read, Audited::Export, routes!(masks::get_mask))
        .with(Scope::Read, Audited::Export, routes!(masks::get_envelope))
        .with(Scope::Read, Audited::Export, routes!(nifti::get_nifti))
        .with(Scope::Read, Audited::View, routes!(masks::get_quality))
        .with(Scope::Read, Audited::View, routes!(layers::list_layers))
        .with(Scope::Read, Audited::View, routes!(layers::get_layer))
        .with(Scope::Write, Audited::Change, routes!(layers::patch_layer))
        .with(Scope::Write, Audited::Delete, routes!(layers::delete_layer))
        .with(
            Scope::Read,
            Audited::View,
            routes!(layers::get_layer_volume),
        )
        .with(
            Scope::Read,
            Audited::Export,
            routes!(layers::get_layer_nifti),
        )
        .with(
            Scope::Read,
            Audited::View,
            routes!(candidates::get_candidates),
        )
        .with(Scope::Read, Audited::View, routes!(candidates::get_profile))
        .with(
            Scope::Read,
            Audited::View,
            routes!(registration::get_registration),
        )
        .with(Scope::Read, Audited::Export, routes!(report::get_report))
        .with(Scope::Read, Audited::Export, routes!(share::get_share))
        .and(
            GuardedRoutes::default()
                .with(Scope::Read, Audited::View, routes!(findings::get_findings))
                .with(
                    Scope::Write,
                    Audited::Change,
                    routes!(findings::put_findings),
                )
                .with(
                    Scope::Write,
                    Audited::Change,
                    routes!(findings::take_over_findings),
                )
                .with(Scope::Read, Audited::View, routes!(readings::list_readings))
                .with(Scope::Read, Audited::View, routes!(readings::get_reading))
                .with(
                    Scope::Read,
                    Audited::View,
                    routes!(readings::get_own_reading),
                )
                .with(
                    Scope::Write,
                    Audited::Change,
                    routes!(readings::put_own_reading),
                )
                .with(
                    Scope::Write,
                    Audited::Signature,
                    routes!(readings::sign_own_reading),
                )
                .map(|routes| routes.layer(DefaultBodyLimit::max(findings::MAX_BYTES))),
        )
        .and(
            GuardedRoutes::default()
                // It draws what its body lists, and changes nothing.
                .with(
                    Scope::Read,
                    Audited::Export,
                    routes!(renders::create_renders),
                )
                // What identifies a patient is in its body, not in an address. Its answer says whether it shows patients.
                .with(Scope::Read, Audited::Query, routes!(search::search_cases))
                .map(|routes| routes.layer(DefaultBodyLimit::max(MAX_BODY_BYTES))),
        )
        .and(
            GuardedRoutes::default()
                // They are nothing of a case or a patient: whoever may look has some, and nothing of them is recorded.
                .with(
                    Scope::Read,
                    Audited::No,
                    routes!(preferences::get_preferences),
                )
                .with(
                    Scope::Read,
                    Audited::No,
                    routes!(preferences::put_preferences),
                )
                .with(
                    Scope::Read,
                    Audited::No,
                    routes!(preferences::delete_preferences),
                )
                .map(|routes| routes.layer(DefaultBodyLimit::max(::cases::preferences::MAX_BYTES))),
        )
        .map(|routes| {
            let limit = AnswerTimeout::from_ref(state);
            let in_time = middleware::from_fn_with_state(limit, answer_in_time);
            routes.route_layer(counts()).route_layer(in_time)
        });
    let upload_limit = Uploads::from_ref(state).limits.max_bytes;
    let upload_limit = upload_limit.saturating_add(FORM_OVERHEAD_BYTES);
    let upload_limit = usize::try_from(upload_limit).unwrap_or(usize::MAX);
    // These have no time limit: an upload has its own limits, and events end with the case.
    let streams = GuardedRoutes::default()
        .with(Scope::Write, Audited::Upload, routes!(upload::create_case))
        .with(Scope::Write, Audited::Upload, routes!(masks::put_mask))
        .with(
            Scope::Write,
            Audited::Upload,
            routes!(upload::layer::create_layer),
        )
        .map(|routes| routes.layer(DefaultBodyLimit::max(upload_limit)))
        .with(Scope::Read, Audited::View, routes!(events::get_events))
        .with(
            Scope::Read,
            Audited::View,
            routes!(layers::get_layer_events),
        )
        .map(|routes| routes.route_layer(counts()));
    let guarded = answers.and(streams);
    match GuardAll::from_ref(state) {
        GuardAll(true) => guarded.and(operation_routes()),
        GuardAll(false) => guarded,
    }
}

/// The routes about the server itself, which need a token if that is configured.
fn operation_routes() -> GuardedRoutes<AppState> {
    GuardedRoutes::default()
        .with(Scope::Metrics, Audited::No, routes!(health::metrics))
        .with(Scope::Read, Audited::No, routes!(health::version))
}

/// What the token of each route must permit, and what is recorded.
pub fn scopes(state: &AppState) -> ScopeTable {
    let (_, scopes) = guarded_routes(state).into_parts();
    scopes.and(documents::scopes())
}

/// Every route but the static documents, and their description.
pub fn all(state: &AppState) -> (Router<AppState>, utoipa::openapi::OpenApi) {
    let open = OpenApiRouter::new()
        .routes(routes!(health::healthz))
        .routes(routes!(health::readyz))
        .routes(routes!(sign_in::get_sign_in));
    let open = match GuardAll::from_ref(state) {
        GuardAll(true) => open,
        GuardAll(false) => open.merge(operation_routes().into_parts().0),
    };
    let (guarded, scopes) = guarded_routes(state).into_parts();
    let guard = guard(state, scopes);
    let guarded = guarded
        .route_layer(middleware::from_fn(in_turn))
        .route_layer(middleware::from_fn_with_state(guard, auth::require_token));
    let (routes, mut description) = guarded.split_for_parts();
    guarded::describe(&mut description);
    let guarded = OpenApiRouter::from(routes);
    OpenApiRouter::with_openapi(Description::openapi().merge_from(description))
        .merge(guarded)
        .merge(open)
        .split_for_parts()
}

/// The guard of routes with these scopes.
pub(crate) fn guard(state: &AppState, scopes: ScopeTable) -> Guard {
    Guard {
        access: Access::from_ref(state),
        scopes: Arc::new(scopes),
        audit: state.audit().clone(),
    }
}

/// Handles a request so that its work takes turns with that of other clients.
pub(crate) async fn in_turn(request: Request, next: Next) -> Response {
    let client = client_of(request.extensions());
    ::cases::for_client(client, next.run(request)).await
}

/// Abandons an answer that takes too long. Work that is still waiting is cancelled.
pub(crate) async fn answer_in_time(
    State(AnswerTimeout(limit)): State<AnswerTimeout>,
    request: Request,
    next: Next,
) -> Result<Response, AppError> {
    let is_of_many = request.uri().path().ends_with("/renders");
    tokio::time::timeout(limit, next.run(request))
        .await
        .map_err(|_elapsed| {
            if is_of_many {
                let limit_s = limit.as_secs();
                AppError::too_slow(format!(
                        "these pictures were not drawn within the limit of {limit_s} s; request fewer or smaller ones, in several requests"
                    ))
            } else {
                AppError::timed_out()
            }
        })
}

/// Adds the quality of the mask, and why the case is closed, as headers to all answers that show a case.
async fn add_state_of_case(
    State(cases): State<Cases>,
    path: RawPathParams,
    request: Request,
    next: Next,
) -> Response {
    let id = path.iter().find(|(name, _)| *name == "id");
    let id = id.and_then(|(_, text)| CaseId::parse(text));
    let mut response = next.run(request).await;
    let shows = response.status().is_success() || response.status() == StatusCode::NOT_MODIFIED;
    if let Some(id) = id.filter(|_| shows)
        && let Some(quality) = cases.known_quality(&id)
    {
        response
            .headers_mut()
            .insert(QUALITY, HeaderValue::from_static(quality.name()));
    }
    // Without the database, what was seen a moment ago is still shown, and nobody knows of anything later.
    if let Some(id) = id.filter(|_| shows)
        && let Ok(mut connection) = cases.store().connect().await
        && let Ok(Some(why)) = closed(&mut connection, &id).await
    {
        let why = HeaderValue::from_static(why.name());
        response.headers_mut().insert(CLOSED, why);
    }
    response
}

/// The format of an answer about a surface: what shows a part of the brain must be validated before each use, because a later version of
/// this program may divide it otherwise.
fn of_surface(format: Format, variant: &str, surface: SurfaceName) -> Format {
    match surface_version(surface) {
        None => format,
        Some(version) => format
            .variant(format!("{variant}; {version}"))
            .revalidated(),
    }
}

/// Adds the headers with the depth of an answer, and whether it was clamped.
pub(crate) fn depth_headers(depth: ShownDepth) -> HeaderMap {
    let mut headers = HeaderMap::new();
    conditional::insert(
        &mut headers,
        HeaderName::from_static("x-isocortex-depth-mm"),
        &depth.mm.to_string(),
    );
    conditional::insert(
        &mut headers,
        HeaderName::from_static("x-isocortex-depth-clamped"),
        &depth.is_clamped.to_string(),
    );
    headers
}
