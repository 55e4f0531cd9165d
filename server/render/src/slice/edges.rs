//! The edges of a layer on a slice: the twin of `shaders/edges.wgsl`.

use crate::layer::{LayerSampler, OverlayRamp};
use crate::rays::Rays;
use crate::{Overlay, Projection};

/// The colour of an edge.
pub(crate) const COLOR: [u8; 3] = [255, 70, 200];

/// Slopes from which an edge begins to show and from which it shows in full, in numbers of the layer's 255 colours per
/// mm.
pub(crate) const LEAST_RISE: f32 = 10.0;
pub(crate) const FULL_RISE: f32 = 20.0;

/// Half the width of an edge, in pixels; half a pixel more fades out.
pub(crate) const HALF_WIDTH: f32 = 0.6;

/// The distance over which a slope is measured to either side, in mm and in voxels of the layer, whichever is more.
pub(crate) const RISE_REACH: f32 = 0.75;

/// Draws lines where the values of a layer rise steepest.
pub(super) struct Edges<'a> {
    layer: LayerSampler<'a>,
    rays: Rays,
    ramp: OverlayRamp,
    mm_per_pixel: f32,
    reach: f32,
}

/// How steep a layer is at a place of the picture.
struct Rise {
    /// In colours per pixel, to the right and down.
    slope: [f32; 2],
    /// The least defined fraction of the places it was measured at.
    defined: f32,
}

impl Rise {
    fn length(&self) -> f32 {
        let [right, down] = self.slope;
        (right * right + down * down).sqrt()
    }
}

impl<'a> Edges<'a> {
    /// The edges of an overlay for the pixels of `projection`. Of its style, only the window matters.
    pub(super) fn new(overlay: Overlay<'a>, projection: &Projection) -> Self {
        let rays = Rays::through_voxels(projection, overlay.layer.voxel_from_case(), 1.0);
        let mm_per_pixel = projection.mm_per_pixel() as f32;
        let length = |[x, y, z]: [f32; 3]| (x * x + y * y + z * z).sqrt();
        let voxels_per_pixel = length(rays.per_pixel_right()).min(length(rays.per_pixel_down()));
        Self {
            layer: overlay.layer.sampler(),
            rays,
            ramp: overlay.style.ramp(),
            mm_per_pixel,
            reach: (RISE_REACH / mm_per_pixel.min(voxels_per_pixel)).max(1.0),
        }
    }

    /// The number of the layer's colour at a place, and the defined fraction.
    fn level(&self, x: f32, y: f32) -> [f32; 2] {
        let [value, defined] = self.layer.at(self.rays.place_on_slice(x, y));
        [self.ramp.level(value), defined]
    }

    fn rise(&self, [x, y]: [f32; 2]) -> Rise {
        let reach = self.reach;
        let [right, left] = [self.level(x + reach, y), self.level(x - reach, y)];
        let [under, above] = [self.level(x, y + reach), self.level(x, y - reach)];
        let slope = [right[0] - left[0], under[0] - above[0]];
        Rise {
            slope: slope.map(|rise| rise / (2.0 * reach)),
            defined: right[1].min(left[1]).min(under[1]).min(above[1]),
        }
    }

    /// A colour at a place of the picture, in pixels, with the edges over it: levels of 0 to 255.
    ///
    /// The slope is measured at the place and to either side along its own direction; the line is where a parabola
    /// through the three has its peak.
    pub(super) fn over(&self, color: [u8; 3], [x, y]: [f32; 2]) -> [f32; 3] {
        let share = self.share([x, y]);
        std::array::from_fn(|channel| {
            let [below, above] = [color[channel], COLOR[channel]].map(f32::from);
            below + share * (above - below)
        })
    }

    /// How much of a pixel an edge covers, 0 to 1.
    fn share(&self, [x, y]: [f32; 2]) -> f32 {
        let rise = self.rise([x, y]);
        let here = rise.length();
        if here <= LEAST_RISE * self.mm_per_pixel || rise.defined <= 0.5 {
            return 0.0;
        }
        let [right, down] = rise.slope.map(|slope| slope / here * self.reach);
        let before = self.rise([x - right, y - down]).length();
        let after = self.rise([x + right, y + down]).length();
        let bend = 2.0 * here - before - after;
        if bend <= 0.0 {
            return 0.0;
        }
        let distance = (0.5 * (after - before) / bend).abs() * self.reach;
        let cover = (HALF_WIDTH + 0.5 - distance).clamp(0.0, 1.0);
        let part = (here / self.mm_per_pixel - LEAST_RISE) / (FULL_RISE - LEAST_RISE);
        let part = part.clamp(0.0, 1.0);
        cover * (part * part * (3.0 - 2.0 * part))
    }
}
