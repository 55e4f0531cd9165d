//! Finds the brain in a T1-weighted head, and rates how far the result can be trusted.
//!
//! [`extract`] is the main function. There is no I/O here: the caller reads the weights of the network and passes their
//! bytes.
//!
//! The network is deepbet 1.0.2 (Fisch et al., "deepbet: Fast brain extraction of T1-weighted MRI using
//! Convolutional Neural Networks", Computers in Biology and Medicine 179:108845, 2024). This crate
//! contains the code that runs the network, but not the weights, which belong to its authors.

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
pub use pruning::{PruningParameters, prune_with};
pub use quality::{Because, Masked, Opinion, Origin, Quality, Reason, Shape, Verdict, judge};
pub use rim::Rim;
pub use slices::Slices;
pub use supplied::{Comparison, SurfaceDistance};
