//! A second simulator, made apart from the first one, which treats noise otherwise.
//!
//! Within an ellipsoid,
//! * **thickening** paints white matter grey where it is near grey matter, with noise as the head's: its variance and the
//!   correlation of neighbours along each axis are measured in the head's deep white matter;
//! * **blur** is the mean of a box, with as much correlated noise as the mean removed;
//! * **darker white** and **brighter grey matter** follow the tissue scale after a Gaussian, so that noise does not decide what is
//!   grey.
//!
//! A transmantle band is painted, from 2.5 mm at the lesion to 1.5 mm at the ventricle. A lesion without any effect is a sham:
//! it changes nothing.

use std::collections::HashMap;

use geometry::Volume;
use glam::DVec3;

use super::lesion::{Lesion, grey_share, white_share};
use crate::random::Random;
use analysis::{Block, TissueScale, Zone};

/// The least and the greatest half-axis, as a share of the radius.
const HALF_AXES: [f64; 2] = [0.85, 1.15];
/// The distance over which the effect fades, in mm.
const FADE_MM: f64 = 1.5;
/// The Gaussian of the tissue scale that tells grey from white matter, in mm; noise would make specks.
const STEADY_MM: f64 = 0.8;
/// Grey matter, in that tissue scale.
const GREY: [f32; 2] = [-0.5, 0.5];
/// The distance over which the paint ends, in mm.
const PAINT_EDGE_MM: f64 = 1.0;
/// The radii of a band at the lesion and at the ventricle, in mm, and the tissue scale of its paint.
const BAND_MM: [f64; 2] = [2.5, 1.5];
pub(super) const BAND_VALUE: f64 = 0.75;
/// Deep white matter: everything within so many voxels is at least this bright; and how many voxels one is looked at.
const WHITE_FROM: f32 = 0.7;
const WHITE_REACH: usize = 3;
const STRIDE: usize = 2;
/// The fewest voxels of deep white matter; with fewer, the noise is taken as white.
const LEAST_SAMPLES: usize = 200;
/// The greatest correlation of neighbours that a kernel of three taps can make.
const MOST_CORRELATED: f64 = 0.7;

/// The head that receives a lesion.
pub(super) struct Canvas<'a> {
    pub(super) volume: &'a Volume,
    pub(super) block: &'a Block,
    /// Tissue scale of the block.
    pub(super) values: &'a [f32],
    pub(super) tissue: &'a TissueScale,
    /// The noise of the head.
    pub(super) grain: Grain,
}

impl Canvas<'_> {
    /// Puts a value of the tissue scale into a voxel of the block. The bias of the coil, which the tissue scale is free of, is that
    /// of the voxel.
    pub(super) fn put(&self, voxels: &mut [u16], in_block: [usize; 3], after: f64) {
        let Self { volume, tissue, .. } = *self;
        let rescale = volume.rescale();
        let intensity_of =
            |value: f64| f64::from(tissue.grey) + f64::from(tissue.white - tissue.grey) * value;
        let native = [0, 1, 2].map(|axis| in_block[axis] + self.block.first[axis]);
        let stored = &mut voxels[volume.grid().index(native)];
        let own = f64::from(volume.intensity(f32::from(*stored)));
        let before = f64::from(self.values[self.block.grid.index(in_block)]);
        let bias = own / intensity_of(before);
        if bias.is_finite() && bias > 0.0 {
            let intensity = bias * intensity_of(after);
            let value = (intensity - f64::from(rescale.intercept)) / f64::from(rescale.slope);
            *stored = value.round().clamp(0.0, 65535.0) as u16;
        }
    }

    /// The volume with other voxels.
    pub(super) fn volume_of(&self, voxels: Vec<u16>) -> Volume {
        let (grid, rescale) = (self.volume.grid().clone(), self.volume.rescale());
        Volume::new(grid, voxels, rescale).expect("as many voxels as before")
    }
}

/// The noise of a head, in tissue scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grain {
    /// The standard deviation.
    pub(super) deviation: f64,
    /// The correlation of two neighbours along each axis of the volume.
    pub(super) neighbours: [f64; 3],
}

impl Grain {
    /// Measures the residuals of deep white matter around its local mean.
    pub(super) fn of(block: &Block, values: &[f32], tissue: &TissueScale) -> Self {
        let [nx, ny, nz] = block.size;
        let at = |x: usize, y: usize, z: usize| values[x + nx * (y + ny * z)];
        let reach = WHITE_REACH;
        let (mut count, mut squares, mut products) = (0, 0.0, [0.0; 3]);
        let inner = |side: usize| (reach..side.saturating_sub(reach)).step_by(STRIDE);
        for (z, y) in inner(nz).flat_map(|z| inner(ny).map(move |y| (z, y))) {
            // Outside the brain, fat is as bright as white matter, and not as even.
            let is_deep = |x: usize| block.zones[x + nx * (y + ny * z)] == Zone::Deep;
            for x in inner(nx).filter(|&x| is_deep(x) && at(x, y, z) >= WHITE_FROM) {
                let mut sum = 0.0;
                let is_white = (z - reach..=z + reach).all(|z| {
                    (y - reach..=y + reach).all(|y| {
                        let row = &values[x - reach + nx * (y + ny * z)..][..2 * reach + 1];
                        sum += row.iter().map(|&value| f64::from(value)).sum::<f64>();
                        row.iter().all(|&value| value >= WHITE_FROM)
                    })
                });
                if !is_white {
                    continue;
                }
                let mean = sum / ((2 * reach + 1) as f64).powi(3);
                let off = |x, y, z| f64::from(at(x, y, z)) - mean;
                let own = off(x, y, z);
                count += 1;
                squares += own * own;
                let beside = [off(x + 1, y, z), off(x, y + 1, z), off(x, y, z + 1)];
                for (product, beside) in products.iter_mut().zip(beside) {
                    *product += own * beside;
                }
            }
        }
        if count < LEAST_SAMPLES {
            return Self {
                deviation: f64::from(tissue.noise),
                neighbours: [0.0; 3],
            };
        }
        Self {
            deviation: (squares / count as f64).sqrt(),
            neighbours: products
                .map(|product| (product / squares).clamp(-MOST_CORRELATED, MOST_CORRELATED)),
        }
    }

    /// The tap beside the middle tap of 1 of the kernel that gives white noise the correlation along an axis.
    fn tap(self, axis: usize) -> f64 {
        let wanted = self.neighbours[axis];
        if wanted.abs() < 1e-6 {
            return 0.0;
        }
        (1.0 - (1.0 - 2.0 * wanted * wanted).sqrt()) / (2.0 * wanted)
    }

    /// The correlation of voxels so far apart along an axis.
    fn correlation(self, axis: usize, apart: usize) -> f64 {
        let tap = self.tap(axis);
        let of_three = [1.0 + 2.0 * tap * tap, 2.0 * tap, tap * tap];
        of_three.get(apart).map_or(0.0, |sum| sum / of_three[0])
    }

    /// A field of such noise with a deviation of 1, x-fastest.
    pub(super) fn field(self, size: [usize; 3], random: &mut Random) -> Vec<f64> {
        let wide = size.map(|side| side + 2);
        let mut field: Vec<f64> = (0..wide.iter().product::<usize>())
            .map(|_| random.normal())
            .collect();
        let mut sides = wide;
        for axis in 0..3 {
            let tap = self.tap(axis);
            let norm = (1.0 + 2.0 * tap * tap).sqrt();
            let stride: usize = sides[..axis].iter().product();
            let mut shorter = sides;
            shorter[axis] -= 2;
            let mut filtered = Vec::with_capacity(shorter.iter().product());
            for z in 0..shorter[2] {
                for y in 0..shorter[1] {
                    for x in 0..shorter[0] {
                        let before = x + sides[0] * (y + sides[1] * z);
                        let [first, middle, last] =
                            [0, 1, 2].map(|step| field[before + step * stride]);
                        filtered.push((middle + tap * (first + last)) / norm);
                    }
                }
            }
            (field, sides) = (filtered, shorter);
        }
        field
    }
}

/// A mean over a box: the weights of the voxels to one side of the middle, the middle first, along each axis.
struct BoxMean {
    weights: [Vec<f64>; 3],
}

impl BoxMean {
    /// The box with the variance of a Gaussian of this deviation, in voxels along each axis.
    fn new(deviation: [f64; 3]) -> Self {
        let weights = deviation.map(|deviation| {
            let edge = (deviation * 12.0_f64.sqrt()).max(1.0);
            let reach = ((edge - 1.0) / 2.0).ceil() as usize;
            let covered = |place: usize| (edge / 2.0 - place as f64 + 0.5).clamp(0.0, 1.0) / edge;
            (0..=reach).map(covered).collect()
        });
        Self { weights }
    }

    fn weight(&self, axis: usize, place: i64) -> f64 {
        let weights = &self.weights[axis];
        *weights.get(place.unsigned_abs() as usize).unwrap_or(&0.0)
    }

    fn reach(&self) -> [i64; 3] {
        [0, 1, 2].map(|axis| self.weights[axis].len() as i64 - 1)
    }

    /// The variance of noise in the mean, and its covariance with the noise of the middle voxel, as shares of its variance.
    fn kept(&self, grain: Grain) -> [f64; 2] {
        let mut kept = [1.0; 2];
        for (axis, reach) in self.reach().into_iter().enumerate() {
            let apart = |a: i64, b: i64| grain.correlation(axis, (a - b).unsigned_abs() as usize);
            let with = |place: i64| -> f64 {
                let weighted = (-reach..=reach).map(|b| self.weight(axis, b) * apart(place, b));
                weighted.sum()
            };
            let all = (-reach..=reach).map(|a| self.weight(axis, a) * with(a));
            kept[0] *= all.sum::<f64>();
            kept[1] *= with(0);
        }
        kept
    }
}

/// The part of a block around a lesion.
pub(super) struct Part<'a> {
    pub(super) canvas: &'a Canvas<'a>,
    pub(super) first: [usize; 3],
    pub(super) size: [usize; 3],
}

impl<'a> Part<'a> {
    pub(super) fn around(canvas: &'a Canvas<'a>, centre: DVec3, reach_mm: f64) -> Self {
        let block = canvas.block;
        let centre = block.grid.voxel_from_patient().transform_point3(centre);
        let reach = block.in_voxels(reach_mm);
        let low = |axis: usize| (centre[axis] - reach[axis]).floor().max(0.0) as usize;
        let first = [0, 1, 2].map(low);
        let size = [0, 1, 2].map(|axis| {
            let last = (centre[axis] + reach[axis]).ceil().max(0.0) as usize;
            (last.min(block.size[axis] - 1) + 1).saturating_sub(first[axis])
        });
        Self {
            canvas,
            first,
            size,
        }
    }

    pub(super) fn voxels(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [nx, ny, nz] = self.size;
        (0..nx * ny * nz).map(move |index| [index % nx, index / nx % ny, index / nx / ny])
    }

    pub(super) fn in_block(&self, voxel: [usize; 3]) -> [usize; 3] {
        [0, 1, 2].map(|axis| voxel[axis] + self.first[axis])
    }

    pub(super) fn position(&self, voxel: [usize; 3]) -> DVec3 {
        let voxel = DVec3::from_array(self.in_block(voxel).map(|along| along as f64));
        let grid = &self.canvas.block.grid;
        grid.patient_from_voxel().transform_point3(voxel)
    }

    /// A weighted mean of some values of the block around a voxel. Beyond the block, its outermost voxels are repeated.
    fn mean(
        &self,
        voxel: [usize; 3],
        (reach, weight): ([i64; 3], impl Fn(usize, i64) -> f64),
        value: impl Fn(usize) -> f64,
    ) -> f64 {
        let block = self.canvas.block;
        let voxel = self.in_block(voxel);
        let (mut sum, mut total) = (0.0, 0.0);
        for z in -reach[2]..=reach[2] {
            for y in -reach[1]..=reach[1] {
                for x in -reach[0]..=reach[0] {
                    let off = [x, y, z];
                    let there = [0, 1, 2].map(|axis| {
                        let last = block.size[axis] as i64 - 1;
                        (voxel[axis] as i64 + off[axis]).clamp(0, last) as usize
                    });
                    let weight: f64 = (0..3).map(|axis| weight(axis, off[axis])).product();
                    sum += weight * value(block.grid.index(there));
                    total += weight;
                }
            }
        }
        sum / total
    }

    /// The tissue scale, steadied against noise.
    pub(super) fn steady(&self, voxel: [usize; 3]) -> f64 {
        let sigma = self.canvas.block.in_voxels(STEADY_MM);
        let reach = sigma.map(|sigma| (2.5 * sigma).ceil() as i64);
        let weight = |axis: usize, place: i64| (-0.5 * (place as f64 / sigma[axis]).powi(2)).exp();
        let value = |index: usize| f64::from(self.canvas.values[index]);
        self.mean(voxel, (reach, weight), value)
    }

    /// Positions of grey matter.
    fn grey(&self) -> Vec<DVec3> {
        let is_grey =
            |voxel: &[usize; 3]| (GREY[0]..GREY[1]).contains(&(self.steady(*voxel) as f32));
        let grey = self.voxels().filter(is_grey);
        grey.map(|voxel| self.position(voxel)).collect()
    }
}

/// The strength of the effect at each position.
struct Ellipsoid {
    centre: DVec3,
    axes: [DVec3; 3],
    half_axes_mm: [f64; 3],
}

impl Ellipsoid {
    fn new(lesion: &Lesion, random: &mut Random) -> Self {
        let mut drawn = || DVec3::new(random.normal(), random.normal(), random.normal());
        let first = drawn().normalize_or(DVec3::X);
        let second = first
            .cross(drawn())
            .normalize_or(first.any_orthonormal_vector());
        let [least, most] = HALF_AXES;
        let half_axes_mm =
            [0; 3].map(|_| lesion.radius_mm * (least + (most - least) * random.uniform()));
        Self {
            centre: lesion.centre_in_patient,
            axes: [first, second, first.cross(second)],
            half_axes_mm,
        }
    }

    fn share(&self, position: DVec3) -> f64 {
        let from = position - self.centre;
        let scaled: f64 = (self.axes.iter().zip(self.half_axes_mm))
            .map(|(axis, half)| (axis.dot(from) / half).powi(2))
            .sum();
        if scaled < 1e-9 {
            return 1.0;
        }
        fade(from.length() * (1.0 - 1.0 / scaled.sqrt()))
    }
}

/// The strength of the effect so far outside the edge of a lesion, in mm.
pub(super) fn fade(outside_mm: f64) -> f64 {
    let fade = (0.5 - outside_mm / FADE_MM).clamp(0.0, 1.0);
    // Smooth at both ends.
    fade * fade * (3.0 - 2.0 * fade)
}

/// How far a lesion reaches from its centre, in mm, if its edge does so.
pub(super) fn reach_mm(lesion: &Lesion, edge_mm: f64) -> f64 {
    let band_mm = |end: DVec3| end.distance(lesion.centre_in_patient) + BAND_MM[0] + PAINT_EDGE_MM;
    let edge_mm = edge_mm + FADE_MM;
    lesion
        .band_to
        .map_or(edge_mm, |end| edge_mm.max(band_mm(end)))
}

/// How much of a voxel is painted as part of the band to the ventricle.
pub(super) fn band(lesion: &Lesion, position: DVec3) -> f64 {
    let [near, far] = BAND_MM;
    let inside = |(away, share): (f64, f64)| near + (far - near) * share - away;
    let inside = lesion.beside_band(position).map(inside);
    inside.map_or(0.0, |inside| (inside / PAINT_EDGE_MM + 0.5).clamp(0.0, 1.0))
}

/// A copy of a volume with a lesion.
pub(super) fn painted(canvas: &Canvas<'_>, lesion: &Lesion) -> Volume {
    let effect = lesion.effect;
    let mut random = Random::new(lesion.seed ^ 0x5041_494E_5400);
    let ellipsoid = Ellipsoid::new(lesion, &mut random);
    let Canvas {
        volume,
        block,
        values,
        grain,
        ..
    } = *canvas;
    let reach_mm = reach_mm(lesion, lesion.radius_mm * HALF_AXES[1]);
    let part = Part::around(canvas, lesion.centre_in_patient, reach_mm);
    let noise = grain.field(part.size, &mut random);
    let grey = if effect.thickening_mm > 0.0 {
        // What is painted at the edge may lie next to grey matter beyond it.
        Part::around(
            canvas,
            lesion.centre_in_patient,
            reach_mm + effect.thickening_mm,
        )
        .grey()
    } else {
        Vec::new()
    };
    let mean = BoxMean::new(block.in_voxels(effect.blur_mm));
    let [kept, shared] = mean.kept(grain);
    let half_voxel_mm = block.spacing_mm.iter().sum::<f64>() / 6.0;
    let paint_of = |voxel: [usize; 3]| {
        let index = block.grid.index(part.in_block(voxel));
        let position = part.position(voxel);
        let share = ellipsoid.share(position);
        if share <= 0.0 || block.zones[index] < Zone::Tissue || values[index] <= 0.0 {
            return None;
        }
        let from_grey = grey
            .iter()
            .map(|grey| grey.distance_squared(position))
            .fold(f64::INFINITY, f64::min)
            .sqrt()
            - half_voxel_mm;
        let paint = (effect.thickening_mm - from_grey) / PAINT_EDGE_MM + 0.5;
        Some((index, share * paint.clamp(0.0, 1.0)))
    };
    // Paint comes first, so that the border of a thick and blurred cortex is blurred.
    let paint: HashMap<usize, f64> = if effect.thickening_mm > 0.0 {
        part.voxels().filter_map(paint_of).collect()
    } else {
        HashMap::new()
    };
    let bare = |index: usize| 1.0 - paint.get(&index).copied().unwrap_or(0.0);
    let painted = |index: usize| f64::from(values[index]) * bare(index);
    let mut voxels = volume.voxels().to_vec();
    for (voxel, noise) in part.voxels().zip(noise) {
        let in_block = part.in_block(voxel);
        let index = block.grid.index(in_block);
        let position = part.position(voxel);
        let share = ellipsoid.share(position);
        let band = band(lesion, position);
        if (share <= 0.0 && band <= 0.0) || block.zones[index] < Zone::Tissue {
            continue;
        }
        let before = f64::from(values[index]);
        let own_noise = bare(index).powi(2);
        let (mut after, mut remaining) = (painted(index), own_noise);
        if effect.blur_mm > 0.0 && share > 0.0 {
            let weight = |axis: usize, place: i64| mean.weight(axis, place);
            let of = |value: &dyn Fn(usize) -> f64| part.mean(voxel, (mean.reach(), weight), value);
            after += share * (of(&painted) - after);
            let own = 1.0 - share;
            // What paint left of the noise counts as even within the box.
            let kept = kept * of(&|index| bare(index).powi(2));
            remaining = share * share * kept + (own * own + 2.0 * own * share * shared) * own_noise;
        }
        if band > 0.0 {
            let paint = band * white_share(part.steady(voxel));
            after += paint * (BAND_VALUE - after);
            remaining *= (1.0 - paint).powi(2);
        }
        if share > 0.0 && (effect.darkening > 0.0 || effect.brightening > 0.0) {
            let steady = part.steady(voxel);
            after += share * effect.brightening * grey_share(steady);
            after -= share * effect.darkening * white_share(steady);
        }
        after += grain.deviation * (1.0 - remaining).max(0.0).sqrt() * noise;
        if after == before {
            continue;
        }
        canvas.put(&mut voxels, in_block, after);
    }
    canvas.volume_of(voxels)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::study::{Effect, Ground, Simulator};
    use analysis::testing::{Phantom, Scan, lesion, plain_grid};

    /// The correlation of neighbours along x, and the mean and deviation of some values with their voxels.
    fn moments(values: &[([usize; 3], f64)]) -> (f64, f64, [f64; 3]) {
        let mean = values.iter().map(|(_, value)| value).sum::<f64>() / values.len() as f64;
        let found: std::collections::HashMap<[usize; 3], f64> = values
            .iter()
            .map(|&(voxel, value)| (voxel, value - mean))
            .collect();
        let variance = found.values().map(|off| off * off).sum::<f64>() / found.len() as f64;
        let correlations = [0, 1, 2].map(|axis| {
            let (mut sum, mut count) = (0.0, 0);
            for (voxel, off) in &found {
                let mut beside = *voxel;
                beside[axis] += 1;
                if let Some(other) = found.get(&beside) {
                    sum += off * other;
                    count += 1;
                }
            }
            sum / f64::from(count.max(1)) / variance
        });
        (mean, variance, correlations)
    }

    pub(in crate::study) const GRAIN: Grain = Grain {
        deviation: 0.05,
        neighbours: [0.35, 0.2, 0.0],
    };

    /// A head with correlated noise.
    pub(in crate::study) fn grainy() -> Scan {
        let mut scan = Phantom::PLAIN.scan(&plain_grid());
        let noise = GRAIN.field(plain_grid().size(), &mut Random::new(7));
        let contrast = Phantom::PLAIN.contrast;
        let voxels = (scan.volume.voxels().iter().zip(noise))
            .map(|(&stored, noise)| match stored {
                0 => 0,
                _ => (f64::from(stored) + GRAIN.deviation * contrast * noise).round() as u16,
            })
            .collect();
        let rescale = scan.volume.rescale();
        scan.volume = Volume::new(plain_grid(), voxels, rescale).unwrap();
        scan
    }

    /// The tissue scale of the voxels of a volume, by the scale of a head, if they are chosen by their position and by what the
    /// head has there.
    pub(in crate::study) fn chosen(
        ground: &Ground<'_>,
        volume: &Volume,
        is_chosen: impl Fn(DVec3, f32) -> bool,
    ) -> Vec<([usize; 3], f64)> {
        let block = &ground.block;
        let mut found = Vec::new();
        for (index, &before) in ground.values.iter().enumerate() {
            let voxel = block.grid.voxel(index);
            let place = DVec3::from_array(voxel.map(|along| along as f64));
            let position = block.grid.patient_from_voxel().transform_point3(place);
            if !is_chosen(position, before) {
                continue;
            }
            let native = [0, 1, 2].map(|axis| voxel[axis] + block.first[axis]);
            let at = |volume: &Volume| {
                let stored = volume.voxels()[volume.grid().index(native)];
                f64::from(volume.intensity(f32::from(stored)))
            };
            let grey = f64::from(ground.tissue.grey);
            let contrast = f64::from(ground.tissue.white) - grey;
            let bias = at(ground.head.volume) / (grey + contrast * f64::from(before));
            found.push((voxel, (at(volume) / bias - grey) / contrast));
        }
        found
    }

    #[test]
    fn noise_has_the_wanted_deviation_and_correlation() {
        let size = [60, 60, 60];
        let field = GRAIN.field(size, &mut Random::new(3));
        let voxel = |index: usize| [index % 60, index / 60 % 60, index / 3600];
        let values: Vec<_> = (0..).map(voxel).zip(field).collect();
        let (mean, variance, correlations) = moments(&values);
        assert!(
            mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03,
            "{mean} {variance}"
        );
        for (found, wanted) in correlations.into_iter().zip(GRAIN.neighbours) {
            assert!((found - wanted).abs() < 0.02, "{correlations:?}");
        }
    }

    #[test]
    fn the_grain_of_a_head_is_measured() {
        let scan = grainy();
        let ground = Ground::new(scan.head()).unwrap();
        let found = Grain::of(&ground.block, &ground.values, &ground.tissue);
        assert!(
            (found.deviation / GRAIN.deviation - 1.0).abs() < 0.05,
            "{found:?}"
        );
        for (found, wanted) in found.neighbours.into_iter().zip(GRAIN.neighbours) {
            assert!((found - wanted).abs() < 0.05, "{found} {wanted}");
        }
    }

    #[test]
    fn a_blur_of_white_matter_keeps_its_mean_its_noise_and_their_correlation() {
        let scan = grainy();
        let ground = Ground::new(scan.head()).unwrap();
        let centre = DVec3::new(2.0, -4.0, 3.0);
        let lesion = Lesion {
            centre_in_patient: centre,
            radius_mm: 20.0,
            effect: Effect {
                blur_mm: 1.5,
                ..Effect::NONE
            },
            band_to: None,
            seed: 3,
        };
        let with = ground.simulated(&lesion, Simulator::Painted);
        let is_inside = |position: DVec3, _| position.distance(centre) < 15.0;
        let before = moments(&chosen(&ground, &scan.volume, is_inside));
        let after = moments(&chosen(&ground, &with, is_inside));
        assert!((after.0 - before.0).abs() < 0.005, "{before:?} {after:?}");
        assert!(
            (after.1 / before.1 - 1.0).abs() < 0.05,
            "{before:?} {after:?}"
        );
        for (after, before) in after.2.into_iter().zip(before.2) {
            assert!((after - before).abs() < 0.05, "{after} {before}");
        }
    }

    #[test]
    fn a_painted_thickening_is_grey_with_the_noise_of_the_head() {
        let scan = grainy();
        let ground = Ground::new(scan.head()).unwrap();
        let lesion = Lesion {
            centre_in_patient: lesion(),
            radius_mm: 22.0,
            effect: Effect {
                thickening_mm: 4.0,
                ..Effect::NONE
            },
            band_to: None,
            seed: 3,
        };
        let with = ground.simulated(&lesion, Simulator::Painted);
        let centre = lesion.centre_in_patient;
        // The junction of the phantom is 1.3 mm wide: from 2 mm below its middle on it is white.
        let below = |position: DVec3| {
            let direction = position.normalize();
            analysis::testing::on_junction(direction).length() - position.length()
        };
        let is_painted = |position: DVec3, _| {
            position.distance(centre) < 16.0 && (2.0..3.2).contains(&below(position))
        };
        let (before, after) = (
            moments(&chosen(&ground, &scan.volume, is_painted)),
            moments(&chosen(&ground, &with, is_painted)),
        );
        assert!(before.0 > 0.9, "{before:?}");
        assert!(after.0.abs() < 0.05, "{after:?}");
        let wanted = GRAIN.deviation * GRAIN.deviation;
        assert!((after.1 / wanted - 1.0).abs() < 0.1, "{after:?}");
        for (found, wanted) in after.2.into_iter().zip(GRAIN.neighbours) {
            assert!((found - wanted).abs() < 0.07, "{after:?}");
        }
        // Beyond the paint, nothing changes.
        let is_beyond = |position: DVec3, _| {
            position.distance(centre) < 16.0 && (6.0..9.0).contains(&below(position))
        };
        let [whole, kept] = [&scan.volume, &with].map(|volume| chosen(&ground, volume, is_beyond));
        assert!(whole.len() > 500 && whole == kept);
    }

    #[test]
    fn uneven_fat_outside_the_brain_is_no_noise() {
        let scan = grainy();
        let ground = Ground::new(scan.head()).unwrap();
        let brightest = scan.volume.voxels().iter().max().copied().unwrap();
        let mut voxels = scan.volume.voxels().to_vec();
        let zones = ground.block.zones.iter().enumerate();
        for (index, _) in zones.filter(|(_, zone)| **zone == Zone::Outside) {
            let voxel = ground.block.grid.voxel(index);
            let native = [0, 1, 2].map(|axis| voxel[axis] + ground.block.first[axis]);
            let uneven = (index * 7919 % 13) as u16 * (brightest / 20);
            voxels[scan.volume.grid().index(native)] = brightest + uneven;
        }
        let grid = scan.volume.grid().clone();
        let fatty = Volume::new(grid, voxels, scan.volume.rescale()).unwrap();
        let head = analysis::Head {
            volume: &fatty,
            ..scan.head()
        };
        let fatty = Ground::new(head).unwrap();
        let [before, after] = [&ground, &fatty]
            .map(|ground| Grain::of(&ground.block, &ground.values, &ground.tissue).deviation);
        assert!((after / before - 1.0).abs() < 0.02, "{before} {after}");
    }

    #[test]
    fn a_sham_changes_nothing() {
        let scan = grainy();
        let ground = Ground::new(scan.head()).unwrap();
        let sham = Lesion {
            centre_in_patient: lesion(),
            radius_mm: 6.0,
            effect: Effect::NONE,
            band_to: None,
            seed: 3,
        };
        assert_eq!(ground.simulated(&sham, Simulator::Painted), scan.volume);
    }
}
