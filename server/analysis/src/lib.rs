//! Measures from one head that help readers: values in, values out, without files or tasks.
//!
//! * The plane between the hemispheres: [`midsagittal_plane`].
//! * The sharpness of the junction of grey and white matter, compared with its surroundings and the other side, and the
//!   most blurred places: [`maps`]. Everything comes from the head itself; there is no database of normal heads.
//! * The intensities of a FLAIR of the same head at that junction, compared in the same way: [`flair_map`].
//! * The regions of the brain: cerebrum by side, cerebellum, brain stem: [`Regions`]; and its parts with surfaces of their
//!   own: [`Division`].
//! * The position of another volume of the same head: [`register`]; of the head in the space of an atlas: [`align`].
//! * The tissue scale of a head, voxel by voxel, on which all of these stand: [`tissue_of`].

mod block;
mod candidates;
mod coarse;
mod convolve;
mod detail;
mod flair;
mod gradient;
mod head;
mod junction;
mod maps;
mod midsagittal;
mod mirror;
#[cfg(any(test, feature = "testing"))]
mod phantom;
mod regions;
mod registration;
mod robust;
mod sharpness;
mod slant;
mod slices;
mod spans;
mod stored;
#[cfg(test)]
mod tests;
mod thickness;
mod tissue;
mod undefined;
mod width;

pub use block::{Block, Zone, depth_at};
pub use candidates::{
    BORDERLINE_FROM, Candidate, HeadDoubts, Judgement, ScoreCaveat, ScoreLimits, Side,
    UNUSUAL_ABOVE, Unusual,
};
pub use flair::{Flair, FlairMap, FlairUndefined, flair_map};
pub use head::Head;
pub use maps::{MapParameters, Maps, maps, maps_and_division, tissue_of};
pub use midsagittal::{MidsagittalFit, MidsagittalPlane, midsagittal_fit, midsagittal_plane};
pub use regions::{
    Division, NoDivision, Region, RegionDoubt, RegionNumbers, Regions, Sheet, SurfacePart, regions,
};
pub use registration::{
    Aligned, Alignment, Doubt, Misfit, Registration, Verdict, align, register, shared_points,
};
pub use slant::{DepthBand, slope};
pub use stored::{MAP_FORMAT, MapKind, Scale, StoredMap, StoredMapError, UNDEFINED};
pub use tissue::TissueScale;
pub use undefined::MapsUndefined;
pub use width::{JunctionWidth, WidthTable};

/// Heads with known parts, for tests.
#[cfg(any(test, feature = "testing"))]
pub mod testing {
    pub use crate::phantom::*;
    pub use crate::regions::phantom as brain;
}
