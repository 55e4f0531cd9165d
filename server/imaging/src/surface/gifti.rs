//! GIFTI 1.0, strictly: no entities, no external files, the three data types of the standard.

use std::collections::BTreeMap;
use std::io::Read as _;

use base64::prelude::{BASE64_STANDARD, Engine as _};
use flate2::read::ZlibDecoder;
use glam::{DAffine3, DMat4, DVec4};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::{Columns, MAX_TRIANGLES, StatedSpace, Surface, SurfaceError, check_counts, checked};

/// The most arrays of a file.
const MAX_ARRAYS: usize = 512;

/// The most numbers of all arrays together.
const MAX_NUMBERS: u64 = 64 << 20;

/// The most labels of a table, and the longest name.
const MAX_LABELS: usize = 65_535;
const MAX_NAME_BYTES: usize = 1024;

/// The deepest nesting of elements.
const MAX_DEPTH: usize = 16;

const SCANNER: &str = "NIFTI_XFORM_SCANNER_ANAT";

/// Whether bytes begin as a GIFTI file may.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let start = bytes.trim_ascii_start();
    start.starts_with(b"<?xml") || start.starts_with(b"<GIFTI") || start.starts_with(b"<!DOCTYPE")
}

/// The data of a file.
#[derive(Debug, Default)]
struct File {
    arrays: Vec<Array>,
    names: BTreeMap<u32, String>,
}

/// The elements of an array in the order of rows.
#[derive(Debug)]
struct Array {
    intent: String,
    sides: Vec<usize>,
    numbers: Numbers,
    /// Those that were stated: the space of the data, the space that the matrix leads to, the matrix.
    spaces: Vec<[String; 3]>,
}

#[derive(Debug)]
enum Numbers {
    Whole(Vec<i32>),
    Real(Vec<f32>),
}

impl Numbers {
    fn real(self) -> Vec<f32> {
        match self {
            Self::Whole(numbers) => numbers.into_iter().map(|number| number as f32).collect(),
            Self::Real(numbers) => numbers,
        }
    }
}

/// Which part of the upload is read, for errors.
#[derive(Debug, Clone, Copy)]
struct Part(&'static str);

impl Part {
    fn damaged(self, what: impl Into<String>) -> SurfaceError {
        let what = what.into();
        SurfaceError::Damaged { part: self.0, what }
    }

    fn unsupported(self, what: impl Into<String>) -> SurfaceError {
        let what = what.into();
        SurfaceError::Unsupported { part: self.0, what }
    }
}

/// Reads a surface, and the values that are in the same file.
pub(super) fn surface(bytes: &[u8]) -> Result<(Surface, Columns), SurfaceError> {
    let part = Part("surface");
    let File { mut arrays, names } = read(bytes, part)?;
    let mut take = |intent: &str| {
        let place = arrays.iter().position(|array| array.intent == intent);
        let array = place.map(|place| arrays.remove(place));
        array.ok_or_else(|| part.damaged(format!("it has no array NIFTI_INTENT_{intent}")))
    };
    let (points, triangles) = (take("POINTSET")?, take("TRIANGLE")?);
    if arrays
        .iter()
        .any(|array| ["POINTSET", "TRIANGLE"].contains(&&*array.intent))
    {
        return Err(part.unsupported("several surfaces"));
    }
    let are_triples = |array: &Array| matches!(array.sides[..], [_, 3]);
    if !are_triples(&points) || !are_triples(&triangles) {
        return Err(part.damaged("its points or triangles are not triples"));
    }
    check_counts(points.sides[0] as u64, triangles.sides[0] as u64)?;
    let space = space_of(&points.spaces, part)?;
    let Numbers::Real(points) = points.numbers else {
        return Err(part.damaged("its points are not NIFTI_TYPE_FLOAT32"));
    };
    let Numbers::Whole(triangles) = triangles.numbers else {
        return Err(part.damaged("its triangles are not NIFTI_TYPE_INT32"));
    };
    // A negative number becomes one that no surface has.
    let triangles: Vec<_> = triangles.into_iter().map(|number| number as u32).collect();
    let surface = checked(Surface {
        positions: points.as_chunks().0.to_vec(),
        triangles: triangles.as_chunks().0.to_vec(),
        space,
    })?;
    Ok((surface, columns(arrays, names, part)?))
}

/// Reads values.
pub(super) fn values(bytes: &[u8]) -> Result<Columns, SurfaceError> {
    let part = Part("values");
    let File { mut arrays, names } = read(bytes, part)?;
    arrays.retain(|array| !["POINTSET", "TRIANGLE"].contains(&&*array.intent));
    columns(arrays, names, part)
}

fn columns(
    arrays: Vec<Array>,
    names: BTreeMap<u32, String>,
    part: Part,
) -> Result<Columns, SurfaceError> {
    let column = |array: Array| match array.sides[..] {
        [_] | [_, 1] => Ok(array.numbers.real()),
        _ => Err(part.unsupported("values with more than one dimension")),
    };
    Ok(Columns {
        are_labels: !arrays.is_empty() && arrays.iter().all(|array| array.intent == "LABEL"),
        columns: arrays.into_iter().map(column).collect::<Result<_, _>>()?,
        names,
    })
}

/// What a file states about the space of its points.
fn space_of(spaces: &[[String; 3]], part: Part) -> Result<StatedSpace, SurfaceError> {
    for [data, transformed, matrix] in spaces {
        if data.trim() == SCANNER {
            return Ok(StatedSpace::Scanner(DAffine3::IDENTITY));
        }
        if transformed.trim() == SCANNER {
            let words = matrix.split_whitespace().map(str::parse);
            let numbers: Vec<f64> = words
                .collect::<Result<_, _>>()
                .map_err(|_| part.damaged("its matrix is not 16 numbers"))?;
            let rows: [f64; 16] = numbers
                .try_into()
                .map_err(|_| part.damaged("its matrix is not 16 numbers"))?;
            let matrix = DMat4::from_cols_array(&rows).transpose();
            let is_affine = matrix.is_finite()
                && matrix.row(3) == DVec4::W
                && matrix.determinant().abs() > 1e-6;
            if !is_affine {
                return Err(part.damaged("its matrix is not an affine transform"));
            }
            return Ok(StatedSpace::Scanner(DAffine3::from_mat4(matrix)));
        }
    }
    Ok(StatedSpace::Nothing)
}

/// What an element states about an array.
#[derive(Debug, Default)]
struct Head {
    intent: String,
    kind: String,
    order: String,
    sides: Vec<usize>,
    encoding: String,
    endian: String,
}

fn read(bytes: &[u8], part: Part) -> Result<File, SurfaceError> {
    let mut reader = Reader::from_reader(bytes);
    let mut file = File::default();
    let mut path: Vec<Vec<u8>> = Vec::new();
    let mut head: Option<Head> = None;
    let (mut numbers, mut spaces) = (None, Vec::new());
    let mut label: Option<u32> = None;
    let mut text = String::new();
    let mut total = 0;
    loop {
        let event = reader.read_event();
        let event = event.map_err(|_| part.damaged("it is not well-formed XML"))?;
        match event {
            Event::DocType(kind) if kind.contains(&b'[') => {
                return Err(part.unsupported("a document type with declarations"));
            }
            Event::Start(element) => {
                path.push(element.name().as_ref().to_vec());
                if path.len() > MAX_DEPTH {
                    return Err(part.damaged("its elements are nested too deeply"));
                }
                text.clear();
                match &**path.last().expect("it was pushed") {
                    b"GIFTI" if path.len() > 1 => {
                        return Err(part.damaged("it has an element GIFTI in another one"));
                    }
                    b"DataArray" => {
                        if head.is_some() || file.arrays.len() == MAX_ARRAYS {
                            return Err(part.damaged("it has too many arrays"));
                        }
                        head = Some(head_of(&element, part)?);
                        (numbers, spaces) = (None, Vec::new());
                    }
                    b"CoordinateSystemTransformMatrix" => spaces.push(Default::default()),
                    b"Label" => label = Some(key_of(&element, part)?),
                    _ => {}
                }
            }
            Event::Empty(element) if element.name().as_ref() == b"Label" => {
                let key = key_of(&element, part)?;
                file.names.insert(key, String::new());
            }
            Event::Empty(element) if element.name().as_ref() == b"DataArray" => {
                return Err(part.damaged("an array has no data"));
            }
            Event::Text(piece) if is_data(&path) => {
                let head = head
                    .as_ref()
                    .ok_or_else(|| part.damaged("it has data without an array"))?;
                if numbers.is_some() {
                    return Err(part.damaged("an array has data twice"));
                }
                numbers = Some(decoded(head, &piece, &mut total, part)?);
            }
            Event::Text(piece) => {
                let piece = piece
                    .decode()
                    .map_err(|_| part.damaged("it is not UTF-8"))?;
                add(&mut text, &piece);
            }
            Event::CData(piece) => {
                let piece = piece
                    .decode()
                    .map_err(|_| part.damaged("it is not UTF-8"))?;
                add(&mut text, &piece);
            }
            Event::GeneralRef(reference) => {
                let known = match &*reference {
                    b"amp" => Some('&'),
                    b"lt" => Some('<'),
                    b"gt" => Some('>'),
                    b"quot" => Some('"'),
                    b"apos" => Some('\''),
                    _ => reference.resolve_char_ref().ok().flatten(),
                };
                let letter = known.ok_or_else(|| part.unsupported("an entity"))?;
                add(&mut text, letter.encode_utf8(&mut [0; 4]));
            }
            Event::End(_) => {
                let name = path.pop().unwrap_or_default();
                match &*name {
                    b"DataArray" => {
                        let Head { intent, sides, .. } = head.take().unwrap_or_default();
                        let numbers = numbers.take();
                        file.arrays.push(Array {
                            intent,
                            sides,
                            numbers: numbers.ok_or_else(|| part.damaged("an array has no data"))?,
                            spaces: std::mem::take(&mut spaces),
                        });
                    }
                    b"Label" => {
                        let key = label.take().unwrap_or_default();
                        file.names.insert(key, text.trim().to_owned());
                        if file.names.len() > MAX_LABELS {
                            return Err(part.damaged("it has too many labels"));
                        }
                    }
                    name => {
                        let place = match name {
                            b"DataSpace" => 0,
                            b"TransformedSpace" => 1,
                            b"MatrixData" => 2,
                            _ => continue,
                        };
                        if let Some(space) = spaces.last_mut() {
                            space[place] = std::mem::take(&mut text);
                        }
                    }
                }
            }
            Event::Eof => break,
            _ => {}
        }
    }
    if !path.is_empty() {
        return Err(part.damaged("it ends too early"));
    }
    Ok(file)
}

/// Adds to a text that is kept. What is longer than any that counts is cut off.
fn add(text: &mut String, piece: &str) {
    let room = MAX_NAME_BYTES.saturating_sub(text.len());
    text.push_str(&piece[..piece.floor_char_boundary(room)]);
}

fn is_data(path: &[Vec<u8>]) -> bool {
    matches!(path, [.., array, data] if array == b"DataArray" && data == b"Data")
}

/// The attributes of an element that are called so, as they stand there.
fn attribute(
    element: &BytesStart<'_>,
    name: &str,
    part: Part,
) -> Result<Option<String>, SurfaceError> {
    let found = element.try_get_attribute(name);
    let found = found.map_err(|_| part.damaged("it is not well-formed XML"))?;
    Ok(found.map(|found| String::from_utf8_lossy(&found.value).into_owned()))
}

fn key_of(element: &BytesStart<'_>, part: Part) -> Result<u32, SurfaceError> {
    // The first drafts of the format say Index.
    let key = attribute(element, "Key", part)?.or(attribute(element, "Index", part)?);
    let key: Option<i64> = key.and_then(|key| key.trim().parse().ok());
    // Workbench numbers regions that are not known below 0.
    let key = key.ok_or_else(|| part.damaged("a label has no number"))?;
    Ok(u32::try_from(key).unwrap_or_default())
}

fn head_of(element: &BytesStart<'_>, part: Part) -> Result<Head, SurfaceError> {
    let text =
        |name: &str| Ok::<_, SurfaceError>(attribute(element, name, part)?.unwrap_or_default());
    if !text("ExternalFileName")?.trim().is_empty() {
        return Err(part.unsupported("data in another file"));
    }
    let number = |name: &str| {
        let found: Option<usize> = text(name)?.trim().parse().ok();
        found.ok_or_else(|| part.damaged(format!("an array has no whole number {name}")))
    };
    let dimensions = number("Dimensionality")?;
    if !(1..=2).contains(&dimensions) {
        return Err(part.unsupported("an array with more than two dimensions"));
    }
    let sides = (0..dimensions).map(|axis| number(&format!("Dim{axis}")));
    Ok(Head {
        intent: text("Intent")?
            .trim_start_matches("NIFTI_INTENT_")
            .to_owned(),
        kind: text("DataType")?,
        order: text("ArrayIndexingOrder")?,
        sides: sides.collect::<Result<_, _>>()?,
        encoding: text("Encoding")?,
        endian: text("Endian")?,
    })
}

/// The numbers of an array, row by row.
fn decoded(head: &Head, text: &[u8], total: &mut u64, part: Part) -> Result<Numbers, SurfaceError> {
    let count = head
        .sides
        .iter()
        .try_fold(1u64, |count, &side| count.checked_mul(side as u64));
    let count = count.filter(|&count| count <= 3 * MAX_TRIANGLES as u64);
    *total = total.saturating_add(count.unwrap_or(u64::MAX));
    let Some(count) = count.filter(|_| *total <= MAX_NUMBERS) else {
        return Err(SurfaceError::TooMany {
            what: "numbers in its arrays",
            count: *total,
            most: MAX_NUMBERS,
        });
    };
    let count = count as usize;
    let is_big = match &*head.endian {
        // Older versions of nibabel write the names of constants.
        "LittleEndian" | "GIFTI_ENDIAN_LITTLE" => false,
        "BigEndian" | "GIFTI_ENDIAN_BIG" => true,
        _ if head.encoding == "ASCII" => false,
        _ => return Err(part.damaged("an array does not state its byte order")),
    };
    let size = match &*head.kind {
        "NIFTI_TYPE_UINT8" => 1,
        // Triangles of some programs are UINT32; no vertex has a number that differs.
        "NIFTI_TYPE_INT32" | "NIFTI_TYPE_UINT32" | "NIFTI_TYPE_FLOAT32" => 4,
        _ => {
            return Err(part
                .unsupported("an array that is not of the type UINT8, INT32, UINT32 or FLOAT32"));
        }
    };
    let is_real = head.kind == "NIFTI_TYPE_FLOAT32";
    let short = || part.damaged("an array has fewer or more numbers than it states");
    let numbers = if head.encoding == "ASCII" {
        let text = std::str::from_utf8(text).map_err(|_| part.damaged("it is not text"))?;
        let words = text.split_ascii_whitespace().take(count + 1);
        let broken = || part.damaged("an array has a word that is not a number");
        if is_real {
            let numbers = words.map(|word| word.parse().map_err(|_| broken()));
            Numbers::Real(numbers.collect::<Result<_, _>>()?)
        } else {
            let numbers = words.map(|word| word.parse().map_err(|_| broken()));
            Numbers::Whole(numbers.collect::<Result<_, _>>()?)
        }
    } else {
        let bytes = binary(head, text, count * size, part)?;
        let four = bytes.as_chunks::<4>().0.iter().map(|&four| match is_big {
            true => u32::from_be_bytes(four),
            false => u32::from_le_bytes(four),
        });
        match (size, is_real) {
            (1, _) => Numbers::Whole(bytes.iter().map(|&byte| byte.into()).collect()),
            (_, true) => Numbers::Real(four.map(f32::from_bits).collect()),
            (_, false) => Numbers::Whole(four.map(u32::cast_signed).collect()),
        }
    };
    let found = match &numbers {
        Numbers::Whole(numbers) => numbers.len(),
        Numbers::Real(numbers) => numbers.len(),
    };
    if found != count {
        return Err(short());
    }
    Ok(match (&*head.order, &head.sides[..]) {
        ("ColumnMajorOrder", &[rows, columns]) => match numbers {
            Numbers::Whole(numbers) => Numbers::Whole(turned(&numbers, rows, columns)),
            Numbers::Real(numbers) => Numbers::Real(turned(&numbers, rows, columns)),
        },
        ("RowMajorOrder" | "ColumnMajorOrder", _) => numbers,
        _ => return Err(part.damaged("an array does not state the order of its numbers")),
    })
}

fn binary(head: &Head, text: &[u8], length: usize, part: Part) -> Result<Vec<u8>, SurfaceError> {
    let packed: Vec<u8> = (text.iter().copied())
        .filter(|byte| !byte.is_ascii_whitespace())
        .collect();
    let packed = BASE64_STANDARD.decode(packed);
    let packed = packed.map_err(|_| part.damaged("an array is not Base64"))?;
    let bytes = match &*head.encoding {
        "Base64Binary" => packed,
        "GZipBase64Binary" => {
            let mut bytes = Vec::new();
            let most = length as u64 + 1;
            let read = ZlibDecoder::new(&packed[..])
                .take(most)
                .read_to_end(&mut bytes);
            read.map_err(|_| part.damaged("an array cannot be unpacked"))?;
            bytes
        }
        _ => {
            return Err(
                part.unsupported("an array that is encoded in another way than the standard knows")
            );
        }
    };
    match bytes.len() == length {
        true => Ok(bytes),
        false => Err(part.damaged("an array has fewer or more bytes than it states")),
    }
}

/// Columns as rows.
fn turned<T: Copy>(numbers: &[T], rows: usize, columns: usize) -> Vec<T> {
    let places = (0..rows).flat_map(|row| (0..columns).map(move |column| column * rows + row));
    places.map(|place| numbers[place]).collect()
}
