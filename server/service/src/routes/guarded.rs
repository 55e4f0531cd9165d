//! The common part of the descriptions of all guarded routes.

use utoipa::openapi::path::Operation;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Components, Content, OpenApi, Ref, RefOr, ResponseBuilder};

/// The name of the scheme in the description.
const BEARER: &str = "bearer";

/// Describes the bearer token, and the answers that any guarded route may give.
pub(crate) fn describe(api: &mut OpenApi) {
    let scheme = HttpBuilder::new()
        .scheme(HttpAuthScheme::Bearer)
        .description(Some("Required if the server has a token."))
        .build();
    api.components
        .get_or_insert_with(Components::default)
        .add_security_scheme(BEARER, SecurityScheme::Http(scheme));
    for (path, item) in &mut api.paths.paths {
        let reads = [&mut item.get, &mut item.head];
        for operation in reads.into_iter().flatten() {
            guard(operation);
            if path.contains("{id}/") && is_negotiated(operation) {
                add(operation, "406", "No accepted media type is available");
            }
        }
        let writes = [
            &mut item.put,
            &mut item.post,
            &mut item.patch,
            &mut item.delete,
        ];
        writes.into_iter().flatten().for_each(guard);
    }
}

/// Whether the answer has a media type that a client may not accept. JSON and events are sent to all.
fn is_negotiated(operation: &Operation) -> bool {
    match operation.responses.responses.get("200") {
        Some(RefOr::T(answer)) => (answer.content.keys())
            .any(|kind| !["application/json", "text/event-stream"].contains(&kind.as_str())),
        _ => false,
    }
}

fn guard(operation: &mut Operation) {
    let nothing: [&str; 0] = [];
    operation.security = Some(vec![
        SecurityRequirement::new(BEARER, nothing),
        // Without a configured token, the server requires none.
        SecurityRequirement::default(),
    ]);
    add(operation, "401", "A token is required");
    add(
        operation,
        "429",
        "Too many wrong tokens came from the address of the client",
    );
}

/// Adds a problem as an answer, unless the route describes it itself.
fn add(operation: &mut Operation, status: &str, description: &str) {
    let problem = Content::new(Some(Ref::from_schema_name("Problem")));
    let response = ResponseBuilder::new()
        .description(description)
        .content("application/problem+json", problem)
        .build();
    let responses = &mut operation.responses.responses;
    responses
        .entry(status.to_owned())
        .or_insert_with(|| response.into());
}
