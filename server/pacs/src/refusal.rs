//! Why an object that was sent is not kept: by STOW-RS and C-STORE in the same words, in the answer and in the log.

use std::borrow::Cow;
use std::collections::BTreeMap;

use case::{ErrorKind, PublicError as _};
use cases::Error;

use crate::values::{ArrivalSource, Reception};

/// The most characters of an Error Comment (0000,0902), which is a long string (LO).
const MOST_OF_COMMENT: usize = 64;

/// The most reasons of a request or an association that the log has.
const MOST_REASONS: usize = 10;

/// What the log says of the objects beyond these.
const OTHER_REASONS: &str = "other reasons";

/// A status (PS3.7 C, PS3.4 B.2.3); the Failure Reason of STOW-RS, too (PS3.18 table I.2-2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Status {
    Success = 0x0000,
    /// A warning: coercion of data elements.
    Corrected = 0xB000,
    OutOfResources = 0xA700,
    DataSetDoesNotMatch = 0xA900,
    CannotUnderstand = 0xC000,
    ProcessingFailure = 0x0110,
    ClassNotSupported = 0x0122,
    NotAuthorized = 0x0124,
    UnrecognisedOperation = 0x0211,
}

/// Why an object is not stored: its status, and a sentence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Refusal {
    pub(crate) status: Status,
    pub(crate) why: Cow<'static, str>,
}

impl Refusal {
    pub(crate) const NOT_BETTER: Self = Self::new(
        Status::CannotUnderstand,
        "a better image came with its UID: decodable, placed or lossless",
    );

    pub(crate) const MAY_NOT_REJECT: Self = Self::new(
        Status::NotAuthorized,
        "its sender may not reject images (`dicom-reject`, `may_reject`)",
    );

    pub(crate) const fn new(status: Status, why: &'static str) -> Self {
        Self {
            status,
            why: Cow::Borrowed(why),
        }
    }

    /// Whether the object is refused, and would be again; otherwise the server cannot take it now, and the log has the cause.
    pub(crate) fn is_of_object(&self) -> bool {
        !matches!(
            self.status,
            Status::OutOfResources | Status::ProcessingFailure
        )
    }
}

/// An error, which is logged if it is none of the object.
impl From<Error> for Refusal {
    fn from(error: Error) -> Self {
        let status = match (&error, error.kind()) {
            (Error::Failure(_), _) => Status::CannotUnderstand,
            (_, ErrorKind::Full | ErrorKind::Unavailable) => Status::OutOfResources,
            _ => Status::ProcessingFailure,
        };
        let cause = error.hidden_cause();
        if cause.is_some() || status == Status::ProcessingFailure {
            let error = cause.unwrap_or(&error);
            tracing::error!(error, "an image could not be stored");
        }
        Self {
            status,
            why: error.sentence().into(),
        }
    }
}

impl Reception {
    /// What its sender is told.
    pub(crate) fn status(self) -> Result<Status, Refusal> {
        match self {
            Self::New | Self::Known => Ok(Status::Success),
            Self::Corrected => Ok(Status::Corrected),
            Self::Refused => Err(Refusal::NOT_BETTER),
        }
    }
}

/// The beginning of a sentence as an Error Comment (0000,0902).
pub(crate) fn error_comment(why: &str) -> String {
    let is_plain = |c: &char| (' '..='~').contains(c) && *c != '\\';
    why.chars().filter(is_plain).take(MOST_OF_COMMENT).collect()
}

/// How many objects of a request, an association or a retrieval were refused, by reason. A line of the log for each reason is written when
/// this is dropped, however that ends.
#[derive(Debug)]
pub(crate) struct Refusals {
    source: ArrivalSource,
    objects: BTreeMap<Cow<'static, str>, usize>,
}

impl Refusals {
    /// None yet of what comes in this way.
    pub(crate) fn of(source: ArrivalSource) -> Self {
        Self {
            source,
            objects: BTreeMap::new(),
        }
    }

    /// Counts an object. A rejection note that is not permitted has a line of its own.
    pub(crate) fn add(&mut self, refusal: &Refusal) {
        if refusal.status == Status::NotAuthorized {
            return;
        }
        let is_room = self.objects.len() < MOST_REASONS || self.objects.contains_key(&refusal.why);
        let why = match is_room {
            true => refusal.why.clone(),
            false => OTHER_REASONS.into(),
        };
        *self.objects.entry(why).or_default() += 1;
    }

    /// How many there were, but for rejection notes.
    pub(crate) fn count(&self) -> usize {
        self.objects.values().sum()
    }
}

impl Drop for Refusals {
    fn drop(&mut self) {
        for (reason, objects) in &self.objects {
            let source = self.source.name();
            tracing::warn!(source, objects, reason = &**reason, "objects were refused");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_reason_is_counted_once_and_not_without_end() {
        let mut refusals = Refusals::of(ArrivalSource::Stow);
        for number in 0..90 {
            refusals.add(&Refusal::NOT_BETTER);
            refusals.add(&Refusal::MAY_NOT_REJECT);
            refusals.add(&Refusal {
                status: Status::CannotUnderstand,
                why: format!("element {number} cannot be read").into(),
            });
        }
        assert_eq!(refusals.objects.len(), MOST_REASONS + 1);
        assert_eq!(refusals.objects[&*Refusal::NOT_BETTER.why], 90);
        assert_eq!(refusals.objects[OTHER_REASONS], 90 - (MOST_REASONS - 1));
    }
}
