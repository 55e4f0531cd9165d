//! A mesh to draw.

use geometry::{MeshSize, ShrunkMesh};

/// A mesh to draw: its size and its vertices.
#[derive(Debug, Clone, Copy)]
pub struct Facets<'a> {
    pub(super) size: MeshSize,
    pub(super) mesh: &'a ShrunkMesh,
}

impl<'a> Facets<'a> {
    /// The facets of `mesh`, which has the size `size`.
    ///
    /// # Panics
    /// If the number of vertices does not match.
    pub fn new(size: MeshSize, mesh: &'a ShrunkMesh) -> Self {
        assert_eq!(
            mesh.positions_in_patient.len(),
            size.vertex_count(),
            "the vertices of a mesh of this size"
        );
        Self { size, mesh }
    }
}
