//! Every depth of every vertex, tabulated.

use crate::{DepthField, DistanceMap, EnvelopeMesh, Forest, MeshSize};

/// What a vertex follows as the mesh shrinks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PathKind {
    /// The optimal paths of the second transform, as in the paper.
    Forest,
    /// Up the gradient of the distance map: the nearest way to a depth.
    Flow,
}

/// The positions of a mesh's vertices at every depth: depth-major, 16 bits a coordinate.
#[derive(Debug, Clone, PartialEq)]
pub struct PathTable {
    /// How fine the mesh is.
    pub size: MeshSize,
    /// LPS mm of the stored position `[0, 0, 0]`.
    pub origin_in_patient: [f32; 3],
    /// Millimetres in a step of a stored coordinate.
    pub step_mm: f32,
    /// Depth from a row to the next, in mm. Row 0 is depth 0.
    pub row_mm: f32,
    /// Rows of `size.vertex_count()` stored positions.
    pub rows: Vec<[u16; 3]>,
    /// For each vertex the depth of its path's end, in mm, beyond which it rests.
    pub rest_depth_mm: Vec<f32>,
}

/// A mesh at a depth.
#[derive(Debug, Clone, PartialEq)]
pub struct ShrunkMesh {
    /// Its depth: what was asked for, at most that of the deepest row.
    pub depth_mm: f32,
    /// Vertices in LPS mm, in the order of [`MeshSize::vertex_count`].
    pub positions_in_patient: Vec<[f32; 3]>,
}

impl PathTable {
    /// The mesh of the isosurface `depth_mm` below the envelope, clamped to 0 and the table's last row.
    pub fn shrink(&self, depth_mm: f32) -> ShrunkMesh {
        let _ = depth_mm;
        todo!()
    }
}

/// Follows the path of every vertex and tabulates its position at every depth.
///
/// With [`PathKind::Forest`] a `forest` is needed.
pub fn path_table(
    mesh: &EnvelopeMesh,
    distance: &DistanceMap,
    field: &DepthField,
    forest: Option<&Forest>,
) -> PathTable {
    let _ = (mesh, distance, field, forest);
    todo!()
}
