//! The progress of an extraction.

use std::ops::ControlFlow;

use crate::ExtractionError;

/// Receives the finished fraction of the work, 0 to 1, and returns whether to continue.
pub type Observe<'a> = &'a dyn Fn(f32) -> ControlFlow<()>;

/// Reports the finished fraction and returns an error if the caller stops the work.
pub(crate) fn go_on(observe: Observe<'_>, done: f32) -> Result<(), ExtractionError> {
    match observe(done) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(ExtractionError::Cancelled),
    }
}
