//! The part of a picture that has anything to draw.

use glam::{DVec2, DVec3};

use super::GpuSurface;
use super::job::Call;
use crate::{FrameSize, MAP_MARGIN};

/// How far the isosurface may lie outside the bounding ball shrunk by its depth, in working voxels: see `uniforms`.
const BALL_MARGIN: f64 = 4.0;

/// The margin around the drawn pixels, in pixels.
const MARGIN: f64 = 2.0;

/// A block of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Block {
    pub(super) corner: [u32; 2],
    pub(super) size: [u32; 2],
}

impl Block {
    /// The pixels that a picture may cover: those around its vertices, or around the ball that contains its isosurface.
    pub(super) fn around(call: &Call<'_>) -> Self {
        if let Some(map) = call.request.map_projection() {
            let centre = DVec2::from_array(map.centre());
            let radius = MAP_MARGIN * map.pixels_per_unit();
            return Self::between(centre - radius, centre + radius, map.size());
        }
        let projection = call.request.projection(&call.scene);
        let frame_from_patient = projection.frame_from_patient();
        let place = |position: DVec3| frame_from_patient.transform_point3(position).truncate();
        let size = projection.size();
        match call.surface {
            GpuSurface::Mesh { mesh, .. } => {
                let positions = mesh.positions_in_patient.iter();
                let places = positions.map(|position| place(DVec3::from(position.map(f64::from))));
                let none = [DVec2::INFINITY, DVec2::NEG_INFINITY];
                let [low, high] = places.fold(none, |[low, high], at| [low.min(at), high.max(at)]);
                Self::between(low, high, size)
            }
            GpuSurface::Trace => {
                let margin_mm = BALL_MARGIN * call.scene.field.grid().spacing_mm()[0];
                let bounds = call.scene.bounds;
                let radius_mm = bounds.radius_mm - call.request.parameters().depth_mm + margin_mm;
                let radius = radius_mm.max(0.0) / projection.mm_per_pixel();
                let centre = place(bounds.centre_in_patient);
                Self::between(centre - radius, centre + radius, size)
            }
        }
    }

    /// The pixels of a picture between two positions, with a margin; none if a position is not a number.
    fn between(low: DVec2, high: DVec2, size: FrameSize) -> Self {
        let last = DVec2::new(f64::from(size.width()), f64::from(size.height()));
        // NaN would be converted to 0.
        let pixel = |place: DVec2| {
            place
                .clamp(DVec2::ZERO, last)
                .to_array()
                .map(|at| at as u32)
        };
        let corner = pixel((low - MARGIN).floor());
        let end = pixel((high + MARGIN).ceil());
        Self {
            corner,
            size: [0, 1].map(|axis| end[axis].saturating_sub(corner[axis])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_stays_within_its_picture() {
        let size = FrameSize::new(100, 50).unwrap();
        let between = |low, high| Block::between(low, high, size);
        let block = |corner, size| Block { corner, size };
        assert_eq!(
            between(DVec2::new(10.5, 20.0), DVec2::new(30.2, 25.0)),
            block([8, 18], [25, 9])
        );
        assert_eq!(
            between(DVec2::splat(-1e9), DVec2::splat(1e9)),
            block([0, 0], [100, 50])
        );
        assert_eq!(
            between(DVec2::splat(200.0), DVec2::splat(300.0)).size,
            [0, 0]
        );
        assert_eq!(between(DVec2::INFINITY, DVec2::NEG_INFINITY).size, [0, 0]);
    }
}
