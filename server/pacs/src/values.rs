//! What comes from a PACS, series that arrive, and the results that are sent to it.
//!
//! Each instance is an object that its arrival refers to, from the moment it is acknowledged until its series is
//! forgotten. An image that comes while a job reads its series fences that job off.

use std::time::Duration;

use case::images::{Closed, Fingerprint};
use case::series::{AccessionNumber, SeriesUids, Uid};
use case::{CaseId, CaseState, Failure, JobKind, JobState, LayerId, ObjectKind};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use storage::{Job, ObjectName};
use utoipa::ToSchema;

/// Reads a series that came.
pub(crate) const SERIES: JobKind = JobKind::new("series", "reading");

/// A word in a column.
macro_rules! words {
    ($(#[$docs:meta])* $name:ident { $($(#[$variant_docs:meta])* $variant:ident = $word:literal),+ $(,)? }) => {
        $(#[$docs])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub(crate) enum $name { $($(#[$variant_docs])* $variant),+ }

        impl $name {
            /// The word in rows and answers.
            pub(crate) fn name(self) -> &'static str {
                match self { $(Self::$variant => $word),+ }
            }

            /// What a word means.
            pub(crate) fn from_name(name: &str) -> Option<Self> {
                match name { $($word => Some(Self::$variant),)+ _ => None }
            }
        }
    };
}

words! {
    /// How a series came.
    ArrivalSource {
        Stow = "stow",
        CStore = "c-store",
        /// It was fetched from a node.
        Retrieval = "retrieval",
    }
}

words! {
    /// What became of a series.
    ArrivalState {
        /// Images are coming, or it waits to be read.
        Receiving = "receiving",
        /// It became a case.
        Case = "case",
        /// It became a layer, which its reason states too.
        Layer = "layer",
        /// It became nothing, for a reason.
        Nothing = "nothing",
    }
}

/// How a series is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Taken {
    /// What the series becomes.
    #[serde(rename = "as")]
    pub(crate) kind: TakenAs,
    /// Whether missing slices are interpolated. Default: false.
    #[serde(default)]
    pub(crate) allow_gaps: bool,
}

/// What a series becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum TakenAs {
    /// A case.
    Case,
    /// A layer of the case that a link to its study opens.
    Layer,
}

/// An image that has come.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NewInstance {
    pub(crate) uids: SeriesUids,
    /// The accession number of its study.
    pub(crate) accession_number: Option<AccessionNumber>,
    /// The image.
    pub(crate) sop_instance_uid: Uid,
    /// The digest of its file, which is an object of the kind `instance`.
    pub(crate) digest: blake3::Hash,
    /// The label of its series, if it may be kept.
    pub(crate) label: Option<String>,
    /// What it states and shows; none if it cannot be decoded.
    pub(crate) fingerprint: Option<Fingerprint>,
}

impl From<&NewInstance> for ObjectName {
    /// The object with its file.
    fn from(instance: &NewInstance) -> Self {
        Self {
            kind: ObjectKind::Instance,
            digest: instance.digest,
        }
    }
}

/// What a rejection note has rejected of a series. Its UIDs are patient data.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = Rejection)]
pub(crate) struct Rejected {
    /// Its name in addresses.
    pub(crate) id: String,
    /// The Study Instance UID.
    pub(crate) study: String,
    /// The Series Instance UID.
    pub(crate) series: String,
    /// How many images.
    pub(crate) images: usize,
    /// Whether an image counts again when it comes again: it was rejected because it had been kept long enough (113039).
    pub(crate) may_return: bool,
    /// Who has sent the note: a token, a user, the title of a peer, or a node.
    pub(crate) by: String,
    /// When it came (RFC 3339).
    pub(crate) at: String,
}

/// What became of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reception {
    New,
    /// It was there, and stays as it is.
    Known,
    /// It is another one than the last with its UID, and counts from now on.
    Corrected,
    /// A better image came with its UID, one that can be decoded and placed or is lossless: that one counts.
    Refused,
}

/// A series that came.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Arrival {
    /// Its name in addresses: 32 hexadecimal digits without a meaning.
    pub(crate) id: String,
    pub(crate) uids: SeriesUids,
    /// The accession number of its study.
    pub(crate) accession_number: Option<AccessionNumber>,
    /// How its first image came.
    pub(crate) source: ArrivalSource,
    /// What lists call it: from the series, never from the patient.
    pub(crate) label: Option<String>,
    /// What became of it.
    pub(crate) state: ArrivalState,
    /// The reason, if it became a layer or nothing.
    pub(crate) reason: Option<Failure>,
    /// How somebody took it.
    pub(crate) taken: Option<Taken>,
    /// The reason for which it was refused before it was taken.
    pub(crate) refused: Option<Failure>,
    /// The case that it is, or of which it is a layer; also while late images are coming, but not if images were corrected or
    /// rejected since.
    pub(crate) case: Option<CaseId>,
    /// Images so far.
    pub(crate) instances: usize,
    /// How many the sender says there are.
    pub(crate) expected: Option<usize>,
    /// Images that took the place of others with the same UID since it was read before, or taken.
    pub(crate) corrected: usize,
    /// Objects that are no images and were not kept.
    pub(crate) ignored: usize,
    /// Objects that were refused, as often as they came.
    pub(crate) refused_objects: usize,
    /// Why the last of them was refused.
    pub(crate) last_refusal: Option<String>,
    /// When its first image came.
    pub(crate) first_at: Timestamp,
    /// When its last image came.
    pub(crate) last_at: Timestamp,
}

impl Arrival {
    /// Whether nothing of the series has come but objects that were refused.
    pub(crate) fn is_all_refused(&self) -> bool {
        let reason = self.reason.as_ref();
        self.instances == 0 && reason.is_some_and(|reason| reason.name == ALL_REFUSED)
    }
}

/// Which series to list; without a condition, all.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct ArrivalQuery {
    /// What became of them.
    pub(crate) state: Option<ArrivalState>,
    /// The case that they became, or of which they became a layer.
    pub(crate) case: Option<CaseId>,
    /// A part of the label, whether in upper or lower case.
    pub(crate) text: Option<String>,
    /// The first image came then or later.
    pub(crate) since: Option<Timestamp>,
    /// The first image came earlier than that.
    pub(crate) until: Option<Timestamp>,
}

/// When a series is due.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DueTerms {
    /// How long nothing may have come for it, unless it is known to be complete.
    pub(crate) stable: Duration,
    /// How long to wait for images that the sender announced.
    pub(crate) patience: Duration,
}

/// The reason of a series that became a layer.
pub(crate) const BECAME_LAYER: &str = "series-is-layer";

/// The reason of a series that is not T1-weighted. It waits for a case of its study, to become a layer of it.
pub(crate) const NOT_T1: &str = "series-not-t1";

/// The reason of a series that was taken as a layer and whose study has no case.
pub(crate) const NO_CASE: &str = "no-case-of-study";

/// The reason of a series whose images the PACS has rejected.
pub(crate) const REJECTED: &str = "rejected";

/// Why a series becomes nothing whose images are rejected.
pub(crate) fn images_rejected() -> Failure {
    Failure::unusable(REJECTED, "the PACS has rejected images of the series")
}

/// The reason of a series whose images have come again under another study or series.
pub(crate) const MOVED: &str = "moved";

/// The reason of a series with a stored image that is damaged.
pub(crate) const IMAGES_LOST: &str = "images-lost";

/// The reason of a corrected series of which not all images have come again.
pub(crate) const INCOMPLETE_CORRECTION: &str = "incomplete-correction";

/// The reason of a series without any image.
pub(crate) const OTHER_OBJECTS: &str = "other-objects";

/// The reason of a series of which nothing has come that was not refused.
pub(crate) const ALL_REFUSED: &str = "all-refused";

/// What became of a leased series.
#[derive(Debug, Clone)]
pub(crate) enum Outcome {
    Case(CaseId),
    /// A layer of this case, which is of the same study.
    Layer(CaseId),
    /// Nothing, for this reason.
    Nothing(Failure),
}

/// Which results to list; without a condition, all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct TransferQuery {
    /// The case that a result was made from.
    pub(crate) case: Option<CaseId>,
    /// How far they are.
    pub(crate) state: Option<JobState>,
}

/// The last image that a PACS has sent with a UID.
#[derive(Debug, Clone)]
pub(crate) struct LastImage {
    pub(crate) uid: Uid,
    pub(crate) uids: SeriesUids,
    /// What it states and shows; none if it cannot be decoded.
    pub(crate) fingerprint: Option<Fingerprint>,
    /// How often it was sent.
    pub(crate) times: i64,
    pub(crate) sender: ArrivalSource,
    /// Microseconds since 1970.
    pub(crate) last_at: i64,
}

/// A case and the images that it was made of.
#[derive(Debug, Clone)]
pub(crate) struct MadeCase {
    pub(crate) case: CaseId,
    pub(crate) state: CaseState,
    pub(crate) closed: Option<Closed>,
    /// Whether a PACS has sent its images; otherwise they were uploaded.
    pub(crate) is_received: bool,
    pub(crate) images: Vec<MadeImage>,
}

/// An image that a case was made of.
#[derive(Debug, Clone)]
pub(crate) struct MadeImage {
    pub(crate) uid: Uid,
    pub(crate) fingerprint: Fingerprint,
    /// Whether the PACS has sent it again since then, wherever, or has rejected it.
    pub(crate) has_come_again: bool,
}

/// An instance that was withdrawn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Withdrawn {
    /// The series in which it was withdrawn; none for results, which are the same in every series.
    pub(crate) uids: Option<SeriesUids>,
    pub(crate) instance: Uid,
    /// When the latest note of it came.
    pub(crate) at: Timestamp,
    /// Names what one note rejects of one series; empty for results.
    pub(crate) id: String,
    /// Who has sent the note.
    pub(crate) by: String,
    /// Whether it counts again when it comes again.
    pub(crate) may_return: bool,
}

/// A series that a job is to read.
#[derive(Debug, Clone)]
pub(crate) struct DueSeries {
    pub(crate) uids: SeriesUids,
    /// How somebody took it.
    pub(crate) taken: Option<Taken>,
    /// Whether images of it were corrected since then.
    pub(crate) is_corrected: bool,
    /// Its images that are not rejected, in the order of their UIDs.
    pub(crate) images: Vec<DueImage>,
}

/// An image of a series that a job is to read.
#[derive(Debug, Clone)]
pub(crate) struct DueImage {
    pub(crate) uid: Uid,
    pub(crate) object: ObjectName,
    /// How often it was sent.
    pub(crate) times: u64,
}

/// Sends a result, whose id is the key of the job.
pub(crate) const SEND: JobKind = JobKind::new("send", "delivery");

/// The series of a result, which has no other instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ResultSeries {
    /// The class of the result.
    pub(crate) sop_class_uid: Uid,
    pub(crate) series_uid: Uid,
}

/// A result to be sent.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NewResult {
    /// The case that it was made from.
    pub(crate) case: CaseId,
    /// The name of the node.
    pub(crate) node: String,
    pub(crate) study: Uid,
    pub(crate) series: ResultSeries,
    /// The result.
    pub(crate) instance: Uid,
    /// The layers of the case that it shows, or may show.
    pub(crate) layers: Vec<LayerId>,
    /// The digest of its file, which is an object of the kind `result`.
    pub(crate) digest: blake3::Hash,
}

impl NewResult {
    /// The object with its file.
    pub(crate) fn object(&self) -> ObjectName {
        result_object(self.digest)
    }
}

pub(crate) fn result_object(digest: blake3::Hash) -> ObjectName {
    ObjectName {
        kind: ObjectKind::Result,
        digest,
    }
}

/// Why a result that was sent does not count any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NotValid {
    /// A rejection note of ours has withdrawn it.
    Withdrawn,
    /// Its case, or a layer that it shows or may show, is closed.
    Closed(Closed),
}

impl NotValid {
    /// The word in answers.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Withdrawn => "withdrawn",
            Self::Closed(_) => "closed",
        }
    }

    /// The reason as a sentence without its end.
    pub(crate) fn sentence(self) -> String {
        match self {
            Self::Withdrawn => "it was withdrawn by a rejection note".to_owned(),
            Self::Closed(why) => format!(
                "it is closed: {}; request it again of what the PACS has now",
                why.sentence()
            ),
        }
    }
}

/// A result that is sent, or was.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SentResult {
    /// Its name in addresses: 32 hexadecimal digits without a meaning.
    pub(crate) id: String,
    pub(crate) what: NewResult,
    /// When it was first requested.
    pub(crate) created_at: Timestamp,
    /// Why it does not count any more.
    pub(crate) not_valid: Option<NotValid>,
    /// The job that sends it, or did.
    pub(crate) job: Option<Job>,
}
