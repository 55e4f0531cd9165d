//! The payloads of derived objects, before compression. Little-endian; the frame around a payload states its kind and
//! version.
//!
//! A grid is its size (3 × u32) and the columns of `patient_from_voxel` (12 × f64).
//!
//! | kind | payload |
//! |---|---|
//! | `volume` | grid, slope and intercept (f32), residuals of the stored values |
//! | `mask`, `envelope` | grid, lengths of runs as LEB128: outside, inside, outside, … |
//! | `forest` | the predecessor codes of the envelope's voxels, in the order of the grid |
//! | `paths` | N_F, N_P (u16), origin (3 × f32), step, row and greatest depth (f32), rows (u32), the first piece of each row (u32), pieces, residuals of the rows from row to row |
//! | `maps` | the length of a JSON head (u32) and the head: format, candidates and regions, or why there are no maps; then the length (u32) and the bytes of each map |
//! | `surfaces` | the length of a JSON head (u32) and the head: format, or why there are no surfaces; then, for the left half, the right half and the cerebrum, the length (u32) and the bytes of its envelope, and of the differences of the numbers of the voxels of its fence as LEB128 |
//!
//! Residuals are 16-bit differences from a prediction, folded so that small ones are small numbers (0, −1, 1, −2, …),
//! low bytes first, then all high bytes: zstd finds little to do in the high ones.
//!
//! The digest of a payload is checked before decoding. Even so, every length is compared with the available bytes.

mod bytes;
mod envelope;
mod forest;
mod maps;
mod paths;
mod residuals;
mod surfaces;
mod volume;

pub use envelope::{decode_brain, decode_envelope, encode_brain, encode_envelope};
pub use forest::{decode_forest, encode_forest};
pub use maps::{decode_maps, encode_maps};
pub use paths::{decode_paths, encode_paths};
pub use surfaces::{decode_surfaces, encode_surfaces};
pub use volume::{decode_volume, encode_volume};
