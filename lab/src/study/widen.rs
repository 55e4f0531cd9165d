//! A third simulator, which changes structure alone and leaves noise and texture as they were acquired.
//!
//! The structure of a voxel is the mean tissue scale of the voxels around it that are equally far from the junction of grey and
//! white matter; its texture is the residual. Within a random blob,
//! * **blur** convolves the profile of the structure across the junction with a Gaussian;
//! * **thickening** moves that profile into white matter;
//! * **darker white** and **brighter grey matter** follow the tissue scale after a Gaussian.
//!
//! The texture is put back as it was, also in a transmantle band. A lesion without any effect is a sham: it changes nothing.

use geometry::Volume;
use glam::DVec3;

use super::lesion::{Lesion, grey_share, white_share};
use super::paint::{BAND_VALUE, Canvas, GREY, Part, band, fade, reach_mm};
use crate::random::Random;
use analysis::Zone;

/// The number of balls of a blob, and the distance of all but the first from its centre, as a share of the radius.
const BALLS: usize = 6;
const APART: f64 = 0.6;
/// The middle between grey and white, at which the junction is.
const MIDDLE: f64 = 0.5;
/// The Gaussian around a voxel that counts for its profile, in mm: widths and intensities vary from place to place.
const AROUND_MM: f64 = 2.5;
/// The greatest distance from the junction of a profile, the step of its samples, and the Gaussian over them, in mm.
const PROFILE_MM: f64 = 6.0;
const STEP_MM: f64 = 0.25;
const SMOOTH_MM: f64 = 0.3;

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

/// The mean tissue scale by the distance from the junction, from grey matter (below 0) to white.
struct Profile(Vec<f64>);

impl Profile {
    fn distances() -> impl Iterator<Item = f64> {
        let count = (PROFILE_MM / STEP_MM) as i32;
        (-count..=count).map(|step| f64::from(step) * STEP_MM)
    }

    /// The profile around a position, where near voxels count most. Fluid is left out.
    fn around(position: DVec3, voxels: &[Voxel]) -> Self {
        let mut bins = vec![(0.0, 0.0); Self::distances().count()];
        for voxel in voxels {
            let away_mm = voxel.position.distance(position);
            let is_fluid = voxel.steady < f64::from(GREY[0]);
            if is_fluid || away_mm > 3.0 * AROUND_MM || voxel.from_junction_mm.abs() > PROFILE_MM {
                continue;
            }
            let bin = ((voxel.from_junction_mm + PROFILE_MM) / STEP_MM).round() as usize;
            let weight = gaussian(away_mm, AROUND_MM);
            bins[bin].0 += weight;
            bins[bin].1 += weight * voxel.value;
        }
        let mean_at = |at: f64| {
            let weighted = Self::distances().zip(&bins).map(|(mm, (count, sum))| {
                let weight = gaussian(mm - at, SMOOTH_MM);
                (weight * count, weight * sum)
            });
            let (count, sum) = weighted.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
            (sum / count.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
        };
        Self(Self::distances().map(mean_at).collect())
    }

    /// The value at a distance; beyond both ends, that of the end.
    fn at(&self, distance_mm: f64) -> f64 {
        let place = (distance_mm + PROFILE_MM).clamp(0.0, 2.0 * PROFILE_MM) / STEP_MM;
        let (before, part) = (place.floor() as usize, place.fract());
        let after = (before + 1).min(self.0.len() - 1);
        self.0[before] + part * (self.0[after] - self.0[before])
    }

    /// The value at a distance of the profile convolved with a Gaussian.
    fn widened_at(&self, distance_mm: f64, blur_mm: f64) -> f64 {
        if blur_mm <= 0.0 {
            return self.at(distance_mm);
        }
        let weighted = Self::distances().map(|mm| {
            let weight = gaussian(mm, blur_mm);
            (weight, weight * self.at(distance_mm + mm))
        });
        let (total, sum) = weighted.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        sum / total
    }
}

fn gaussian(away: f64, deviation: f64) -> f64 {
    (-0.5 * (away / deviation).powi(2)).exp()
}

/// A voxel with tissue around a lesion.
struct Voxel {
    in_block: [usize; 3],
    position: DVec3,
    value: f64,
    /// The tissue scale, steadied against noise.
    steady: f64,
    from_junction_mm: f64,
}

/// The voxels with tissue in a part of a head.
fn tissue(part: &Part<'_>, canvas: &Canvas<'_>) -> Vec<Voxel> {
    let steady: Vec<f64> = part.voxels().map(|voxel| part.steady(voxel)).collect();
    let junction = junction(part, canvas, &steady);
    let voxel = |(voxel, steady): ([usize; 3], f64)| {
        let (in_block, position) = (part.in_block(voxel), part.position(voxel));
        let index = canvas.block.grid.index(in_block);
        if canvas.block.zones[index] < Zone::Tissue {
            return None;
        }
        let squares = junction.iter().map(|it| it.distance_squared(position));
        let away_mm = squares.fold(f64::INFINITY, f64::min).sqrt();
        Some(Voxel {
            in_block,
            position,
            value: f64::from(canvas.values[index]),
            steady,
            from_junction_mm: if steady < MIDDLE { -away_mm } else { away_mm },
        })
    };
    part.voxels().zip(steady).filter_map(voxel).collect()
}

/// The places at which the steadied tissue scale passes the middle between grey and white, on the edges between voxels.
fn junction(part: &Part<'_>, canvas: &Canvas<'_>, steady: &[f64]) -> Vec<DVec3> {
    let zone = |voxel| canvas.block.zones[canvas.block.grid.index(part.in_block(voxel))];
    let [nx, ny, _] = part.size;
    let mut found = Vec::new();
    for (voxel, &here) in part.voxels().zip(steady) {
        for (axis, stride) in [1, nx, nx * ny].into_iter().enumerate() {
            let mut next = voxel;
            next[axis] += 1;
            if next[axis] == part.size[axis] {
                continue;
            }
            let there = steady[voxel[0] + nx * (voxel[1] + ny * voxel[2]) + stride];
            let passes = (here < MIDDLE) != (there < MIDDLE);
            if passes && [voxel, next].map(zone) == [Zone::Deep; 2] {
                let share = (MIDDLE - here) / (there - here);
                found.push(part.position(voxel).lerp(part.position(next), share));
            }
        }
    }
    found
}

/// A copy of a volume with a lesion.
pub(super) fn widened(canvas: &Canvas<'_>, lesion: &Lesion) -> Volume {
    let effect = lesion.effect;
    let mut random = Random::new(lesion.seed ^ 0x5749_4445_4E00);
    let reach_mm = reach_mm(lesion, lesion.radius_mm * (1.0 + APART)) + PROFILE_MM;
    let part = Part::around(canvas, lesion.centre_in_patient, reach_mm);
    let voxel_mm3 = canvas.block.spacing_mm.iter().product();
    let blob = Blob::new(lesion, &part, voxel_mm3, &mut random);
    let tissue = tissue(&part, canvas);
    let changes_profile = effect.blur_mm > 0.0 || effect.thickening_mm > 0.0;
    let mut voxels = canvas.volume.voxels().to_vec();
    for voxel in &tissue {
        let share = fade(blob.outside_mm(voxel.position));
        let [grey, white] = [grey_share(voxel.steady), white_share(voxel.steady)];
        let mut change = 0.0;
        if share > 0.0 && changes_profile {
            let profile = Profile::around(voxel.position, &tissue);
            let from_mm = voxel.from_junction_mm;
            let moved = profile.widened_at(from_mm - effect.thickening_mm, effect.blur_mm);
            // Fluid, which is neither grey nor white, stays.
            change += share * (grey + white) * (moved - profile.at(from_mm));
        }
        change += share * (effect.brightening * grey - effect.darkening * white);
        change -= band(lesion, voxel.position) * white * (1.0 - BAND_VALUE);
        if change != 0.0 {
            canvas.put(&mut voxels, voxel.in_block, voxel.value + change);
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
