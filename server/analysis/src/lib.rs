#![doc = include_str!("../README.md")]

mod block;
mod candidates;
mod coarse;
mod convolve;
mod detail;
mod flair;
mod gradient;
mod head;
mod junction;
mod junction_places;
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
    BORDERLINE_FROM, Candidate, HeadDoubts, Judgement, ScoreCaveat, ScoreLimits, UNUSUAL_ABOVE,
    Unusual,
};
pub use flair::{Flair, FlairMap, FlairUndefined, flair_map};
pub use head::Head;
pub use junction_places::JunctionPlaces;
pub use maps::{Maps, maps, maps_and_division};
pub use midsagittal::{MidsagittalFit, MidsagittalPlane, midsagittal_fit, midsagittal_plane};
pub use regions::{
    Division, NoDivision, Region, RegionDoubt, RegionNumbers, Regions, Sheet, SurfacePart, regions,
};
pub use registration::{
    Aligned, Alignment, Doubt, Misfit, Registration, Verdict, align, register, shared_points,
};
pub use slant::{DepthBand, slope};
pub use stored::{MAP_FORMAT, MapKind, Scale, StoredMap, StoredMapError, UNDEFINED};
pub use tissue::{TissueScale, tissue_of};
pub use undefined::MapsUndefined;
pub use width::{JunctionWidth, WidthTable, width_table};

/// Heads with known parts, for tests.
#[cfg(any(test, feature = "testing"))]
pub mod testing {
    pub use crate::phantom::*;
    pub use crate::regions::phantom as brain;
}
