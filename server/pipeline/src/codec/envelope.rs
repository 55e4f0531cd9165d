//! An envelope or a brain mask as runs.

use geometry::{BrainMask, Envelope, Grid, MAX_WORKING_SIZE, Mask};

use super::bytes::{Reader, put_grid, put_leb128};

/// The payload of an envelope.
pub fn encode_envelope(envelope: &Envelope) -> Vec<u8> {
    encode(envelope.mask())
}

/// The payload of a brain mask.
pub fn encode_brain(brain: &BrainMask) -> Vec<u8> {
    encode(brain.mask())
}

fn encode(mask: &Mask) -> Vec<u8> {
    let mut bytes = Vec::new();
    put_grid(&mut bytes, mask.grid());
    put_runs(&mut bytes, mask.voxels());
    bytes
}

fn put_runs(bytes: &mut Vec<u8>, voxels: &[bool]) {
    let starts_inside = voxels.first().is_some_and(|&inside| inside);
    if starts_inside {
        put_leb128(bytes, 0);
    }
    for run in voxels.chunk_by(|a, b| a == b) {
        // A working grid has at most 512³ voxels.
        put_leb128(bytes, run.len() as u32);
    }
}

/// The envelope from a payload; `None` if it is damaged.
pub fn decode_envelope(bytes: &[u8]) -> Option<Envelope> {
    Envelope::from_stored(decode(bytes)?).ok()
}

/// The brain mask from a payload; `None` if it is damaged.
pub fn decode_brain(bytes: &[u8]) -> Option<BrainMask> {
    BrainMask::from_stored(decode(bytes)?).ok()
}

fn decode(bytes: &[u8]) -> Option<Mask> {
    let mut reader = Reader(bytes);
    let grid = reader.grid()?;
    if grid.size().iter().any(|&side| side > MAX_WORKING_SIZE) {
        return None;
    }
    let voxels = read_runs(&mut reader, &grid)?;
    Mask::new(grid, voxels).ok()
}

fn read_runs(reader: &mut Reader<'_>, grid: &Grid) -> Option<Vec<bool>> {
    let count = grid.voxel_count();
    let mut voxels = Vec::with_capacity(count);
    let mut inside = false;
    while voxels.len() < count {
        let end = voxels.len() + usize::try_from(reader.leb128()?).ok()?;
        if end > count {
            return None;
        }
        voxels.resize(end, inside);
        inside = !inside;
    }
    reader.0.is_empty().then_some(voxels)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        Grid::aligned([5, 4, 4], [0.9; 3], glam::DVec3::new(1.0, 2.0, 3.0)).unwrap()
    }

    #[test]
    fn an_envelope_comes_back_exactly() {
        let mut voxels = vec![false; 80];
        for index in [26, 27, 46, 48] {
            voxels[index] = true;
        }
        let envelope = Envelope::from_stored(Mask::new(grid(), voxels).unwrap()).unwrap();
        let bytes = encode_envelope(&envelope);
        assert_eq!(decode_envelope(&bytes), Some(envelope));
        assert_eq!(decode_envelope(&bytes[..bytes.len() - 1]), None);
        assert_eq!(decode_envelope(&[&bytes[..], &[0]].concat()), None);
    }

    #[test]
    fn runs_may_begin_and_end_inside() {
        let voxels: Vec<bool> = (0..80).map(|index| index % 80 < 3 || index > 70).collect();
        let mut bytes = Vec::new();
        put_runs(&mut bytes, &voxels);
        assert_eq!(read_runs(&mut Reader(&bytes), &grid()), Some(voxels));
    }

    #[test]
    fn a_run_beyond_the_grid_is_refused() {
        let mut bytes = Vec::new();
        put_leb128(&mut bytes, u32::MAX);
        assert_eq!(read_runs(&mut Reader(&bytes), &grid()), None);
    }
}
