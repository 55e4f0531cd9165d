//! What named users have chosen and saved for themselves.

use super::connection::Connection;
use crate::args;
use crate::{Store, StoreError};

impl Store {
    /// The document of a user; `None` if there is none.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn preferences(&self, user: &str) -> Result<Option<String>, StoreError> {
        read(&mut self.connect().await?, user).await
    }

    /// The names of all users with a document.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn users_with_preferences(&self) -> Result<Vec<String>, StoreError> {
        let rows = self
            .connect()
            .await?
            .fetch_all(
                "SELECT user_name FROM preferences ORDER BY user_name",
                args![],
            )
            .await?;
        rows.iter().map(|row| row.get("user_name")).collect()
    }

    /// Replaces the document of a user, or removes it, if it is still the one that is known; returns whether it was.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn replace_preferences(
        &self,
        user: &str,
        known: Option<&str>,
        document: Option<&str>,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if read(&mut transaction, user).await?.as_deref() != known {
            return Ok(false);
        }
        match document {
            Some(document) => {
                transaction
                    .execute(
                        "INSERT INTO preferences (user_name, document, changed_at) VALUES ($1, $2, $3)
                         ON CONFLICT (user_name) DO UPDATE SET document = excluded.document, changed_at = excluded.changed_at",
                        args![user, document, now],
                    )
                    .await?
            }
            None => {
                transaction
                    .execute("DELETE FROM preferences WHERE user_name = $1", args![user])
                    .await?
            }
        };
        transaction.commit().await?;
        Ok(true)
    }
}

async fn read(connection: &mut Connection, user: &str) -> Result<Option<String>, StoreError> {
    let row = connection
        .fetch_optional(
            "SELECT document FROM preferences WHERE user_name = $1",
            args![user],
        )
        .await?;
    row.map(|row| row.get("document")).transpose()
}
