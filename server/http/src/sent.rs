//! Values as clients send them, in queries and in JSON, and their parsing into types. Errors are [`Refusal`]s.

use std::borrow::Cow;
use std::fmt;

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use serde::de::value::{MapDeserializer, SeqDeserializer};
use serde::de::{Deserializer, IntoDeserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, forward_to_deserialize_any};
use serde_json::{Map, Value};
use serde_path_to_error::{Error, Segment};

use crate::problem::AppError;
use crate::refusals::Refusal;

/// The longest body that is JSON.
pub const MAX_BODY_BYTES: usize = 1 << 20;

/// Parses a query.
///
/// # Errors
/// The refusal, with the key.
pub fn from_query<'de, T: Deserialize<'de>>(query: &'de str) -> Result<T, Error<Refusal>> {
    from_pairs(form_urlencoded::parse(query.as_bytes()))
}

/// Parses the keys and values of a query.
///
/// # Errors
/// The refusal, with the key.
pub fn from_pairs<'de, T: Deserialize<'de>>(
    pairs: impl IntoIterator<Item = (Cow<'de, str>, Cow<'de, str>)>,
) -> Result<T, Error<Refusal>> {
    let pairs = pairs.into_iter();
    let pairs = pairs.map(|(key, value)| (key, Sent::Text(value)));
    serde_path_to_error::deserialize(MapDeserializer::new(pairs))
}

/// Parses a JSON value.
///
/// # Errors
/// The refusal, with the path of the value; `.` is the whole. An unknown key is not part of the path.
pub fn from_json<T: for<'de> Deserialize<'de>>(value: Value) -> Result<T, (String, Refusal)> {
    serde_path_to_error::deserialize(Sent::Json(value)).map_err(|error| {
        let path = error.path().to_string();
        let known_part = match (error.inner(), error.path().iter().next_back()) {
            (Refusal::UnknownKey { .. }, Some(Segment::Map { key })) => {
                path.strip_suffix(key.as_str())
            }
            _ => None,
        };
        let path = match known_part.map(|path| path.trim_end_matches('.')) {
            Some("") => ".".to_owned(),
            Some(place) => place.to_owned(),
            None => path,
        };
        (path, error.into_inner())
    })
}

/// Reads JSON in which no object has a key twice: either value could be the one that was meant.
///
/// # Errors
/// What is wrong: a sentence that begins with its verb.
pub fn json_value(text: &[u8]) -> Result<Value, String> {
    let Unambiguous(value) = serde_json::from_slice(text).map_err(|error| {
        if error.is_data() {
            error.to_string()
        } else {
            format!("is not JSON: {error}")
        }
    })?;
    Ok(value)
}

/// A JSON value in which no object has a key twice.
struct Unambiguous(Value);

impl<'de> Deserialize<'de> for Unambiguous {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(UnambiguousVisitor).map(Self)
    }
}

struct UnambiguousVisitor;

impl<'de> Visitor<'de> for UnambiguousVisitor {
    type Value = Value;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("JSON")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, flag: bool) -> Result<Value, E> {
        Ok(flag.into())
    }

    fn visit_u64<E>(self, number: u64) -> Result<Value, E> {
        Ok(number.into())
    }

    fn visit_i64<E>(self, number: i64) -> Result<Value, E> {
        Ok(number.into())
    }

    fn visit_f64<E>(self, number: f64) -> Result<Value, E> {
        Ok(number.into())
    }

    fn visit_str<E>(self, text: &str) -> Result<Value, E> {
        Ok(text.into())
    }

    fn visit_string<E>(self, text: String) -> Result<Value, E> {
        Ok(text.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Value, A::Error> {
        let mut values = Vec::new();
        while let Some(Unambiguous(value)) = list.next_element()? {
            values.push(value);
        }
        Ok(values.into())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some((key, Unambiguous(value))) = members.next_entry()? {
            if object.insert(key, value).is_some() {
                return Err(serde::de::Error::custom("has a key twice"));
            }
        }
        Ok(object.into())
    }
}

/// The value that the body of a request describes in JSON.
///
/// # Errors
/// If the body is too large, or does not describe such a value.
pub fn json_body<T: for<'de> Deserialize<'de>>(
    body: Result<Bytes, BytesRejection>,
) -> Result<T, AppError> {
    json_body_within(MAX_BODY_BYTES, body)
}

/// The same, of a body that may have another length.
///
/// # Errors
/// As [`json_body`].
pub fn json_body_within<T: for<'de> Deserialize<'de>>(
    limit_bytes: usize,
    body: Result<Bytes, BytesRejection>,
) -> Result<T, AppError> {
    let body = body.map_err(|_| AppError::too_large(limit_bytes as u64))?;
    json_text(&body)
}

/// The value that a text describes in JSON.
///
/// # Errors
/// If the text does not describe such a value.
pub fn json_text<T: for<'de> Deserialize<'de>>(text: &[u8]) -> Result<T, AppError> {
    let kind = "body-unreadable";
    let json = json_value(text).map_err(|detail| AppError::invalid(kind, ".", detail))?;
    from_json(json).map_err(|(path, refusal)| AppError::invalid(kind, path, refusal))
}

/// A value from a client.
enum Sent<'de> {
    /// From a query: numbers and flags are parsed from a text.
    Text(Cow<'de, str>),
    Json(Value),
}

impl<'de> IntoDeserializer<'de, Refusal> for Sent<'de> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

/// Numbers and flags: parsed from a text, or converted from JSON.
macro_rules! parsed {
    ($($deserialize:ident $visit:ident $kind:ty, $of_json:expr, $expected:expr;)*) => {$(
        fn $deserialize<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refusal> {
            let of_json: fn(&Value) -> Option<$kind> = $of_json;
            let parsed = match &self {
                Self::Text(text) => text.parse().ok(),
                Self::Json(value) => of_json(value),
            };
            visitor.$visit(parsed.ok_or_else(|| Refusal::unless(&$expected))?)
        }
    )*};
}

/// Said of everything but a whole number.
const WHOLE: &str = "a whole number, not negative";

impl<'de> Deserializer<'de> for Sent<'de> {
    type Error = Refusal;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refusal> {
        match self {
            Self::Text(text) => text.into_deserializer().deserialize_any(visitor),
            Self::Json(Value::Null) => visitor.visit_unit(),
            Self::Json(Value::Bool(flag)) => visitor.visit_bool(flag),
            Self::Json(Value::String(text)) => visitor.visit_string(text),
            Self::Json(Value::Number(number)) => match (number.as_u64(), number.as_i64()) {
                (Some(number), _) => visitor.visit_u64(number),
                (None, Some(number)) => visitor.visit_i64(number),
                (None, None) => visitor.visit_f64(number.as_f64().unwrap_or(f64::NAN)),
            },
            Self::Json(Value::Array(list)) => {
                SeqDeserializer::new(list.into_iter().map(Self::Json)).deserialize_any(visitor)
            }
            Self::Json(Value::Object(members)) => {
                let members = members.into_iter();
                let members = members.map(|(key, value)| (key, Self::Json(value)));
                MapDeserializer::new(members).deserialize_any(visitor)
            }
        }
    }

    parsed! {
        deserialize_bool visit_bool bool, Value::as_bool, "`true` or `false`";
        deserialize_f32 visit_f32 f32, |value| Some(value.as_f64()? as f32), "a number";
        deserialize_f64 visit_f64 f64, Value::as_f64, "a number";
        deserialize_u8 visit_u64 u64, Value::as_u64, WHOLE;
        deserialize_u16 visit_u64 u64, Value::as_u64, WHOLE;
        deserialize_u32 visit_u64 u64, Value::as_u64, WHOLE;
        deserialize_u64 visit_u64 u64, Value::as_u64, WHOLE;
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Refusal> {
        match self {
            Self::Json(Value::Null) => visitor.visit_none(),
            some => visitor.visit_some(some),
        }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Refusal> {
        let text = match self {
            Self::Text(text) => text,
            Self::Json(Value::String(text)) => text.into(),
            Self::Json(_) => return Err(Refusal::unless_one_of(variants)),
        };
        text.into_deserializer()
            .deserialize_enum(name, variants, visitor)
    }

    /// A list of the values in order is not accepted.
    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _keys: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Refusal> {
        match self {
            Self::Json(Value::Object(_)) => self.deserialize_any(visitor),
            _ => Err(Refusal::unless(&"an object")),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Refusal> {
        visitor.visit_newtype_struct(self)
    }

    forward_to_deserialize_any! {
        i8 i16 i32 i64 char str string bytes byte_buf unit unit_struct seq tuple tuple_struct map identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Example {
        depth_mm: f32,
        side: Option<Side>,
        count: Option<u8>,
        #[serde(default)]
        is_open: bool,
        name: Option<String>,
        #[serde(default)]
        parts: Vec<Example>,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Side {
        Left,
        Right,
    }

    #[test]
    fn a_query_and_json_give_the_same_values() {
        let expected = Example {
            depth_mm: 0.1,
            side: Some(Side::Left),
            count: Some(7),
            is_open: true,
            name: Some("1 %".to_owned()),
            parts: Vec::new(),
        };
        let query = "depth_mm=0.1&side=left&count=7&is_open=true&name=1+%25";
        assert_eq!(from_query::<Example>(query).unwrap(), expected);
        let json =
            json!({"depth_mm": 0.1, "side": "left", "count": 7, "is_open": true, "name": "1 %"});
        assert_eq!(from_json::<Example>(json).unwrap(), expected);
        let least =
            from_json::<Example>(json!({"depth_mm": 2, "side": null, "parts": []})).unwrap();
        assert_eq!((least.depth_mm, least.side), (2.0, None));
    }

    #[test]
    fn no_object_of_json_has_a_key_twice() {
        let text = br#"{"a": [null, true, -1, 2, 0.5, "b", {"a": 1}], "b": {}}"#;
        assert_eq!(
            json_value(text).unwrap(),
            serde_json::from_slice::<Value>(text).unwrap()
        );
        for text in [
            r#"{"Smith": 1, "Smith": 1}"#,
            r#"[{"a": {"Smith": 1, "b": 2, "Smith": 3}}]"#,
        ] {
            let detail = json_value(text.as_bytes()).unwrap_err();
            assert!(detail.starts_with("has a key twice at line 1"), "{detail}");
        }
        assert!(json_value(b"{").unwrap_err().starts_with("is not JSON: "));
    }

    const KNOWN: &str =
        "has an unknown key; known: `depth_mm`, `side`, `count`, `is_open`, `name`, `parts`";

    #[test]
    fn what_is_wrong_with_a_query_is_said_and_what_was_sent_is_not() {
        for (query, path, words) in [
            ("depth_mm=Smith", "depth_mm", "must be a number"),
            ("depth_mm=", "depth_mm", "must be a number"),
            ("depth_mm=1&side=Smith", "side", "must be `left` or `right`"),
            (
                "depth_mm=1&count=-1",
                "count",
                "must be a whole number, not negative",
            ),
            ("depth_mm=1&count=256", "count", "must be a smaller number"),
            (
                "depth_mm=1&is_open=Smith",
                "is_open",
                "must be `true` or `false`",
            ),
            ("depth_mm=1&depth_mm=2", ".", "has the key `depth_mm` twice"),
            ("Smith=1", "Smith", KNOWN),
            ("side=left", ".", "lacks the key `depth_mm`"),
            ("depth_mm=1&parts=Smith", "parts", "must be a sequence"),
        ] {
            let error = from_query::<Example>(query).unwrap_err();
            assert_eq!(
                (
                    error.path().to_string().as_str(),
                    error.inner().to_string().as_str()
                ),
                (path, words)
            );
        }
    }

    #[test]
    fn what_is_wrong_with_json_is_said_with_its_path_and_what_was_sent_is_not() {
        let whole = "must be a whole number, not negative";
        for (json, path, words) in [
            (json!({"Smith": 1}), ".", KNOWN),
            (json!({"Smith`, expected `Smith": 1}), ".", KNOWN),
            (
                json!({"depth_mm": 1, "parts": [{"a.Smith": 1}]}),
                "parts[0]",
                KNOWN,
            ),
            (json!({"depth_mm": "Smith"}), "depth_mm", "must be a number"),
            (json!({"depth_mm": null}), "depth_mm", "must be a number"),
            (
                json!({"depth_mm": 1, "side": "Smith"}),
                "side",
                "must be `left` or `right`",
            ),
            (
                json!({"depth_mm": 1, "side": {"Smith": 1}}),
                "side",
                "must be `left` or `right`",
            ),
            (json!({"depth_mm": 1, "count": -1}), "count", whole),
            (json!({"depth_mm": 1, "count": 1.5}), "count", whole),
            (
                json!({"depth_mm": 1, "count": 256}),
                "count",
                "must be a smaller number",
            ),
            (
                json!({"depth_mm": 1, "name": ["Smith"]}),
                "name",
                "must be a string",
            ),
            (
                json!({"depth_mm": 1, "parts": [{}]}),
                "parts[0]",
                "lacks the key `depth_mm`",
            ),
            (
                json!({"depth_mm": 1, "parts": [[1]]}),
                "parts[0]",
                "must be an object",
            ),
            (json!(["Smith"]), ".", "must be an object"),
        ] {
            let (found, refusal) = from_json::<Example>(json).unwrap_err();
            assert_eq!(
                (found.as_str(), refusal.to_string().as_str()),
                (path, words)
            );
        }
    }
}
