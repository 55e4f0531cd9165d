//! The vocabulary of a case, shared by all other crates: one head, from its upload to the facts that a client needs to show it.
//!
//! Nothing here does I/O or knows a protocol. Types that are stored or sent implement `serde`, and with the feature `openapi`
//! also `utoipa`.

mod facts;
mod failure;
mod id;
mod maps;
mod object;
mod parameters;
mod progress;
mod quality;

pub use facts::{Case, CaseFacts, CutFacts, DicomFacts, PlaneFacts, SphereFacts, WindowFacts};
pub use failure::{Failure, FailureKind};
pub use id::{CaseId, NotACaseId};
pub use maps::{CandidateFacts, MapName, PatientSide};
pub use object::ObjectKind;
pub use parameters::{MaskKind, MaskSource, Parameters};
pub use progress::{CaseState, Progress, Stage};
pub use quality::{MaskMethod, Quality, QualityNumbers, QualityState};
