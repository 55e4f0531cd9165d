//! Wavefront OBJ.

use std::fmt::Write as _;

use render::RESEARCH_USE_NOTICE;

use super::Mesh;

/// An OBJ in LPS mm, as stated in a comment. Coordinates are written as the shortest text that gives the same `f32`
/// back.
pub fn obj(mesh: Mesh<'_>) -> Vec<u8> {
    let mut text = format!(
        "# Isocortex. {RESEARCH_USE_NOTICE}\n# SPACE=LPS UNIT=mm DEPTH={:.3}\n",
        mesh.depth_mm
    );
    let write = (|| {
        for [x, y, z] in mesh.positions_in_patient {
            writeln!(text, "v {x} {y} {z}")?;
        }
        for triangle in mesh.triangles {
            let [a, b, c] = triangle.map(|vertex| vertex + 1);
            writeln!(text, "f {a} {b} {c}")?;
        }
        Ok::<(), std::fmt::Error>(())
    })();
    write.expect("writing to memory cannot fail");
    text.into_bytes()
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{mesh_of, tetrahedron};
    use super::*;

    #[test]
    fn vertices_count_from_one() {
        let (positions, triangles) = tetrahedron();
        let file = obj(mesh_of(&positions, &triangles));
        let text = String::from_utf8(file).unwrap();
        assert!(text.contains("\nv 30 0 0\n"));
        assert!(text.contains("\nf 1 3 2\n"));
        assert!(text.contains("SPACE=LPS"));
        assert_eq!(text.lines().count(), 2 + 4 + 4);
    }
}
