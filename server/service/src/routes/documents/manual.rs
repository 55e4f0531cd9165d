//! The manual of the interface: one page made of its OpenAPI description, without scripts.

use std::fmt::Write as _;

use serde_json::Value;

/// The look of the manual.
pub(super) const STYLE: &str = include_str!("manual.css");

/// The manual as HTML.
///
/// `description` is an OpenAPI document of this program; what is missing in it is left out.
pub(super) fn html(description: &Value) -> String {
    let mut page = String::from(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>Isocortex: the interface</title>\n<link rel=\"icon\" href=\"data:,\">\n<link rel=\"stylesheet\" href=\"docs.css\">\n<main>\n",
    );
    write_page(&mut page, description).expect("writing to memory cannot fail");
    page.push_str("</main>\n</html>\n");
    page
}

fn write_page(page: &mut String, description: &Value) -> std::fmt::Result {
    let info = &description["info"];
    writeln!(
        page,
        "<h1>{} <small>{}</small></h1>",
        text(&info["title"]),
        text(&info["version"])
    )?;
    for paragraph in string(&info["description"]).split("\n\n") {
        writeln!(page, "<p>{}</p>", escaped(paragraph))?;
    }
    writeln!(page, "<p>As <a href=\"openapi.json\">OpenAPI 3.1</a>.</p>")?;
    for tag in items(&description["tags"]) {
        let name = string(&tag["name"]);
        writeln!(page, "<h2>{}</h2>", text(&tag["description"]))?;
        for (path, methods) in members(&description["paths"]) {
            for (method, operation) in members(methods) {
                if items(&operation["tags"]).any(|tag| tag == name) {
                    write_operation(page, method, path, operation)?;
                }
            }
        }
    }
    writeln!(page, "<h2>What answers hold</h2>")?;
    for (name, schema) in members(&description["components"]["schemas"]) {
        write_schema(page, name, schema)?;
    }
    Ok(())
}

fn write_operation(
    page: &mut String,
    method: &str,
    path: &str,
    operation: &Value,
) -> std::fmt::Result {
    let id = string(&operation["operationId"]);
    writeln!(
        page,
        "<details id=\"{}\"><summary><b>{}</b> <code>{}</code> {}</summary>",
        escaped(id),
        method.to_uppercase(),
        escaped(path),
        text(&operation["summary"])
    )?;
    writeln!(page, "<p>{}</p>", text(&operation["description"]))?;
    if items(&operation["parameters"]).next().is_some() {
        writeln!(
            page,
            "<table><caption>Parameters</caption><tr><th>Name<th>In<th>Type<th>Meaning</tr>"
        )?;
        for parameter in items(&operation["parameters"]) {
            writeln!(
                page,
                "<tr><td><code>{}</code><td>{}<td>{}<td>{}</tr>",
                text(&parameter["name"]),
                text(&parameter["in"]),
                escaped(&type_of(&parameter["schema"])),
                text(&parameter["description"])
            )?;
        }
        writeln!(page, "</table>")?;
    }
    for (media_type, content) in members(&operation["requestBody"]["content"]) {
        writeln!(
            page,
            "<p>Body: <code>{}</code>, {}</p>",
            escaped(media_type),
            escaped(&type_of(&content["schema"]))
        )?;
    }
    writeln!(
        page,
        "<table><caption>Answers</caption><tr><th>Status<th>Meaning<th>Body</tr>"
    )?;
    for (status, answer) in members(&operation["responses"]) {
        let bodies: Vec<_> = members(&answer["content"])
            .map(|(kind, _)| escaped(kind))
            .collect();
        writeln!(
            page,
            "<tr><td>{}<td>{}<td>{}</tr>",
            escaped(status),
            text(&answer["description"]),
            bodies.join("<br>")
        )?;
        for (name, header) in members(&answer["headers"]) {
            writeln!(
                page,
                "<tr><td><td><code>{}</code>: {}<td></tr>",
                escaped(name),
                text(&header["description"])
            )?;
        }
    }
    writeln!(page, "</table></details>")
}

fn write_schema(page: &mut String, name: &str, schema: &Value) -> std::fmt::Result {
    writeln!(
        page,
        "<details id=\"schema-{0}\"><summary><code>{0}</code> {1}</summary>",
        escaped(name),
        text(&schema["description"])
    )?;
    writeln!(page, "<table><tr><th>Member<th>Type<th>Meaning</tr>")?;
    let parts = std::iter::once(schema)
        .chain(items(&schema["allOf"]))
        .chain(items(&schema["oneOf"]));
    for part in parts {
        for (member, schema) in members(&part["properties"]) {
            writeln!(
                page,
                "<tr><td><code>{}</code><td>{}<td>{}</tr>",
                escaped(member),
                escaped(&type_of(schema)),
                text(&schema["description"])
            )?;
        }
    }
    writeln!(page, "</table></details>")
}

/// A type in words: `integer 3 to 512, default 30`.
fn type_of(schema: &Value) -> String {
    if let Some(reference) = schema["$ref"].as_str() {
        return reference.rsplit('/').next().unwrap_or_default().to_owned();
    }
    let values: Vec<_> = items(&schema["enum"]).filter_map(Value::as_str).collect();
    let alternatives: Vec<_> = items(&schema["oneOf"])
        .map(type_of)
        .filter(|name| name != "null")
        .collect();
    let mut words = if !values.is_empty() {
        values.join(" | ")
    } else if !alternatives.is_empty() {
        alternatives.join(" | ")
    } else if schema["items"].is_object() {
        format!("list of {}", type_of(&schema["items"]))
    } else {
        let types = items(&schema["type"])
            .filter_map(Value::as_str)
            .filter(|name| *name != "null");
        schema["type"]
            .as_str()
            .map_or_else(|| types.collect::<Vec<_>>().join(" | "), str::to_owned)
    };
    if let (Some(least), Some(most)) = (schema["minimum"].as_f64(), schema["maximum"].as_f64()) {
        words += &format!(", {least} to {most}");
    }
    if !schema["default"].is_null() {
        words += &format!(", default {}", schema["default"]);
    }
    if let Some(example) = schema["example"].as_str() {
        words += &format!(", such as {example}");
    }
    words
}

fn items(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

fn members(value: &Value) -> impl Iterator<Item = (&str, &Value)> {
    let object = value.as_object().into_iter().flatten();
    object.map(|(name, member)| (name.as_str(), member))
}

fn string(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

fn text(value: &Value) -> String {
    escaped(string(value))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn types_are_said_in_words() {
        assert_eq!(
            type_of(&json!({ "type": "integer", "minimum": 3, "maximum": 512, "default": 30 })),
            "integer, 3 to 512, default 30"
        );
        assert_eq!(
            type_of(&json!({ "$ref": "#/components/schemas/Problem" })),
            "Problem"
        );
        assert_eq!(
            type_of(&json!({ "type": ["string", "null"], "enum": ["left", "right"] })),
            "left | right"
        );
        assert_eq!(
            type_of(&json!({ "type": "array", "items": { "type": "number" } })),
            "list of number"
        );
    }

    #[test]
    fn nothing_in_a_description_becomes_markup() {
        let page = html(&json!({ "info": { "title": "<script>alert(1)</script>" } }));
        assert!(!page.contains("<script"));
    }
}
