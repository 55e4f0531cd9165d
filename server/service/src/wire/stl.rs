//! Binary STL.

use geometry::Solid;

use super::Mesh;

const HEADER_LENGTH: usize = 80;
const TRIANGLE_LENGTH: usize = 50;

/// A binary STL in LPS mm, as stated in the header in the form that 3D Slicer reads.
///
/// Normals are the outward normals of the facets.
pub fn stl(mesh: Mesh<'_>) -> Vec<u8> {
    let about = format!("DEPTH={:.3}", mesh.depth_mm);
    written(&about, mesh.positions_in_patient, mesh.triangles)
}

/// The same of balls and tubes, with their radius.
pub fn stl_of_tubes(solid: &Solid, radius_mm: f64) -> Vec<u8> {
    let about = format!("RADIUS={radius_mm:.3}");
    written(&about, &solid.positions_in_patient, &solid.triangles)
}

fn written(about: &str, positions_in_patient: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut file = Vec::with_capacity(HEADER_LENGTH + 4 + TRIANGLE_LENGTH * triangles.len());
    let title = format!(
        "Isocortex SPACE=LPS;UNIT=mm;{about} {}",
        render::SHORT_NOTICE
    );
    file.extend(
        title
            .bytes()
            .chain(std::iter::repeat(b' '))
            .take(HEADER_LENGTH),
    );
    file.extend_from_slice(&(triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        let corners = triangle.map(|vertex| positions_in_patient[vertex as usize]);
        let vectors = std::iter::once(facet_normal(corners)).chain(corners);
        file.extend(vectors.flatten().flat_map(f32::to_le_bytes));
        file.extend_from_slice(&[0, 0]);
    }
    file
}

fn facet_normal([a, b, c]: [[f32; 3]; 3]) -> [f32; 3] {
    let [a, b, c] = [a, b, c].map(glam::Vec3::from_array);
    (b - a).cross(c - a).normalize_or_zero().to_array()
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{f32_at, mesh_of, tetrahedron, u32_at};
    use super::*;

    #[test]
    fn facets_carry_their_outward_normals() {
        let (positions, triangles) = tetrahedron();
        let file = stl(mesh_of(&positions, &triangles));
        assert_eq!(file.len(), 84 + 50 * 4);
        assert!(!file.starts_with(b"solid"));
        assert!(file[..80].windows(9).any(|window| window == b"SPACE=LPS"));
        assert_eq!(u32_at(&file, 80), 4);
        let normal = [0, 4, 8].map(|offset| f32_at(&file, 84 + offset));
        assert_eq!(normal, [0.0, 0.0, -1.0]);
        assert_eq!(f32_at(&file, 84 + 12 + 12 + 4), 20.0);
    }
}
