//! The points of the surface that pixels show.

use glam::DVec3;

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
        let index = y as usize * size.width() as usize + x as usize;
        let height_mm = f64::from(self.heights_mm[index]);
        let position_in_frame = DVec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, height_mm);
        height_mm.is_finite().then(|| {
            self.projection
                .patient_from_frame()
                .transform_point3(position_in_frame)
        })
    }
}
