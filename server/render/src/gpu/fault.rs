//! Faults that tests simulate.

/// A simulated fault of a graphics device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// It is lost.
    Loss,
    /// It has no memory for this many attempts at a picture.
    OutOfMemory(u32),
    /// Its thread panics at the next picture.
    Panic,
}
