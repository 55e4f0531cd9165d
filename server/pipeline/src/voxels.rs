//! Recognises the same voxels with another header.

use case::VoxelFacts;
use extraction::canonical_axes;
use geometry::Volume;
use imaging::nifti::Replaced;

/// The values of a volume, and where they lie in the patient according to its header.
pub(super) fn voxel_facts(volume: &Volume, replaced: &Replaced) -> VoxelFacts {
    let size = volume.grid().size();
    let mut histogram = vec![0u64; 1 << 16];
    let mut planes = size.map(|side| vec![0u64; side]);
    for (row, values) in volume.voxels().chunks_exact(size[0]).enumerate() {
        let mut of_row = 0u64;
        for (&value, plane) in values.iter().zip(&mut planes[0]) {
            histogram[usize::from(value)] += 1;
            of_row += u64::from(value);
            *plane += u64::from(value);
        }
        planes[1][row % size[1]] += of_row;
        planes[2][row / size[1]] += of_row;
    }
    let mut values = blake3::Hasher::new();
    for count in histogram {
        values.update(&count.to_le_bytes());
    }
    let along = |(native, is_reversed): (usize, bool)| {
        let sums = planes[native].iter();
        let [forward, backward] = [digest(sums.clone()), digest(sums.rev())];
        match is_reversed {
            true => [backward, forward],
            false => [forward, backward],
        }
    };
    VoxelFacts {
        values: values.finalize().to_hex().to_string(),
        profiles: canonical_axes(volume.grid()).map(along),
        not_finite: replaced.not_finite,
        clipped: replaced.clipped,
    }
}

/// The first eight bytes of the BLAKE3 digest of some sums.
fn digest<'a>(sums: impl Iterator<Item = &'a u64>) -> u64 {
    let mut hasher = blake3::Hasher::new();
    for sum in sums {
        hasher.update(&sum.to_le_bytes());
    }
    let mut first = [0; 8];
    first.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(first)
}

#[cfg(test)]
mod tests {
    use geometry::{Grid, Rescale};
    use glam::{DAffine3, DMat3, DVec3};

    use super::*;

    const SIZE: [usize; 3] = [3, 4, 5];

    fn volume(size: [usize; 3], axes: DMat3, value: impl Fn([usize; 3]) -> u16) -> Volume {
        let grid = Grid::new(size, DAffine3::from_mat3(axes)).unwrap();
        let voxels = (0..60).map(|index| value(grid.voxel(index))).collect();
        let as_stored = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        Volume::new(grid, voxels, as_stored).unwrap()
    }

    /// A value for each voxel that no other one has.
    fn value([x, y, z]: [usize; 3]) -> u16 {
        (100 * x + 10 * y + z) as u16
    }

    fn facts(volume: &Volume) -> VoxelFacts {
        voxel_facts(volume, &Replaced::default())
    }

    #[test]
    fn the_same_voxels_with_other_axes_have_other_places_and_stored_otherwise_they_have_not() {
        let [x, y, z] = DVec3::AXES;
        let plain = facts(&volume(SIZE, DMat3::IDENTITY, value));
        let headers = [
            DMat3::from_cols(-x, y, z),
            DMat3::from_cols(x, z, y),
            DMat3::from_cols(y, x, -z),
            DMat3::from_cols(-x, -y, z),
        ];
        for axes in headers {
            let other = facts(&volume(SIZE, axes, value));
            assert!(other.has_other_axes(&plain), "{axes}");
            assert!(plain.has_other_axes(&other), "{axes}");
        }
        // Back to front in the file, and with the axes exchanged, each with the header that is then true.
        let backwards = volume(SIZE, DMat3::from_cols(x, y, -z), |[x, y, z]| {
            value([x, y, 4 - z])
        });
        assert_eq!(facts(&backwards), plain);
        let exchanged = volume([5, 3, 4], DMat3::from_cols(z, x, y), |[z, x, y]| {
            value([x, y, z])
        });
        assert_eq!(facts(&exchanged), plain);
        let slightly_turned = DMat3::from_rotation_z(0.1);
        assert_eq!(facts(&volume(SIZE, slightly_turned, value)), plain);
        assert!(!plain.has_other_axes(&plain));
        let another = facts(&volume(SIZE, DMat3::IDENTITY, |voxel| value(voxel).max(1)));
        assert_ne!(another.values, plain.values);
    }

    /// The same grey values in other places, as after a wrap was undone or a head was moved, are another picture.
    #[test]
    fn voxels_that_were_shifted_are_no_other_header() {
        let plain = facts(&volume(SIZE, DMat3::IDENTITY, value));
        let moved: [fn([usize; 3]) -> [usize; 3]; 5] = [
            |[x, y, z]| [(x + 1) % 3, y, z],
            |[x, y, z]| [x, (y + 2) % 4, z],
            |[x, y, z]| [x, y, (z + 4) % 5],
            |[x, y, z]| [(x + 2) % 3, (y + 1) % 4, (z + 3) % 5],
            |[x, y, z]| match z {
                0 => [x, y, 1],
                1 => [x, y, 0],
                _ => [x, y, z],
            },
        ];
        for moved in moved {
            let other = facts(&volume(SIZE, DMat3::IDENTITY, |voxel| value(moved(voxel))));
            assert_eq!(other.values, plain.values);
            assert_ne!(other.profiles, plain.profiles);
            assert!(!other.has_other_axes(&plain) && !plain.has_other_axes(&other));
        }
    }
}
