//! Triangles around the envelope, from sagittal contours.

use crate::{DepthField, GeometryError};

/// How fine a mesh is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct MeshSize {
    contour_count: u16,
    points_per_contour: u16,
}

impl MeshSize {
    /// A mesh of `contour_count` sagittal contours (the paper's N_F) of `points_per_contour` points (its N_P).
    ///
    /// # Errors
    /// When `contour_count` is not in 3..=512 or `points_per_contour` not in 3..=1024.
    pub fn new(contour_count: usize, points_per_contour: usize) -> Result<Self, GeometryError> {
        let _ = (contour_count, points_per_contour);
        todo!()
    }

    /// Number of contours, N_F.
    pub fn contour_count(self) -> usize {
        usize::from(self.contour_count)
    }

    /// Number of points on each contour, N_P.
    pub fn points_per_contour(self) -> usize {
        usize::from(self.points_per_contour)
    }

    /// `contour_count * points_per_contour + 2`: the contours' points, contour by contour, then the first and the last cap's centre.
    pub fn vertex_count(self) -> usize {
        self.contour_count() * self.points_per_contour() + 2
    }

    /// `2 * contour_count * points_per_contour`.
    pub fn triangle_count(self) -> usize {
        2 * self.contour_count() * self.points_per_contour()
    }

    /// The triangles of every mesh of this size, at every depth: vertex indices, counter-clockwise seen from outside.
    pub fn triangles(self) -> Vec<[u32; 3]> {
        todo!()
    }
}

/// The vertices of the envelope's mesh: depth 0 of every shrunk mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvelopeMesh {
    /// How fine it is.
    pub size: MeshSize,
    /// Vertices in voxel coordinates of the working grid, in the order of [`MeshSize::vertex_count`].
    pub positions_in_voxel: Vec<glam::Vec3>,
}

/// Cuts the envelope into sagittal contours and joins their points to a closed mesh.
///
/// # Errors
/// When the envelope is too small to be cut.
pub fn envelope_mesh(field: &DepthField, size: MeshSize) -> Result<EnvelopeMesh, GeometryError> {
    let _ = (field, size);
    todo!()
}
