//! Reads the attributes of stored images.

use serde_json::Value;
use storage::{ObjectName, Store, StoreError, Unreadable};
use tempfile::TempDir;

use crate::application::Cases;
use crate::error::Error;

impl Cases {
    /// The attributes of stored images as DICOM JSON; `None` if one is lost.
    ///
    /// # Errors
    /// A [`Failure`](case::Failure) that states what is wrong with an image, [`Error::Busy`] if too many clients wait, or an error of
    /// the store.
    pub async fn stored_metadata(&self, names: &[ObjectName]) -> Result<Option<Vec<Value>>, Error> {
        let input = self.store().spools().directory().await?;
        if !copy_objects(self.store(), names, &input).await? {
            return Ok(None);
        }
        let _turn = self.dicom.limit.turn().await?;
        let folders = (input, self.store().spools().directory().await?);
        Ok(Some(
            self.dicom.reader.metadata(folders, names.len()).await?,
        ))
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
