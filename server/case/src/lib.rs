#![doc = include_str!("../README.md")]

mod client;
mod facts;
mod failure;
pub mod findings;
mod gyrus;
mod id;
pub mod images;
mod job;
mod layer;
mod maps;
mod object;
mod parameters;
mod progress;
mod public_error;
mod quality;
pub mod readings;
mod registration;
pub mod series;
mod side;
mod standard;
mod surface;
mod voxels;

pub use client::Client;
pub use facts::{
    Case, CaseChange, CaseFacts, CutFacts, DicomFacts, ImageRun, PlaneFacts, SphereFacts,
    VoxelFacts, WindowFacts,
};
pub use failure::{Failure, FailureKind, SOURCE_DAMAGED, SOURCE_MISSING};
pub use gyrus::{Gyrus, Lobe};
pub use id::{CaseId, NotACaseId};
pub use images::Closed;
pub use job::{JobKind, JobState, STORE_FAILED};
pub use layer::{
    Contrast, LabelFacts, Layer, LayerChange, LayerFacts, LayerId, LayerKind, LayerParameters,
    MAX_LAYERS, MatrixOrigin, NotALayerId, PlacementFacts, PlacementVerdict, SurfaceFacts,
    SurfaceFit, Transform,
};
pub use maps::{
    BrainRegion, CandidateFacts, JunctionBandFacts, MapName, RegionFacts, RegionNumbers, Unusual,
};
pub use object::ObjectKind;
pub use parameters::{MaskKind, MaskSource, Parameters};
pub use progress::{CaseState, Progress, Stage};
pub use public_error::{ErrorKind, INTERNAL, PublicError};
pub use quality::{
    AXES_ASSUMED, CorrectedHeader, MaskMethod, Quality, QualityNumbers, QualityState,
};
pub use registration::{CaseRegistration, RegistrationVerdict};
pub use side::PatientSide;
pub use standard::{ATLAS_ERROR_MM, AtlasPosition, StandardPosition};
pub use surface::SurfaceName;
pub use voxels::VoxelValues;

/// Whether a character is a control character, or one of those that turn the direction of the text after them: with
/// these, a name could be shown as another one.
fn is_control(character: char) -> bool {
    character.is_control() || matches!(character, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}
