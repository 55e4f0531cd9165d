//! The deletion of cases and layers.

use super::connection::Connection;
use super::{cases, layers, owners, pins};
use crate::rows::Owner;
use crate::{Store, StoreError};

impl Store {
    /// Removes a case with its layers, or a layer, and the objects that nothing else needs; `false` if it did not exist. A running
    /// preparation is cancelled. The operation completes even if the caller drops the future.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written. It may have been removed even so; its objects are then removed later.
    pub async fn delete(&self, owner: impl Into<Owner>) -> Result<bool, StoreError> {
        let (store, owner) = (self.clone(), owner.into());
        let delete = async move {
            store.id().await?;
            let deleted = store.delete_rows(owner).await?;
            if deleted {
                match owner.layer {
                    None => store.inner.is_deleted(&owner.case),
                    Some(_) => store.signals().changed(&owner.case),
                }
                store.collect().await?;
            }
            Ok(deleted)
        };
        tokio::spawn(delete).await?
    }

    /// Removes the rows of a case or of a layer; returns whether it existed. Its objects are left with expired pins; the versions of a
    /// case become those of the case that it is a version of.
    pub(crate) async fn delete_rows(&self, owner: impl Into<Owner>) -> Result<bool, StoreError> {
        let (transaction, now) = self.write().await?;
        self.delete_in(transaction, owner.into(), now).await
    }

    /// The same in a transaction, which is committed.
    pub(super) async fn delete_in(
        &self,
        mut transaction: Connection,
        owner: Owner,
        now: i64,
    ) -> Result<bool, StoreError> {
        let needed = owners::objects(&mut transaction, owner).await?;
        pins::abandon(&mut transaction, needed, now).await?;
        let deleted = match &owner.layer {
            None => cases::delete(&mut transaction, &owner.case, now).await?,
            Some(layer) => layers::delete(&mut transaction, &owner.case, layer).await?,
        };
        transaction.commit().await?;
        if deleted {
            self.rows().database.empty_log().await;
        }
        Ok(deleted)
    }
}
