//! Recognises the same voxels with another header.

use case::VoxelFacts;
use extraction::canonical_axes;
use geometry::Volume;

/// The values of a volume, and where they lie in the patient according to its header.
pub(super) fn voxel_facts(volume: &Volume) -> VoxelFacts {
    let size = volume.grid().size();
    let mut histogram = vec![0u64; 1 << 16];
    let mut sum = 0u64;
    let mut moments = [0u64; 3];
    for (row, values) in volume.voxels().chunks_exact(size[0]).enumerate() {
        let mut of_row = 0u64;
        for (x, &value) in values.iter().enumerate() {
            histogram[usize::from(value)] += 1;
            of_row += u64::from(value);
            moments[0] += u64::from(value) * x as u64;
        }
        sum += of_row;
        moments[1] += of_row * (row % size[1]) as u64;
        moments[2] += of_row * (row / size[1]) as u64;
    }
    let mut values = blake3::Hasher::new();
    for count in histogram {
        values.update(&count.to_le_bytes());
    }
    let along = |(native, is_reversed): (usize, bool)| match is_reversed {
        true => (size[native] - 1) as u64 * sum - moments[native],
        false => moments[native],
    };
    VoxelFacts {
        values: values.finalize().to_hex().to_string(),
        moments: canonical_axes(volume.grid()).map(along),
    }
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

    #[test]
    fn the_same_voxels_with_other_axes_have_other_places_and_stored_otherwise_they_have_not() {
        let [x, y, z] = DVec3::AXES;
        let plain = voxel_facts(&volume(SIZE, DMat3::IDENTITY, value));
        let headers = [
            DMat3::from_cols(-x, y, z),
            DMat3::from_cols(x, z, y),
            DMat3::from_cols(y, x, -z),
            DMat3::from_cols(-x, -y, z),
        ];
        for axes in headers {
            let other = voxel_facts(&volume(SIZE, axes, value));
            assert_eq!(other.values, plain.values);
            assert_ne!(other.moments, plain.moments, "{axes}");
        }
        // Back to front in the file, and with the axes exchanged, each with the header that is then true.
        let backwards = volume(SIZE, DMat3::from_cols(x, y, -z), |[x, y, z]| {
            value([x, y, 4 - z])
        });
        assert_eq!(voxel_facts(&backwards), plain);
        let exchanged = volume([5, 3, 4], DMat3::from_cols(z, x, y), |[z, x, y]| {
            value([x, y, z])
        });
        assert_eq!(voxel_facts(&exchanged), plain);
        let slightly_turned = DMat3::from_rotation_z(0.1);
        assert_eq!(voxel_facts(&volume(SIZE, slightly_turned, value)), plain);
        let another = voxel_facts(&volume(SIZE, DMat3::IDENTITY, |voxel| value(voxel).max(1)));
        assert_ne!(another.values, plain.values);
    }
}
