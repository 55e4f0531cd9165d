//! From a point of the surface to the bytes of its pixel.

use geometry::Volume;
use glam::DVec3;

use crate::rays::{Rays, single};
use crate::sampler::Sampler;
use crate::splat::Surface;
use crate::window::WindowLine;
use crate::{Background, Light, PixelFormat, Projection, RenderParameters, RenderRequest};

/// The most samples to either side of the isosurface that a slab is averaged over.
const MAX_SLAB_SAMPLES: f64 = 64.0;

/// Intensity, window, colour map and light.
#[derive(Debug)]
pub(crate) struct Shade<'a> {
    volume: Sampler<'a, u16>,
    rays: Rays,
    window: WindowLine,
    colors: [[u8; 3]; 256],
    light: Light,
    format: PixelFormat,
    slab: Option<Slab>,
}

/// Where a slab is sampled: offsets along the depth, in mm, and native voxels per mm along L, P and S.
#[derive(Debug)]
struct Slab {
    offsets_mm: Vec<f32>,
    voxels_per_mm: [[f32; 3]; 3],
}

impl Slab {
    fn new(slab_mm: f64, depth_mm: f64, volume: &Volume) -> Option<Self> {
        let offsets_mm = slab_offsets(slab_mm, depth_mm, volume);
        let voxel_from_patient = volume.grid().voxel_from_patient().matrix3;
        (!offsets_mm.is_empty()).then(|| Self {
            offsets_mm,
            voxels_per_mm: DVec3::AXES.map(|axis| single(voxel_from_patient * axis)),
        })
    }
}

/// Where a slab is sampled along the depth, in mm from the isosurface, at equal distances; nowhere when there is no slab.
///
/// Over ±`slab_mm`, at most half a native voxel apart, none beyond the envelope.
pub(crate) fn slab_offsets(slab_mm: f64, depth_mm: f64, volume: &Volume) -> Vec<f32> {
    if slab_mm == 0.0 {
        return Vec::new();
    }
    let spacing_mm = volume
        .grid()
        .spacing_mm()
        .into_iter()
        .fold(f64::MAX, f64::min);
    let side = (2.0 * slab_mm / spacing_mm)
        .ceil()
        .clamp(1.0, MAX_SLAB_SAMPLES);
    (-(side as i32)..=side as i32)
        .map(|step| f64::from(step) * slab_mm / side)
        .filter(|offset_mm| depth_mm + offset_mm >= 0.0)
        .map(|offset_mm| offset_mm as f32)
        .collect()
}

/// The format of a picture: grey as grey, alpha where the background is transparent.
pub(crate) fn pixel_format(parameters: &RenderParameters) -> PixelFormat {
    match (parameters.colormap.is_grey(), parameters.background) {
        (true, Background::Black) => PixelFormat::Grey8,
        (true, Background::Transparent) => PixelFormat::GreyAlpha8,
        (false, Background::Black) => PixelFormat::Rgb8,
        (false, Background::Transparent) => PixelFormat::Rgba8,
    }
}

impl<'a> Shade<'a> {
    /// Shading for the pixels of a picture; surface heights are in units of `unit_mm`.
    pub(crate) fn new(
        volume: &'a Volume,
        projection: &Projection,
        request: &RenderRequest,
        unit_mm: f64,
    ) -> Self {
        let parameters = request.parameters();
        Self {
            volume: Sampler::new(volume.voxels(), volume.grid().size()),
            rays: Rays::new(projection, volume.grid(), unit_mm),
            window: parameters.window.line(volume.rescale()),
            colors: parameters.colormap.table(),
            light: parameters.light,
            format: pixel_format(parameters),
            slab: Slab::new(parameters.slab_mm, parameters.depth_mm, volume),
        }
    }

    /// What the bytes of a pixel mean.
    pub(crate) fn format(&self) -> PixelFormat {
        self.format
    }

    /// Fills a row of pixels, all 0 before.
    pub(crate) fn row(&self, surface: &Surface<'_>, row: usize, pixels: &mut [u8]) {
        match self.format {
            PixelFormat::Grey8 => self.row_as(surface, row, pixels, |[grey, ..]| [grey]),
            PixelFormat::GreyAlpha8 => self.row_as(surface, row, pixels, |[grey, ..]| [grey, 255]),
            PixelFormat::Rgb8 => self.row_as(surface, row, pixels, |color| color),
            PixelFormat::Rgba8 => {
                self.row_as(surface, row, pixels, |[red, green, blue]| {
                    [red, green, blue, 255]
                });
            }
        }
    }

    #[inline]
    fn row_as<const BYTES: usize>(
        &self,
        surface: &Surface<'_>,
        row: usize,
        pixels: &mut [u8],
        encode: impl Fn([u8; 3]) -> [u8; BYTES],
    ) {
        let (pixels, _) = pixels.as_chunks_mut::<BYTES>();
        surface.row(row, pixels.len(), |column, point| {
            let position = self
                .rays
                .through(column as f32 + 0.5, row as f32 + 0.5)
                .at(point.height);
            if let Some(stored) = self.stored(position, point.inward) {
                pixels[column] = encode(self.color(stored, point.facing));
            }
        });
    }

    /// The stored value at a surface point, or its mean over the slab; `None` outside of the volume.
    #[inline]
    fn stored(&self, position: [f32; 3], inward: [f32; 3]) -> Option<f32> {
        match &self.slab {
            None => self
                .volume
                .contains(position)
                .then(|| self.volume.at(position)),
            Some(slab) => self.slab_mean(slab, position, inward),
        }
    }

    fn slab_mean(&self, slab: &Slab, position: [f32; 3], inward: [f32; 3]) -> Option<f32> {
        let [x, y, z] = inward;
        let length = (x * x + y * y + z * z).sqrt().max(1e-6);
        let [along_x, along_y, along_z] = slab.voxels_per_mm;
        let per_mm: [f32; 3] = std::array::from_fn(|axis| {
            (x * along_x[axis] + y * along_y[axis] + z * along_z[axis]) / length
        });
        let mut sum = 0.0;
        let mut count = 0.0;
        for offset_mm in &slab.offsets_mm {
            let sample = std::array::from_fn(|axis| position[axis] + offset_mm * per_mm[axis]);
            if self.volume.contains(sample) {
                sum += self.volume.at(sample);
                count += 1.0;
            }
        }
        (count > 0.0).then(|| sum / count)
    }

    #[inline]
    fn color(&self, stored: f32, facing: f32) -> [u8; 3] {
        let brightness = self.window.brightness(stored);
        let light = self.light.on(facing);
        let color = self.colors[(brightness + 0.5) as u8 as usize];
        color.map(|share| (f32::from(share) * light + 0.5) as u8)
    }
}
