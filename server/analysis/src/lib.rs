//! What is computed from one head to help the eye: values in, values out, with no files and no tasks.
//!
//! * The plane between the hemispheres: [`midsagittal_plane`].
//! * How sharp the junction of grey and white matter is, against its surroundings and the other side, and the places at which it
//!   is blurred most: [`maps`]. All of it comes from the head itself; there is no database of normal heads.
//! * Where another volume of the same head lies: [`register`].

mod block;
mod candidates;
mod coarse;
mod convolve;
mod gradient;
mod junction;
mod maps;
mod midsagittal;
mod mirror;
mod registration;
mod robust;
mod sharpness;
mod stored;
#[cfg(feature = "study")]
pub mod study;
#[cfg(test)]
mod tests;
mod tissue;
mod undefined;
mod width;

pub use candidates::{Candidate, Side};
pub use maps::{Head, MapParameters, Maps, maps};
pub use midsagittal::{MidsagittalPlane, midsagittal_plane};
pub use registration::{Doubt, Registration, Verdict, register};
pub use stored::{MAP_FORMAT, MapKind, Scale, StoredMap, StoredMapError, UNDEFINED};
pub use tissue::TissueScale;
pub use undefined::MapsUndefined;
pub use width::{JunctionWidth, WidthTable};
