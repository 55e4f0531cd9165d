//! The head of a file (PS3.10 §7.1), which a data set lacks on the way.

use crate::dimse::command::{ObjectName, padded, uid};

const PREAMBLE: usize = 128;

/// The length of what precedes the elements that the group length counts.
const UNCOUNTED: usize = PREAMBLE + 4 + 12;

/// Value representations with a length of four bytes (PS3.5 §7.1.2), as far as they are in file meta information.
const LONG: [&[u8]; 2] = [b"OB", b"UN"];

/// The preamble and the file meta information.
pub(crate) fn file_head(object: &ObjectName, transfer_syntax: &str) -> Vec<u8> {
    let mut meta = Vec::new();
    let mut element = |number: u16, uid: &str| {
        let value = padded(uid);
        meta.extend([2, 0]);
        meta.extend(number.to_le_bytes());
        meta.extend(b"UI");
        meta.extend(u16::try_from(value.len()).unwrap_or(0).to_le_bytes());
        meta.extend(value);
    };
    element(0x0002, &object.sop_class_uid);
    element(0x0003, &object.sop_instance_uid);
    element(0x0010, transfer_syntax);
    let mut head = vec![0; PREAMBLE];
    head.extend(b"DICM");
    head.extend([2, 0, 0, 0]);
    head.extend(b"UL");
    head.extend([4, 0]);
    head.extend(u32::try_from(meta.len()).unwrap_or(0).to_le_bytes());
    head.extend(meta);
    head
}

/// What the head of a file states.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct FileHead {
    pub(crate) object: ObjectName,
    pub(crate) transfer_syntax: String,
    /// Where the data set begins.
    pub(crate) length: usize,
}

impl FileHead {
    /// Reads it; `None` if it is damaged.
    pub(crate) fn read(file: &[u8]) -> Option<Self> {
        let head = file.get(PREAMBLE..UNCOUNTED)?;
        if &head[..4] != b"DICM" || head[4..12] != *b"\x02\0\0\0UL\x04\0" {
            return None;
        }
        let length = u32::from_le_bytes(head[12..].try_into().ok()?);
        let length = UNCOUNTED.checked_add(usize::try_from(length).ok()?)?;
        let mut rest = file.get(UNCOUNTED..length)?;
        let (mut class, mut instance, mut syntax) = (None, None, None);
        while !rest.is_empty() {
            let (element, after) = rest.split_at_checked(8)?;
            let (value, after) = match LONG.contains(&&element[4..6]) {
                false => {
                    let length = u16::from_le_bytes([element[6], element[7]]);
                    after.split_at_checked(usize::from(length))?
                }
                true => {
                    let (length, after) = after.split_at_checked(4)?;
                    let length = u32::from_le_bytes(length.try_into().ok()?);
                    after.split_at_checked(usize::try_from(length).ok()?)?
                }
            };
            rest = after;
            match element[..4] {
                [2, 0, 0x02, 0] => class = Some(uid(value)?),
                [2, 0, 0x03, 0] => instance = Some(uid(value)?),
                [2, 0, 0x10, 0] => syntax = Some(uid(value)?),
                _ => {}
            }
        }
        Some(Self {
            object: ObjectName {
                sop_class_uid: class?,
                sop_instance_uid: instance?,
            },
            transfer_syntax: syntax?,
            length,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_head_is_read_as_it_was_written_and_refused_if_it_is_cut() {
        let object = ObjectName {
            sop_class_uid: "1.2.840.10008.5.1.4.1.1.7".to_owned(),
            sop_instance_uid: "2.25.7".to_owned(),
        };
        let head = file_head(&object, "1.2.840.10008.1.2.1");
        let expected = FileHead {
            object,
            transfer_syntax: "1.2.840.10008.1.2.1".to_owned(),
            length: head.len(),
        };
        let file = [&head[..], b"the data set"].concat();
        assert_eq!(FileHead::read(&file), Some(expected));
        for cut in 0..head.len() {
            assert_eq!(FileHead::read(&head[..cut]), None, "{cut}");
        }
        for at in UNCOUNTED - 4..head.len() {
            let mut changed = file.clone();
            changed[at] = 0xFF;
            let _ = FileHead::read(&changed);
        }
    }
}
