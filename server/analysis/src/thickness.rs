//! The thickness of the cortex and the mean of all tissue, compared with the other side.
//!
//! Where the cortex is thicker, there is more grey matter for each area of the white surface, and the mean of all tissue is
//! darker. A blur changes neither to first order.

use crate::MidsagittalPlane;
use crate::block::{Block, Zone};
use crate::coarse::{Coarse, Sums};
use crate::gradient::Weighted;
use crate::mirror::{LEAST_MIRRORED, Places};
use crate::robust::Robust;

/// The cell size of all sums, in mm, and the Gaussian that smooths them on both sides.
const STEP_MM: f64 = 2.0;
const WIDTH_MM: f64 = 3.0;
/// The intensities of tissue, in tissue scale.
const TISSUE_RANGE: [f32; 2] = [-0.5, 1.5];
/// The least weight of a voxel of the white surface: a biweight of half-width ½ at a quarter off the middle.
const SURFACE_FROM: f32 = 0.5625;
/// The least area of the white surface in a volume, in mm²/mm³, and the least share of tissue.
const LEAST_AREA: f32 = 0.01;
const LEAST_TISSUE: f32 = 1e-3;
/// The share of the thickness beside the mean of all tissue, and the greatest deviation of either.
const THICKNESS_SHARE: f32 = 0.7;
const MOST_Z: f32 = 8.0;
/// The least spread of the thickness, in mm, and of the mean, in tissue scale. A smaller spread is rounding, not anatomy.
const LEAST_THICKNESS_SPREAD: f32 = 0.1;
const LEAST_MEAN_SPREAD: f32 = 0.01;

/// The share of grey matter of a voxel of this tissue scale: the rest is white matter, or fluid if it is darker than grey.
fn grey_share(tissue: f32, fluid: f32) -> f32 {
    let share = if tissue < 0.0 {
        1.0 - tissue / fluid
    } else {
        1.0 - tissue
    };
    share.clamp(0.0, 1.0)
}

/// The grey matter, the white surface and the tissue of a head on cells, from which the thickness of its cortex follows.
///
/// Everything is a mean under a Gaussian of 3 mm.
pub(crate) struct Thickness {
    coarse: Coarse,
    /// The grey share, the area of the white surface, the tissue scale and the share of tissue.
    own: Vec<Sums<4>>,
    /// Thickness and mean of all tissue, weighted by the junction, and that weight.
    at_junction: Vec<Sums<3>>,
}

/// The thickness, in mm, and the mean of all tissue.
///
/// The thickness is the volume of grey matter over the area of the white surface, which is the mean thickness if the window is
/// much wider than the cortex.
fn of_sums([grey, area, intensity, tissue]: Sums<4>) -> [f32; 2] {
    [
        grey / area.max(LEAST_AREA),
        intensity / tissue.max(LEAST_TISSUE),
    ]
}

impl Thickness {
    /// `fluid` is the mean of fluid in tissue scale.
    pub(crate) fn new(block: &Block, (values, fluid): (&[f32], f32), weighted: &Weighted) -> Self {
        let coarse = Coarse::new(block.size, block.spacing_mm, STEP_MM);
        let Weighted { weights, gradients } = weighted;
        let [grey, area, intensity, tissue, weight] = coarse.means(|index| {
            let is_tissue = block.zones[index] >= Zone::Tissue;
            if !is_tissue {
                return [0.0; 5];
            }
            let (value, weight) = (values[index], weights[index]);
            // Twice the gradient between a quarter and three quarters of the tissue scale (the coarea formula).
            let is_surface = weight > SURFACE_FROM;
            let area = if is_surface {
                2.0 * gradients[index] / weight
            } else {
                0.0
            };
            let intensity = value.clamp(TISSUE_RANGE[0], TISSUE_RANGE[1]);
            [grey_share(value, fluid), area, intensity, 1.0, weight]
        });
        let own = coarse.smoothed(&[grey, area, intensity, tissue], WIDTH_MM);
        let mut products = [weight.clone(), weight.clone(), weight];
        for (cell, &sums) in own.iter().enumerate() {
            let [thickness, mean] = of_sums(sums);
            products[0][cell] *= thickness;
            products[1][cell] *= mean;
        }
        Self {
            at_junction: coarse.smoothed(&products, WIDTH_MM),
            own,
            coarse,
        }
    }

    /// How suspicious of a thick cortex each of some voxels (ascending) is, in robust deviations over the junction, which is
    /// given by places among these voxels; NaN where the other side has no junction.
    ///
    /// Thickness and mean are compared with their means over the junction at the mirrored point. The result is minus the
    /// deviation of the mean of all tissue, plus seven tenths of the one of the thickness.
    pub(crate) fn compared(
        &self,
        block: &Block,
        (voxels, junction): (&[u32], &[u32]),
        plane: &MidsagittalPlane,
    ) -> Vec<f32> {
        let mut differences = [0; 2].map(|_| Vec::with_capacity(voxels.len()));
        let places = Places::new(block, &self.coarse, plane);
        places.visit(voxels, &self.own, |_, sums, other| {
            let [thickness, mean, weight] = self.coarse.sample(&self.at_junction, other);
            let has_other = weight > LEAST_MIRRORED;
            let pairs = of_sums(sums).into_iter().zip([thickness, mean]);
            for (difference, (own, other)) in differences.iter_mut().zip(pairs) {
                difference.push(if has_other {
                    own - other / weight
                } else {
                    f32::NAN
                });
            }
        });
        let [thickness, mean] = &differences;
        let robust = |values: &[f32], least_spread: f32| {
            let at_junction = junction.iter().map(|&place| values[place as usize]);
            Robust::of(at_junction, least_spread)
        };
        let of_thickness = robust(thickness, LEAST_THICKNESS_SPREAD);
        let of_mean = robust(mean, LEAST_MEAN_SPREAD);
        let z = |robust: Robust, value: f32| robust.z(value).clamp(-MOST_Z, MOST_Z);
        (thickness.iter().zip(mean))
            .map(|(&thickness, &mean)| {
                THICKNESS_SHARE * z(of_thickness, thickness) - z(of_mean, mean)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use geometry::{Rescale, Volume};
    use glam::DVec3;

    use super::*;
    use crate::Head;
    use crate::candidates::Scores;
    use crate::gradient::weighted_gradient;
    use crate::maps::compared_thickness;
    use crate::phantom::{Scan, white_noise};
    use crate::regions::phantom::{BrainPhantom, grid};
    use crate::sharpness::sharpness;
    use crate::tissue::tissue_of;

    #[test]
    fn half_fluid_and_half_white_are_half_grey() {
        let shares = [-4.0, -2.0, -1.0, 0.0, 0.5, 1.0, 1.3].map(|value| grey_share(value, -2.0));
        assert_eq!(shares, [0.0, 0.0, 0.5, 1.0, 0.5, 0.0, 0.0]);
    }

    /// The stored values of grey matter and of white matter of the phantom.
    const GREY: u16 = 1000;
    const WHITE: u16 = 1400;

    /// The scan with white matter painted grey within 9 mm of a place, if it is within 2 mm of grey matter.
    fn thickened(scan: &Scan, place: DVec3) -> Volume {
        let grid = scan.volume.grid();
        let before = scan.volume.voxels();
        let is_grey = |stored: u16| (GREY - 200..(GREY + WHITE) / 2).contains(&stored);
        let mut voxels = before.to_vec();
        for (index, stored) in voxels.iter_mut().enumerate() {
            let voxel = grid.voxel(index);
            let at = DVec3::from_array(voxel.map(|along| along as f64));
            let is_inside = grid
                .patient_from_voxel()
                .transform_point3(at)
                .distance(place)
                < 9.0;
            if !is_inside || *stored < (GREY + WHITE) / 2 {
                continue;
            }
            let is_near = (0..125).any(|number| {
                let off = [number % 5 - 2, number / 5 % 5 - 2, number / 25 - 2];
                let there = [0, 1, 2].map(|axis| (voxel[axis] as i64 + off[axis]) as usize);
                let squared: i64 = off.iter().map(|along| along * along).sum();
                squared <= 4 && is_grey(before[grid.index(there)])
            });
            if is_near {
                *stored = GREY;
            }
        }
        Volume::new(grid.clone(), voxels, scan.volume.rescale()).expect("as many voxels")
    }

    /// The scores at the junction, with their positions.
    fn scores(head: Head<'_>) -> Vec<(DVec3, f32)> {
        let (block, values, tissue) = tissue_of(head).unwrap();
        let weighted = weighted_gradient(&block, &values, tissue.noise);
        let thickness = Thickness::new(&block, (&values, tissue.fluid), &weighted);
        let sharpness = sharpness(&block, weighted);
        let mut map = compared_thickness(&block, &thickness, &sharpness, head.plane);
        let scores = Scores::smoothed(&block, &sharpness.junction, &mut map);
        let position = |voxel: u32| {
            let voxel = block.grid.voxel(voxel as usize).map(|along| along as f64);
            let voxel = DVec3::from_array(voxel);
            block.grid.patient_from_voxel().transform_point3(voxel)
        };
        let scored = scores.junction.iter().zip(&scores.scores);
        scored
            .map(|(&voxel, &score)| (position(voxel), score))
            .collect()
    }

    /// A head with the same folds on both sides, and noise.
    fn symmetric() -> Scan {
        let phantom = BrainPhantom::PLAIN;
        let own_from_voxel = phantom.placed.inverse() * grid().patient_from_voxel();
        let value = |index: usize| {
            let voxel = DVec3::from_array(grid().voxel(index).map(|along| along as f64));
            let mut place = own_from_voxel.transform_point3(voxel);
            place.x = place.x.abs();
            let value = phantom.at(place).map_or(-1.8, |(_, value)| value);
            let value = value + 0.05 * white_noise(index);
            let contrast = f64::from(WHITE - GREY);
            (f64::from(GREY) + contrast * value).round().max(0.0) as u16
        };
        let voxels = (0..grid().voxel_count()).map(value).collect();
        let rescale = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        let volume = Volume::new(grid(), voxels, rescale).expect("one value for each voxel");
        Scan::new(volume, &phantom.mask(&grid()))
    }

    #[test]
    fn a_thick_cortex_stands_out_on_its_own_side() {
        let scan = symmetric();
        let head = scan.head();
        let plain = scores(head);
        let wanted = DVec3::new(38.0, -30.0, 30.0);
        let distance = |at: &DVec3| at.distance(wanted);
        let nearest = plain
            .iter()
            .min_by(|a, b| distance(&a.0).total_cmp(&distance(&b.0)));
        let place = nearest.expect("junction").0;
        let volume = thickened(&scan, place);
        let thick = scores(Head {
            volume: &volume,
            ..head
        });
        let near = |place: DVec3, scores: &[(DVec3, f32)]| {
            let near = scores.iter().filter(|(at, _)| at.distance(place) < 9.0);
            near.map(|(_, score)| *score)
                .fold(f32::NEG_INFINITY, f32::max)
        };
        let opposite = head.plane.reflected(place);
        let rise = [place, opposite].map(|place| near(place, &thick) - near(place, &plain));
        println!("{rise:?} to {}", near(place, &thick));
        assert!(rise[0] > 1.0 && rise[1] < 0.5, "{rise:?}");
    }
}
