//! Faults that tests ask for.

/// What can happen to a graphics device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// It is lost.
    Loss,
    /// It has no memory for the next attempts, so many, at a picture.
    OutOfMemory(u32),
    /// Its thread panics at the next picture.
    Panic,
}
