//! The common part of the descriptions of all guarded routes.

use utoipa::openapi::path::{Operation, ParameterIn};
use utoipa::openapi::schema::{AnyOf, ObjectBuilder, SchemaType, Type};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Components, Content, OpenApi, Ref, RefOr, ResponseBuilder, Schema};

/// The names of the schemes in the description.
const BEARER: &str = "bearer";
const BASIC: &str = "basic";

/// Describes the token, the answers that any guarded route may give, and the body of every error.
pub(crate) fn describe(api: &mut OpenApi) {
    let components = api.components.get_or_insert_with(Components::default);
    for (name, scheme, description) in [
        (
            BEARER,
            HttpAuthScheme::Bearer,
            "Required if the server has a token.",
        ),
        (
            BASIC,
            HttpAuthScheme::Basic,
            "The token as the password of any user, for clients that know nothing else.",
        ),
    ] {
        let scheme = HttpBuilder::new().scheme(scheme);
        let scheme = scheme.description(Some(description)).build();
        components.add_security_scheme(name, SecurityScheme::Http(scheme));
    }
    for schema in components.schemas.values_mut() {
        let_be_absent(schema);
    }
    for (path, item) in &mut api.paths.paths {
        let reads = [&mut item.get, &mut item.head];
        for operation in reads.into_iter().flatten() {
            guard(operation, path);
            // All that belongs to a case refuses keys that it does not know.
            if has_keys(operation) || path.contains("{id}/") {
                add(operation, "400", "A key or value of the query is invalid");
            }
            if path.contains("{id}/") && is_negotiated(operation) {
                add(operation, "406", "No accepted media type is available");
                let unchanged =
                    ResponseBuilder::new().description("The client already has this answer");
                let responses = &mut operation.responses.responses;
                responses
                    .entry("304".to_owned())
                    .or_insert_with(|| unchanged.build().into());
            }
        }
        let writes = [
            &mut item.put,
            &mut item.post,
            &mut item.patch,
            &mut item.delete,
        ];
        for operation in writes.into_iter().flatten() {
            guard(operation, path);
        }
    }
}

/// Describes groups of fields that are there in some states only, such as the facts of a ready case: derived is that they are `null`
/// otherwise, and they are absent.
fn let_be_absent(schema: &mut RefOr<Schema>) {
    let is_null = |item: &RefOr<Schema>| matches!(item, RefOr::T(Schema::Object(object)) if object.schema_type == SchemaType::Type(Type::Null));
    let RefOr::T(Schema::AllOf(all)) = schema else {
        return;
    };
    for item in &mut all.items {
        let RefOr::T(Schema::OneOf(one)) = item else {
            continue;
        };
        if !one.items.iter().any(is_null) {
            continue;
        }
        let mut items = std::mem::take(&mut one.items);
        items.retain(|item| !is_null(item));
        let anything = ObjectBuilder::new().schema_type(SchemaType::AnyValue);
        items.push(Schema::from(anything).into());
        let mut any = AnyOf::new();
        any.items = items;
        *item = Schema::AnyOf(any).into();
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

/// Whether the query has keys.
fn has_keys(operation: &Operation) -> bool {
    let parameters = operation.parameters.iter().flatten();
    parameters.into_iter().any(
        |parameter| matches!(parameter, RefOr::T(key) if key.parameter_in == ParameterIn::Query),
    )
}

fn guard(operation: &mut Operation, path: &str) {
    let nothing: [&str; 0] = [];
    operation.security = Some(vec![
        SecurityRequirement::new(BEARER, nothing),
        SecurityRequirement::new(BASIC, nothing),
        // Without a configured token, the server requires none.
        SecurityRequirement::default(),
    ]);
    add(
        operation,
        "401",
        "A token is required, or the token has ended or was refused",
    );
    add(operation, "403", "The token lacks a scope");
    add(
        operation,
        "507",
        "The audit record of the server cannot be written",
    );
    if path.starts_with("/v1/cases/{id}") {
        add(operation, "404", "No such case");
    }
    for (status, answer) in &mut operation.responses.responses {
        let is_error = status.starts_with(['4', '5']);
        if let RefOr::T(answer) = answer
            && is_error
            && answer.content.is_empty()
        {
            answer.content.insert(PROBLEM.to_owned(), problem().into());
        }
    }
}

/// The media type of every error.
const PROBLEM: &str = "application/problem+json";

fn problem() -> Content {
    Content::new(Some(Ref::from_schema_name("Problem")))
}

/// Adds a problem as an answer, unless the route describes it itself.
fn add(operation: &mut Operation, status: &str, description: &str) {
    let response = ResponseBuilder::new()
        .description(description)
        .content(PROBLEM, problem())
        .build();
    let responses = &mut operation.responses.responses;
    responses
        .entry(status.to_owned())
        .or_insert_with(|| response.into());
}
