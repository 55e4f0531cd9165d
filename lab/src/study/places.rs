//! Places for lesions: chosen at random from the volume alone, before any picture.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::random::Random;
use analysis::{Block, Head, Region, depth_at, regions, slope};

/// The greatest distance of the tissue scale of a junction voxel from the middle between grey and white.
const NEAR_MIDDLE: f32 = 0.15;
/// The greatest depth of cortex, in mm, if the regions are in doubt. Deeper are nuclei and the brain stem.
const DEEPEST_MM: f32 = 28.0;
/// The least depth of the bottom of a sulcus, in mm.
const BOTTOM_FROM_MM: f32 = 12.0;
/// The greatest depth of a crown, in mm.
const CROWN_TO_MM: f32 = 7.0;
/// The share of the head, from the front and from below, that is frontal, and basal.
const FRONT: f64 = 0.45;
const BASE: f64 = 0.35;
/// The greatest distance of a mesial place from the midsagittal plane, in mm.
const MESIAL_MM: f64 = 12.0;
/// The least distance of cortex from a ventricle, in mm: what is nearer borders on nuclei, not on cortex.
const FROM_VENTRICLE_MM: f64 = 8.0;
/// The least depth of a ventricle, in mm, and the intensity below which it is fluid, in tissue scale.
const VENTRICLE_FROM_MM: f32 = 18.0;
const FLUID_BELOW: f32 = -0.6;
/// The fractions of places at the bottom of sulci, in walls and in crowns, and of frontal places.
const KINDS: [f64; 3] = [0.5, 0.25, 0.25];
const FRONTAL: f64 = 0.6;
/// The least fraction of mesial places and of basal ones.
const LEAST_MESIAL: f64 = 0.1;
const LEAST_BASAL: f64 = 0.1;

/// A place for a lesion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The position, LPS mm.
    pub position_in_patient: DVec3,
    /// The depth below the envelope, in mm.
    pub depth_mm: f32,
    /// The part of the brain.
    pub area: Area,
}

/// A part of the brain, by its place in the box around it alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Area {
    /// Within 12 mm of the midsagittal plane.
    Mesial,
    /// In the lowest 35 % of the head, and not mesial.
    Basal,
    /// In the front 45 % of the head, and neither mesial nor basal.
    Frontal,
    /// Elsewhere.
    Other,
}

impl Area {
    /// All areas.
    pub const ALL: [Self; 4] = [Self::Mesial, Self::Basal, Self::Frontal, Self::Other];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mesial => "within 12 mm of the midsagittal plane",
            Self::Basal => "otherwise in the lowest 35 % of the head",
            Self::Frontal => "otherwise in the front 45 %",
            Self::Other => "elsewhere",
        }
    }
}

/// The wanted properties of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Wish {
    /// 0 bottom of a sulcus, 1 wall, 2 crown.
    kind: usize,
    is_frontal: bool,
    is_mesial: bool,
    is_basal: bool,
}

/// The available places of a block.
pub(crate) struct Offer {
    place: Place,
    kind: usize,
    is_frontal: bool,
    is_mesial: bool,
    is_basal: bool,
}

impl Offer {
    fn meets(&self, wish: Wish) -> bool {
        self.kind == wish.kind
            && self.is_frontal == wish.is_frontal
            && (!wish.is_mesial || self.is_mesial)
            && (!wish.is_basal || self.is_basal)
    }
}

/// Random places by seed: half at the bottom of sulci, a quarter each in walls and crowns, 60 % frontal, at least 10 %
/// each mesial and basal.
///
/// Each place is drawn independently of the others. A least distance would spread them evenly over the head, which
/// favours sharp junctions: blurred ones offer more voxels near the middle, and so more places.
pub(crate) fn places(offers: &[Offer], count: usize, seed: u64) -> Vec<Place> {
    let mut random = Random::new(seed);
    let mut found: Vec<Place> = Vec::new();
    while found.len() < count && !offers.is_empty() {
        let wish = wish(&mut random);
        let suitable: Vec<&Offer> = offers.iter().filter(|offer| offer.meets(wish)).collect();
        // A small head may have no such place.
        if !suitable.is_empty() {
            found.push(suitable[random.below(suitable.len())].place);
        }
    }
    found
}

fn wish(random: &mut Random) -> Wish {
    let drawn = random.uniform();
    let kind = if drawn < KINDS[0] {
        0
    } else if drawn < KINDS[0] + KINDS[1] {
        1
    } else {
        2
    };
    Wish {
        kind,
        is_frontal: random.uniform() < FRONTAL,
        is_mesial: random.uniform() < LEAST_MESIAL,
        is_basal: random.uniform() < LEAST_BASAL,
    }
}

/// All places that a head offers.
pub(crate) fn offers(head: Head<'_>, block: &Block, values: &[f32]) -> Vec<Offer> {
    let corner = |end: f64| {
        let voxel = DVec3::from_array(block.size.map(|side| end * (side - 1) as f64));
        block.grid.patient_from_voxel().transform_point3(voxel)
    };
    let (low, high) = (corner(0.0).min(corner(1.0)), corner(0.0).max(corner(1.0)));
    let size = high - low;
    let ventricles = ventricles(head, block, values);
    let regions = regions(head, block, values, None);
    let mut offers = Vec::new();
    for (index, &value) in values.iter().enumerate() {
        let voxel = block.grid.voxel(index);
        let is_inner = (0..3).all(|axis| (4..block.size[axis] - 4).contains(&voxel[axis]));
        // One voxel in eight is enough, and no two are neighbours.
        if !is_inner || voxel.iter().any(|along| along % 2 > 0) || (value - 0.5).abs() > NEAR_MIDDLE
        {
            continue;
        }
        let place = DVec3::from_array(voxel.map(|along| along as f64));
        let position = block.grid.patient_from_voxel().transform_point3(place);
        let in_working = head
            .depth
            .grid()
            .voxel_from_patient()
            .transform_point3(position);
        let depth_mm = depth_at(head.depth, in_working.as_vec3());
        // It is small in deep nuclei and noise.
        let is_steep = slope(block, values, voxel).length() > 0.10;
        if depth_mm < 4.0 || (depth_mm >= DEEPEST_MM && !regions.doubts.is_empty()) || !is_steep {
            continue;
        }
        let is_near_ventricle = ventricles
            .iter()
            .any(|fluid| fluid.distance_squared(position) < FROM_VENTRICLE_MM.powi(2));
        if is_near_ventricle {
            continue;
        }
        let share = (position - low) / size;
        // The cerebellum is below and behind, if it was not found.
        let is_elsewhere = if regions.doubts.is_empty() {
            !regions.at(position).is_some_and(Region::counts)
        } else {
            share.z < BASE && share.y > FRONT
        };
        if is_elsewhere {
            continue;
        }
        let from_plane = head.plane.normal().dot(position) - head.plane.offset_mm();
        let is_mesial = from_plane.abs() < MESIAL_MM;
        offers.push(Offer {
            place: Place {
                position_in_patient: position,
                depth_mm,
                area: match share {
                    _ if is_mesial => Area::Mesial,
                    DVec3 { z, .. } if z < BASE => Area::Basal,
                    DVec3 { y, .. } if y < FRONT => Area::Frontal,
                    _ => Area::Other,
                },
            },
            kind: match depth_mm {
                _ if depth_mm >= BOTTOM_FROM_MM => 0,
                _ if depth_mm >= CROWN_TO_MM => 1,
                _ => 2,
            },
            is_frontal: share.y < FRONT,
            is_mesial,
            is_basal: share.z < BASE,
        });
    }
    offers
}

/// Every second voxel along each axis, in patient space, that is deep fluid among deep fluid.
pub(crate) fn ventricles(head: Head<'_>, block: &Block, values: &[f32]) -> Vec<DVec3> {
    let working_from_patient = head.depth.grid().voxel_from_patient();
    let is_fluid = |voxel: [usize; 3]| values[block.grid.index(voxel)] < FLUID_BELOW;
    let inner = |axis: usize| (1..block.size[axis].saturating_sub(1)).step_by(2);
    let mut found = Vec::new();
    for (z, y) in inner(2).flat_map(|z| inner(1).map(move |y| (z, y))) {
        for voxel in inner(0).map(|x| [x, y, z]) {
            let has_fluid_around = || {
                (0..3).all(|axis| {
                    let (mut before, mut after) = (voxel, voxel);
                    before[axis] -= 1;
                    after[axis] += 1;
                    is_fluid(before) && is_fluid(after)
                })
            };
            if !is_fluid(voxel) || !has_fluid_around() {
                continue;
            }
            let place = DVec3::from_array(voxel.map(|along| along as f64));
            let position = block.grid.patient_from_voxel().transform_point3(place);
            let in_working = working_from_patient.transform_point3(position).as_vec3();
            if depth_at(head.depth, in_working) > VENTRICLE_FROM_MM {
                found.push(position);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A blurred junction offers many places close together, a sharp one few that are far apart.
    #[test]
    fn places_for_lesions_and_for_comparison_have_the_same_share_of_blurred_junction() {
        let offer = |x: f64, y: f64, number: u32| Offer {
            place: Place {
                position_in_patient: DVec3::new(x, y, 0.0),
                depth_mm: [16.0, 9.0, 5.0][number as usize % 3],
                area: Area::Other,
            },
            kind: number as usize % 3,
            is_frontal: number.is_multiple_of(2),
            is_mesial: number.is_multiple_of(5),
            is_basal: number.is_multiple_of(7),
        };
        let blurred = (0..900u32).map(|n| offer(f64::from(n % 30), f64::from(n / 30), n));
        let sharp = (0..900u32).map(|n| {
            let [x, y] = [n % 30, n / 30].map(|along| f64::from(along) * 5.0);
            offer(-x - 50.0, y, n)
        });
        let offers: Vec<Offer> = blurred.chain(sharp).collect();
        let share = |places: &[Place]| {
            let blurred = places
                .iter()
                .filter(|place| place.position_in_patient.x >= 0.0);
            blurred.count() as f64 / places.len() as f64
        };
        let shares = (0..20).map(|seed| {
            let places = places(&offers, 120 + 400, seed);
            let (trials, normals) = places.split_at(120);
            [share(trials), share(normals)]
        });
        let [trials, normals] = shares.fold([0.0; 2], |sum, [trials, normals]| {
            [sum[0] + trials / 20.0, sum[1] + normals / 20.0]
        });
        // Three standard errors of 2,400 places.
        assert!((trials - 0.5).abs() < 0.03, "{trials}");
        assert!((normals - 0.5).abs() < 0.02, "{normals}");
    }
}
