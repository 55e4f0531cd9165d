//! Finds the brain in a T1-weighted head, and says how far it can be believed.
//!
//! [`extract`] is the one function that most want. There is no input or output here: who calls reads the network's weights
//! and hands over their bytes.
//!
//! The network is that of deepbet 1.0.2 (Fisch et al., "deepbet: Fast brain extraction of T1-weighted MRI using
//! Convolutional Neural Networks", Computers in Biology and Medicine 179:108845, 2024); its weights are its authors' and
//! are not part of this crate, the code that runs them is.

mod axes;
mod canonical;
mod error;
mod extract;
mod network;
mod probability;
mod pruning;
mod quality;
mod rim;
mod supplied;

use std::ops::ControlFlow;

pub use error::ExtractionError;
pub use extract::{CLOSING_RADIUS_MM, Extraction, Method, extract, predict, prune};
pub use network::{Network, Prediction};
pub use probability::Probability;
pub use quality::{Doubt, MaskNumbers, Quality, Reason, Verdict};
pub use rim::Rim;
pub use supplied::{Judgement, Supplied, judge};

/// Is told the share of the work that is done, from 0 to 1, and says whether to go on.
pub type Observe<'a> = &'a dyn Fn(f32) -> ControlFlow<()>;
