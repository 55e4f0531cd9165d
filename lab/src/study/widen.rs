//! A third simulator, which changes structure alone and leaves noise and texture as they were acquired.
//!
//! The structure of a voxel is the mean tissue scale of the voxels around it that have the same steadied tissue scale, so that
//! edges stay as sharp as they are; its texture is the residual. Within a random blob,
//! * **blur** smooths the structure by a Gaussian, which leaves out fluid;
//! * **thickening** moves the structure into white matter;
//! * **darker white** and **brighter grey matter** follow the steadied tissue scale.
//!
//! The texture is put back as it was, also in a transmantle band. A lesion without any effect is a sham: it changes nothing.

use geometry::Volume;
use glam::DVec3;

use super::lesion::{Lesion, direction, grey_share, white_share};
use super::paint::{BAND_VALUE, Canvas, Part, band, fade, reach_mm};
use crate::random::Random;
use analysis::Zone;

/// The number of balls of a blob, and the distance of all but the first from its centre, as a share of the radius.
const BALLS: usize = 6;
const APART: f64 = 0.6;
/// The Gaussians over the distance, in mm, and over the steadied tissue scale of the voxels that count for a structure.
const AROUND_MM: f64 = 2.5;
const ALIKE: f64 = 0.1;
/// The reach of a Gaussian, as a multiple of its deviation, and the least deviation that interpolates between voxels, in voxels.
const REACH: f64 = 2.5;
const BETWEEN: f64 = 0.4;

/// A union of balls around the centre of a lesion, as large as a ball of its radius.
struct Blob {
    centres: [DVec3; BALLS],
    radius_mm: f64,
}

impl Blob {
    fn new(lesion: &Lesion, part: &Part<'_>, voxel_mm3: f64, random: &mut Random) -> Self {
        let mut centres = [lesion.centre_in_patient; BALLS];
        for centre in &mut centres[1..] {
            let away = DVec3::new(random.normal(), random.normal(), random.normal());
            *centre += away.normalize_or(DVec3::X) * (APART * lesion.radius_mm);
        }
        let mut blob = Self {
            centres,
            radius_mm: 0.0,
        };
        let positions = part.voxels().map(|voxel| part.position(voxel));
        let mut outside: Vec<f64> = positions.map(|at| blob.outside_mm(at)).collect();
        let wanted_mm3 = 4.0 / 3.0 * std::f64::consts::PI * lesion.radius_mm.powi(3);
        let count = ((wanted_mm3 / voxel_mm3) as usize).min(outside.len() - 1);
        blob.radius_mm = *outside.select_nth_unstable_by(count, f64::total_cmp).1;
        blob
    }

    fn outside_mm(&self, position: DVec3) -> f64 {
        let away = self.centres.iter().map(|centre| centre.distance(position));
        away.fold(f64::INFINITY, f64::min) - self.radius_mm
    }
}

/// A voxel around a lesion.
struct Voxel {
    position: DVec3,
    is_tissue: bool,
    value: f64,
    /// The tissue scale, steadied against noise.
    steady: f64,
}

fn gaussian(away: f64, deviation: f64) -> f64 {
    (-0.5 * (away / deviation).powi(2)).exp()
}

/// The mean of values of a part under a Gaussian around a position, by the weight and the value of each voxel.
fn mean(
    part: &Part<'_>,
    (position, deviation_mm): (DVec3, f64),
    weighted: impl Fn(usize) -> (f64, f64),
) -> f64 {
    let block = part.canvas.block;
    let place = block.grid.voxel_from_patient().transform_point3(position);
    let deviation = block.in_voxels(deviation_mm);
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let place = place[axis] - part.first[axis] as f64;
        let deviation = deviation[axis].max(BETWEEN);
        let first = (place - REACH * deviation).ceil().max(0.0) as usize;
        let end = (place + REACH * deviation).floor().max(0.0) as usize + 1;
        let near = first..end.min(part.size[axis]);
        near.map(|at| (at, gaussian(at as f64 - place, deviation)))
            .collect::<Vec<_>>()
    });
    let [nx, ny, _] = part.size;
    let (mut total, mut sum) = (0.0, 0.0);
    for (z, far) in &z {
        for (y, across) in &y {
            for (x, along) in &x {
                let (weight, value) = weighted(x + nx * (y + ny * z));
                let weight = far * across * along * weight;
                total += weight;
                sum += weight * value;
            }
        }
    }
    sum / total.max(f64::MIN_POSITIVE)
}

/// A copy of a volume with a lesion.
pub(super) fn widened(canvas: &Canvas<'_>, lesion: &Lesion) -> Volume {
    let Canvas { block, values, .. } = *canvas;
    let effect = lesion.effect;
    let mut random = Random::new(lesion.seed ^ 0x5749_4445_4E00);
    let around_mm = effect.thickening_mm + REACH * effect.blur_mm;
    let reach_mm = reach_mm(lesion, lesion.radius_mm * (1.0 + APART)) + around_mm;
    let part = Part::around(canvas, lesion.centre_in_patient, reach_mm);
    let voxel_mm3 = block.spacing_mm.iter().product();
    let blob = Blob::new(lesion, &part, voxel_mm3, &mut random);
    let voxel = |voxel| {
        let index = block.grid.index(part.in_block(voxel));
        Voxel {
            position: part.position(voxel),
            is_tissue: block.zones[index] >= Zone::Tissue,
            value: f64::from(values[index]),
            steady: part.steady(voxel),
        }
    };
    let all: Vec<Voxel> = part.voxels().map(voxel).collect();
    let structure = |own: &Voxel| {
        let is_needed = around_mm > 0.0 && fade(blob.outside_mm(own.position) - around_mm) > 0.0;
        if !is_needed || !own.is_tissue {
            return (0.0, own.value);
        }
        let structure = mean(&part, (own.position, AROUND_MM), |index| {
            let other = &all[index];
            let alike = gaussian(other.steady - own.steady, ALIKE);
            (f64::from(u8::from(other.is_tissue)) * alike, other.value)
        });
        // Fluid is neither grey nor white.
        (grey_share(structure) + white_share(structure), structure)
    };
    let structures: Vec<(f64, f64)> = all.iter().map(structure).collect();
    let mut voxels = canvas.volume.voxels().to_vec();
    for (index, voxel) in part.voxels().enumerate() {
        let (own, in_block) = (&all[index], part.in_block(voxel));
        if !own.is_tissue {
            continue;
        }
        let share = fade(blob.outside_mm(own.position));
        let white = white_share(own.steady);
        let mut change = share * effect.brightening * grey_share(own.steady);
        change -=
            white * (share * effect.darkening + band(lesion, own.position) * (1.0 - BAND_VALUE));
        if share > 0.0 && around_mm > 0.0 {
            let moved_mm = direction(block, values, in_block) * effect.thickening_mm;
            let from = (own.position - moved_mm, effect.blur_mm);
            let (weight, structure) = structures[index];
            change += share * weight * (mean(&part, from, |index| structures[index]) - structure);
        }
        if change != 0.0 {
            canvas.put(&mut voxels, in_block, own.value + change);
        }
    }
    canvas.volume_of(voxels)
}

#[cfg(test)]
mod tests {
    use super::super::paint::tests::{GRAIN, chosen, grainy};
    use super::*;
    use crate::study::{Effect, Ground, Simulator};
    use analysis::testing::{lesion, on_junction};

    fn blob(effect: Effect) -> Lesion {
        Lesion {
            centre_in_patient: lesion(),
            radius_mm: 14.0,
            effect,
            band_to: None,
            seed: 3,
        }
    }

    /// The tissue scale of the voxels within 8 mm of a lesion by their height above the junction, without and with it.
    fn heights(effect: Effect) -> Vec<(f64, [f64; 2])> {
        let scan = grainy();
        let ground = Ground::new(scan.head()).unwrap();
        let with = ground.simulated(&blob(effect), Simulator::Widened);
        let block = &ground.block;
        let is_near = |position: DVec3, _| position.distance(lesion()) < 8.0;
        let [before, after] = [&scan.volume, &with].map(|volume| chosen(&ground, volume, is_near));
        let both = before.into_iter().zip(after);
        both.map(|((voxel, before), (_, after))| {
            let place = DVec3::from_array(voxel.map(|along| along as f64));
            let position = block.grid.patient_from_voxel().transform_point3(place);
            let height = position.length() - on_junction(position.normalize()).length();
            (height, [before, after])
        })
        .collect()
    }

    fn mean(values: impl Iterator<Item = f64>) -> f64 {
        let (sum, count) =
            values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
        sum / count
    }

    /// The mean of the voxels within 0.4 mm of a height: 0 without the lesion, 1 with it.
    fn mean_at(heights: &[(f64, [f64; 2])], from: f64, which: usize) -> f64 {
        let near = heights
            .iter()
            .filter(|(height, _)| (height - from).abs() < 0.4);
        mean(near.map(|(_, values)| values[which]))
    }

    #[test]
    fn a_blur_widens_the_profile_as_a_gaussian_does_and_leaves_noise_and_texture() {
        let heights = heights(Effect {
            blur_mm: 1.5,
            ..Effect::NONE
        });
        let at = |from, which| mean_at(&heights, from, which);
        let step = |which| at(-1.0, which) - at(1.0, which);
        // Of an edge of 1.3 mm, 0.56 lie within 1 mm; of one of 1.3 and 1.5 mm together, 0.38.
        assert!((0.48..0.66).contains(&step(0)), "{}", step(0));
        let kept = step(1) / step(0);
        assert!((0.58..0.80).contains(&kept), "{kept}");
        // What changes depends on the height alone: a mean of the voxels would have taken away their noise.
        for from in [-3.0, -1.5, 0.0, 1.5] {
            let near = || {
                heights
                    .iter()
                    .filter(move |(height, _)| (height - from).abs() < 0.2)
            };
            let changes = || near().map(|(_, [before, after])| after - before);
            let middle = mean(changes());
            let spread = mean(changes().map(|change| (change - middle).powi(2))).sqrt();
            assert!(
                near().count() > 30 && spread < 0.5 * GRAIN.deviation,
                "{from}: {spread}"
            );
        }
    }

    #[test]
    fn a_thickening_moves_the_profile_into_white_matter() {
        let heights = heights(Effect {
            thickening_mm: 2.0,
            ..Effect::NONE
        });
        let at = |from, which| mean_at(&heights, from, which);
        for (after, before) in [(-2.0, 0.0), (-1.0, 1.0), (-3.0, -1.0)] {
            let [found, wanted] = [at(after, 1), at(before, 0)];
            assert!(
                (found - wanted).abs() < 0.06,
                "{after}: {found}, not {wanted}"
            );
        }
    }

    #[test]
    fn a_blob_is_as_large_as_a_ball_and_another_for_each_seed() {
        let scan = grainy();
        let ground = Ground::new(scan.head()).unwrap();
        let canvas = ground.canvas();
        let lesion = blob(Effect::NONE);
        let part = Part::around(&canvas, lesion.centre_in_patient, 2.0 * lesion.radius_mm);
        let shapes = [3, 4].map(|seed| {
            let blob = Blob::new(&lesion, &part, 1.0, &mut Random::new(seed));
            let inside = part
                .voxels()
                .filter(|voxel| blob.outside_mm(part.position(*voxel)) < 0.0);
            inside.collect::<Vec<_>>()
        });
        for shape in &shapes {
            assert!(
                (shape.len() as f64 / 11_494.0 - 1.0).abs() < 0.01,
                "{}",
                shape.len()
            );
        }
        assert_ne!(shapes[0], shapes[1]);
    }
}
