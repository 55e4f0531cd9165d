//! The points of the surface that pixels show.

use glam::DVec3;
use rayon::prelude::*;

use crate::Projection;

/// For each pixel of a picture the point of the surface that it shows, for picking and for tests.
#[derive(Debug, Clone)]
pub struct Hits {
    projection: Projection,
    heights_mm: Vec<f32>,
}

impl Hits {
    /// The hits of a picture from their frame-space z in mm, row by row; a value that is not finite is no hit.
    ///
    /// # Panics
    /// If the number of values differs from the number of pixels.
    pub(crate) fn new(projection: Projection, heights_mm: Vec<f32>) -> Self {
        assert_eq!(
            heights_mm.len(),
            projection.size().pixel_count(),
            "one for each pixel"
        );
        Self {
            projection,
            heights_mm,
        }
    }

    /// The projection of the picture.
    pub fn projection(&self) -> &Projection {
        &self.projection
    }

    /// Position in LPS mm of the surface at pixel (x, y); `None` if it shows the background or lies outside the
    /// picture.
    pub fn position_in_patient(&self, x: u32, y: u32) -> Option<DVec3> {
        let size = self.projection.size();
        if x >= size.width() || y >= size.height() {
            return None;
        }
        self.position_at(y as usize * size.width() as usize + x as usize)
    }

    /// The position in LPS mm of the surface at each pixel, row by row; NaN if it shows the background.
    pub fn positions_in_patient(&self) -> Vec<[f32; 3]> {
        let position = |index| match self.position_at(index) {
            Some(position) => position.to_array().map(|coordinate| coordinate as f32),
            None => [f32::NAN; 3],
        };
        (0..self.heights_mm.len())
            .into_par_iter()
            .map(position)
            .collect()
    }

    /// The position at a pixel, counted row by row.
    fn position_at(&self, index: usize) -> Option<DVec3> {
        let width = self.projection.size().width() as usize;
        let [x, y] = [index % width, index / width].map(|place| place as f64 + 0.5);
        let height_mm = f64::from(self.heights_mm[index]);
        height_mm.is_finite().then(|| {
            self.projection
                .patient_from_frame()
                .transform_point3(DVec3::new(x, y, height_mm))
        })
    }
}
