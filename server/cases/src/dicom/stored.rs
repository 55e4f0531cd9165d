//! Reads the patients of stored images.

use storage::{ObjectName, Store, StoreError, Unreadable};
use tempfile::TempDir;

use crate::application::Cases;
use crate::error::Error;
use crate::patient::Patient;

impl Cases {
    /// The patients of stored images; `None` if one is lost.
    ///
    /// # Errors
    /// A [`Failure`](case::Failure) that states what is wrong with an image, [`Error::Busy`] if too many clients wait, or an error of
    /// the store.
    pub async fn patients_of(&self, names: &[ObjectName]) -> Result<Option<Vec<Patient>>, Error> {
        let input = self.store().spools().directory().await?;
        if !copy_objects(self.store(), names, &input).await? {
            return Ok(None);
        }
        let _turn = self.dicom.limit.turn().await?;
        let folders = (input, self.store().spools().directory().await?);
        let read = self.dicom.reader.attributes(folders, names.len()).await?;
        let stated = read.iter();
        let patients = stated.map(|stated| Patient::of(|keyword| stated.value(keyword)));
        Ok(Some(patients.collect()))
    }
}

/// Copies objects into a directory, under their places in the list; `false` if one is lost.
///
/// # Errors
/// If the store or the disk fails.
pub async fn copy_objects(
    store: &Store,
    names: &[ObjectName],
    directory: &TempDir,
) -> Result<bool, Error> {
    for (number, name) in names.iter().enumerate() {
        let object = match store.object(name).await {
            Ok(object) => object,
            Err(Unreadable::Store(error)) => return Err(error.into()),
            Err(_) => return Ok(false),
        };
        let path = directory.path().join(number.to_string());
        let written = tokio::fs::write(path, object).await;
        written.map_err(StoreError::Disk)?;
    }
    Ok(true)
}
