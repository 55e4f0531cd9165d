//! The words in which all other crates speak of a case: one head, from the upload to the facts that a client needs to show it.
//!
//! Nothing in here computes, reads a file or knows a protocol. What is stored or sent is described by `serde`; with the feature
//! `openapi` by `utoipa` as well.

mod facts;
mod failure;
mod id;
mod object;
mod parameters;
mod progress;
mod quality;

pub use facts::{Case, CaseFacts, CutFacts, DicomFacts, PlaneFacts, SphereFacts, WindowFacts};
pub use failure::{Failure, FailureKind};
pub use id::{CaseId, NotACaseId};
pub use object::ObjectKind;
pub use parameters::{MaskKind, MaskSource, Parameters};
pub use progress::{CaseState, Progress, Stage};
pub use quality::{MaskMethod, Quality, QualityNumbers, QualityState};
