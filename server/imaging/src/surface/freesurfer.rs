//! FreeSurfer's binary triangle surfaces and its `curv` files of the new kind, big-endian.

use glam::{DMat3, DVec3};

use super::{StatedSpace, Surface, SurfaceError, check_counts, checked, scanner_from_tkregister};

pub(super) const TRIANGLES_MAGIC: [u8; 3] = [0xff, 0xff, 0xfe];
pub(super) const VALUES_MAGIC: [u8; 3] = [0xff; 3];

/// The longest line of a footer or a title that is looked at.
const MAX_FOOTER_BYTES: usize = 64 << 10;

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
        space: StatedSpace::Tkregister(volume_of(rest)?),
    })
}

/// The way to scanner RAS that a footer states; `None` if there is none, or one that says of itself that it is not valid.
fn volume_of(footer: &[u8]) -> Result<Option<glam::DAffine3>, SurfaceError> {
    let broken = || damaged("surface", "its footer is not a volume geometry");
    let footer = &footer[..footer.len().min(MAX_FOOTER_BYTES)];
    let newer = [2, 0, 20_i32].map(i32::to_be_bytes);
    let text = [newer.as_flattened(), &20_i32.to_be_bytes()]
        .into_iter()
        .find_map(|head| footer.strip_prefix(head));
    let Some(text) = text else { return Ok(None) };
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
