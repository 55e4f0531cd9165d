//! UIDs without a registered root.

/// The UID under 2.25 of a digest (PS3.5 B.2): equal digests have equal UIDs.
pub fn uid_of(digest: &blake3::Hash) -> String {
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&digest.as_bytes()[..16]);
    // A UUID of version 8, whose other bits are free (RFC 9562 §5.8).
    bytes[6] = bytes[6] & 0x0F | 0x80;
    bytes[8] = bytes[8] & 0x3F | 0x80;
    format!("2.25.{}", u128::from_be_bytes(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uids_are_those_of_their_digests() {
        let uid = uid_of(&blake3::hash(b"a"));
        assert_eq!(uid, uid_of(&blake3::hash(b"a")));
        assert_ne!(uid, uid_of(&blake3::hash(b"b")));
        let number = uid.strip_prefix("2.25.").unwrap();
        assert!(uid.len() <= 64 && !number.starts_with('0'));
        let number: u128 = number.parse().unwrap();
        assert_eq!(number >> 76 & 0xF, 8, "the version of the UUID");
    }
}
