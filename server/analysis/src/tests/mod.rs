//! Phantoms and real heads through all of the maps.

mod bias;
mod edges;
mod heads;
mod masses;
pub(crate) mod real;
mod thick;
