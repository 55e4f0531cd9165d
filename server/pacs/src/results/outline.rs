//! What each kind of result says of itself, and what all of them say.

use std::sync::LazyLock;

use axum::http::StatusCode;
use case::LayerId;
use http::problem::AppError;
use jiff::Timestamp;
use render::RESEARCH_USE_NOTICE;

/// What every result is, for people.
pub(super) static COMMENT: LazyLock<String> =
    LazyLock::new(|| format!("Made by Isocortex. {RESEARCH_USE_NOTICE}"));

/// What the kind of a result says of it before anything is drawn.
#[derive(Debug)]
pub(super) struct Outline {
    /// The SOP class.
    pub(super) class: &'static str,
    /// What viewers show in their list, without the name of the program.
    pub(super) shown: String,
    /// How the pixels are made; documents do not state it.
    pub(super) derivation: String,
    /// Whether identifying text is burned into the pixels.
    pub(super) is_annotated: bool,
    /// The depth of the first picture.
    pub(super) depth_mm: f32,
    /// The layers of the case that it shows, or may show.
    pub(super) layers: Vec<LayerId>,
    /// Everything besides the request, the case and its source that the object depends on.
    pub(super) made_by: String,
    /// When what it shows was last changed, if that is not when the case was made.
    pub(super) made_at: Option<Timestamp>,
}

impl Outline {
    pub(super) fn new(class: &'static str, shown: impl Into<String>) -> Self {
        Self {
            class,
            shown: shown.into(),
            derivation: String::new(),
            is_annotated: false,
            depth_mm: 0.0,
            layers: Vec::new(),
            made_by: String::new(),
            made_at: None,
        }
    }
}

pub(super) fn refuse(kind: &'static str, detail: &str) -> AppError {
    AppError::new(StatusCode::UNPROCESSABLE_ENTITY, kind, detail)
}

pub(super) fn hash_of(parts: &[&str]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        // With their lengths, no two lists of parts give the same bytes.
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    hasher.finalize()
}
