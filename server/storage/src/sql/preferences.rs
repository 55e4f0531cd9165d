//! What named users have chosen and saved for themselves.

use super::connection::{Connection, Row};
use crate::args;
use crate::{Store, StoreError};

/// The document of a user.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct UserPreferences {
    pub user: String,
    pub document: String,
    /// Microseconds since 1970.
    pub changed_at: i64,
}

impl Store {
    /// The document of a user; `None` if there is none.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn preferences(&self, user: &str) -> Result<Option<String>, StoreError> {
        read(&mut self.connect().await?, user).await
    }

    /// The documents of all users.
    pub(crate) async fn all_preferences(&self) -> Result<Vec<UserPreferences>, StoreError> {
        let rows = self
            .connect()
            .await?
            .fetch_all(
                "SELECT user_name, document, changed_at FROM preferences ORDER BY user_name",
                args![],
            )
            .await?;
        let read = |row: &Row| {
            Ok(UserPreferences {
                user: row.get("user_name")?,
                document: row.get("document")?,
                changed_at: row.get("changed_at")?,
            })
        };
        rows.iter().map(read).collect()
    }

    /// Writes the document of a user as another store has it, unless it was changed here at that time or later.
    pub(crate) async fn write_copied_preferences(
        &self,
        copied: UserPreferences,
    ) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        transaction
            .execute(
                "INSERT INTO preferences (user_name, document, changed_at) VALUES ($1, $2, $3)
                 ON CONFLICT (user_name) DO UPDATE SET document = excluded.document, changed_at = excluded.changed_at
                 WHERE excluded.changed_at > preferences.changed_at",
                args![copied.user, copied.document, copied.changed_at],
            )
            .await?;
        transaction.commit().await
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
