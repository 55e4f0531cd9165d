//! What is unusual about a mask, and how much.

use std::fmt;

/// The rating of a mask, from best to worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rating {
    Ok,
    /// Something is unusual: a person should check the mask before the case is used.
    Review,
    /// This is not the mask of a brain.
    Failed,
}

/// A reason why a mask is not ok.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reason {
    /// How bad it is: never [`Rating::Ok`].
    pub rating: Rating,
    /// Its stable code: `mask-cut-inferior` …
    pub code: &'static str,
    /// Its description, a sentence without a full stop.
    pub sentence: String,
}

impl fmt::Display for Reason {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} ({})", self.sentence, self.code)
    }
}

/// The reason for a rating; `None` for [`Rating::Ok`].
pub(crate) fn reason(
    rating: Rating,
    code: &'static str,
    sentence: impl FnOnce() -> String,
) -> Option<Reason> {
    (rating > Rating::Ok).then(|| Reason {
        rating,
        code,
        sentence: sentence(),
    })
}

pub(crate) fn review_if(is_unusual: bool) -> Rating {
    graded(is_unusual, false)
}

pub(crate) fn graded(is_unusual: bool, is_impossible: bool) -> Rating {
    match (is_unusual, is_impossible) {
        (_, true) => Rating::Failed,
        (true, _) => Rating::Review,
        _ => Rating::Ok,
    }
}
