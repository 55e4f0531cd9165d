//! How slantwise the isosurfaces of a head meet its junction of grey and white matter.

use glam::{DVec3, Vec3};

use crate::Head;
use crate::block::{Block, depth_at};
use crate::regions::{Region, Regions};

/// The upper borders of the depth bands, in mm. The last band has no lower one.
const BANDS_MM: [f32; 6] = [3.0, 6.0, 10.0, 15.0, 20.0, 30.0];
/// A junction is met slantwise if less than this share of the gradient lies in the isosurface: at less than 30°.
const LEAST_IN_SURFACE: f32 = 0.5;
/// The least gradient, in tissue scale per mm; the direction of a weaker one is noise.
const LEAST_GRADIENT: f32 = 0.1;
/// The greatest distance from the middle between grey and white, in tissue scale.
const NEAR_MIDDLE: f32 = 0.25;

/// The junction of a head between two depths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthBand {
    /// The shallower border, in mm.
    pub from_mm: f32,
    /// The deeper border, in mm; `None` for the deepest band.
    pub to_mm: Option<f32>,
    /// The number of places of the junction that were looked at: at most one in eight voxels.
    pub places: u32,
    /// The share of them that the isosurface meets at less than 30°, 0 to 1; there, a sharp junction looks blurred. 0 if
    /// there are no places.
    pub slanted_share: f32,
}

/// The shares of the junction that isosurfaces meet slantwise, by depth. Only the junction that counts is looked at.
pub(crate) fn depth_bands(
    head: Head<'_>,
    block: &Block,
    values: &[f32],
    regions: &Regions,
) -> Vec<DepthBand> {
    let field = head.depth;
    let working_from_block = field.grid().voxel_from_patient() * block.grid.patient_from_voxel();
    // The inverse transpose converts a gradient per voxel to one per mm of patient space.
    let axes = block.grid.patient_from_voxel().matrix3;
    let per_mm = axes.inverse().transpose().as_mat3();
    let mut counts = [[0u32; 2]; BANDS_MM.len()];
    let inner = |axis: usize| (2..block.size[axis].saturating_sub(2)).step_by(2);
    for (z, y) in inner(2).flat_map(|z| inner(1).map(move |y| (z, y))) {
        for voxel in inner(0).map(|x| [x, y, z]) {
            let index = block.grid.index(voxel);
            let counts_there = Region::from_code(regions.codes()[index]).is_none_or(Region::counts);
            if (values[index] - 0.5).abs() > NEAR_MIDDLE || !counts_there {
                continue;
            }
            let place = DVec3::from_array(voxel.map(|along| along as f64));
            let place = working_from_block.transform_point3(place).as_vec3();
            let depth_mm = depth_at(field, place);
            let above = BANDS_MM.iter().filter(|&&border| border <= depth_mm);
            let Some(counts) = above.count().checked_sub(1).and_then(|n| counts.get_mut(n)) else {
                continue;
            };
            let gradient = per_mm * slope(block, values, voxel);
            if gradient.length() < LEAST_GRADIENT {
                continue;
            }
            // The working grid is along the patient axes.
            let inwards = field.gradient(place).normalize_or_zero();
            let across = gradient.normalize().dot(inwards);
            let in_surface = (1.0 - across * across).max(0.0).sqrt();
            counts[0] += 1;
            counts[1] += u32::from(in_surface < LEAST_IN_SURFACE);
        }
    }
    let bands = BANDS_MM.into_iter().zip(counts).enumerate();
    bands
        .map(|(number, (from_mm, [places, slanted]))| DepthBand {
            from_mm,
            to_mm: BANDS_MM.get(number + 1).copied(),
            places,
            slanted_share: slanted as f32 / places.max(1) as f32,
        })
        .collect()
}

/// The gradient per voxel over two voxels to either side, which hardly contains noise.
pub fn slope(block: &Block, values: &[f32], voxel: [usize; 3]) -> Vec3 {
    let along = |axis: usize| {
        let at = |by: i64| {
            let mut there = voxel;
            there[axis] = (there[axis] as i64 + by) as usize;
            values[block.grid.index(there)]
        };
        (at(2) + at(1) - at(-1) - at(-2)) / 6.0
    };
    Vec3::new(along(0), along(1), along(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RegionDoubt;
    use crate::phantom::{Phantom, plain_grid};
    use crate::regions::phantom::{BrainPhantom, grid};
    use crate::regions::regions;
    use crate::tissue::tissue_of;

    /// The bands of a synthetic head, which is too small for its regions to be known. Its tissue scale rises by ½ for each mm of `from_middle_mm`.
    fn bands(from_middle_mm: impl Fn(DVec3, f32) -> f32) -> Vec<DepthBand> {
        let scan = Phantom::PLAIN.scan(&plain_grid());
        let head = scan.head();
        let block = Block::new(head.volume, head.depth).unwrap();
        let working_from_patient = head.depth.grid().voxel_from_patient();
        let value = |index: usize| {
            let voxel = DVec3::from_array(block.grid.voxel(index).map(|along| along as f64));
            let position = block.grid.patient_from_voxel().transform_point3(voxel);
            let place = working_from_patient.transform_point3(position).as_vec3();
            0.5 + 0.5 * from_middle_mm(position, depth_at(head.depth, place))
        };
        let values: Vec<f32> = (0..block.voxel_count()).map(value).collect();
        let regions = regions(head, &block, &values, None);
        depth_bands(head, &block, &values, &regions)
    }

    #[test]
    fn a_junction_along_an_isosurface_is_met_slantwise_everywhere() {
        let bands = bands(|_, depth_mm| depth_mm - 12.0);
        let at_12_mm = bands[2];
        assert_eq!((at_12_mm.from_mm, at_12_mm.to_mm), (10.0, Some(15.0)));
        assert!(at_12_mm.places > 1000, "{bands:?}");
        assert!(at_12_mm.slanted_share > 0.98, "{bands:?}");
        assert_eq!([bands[4].places, bands[5].places], [0, 0]);
    }

    #[test]
    fn the_junction_beyond_30_mm_is_a_band_of_its_own() {
        let bands = bands(|_, depth_mm| depth_mm - 33.0);
        let deepest = bands[5];
        assert_eq!((deepest.from_mm, deepest.to_mm), (30.0, None));
        assert!(deepest.places > 300, "{bands:?}");
        assert!(bands[..4].iter().all(|band| band.places == 0), "{bands:?}");
    }

    #[test]
    fn only_the_cerebrum_without_its_nuclei_counts() {
        let scan = BrainPhantom::PLAIN.scan(&grid());
        let (block, values, _) = tissue_of(scan.head()).unwrap();
        let known = regions(scan.head(), &block, &values, None);
        assert_eq!(known.doubts, []);
        let places = |regions: &Regions| -> u32 {
            let bands = depth_bands(scan.head(), &block, &values, regions);
            bands.iter().map(|band| band.places).sum()
        };
        let doubted = regions(scan.head(), &block, &values, Some(RegionDoubt::PrunedMask));
        let [counted, all] = [&known, &doubted].map(places);
        // The folia of the cerebellum have much junction.
        assert!(counted > 5000 && all > counted + 2000, "{counted} {all}");
    }

    #[test]
    fn a_junction_across_the_isosurfaces_is_met_upright() {
        let middle = plain_grid()
            .patient_from_voxel()
            .transform_point3(DVec3::ZERO);
        assert!(middle.x < 0.0, "the head lies around the origin");
        let bands = bands(|position, _| position.x as f32);
        for band in &bands[..3] {
            assert!(band.places > 50 && band.slanted_share < 0.02, "{bands:?}");
        }
    }

    #[test]
    fn a_weak_gradient_is_no_junction() {
        let bands = bands(|position, _| 0.1 * position.x as f32);
        assert!(bands.iter().all(|band| band.places == 0), "{bands:?}");
    }
}
