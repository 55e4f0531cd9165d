//! The head of a file (PS3.10 §7.1), which a data set lacks on the way.

use crate::dimse::command::{ObjectName, padded};

const PREAMBLE: usize = 128;

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
