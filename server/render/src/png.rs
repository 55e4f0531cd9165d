//! PNG files with the notice and metadata.

use std::borrow::Cow;

use crate::{Frame, PixelFormat, RESEARCH_USE_NOTICE, RenderError};

/// Encodes a picture as PNG, grey as grey, with [`RESEARCH_USE_NOTICE`] and the given texts (keyword, value).
///
/// Texts in Latin-1 become `tEXt` chunks, others `iTXt`.
///
/// # Errors
/// If a keyword is not 1 to 79 printable Latin-1 characters.
pub fn encode_png(frame: &Frame, texts: &[(&str, String)]) -> Result<Vec<u8>, RenderError> {
    let mut bytes = Vec::with_capacity(frame.bytes().len() / 4 + 1024);
    let mut encoder = png::Encoder::new(&mut bytes, frame.size().width(), frame.size().height());
    encoder.set_color(color_type(frame.format()));
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    add_text(&mut encoder, "Disclaimer", RESEARCH_USE_NOTICE)?;
    for (keyword, value) in texts {
        add_text(&mut encoder, keyword, value)?;
    }
    let mut writer = encoder
        .write_header()
        .map_err(|_| RenderError::PngEncoding)?;
    writer
        .write_image_data(frame.bytes())
        .and_then(|()| writer.finish())
        .map_err(|_| RenderError::PngEncoding)?;
    Ok(bytes)
}

pub(crate) fn color_type(format: PixelFormat) -> png::ColorType {
    match format {
        PixelFormat::Grey8 => png::ColorType::Grayscale,
        PixelFormat::GreyAlpha8 => png::ColorType::GrayscaleAlpha,
        PixelFormat::Rgb8 => png::ColorType::Rgb,
        PixelFormat::Rgba8 => png::ColorType::Rgba,
    }
}

pub(crate) fn add_text<W: std::io::Write>(
    encoder: &mut png::Encoder<'_, W>,
    keyword: &str,
    value: &str,
) -> Result<(), RenderError> {
    if !is_keyword(keyword) {
        return Err(RenderError::PngKeyword);
    }
    // A zero byte would end the text early.
    let value: Cow<'_, str> = if value.contains('\0') {
        value.replace('\0', " ").into()
    } else {
        value.into()
    };
    let is_latin_1 = value.chars().all(|letter| u32::from(letter) < 0x100);
    let added = if is_latin_1 {
        encoder.add_text_chunk(keyword.to_owned(), value.into_owned())
    } else {
        encoder.add_itxt_chunk(keyword.to_owned(), value.into_owned())
    };
    added.map_err(|_| RenderError::PngEncoding)
}

/// Whether PNG accepts a keyword: 1 to 79 printable Latin-1 characters, no space at an end, no two in a row.
fn is_keyword(keyword: &str) -> bool {
    let printable = |letter| matches!(letter, ' '..='~' | '\u{a1}'..='\u{ff}');
    (1..=79).contains(&keyword.chars().count())
        && keyword.chars().all(printable)
        && keyword.trim_matches(' ') == keyword
        && !keyword.contains("  ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FrameSize;

    fn frame(format: PixelFormat) -> Frame {
        let size = FrameSize::new(37, 21).unwrap();
        let count = size.pixel_count() * format.bytes_per_pixel();
        Frame::new(
            size,
            format,
            (0..count).map(|index| (index * 31 % 251) as u8).collect(),
        )
    }

    #[test]
    fn a_picture_comes_back_from_its_png() {
        for (format, color) in [
            (PixelFormat::Grey8, image::ColorType::L8),
            (PixelFormat::GreyAlpha8, image::ColorType::La8),
            (PixelFormat::Rgb8, image::ColorType::Rgb8),
            (PixelFormat::Rgba8, image::ColorType::Rgba8),
        ] {
            let frame = frame(format);
            let encoded = encode_png(&frame, &[]).unwrap();
            let decoded = image::load_from_memory(&encoded).unwrap();
            assert_eq!(decoded.color(), color);
            assert_eq!((decoded.width(), decoded.height()), (37, 21));
            assert_eq!(decoded.as_bytes(), frame.bytes());
        }
    }

    #[test]
    fn texts_and_the_notice_are_kept() {
        let texts = [
            ("renderer", "splat"),
            ("depth_mm", "8"),
            ("note", "größer, 深さ"),
        ];
        let owned = texts.map(|(keyword, text)| (keyword, text.to_owned()));
        let encoded = encode_png(&frame(PixelFormat::Grey8), &owned).unwrap();
        let reader = png::Decoder::new(std::io::Cursor::new(encoded))
            .read_info()
            .unwrap();
        let info = reader.info();
        let latin: Vec<_> = info
            .uncompressed_latin1_text
            .iter()
            .map(|text| (text.keyword.as_str(), text.text.as_str()))
            .collect();
        assert_eq!(
            latin,
            [
                ("Disclaimer", RESEARCH_USE_NOTICE),
                ("renderer", "splat"),
                ("depth_mm", "8")
            ]
        );
        assert_eq!(info.utf8_text[0].keyword, "note");
        assert_eq!(info.utf8_text[0].get_text().unwrap(), "größer, 深さ");
    }

    #[test]
    fn a_bad_keyword_is_refused() {
        for keyword in [
            "",
            " depth",
            "two  spaces",
            "深さ",
            "line\nbreak",
            &"x".repeat(80),
        ] {
            let result = encode_png(&frame(PixelFormat::Grey8), &[(keyword, "8".to_owned())]);
            assert_eq!(result, Err(RenderError::PngKeyword), "{keyword:?}");
        }
    }
}
