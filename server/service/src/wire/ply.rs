//! Binary PLY.

use render::RESEARCH_USE_NOTICE;

use super::Mesh;

/// A binary, little-endian PLY in LPS mm, as stated in a comment.
pub fn ply(mesh: Mesh<'_>) -> Vec<u8> {
    let mut file = header(mesh).into_bytes();
    file.extend_from_slice(&super::positions(mesh.positions_in_patient));
    for triangle in mesh.triangles {
        file.push(3);
        file.extend(triangle.iter().flat_map(|vertex| vertex.to_le_bytes()));
    }
    file
}

fn header(mesh: Mesh<'_>) -> String {
    format!(
        "ply\nformat binary_little_endian 1.0\n\
         comment Isocortex. {RESEARCH_USE_NOTICE}\ncomment SPACE=LPS UNIT=mm DEPTH={:.3}\n\
         element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        mesh.depth_mm,
        mesh.positions_in_patient.len(),
        mesh.triangles.len()
    )
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{f32_at, mesh_of, tetrahedron};
    use super::*;

    #[test]
    fn the_header_counts_what_follows() {
        let (positions, triangles) = tetrahedron();
        let mesh = mesh_of(&positions, &triangles);
        let file = ply(mesh);
        let start = header(mesh).len();
        assert!(header(mesh).contains("element vertex 4\n"));
        assert!(header(mesh).contains("element face 4\n"));
        assert_eq!(file.len(), start + 4 * 12 + 4 * 13);
        assert_eq!(f32_at(&file, start + 12), 30.0);
        assert_eq!(file[start + 48..start + 53], [3, 0, 0, 0, 0]);
    }
}
