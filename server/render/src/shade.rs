//! Computes the bytes of a pixel from its point of the surface.

use geometry::{Rescale, Volume};
use glam::{DAffine3, DVec3};
use multiversion::multiversion;

use crate::layer::{LayerSampler, OverlayRamp};
use crate::points::PointRow;
use crate::rays::{Rays, View, single};
use crate::sampler::{Sampler, trilinear, whole};
use crate::window::WindowLine;
use crate::{
    Background, Layers, Look, Overlay, PixelFormat, RenderParameters, RenderRequest, Scene,
};

/// The most samples to either side of the isosurface that a slab is averaged over.
const MAX_SLAB_SAMPLES: f64 = 64.0;

/// Pixels that are shaded at once.
const LANES: usize = 32;

/// Intensity, window, colour map and light.
#[derive(Debug)]
pub(crate) struct Shade<'a> {
    texture: Texture<'a>,
    rays: Rays,
    window: WindowLine,
    colors: [[u8; 3]; 256],
    overlay: Option<OverlayPaint<'a>>,
    look: Look,
    format: PixelFormat,
    slab: Option<Slab>,
}

/// The source of the brightness of a surface: the intensities of the case or a layer.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Texture<'a> {
    Volume(Sampler<'a, u16>),
    Layer(LayerSampler<'a>),
}

impl<'a> Texture<'a> {
    pub(crate) fn of(scene: &Scene<'a>) -> Self {
        match scene.layers.base {
            Some(layer) => Self::Layer(layer.sampler()),
            None => Self::of_volume(scene.volume),
        }
    }

    pub(crate) fn of_volume(volume: &'a Volume) -> Self {
        Self::Volume(Sampler::new(volume.voxels(), volume.grid().size()))
    }

    /// The value at a position in voxel coordinates; `None` if outside or undefined.
    #[inline]
    pub(crate) fn at(&self, position: [f32; 3]) -> Option<f32> {
        match self {
            Self::Volume(volume) => volume.value_at(position),
            Self::Layer(layer) => layer.value_at(position),
        }
    }
}

/// The transform from the voxels of a scene's texture to the patient.
pub(crate) fn texture_from_patient(scene: &Scene<'_>) -> DAffine3 {
    match scene.layers.base {
        Some(layer) => layer.voxel_from_case(),
        None => scene.volume.grid().voxel_from_patient(),
    }
}

/// The window for the stored values of a scene's texture.
pub(crate) fn texture_rescale(scene: &Scene<'_>) -> Rescale {
    match scene.layers.base {
        Some(_) => Rescale {
            slope: 1.0,
            intercept: 0.0,
        },
        None => scene.volume.rescale(),
    }
}

/// Blends the colours of a layer over a texture.
#[derive(Debug)]
pub(crate) struct OverlayPaint<'a> {
    layer: LayerSampler<'a>,
    rays: Rays,
    ramp: OverlayRamp,
    colors: [[u8; 3]; 256],
}

impl<'a> OverlayPaint<'a> {
    /// For the pixels of a picture; heights are in units of `unit_mm`.
    pub(crate) fn new(overlay: Overlay<'a>, view: impl Into<View>, unit_mm: f64) -> Self {
        let from_case = overlay.layer.voxel_from_case();
        Self {
            layer: overlay.layer.sampler(),
            rays: Rays::through_voxels(view, from_case, unit_mm),
            ramp: overlay.style.ramp(),
            colors: overlay.style.parameters().colormap.table(),
        }
    }

    /// A colour at a height above a place of the picture, in pixels, with the overlay above it: levels of 0 to 255.
    #[inline]
    pub(crate) fn over(&self, color: [u8; 3], [x, y]: [f32; 2], height: f32) -> [f32; 3] {
        let [value, defined] = self.layer.at(self.rays.through(x, y).at(height));
        let share = defined * self.ramp.share(value);
        let above = self.colors[usize::from(nearest(self.ramp.level(value)))];
        std::array::from_fn(|channel| {
            let [below, above] = [color[channel], above[channel]].map(f32::from);
            below + share * (above - below)
        })
    }
}

/// Where a slab is sampled: offsets along the depth, in mm, and native voxels per mm along L, P and S.
#[derive(Debug)]
struct Slab {
    offsets_mm: Vec<f32>,
    voxels_per_mm: [[f32; 3]; 3],
}

impl Slab {
    fn new(parameters: &RenderParameters, scene: &Scene<'_>) -> Option<Self> {
        let offsets_mm = slab_offsets(parameters.look.slab_mm, parameters.depth_mm, scene.volume);
        let voxel_from_patient = texture_from_patient(scene).matrix3;
        (!offsets_mm.is_empty()).then(|| Self {
            offsets_mm,
            voxels_per_mm: DVec3::AXES.map(|axis| single(voxel_from_patient * axis)),
        })
    }
}

/// Where a slab is sampled along the depth, in mm from the isosurface, at equal distances; empty without a slab.
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
pub(crate) fn pixel_format(parameters: &RenderParameters, layers: &Layers<'_>) -> PixelFormat {
    let is_grey = parameters.look.colormap.is_grey() && layers.overlay.is_none();
    match (is_grey, parameters.look.background) {
        (true, Background::Black) => PixelFormat::Grey8,
        (true, Background::Transparent) => PixelFormat::GreyAlpha8,
        (false, Background::Black) => PixelFormat::Rgb8,
        (false, Background::Transparent) => PixelFormat::Rgba8,
    }
}

impl<'a> Shade<'a> {
    /// Shading for the pixels of a picture; surface heights are in units of `unit_mm`.
    pub(crate) fn new(
        scene: &Scene<'a>,
        view: View,
        request: &RenderRequest,
        unit_mm: f64,
    ) -> Self {
        let parameters = request.parameters();
        Self {
            texture: Texture::of(scene),
            rays: Rays::through_voxels(view, texture_from_patient(scene), unit_mm),
            window: parameters.window.line(texture_rescale(scene)),
            colors: parameters.look.colormap.table(),
            overlay: scene
                .layers
                .overlay
                .map(|overlay| OverlayPaint::new(overlay, view, unit_mm)),
            look: parameters.look,
            format: pixel_format(parameters, &scene.layers),
            slab: Slab::new(parameters, scene),
        }
    }

    /// The format of a pixel.
    pub(crate) fn format(&self) -> PixelFormat {
        self.format
    }

    /// Whether directions into the brain are needed.
    pub(crate) fn asks_for_inward(&self) -> bool {
        self.slab.is_some()
    }

    /// Fills a row of pixels, all 0 before.
    pub(crate) fn row(&self, row: usize, points: &PointRow, pixels: &mut [u8]) {
        match self.format {
            PixelFormat::Grey8 => self.row_as(row, points, pixels, |[grey, ..]| [grey]),
            PixelFormat::GreyAlpha8 => self.row_as(row, points, pixels, |[grey, ..]| [grey, 255]),
            PixelFormat::Rgb8 => self.row_as(row, points, pixels, |color| color),
            PixelFormat::Rgba8 => {
                self.row_as(row, points, pixels, |[red, green, blue]| {
                    [red, green, blue, 255]
                });
            }
        }
        self.soften(points, pixels);
    }

    /// Mixes pixels that the surface covers in part with the background.
    fn soften(&self, points: &PointRow, pixels: &mut [u8]) {
        let first = match self.format {
            PixelFormat::Grey8 | PixelFormat::Rgb8 => 0,
            PixelFormat::GreyAlpha8 => 1,
            PixelFormat::Rgba8 => 3,
        };
        let pixels = pixels.chunks_exact_mut(self.format.bytes_per_pixel());
        for (pixel, &coverage) in pixels.zip(&points.coverage) {
            if coverage < 1.0 {
                for level in &mut pixel[first..] {
                    *level = nearest(f32::from(*level) * coverage);
                }
            }
        }
    }

    fn row_as<const BYTES: usize>(
        &self,
        row: usize,
        points: &PointRow,
        pixels: &mut [u8],
        encode: impl Fn([u8; 3]) -> [u8; BYTES],
    ) {
        let (pixels, _) = pixels.as_chunks_mut::<BYTES>();
        let mut block = Block::default();
        for (index, pixels) in pixels.chunks_mut(LANES).enumerate() {
            let first = index * LANES;
            let columns = first..first + pixels.len();
            if points.heights[columns.clone()]
                .iter()
                .all(|&height| height == f32::NEG_INFINITY)
            {
                continue;
            }
            block.heights[..pixels.len()].copy_from_slice(&points.heights[columns.clone()]);
            block.heights[pixels.len()..].fill(f32::NEG_INFINITY);
            block.facing[..pixels.len()].copy_from_slice(&points.facing[columns]);
            match (&self.slab, &self.texture) {
                (None, Texture::Volume(volume)) => block.sample(volume, &self.rays, [first, row]),
                (None, Texture::Layer(_)) => {
                    self.sample_each(&mut block, [first, row], |_, position| {
                        self.texture.at(position)
                    });
                }
                (Some(slab), _) => {
                    self.sample_each(&mut block, [first, row], |column, position| {
                        self.slab_mean(slab, position, points.inward[column])
                    });
                }
            }
            block.finish(self.window, self.look);
            for (lane, pixel) in pixels.iter_mut().enumerate() {
                if block.inside[lane] {
                    let color = self.colors[usize::from(block.levels[lane])];
                    let color = match &self.overlay {
                        None => color.map(f32::from),
                        Some(overlay) => {
                            let place = [(first + lane) as f32 + 0.5, row as f32 + 0.5];
                            overlay.over(color, place, block.heights[lane])
                        }
                    };
                    *pixel = encode(color.map(|level| nearest(level * block.lights[lane])));
                }
            }
        }
    }

    /// The values at a block of pixels, each from its column and its position in voxel coordinates.
    fn sample_each(
        &self,
        block: &mut Block,
        [first, row]: [usize; 2],
        value: impl Fn(usize, [f32; 3]) -> Option<f32>,
    ) {
        for lane in 0..LANES {
            let column = first + lane;
            let height = block.heights[lane];
            let ray = self.rays.through(column as f32 + 0.5, row as f32 + 0.5);
            let found = (height > f32::NEG_INFINITY)
                .then(|| value(column, ray.at(height)))
                .flatten();
            block.inside[lane] = found.is_some();
            block.stored[lane] = found.unwrap_or_default();
        }
    }

    /// The mean over the slab about a surface point; `None` outside the volume.
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
            if let Some(value) = self.texture.at(sample) {
                sum += value;
                count += 1.0;
            }
        }
        (count > 0.0).then(|| sum / count)
    }
}

/// The nearest whole number to a level of 0 to 255.
#[inline(always)]
pub(crate) fn nearest(level: f32) -> u8 {
    // In one instruction, where a checked conversion takes five.
    whole(level + 0.5) as u8
}

/// Pixels that are shaded together, step by step, so that the compiler makes vectors of them.
#[derive(Debug)]
struct Block {
    heights: [f32; LANES],
    facing: [f32; LANES],
    /// Whether there is a point inside of the volume.
    inside: [bool; LANES],
    stored: [f32; LANES],
    levels: [u8; LANES],
    lights: [f32; LANES],
}

impl Default for Block {
    fn default() -> Self {
        Self {
            heights: [f32::NEG_INFINITY; LANES],
            facing: [0.0; LANES],
            inside: [false; LANES],
            stored: [0.0; LANES],
            levels: [0; LANES],
            lights: [0.0; LANES],
        }
    }
}

impl Block {
    /// The stored values at the points of a row, from column `first` on.
    fn sample(&mut self, volume: &Sampler<'_, u16>, rays: &Rays, [first, row]: [usize; 2]) {
        let mut cells = [0; LANES];
        let mut places = [[0.0; LANES]; 3];
        let from = [first as f32 + 0.5, row as f32 + 0.5];
        find_cells(volume, rays, from, self, &mut cells, &mut places);
        let mut corners = [[0.0; LANES]; 8];
        for (lane, &cell) in cells.iter().enumerate() {
            if self.inside[lane] {
                let [a, b, c, d, e, f, g, h] = volume.corners(cell);
                corners[0][lane] = a;
                corners[1][lane] = b;
                corners[2][lane] = c;
                corners[3][lane] = d;
                corners[4][lane] = e;
                corners[5][lane] = f;
                corners[6][lane] = g;
                corners[7][lane] = h;
            }
        }
        interpolate(&corners, &places, &mut self.stored);
    }

    /// Brightness and light from stored values and facing.
    fn finish(&mut self, window: WindowLine, look: Look) {
        finish(
            &self.stored,
            &self.facing,
            window,
            look,
            &mut self.levels,
            &mut self.lights,
        );
    }
}

/// For each pixel of a block the cell that its point lies in, the place in it, and whether it is in the volume.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn find_cells(
    volume: &Sampler<'_, u16>,
    rays: &Rays,
    [x, y]: [f32; 2],
    block: &mut Block,
    cells: &mut [u32; LANES],
    places: &mut [[f32; LANES]; 3],
) {
    let [along_x, along_y, along_z] = places;
    for lane in 0..LANES {
        let ray = rays.through(x + lane as u32 as i32 as f32, y);
        let position = ray.at(block.heights[lane]);
        block.inside[lane] = volume.contains(position);
        let (cell, place) = volume.cell(position);
        cells[lane] = cell;
        [along_x[lane], along_y[lane], along_z[lane]] = place;
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn interpolate(corners: &[[f32; LANES]; 8], places: &[[f32; LANES]; 3], stored: &mut [f32; LANES]) {
    let [a, b, c, d, e, f, g, h] = corners;
    for lane in 0..LANES {
        let corners = [
            a[lane], b[lane], c[lane], d[lane], e[lane], f[lane], g[lane], h[lane],
        ];
        stored[lane] = trilinear(corners, [places[0][lane], places[1][lane], places[2][lane]]);
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn finish(
    stored: &[f32; LANES],
    facing: &[f32; LANES],
    window: WindowLine,
    look: Look,
    levels: &mut [u8; LANES],
    lights: &mut [f32; LANES],
) {
    for lane in 0..LANES {
        levels[lane] = nearest(window.brightness(stored[lane]));
        lights[lane] = look.light_on(facing[lane]);
    }
}
