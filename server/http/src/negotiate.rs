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

/// The items of an `Accept` header with their quality, 0 to 1.
struct Accepted(Vec<(String, f32)>);

impl Accepted {
    fn read(headers: &HeaderMap, name: HeaderName) -> Self {
        let values = headers.get_all(name).into_iter();
        let texts = values.filter_map(|value| value.to_str().ok());
        let items = texts.flat_map(|text| text.split(',')).filter_map(item);
        Self(items.collect())
    }

    fn exact(&self, name: &str) -> Option<f32> {
        let found = self.0.iter().find(|(item, _)| item == name);
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

/// `name;q=0.5` → name and quality; other parameters are ignored. `None` for an empty item.
fn item(text: &str) -> Option<(String, f32)> {
    let mut parts = text.split(';').map(str::trim);
    let name = parts.next().filter(|name| !name.is_empty())?;
    let quality = parts
        .filter_map(|part| part.split_once('='))
        .find(|(key, _)| key.trim().eq_ignore_ascii_case("q"))
        .map_or(1.0, |(_, value)| value.trim().parse().unwrap_or(0.0));
    Some((name.to_ascii_lowercase(), quality))
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
