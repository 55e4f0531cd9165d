//! Content negotiation: media types and content codings.

use std::io::Write as _;

use axum::http::{HeaderMap, HeaderName, header};
use bytes::Bytes;

use crate::problem::AppError;

/// How hard zstd and gzip try while a client waits: within a few percent of the best here, in a hundredth of the time.
const USUAL: [u32; 2] = [3, 5];

/// The same for the documents of the program, which are compressed once at the start.
const BEST: [u32; 2] = [9, 9];

/// The media type of a gzipped NIfTI file.
pub const GZIP: &str = "application/gzip";

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Coding {
    Identity,
    /// RFC 8878.
    Zstd,
    /// RFC 1952.
    Gzip,
    /// RFC 7932; only of what was compressed while the program was built.
    Brotli,
}

impl Coding {
    /// Those of answers that are compressed while the program runs, the preferred one first.
    pub const WHILE_RUNNING: [Self; 2] = [Self::Zstd, Self::Gzip];

    /// The name in `Content-Encoding`; `None` for [`Coding::Identity`], which is not named there.
    pub fn name(self) -> Option<&'static str> {
        match self {
            Self::Identity => None,
            Self::Zstd => Some("zstd"),
            Self::Gzip => Some("gzip"),
            Self::Brotli => Some("br"),
        }
    }

    /// The offered coding that the client prefers; among equals the first, and none only if it prefers that.
    ///
    /// Without `Accept-Encoding`, or without an offered coding in it, the result is [`Coding::Identity`].
    pub fn preferred(headers: &HeaderMap, offered: &[Self]) -> Self {
        let accepted = Accepted::read(headers, header::ACCEPT_ENCODING);
        let quality = |name: &str| {
            let named = accepted.exact(name);
            named.or_else(|| accepted.exact("*")).unwrap_or(0.0)
        };
        let mut best = (Self::Identity, 0.0);
        for &coding in offered {
            let quality = coding.name().map_or(0.0, quality);
            if quality > best.1 {
                best = (coding, quality);
            }
        }
        let identity = accepted.exact("identity").unwrap_or(0.0);
        if identity > best.1 {
            Self::Identity
        } else {
            best.0
        }
    }

    /// Compresses a body quickly, while a client waits.
    ///
    /// # Panics
    /// For [`Coding::Brotli`], which this program never makes while it runs.
    pub fn compress(self, bytes: &Bytes) -> Bytes {
        self.compress_at(USUAL, bytes)
    }

    /// Compresses a body that many answers share as well as it gets.
    ///
    /// # Panics
    /// For [`Coding::Brotli`], which this program never makes while it runs.
    pub fn compress_well(self, bytes: &Bytes) -> Bytes {
        self.compress_at(BEST, bytes)
    }

    fn compress_at(self, [zstd_level, gzip_level]: [u32; 2], bytes: &Bytes) -> Bytes {
        let compressed = match self {
            Self::Identity => return bytes.clone(),
            Self::Zstd => zstd::bulk::compress(bytes, zstd_level.cast_signed()),
            Self::Gzip => gzip(bytes, gzip_level),
            Self::Brotli => {
                unreachable!("only what is compressed while building is sent as brotli")
            }
        };
        compressed
            .expect("compressing from memory to memory cannot fail")
            .into()
    }
}

fn gzip(bytes: &[u8], level: u32) -> std::io::Result<Vec<u8>> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::new(level));
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// Picks the offered media type that the client prefers; among equals the first.
///
/// Without `Accept` it is the first. Offers are in lower case.
///
/// # Errors
/// An error if none is accepted.
pub fn media_type(
    headers: &HeaderMap,
    offered: &'static [&'static str],
) -> Result<&'static str, AppError> {
    let accepted = Accepted::read(headers, header::ACCEPT);
    if accepted.0.is_empty() {
        return Ok(offered[0]);
    }
    let mut best = None;
    for &offer in offered {
        let quality = accepted.quality_of_media_type(offer);
        if quality > 0.0 && best.is_none_or(|(_, other)| quality > other) {
            best = Some((offer, quality));
        }
    }
    let best = best.map(|(offer, _)| offer);
    best.ok_or_else(|| AppError::not_acceptable(offered))
}

/// What a client accepts: media ranges or content codings, each with its quality, 0 to 1.
pub struct Accepted(pub Vec<(MediaType, f32)>);

impl Accepted {
    /// The items of a header, such as `Accept`.
    pub fn read(headers: &HeaderMap, name: HeaderName) -> Self {
        let values = headers.get_all(name).into_iter();
        let texts: Vec<_> = values.filter_map(|value| value.to_str().ok()).collect();
        Self::parse(&texts.join(","))
    }

    /// The items of a text, which commas outside of quotes separate.
    pub fn parse(text: &str) -> Self {
        let mut is_quoted = false;
        let items = text.split(|letter| {
            is_quoted ^= letter == '"';
            letter == ',' && !is_quoted
        });
        let with_quality = |item: MediaType| {
            let quality = item.parameter("q");
            let quality = quality.map_or(1.0, |quality| quality.parse().unwrap_or(0.0));
            (item, quality)
        };
        let items = items.filter_map(MediaType::parse).map(with_quality);
        Self(items.collect())
    }

    fn exact(&self, name: &str) -> Option<f32> {
        let found = self.0.iter().find(|(item, _)| item.essence == name);
        found.map(|&(_, quality)| quality)
    }

    /// By the most specific item that fits (RFC 9110, section 12.5.1).
    fn quality_of_media_type(&self, offer: &str) -> f32 {
        let any_subtype = offer.split_once('/').map(|(kind, _)| format!("{kind}/*"));
        self.exact(offer)
            .or_else(|| self.exact(&any_subtype?))
            .or_else(|| self.exact("*/*"))
            .unwrap_or(0.0)
    }
}

/// A media type, a range of them or a content coding, with its parameters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MediaType {
    /// Such as `multipart/related`, in lower case.
    pub essence: String,
    parameters: Vec<(String, String)>,
}

impl MediaType {
    /// Parses the value of `Content-Type` (RFC 9110 §8.3), or an item of `Accept` or `Accept-Encoding`; `None` if it is not one.
    pub fn parse(text: &str) -> Option<Self> {
        let (essence, mut rest) = match text.split_once(';') {
            Some((essence, rest)) => (essence, rest),
            None => (text, ""),
        };
        let essence = essence.trim().to_ascii_lowercase();
        let mut parameters = Vec::new();
        while !rest.trim().is_empty() {
            let (name, value) = rest.split_once('=')?;
            let value = value.trim_start();
            let text;
            (text, rest) = match value.strip_prefix('"') {
                Some(quoted) => unquote(quoted)?,
                None => {
                    let (bare, rest) = value.split_once(';').unwrap_or((value, ""));
                    (bare.trim().to_owned(), rest)
                }
            };
            parameters.push((name.trim().to_ascii_lowercase(), text));
        }
        (!essence.is_empty()).then_some(Self {
            essence,
            parameters,
        })
    }

    /// The value of a parameter; its name is in lower case.
    pub fn parameter(&self, name: &str) -> Option<&str> {
        let found = self.parameters.iter().find(|(key, _)| key == name);
        found.map(|(_, value)| value.as_str())
    }
}

/// The text up to the closing quotation mark, and what follows the next semicolon.
fn unquote(text: &str) -> Option<(String, &str)> {
    let mut value = String::new();
    let mut characters = text.char_indices();
    while let Some((at, character)) = characters.next() {
        match character {
            '"' => {
                let rest = text[at + 1..].trim_start();
                return match rest.strip_prefix(';') {
                    Some(rest) => Some((value, rest)),
                    None => rest.is_empty().then_some((value, rest)),
                };
            }
            '\\' => value.push(characters.next()?.1),
            other => value.push(other),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    const OFFERED: &[&str] = &["application/octet-stream", "model/gltf-binary"];

    fn headers(name: HeaderName, value: &str) -> HeaderMap {
        HeaderMap::from_iter([(name, value.parse().unwrap())])
    }

    fn picked(accept: &str) -> Option<&'static str> {
        media_type(&headers(header::ACCEPT, accept), OFFERED).ok()
    }

    #[test]
    fn the_first_offer_is_the_default() {
        assert_eq!(media_type(&HeaderMap::new(), OFFERED).unwrap(), OFFERED[0]);
        assert_eq!(picked("*/*"), Some(OFFERED[0]));
    }

    #[test]
    fn the_most_welcome_offer_is_picked() {
        assert_eq!(picked("model/*"), Some(OFFERED[1]));
        assert_eq!(picked("*/*;q=0.1, model/gltf-binary"), Some(OFFERED[1]));
        assert_eq!(
            picked("application/octet-stream;q=0, */*;q=0.1"),
            Some(OFFERED[1])
        );
        assert_eq!(picked("text/html"), None);
        let quoted = r#"application/octet-stream;a="b,c;q=1";q=0.1, model/*;q=0.2"#;
        assert_eq!(picked(quoted), Some(OFFERED[1]));
    }

    #[test]
    fn codings_follow_their_qualities() {
        let among = |offered: &[Coding], value| {
            Coding::preferred(&headers(header::ACCEPT_ENCODING, value), offered)
        };
        let preferred = |value| among(&Coding::WHILE_RUNNING, value);
        assert_eq!(
            Coding::preferred(&HeaderMap::new(), &Coding::WHILE_RUNNING),
            Coding::Identity
        );
        assert_eq!(preferred("gzip, deflate, br, zstd"), Coding::Zstd);
        assert_eq!(preferred("gzip, deflate"), Coding::Gzip);
        assert_eq!(preferred("gzip;q=1, zstd;q=0.5"), Coding::Gzip);
        assert_eq!(preferred("br"), Coding::Identity);
        assert_eq!(preferred("zstd;q=0"), Coding::Identity);
        let built = [Coding::Brotli, Coding::Gzip];
        assert_eq!(among(&built, "gzip, deflate, br, zstd"), Coding::Brotli);
        assert_eq!(among(&built, "gzip, deflate"), Coding::Gzip);
        assert_eq!(among(&built, "zstd"), Coding::Identity);
    }
}
