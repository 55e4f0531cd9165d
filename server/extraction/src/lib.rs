#![doc = include_str!("../README.md")]

mod axes;
mod canonical;
mod error;
mod extract;
mod flatness;
mod foreground;
mod methods;
mod network;
mod observe;
mod probability;
mod pruning;
mod quality;
mod rating;
mod rim;
mod slices;
mod supplied;

pub use canonical::canonical_axes;
pub use error::ExtractionError;
pub use extract::extract;
pub use foreground::check_foreground;
pub use methods::{CLOSING_RADIUS_MM, Extraction, Method, closed, predict, prune};
pub use network::{Network, Prediction};
pub use observe::Observe;
pub use probability::Probability;
pub use quality::{Because, Masked, Opinion, Origin, Quality, Shape, rate};
pub use rating::{Rating, Reason};
pub use rim::Rim;
pub use slices::Slices;
pub use supplied::{Comparison, SurfaceDistance};
