//! The id of the store: a table of one row.

use super::Rows;
use crate::StoreError;
use crate::args;
use crate::label::StoreId;

impl Rows {
    /// The id of the store to which these rows belong; `None` if they belong to none yet.
    pub(crate) async fn store_id(&self) -> Result<Option<StoreId>, StoreError> {
        let mut connection = self.connect().await?;
        let row = connection
            .fetch_optional("SELECT id FROM store", args![])
            .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let text: String = row.get("id")?;
        let damaged = || StoreError::Rows("the id of the store is damaged".into());
        StoreId::parse(&text).ok_or_else(damaged).map(Some)
    }

    /// Whether no store has ever been opened on these rows.
    pub(crate) async fn are_new(&self) -> Result<bool, StoreError> {
        let mut connection = self.connect().await?;
        let row = connection
            .fetch_one(
                "SELECT EXISTS (SELECT 1 FROM cases) OR EXISTS (SELECT 1 FROM store WHERE complete) AS used",
                args![],
            )
            .await?;
        row.get("used").map(|used: bool| !used)
    }

    /// Gives these rows an id, unless they have one; returns the one that they have then.
    pub(crate) async fn make_store_id(&self, id: StoreId) -> Result<StoreId, StoreError> {
        let (mut transaction, _) = self.write().await?;
        transaction
            .execute(
                "INSERT INTO store (one, id) VALUES (1, $1) ON CONFLICT DO NOTHING",
                args![id.to_string()],
            )
            .await?;
        transaction.commit().await?;
        Ok(self.store_id().await?.unwrap_or(id))
    }

    /// Notes that the objects have the same id, so that nobody gives it to other ones.
    pub(crate) async fn complete_store_id(&self) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        transaction
            .execute(
                "UPDATE store SET complete = TRUE WHERE NOT complete",
                args![],
            )
            .await?;
        transaction.commit().await
    }

    /// Gives these rows another id.
    pub(crate) async fn change_store_id(&self, id: StoreId) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        transaction
            .execute("UPDATE store SET id = $1", args![id.to_string()])
            .await?;
        transaction.commit().await
    }
}
