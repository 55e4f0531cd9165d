//! The steps of a store one by one, for tests that stop in between as a killed process does.

use std::time::Duration;

use case::CaseId;

use crate::rows::{Pinned, Sweep};
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
    store.delete_case(id).await
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
    let sweep = Sweep {
        holder: holder.to_owned(),
        lease,
    };
    let unneeded = store.abandoned(100).await?;
    store.mark(&unneeded, &sweep).await
}

/// Ends a sweep, whose objects are deleted.
///
/// # Errors
/// If the rows cannot be written.
pub async fn end_sweep(store: &Store, holder: &str) -> Result<(), StoreError> {
    store.remove_tombstones(holder).await
}
