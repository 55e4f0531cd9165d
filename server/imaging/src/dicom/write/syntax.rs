//! A result in the transfer syntax that every node accepts (PS3.5 §10.1).

use dicom_dictionary_std::uids;
use dicom_object::from_reader;

use super::WriteError;
use super::common::written;

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
