//! JPEG 2000 of one component, lossless or not.

use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image};

/// The markers at the start of a codestream: start of codestream, then image size.
const START: [u8; 4] = [0xFF, 0x4F, 0xFF, 0x51];

/// The part of the header that is checked before decoding (ISO/IEC 15444-1 A.5.1).
struct Size {
    signed: bool,
    bits: u32,
    is_exact: bool,
}

pub(super) struct Decoded {
    pub(super) samples: Vec<i32>,
    /// The number of bits of each, by the codestream.
    pub(super) bits: u32,
    /// Whether they are signed, by the codestream.
    pub(super) signed: bool,
    /// Whether the wavelet is the reversible one, so that bits mean what was encoded.
    pub(super) is_exact: bool,
}

pub(super) fn decode(packed: &[u8], [columns, rows]: [usize; 2]) -> Result<Decoded, &'static str> {
    const DAMAGED: &str = "its JPEG 2000 codestream is damaged";
    let size = read_size(packed, [columns, rows])?;
    let settings = DecodeSettings {
        resolve_palette_indices: false,
        strict: true,
        target_resolution: None,
    };
    let image = Image::new(packed, &settings).map_err(|_| DAMAGED)?;
    let mut context = DecoderContext::default();
    let decoded = image.decode(&mut context).map_err(|_| DAMAGED)?;
    let [component] = decoded.components() else {
        return Err("its JPEG 2000 image does not have exactly one grey component");
    };
    if component.samples().len() != columns * rows {
        return Err(DAMAGED);
    }
    // The decoder adds half the range to signed samples too.
    let half = if size.signed { 1 << (size.bits - 1) } else { 0 };
    let greatest = ((1u32 << size.bits) - 1) as f32;
    let sample = |&value: &f32| value.round().clamp(0.0, greatest) as i32 - half;
    let samples = component.samples().iter().map(sample).collect();
    Ok(Decoded {
        samples,
        bits: size.bits,
        signed: size.signed,
        is_exact: size.is_exact,
    })
}

/// Checks that the codestream has the size of the image, so that no header makes the decoder allocate more.
fn read_size(packed: &[u8], [columns, rows]: [usize; 2]) -> Result<Size, &'static str> {
    const CUT: &str = "its JPEG 2000 header is truncated";
    // In a JP2 file the codestream follows some boxes.
    let start = packed
        .windows(4)
        .take(4096)
        .position(|window| window == START)
        .ok_or(CUT)?;
    let size = packed.get(start + 6..start + 45).ok_or(CUT)?;
    let number =
        |at: usize| u32::from_be_bytes([size[at], size[at + 1], size[at + 2], size[at + 3]]);
    let [right, bottom, left, top] = [2, 6, 10, 14].map(number);
    let [tile_width, tile_height] = [18, 22].map(number);
    let components = u16::from_be_bytes([size[34], size[35]]);
    let fits = right.checked_sub(left) == Some(columns as u32)
        && bottom.checked_sub(top) == Some(rows as u32)
        && [left, top] == [0, 0];
    if !fits || components != 1 || size[37..39] != [1, 1] {
        return Err("the size of its JPEG 2000 image differs from the header");
    }
    // Each tile costs memory. An image of a head has one tile or a few.
    let tiles = |side: u32, tile: u32| u64::from(side).div_ceil(u64::from(tile.max(1)));
    if tile_width == 0
        || tile_height == 0
        || tiles(right, tile_width) * tiles(bottom, tile_height) > 4096
    {
        return Err("its JPEG 2000 image has too many tiles");
    }
    let bits = u32::from(size[36] & 0x7F) + 1;
    if bits > 16 {
        return Err("its JPEG 2000 image has more than 16 bits");
    }
    // The coding style follows: its marker, and the transformation after 13 bytes (A.6.1).
    let style = packed.get(start + 45..start + 59);
    Ok(Size {
        is_exact: style.is_some_and(|style| style[..2] == [0xFF, 0x52] && style[13] == 1),
        signed: size[36] & 0x80 != 0,
        bits,
    })
}
