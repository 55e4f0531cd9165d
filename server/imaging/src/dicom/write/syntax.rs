//! The head of a result, and a result in the transfer syntax that every node accepts (PS3.5 §10.1).

use dicom_dictionary_std::uids;
use dicom_object::{FileMetaTable, from_reader};

use super::WriteError;
use super::common::written;

/// The bytes before the file meta information.
const PREAMBLE: usize = 128;

/// What the head of a result states.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileHead {
    /// Its SOP Class UID.
    pub sop_class_uid: String,
    /// Its SOP Instance UID.
    pub sop_instance_uid: String,
    /// The UID of the transfer syntax of the data set.
    pub transfer_syntax: String,
    /// Where the data set begins.
    pub length: usize,
}

/// Reads the head of a result (PS3.10 §7.1).
///
/// The file must be one that this crate has written.
///
/// # Errors
/// [`WriteError::Encoding`] if it is damaged.
pub fn file_head(file: &[u8]) -> Result<FileHead, WriteError> {
    let mut rest = file.get(PREAMBLE..).ok_or(WriteError::Encoding)?;
    let meta = FileMetaTable::from_reader(&mut rest).map_err(|_| WriteError::Encoding)?;
    Ok(FileHead {
        sop_class_uid: meta.media_storage_sop_class_uid().to_owned(),
        sop_instance_uid: meta.media_storage_sop_instance_uid().to_owned(),
        transfer_syntax: meta.transfer_syntax().to_owned(),
        length: file.len() - rest.len(),
    })
}

/// A result in Implicit VR Little Endian.
///
/// The file must be one that this crate has written, because nothing limits what another one may take.
///
/// # Errors
/// [`WriteError::Encoding`] if it is damaged.
pub fn implicit_file(file: &[u8]) -> Result<Vec<u8>, WriteError> {
    let object = from_reader(file).map_err(|_| WriteError::Encoding)?;
    let meta = object.meta().clone();
    let [class, instance] = [
        &meta.media_storage_sop_class_uid,
        &meta.media_storage_sop_instance_uid,
    ];
    let syntax = uids::IMPLICIT_VR_LITTLE_ENDIAN;
    written(object.into_inner(), syntax, [class, instance])
}
