//! What a row of pixels shows of an isosurface.

/// The points of the isosurface that a row of pixels shows.
#[derive(Debug, Clone)]
pub(crate) struct PointRow {
    /// Heights towards the viewer from the plane through the target's centre, in working voxels; −∞ where there is no
    /// point.
    pub(crate) heights: Vec<f32>,
    /// Cosines between the outward normal and the direction to the viewer.
    pub(crate) facing: Vec<f32>,
    /// About unit vectors into the brain, in patient space; empty if not needed.
    pub(crate) inward: Vec<[f32; 3]>,
    /// The covered share of each pixel, 0 to 1; empty if all pixels are covered whole.
    pub(crate) coverage: Vec<f32>,
}

/// A point of the isosurface as [`PointRow`] keeps it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    pub(crate) height: f32,
    pub(crate) facing: f32,
    pub(crate) inward: [f32; 3],
}

impl PointRow {
    /// A row of `width` pixels that show nothing, with or without directions into the brain.
    pub(crate) fn new(width: usize, with_inward: bool) -> Self {
        Self {
            heights: vec![f32::NEG_INFINITY; width],
            facing: vec![0.0; width],
            inward: vec![[0.0; 3]; if with_inward { width } else { 0 }],
            coverage: Vec::new(),
        }
    }

    /// Writes what a pixel shows.
    #[inline]
    pub(crate) fn set(&mut self, column: usize, point: Point) {
        self.heights[column] = point.height;
        self.facing[column] = point.facing;
        if let Some(inward) = self.inward.get_mut(column) {
            *inward = point.inward;
        }
    }
}
