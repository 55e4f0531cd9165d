//! Pairs of volumes with a known transform: a head, and the same head as another scan might show it.

use std::path::Path;

use geometry::{BrainMask, Envelope, Grid, Rescale, Volume, envelope};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use imaging::{Limits, nifti};

/// What the other scan is like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Same,
    Inverted,
    Gamma,
    Flair,
    Noisy,
    Thick,
    Blurred,
    Half,
    Slab,
}

impl Kind {
    pub(crate) const ALL: [Self; 9] = [
        Self::Same,
        Self::Inverted,
        Self::Gamma,
        Self::Flair,
        Self::Noisy,
        Self::Thick,
        Self::Blurred,
        Self::Half,
        Self::Slab,
    ];

    /// The error that is allowed in 95 of 100, in mm.
    pub(crate) fn limit_mm(self) -> f64 {
        match self {
            Self::Thick | Self::Blurred => 1.0,
            _ => 0.5,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Same => "same contrast",
            Self::Inverted => "inverted",
            Self::Gamma => "gamma 2.5",
            Self::Flair => "FLAIR-like",
            Self::Noisy => "FLAIR-like, noise × 4",
            Self::Thick => "FLAIR-like, 1 × 1 × 5 mm",
            Self::Blurred => "PET-like, 8 mm",
            Self::Half => "FLAIR-like, half the head",
            Self::Slab => "FLAIR-like, 60 mm of it",
        }
    }

    fn spacing_mm(self) -> DVec3 {
        match self {
            Self::Thick => DVec3::new(1.0, 1.0, 5.0),
            Self::Blurred => DVec3::splat(2.5),
            _ => DVec3::splat(1.0),
        }
    }

    /// The new intensity for a share of the range from air (0) over grey (0.55) and white (0.8) matter to fat (1 and more).
    fn contrast(self, share: f64) -> f64 {
        let knots: &[[f64; 2]] = match self {
            Self::Same => return share,
            Self::Inverted => return 1.0 - share.clamp(0.0, 1.2) / 1.2,
            Self::Gamma => return share.max(0.0).powf(2.5),
            // Fluid dark, grey above white, fat bright.
            Self::Flair | Self::Noisy | Self::Thick | Self::Half | Self::Slab => &[
                [0.0, 0.0],
                [0.1, 0.03],
                [0.3, 0.15],
                [0.55, 0.75],
                [0.8, 0.5],
                [1.2, 0.9],
                [3.0, 1.2],
            ],
            // Uptake in grey matter.
            Self::Blurred => &[
                [0.0, 0.0],
                [0.3, 0.1],
                [0.55, 1.0],
                [0.8, 0.3],
                [1.2, 0.1],
                [3.0, 0.1],
            ],
        };
        let above = knots
            .iter()
            .position(|knot| knot[0] > share)
            .unwrap_or(knots.len() - 1)
            .max(1);
        let ([x0, y0], [x1, y1]) = (knots[above - 1], knots[above]);
        (y0 + (y1 - y0) * (share - x0) / (x1 - x0)).max(0.0)
    }
}

/// Numbers that look drawn by lot, the same for the same seed.
pub(crate) struct Lot(u64);

impl Lot {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x2545_f491_4f6c_dd1d)
    }

    /// From 0 to 1.
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) as f64 / u64::MAX as f64
    }

    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.unit().max(1e-300).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    pub(crate) fn direction(&mut self) -> DVec3 {
        DVec3::new(self.normal(), self.normal(), self.normal()).normalize()
    }
}

/// A rigid motion of exactly so many degrees about the centre, and so many mm.
pub(crate) fn motion(lot: &mut Lot, centre: DVec3, degrees: f64, shift_mm: f64) -> DAffine3 {
    let turn = DQuat::from_axis_angle(lot.direction(), degrees.to_radians());
    let shift = lot.direction() * shift_mm;
    DAffine3::from_translation(centre + shift)
        * DAffine3::from_quat(turn)
        * DAffine3::from_translation(-centre)
}

/// The noise of each pair, as a share of the range of intensities.
const NOISE: f64 = 0.02;

/// A head that pairs are made of.
pub(crate) struct Head {
    pub(crate) volume: Volume,
    pub(crate) envelope: Envelope,
}

impl Head {
    /// A T1 with a mask of its brain, both NIfTI.
    pub(crate) fn read(volume: &Path, mask: &Path) -> Result<Self, Box<dyn std::error::Error>> {
        let volume = nifti::read_volume(&std::fs::read(volume)?, &Limits::default())?;
        let mask = nifti::read_mask(&std::fs::read(mask)?, &Limits::default())?;
        let envelope = envelope(&BrainMask::from_mask(&mask, volume.grid())?, 10.0)?;
        Ok(Self { volume, envelope })
    }

    /// The intensity that stands for white matter, which is 0.8 of the range.
    fn white(&self) -> f64 {
        let percentile = self.volume.percentiles_inside(&self.envelope, [0.9]);
        percentile.map_or(1.0, |[white]| f64::from(white))
    }

    fn share(&self, white: f64, place: DVec3) -> f64 {
        let voxel = self
            .volume
            .grid()
            .voxel_from_patient()
            .transform_point3(place);
        let stored = self.volume.sample(voxel.as_vec3());
        stored.map_or(0.0, |stored| {
            f64::from(self.volume.intensity(stored)) / white * 0.8
        })
    }

    pub(crate) fn centre(&self) -> DVec3 {
        let [first, last] = self
            .envelope
            .mask()
            .bounds()
            .expect("an envelope is not empty");
        let middle = [0, 1, 2].map(|axis| (first[axis] + last[axis]) as f64 / 2.0);
        self.envelope
            .grid()
            .patient_from_voxel()
            .transform_point3(DVec3::from_array(middle))
    }

    /// The head as the other scan shows it; `case_from_layer` is the truth.
    pub(crate) fn layer(&self, kind: Kind, case_from_layer: DAffine3, lot: &mut Lot) -> Volume {
        let spacing = kind.spacing_mm();
        let extent = DVec3::new(190.0, 230.0, 230.0);
        let mut size = (extent / spacing).round();
        let centre = case_from_layer.inverse().transform_point3(self.centre());
        // The voxels of the other scan lie anyhow, up to some degrees oblique.
        let axes = DMat3::from_quat(DQuat::from_axis_angle(
            lot.direction(),
            (4.0 * lot.unit()).to_radians(),
        ));
        let offset = DVec3::new(lot.unit(), lot.unit(), lot.unit());
        let mut first = offset - size / 2.0;
        if kind == Kind::Half {
            let axis = (3.0 * lot.unit()) as usize % 3;
            size[axis] = (size[axis] / 2.0).round();
            if lot.unit() < 0.5 {
                first[axis] = 0.0;
            }
        }
        if kind == Kind::Slab {
            size.z = 60.0;
            first.z = -30.0;
        }
        let axes = axes * DMat3::from_diagonal(spacing);
        let patient_from_voxel = DAffine3 {
            matrix3: axes,
            translation: centre + axes * first,
        };
        let size = size.to_array().map(|side| side as usize);
        let grid = Grid::new(size, patient_from_voxel).expect("a grid within range");
        let deviation = NOISE * if kind == Kind::Noisy { 4.0 } else { 1.0 };
        let mut values: Vec<f64> = self.clean(kind, case_from_layer, &grid, axes);
        let top = values.iter().copied().fold(0.0, f64::max);
        for value in &mut values {
            // Noise of a magnitude picture (Rice).
            let (real, imaginary) = (*value + deviation * lot.normal(), deviation * lot.normal());
            *value = real.hypot(imaginary);
        }
        let scale = 30_000.0 / top.max(1e-9);
        let voxels = values
            .iter()
            .map(|value| (value * scale).clamp(0.0, 65_535.0) as u16)
            .collect();
        Volume::new(
            grid,
            voxels,
            Rescale {
                slope: 0.1,
                intercept: 0.0,
            },
        )
        .expect("one value for each voxel")
    }

    fn clean(&self, kind: Kind, case_from_layer: DAffine3, grid: &Grid, axes: DMat3) -> Vec<f64> {
        let case_from_voxel = case_from_layer * grid.patient_from_voxel();
        let white = self.white();
        let value = |place: DVec3| kind.contrast(self.share(white, place));
        let at = |index: usize| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
            let place = case_from_voxel.transform_point3(voxel);
            if kind == Kind::Thick {
                let along = case_from_layer.matrix3 * axes.z_axis.normalize();
                return [-2.0, -1.0, 0.0, 1.0, 2.0]
                    .map(|mm| value(place + along * mm))
                    .iter()
                    .sum::<f64>()
                    / 5.0;
            }
            value(place)
        };
        let mut values: Vec<f64> = (0..grid.voxel_count()).map(at).collect();
        if kind == Kind::Blurred {
            for axis in 0..3 {
                values = blurred(
                    &values,
                    grid.size(),
                    axis,
                    8.0 / 2.3548 / grid.spacing_mm()[axis],
                );
            }
        }
        values
    }
}

/// The same voxels, placed otherwise.
pub(crate) fn placed(volume: &Volume, other_from_patient: DAffine3) -> Volume {
    let grid = volume.grid();
    let moved = Grid::new(grid.size(), other_from_patient * grid.patient_from_voxel());
    let voxels = volume.voxels().to_vec();
    Volume::new(
        moved.expect("a grid within range"),
        voxels,
        volume.rescale(),
    )
    .expect("as many voxels")
}

fn blurred(values: &[f64], size: [usize; 3], axis: usize, deviation: f64) -> Vec<f64> {
    let stride: usize = size[..axis].iter().product();
    let reach = (4.0 * deviation) as isize;
    let weights: Vec<f64> = (-reach..=reach)
        .map(|k| (-0.5 * (k as f64 / deviation).powi(2)).exp())
        .collect();
    let total: f64 = weights.iter().sum();
    let at = |index: usize| {
        let place = (index / stride % size[axis]) as isize;
        let taken = (-reach..=reach).zip(&weights).map(|(k, weight)| {
            let other = (place + k).clamp(0, size[axis] as isize - 1);
            weight * values[(index as isize + (other - place) * stride as isize) as usize]
        });
        taken.sum::<f64>() / total
    };
    (0..values.len()).map(at).collect()
}

/// How far apart two transforms place the border of the envelope, in mm: the mean and the greatest distance.
pub(crate) fn errors_mm(envelope: &Envelope, truth: DAffine3, found: DAffine3) -> [f64; 2] {
    let points = border(envelope);
    let layer_from_case = truth.inverse();
    let distance = |point: &DVec3| {
        let again = found.transform_point3(layer_from_case.transform_point3(*point));
        again.distance(*point)
    };
    let distances: Vec<f64> = points.iter().map(distance).collect();
    let mean = distances.iter().sum::<f64>() / distances.len() as f64;
    [mean, distances.into_iter().fold(0.0, f64::max)]
}

/// Every so many voxels of the envelope's border.
pub(crate) fn border(envelope: &Envelope) -> Vec<DVec3> {
    let grid = envelope.grid();
    let [nx, ny, _] = grid.size();
    let inside = envelope.mask().voxels();
    let is_border = |&index: &usize| {
        inside[index]
            && [1, nx, nx * ny]
                .iter()
                .any(|step| !inside[index - step] || !inside[index + step])
    };
    let position = |index: usize| {
        let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
        grid.patient_from_voxel().transform_point3(voxel)
    };
    (0..inside.len())
        .filter(is_border)
        .step_by(97)
        .map(position)
        .collect()
}
