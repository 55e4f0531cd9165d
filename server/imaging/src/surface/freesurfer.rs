//! FreeSurfer's binary triangle surfaces, its `curv` files of the new kind, overlays in MGH files and annotations, big-endian.

use glam::{DMat3, DVec3};

use std::collections::BTreeMap;
use std::io::Read as _;

use flate2::read::MultiGzDecoder;

use super::{
    Columns, MAX_VERTICES, StatedSpace, Surface, SurfaceError, check_counts, checked,
    scanner_from_tkregister,
};
use crate::nifti::{GZIP_MAGIC, looks_like_header};

pub(super) const TRIANGLES_MAGIC: [u8; 3] = [0xff, 0xff, 0xfe];
pub(super) const VALUES_MAGIC: [u8; 3] = [0xff; 3];

/// The bytes of the header of an MGH file.
const MGH_HEADER: u64 = 284;

/// The most numbers of an overlay.
const MAX_NUMBERS: u64 = 16 * MAX_VERTICES as u64;

/// The most entries of a table of colours, and the longest name.
const MAX_LABELS: u64 = 65_535;
const MAX_NAME_BYTES: u64 = 1024;

/// The longest line of a footer or a title that is looked at.
const MAX_FOOTER_BYTES: usize = 64 << 10;

/// The tags of a footer: whether coordinates are scanner RAS, and the geometry of the volume.
const REAL_RAS_TAG: i32 = 2;
const GEOMETRY_TAG: i32 = 20;

/// The most that the directions of the axes of a volume may deviate from unit length.
const UNIT: f64 = 1e-2;

fn damaged(part: &'static str, what: &str) -> SurfaceError {
    let what = what.to_owned();
    SurfaceError::Damaged { part, what }
}

/// The next bytes, which are then behind.
fn take<'a>(rest: &mut &'a [u8], count: u64, part: &'static str) -> Result<&'a [u8], SurfaceError> {
    let count = usize::try_from(count).unwrap_or(usize::MAX);
    let (bytes, behind) = rest
        .split_at_checked(count)
        .ok_or_else(|| damaged(part, "it ends too early"))?;
    *rest = behind;
    Ok(bytes)
}

fn count(rest: &mut &[u8], part: &'static str) -> Result<u64, SurfaceError> {
    let bytes = take(rest, 4, part)?.try_into().expect("four bytes");
    u64::try_from(i32::from_be_bytes(bytes)).map_err(|_| damaged(part, "a count is negative"))
}

/// Reads a surface.
pub(super) fn surface(bytes: &[u8]) -> Result<Surface, SurfaceError> {
    const PART: &str = "surface";
    let title = bytes.windows(2).position(|two| two == b"\n\n");
    let start = title
        .filter(|&at| at < MAX_FOOTER_BYTES)
        .ok_or_else(|| damaged(PART, "it has no title"))?;
    let mut rest = &bytes[start + 2..];
    let [vertices, triangles] = [count(&mut rest, PART)?, count(&mut rest, PART)?];
    check_counts(vertices, triangles)?;
    let places = take(&mut rest, 12 * vertices, PART)?;
    let numbers = take(&mut rest, 12 * triangles, PART)?;
    let four = |four: &[u8; 4]| *four;
    let places: Vec<f32> = (places.as_chunks().0.iter().map(four))
        .map(f32::from_be_bytes)
        .collect();
    // A negative number becomes one that no surface has.
    let numbers: Vec<u32> = (numbers.as_chunks().0.iter().map(four))
        .map(u32::from_be_bytes)
        .collect();
    checked(Surface {
        positions: places.as_chunks().0.to_vec(),
        triangles: numbers.as_chunks().0.to_vec(),
        space: space_of(rest)?,
    })
}

/// The space that a footer states: first, perhaps, whether coordinates are scanner RAS, and then the geometry of the volume.
fn space_of(footer: &[u8]) -> Result<StatedSpace, SurfaceError> {
    let footer = &footer[..footer.len().min(MAX_FOOTER_BYTES)];
    let stated = footer.strip_prefix(&REAL_RAS_TAG.to_be_bytes());
    let Some((stated, rest)) = stated.and_then(<[u8]>::split_first_chunk) else {
        return Ok(StatedSpace::Tkregister(volume_of(footer)?));
    };
    match i32::from_be_bytes(*stated) {
        0 => Ok(StatedSpace::Tkregister(volume_of(rest)?)),
        1 => Ok(StatedSpace::Scanner(glam::DAffine3::IDENTITY)),
        other => {
            let what = format!("a footer with the space {other}, which is neither 0 nor 1");
            let part = "surface";
            Err(SurfaceError::Unsupported { part, what })
        }
    }
}

/// The way to scanner RAS that a footer states; `None` if there is none, or one that says of itself that it is not valid.
fn volume_of(footer: &[u8]) -> Result<Option<glam::DAffine3>, SurfaceError> {
    let broken = || damaged("surface", "its footer is not a volume geometry");
    let Some(text) = footer.strip_prefix(&GEOMETRY_TAG.to_be_bytes()) else {
        return Ok(None);
    };
    // Other tags may follow, which are not text.
    let lines = text.split(|&byte| byte == b'\n').take(8);
    let mut found = std::collections::HashMap::new();
    for line in lines {
        let line = std::str::from_utf8(line).map_err(|_| broken())?;
        let Some((key, value)) = line.split_once('=') else {
            break;
        };
        let value = value.split('#').next().unwrap_or_default();
        found.insert(key.trim(), value.trim());
    }
    match found.get("valid") {
        Some(&"1") => {}
        Some(&"0") => return Ok(None),
        _ => return Err(broken()),
    }
    let vector = |key: &str| {
        let words = found.get(key).ok_or_else(broken)?.split_whitespace();
        let numbers: Result<Vec<f64>, _> = words.map(str::parse).collect();
        let numbers: [f64; 3] = numbers
            .map_err(|_| broken())?
            .try_into()
            .map_err(|_| broken())?;
        let vector = DVec3::from_array(numbers);
        (vector.is_finite() && vector.abs().max_element() < 1e5)
            .then_some(vector)
            .ok_or_else(broken)
    };
    let directions = DMat3::from_cols(vector("xras")?, vector("yras")?, vector("zras")?);
    let is_unit = |axis: usize| (directions.col(axis).length() - 1.0).abs() < UNIT;
    if !(0..3).all(is_unit) || directions.determinant().abs() < 0.5 {
        return Err(broken());
    }
    Ok(Some(scanner_from_tkregister(directions, vector("cras")?)))
}

/// Reads values.
pub(super) fn values(bytes: &[u8]) -> Result<Vec<f32>, SurfaceError> {
    const PART: &str = "values";
    let mut rest = &bytes[VALUES_MAGIC.len()..];
    let [vertices, _triangles, each] = [
        count(&mut rest, PART)?,
        count(&mut rest, PART)?,
        count(&mut rest, PART)?,
    ];
    if each != 1 {
        let what = format!("{each} values for each vertex");
        return Err(SurfaceError::Unsupported { part: PART, what });
    }
    check_counts(vertices, 0)?;
    let values = take(&mut rest, 4 * vertices, PART)?;
    if !rest.is_empty() {
        return Err(damaged(PART, "bytes follow its last value"));
    }
    let values = values.as_chunks().0.iter();
    Ok(values.map(|&four| f32::from_be_bytes(four)).collect())
}

/// Whether bytes begin as an MGH file, gzipped or not.
pub(super) fn looks_like_mgh(bytes: &[u8]) -> bool {
    let mut start = Vec::new();
    match bytes.starts_with(&GZIP_MAGIC) {
        true => {
            let unpacked = MultiGzDecoder::new(bytes).take(4).read_to_end(&mut start);
            unpacked.is_ok() && start == 1u32.to_be_bytes()
        }
        false => bytes.starts_with(&1u32.to_be_bytes()) && looks_like_header(bytes),
    }
}

/// Reads an overlay: a column for each frame, one number of it for each vertex.
pub(super) fn overlay(bytes: &[u8]) -> Result<Columns, SurfaceError> {
    const PART: &str = "values";
    let mut file: Box<dyn std::io::Read> = match bytes.starts_with(&GZIP_MAGIC) {
        true => Box::new(MultiGzDecoder::new(bytes)),
        false => Box::new(bytes),
    };
    let mut read = |length: u64| {
        let mut found = Vec::new();
        let read = file.by_ref().take(length).read_to_end(&mut found);
        let is_whole = read.is_ok() && found.len() as u64 == length;
        is_whole
            .then_some(found)
            .ok_or_else(|| damaged(PART, "it ends too early"))
    };
    let header = read(MGH_HEADER)?;
    let mut rest = &header[4..];
    let mut whole = || count(&mut rest, PART);
    let [sides @ .., frames, kind] = [whole()?, whole()?, whole()?, whole()?, whole()?];
    // FreeSurfer fills one side, whichever it is.
    let vertices = sides
        .iter()
        .try_fold(1u64, |product, &side| product.checked_mul(side));
    let vertices = vertices.unwrap_or(u64::MAX);
    if sides.iter().filter(|&&side| side != 1).count() > 1 {
        let what = format!(
            "a volume of {} × {} × {} voxels",
            sides[0], sides[1], sides[2]
        );
        return Err(SurfaceError::Unsupported { part: PART, what });
    }
    check_counts(vertices, 0)?;
    let numbers = vertices.saturating_mul(frames);
    if numbers > MAX_NUMBERS {
        let (what, count, most) = ("numbers of values", numbers, MAX_NUMBERS);
        return Err(SurfaceError::TooMany { what, count, most });
    }
    let size = match kind {
        0 => 1,
        4 | 10 => 2,
        1 | 3 => 4,
        kind => {
            let what = format!("the MGH data type {kind}");
            return Err(SurfaceError::Unsupported { part: PART, what });
        }
    };
    let data = read(numbers * size)?;
    let numbers: Vec<f32> = match kind {
        0 => data.iter().map(|&byte| byte.into()).collect(),
        1 => fours(&data)
            .map(|four| i32::from_be_bytes(four) as f32)
            .collect(),
        3 => fours(&data).map(f32::from_be_bytes).collect(),
        4 => twos(&data)
            .map(|two| i16::from_be_bytes(two).into())
            .collect(),
        _ => twos(&data)
            .map(|two| u16::from_be_bytes(two).into())
            .collect(),
    };
    let columns = numbers.chunks(vertices.max(1) as usize);
    Ok(Columns {
        columns: columns.map(<[f32]>::to_vec).collect(),
        ..Columns::default()
    })
}

fn fours(bytes: &[u8]) -> impl Iterator<Item = [u8; 4]> {
    bytes.as_chunks().0.iter().copied()
}

fn twos(bytes: &[u8]) -> impl Iterator<Item = [u8; 2]> {
    bytes.as_chunks().0.iter().copied()
}

/// Whether bytes may be an annotation: it has no magic word, but a pair for each vertex, of which the first is of the vertex 0, and then the mark
/// of a table.
pub(super) fn looks_like_annotation(bytes: &[u8]) -> bool {
    let number = |at: usize| {
        let four = bytes.get(at..at.checked_add(4)?)?.try_into().ok()?;
        Some(i32::from_be_bytes(four))
    };
    let after = number(0).filter(|&count| (1..=MAX_VERTICES as i32).contains(&count));
    let after = after.map(|count| 4 + 8 * count as usize);
    number(4) == Some(0) && after.is_some_and(|at| [Some(1), None].contains(&number(at)))
}

/// Reads an annotation: the number of the label of each vertex, and the names. Vertices without a label have 0.
pub(super) fn annotation(bytes: &[u8]) -> Result<Columns, SurfaceError> {
    const PART: &str = "values";
    let mut rest = bytes;
    let vertices = count(&mut rest, PART)?;
    check_counts(vertices, 0)?;
    let pairs = take(&mut rest, 8 * vertices, PART)?;
    if rest.is_empty() {
        let what = "an annotation without a table of colours".to_owned();
        return Err(SurfaceError::Unsupported { part: PART, what });
    }
    let [_mark, version] = [signed(&mut rest, PART)?, signed(&mut rest, PART)?];
    // The older kind states the number of entries there, the newer one its version, below 0.
    let entries = match version {
        1.. => {
            text(&mut rest, PART)?;
            version as u64
        }
        -2 => {
            let _highest = count(&mut rest, PART)?;
            text(&mut rest, PART)?;
            count(&mut rest, PART)?
        }
        other => {
            let what = format!("an annotation whose table is of the version {other}");
            return Err(SurfaceError::Unsupported { part: PART, what });
        }
    };
    if entries > MAX_LABELS {
        let (what, count, most) = ("labels", entries, MAX_LABELS);
        return Err(SurfaceError::TooMany { what, count, most });
    }
    let mut numbers = BTreeMap::new();
    let mut names = BTreeMap::new();
    for place in 0..entries {
        let number = match version {
            1.. => place,
            _ => count(&mut rest, PART)?,
        };
        let number =
            u32::try_from(number).map_err(|_| damaged(PART, "a label is beyond all bounds"))?;
        let name = text(&mut rest, PART)?;
        let [red, green, blue, transparency] = [(); 4].map(|()| count(&mut rest, PART));
        transparency?;
        let color = [red?, green?, blue?];
        if color.iter().any(|&part| part > 255) {
            return Err(damaged(PART, "a colour is not one of 8 bits"));
        }
        numbers.insert(color[0] | color[1] << 8 | color[2] << 16, number);
        names.insert(number, name);
    }
    let mut labels = vec![0.0; vertices as usize];
    for pair in pairs.as_chunks::<8>().0 {
        let [vertex, color] =
            [0, 4].map(|at| u32::from_be_bytes(pair[at..at + 4].try_into().expect("four bytes")));
        let label = labels
            .get_mut(vertex as usize)
            .ok_or_else(|| damaged(PART, "it names a vertex that it does not have"))?;
        // What is in no table has no label: FreeSurfer gives such vertices the colour 0.
        *label = numbers
            .get(&u64::from(color))
            .map_or(0.0, |&number| number as f32);
    }
    Ok(Columns {
        columns: vec![labels],
        names,
        are_labels: true,
    })
}

fn signed(rest: &mut &[u8], part: &'static str) -> Result<i32, SurfaceError> {
    let bytes = take(rest, 4, part)?.try_into().expect("four bytes");
    Ok(i32::from_be_bytes(bytes))
}

/// A text with its length before it, and a zero at its end.
fn text(rest: &mut &[u8], part: &'static str) -> Result<String, SurfaceError> {
    let length = count(rest, part)?;
    if length > MAX_NAME_BYTES {
        return Err(damaged(part, "a name is too long"));
    }
    let bytes = take(rest, length, part)?;
    let text = bytes.split(|&byte| byte == 0).next().unwrap_or_default();
    Ok(String::from_utf8_lossy(text).into_owned())
}
