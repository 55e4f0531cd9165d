//! glTF 2.0 in one binary file (GLB).

use serde_json::json;

use super::Mesh;

const MAGIC: &[u8; 4] = b"glTF";
const VERSION: u32 = 2;
const JSON_CHUNK: &[u8; 4] = b"JSON";
const BINARY_CHUNK: &[u8; 4] = b"BIN\0";

/// LPS mm to glTF's space, column by column: x stays (the patient's left is glTF's +x of a figure that faces +z), up is
/// S, forward is A; metres.
const GLTF_FROM_PATIENT: [f32; 16] = [
    0.001, 0.0, 0.0, 0.0, //
    0.0, 0.0, -0.001, 0.0, //
    0.0, 0.001, 0.0, 0.0, //
    0.0, 0.0, 0.0, 1.0,
];

/// A GLB of one mesh. Its buffer holds the vertices in LPS mm; the node's matrix turns them y-up and into metres.
///
/// Format: Khronos glTF 2.0, sections 3.6 and 4.4.
pub fn gltf(mesh: Mesh<'_>) -> Vec<u8> {
    let positions = super::positions(mesh.positions_in_patient);
    let triangles = super::triangles(mesh.triangles);
    let mut text = document(mesh, positions.len(), triangles.len()).to_string();
    while !text.len().is_multiple_of(4) {
        text.push(' ');
    }
    let binary_length = positions.len() + triangles.len();
    let length = 12 + 8 + text.len() + 8 + binary_length;
    let mut file = Vec::with_capacity(length);
    file.extend_from_slice(MAGIC);
    file.extend_from_slice(&VERSION.to_le_bytes());
    file.extend_from_slice(&(length as u32).to_le_bytes());
    file.extend_from_slice(&(text.len() as u32).to_le_bytes());
    file.extend_from_slice(JSON_CHUNK);
    file.extend_from_slice(text.as_bytes());
    file.extend_from_slice(&(binary_length as u32).to_le_bytes());
    file.extend_from_slice(BINARY_CHUNK);
    file.extend_from_slice(&positions);
    file.extend_from_slice(&triangles);
    file
}

fn document(mesh: Mesh<'_>, position_bytes: usize, triangle_bytes: usize) -> serde_json::Value {
    const FLOAT: u32 = 5126;
    const UNSIGNED_INT: u32 = 5125;
    const ARRAY_BUFFER: u32 = 34962;
    const ELEMENT_ARRAY_BUFFER: u32 = 34963;
    let [least, greatest] = bounds(mesh.positions_in_patient);
    json!({
        "asset": {
            "version": "2.0",
            "generator": concat!("isocortex ", env!("CARGO_PKG_VERSION")),
            "extras": {
                "notice": render::RESEARCH_USE_NOTICE,
                "depth_mm": mesh.depth_mm,
                "buffer_space": "LPS mm",
            },
        },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "matrix": GLTF_FROM_PATIENT }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": FLOAT,
                "count": mesh.positions_in_patient.len(),
                "type": "VEC3",
                "min": least,
                "max": greatest,
            },
            {
                "bufferView": 1,
                "componentType": UNSIGNED_INT,
                "count": 3 * mesh.triangles.len(),
                "type": "SCALAR",
            },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": position_bytes, "target": ARRAY_BUFFER },
            {
                "buffer": 0,
                "byteOffset": position_bytes,
                "byteLength": triangle_bytes,
                "target": ELEMENT_ARRAY_BUFFER,
            },
        ],
        "buffers": [{ "byteLength": position_bytes + triangle_bytes }],
    })
}

/// The least and the greatest coordinates.
fn bounds(positions: &[[f32; 3]]) -> [[f32; 3]; 2] {
    let mut least = [f32::INFINITY; 3];
    let mut greatest = [f32::NEG_INFINITY; 3];
    for position in positions {
        for axis in 0..3 {
            least[axis] = least[axis].min(position[axis]);
            greatest[axis] = greatest[axis].max(position[axis]);
        }
    }
    [least, greatest]
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{f32_at, mesh_of, tetrahedron, u32_at};
    use super::*;

    #[test]
    fn chunks_and_their_lengths_agree() {
        let (positions, triangles) = tetrahedron();
        let file = gltf(mesh_of(&positions, &triangles));
        assert_eq!(&file[..4], MAGIC);
        assert_eq!(u32_at(&file, 8) as usize, file.len());
        let text_length = u32_at(&file, 12) as usize;
        let document: serde_json::Value =
            serde_json::from_slice(&file[20..20 + text_length]).unwrap();
        let binary = 20 + text_length;
        assert_eq!(binary % 4, 0);
        assert_eq!(u32_at(&file, binary) as usize, file.len() - binary - 8);
        assert_eq!(document["buffers"][0]["byteLength"], 2 * 48);
        assert_eq!(document["accessors"][0]["max"][0], 30.0);
        assert_eq!(f32_at(&file, binary + 8 + 12), 30.0);
    }

    #[test]
    fn the_head_is_up_and_the_face_forward() {
        let turned = |[x, y, z]: [f32; 3]| {
            [0, 1, 2].map(|row| {
                GLTF_FROM_PATIENT[row] * x
                    + GLTF_FROM_PATIENT[4 + row] * y
                    + GLTF_FROM_PATIENT[8 + row] * z
            })
        };
        assert_eq!(turned([1.0, 0.0, 0.0]), [0.001, 0.0, 0.0]);
        assert_eq!(turned([0.0, 0.0, 1.0]), [0.0, 0.001, 0.0]);
        assert_eq!(turned([0.0, -1.0, 0.0]), [0.0, 0.0, 0.001]);
    }
}
