//! Why a query or a body is refused. Nothing from the client is repeated, because it may be anything, such as the name of
//! a patient.

use std::fmt;

use serde::de::{Expected, Unexpected};

/// The reason why a value cannot be read: a sentence that begins with its verb.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A key is unknown.
    #[error("has an unknown key; {}", known_keys(known))]
    UnknownKey { known: &'static [&'static str] },
    /// A key is missing.
    #[error("lacks the key `{key}`")]
    MissingKey { key: &'static str },
    /// A key is given twice.
    #[error("has the key `{key}` twice")]
    KeyTwice { key: &'static str },
    /// A value is of another kind or out of range.
    #[error("must be {expected}")]
    Unexpected { expected: String },
    #[error("cannot be read: {reason}")]
    Unreadable { reason: String },
}

impl Refusal {
    /// A value that is not as expected.
    pub fn unless(expected: &dyn fmt::Display) -> Self {
        Self::Unexpected {
            expected: expected.to_string(),
        }
    }

    /// A value that is none of these names.
    pub fn unless_one_of(names: &[&str]) -> Self {
        let before = if names.len() > 2 { "one of " } else { "" };
        Self::unless(&format!("{before}{}", listed(names)))
    }
}

/// serde calls these with what the code expected, and with what the client sent, which is dropped.
impl serde::de::Error for Refusal {
    fn custom<T: fmt::Display>(reason: T) -> Self {
        Self::Unreadable {
            reason: reason.to_string(),
        }
    }

    fn invalid_type(_sent: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::unless(&expected)
    }

    fn invalid_value(sent: Unexpected<'_>, expected: &dyn Expected) -> Self {
        match sent {
            Unexpected::Unsigned(_) => Self::unless(&"a smaller number"),
            _ => Self::unless(&expected),
        }
    }

    fn invalid_length(_sent: usize, expected: &dyn Expected) -> Self {
        Self::unless(&expected)
    }

    fn unknown_variant(_sent: &str, expected: &'static [&'static str]) -> Self {
        Self::unless_one_of(expected)
    }

    fn unknown_field(_sent: &str, known: &'static [&'static str]) -> Self {
        Self::UnknownKey { known }
    }

    fn missing_field(key: &'static str) -> Self {
        Self::MissingKey { key }
    }

    fn duplicate_field(key: &'static str) -> Self {
        Self::KeyTwice { key }
    }
}

/// The known keys, in words.
pub fn known_keys(known: &[&str]) -> String {
    match known {
        [] => "none is known".to_owned(),
        _ => format!("known: {}", listed(known)),
    }
}

fn listed(names: &[&str]) -> String {
    let names: Vec<_> = names.iter().map(|name| format!("`{name}`")).collect();
    names.join(if names.len() == 2 { " or " } else { ", " })
}
