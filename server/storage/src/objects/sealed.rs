//! The bytes of an encrypted object: a header of 72 bytes, then the object of [`super::frame`] in chunks.
//!
//! | bytes | what, little-endian |
//! |---|---|
//! | 0–7 | the magic word `ISOCENC\n` |
//! | 8–9 | format version, 1 |
//! | 10–15 | 0 |
//! | 16–23 | length of the object |
//! | 24–31 | id of the key |
//! | 32–63 | random |
//! | 64–71 | the first 8 bytes of BLAKE3 over bytes 0–63, which tells damage from another key |
//!
//! Each chunk is 64 KiB of the object, the last one the rest, encrypted by AES-256-GCM, and its tag of 16 bytes. Every object has
//! a key of its own, derived from the key of the store, its header and its name, so nonces need not be random: they are
//! the number of the chunk, and whether it is the last. A changed, missing, additional, exchanged or repeated chunk, and an object under
//! the name of another, are detected. The place of each chunk follows from its number, so a part of an object can be read without the rest.

use std::io::{self, Read};

use bytes::{Bytes, BytesMut};
use ring::aead::{AES_256_GCM, Aad, LessSafeKey, Nonce, UnboundKey};

use super::ObjectName;
use super::keys::{Key, KeyId};

const MAGIC: &[u8; 8] = b"ISOCENC\n";
const VERSION: u16 = 1;
const CHECKED_LENGTH: usize = 64;

/// Length of a header, in bytes.
pub(crate) const SEALED_HEADER_LENGTH: usize = 72;

/// Length of a chunk, in bytes.
const CHUNK_LENGTH: usize = 64 << 10;

/// Length of a tag, in bytes.
const TAG_LENGTH: usize = 16;

/// Separates the keys of objects from everything else that is derived from a key.
const OBJECT_CONTEXT: &str = "isocortex 2026-11-25 key of an object";

/// The reason why an encrypted object is rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum SealError {
    #[error("the header of its encryption is damaged")]
    HeaderDamaged,
    #[error("the version of its encryption is unknown")]
    UnknownVersion,
    #[error("its length does not match the header of its encryption")]
    WrongLength,
    #[error("its encrypted bytes are damaged")]
    Damaged,
}

/// The header of an encrypted object.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SealedHeader {
    bytes: [u8; SEALED_HEADER_LENGTH],
}

impl SealedHeader {
    fn new(key: KeyId, length: u64) -> io::Result<Self> {
        let mut bytes = [0; SEALED_HEADER_LENGTH];
        bytes[..8].copy_from_slice(MAGIC);
        bytes[8..10].copy_from_slice(&VERSION.to_le_bytes());
        bytes[16..24].copy_from_slice(&length.to_le_bytes());
        bytes[24..32].copy_from_slice(&key.0);
        getrandom::fill(&mut bytes[32..64]).map_err(io::Error::other)?;
        let check = blake3::hash(&bytes[..CHECKED_LENGTH]);
        bytes[CHECKED_LENGTH..].copy_from_slice(&check.as_bytes()[..8]);
        Ok(Self { bytes })
    }

    /// The header at the beginning of some bytes; `None` if they are not encrypted.
    pub(crate) fn of(bytes: &[u8]) -> Result<Option<Self>, SealError> {
        if !bytes.starts_with(MAGIC) {
            return Ok(None);
        }
        let bytes = bytes
            .first_chunk::<SEALED_HEADER_LENGTH>()
            .ok_or(SealError::HeaderDamaged)?;
        let check = blake3::hash(&bytes[..CHECKED_LENGTH]);
        if bytes[CHECKED_LENGTH..] != check.as_bytes()[..8] {
            return Err(SealError::HeaderDamaged);
        }
        if bytes[8..10] != VERSION.to_le_bytes() {
            return Err(SealError::UnknownVersion);
        }
        Ok(Some(Self { bytes: *bytes }))
    }

    /// The key of the store with which the object is encrypted.
    pub(crate) fn key(&self) -> KeyId {
        let mut id = [0; 8];
        id.copy_from_slice(&self.bytes[24..32]);
        KeyId(id)
    }

    /// The length of the object.
    fn length(&self) -> u64 {
        let mut length = [0; 8];
        length.copy_from_slice(&self.bytes[16..24]);
        u64::from_le_bytes(length)
    }

    /// The key of the object.
    fn object_key(&self, key: &Key, name: &ObjectName) -> LessSafeKey {
        let mut hasher = blake3::Hasher::new_derive_key(OBJECT_CONTEXT);
        hasher.update(&key.secret);
        hasher.update(&self.bytes[..CHECKED_LENGTH]);
        hasher.update(name.to_string().as_bytes());
        let key = UnboundKey::new(&AES_256_GCM, hasher.finalize().as_bytes());
        LessSafeKey::new(key.expect("a digest is as long as a key"))
    }
}

/// The number of chunks of an object; one without a byte has an empty chunk.
fn chunks_of(length: u64) -> u64 {
    length.div_ceil(CHUNK_LENGTH as u64).max(1)
}

fn nonce(chunk: u64, is_last: bool) -> Nonce {
    let mut nonce = [0; 12];
    nonce[..8].copy_from_slice(&chunk.to_le_bytes());
    nonce[8] = u8::from(is_last);
    Nonce::assume_unique_for_key(nonce)
}

/// Encrypts what it reads.
pub(crate) struct Sealing<R> {
    content: R,
    key: LessSafeKey,
    /// Bytes of the object that are not encrypted yet.
    left: u64,
    chunk: u64,
    chunks: u64,
    /// What is encrypted and not read yet begins at `at`.
    ready: Vec<u8>,
    at: usize,
}

impl<R: Read> Sealing<R> {
    /// Begins the object with these contents and this length.
    ///
    /// # Errors
    /// If this machine gives no random numbers.
    pub(crate) fn new(key: &Key, name: &ObjectName, length: u64, content: R) -> io::Result<Self> {
        let header = SealedHeader::new(key.id, length)?;
        Ok(Self {
            content,
            key: header.object_key(key, name),
            left: length,
            chunk: 0,
            chunks: chunks_of(length),
            ready: header.bytes.to_vec(),
            at: 0,
        })
    }

    fn seal_next(&mut self) -> io::Result<()> {
        let length = self.left.min(CHUNK_LENGTH as u64);
        self.left -= length;
        self.ready.resize(length as usize, 0);
        self.content.read_exact(&mut self.ready)?;
        let nonce = nonce(self.chunk, self.chunk + 1 == self.chunks);
        self.chunk += 1;
        let tag = self
            .key
            .seal_in_place_separate_tag(nonce, Aad::empty(), &mut self.ready);
        let tag = tag.map_err(|_| io::Error::other("a chunk cannot be encrypted"))?;
        self.ready.extend_from_slice(tag.as_ref());
        self.at = 0;
        Ok(())
    }
}

impl<R: Read> Read for Sealing<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.at == self.ready.len() && self.chunk < self.chunks {
            self.seal_next()?;
        }
        let count = buffer.len().min(self.ready.len() - self.at);
        buffer[..count].copy_from_slice(&self.ready[self.at..self.at + count]);
        self.at += count;
        Ok(count)
    }
}

/// The length of an encrypted object.
pub(crate) fn sealed_length(length: u64) -> Option<u64> {
    let tags = chunks_of(length).checked_mul(TAG_LENGTH as u64)?;
    length
        .checked_add(tags)?
        .checked_add(SEALED_HEADER_LENGTH as u64)
}

/// Decrypts an object, in place if nobody else holds its bytes.
///
/// # Errors
/// If any byte differs from what was written, or it was written under another name or with another key.
pub(crate) fn unseal(
    header: &SealedHeader,
    key: &Key,
    name: &ObjectName,
    sealed: Bytes,
) -> Result<Bytes, SealError> {
    let length = header.length();
    if sealed_length(length) != Some(sealed.len() as u64) {
        return Err(SealError::WrongLength);
    }
    let key = header.object_key(key, name);
    let mut bytes = sealed
        .try_into_mut()
        .unwrap_or_else(|shared| BytesMut::from(&shared[..]));
    let chunks = chunks_of(length);
    let (mut to, mut from) = (0, SEALED_HEADER_LENGTH);
    for chunk in 0..chunks {
        let end = bytes.len().min(from + CHUNK_LENGTH + TAG_LENGTH);
        let opened = key.open_within(
            nonce(chunk, chunk + 1 == chunks),
            Aad::empty(),
            &mut bytes[to..end],
            from - to..,
        );
        to += opened.map_err(|_| SealError::Damaged)?.len();
        from = end;
    }
    bytes.truncate(to);
    Ok(bytes.freeze())
}

#[cfg(test)]
mod tests {
    use case::ObjectKind;

    use super::*;

    fn key(byte: u8) -> Key {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        std::fs::write(&path, format!("{byte:02x}").repeat(32)).unwrap();
        let ring = super::super::Keys::read(&path).unwrap().ring();
        ring.for_writing().unwrap().clone()
    }

    fn name(kind: ObjectKind) -> ObjectName {
        let digest = blake3::hash(b"payload");
        ObjectName { kind, digest }
    }

    fn contents(length: usize) -> Vec<u8> {
        let mut contents = vec![0; length];
        blake3::Hasher::new().finalize_xof().fill(&mut contents);
        contents
    }

    fn sealed(contents: &[u8]) -> Vec<u8> {
        let name = name(ObjectKind::Volume);
        let mut sealing = Sealing::new(&key(1), &name, contents.len() as u64, contents).unwrap();
        let mut sealed = Vec::new();
        sealing.read_to_end(&mut sealed).unwrap();
        sealed
    }

    fn opened(kind: ObjectKind, sealed: Vec<u8>) -> Result<Bytes, SealError> {
        let header = SealedHeader::of(&sealed)?.ok_or(SealError::HeaderDamaged)?;
        unseal(&header, &key(1), &name(kind), sealed.into())
    }

    #[test]
    fn an_object_of_any_length_comes_back_and_twice_the_same_is_not_the_same() {
        for length in [
            0,
            1,
            CHUNK_LENGTH - 1,
            CHUNK_LENGTH,
            CHUNK_LENGTH + 1,
            200_000,
        ] {
            let contents = contents(length);
            let bytes = sealed(&contents);
            assert_eq!(Some(bytes.len() as u64), sealed_length(length as u64));
            assert_ne!(bytes, sealed(&contents));
            if length > 16 {
                let window = &contents[..16];
                assert!(!bytes.windows(16).any(|some| some == window));
            }
            // Somebody else holds the bytes, and nobody else does.
            let held = Bytes::from(bytes.clone());
            let header = SealedHeader::of(&held).unwrap().unwrap();
            assert_eq!(header.key(), key(1).id);
            let name = name(ObjectKind::Volume);
            let copied = unseal(&header, &key(1), &name, held.clone()).unwrap();
            assert!(copied == contents && held == bytes, "{length}");
            assert!(opened(ObjectKind::Volume, bytes).unwrap() == contents);
        }
    }

    #[test]
    fn every_changed_byte_is_found() {
        let good = sealed(&contents(300));
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 1 << (at % 8);
            assert!(opened(ObjectKind::Volume, bad).is_err(), "byte {at}");
        }
    }

    #[test]
    fn every_truncation_an_addition_and_a_repetition_is_found() {
        let good = sealed(&contents(2 * CHUNK_LENGTH));
        let step = CHUNK_LENGTH + TAG_LENGTH;
        for length in (0..good.len()).step_by(997).chain([good.len() - 1]) {
            assert!(opened(ObjectKind::Volume, good[..length].to_vec()).is_err());
        }
        assert!(opened(ObjectKind::Volume, [&good[..], &[0]].concat()).is_err());
        let (header, chunks) = good.split_at(SEALED_HEADER_LENGTH);
        let (first, second) = chunks.split_at(step);
        for wrong in [
            [header, second, first].concat(),
            [header, first, first].concat(),
            [header, second, second].concat(),
        ] {
            assert_eq!(opened(ObjectKind::Volume, wrong), Err(SealError::Damaged));
        }
        // A header that promises less makes another key.
        let shorter = contents(CHUNK_LENGTH);
        let other = sealed(&shorter);
        let cut = [&other[..SEALED_HEADER_LENGTH], first].concat();
        assert_eq!(opened(ObjectKind::Volume, cut), Err(SealError::Damaged));
        let cut = [header, first].concat();
        assert_eq!(opened(ObjectKind::Volume, cut), Err(SealError::WrongLength));
    }

    #[test]
    fn another_name_and_another_key_do_not_open_it() {
        let good = sealed(&contents(300));
        assert_eq!(
            opened(ObjectKind::SourceVolume, good.clone()),
            Err(SealError::Damaged)
        );
        let header = SealedHeader::of(&good).unwrap().unwrap();
        let other = unseal(&header, &key(2), &name(ObjectKind::Volume), good.into());
        assert_eq!(other, Err(SealError::Damaged));
    }

    #[test]
    fn a_promise_of_gigabytes_is_not_believed() {
        for length in [u64::MAX, 1 << 62, 1 << 40] {
            let header = SealedHeader::new(key(1).id, length).unwrap();
            let bytes = [&header.bytes[..], &[0; 100]].concat();
            assert_eq!(
                opened(ObjectKind::Volume, bytes),
                Err(SealError::WrongLength)
            );
        }
    }

    #[test]
    fn contents_that_end_early_are_an_error() {
        let name = name(ObjectKind::Volume);
        let mut sealing = Sealing::new(&key(1), &name, 10, &b"short"[..]).unwrap();
        let ended = sealing.read_to_end(&mut Vec::new()).unwrap_err();
        assert_eq!(ended.kind(), io::ErrorKind::UnexpectedEof);
    }
}
