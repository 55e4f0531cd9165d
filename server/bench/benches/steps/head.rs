//! The head of the steps.

use std::sync::Arc;

use bench::{Head, PreparedHead};

/// Edge of its voxels, in mm: large, for counting takes fifty times as long as doing.
pub(crate) const SPACING_MM: f64 = 4.0;

pub(crate) fn head() -> Head {
    Head::phantom(SPACING_MM).expect("a head of the program's own")
}

pub(crate) fn case() -> Arc<PreparedHead> {
    let (case, _) = PreparedHead::prepare(&head(), 10.0).expect("a sound head");
    Arc::new(case)
}

/// A step that gives something, which is kept from being optimised away.
pub(crate) fn step<T>(mut work: impl FnMut() -> T + 'static) -> Box<dyn FnMut()> {
    Box::new(move || drop(std::hint::black_box(work())))
}
