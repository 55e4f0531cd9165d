//! The message of a parser without the rejected value, which may be anything, such as the name of a patient.
//!
//! serde reports errors of its derived code as text only, so this module and [`super::query`] recognise them by their
//! first words. Tests pin the messages of each parser: if an update of a library changes them, a test fails before a
//! `type` of a problem changes.

/// The error as a sentence that begins with its verb. It repeats nothing from the client.
///
/// Parsers state what they expected after what they found, so the last `expected` never comes from the client.
pub(super) fn without_input(reason: &str) -> String {
    let expected = || reason.rsplit_once("expected ").map(|(_, words)| words);
    if reason.starts_with("unknown field ") {
        return format!("has an unknown key; {}", known(reason));
    }
    let is_of_a_wrong_kind = ["unknown variant ", "invalid type: ", "invalid value: "]
        .iter()
        .any(|start| reason.starts_with(start));
    if is_of_a_wrong_kind || reason.starts_with("invalid length ") {
        let words = expected().map(without_place);
        return words.map_or("cannot be read".to_owned(), |words| {
            format!("must be {words}")
        });
    }
    if reason.contains("float literal") || reason.contains("float from empty string") {
        return "must be a number".to_owned();
    }
    if reason.contains("found in string") || reason.contains("integer from empty string") {
        return "must be a whole number, not negative".to_owned();
    }
    format!("cannot be read: {reason}")
}

/// The known keys, from the message about an unknown one.
pub(super) fn known(reason: &str) -> String {
    let expected = reason.rsplit_once("`, expected ");
    expected.map_or("none is".to_owned(), |(_, keys)| {
        format!(
            "known: {}",
            without_place(keys).trim_start_matches("one of ")
        )
    })
}

/// Removes the line and column at the end of a message of the JSON parser.
fn without_place(words: &str) -> &str {
    words.split(" at line ").next().unwrap_or(words)
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only the errors are looked at")]
    struct Example {
        depth_mm: f32,
        side: Side,
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Side {
        Left,
        Right,
    }

    fn words(json: &str) -> String {
        let error = serde_json::from_str::<Example>(json).unwrap_err();
        without_input(&error.to_string())
    }

    #[test]
    fn what_is_expected_is_said_and_what_was_sent_is_not() {
        let unknown = "has an unknown key; known: `depth_mm` or `side`";
        let cases = [
            (r#"{"Smith": 1}"#, unknown),
            (r#"{"Smith`, expected `Smith": 1}"#, unknown),
            (r#"{"depth_mm": "Smith"}"#, "must be f32"),
            (r#"{"depth_mm": "Smith, expected Smith"}"#, "must be f32"),
            (r#"{"side": "Smith"}"#, "must be `left` or `right`"),
        ];
        for (json, expected) in cases {
            assert_eq!(words(json), expected, "{json}");
        }
    }
}
