//! Surfaces with values: what the files say of their place is kept, nothing is guessed, and hostile files are errors.

use std::io::Write as _;

use base64::prelude::{BASE64_STANDARD, Engine as _};
use geometry::Grid;
use glam::{DAffine3, DMat3, DVec3};
use imaging::surface::{Drawing, Space, SurfaceError, SurfaceFiles, ValuedSurface, read, sheet};

/// Two triangles on the patient's left (RAS), values of their vertices, and where they lie in the scanner.
const PLACES: [[f32; 3]; 4] = [
    [-30.0, 10.0, 5.0],
    [-30.0, 14.0, 5.0],
    [-30.0, 10.0, 9.0],
    [-30.0, 14.0, 9.0],
];
const TRIANGLES: [[i32; 3]; 2] = [[0, 1, 2], [2, 1, 3]];
const VALUES: [f32; 4] = [0.25, 1.5, -2.0, f32::NAN];

/// The footer of a volume that FreeSurfer conformed: its axes point left, down and forwards, and its centre is not the origin.
fn footer(valid: u8) -> Vec<u8> {
    let text = format!(
        "valid = {valid}  # volume info valid\nfilename = ../mri/T1.mgz\nvolume = 256 256 256\nvoxelsize = 1.0 1.0 1.0\n\
         xras   = -1.0 0.0 0.0\nyras   = 0.0 0.0 -1.0\nzras   = 0.0 1.0 0.0\ncras   = 3.5 -17.0 22.25\n"
    );
    [&[0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 20], text.as_bytes()].concat()
}

fn freesurfer(places: &[[f32; 3]], triangles: &[[i32; 3]], footer: &[u8]) -> Vec<u8> {
    let mut file = b"\xff\xff\xfecreated by a test\n\n".to_vec();
    for count in [places.len(), triangles.len()] {
        file.extend((count as i32).to_be_bytes());
    }
    file.extend(places.as_flattened().iter().flat_map(|x| x.to_be_bytes()));
    file.extend(
        triangles
            .as_flattened()
            .iter()
            .flat_map(|n| n.to_be_bytes()),
    );
    file.extend(footer);
    file
}

fn curv(values: &[f32]) -> Vec<u8> {
    let mut file = vec![0xff; 3];
    for count in [values.len() as i32, 2, 1] {
        file.extend(count.to_be_bytes());
    }
    file.extend(values.iter().flat_map(|value| value.to_be_bytes()));
    file
}

fn read_both(surface: &[u8], values: Option<&[u8]>) -> Result<ValuedSurface, SurfaceError> {
    read(SurfaceFiles { surface, values }, None, None, None)
}

fn assert_at(surface: &ValuedSurface, moved: [f64; 3]) {
    for (found, place) in surface.positions_in_patient.iter().zip(PLACES) {
        let scanner = DVec3::from_array(place.map(f64::from)) + DVec3::from_array(moved);
        let expected = DVec3::new(-scanner.x, -scanner.y, scanner.z);
        assert!(found.distance(expected) < 1e-4, "{found} {expected}");
    }
    let bits = |values: &[f32]| {
        values
            .iter()
            .map(|value| value.to_bits())
            .collect::<Vec<_>>()
    };
    assert_eq!(bits(&surface.values), bits(&VALUES));
}

#[test]
fn tkregister_coordinates_are_placed_by_the_footer_or_the_t1_and_never_guessed() {
    let values = curv(&VALUES);
    let file = freesurfer(&PLACES, &TRIANGLES, &footer(1));
    let surface = read_both(&file, Some(&values)).unwrap();
    assert_at(&surface, [3.5, -17.0, 22.25]);
    // Left is left.
    assert!(surface.positions_in_patient[0].x > 20.0);
    assert_eq!(surface.triangles, [[0, 1, 2], [2, 1, 3]]);

    // A conformed T1 with another centre.
    let axes = DMat3::from_cols(DVec3::X, -DVec3::Z, -DVec3::Y);
    let corner = DVec3::new(-1.0, 2.0, 3.0) - axes * DVec3::splat(128.0);
    let t1 = Grid::new([256; 3], DAffine3::from_mat3_translation(axes, corner)).unwrap();
    for footer in [footer(0), Vec::new(), b"anything".to_vec()] {
        let file = freesurfer(&PLACES, &TRIANGLES, &footer);
        let files = SurfaceFiles {
            surface: &file,
            values: Some(&values),
        };
        let refused = read(files, None, None, None).unwrap_err();
        assert_eq!(refused.kind(), "surface-space-unknown");
        assert!(refused.to_string().contains("part `t1`"), "{refused}");
        assert_at(
            &read(files, Some(&t1), None, None).unwrap(),
            [1.0, -2.0, 3.0],
        );
        // What the client states counts.
        let stated = read(files, Some(&t1), Some(Space::Scanner), None).unwrap();
        assert_at(&stated, [0.0; 3]);
    }
    // The second number of a footer states whether coordinates are already those of the scanner.
    let with = |stated: u8| {
        let mut footer = footer(1);
        footer[7] = stated;
        let file = freesurfer(&PLACES, &TRIANGLES, &footer);
        let files = SurfaceFiles {
            surface: &file,
            values: Some(&values),
        };
        read(files, Some(&t1), None, None)
    };
    assert_at(&with(0).unwrap(), [3.5, -17.0, 22.25]);
    assert_at(&with(1).unwrap(), [0.0; 3]);
    assert_eq!(with(2).unwrap_err().kind(), "surface-unsupported");
    let broken = String::from_utf8(footer(1)).unwrap();
    for (found, instead) in [
        ("cras   = 3.5", "cras   = nan"),
        ("cras   = 3.5 ", "cras   = "),
        ("xras   = -1.0", "xras   = -3.0"),
        ("yras   = 0.0 0.0 -1.0", "yras   = 1.0 0.0 0.0"),
        ("valid = 1", "valid = maybe"),
    ] {
        let footer = broken.replace(found, instead);
        assert_ne!(footer, broken);
        let file = freesurfer(&PLACES, &TRIANGLES, footer.as_bytes());
        let refused = read_both(&file, Some(&values)).unwrap_err();
        assert_eq!(refused.kind(), "surface-damaged", "{instead}: {refused}");
    }
}

#[test]
fn damaged_freesurfer_files_are_errors() {
    let values = curv(&VALUES);
    let sound = freesurfer(&PLACES, &TRIANGLES, &footer(1));
    for end in 0..sound.len() {
        let _ = read_both(&sound[..end], Some(&values));
    }
    for end in 3..values.len() {
        let refused = read_both(&sound, Some(&values[..end])).unwrap_err();
        assert_eq!(refused.kind(), "surface-damaged", "{end}");
    }
    let start = 3 + b"created by a test\n\n".len();
    let with = |at: usize, number: i32| {
        let mut file = sound.clone();
        file[start + at..start + at + 4].copy_from_slice(&number.to_be_bytes());
        read_both(&file, Some(&values)).unwrap_err()
    };
    for (at, number, kind) in [
        (0, 4_000_000, "surface-too-large"),
        (0, 900_000, "surface-damaged"),
        (0, -1, "surface-damaged"),
        (4, i32::MAX, "surface-too-large"),
        // A triangle with a vertex that is not there, and a place that is no number.
        (8 + 48, 4, "surface-damaged"),
        (8 + 48, -1, "surface-damaged"),
        (8, f32::NAN.to_bits().cast_signed(), "surface-damaged"),
        (8, 1e30f32.to_bits().cast_signed(), "surface-damaged"),
    ] {
        let mut kinds = String::new();
        let used = allocation_counter::measure(|| kinds = with(at, number).kind().to_owned());
        assert_eq!(kinds, kind, "{at} {number}");
        assert!(used.bytes_max < 100_000, "{at} {number}: {used:?}");
    }
    let other = read_both(&sound, Some(&curv(&VALUES[..3]))).unwrap_err();
    assert_eq!(other.kind(), "values-of-another-surface");
    assert_eq!(
        read_both(&sound, None).unwrap_err().kind(),
        "values-missing"
    );
    let quads = [b"\xff\xff\xff", &sound[3..]].concat();
    assert_eq!(
        read_both(&quads, None).unwrap_err().kind(),
        "surface-not-recognised"
    );
}

/// How the numbers of a GIFTI file are written.
#[derive(Clone, Copy)]
struct Writing {
    encoding: &'static str,
    is_big: bool,
    is_by_column: bool,
}

const PLAIN: Writing = Writing {
    encoding: "Base64Binary",
    is_big: false,
    is_by_column: false,
};

/// A number as a word, and in the order of its most significant byte.
type Number = (String, [u8; 4]);

impl Writing {
    fn array(
        self,
        intent: &str,
        kind: &str,
        numbers: &[Number],
        width: usize,
        inside: &str,
    ) -> String {
        let rows = numbers.len() / width;
        let ordered: Vec<&Number> = match self.is_by_column {
            true => (0..numbers.len())
                .map(|at| &numbers[(at % rows) * width + at / rows])
                .collect(),
            false => numbers.iter().collect(),
        };
        let mut bytes = Vec::new();
        for (_, number) in &ordered {
            let mut number = *number;
            if !self.is_big {
                number.reverse();
            }
            bytes.extend(number);
        }
        let data = match self.encoding {
            "ASCII" => ordered
                .iter()
                .map(|(word, _)| format!("{word}\n"))
                .collect(),
            "GZipBase64Binary" => {
                let fast = flate2::Compression::fast();
                let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), fast);
                packed.write_all(&bytes).unwrap();
                BASE64_STANDARD.encode(packed.finish().unwrap())
            }
            _ => BASE64_STANDARD.encode(bytes),
        };
        let sides = match width {
            1 => format!("Dimensionality=\"1\" Dim0=\"{rows}\""),
            _ => format!("Dimensionality=\"2\" Dim0=\"{rows}\" Dim1=\"{width}\""),
        };
        let order = if self.is_by_column { "Column" } else { "Row" };
        let endian = if self.is_big { "Big" } else { "Little" };
        format!(
            "<DataArray Intent=\"NIFTI_INTENT_{intent}\" DataType=\"NIFTI_TYPE_{kind}\" ArrayIndexingOrder=\"{order}MajorOrder\" {sides} \
             Encoding=\"{}\" Endian=\"{endian}Endian\" ExternalFileName=\"\" ExternalFileOffset=\"\">\n<MetaData/>{inside}\n\
             <Data>\n{data}\n</Data>\n</DataArray>\n",
            self.encoding
        )
    }

    fn values(self, values: &[f32]) -> String {
        let numbers: Vec<_> = values
            .iter()
            .map(|x| (x.to_string(), x.to_be_bytes()))
            .collect();
        self.array("SHAPE", "FLOAT32", &numbers, 1, "")
    }

    fn surface(self, space: &str) -> String {
        let places = PLACES.as_flattened().iter();
        let places: Vec<_> = places.map(|x| (x.to_string(), x.to_be_bytes())).collect();
        let numbers = TRIANGLES.as_flattened().iter();
        let numbers: Vec<_> = numbers.map(|n| (n.to_string(), n.to_be_bytes())).collect();
        let points = self.array("POINTSET", "FLOAT32", &places, 3, space);
        points + &self.array("TRIANGLE", "INT32", &numbers, 3, "")
    }
}

fn space(data: &str, transformed: &str, matrix: &str) -> String {
    format!(
        "<CoordinateSystemTransformMatrix><DataSpace><![CDATA[{data}]]></DataSpace><TransformedSpace>{transformed}</TransformedSpace>\
         <MatrixData>{matrix}</MatrixData></CoordinateSystemTransformMatrix>"
    )
}

fn scanner() -> String {
    let one = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1";
    space("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_TALAIRACH", one)
}

fn gifti(arrays: &str) -> Vec<u8> {
    let start = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!DOCTYPE GIFTI SYSTEM \"http://www.nitrc.org/frs/download.php/115/gifti.dtd\">\n\
                 <GIFTI Version=\"1.0\" NumberOfDataArrays=\"3\"><MetaData/><LabelTable/>\n";
    format!("{start}{arrays}</GIFTI>\n").into_bytes()
}

#[test]
fn gifti_is_read_in_every_encoding_byte_order_and_order_of_numbers() {
    for encoding in ["ASCII", "Base64Binary", "GZipBase64Binary"] {
        for is_big in [false, true] {
            for is_by_column in [false, true] {
                let writing = Writing {
                    encoding,
                    is_big,
                    is_by_column,
                };
                let surface = gifti(&writing.surface(&scanner()));
                let values = gifti(&writing.values(&VALUES));
                let read = read_both(&surface, Some(&values)).unwrap();
                assert_at(&read, [0.0; 3]);
                assert_eq!(read.triangles, [[0, 1, 2], [2, 1, 3]]);
                let both = gifti(&(writing.surface(&scanner()) + &writing.values(&VALUES)));
                assert_at(&read_both(&both, None).unwrap(), [0.0; 3]);
            }
        }
    }
    // As older versions of nibabel state the byte order.
    let surface = String::from_utf8(gifti(&PLAIN.surface(&scanner()))).unwrap();
    let surface = surface.replace("LittleEndian", "GIFTI_ENDIAN_LITTLE");
    let values = gifti(&PLAIN.values(&VALUES));
    assert_at(
        &read_both(surface.as_bytes(), Some(&values)).unwrap(),
        [0.0; 3],
    );
    // The values of one program with the surface of another.
    let surface = gifti(&PLAIN.surface(&scanner()));
    assert_at(
        &read_both(&surface, Some(&curv(&VALUES))).unwrap(),
        [0.0; 3],
    );
}

#[test]
fn gifti_is_placed_by_its_matrix_or_by_what_the_client_states() {
    let both = |space: &str| gifti(&(PLAIN.surface(space) + &PLAIN.values(&VALUES)));
    let moved = "1 0 0 5\n0 1 0 -6\n0 0 1 7\n0 0 0 1";
    let to_scanner = space("NIFTI_XFORM_UNKNOWN", "NIFTI_XFORM_SCANNER_ANAT", moved);
    assert_at(
        &read_both(&both(&to_scanner), None).unwrap(),
        [5.0, -6.0, 7.0],
    );
    // A matrix that leads out of all heads leads nowhere.
    let far = "1e305 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1";
    let far = both(&space(
        "NIFTI_XFORM_UNKNOWN",
        "NIFTI_XFORM_SCANNER_ANAT",
        far,
    ));
    let refused = read_both(&far, None).unwrap_err();
    assert!(refused.to_string().contains("100 m"), "{refused}");
    let unknown = both(&space("NIFTI_XFORM_UNKNOWN", "NIFTI_XFORM_UNKNOWN", moved));
    for file in [&unknown, &both("")] {
        let refused = read_both(file, None).unwrap_err();
        assert_eq!(refused.kind(), "surface-space-unknown");
        assert!(refused.to_string().contains("`space`"), "{refused}");
        let files = SurfaceFiles {
            surface: file,
            values: None,
        };
        let stated = read(files, None, Some(Space::Scanner), None).unwrap();
        assert_at(&stated, [0.0; 3]);
        let refused = read(files, None, Some(Space::Tkregister), None).unwrap_err();
        assert!(refused.to_string().contains("part `t1`"), "{refused}");
    }
    let flat = space(
        "",
        "NIFTI_XFORM_SCANNER_ANAT",
        "1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 1",
    );
    assert_eq!(
        read_both(&both(&flat), None).unwrap_err().kind(),
        "surface-damaged"
    );
}

#[test]
fn a_column_is_chosen_and_labels_have_their_names() {
    let surface = gifti(&PLAIN.surface(&scanner()));
    let columns = gifti(&(PLAIN.values(&[9.0; 4]) + &PLAIN.values(&VALUES)));
    let chosen = |column: Option<usize>| {
        let files = SurfaceFiles {
            surface: &surface,
            values: Some(&columns),
        };
        read(files, None, None, column)
    };
    assert_at(&chosen(Some(2)).unwrap(), [0.0; 3]);
    for column in [None, Some(0), Some(3)] {
        assert_eq!(chosen(column).unwrap_err().kind(), "values-column");
    }
    let table = "<LabelTable><Label Key=\"0\" Red=\"0\">???</Label><Label Key=\"7\"><![CDATA[insula]]></Label>\
                 <Label Key=\"8\">a &lt; b &#233;</Label><Label Key=\"9\"/></LabelTable>";
    let labels = String::from_utf8(gifti(&PLAIN.values(&[0.0, 7.0, 8.0, 9.0]))).unwrap();
    let labels = labels.replace("<LabelTable/>", table);
    let read = read_both(&surface, Some(labels.as_bytes())).unwrap();
    let names: Vec<_> = read
        .names
        .iter()
        .map(|(key, name)| (*key, &**name))
        .collect();
    assert_eq!(names, [(0, "???"), (7, "insula"), (8, "a < b é"), (9, "")]);
}

/// An overlay as FreeSurfer writes it: its frames as columns, one number for each vertex.
fn overlay(sides: [i32; 3], frames: i32, (kind, data): (i32, &[u8])) -> Vec<u8> {
    let numbers = [1, sides[0], sides[1], sides[2], frames, kind, 0];
    let mut file: Vec<u8> = numbers.iter().flat_map(|n: &i32| n.to_be_bytes()).collect();
    file.resize(284, 0);
    file.extend(data);
    file
}

#[test]
fn overlays_are_read_in_every_type_and_whichever_side_is_filled() {
    let surface = gifti(&PLAIN.surface(&scanner()));
    let numbers = |file: &[u8], column: Option<usize>| {
        let files = SurfaceFiles {
            surface: &surface,
            values: Some(file),
        };
        read(files, None, None, column).map(|read| read.values)
    };
    let bytes = |values: &[f32]| {
        values
            .iter()
            .flat_map(|x| x.to_be_bytes())
            .collect::<Vec<_>>()
    };
    for sides in [[4, 1, 1], [1, 1, 4]] {
        let file = overlay(sides, 1, (3, &bytes(&VALUES)));
        assert_eq!(numbers(&file, None).unwrap()[..3], VALUES[..3]);
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(&file).unwrap();
        assert_eq!(
            numbers(&packed.finish().unwrap(), None).unwrap()[..3],
            VALUES[..3]
        );
    }
    for (kind, data) in [
        (0, vec![0, 1, 2, 200]),
        (4, vec![0, 0, 0, 1, 0, 2, 0, 200]),
        (1, vec![0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 200]),
    ] {
        let file = overlay([4, 1, 1], 1, (kind, &data));
        assert_eq!(numbers(&file, None).unwrap(), [0.0, 1.0, 2.0, 200.0]);
    }
    let two = overlay(
        [4, 1, 1],
        2,
        (3, &bytes(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])),
    );
    assert_eq!(numbers(&two, None).unwrap_err().kind(), "values-column");
    assert_eq!(numbers(&two, Some(2)).unwrap(), [5.0, 6.0, 7.0, 8.0]);
    for (file, kind) in [
        (
            overlay([4, 1, 1], 1, (3, &bytes(&VALUES[..3]))),
            "surface-damaged",
        ),
        (
            overlay([2, 2, 1], 1, (3, &bytes(&VALUES))),
            "surface-unsupported",
        ),
        (
            overlay([4, 1, 1], 1, (9, &bytes(&VALUES))),
            "surface-unsupported",
        ),
        (overlay([i32::MAX, 1, 1], 1, (3, &[])), "surface-too-large"),
        (overlay([4, 1, 1], i32::MAX, (3, &[])), "surface-too-large"),
        (overlay([4, 1, -1], 1, (3, &[])), "surface-damaged"),
        (
            overlay([5, 1, 1], 1, (0, &[1; 5])),
            "values-of-another-surface",
        ),
    ] {
        assert_eq!(numbers(&file, None).unwrap_err().kind(), kind);
    }
}

/// An annotation of four vertices, whose table is of the newer or the older kind.
fn annotation(is_newer: bool) -> Vec<u8> {
    let mut file: Vec<u8> = [4, 0, 0x03_02_01, 1, 0x06_05_04, 2, 0, 3, 0x03_02_01, 1]
        .iter()
        .flat_map(|n: &i32| n.to_be_bytes())
        .collect();
    let mut put = |numbers: &[i32], text: &str| {
        file.extend(numbers.iter().flat_map(|n| n.to_be_bytes()));
        file.extend((text.len() as i32).to_be_bytes());
        file.extend(text.as_bytes());
    };
    let entries = [
        (0, "unknown\0", [9, 9, 9]),
        (1, "insula\0", [1, 2, 3]),
        (2, "cuneus\0", [4, 5, 6]),
    ];
    let mut color: Vec<i32> = match is_newer {
        true => {
            put(&[-2, 3], "a table\0");
            vec![3]
        }
        false => {
            put(&[3], "a table\0");
            Vec::new()
        }
    };
    for (number, name, parts) in entries {
        if is_newer {
            color.push(number);
        }
        put(&color, name);
        color = [&parts[..], &[0]].concat();
    }
    file.extend(color.iter().flat_map(|n| n.to_be_bytes()));
    file
}

#[test]
fn annotations_are_labels_with_names() {
    let surface = freesurfer(&PLACES, &TRIANGLES, &footer(1));
    for is_newer in [true, false] {
        let file = annotation(is_newer);
        let read = read_both(&surface, Some(&file)).unwrap();
        assert!(read.are_labels);
        assert_eq!(read.values, [1.0, 2.0, 0.0, 1.0]);
        let names: Vec<_> = read
            .names
            .iter()
            .map(|(key, name)| (*key, &**name))
            .collect();
        assert_eq!(names, [(0, "unknown"), (1, "insula"), (2, "cuneus")]);
        for end in 0..file.len() {
            assert!(read_both(&surface, Some(&file[..end])).is_err(), "{end}");
        }
        let mut beyond = file.clone();
        beyond[12..16].copy_from_slice(&4i32.to_be_bytes());
        let refused = read_both(&surface, Some(&beyond)).unwrap_err();
        assert_eq!(refused.kind(), "surface-damaged");
    }
}

#[test]
fn what_is_drawn_states_labels_names_and_the_places_of_vertices() {
    let lps = DAffine3::from_translation(DVec3::new(20.0, -20.0, 0.0));
    let drawing = Drawing {
        size: [16; 3],
        patient_from_voxel: [
            [1.0, 0.0, 0.0, lps.translation.x],
            [0.0, 1.0, 0.0, lps.translation.y],
            [0.0, 0.0, 1.0, lps.translation.z],
            [0.0, 0.0, 0.0, 1.0],
        ],
        space: Some(Space::Scanner),
        column: None,
        are_labels: None,
    };
    let file = freesurfer(&PLACES, &TRIANGLES, &footer(1));
    let limits = imaging::Limits::default();
    let draw = |values: &[Option<&[u8]>], drawing: &Drawing| {
        let files: Vec<_> = values
            .iter()
            .map(|&values| SurfaceFiles {
                surface: &file,
                values,
            })
            .collect();
        imaging::surface::draw(&files, None, drawing, &limits)
    };
    let seen = |volume: &[u8]| {
        let read = imaging::nifti::read_values(volume, &limits).unwrap();
        let defined = read.numbers.into_iter().filter(|number| !number.is_nan());
        defined
            .map(|number| number as i32)
            .collect::<std::collections::BTreeSet<_>>()
    };
    let (volume, drawn) = draw(&[None], &drawing).unwrap();
    assert!(drawn.are_labels);
    assert_eq!(drawn.names, [(1, "surface 1".to_owned())].into());
    assert_eq!(seen(&volume), [1].into());
    let places = imaging::surface::places(&volume).unwrap();
    assert_eq!([places.len(), places[0].len()], [1, 4]);
    for (found, [x, y, z]) in places[0].iter().zip(PLACES) {
        assert!(found.distance(DVec3::new(-f64::from(x), -f64::from(y), z.into())) < 0.01);
    }
    let (values, annotation) = (curv(&VALUES), annotation(true));
    let (volume, drawn) = draw(&[Some(&values)], &drawing).unwrap();
    assert!(!drawn.are_labels);
    assert!(imaging::surface::places(&volume).is_some());
    let (volume, drawn) = draw(&[Some(&annotation)], &drawing).unwrap();
    assert!(drawn.are_labels);
    assert_eq!(seen(&volume), [0, 1, 2].into());
    let as_map = Drawing {
        are_labels: Some(false),
        ..drawing.clone()
    };
    assert!(!draw(&[Some(&annotation)], &as_map).unwrap().1.are_labels);
    assert_eq!(draw(&[None], &as_map).unwrap_err().kind(), "values-missing");
    // Beside a surface with values, one without any would have invented ones.
    let valued = gifti(&(PLAIN.surface(&scanner()) + &PLAIN.values(&VALUES)));
    let files = [&valued, &file].map(|surface| SurfaceFiles {
        surface,
        values: None,
    });
    let mixed = imaging::surface::draw(&files, None, &drawing, &limits);
    assert_eq!(mixed.unwrap_err().kind(), "values-missing");
    let mut other = annotation.clone();
    let name = other.windows(6).position(|six| six == b"insula").unwrap();
    other[name] = b'I';
    let refused = draw(&[Some(&annotation), Some(&other)], &drawing).unwrap_err();
    assert_eq!(refused.kind(), "labels-differ");
    let plain =
        imaging::nifti::write_numbers(&Grid::new([8; 3], lps).unwrap(), &[0.0; 512]).unwrap();
    assert_eq!(imaging::surface::places(&plain), None);
}

#[test]
fn hostile_gifti_is_refused() {
    let sound =
        String::from_utf8(gifti(&(PLAIN.surface(&scanner()) + &PLAIN.values(&VALUES)))).unwrap();
    assert!(read_both(sound.as_bytes(), None).is_ok());
    for end in 0..sound.trim_end().len() {
        assert!(read_both(&sound.as_bytes()[..end], None).is_err(), "{end}");
    }
    let bomb = "<!DOCTYPE GIFTI [<!ENTITY a \"aaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]>";
    let doctype = "<!DOCTYPE GIFTI SYSTEM \"http://www.nitrc.org/frs/download.php/115/gifti.dtd\">";
    for (found, instead, kind) in [
        (doctype, bomb, "surface-unsupported"),
        (
            "<MetaData/>",
            "<MetaData>&secret;</MetaData>",
            "surface-unsupported",
        ),
        (
            "ExternalFileName=\"\"",
            "ExternalFileName=\"/etc/passwd\"",
            "surface-unsupported",
        ),
        ("Base64Binary", "ExternalFileBinary", "surface-unsupported"),
        ("Dim0=\"4\"", "Dim0=\"4000000\"", "surface-too-large"),
        ("Dim0=\"4\"", "Dim0=\"5\"", "surface-damaged"),
        (
            "Dim0=\"4\"",
            "Dim0=\"18446744073709551615\"",
            "surface-too-large",
        ),
        ("Dim0=\"4\"", "Dim0=\"-4\"", "surface-damaged"),
        (
            "Dimensionality=\"2\"",
            "Dimensionality=\"9\"",
            "surface-unsupported",
        ),
        (
            "NIFTI_TYPE_FLOAT32",
            "NIFTI_TYPE_FLOAT64",
            "surface-unsupported",
        ),
        ("NIFTI_TYPE_FLOAT32", "NIFTI_TYPE_INT32", "surface-damaged"),
        ("LittleEndian", "MiddleEndian", "surface-damaged"),
        ("RowMajorOrder", "AnyOrder", "surface-damaged"),
        (
            "NIFTI_INTENT_POINTSET",
            "NIFTI_INTENT_TRIANGLE",
            "surface-damaged",
        ),
        ("<Data>\n", "<Data>\n!", "surface-damaged"),
        ("<Data>", "<Date>", "surface-damaged"),
        ("</GIFTI>", "</GIFTI><GIFTI>", "surface-damaged"),
        ("\n<MetaData/>", &"<a>".repeat(100), "surface-damaged"),
    ] {
        let file = sound.replacen(found, instead, 1);
        assert_ne!(file, sound, "{found}");
        let mut kinds = String::new();
        let used = allocation_counter::measure(|| {
            kinds = read_both(file.as_bytes(), None)
                .unwrap_err()
                .kind()
                .to_owned();
        });
        assert_eq!(kinds, kind, "{instead}");
        assert!(used.bytes_max < 1 << 20, "{instead}: {used:?}");
    }
    // An array that unpacks to far more than it states.
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    packed.write_all(&vec![0; 200 << 20]).unwrap();
    let packed = BASE64_STANDARD.encode(packed.finish().unwrap());
    let (before, after) = sound.split_once("<Data>").unwrap();
    let (_, after) = after.split_once("</Data>").unwrap();
    let before = before.replace("\"Base64Binary\"", "\"GZipBase64Binary\"");
    let bomb = format!("{before}<Data>{packed}</Data>{after}");
    let used = allocation_counter::measure(|| {
        let refused = read_both(bomb.as_bytes(), None).unwrap_err();
        assert_eq!(refused.kind(), "surface-damaged");
    });
    assert!(used.bytes_max < 4 << 20, "{used:?}");
}

#[test]
fn no_changed_byte_makes_a_reader_panic_or_a_vertex_without_a_place() {
    let both = PLAIN.surface(&scanner()) + &PLAIN.values(&VALUES);
    let ascii = Writing {
        encoding: "ASCII",
        ..PLAIN
    };
    let ascii = ascii.surface(&scanner()) + &ascii.values(&VALUES);
    let values = curv(&VALUES);
    let annotation = annotation(true);
    for at in 0..annotation.len() {
        for with in [0, 1, 0x80, 0xff] {
            let mut changed = annotation.clone();
            changed[at] = with;
            // Whatever comes of it.
            let _read = read_both(&gifti(&PLAIN.surface(&scanner())), Some(&changed));
        }
    }
    for (file, values) in [
        (gifti(&both), None),
        (gifti(&ascii), None),
        (
            freesurfer(&PLACES, &TRIANGLES, &footer(1)),
            Some(&values[..]),
        ),
    ] {
        for at in 0..file.len() {
            for with in [0, b'<', b'9', 0x80, 0xff] {
                let mut changed = file.clone();
                changed[at] = with;
                let Ok(read) = read_both(&changed, values) else {
                    continue;
                };
                let vertices = read.positions_in_patient.len();
                assert_eq!(read.values.len(), vertices);
                assert!(
                    read.positions_in_patient
                        .iter()
                        .all(|place| place.is_finite())
                );
                let mut numbers = read.triangles.as_flattened().iter();
                assert!(numbers.all(|&number| (number as usize) < vertices));
            }
        }
    }
}

#[test]
fn a_sheet_holds_the_values_of_the_nearest_place_and_nothing_elsewhere() {
    let surface = |values: [f32; 4]| {
        let file = freesurfer(&PLACES, &TRIANGLES, &footer(1));
        let files = SurfaceFiles {
            surface: &file,
            values: Some(&curv(&values)),
        };
        read(files, None, Some(Space::Scanner), None).unwrap()
    };
    // 1 mm from patient (25, −20, 0) on, to the left, the back and the head.
    let place = DAffine3::from_translation(DVec3::new(25.0, -20.0, 0.0));
    let grid = Grid::new([12, 16, 16], place).unwrap();
    let at = |x: f64, y: f64, z: f64| grid.nearest(DVec3::new(x - 25.0, y + 20.0, z)).unwrap();
    let plane = sheet(&[surface([0.0, 4.0, 40.0, 44.0])], &grid, false).unwrap();
    assert_eq!(plane.thickness_mm, 2.0);
    // The square from (30, −14, 5) to (30, −10, 9) at x = 30: values rise by 1 along −y, and by 10 along z.
    for (x, defined) in [
        (28.0, false),
        (29.0, true),
        (30.0, true),
        (31.0, true),
        (32.0, false),
    ] {
        let value = plane.numbers[at(x, -12.0, 7.0)];
        assert_eq!(!value.is_nan(), defined, "{x}");
        assert!(!defined || (value - 22.0).abs() < 1e-4, "{x}: {value}");
    }
    assert!((plane.numbers[at(30.0, -10.0, 5.0)]).abs() < 1e-4);
    assert!((plane.numbers[at(30.0, -14.0, 9.0)] - 44.0).abs() < 1e-4);
    assert!(plane.numbers[at(30.0, -16.0, 7.0)].is_nan());
    let labels = sheet(&[surface([1.0, 2.0, 300.0, 2.0])], &grid, true).unwrap();
    let seen: std::collections::BTreeSet<_> = labels
        .numbers
        .iter()
        .filter(|number| !number.is_nan())
        .map(|&number| number as u32)
        .collect();
    assert_eq!(seen, [1, 2, 300].into());
    // A vertex without a value leaves a hole.
    let hole = sheet(&[surface(VALUES)], &grid, false).unwrap();
    assert!(hole.numbers[at(30.0, -14.0, 9.0)].is_nan());
    assert!(!hole.numbers[at(30.0, -10.0, 5.0)].is_nan());

    let elsewhere = Grid::new([8; 3], DAffine3::IDENTITY).unwrap();
    let refused = sheet(&[surface([1.0; 4])], &elsewhere, false).unwrap_err();
    assert_eq!(refused.kind(), "layer-outside-head");
    let mut huge = surface([1.0; 4]);
    huge.positions_in_patient[3] = DVec3::splat(9e4);
    assert_eq!(
        sheet(&[huge], &grid, false).unwrap_err().kind(),
        "surface-too-large"
    );
}

#[test]
fn what_was_erased_by_hand_is_no_brain_of_a_subject() {
    let limits = imaging::Limits::default();
    let grid = Grid::new([4; 3], DAffine3::IDENTITY).unwrap();
    let write = |of: fn(usize) -> f32| {
        let numbers: Vec<_> = (0..64).map(of).collect();
        imaging::nifti::write_numbers(&grid, &numbers).unwrap()
    };
    let head = write(|at| at as f32);
    let voxels = |brain: Vec<u8>| {
        let mut read = |name: &str| {
            Ok(match name {
                "mri/T1.mgz" => Some(head.clone()),
                "mri/brainmask.mgz" => Some(brain.clone()),
                _ => None,
            })
        };
        let subject = imaging::surface::subject(&mut read, &limits)
            .unwrap()
            .unwrap();
        let mask = imaging::nifti::read_mask(&subject.mask.unwrap(), &limits).unwrap();
        mask.voxels().iter().filter(|belongs| **belongs).count()
    };
    let intensities = write(|at| [0.0, 1.0, 90.0, 110.0][at % 4]);
    assert_eq!(voxels(intensities), 32);
    let plain = write(|at| f32::from(u8::from(at % 4 > 0)));
    assert_eq!(voxels(plain), 48);
}
