//! JPEG, lossless and baseline, of one component.

use jpeg_decoder::{CodingProcess, Decoder, PixelFormat};

/// Decodes one frame into unsigned samples.
pub(super) fn decode(packed: &[u8], [columns, rows]: [usize; 2]) -> Result<Vec<u16>, &'static str> {
    let mut decoder = Decoder::new(packed);
    decoder.set_max_decoding_buffer_size(2 * columns * rows);
    decoder
        .read_info()
        .map_err(|_| "its JPEG header is damaged")?;
    let info = decoder.info().ok_or("its JPEG header is damaged")?;
    if [usize::from(info.width), usize::from(info.height)] != [columns, rows] {
        return Err("the size of its JPEG image differs from the header");
    }
    let lossless = info.coding_process == CodingProcess::Lossless;
    let samples = decoder.decode().map_err(|_| "its JPEG image is damaged")?;
    match info.pixel_format {
        PixelFormat::L8 => Ok(samples.into_iter().map(u16::from).collect()),
        PixelFormat::L16 if lossless => {
            let pairs = samples.chunks_exact(2);
            let samples = pairs.map(|pair| u16::from_ne_bytes([pair[0], pair[1]]));
            Ok(samples.collect())
        }
        _ => Err("its JPEG image does not have exactly one grey component"),
    }
}
