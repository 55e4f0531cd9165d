//! Synthetic lesions in voxel space, which blur, thicken or darken a patch of the junction of a real scan.
//!
//! A patch is a ball with an irregular edge: its radius varies by a fifth with the direction, and its effect fades over
//! 2 mm. Inside it
//! * **blur** smooths the intensities by a Gaussian;
//! * **thickening** moves intensities along the gradient of the smoothed tissue scale, so that grey matter reaches into
//!   white;
//! * **intensity** lowers white matter, and raises grey matter.
//!
//! A transmantle band, in which white matter is darker, may lead from its centre to a ventricle.
//!
//! Smoothing and interpolation remove noise, so white Gaussian noise with the missing variance is added again. A lesion
//! without any effect is a sham: it runs through the same code.

use geometry::Volume;
use glam::DVec3;

use crate::random::Random;
use analysis::{Block, TissueScale, Zone};
use serde::{Deserialize, Serialize};

/// The variation of the radius with the direction, as a fraction.
const IRREGULARITY: f64 = 0.2;
/// The distance over which the effect fades, in mm.
const TAPER_MM: f64 = 2.0;
/// The radius of a band to the ventricle, in mm, and how much darker white matter is in it, as a fraction of the contrast.
const BAND_MM: f64 = 2.0;
const BAND_DARKENING: f64 = 0.25;
/// The Gaussian of the tissue scale for the direction in which intensities move, in mm.
const DIRECTION_MM: f64 = 1.5;

/// The effects of a lesion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Standard deviation of the Gaussian, in mm.
    pub blur_mm: f64,
    /// How far grey matter extends into white matter, in mm.
    pub thickening_mm: f64,
    /// How much darker white matter is, as a fraction of the contrast.
    pub darkening: f64,
    /// How much brighter grey matter is, as a fraction of the contrast.
    pub brightening: f64,
}

impl Effect {
    /// No effect: a sham.
    pub const NONE: Self = Self {
        blur_mm: 0.0,
        thickening_mm: 0.0,
        darkening: 0.0,
        brightening: 0.0,
    };
}

/// A synthetic lesion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lesion {
    /// The centre, LPS mm.
    pub centre_in_patient: DVec3,
    /// Mean radius, in mm.
    pub radius_mm: f64,
    /// Its effects.
    pub effect: Effect,
    /// The end of a dark band that begins at its centre, LPS mm.
    pub band_to: Option<DVec3>,
    /// The seed of its edge and its noise.
    pub seed: u64,
}

impl Lesion {
    /// The greatest distance from its centre at which it changes anything, in mm.
    pub(crate) fn reach_mm(&self) -> f64 {
        let ball = self.radius_mm * (1.0 + 2.0 * IRREGULARITY);
        let band = |end: DVec3| end.distance(self.centre_in_patient) + BAND_MM;
        self.band_to.map_or(ball, |end| ball.max(band(end))) + TAPER_MM
    }

    /// The distance of a position from the axis of the band, in mm, and the share of the way to its end; `None` without a band.
    pub(super) fn beside_band(&self, position: DVec3) -> Option<(f64, f64)> {
        let along = self.band_to? - self.centre_in_patient;
        let from = position - self.centre_in_patient;
        let share = (from.dot(along) / along.length_squared().max(1e-9)).clamp(0.0, 1.0);
        Some((from.distance(along * share), share))
    }
}

/// The share of white matter in a value of the tissue scale, from the middle between grey and white on.
pub(super) fn white_share(value: f64) -> f64 {
    (value - 0.5).clamp(0.0, 0.5) * 2.0
}

/// The share of grey matter: all below that middle, and none in fluid.
pub(super) fn grey_share(value: f64) -> f64 {
    (1.0 - value.abs()).clamp(0.0, 0.5) * 2.0
}

/// The head that receives a lesion.
pub(crate) struct Ground<'a> {
    pub(crate) volume: &'a Volume,
    pub(crate) block: &'a Block,
    /// Tissue scale of the block.
    pub(crate) values: &'a [f32],
    pub(crate) tissue: &'a TissueScale,
}

/// The strength of the effect of a lesion at each point.
struct Patch {
    centre: DVec3,
    radius_mm: f64,
    /// Three axes, along which the radius varies with one, two and three waves.
    axes: [DVec3; 3],
}

impl Patch {
    fn new(lesion: &Lesion, random: &mut Random) -> Self {
        let mut axis = || DVec3::new(random.normal(), random.normal(), random.normal()).normalize();
        Self {
            centre: lesion.centre_in_patient,
            radius_mm: lesion.radius_mm,
            axes: [axis(), axis(), axis()],
        }
    }

    fn share(&self, position: DVec3) -> f64 {
        let from_centre = position - self.centre;
        let distance = from_centre.length();
        let direction = from_centre / distance.max(1e-9);
        let [one, two, three] = self.axes.map(|axis| axis.dot(direction));
        // Legendre polynomials, each between -1 and 1.
        let waves = one + (3.0 * two * two - 1.0) / 2.0 + (5.0 * three.powi(3) - 3.0 * three) / 2.0;
        let radius = self.radius_mm * (1.0 + IRREGULARITY * waves / 1.5);
        ((radius - distance) / TAPER_MM + 0.5).clamp(0.0, 1.0)
    }
}

/// A copy of a volume with a lesion.
pub(crate) fn with_lesion(ground: &Ground<'_>, lesion: &Lesion) -> Volume {
    let mut random = Random::new(lesion.seed);
    let patch = Patch::new(lesion, &mut random);
    let Ground { volume, block, .. } = *ground;
    let grid = volume.grid();
    let mut voxels = volume.voxels().to_vec();
    let rescale = volume.rescale();
    let contrast = f64::from(ground.tissue.white - ground.tissue.grey);
    let noise = f64::from(ground.tissue.noise) * contrast;
    let sampler = Sampler { volume };
    for voxel in around(block, lesion) {
        let index_in_block = block.grid.index(voxel);
        if block.zones[index_in_block] != Zone::Deep {
            continue;
        }
        let native = [0, 1, 2].map(|axis| voxel[axis] + block.first[axis]);
        let place = DVec3::from_array(native.map(|along| along as f64));
        let position = grid.patient_from_voxel().transform_point3(place);
        let share = patch.share(position);
        let band = lesion.beside_band(position).map_or(0.0, |(away, _)| {
            ((BAND_MM - away) / TAPER_MM + 0.5).clamp(0.0, 1.0)
        });
        if share <= 0.0 && band <= 0.0 {
            continue;
        }
        let mut from = place;
        if lesion.effect.thickening_mm > 0.0 {
            let towards_white = direction(block, ground.values, voxel);
            let back = -towards_white * (lesion.effect.thickening_mm * share);
            from = grid.voxel_from_patient().transform_point3(position + back);
        }
        let (moved, kept) = sampler.at(from);
        let (blurred, kept) = if lesion.effect.blur_mm > 0.0 && share > 0.0 {
            let sigma = block.in_voxels(lesion.effect.blur_mm);
            let smoothed = sampler.smoothed(from, sigma);
            let mixed = moved * (1.0 - share) + smoothed.intensity * share;
            (mixed, smoothed.kept_in_mixture(kept, share))
        } else {
            (moved, kept)
        };
        let own = f64::from(ground.values[index_in_block]);
        let darker = (lesion.effect.darkening * share).max(BAND_DARKENING * band);
        let brighter = lesion.effect.brightening * share;
        let changed = brighter * grey_share(own) - darker * white_share(own);
        let missing = (1.0 - kept).max(0.0).sqrt();
        let intensity = blurred + changed * contrast + noise * missing * random.normal();
        let stored = (intensity - f64::from(rescale.intercept)) / f64::from(rescale.slope);
        voxels[grid.index(native)] = stored.round().clamp(0.0, 65535.0) as u16;
    }
    Volume::new(grid.clone(), voxels, rescale).expect("as many voxels as before")
}

/// A smoothed intensity.
struct Smoothed {
    intensity: f64,
    /// The remaining fraction of the variance of the noise.
    kept: f64,
    /// The weight of the central voxel.
    own_weight: f64,
}

impl Smoothed {
    /// The remaining fraction of the variance of the noise in a mixture with the central voxel.
    fn kept_in_mixture(&self, own: f64, share: f64) -> f64 {
        let (a, b) = (1.0 - share, share);
        a * a * own + b * b * self.kept + 2.0 * a * b * self.own_weight * own
    }
}

/// The voxels of a block that a lesion can reach.
fn around(block: &Block, lesion: &Lesion) -> impl Iterator<Item = [usize; 3]> + use<> {
    let centre = block
        .grid
        .voxel_from_patient()
        .transform_point3(lesion.centre_in_patient);
    let reach = block.in_voxels(lesion.reach_mm());
    let range = |axis: usize| {
        let low = (centre[axis] - reach[axis]).floor().max(0.0) as usize;
        let high = (centre[axis] + reach[axis]).ceil().max(0.0) as usize;
        low..=high.min(block.size[axis] - 1)
    };
    let [x, y, z] = [range(0), range(1), range(2)];
    z.flat_map(move |z| {
        let x = x.clone();
        y.clone()
            .flat_map(move |y| x.clone().map(move |x| [x, y, z]))
    })
}

/// The unit vector towards white matter in patient space; 0 if there is no gradient.
pub(super) fn direction(block: &Block, values: &[f32], voxel: [usize; 3]) -> DVec3 {
    let sigma = block.in_voxels(DIRECTION_MM);
    let reach = sigma.map(|sigma| (2.0 * sigma).ceil() as i64);
    let mut slope = DVec3::ZERO;
    for_cube(reach, |offset| {
        let there = [0, 1, 2].map(|axis| {
            (voxel[axis] as i64 + offset[axis]).clamp(0, block.size[axis] as i64 - 1) as usize
        });
        let scaled = [0, 1, 2].map(|axis| offset[axis] as f64 / sigma[axis]);
        let squared: f64 = scaled.iter().map(|along| along * along).sum();
        let value = f64::from(values[block.grid.index(there)].clamp(-0.5, 1.5));
        let along = DVec3::from_array([0, 1, 2].map(|axis| scaled[axis] / sigma[axis]));
        slope += along * (value * (-0.5 * squared).exp());
    });
    // The inverse transpose converts a gradient per voxel to one per mm.
    let axes = block.grid.patient_from_voxel().matrix3;
    (axes.inverse().transpose() * slope).normalize_or_zero()
}

fn for_cube(reach: [i64; 3], mut visit: impl FnMut([i64; 3])) {
    let [x, y, z] = reach.map(|reach| -reach..=reach);
    for z in z {
        for y in y.clone() {
            for x in x.clone() {
                visit([x, y, z]);
            }
        }
    }
}

/// Intensities between voxels, and the remaining fraction of the variance of the noise.
pub(super) struct Sampler<'a> {
    pub(super) volume: &'a Volume,
}

impl Sampler<'_> {
    fn intensity(&self, voxel: [i64; 3]) -> f64 {
        let size = self.volume.grid().size();
        let voxel = [0, 1, 2].map(|axis| voxel[axis].clamp(0, size[axis] as i64 - 1) as usize);
        let stored = self.volume.voxels()[self.volume.grid().index(voxel)];
        f64::from(self.volume.intensity(f32::from(stored)))
    }

    /// The Catmull–Rom cubic, which blurs less than linear interpolation.
    pub(super) fn at(&self, place: DVec3) -> (f64, f64) {
        let base = place.floor();
        let weights = (place - base).to_array().map(|part| {
            let (squared, cubed) = (part * part, part * part * part);
            [
                -0.5 * part + squared - 0.5 * cubed,
                1.0 - 2.5 * squared + 1.5 * cubed,
                0.5 * part + 2.0 * squared - 1.5 * cubed,
                -0.5 * squared + 0.5 * cubed,
            ]
        });
        let base = base.to_array().map(|along| along as i64 - 1);
        let (mut sum, mut kept) = (0.0, 0.0);
        for number in 0..64usize {
            let step = [number % 4, number / 4 % 4, number / 16];
            let weight: f64 = (0..3).map(|axis| weights[axis][step[axis]]).product();
            sum += weight * self.intensity([0, 1, 2].map(|axis| base[axis] + step[axis] as i64));
            kept += weight * weight;
        }
        (sum, kept)
    }

    fn smoothed(&self, place: DVec3, sigma: [f64; 3]) -> Smoothed {
        let middle = place.round();
        let part = place - middle;
        let reach = sigma.map(|sigma| (3.3 * sigma).ceil() as i64);
        let (mut sum, mut total, mut squares, mut own) = (0.0, 0.0, 0.0, 0.0);
        let middle = middle.to_array().map(|along| along as i64);
        for_cube(reach, |offset| {
            let squared: f64 = (0..3)
                .map(|axis| ((offset[axis] as f64 - part[axis]) / sigma[axis]).powi(2))
                .sum();
            let weight = (-0.5 * squared).exp();
            let intensity = self.intensity([0, 1, 2].map(|axis| middle[axis] + offset[axis]));
            sum += weight * intensity;
            total += weight;
            squares += weight * weight;
            if offset == [0; 3] {
                own = weight;
            }
        });
        Smoothed {
            intensity: sum / total,
            kept: squares / (total * total),
            own_weight: own / total,
        }
    }
}
