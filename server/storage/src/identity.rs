//! The id of a store: a row and an object that say which rows and which objects belong together.
//!
//! The row is made first, the object after it, and only by whoever may make a store. From then on they are compared whenever the
//! store is opened, when somebody asks whether it is ready, before each job, and before an object is written or removed. A
//! database with the objects of another store, or with a folder that is not mounted, changes nothing.

use crate::label::{Label, Mismatch, StoreId};
use crate::objects::Objects;
use crate::sql::Rows;
use crate::{Store, StoreError};

/// The id of rows and objects, or in what they differ.
///
/// # Errors
/// [`StoreError::Mismatch`], or if one of them cannot be read: what cannot be reached is not missing.
pub(crate) async fn compare(rows: &Rows, objects: &Objects) -> Result<StoreId, StoreError> {
    let found = Mismatch {
        rows: rows.store_id().await?,
        objects: objects.label().await?,
    };
    match found.rows {
        Some(id) if found.objects.id() == Some(id) => Ok(id),
        _ => Err(StoreError::Mismatch(found)),
    }
}

/// The same; gives an id to rows and objects that are new, or completes one that was half made.
///
/// # Errors
/// As [`compare`].
pub(crate) async fn compare_or_make(rows: &Rows, objects: &Objects) -> Result<StoreId, StoreError> {
    match compare(rows, objects).await {
        Err(StoreError::Mismatch(found))
            if found.objects == Label::Missing
                && rows.are_new().await?
                && objects.are_none().await? => {}
        // Another process may have made the pair between the two looks.
        Err(StoreError::Mismatch(_)) => return compare(rows, objects).await,
        compared => return compared,
    }
    let id = rows.make_store_id(StoreId::new()).await?;
    objects.create_label(&Label::Id(id)).await?;
    // Somebody else may have been faster.
    compare(rows, objects).await
}

impl Store {
    /// The id of the store, to which both its rows and its objects must belong.
    ///
    /// # Errors
    /// [`StoreError::Mismatch`], or if one of them cannot be reached.
    pub async fn id(&self) -> Result<StoreId, StoreError> {
        compare(self.rows(), self.objects()).await
    }
}

/// Gives the store another id, because it is a copy. After an interruption, the next call completes it.
///
/// # Errors
/// If rows and objects do not belong together, or cannot be written.
pub(crate) async fn change(rows: &Rows, objects: &Objects) -> Result<StoreId, StoreError> {
    let (from, to) = match compare(rows, objects).await {
        Ok(from) => (from, StoreId::new()),
        Err(StoreError::Mismatch(Mismatch {
            rows: Some(rows),
            objects: Label::Changing { from, to },
        })) if rows == from => (from, to),
        Err(error) => return Err(error),
    };
    objects.put_label(&Label::Changing { from, to }).await?;
    rows.change_store_id(to).await?;
    objects.put_label(&Label::Id(to)).await?;
    Ok(to)
}
