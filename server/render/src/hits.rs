//! The points of the surface that pixels show.

use glam::DVec3;
use rayon::prelude::*;

use crate::Projection;
use crate::rays::View;

/// For each pixel of a picture the point of the surface that it shows, for picking and for tests.
#[derive(Debug, Clone)]
pub struct Hits {
    view: View,
    heights_mm: Vec<f32>,
}

impl Hits {
    /// The hits of a picture from their heights in mm, which are frame-space z or on a map distances from the centre of the
    /// hemisphere, row by row; a value that is not finite is no hit.
    ///
    /// # Panics
    /// If the number of values differs from the number of pixels.
    pub(crate) fn new(view: impl Into<View>, heights_mm: Vec<f32>) -> Self {
        let view = view.into();
        assert_eq!(
            heights_mm.len(),
            view.size().pixel_count(),
            "one for each pixel"
        );
        Self { view, heights_mm }
    }

    /// The projection of the picture; `None` for a map.
    pub fn projection(&self) -> Option<&Projection> {
        match &self.view {
            View::Parallel(projection) => Some(projection),
            View::Map(_) => None,
        }
    }

    /// Fills the gaps of positions with these hits: those of another disc of the same map.
    pub fn fill(&self, positions: &mut [[f32; 3]]) {
        for (position, other) in positions.iter_mut().zip(self.positions_in_patient()) {
            if position[0].is_nan() {
                *position = other;
            }
        }
    }

    /// Position in LPS mm of the surface at pixel (x, y); `None` if it shows the background or lies outside the
    /// picture.
    pub fn position_in_patient(&self, x: u32, y: u32) -> Option<DVec3> {
        let size = self.view.size();
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
        let width = self.view.size().width() as usize;
        let [x, y] = [index % width, index / width].map(|place| place as f64 + 0.5);
        let height_mm = f64::from(self.heights_mm[index]);
        if !height_mm.is_finite() {
            return None;
        }
        match &self.view {
            View::Parallel(projection) => {
                let in_frame = DVec3::new(x, y, height_mm);
                Some(projection.patient_from_frame().transform_point3(in_frame))
            }
            View::Map(projection) => projection.position_in_patient([x, y], height_mm),
        }
    }
}
