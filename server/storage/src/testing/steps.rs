//! The steps of a store one by one, for tests that stop in between as a killed process does.

use std::time::Duration;

use case::images::Image;
use case::{CaseId, ObjectKind};

use crate::rows::{NewCase, Pinned, Sweep};
use crate::{Framed, ObjectName, Spooled, Store, StoreError};

/// Pins objects, as before they are written.
///
/// # Errors
/// If the rows cannot be written.
pub async fn pin(
    store: &Store,
    names: impl IntoIterator<Item = ObjectName>,
) -> Result<Pinned, StoreError> {
    store.pin(names).await
}

/// Writes an object that no row names yet.
///
/// # Errors
/// If the objects cannot be written.
pub async fn write(store: &Store, object: &Framed) -> Result<(), StoreError> {
    Ok(store.objects().put(object).await?)
}

/// Writes an uploaded file as an object that no row names yet.
///
/// # Errors
/// If the objects cannot be written.
pub async fn write_file(
    store: &Store,
    name: &ObjectName,
    file: &Spooled,
) -> Result<(), StoreError> {
    Ok(store.objects().put_file(name, file).await?)
}

/// Deletes an object, whether or not a row names it.
///
/// # Errors
/// If the objects cannot be written.
pub async fn delete(store: &Store, name: &ObjectName) -> Result<(), StoreError> {
    Ok(store.objects().delete(name).await?)
}

/// Removes the rows of a case, and leaves its objects to a sweep.
///
/// # Errors
/// If the rows cannot be written.
pub async fn delete_rows(store: &Store, id: &CaseId) -> Result<bool, StoreError> {
    store.delete_rows(id).await
}

/// Ends every lease and pin, as a process does that is alone.
///
/// # Errors
/// If the rows cannot be written.
pub async fn forget_holders(store: &Store) -> Result<(), StoreError> {
    store.rows().forget_holders().await
}

/// Begins a sweep of what nobody needs; returns the objects that it is to delete.
///
/// # Errors
/// If the rows cannot be written.
pub async fn begin_sweep(
    store: &Store,
    holder: &str,
    lease: Duration,
) -> Result<Vec<ObjectName>, StoreError> {
    let unneeded = store.abandoned(100).await?;
    mark(store, &unneeded, holder, lease).await
}

/// Leaves the tombstones of a sweep on those of these objects that nobody needs, and returns them.
///
/// # Errors
/// If the rows cannot be written.
pub async fn mark(
    store: &Store,
    names: &[ObjectName],
    holder: &str,
    lease: Duration,
) -> Result<Vec<ObjectName>, StoreError> {
    let sweep = Sweep {
        holder: holder.to_owned(),
        lease,
    };
    store.mark(names, &sweep).await
}

/// Ends a sweep, whose objects are deleted.
///
/// # Errors
/// If the rows cannot be written.
pub async fn end_sweep(store: &Store, holder: &str) -> Result<(), StoreError> {
    store.remove_tombstones(holder).await
}

/// Pins objects for an hour, which are not written.
pub async fn pinned(store: &Store, names: &[ObjectName]) -> Pinned {
    super::items::pinned(store, names).await
}

/// Abandons pinned objects, and leaves them to a sweep.
///
/// # Errors
/// If the rows cannot be written.
pub async fn unpin(store: &Store, pinned: &Pinned) -> Result<(), StoreError> {
    store.unpin(pinned).await
}

/// Inserts the rows of a case that is made of these images, or of those of the case of which it is a version.
pub async fn insert_case(
    store: &Store,
    contents: &str,
    images: Option<Vec<Image>>,
    previous: Option<CaseId>,
) -> CaseId {
    let new = NewCase {
        images,
        previous,
        ..super::items::new_case(store, contents).await
    };
    store.insert_case(&new).await.unwrap();
    new.id
}

/// Those of these objects that nothing refers to.
///
/// # Errors
/// If the rows cannot be read.
pub async fn unneeded(store: &Store, names: &[ObjectName]) -> Result<Vec<ObjectName>, StoreError> {
    store.unneeded(names).await
}

/// The objects of a kind to which rows of other tables refer.
///
/// # Errors
/// If the rows cannot be read.
pub async fn objects_of_tables(
    store: &Store,
    kind: ObjectKind,
    after: Option<&ObjectName>,
    limit: usize,
) -> Result<Vec<ObjectName>, StoreError> {
    store.objects_of_tables(kind, after, limit).await
}

/// At most so many objects that a sweep would look at.
///
/// # Errors
/// If the rows cannot be read.
pub async fn abandoned(store: &Store, limit: usize) -> Result<Vec<ObjectName>, StoreError> {
    store.abandoned(limit).await
}
