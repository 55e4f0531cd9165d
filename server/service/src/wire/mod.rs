#![doc = include_str!("README.md")]

mod freesurfer;
mod gifti;
mod gltf;
mod obj;
mod paths;
mod ply;
mod stl;
mod texture;

use bytes::Bytes;
use geometry::{MeshSize, ShrunkMesh};
use glam::{DVec3, Vec3};

pub use freesurfer::{VolumeGeometry, freesurfer, freesurfer_values};
pub use gifti::{VertexLabel, gifti, gifti_columns, gifti_labels, gifti_values};
pub use gltf::gltf;
pub use obj::obj;
pub use paths::{Astray, paths};
pub use ply::ply;
pub use stl::{stl, stl_of_tubes};
pub use texture::{
    Texture, Voxels, added_layer_texture, coarse_depth_texture, depth_texture, differences,
    layer_texture, quick_range, volume_texture,
};

/// A mesh to write.
#[derive(Debug, Clone, Copy)]
pub struct Mesh<'a> {
    /// The depth of its vertices.
    pub depth_mm: f32,
    /// The vertices in LPS mm.
    pub positions_in_patient: &'a [[f32; 3]],
    /// Vertex numbers, counter-clockwise seen from outside.
    pub triangles: &'a [[u32; 3]],
}

/// The triangles of a mesh without those that touch one of the unknown vertices or have no area.
pub fn known_triangles(shrunk: &ShrunkMesh, size: MeshSize, unknown: &[usize]) -> Vec<[u32; 3]> {
    let mut is_known = vec![true; shrunk.positions_in_patient.len()];
    for &vertex in unknown {
        is_known[vertex] = false;
    }
    let mut triangles = size.triangles();
    triangles.retain(|triangle| {
        let corners = triangle.map(|vertex| shrunk.positions_in_patient[vertex as usize]);
        let [a, b, c] = corners.map(|corner| Vec3::from_array(corner).as_dvec3());
        let is_known = triangle.iter().all(|&vertex| is_known[vertex as usize]);
        is_known && (b - a).cross(c - a) != DVec3::ZERO
    });
    triangles
}

/// Positions in LPS mm as `f32` triples, little-endian.
pub fn positions(positions_in_patient: &[[f32; 3]]) -> Bytes {
    little_endian(positions_in_patient, |x: f32| x.to_le_bytes())
}

/// Triangles as `u32` triples, little-endian.
pub fn triangles(triangles: &[[u32; 3]]) -> Bytes {
    little_endian(triangles, |number: u32| number.to_le_bytes())
}

fn little_endian<T>(triples: &[[T; 3]], bytes: impl Fn(T) -> [u8; 4]) -> Bytes
where
    T: bytemuck::Pod,
{
    if cfg!(target_endian = "little") {
        return Bytes::copy_from_slice(bytemuck::cast_slice(triples));
    }
    let values = triples.iter().flatten();
    values.flat_map(|&value| bytes(value)).collect()
}

#[cfg(test)]
pub(crate) mod fixture {
    use super::Mesh;

    /// A tetrahedron, which is as good a mesh as any.
    pub(crate) fn tetrahedron() -> ([[f32; 3]; 4], [[u32; 3]; 4]) {
        let positions = [
            [0.0, 0.0, 0.0],
            [30.0, 0.0, 0.0],
            [0.0, 20.0, 0.0],
            [0.0, 0.0, 10.0],
        ];
        (positions, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    }

    pub(crate) fn mesh_of<'a>(
        positions_in_patient: &'a [[f32; 3]],
        triangles: &'a [[u32; 3]],
    ) -> Mesh<'a> {
        Mesh {
            depth_mm: 2.5,
            positions_in_patient,
            triangles,
        }
    }

    pub(crate) fn f32_at(bytes: &[u8], offset: usize) -> f32 {
        f32::from_le_bytes(bytes[offset..offset + 4].try_into().unwrap())
    }

    pub(crate) fn u32_at(bytes: &[u8], offset: usize) -> u32 {
        u32::from_le_bytes(bytes[offset..offset + 4].try_into().unwrap())
    }
}

#[cfg(test)]
mod tests {
    use super::fixture::{f32_at, tetrahedron, u32_at};

    #[test]
    fn positions_and_triangles_are_bare_triples() {
        let (positions, triangles) = tetrahedron();
        let positions = super::positions(&positions);
        assert_eq!(positions.len(), 12 * 4);
        assert_eq!(f32_at(&positions, 12), 30.0);
        let triangles = super::triangles(&triangles);
        assert_eq!(triangles.len(), 12 * 4);
        assert_eq!(u32_at(&triangles, 4), 2);
    }
}
