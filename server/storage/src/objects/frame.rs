//! The bytes of an object: a header of 72 bytes, then the payload.
//!
//! | bytes | what, little-endian |
//! |---|---|
//! | 0–7 | the magic word `ISOCOBJ\n` |
//! | 8–9 | format version, 1 |
//! | 10–11 | kind |
//! | 12–15 | encoding of the payload: 0 none, 1 zstd |
//! | 16–23 | length of the payload as stored |
//! | 24–31 | length of the payload decoded |
//! | 32–63 | BLAKE3 of the payload as stored, which is the object's address too |
//! | 64–71 | the first 8 bytes of BLAKE3 over bytes 0–63 |
//!
//! Any changed, missing or additional byte is detected, and no length is trusted before it is checked.

use bytes::Bytes;

use case::ObjectKind;

use super::ObjectName;

const MAGIC: &[u8; 8] = b"ISOCOBJ\n";
const VERSION: u16 = 1;
const CHECKED_LENGTH: usize = 64;

/// Length of a header, in bytes.
pub(crate) const HEADER_LENGTH: usize = 72;

/// The limit for a decoded derived object: a grid of 2³⁰ voxels of 16 bits, and its description.
const MAX_DECODED_LENGTH: u64 = (2 << 30) + (1 << 20);

/// The default of zstd; higher levels take ten times as long and save 5 %.
const ZSTD_LEVEL: i32 = 3;

/// The reason why the bytes of an object are rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum FrameError {
    #[error("it ends in its header")]
    HeaderTruncated,
    #[error("it does not begin with the magic word")]
    NoMagic,
    #[error("its header is damaged")]
    HeaderDamaged,
    #[error("its format version is unknown")]
    UnknownVersion,
    #[error("its digest does not match its name")]
    AnotherObject,
    #[error("its length does not match its header")]
    WrongLength,
    #[error("its payload is damaged")]
    PayloadDamaged,
    #[error("its payload cannot be unpacked")]
    NotUnpacked,
}

/// How a payload is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Plain,
    Zstd,
}

/// A payload ready to store: packed, named, and with its header.
#[derive(Debug, Clone)]
pub struct Framed {
    /// Its address.
    pub name: ObjectName,
    pub(crate) header: [u8; HEADER_LENGTH],
    pub(crate) payload: Bytes,
}

/// Packs a payload if that saves at least a sixteenth, and adds the header.
pub fn frame(kind: ObjectKind, plain: Bytes) -> Framed {
    let plain_length = plain.len() as u64;
    let packed = zstd::bulk::compress(&plain, ZSTD_LEVEL)
        .ok()
        .filter(|packed| packed.len() + plain.len() / 16 < plain.len());
    let (encoding, payload) = match packed {
        Some(packed) => (Encoding::Zstd, Bytes::from(packed)),
        None => (Encoding::Plain, plain),
    };
    let name = ObjectName {
        kind,
        digest: blake3::hash(&payload),
    };
    let header = header(&name, encoding, payload.len() as u64, plain_length);
    Framed {
        name,
        header,
        payload,
    }
}

/// The header of a payload that is stored unpacked.
pub(crate) fn plain_header(name: &ObjectName, length: u64) -> [u8; HEADER_LENGTH] {
    header(name, Encoding::Plain, length, length)
}

fn header(
    name: &ObjectName,
    encoding: Encoding,
    stored_length: u64,
    plain_length: u64,
) -> [u8; HEADER_LENGTH] {
    let encoding = match encoding {
        Encoding::Plain => 0u32,
        Encoding::Zstd => 1,
    };
    let mut header = [0; HEADER_LENGTH];
    header[..8].copy_from_slice(MAGIC);
    header[8..10].copy_from_slice(&VERSION.to_le_bytes());
    header[10..12].copy_from_slice(&name.kind.code().to_le_bytes());
    header[12..16].copy_from_slice(&encoding.to_le_bytes());
    header[16..24].copy_from_slice(&stored_length.to_le_bytes());
    header[24..32].copy_from_slice(&plain_length.to_le_bytes());
    header[32..64].copy_from_slice(name.digest.as_bytes());
    let check = blake3::hash(&header[..CHECKED_LENGTH]);
    header[CHECKED_LENGTH..].copy_from_slice(&check.as_bytes()[..8]);
    header
}

/// Verifies the bytes of an object against its name and returns the unpacked payload.
///
/// # Errors
/// If any byte differs from what was written.
pub(crate) fn unframe(name: &ObjectName, framed: &Bytes) -> Result<Bytes, FrameError> {
    let header = framed
        .get(..HEADER_LENGTH)
        .ok_or(FrameError::HeaderTruncated)?;
    if &header[..8] != MAGIC {
        return Err(FrameError::NoMagic);
    }
    let check = blake3::hash(&header[..CHECKED_LENGTH]);
    if header[CHECKED_LENGTH..] != check.as_bytes()[..8] {
        return Err(FrameError::HeaderDamaged);
    }
    if header[8..10] != VERSION.to_le_bytes() {
        return Err(FrameError::UnknownVersion);
    }
    if header[10..12] != name.kind.code().to_le_bytes()
        || header[32..64] != name.digest.as_bytes()[..]
    {
        return Err(FrameError::AnotherObject);
    }
    let payload = framed.slice(HEADER_LENGTH..);
    if payload.len() as u64 != read_u64(&header[16..24]) {
        return Err(FrameError::WrongLength);
    }
    if blake3::hash(&payload) != name.digest {
        return Err(FrameError::PayloadDamaged);
    }
    match header[12] {
        0 => Ok(payload),
        1 => unpack(&payload, read_u64(&header[24..32])),
        _ => Err(FrameError::UnknownVersion),
    }
}

fn unpack(payload: &[u8], plain_length: u64) -> Result<Bytes, FrameError> {
    if plain_length > MAX_DECODED_LENGTH {
        return Err(FrameError::NotUnpacked);
    }
    let capacity = usize::try_from(plain_length).map_err(|_| FrameError::NotUnpacked)?;
    let plain = zstd::bulk::decompress(payload, capacity).map_err(|_| FrameError::NotUnpacked)?;
    if plain.len() == capacity {
        Ok(plain.into())
    } else {
        Err(FrameError::NotUnpacked)
    }
}

fn read_u64(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .rev()
        .fold(0, |value, &byte| value << 8 | u64::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole(framed: &Framed) -> Vec<u8> {
        [&framed.header[..], &framed.payload].concat()
    }

    fn compressible() -> Bytes {
        (0..20_000u32).map(|step| (step / 100) as u8).collect()
    }

    fn incompressible() -> Bytes {
        let mut bytes = vec![0; 999];
        blake3::Hasher::new().finalize_xof().fill(&mut bytes);
        bytes.into()
    }

    #[test]
    fn a_payload_comes_back_as_it_was_whether_packing_pays_or_not() {
        for (plain, packed) in [
            (compressible(), true),
            (incompressible(), false),
            (Bytes::new(), false),
        ] {
            let framed = frame(ObjectKind::Envelope, plain.clone());
            assert_eq!(framed.payload.len() < plain.len(), packed);
            assert_eq!(unframe(&framed.name, &whole(&framed).into()), Ok(plain));
        }
    }

    #[test]
    fn every_changed_byte_is_found() {
        for plain in [compressible(), incompressible()] {
            let framed = frame(ObjectKind::Forest, plain);
            let good = whole(&framed);
            for at in 0..good.len() {
                let mut bad = good.clone();
                bad[at] ^= 1 << (at % 8);
                assert!(unframe(&framed.name, &bad.into()).is_err(), "byte {at}");
            }
        }
    }

    #[test]
    fn every_truncation_and_an_addition_is_found() {
        let framed = frame(ObjectKind::Paths, compressible());
        let good = whole(&framed);
        for length in 0..good.len() {
            assert!(unframe(&framed.name, &good[..length].to_vec().into()).is_err());
        }
        let longer = [&good[..], b"x"].concat();
        assert_eq!(
            unframe(&framed.name, &longer.into()),
            Err(FrameError::WrongLength)
        );
    }

    #[test]
    fn a_sound_object_at_another_ones_address_is_found() {
        let [here, there] =
            [compressible(), incompressible()].map(|plain| frame(ObjectKind::Volume, plain));
        assert_eq!(
            unframe(&here.name, &whole(&there).into()),
            Err(FrameError::AnotherObject)
        );
        let as_mask = ObjectName {
            kind: ObjectKind::SourceMask,
            ..there.name
        };
        assert_eq!(
            unframe(&as_mask, &whole(&there).into()),
            Err(FrameError::AnotherObject)
        );
    }

    #[test]
    fn a_promise_of_gigabytes_is_not_believed() {
        let payload = Bytes::from_static(b"not zstd");
        let name = ObjectName {
            kind: ObjectKind::Volume,
            digest: blake3::hash(&payload),
        };
        let header = header(&name, Encoding::Zstd, payload.len() as u64, u64::MAX);
        let bytes = [&header[..], &payload].concat();
        assert_eq!(unframe(&name, &bytes.into()), Err(FrameError::NotUnpacked));
    }
}
