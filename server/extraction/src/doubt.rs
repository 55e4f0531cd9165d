//! What is unusual about a mask, and how much.

use std::fmt;

/// The rating of a mask, from best to worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    Ok,
    /// Something is unusual: a person should check the mask before the case is used.
    Review,
    /// This is not the mask of a brain.
    Failed,
}

/// A reason why a mask is not ok.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reason {
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

/// Something unusual about a mask: never [`Verdict::Ok`].
#[derive(Debug)]
pub(crate) struct Doubt {
    pub(crate) verdict: Verdict,
    pub(crate) reason: Reason,
}

pub(crate) fn doubt(
    verdict: Verdict,
    code: &'static str,
    sentence: impl FnOnce() -> String,
) -> Option<Doubt> {
    (verdict > Verdict::Ok).then(|| Doubt {
        verdict,
        reason: Reason {
            code,
            sentence: sentence(),
        },
    })
}

pub(crate) fn review_if(is_unusual: bool) -> Verdict {
    graded(is_unusual, false)
}

pub(crate) fn graded(is_unusual: bool, is_impossible: bool) -> Verdict {
    match (is_unusual, is_impossible) {
        (_, true) => Verdict::Failed,
        (true, _) => Verdict::Review,
        _ => Verdict::Ok,
    }
}
