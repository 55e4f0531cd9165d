//! GIFTI 1.0: a mesh, or values or labels of its vertices.

use std::io::Write as _;

use base64::prelude::{BASE64_STANDARD, Engine as _};
use bytes::Bytes;
use case::SurfaceName;
use flate2::{Compression, write::ZlibEncoder};
use render::RESEARCH_USE_NOTICE;

use super::Mesh;

/// Names and values. None has a character that XML must escape: texts of readers stand in label tables alone.
type MetaData<'a> = &'a [(&'a str, &'a str)];

/// Positions are in scanner space already. A line is a row of the matrix: so nibabel reads it.
const COORDINATE_SYSTEM: &str = "<CoordinateSystemTransformMatrix>\n\
     <DataSpace>NIFTI_XFORM_SCANNER_ANAT</DataSpace>\n\
     <TransformedSpace>NIFTI_XFORM_SCANNER_ANAT</TransformedSpace>\n\
     <MatrixData>\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n</MatrixData>\n\
     </CoordinateSystemTransformMatrix>\n";

/// A mesh of a surface in scanner RAS mm (`.surf.gii`). Left and front change their signs, so triangles stay counter-clockwise seen from
/// outside.
pub fn gifti(mesh: Mesh<'_>, surface: SurfaceName) -> Vec<u8> {
    let positions = mesh.positions_in_patient.iter();
    let positions: Vec<_> = positions.map(|&[x, y, z]| [-x, -y, z]).collect();
    let mut about = vec![("GeometricType", "Anatomical")];
    about.extend(structure(surface));
    let points = Array {
        intent: "POINTSET",
        kind: "FLOAT32",
        size: vec![positions.len(), 3],
        about: &about,
        space: COORDINATE_SYSTEM,
        bytes: super::positions(&positions),
    };
    let triangles = Array {
        intent: "TRIANGLE",
        kind: "INT32",
        size: vec![mesh.triangles.len(), 3],
        about: &[],
        space: "",
        bytes: super::triangles(mesh.triangles),
    };
    file(mesh.depth_mm, &[], &[points, triangles])
}

/// Values of the vertices of a mesh (`.shape.gii`).
pub fn gifti_values(mesh: Mesh<'_>, surface: SurfaceName, name: &str, values: &[f32]) -> Vec<u8> {
    let about = [("Name", name)];
    let values = numbers("SHAPE", &about, values);
    let structure = structure(surface);
    file(mesh.depth_mm, structure.as_slice(), &[values])
}

/// Values of the vertices of a mesh at several depths (mm), an array for each (`.func.gii`).
pub fn gifti_columns(surface: SurfaceName, name: &str, columns: &[(f32, Vec<f32>)]) -> Vec<u8> {
    let names: Vec<_> = columns
        .iter()
        .map(|(depth_mm, _)| format!("{name} at {depth_mm} mm"))
        .collect();
    let abouts: Vec<_> = names.iter().map(|name| [("Name", &**name)]).collect();
    let arrays: Vec<_> = (columns.iter().zip(&abouts))
        .map(|((_, values), about)| numbers("NONE", about, values))
        .collect();
    document(structure(surface).as_slice(), "<LabelTable/>\n", &arrays)
}

/// A label of vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct VertexLabel {
    /// Its number, from 1.
    pub number: u16,
    /// Any text.
    pub name: String,
    /// Red, green and blue.
    pub colour: [u8; 3],
}

/// Labels of the vertices of a mesh (`.label.gii`): 0 where there is none.
pub fn gifti_labels(
    mesh: Mesh<'_>,
    surface: SurfaceName,
    (name, table): (&str, &[VertexLabel]),
    labels: &[u16],
) -> Vec<u8> {
    let labels = Array {
        intent: "LABEL",
        kind: "INT32",
        size: vec![labels.len()],
        about: &[("Name", name)],
        space: "",
        bytes: labels
            .iter()
            .flat_map(|&label| i32::from(label).to_le_bytes())
            .collect(),
    };
    let none = "<Label Key=\"0\" Red=\"0\" Green=\"0\" Blue=\"0\" Alpha=\"0\">none</Label>\n";
    let rows: String = table.iter().map(VertexLabel::xml).collect();
    let table = format!("<LabelTable>\n{none}{rows}</LabelTable>\n");
    let depth = format!("{:.3}", mesh.depth_mm);
    let mut about = vec![("DepthMm", &*depth)];
    about.extend(structure(surface));
    document(&about, &table, &[labels])
}

impl VertexLabel {
    fn xml(&self) -> String {
        let [red, green, blue] = self.colour.map(|part| f32::from(part) / 255.0);
        format!(
            "<Label Key=\"{}\" Red=\"{red:.4}\" Green=\"{green:.4}\" Blue=\"{blue:.4}\" Alpha=\"1\">{}</Label>\n",
            self.number,
            escaped(&self.name)
        )
    }
}

/// A text in XML. Characters that XML 1.0 does not know become spaces.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '\u{fffe}' | '\u{ffff}' => escaped.push(' '),
            letter if letter.is_control() => escaped.push(' '),
            letter => escaped.push(letter),
        }
    }
    escaped
}

/// An array with a number for each vertex.
fn numbers<'a>(intent: &'a str, about: MetaData<'a>, values: &[f32]) -> Array<'a> {
    Array {
        intent,
        kind: "FLOAT32",
        size: vec![values.len()],
        about,
        space: "",
        bytes: values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect(),
    }
}

/// What Workbench and FreeSurfer call a half.
fn structure(surface: SurfaceName) -> Option<(&'static str, &'static str)> {
    let name = match surface {
        SurfaceName::Left => "CortexLeft",
        SurfaceName::Right => "CortexRight",
        SurfaceName::Whole | SurfaceName::Cerebrum => return None,
    };
    Some(("AnatomicalStructurePrimary", name))
}

fn file(depth_mm: f32, about: MetaData<'_>, arrays: &[Array<'_>]) -> Vec<u8> {
    let depth = format!("{depth_mm:.3}");
    let about = [&[("DepthMm", &*depth)], about].concat();
    document(&about, "<LabelTable/>\n", arrays)
}

fn document(about: MetaData<'_>, labels: &str, arrays: &[Array<'_>]) -> Vec<u8> {
    let own = [
        ("Description", "Isocortex"),
        ("Disclaimer", RESEARCH_USE_NOTICE),
    ];
    let about = meta_data(&[&own, about].concat());
    let count = arrays.len();
    let arrays: String = arrays.iter().map(Array::xml).collect();
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<GIFTI Version=\"1.0\" NumberOfDataArrays=\"{count}\">\n{about}{labels}\
         {arrays}</GIFTI>\n"
    )
    .into_bytes()
}

fn meta_data(pairs: MetaData<'_>) -> String {
    let pair = |(name, value): &(&str, &str)| {
        format!("<MD><Name>{name}</Name><Value>{value}</Value></MD>\n")
    };
    let pairs: String = pairs.iter().map(pair).collect();
    format!("<MetaData>\n{pairs}</MetaData>\n")
}

struct Array<'a> {
    intent: &'a str,
    kind: &'a str,
    size: Vec<usize>,
    about: MetaData<'a>,
    space: &'a str,
    /// Little-endian numbers, row by row.
    bytes: Bytes,
}

impl Array<'_> {
    fn xml(&self) -> String {
        let Self {
            intent,
            kind,
            size,
            space,
            ..
        } = self;
        let sizes = size.iter().enumerate();
        let sizes: String = sizes
            .map(|(n, size)| format!("Dim{n}=\"{size}\" "))
            .collect();
        format!(
            "<DataArray Intent=\"NIFTI_INTENT_{intent}\" DataType=\"NIFTI_TYPE_{kind}\" ArrayIndexingOrder=\"RowMajorOrder\" \
             Dimensionality=\"{}\" {sizes}Encoding=\"GZipBase64Binary\" Endian=\"LittleEndian\" ExternalFileName=\"\" \
             ExternalFileOffset=\"\">\n{}{space}<Data>{}</Data>\n</DataArray>\n",
            size.len(),
            meta_data(self.about),
            BASE64_STANDARD.encode(packed(&self.bytes)),
        )
    }
}

/// The form that GIFTI calls GZip: zlib (RFC 1950).
fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    let packed = encoder.write_all(bytes).and_then(|()| encoder.finish());
    packed.expect("compressing from memory to memory cannot fail")
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{mesh_of, tetrahedron};
    use super::*;

    #[test]
    fn halves_are_named_and_values_have_one_dimension() {
        let (positions, triangles) = tetrahedron();
        let mesh = mesh_of(&positions, &triangles);
        let text = |file: Vec<u8>| String::from_utf8(file).unwrap();
        let whole = text(gifti(mesh, SurfaceName::Whole));
        assert!(!whole.contains("AnatomicalStructurePrimary"));
        assert!(whole.contains("NumberOfDataArrays=\"2\""));
        assert!(whole.contains("Dimensionality=\"2\" Dim0=\"4\" Dim1=\"3\" "));
        assert!(text(gifti(mesh, SurfaceName::Left)).contains("<Value>CortexLeft<"));
        let values = [1.0, f32::NAN, 2.0, 3.0];
        let values = text(gifti_values(mesh, SurfaceName::Right, "blur", &values));
        assert!(values.contains("<Value>CortexRight<"));
        assert!(values.contains("NumberOfDataArrays=\"1\""));
        assert!(values.contains("Dimensionality=\"1\" Dim0=\"4\" Enc"));
    }

    #[test]
    fn a_name_of_a_label_is_a_text_and_nothing_else() {
        let (positions, triangles) = tetrahedron();
        let label = VertexLabel {
            number: 7,
            name: "<b>&amp;\u{1} ]]>\u{ffff}é".to_owned(),
            colour: [255, 0, 51],
        };
        let table = ("findings", &[label][..]);
        let mesh = mesh_of(&positions, &triangles);
        let file = gifti_labels(mesh, SurfaceName::Left, table, &[0, 7, 0, 7]);
        let text = String::from_utf8(file).unwrap();
        let row = "<Label Key=\"7\" Red=\"1.0000\" Green=\"0.0000\" Blue=\"0.2000\" Alpha=\"1\">\
                   &lt;b&gt;&amp;amp;  ]]&gt; é</Label>";
        assert!(text.contains(row), "{text}");
        assert!(text.contains("Intent=\"NIFTI_INTENT_LABEL\" DataType=\"NIFTI_TYPE_INT32\""));
    }
}
