//! The head for the steps.

use std::sync::Arc;

use bench::{Head, PreparedHead};

/// Edge of its voxels, in mm: large, because counting takes fifty times as long as running.
pub(crate) const SPACING_MM: f64 = 4.0;

pub(crate) fn head() -> Head {
    Head::phantom(SPACING_MM).expect("the synthetic head")
}

pub(crate) fn case() -> Arc<PreparedHead> {
    let (case, _) = PreparedHead::prepare(&head(), 10.0).expect("a sound head");
    Arc::new(case)
}

/// A step with a result that must not be optimised away.
pub(crate) fn step<T>(mut work: impl FnMut() -> T + 'static) -> Box<dyn FnMut()> {
    Box::new(move || drop(std::hint::black_box(work())))
}
