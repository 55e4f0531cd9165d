//! What the upkeep of a store asks the rows: how much there is.

use super::connection::{Row, microseconds};
use super::expiry::count_expired;
use super::jobs;
use crate::args;
use crate::rows::RowCounts;
use crate::{ObjectName, Store, StoreError};
use case::ObjectKind;

/// How many cases and jobs are in which state, and how long jobs have waited, for metrics.
///
/// # Errors
/// If the rows cannot be read.
pub async fn row_counts(store: &Store) -> Result<RowCounts, StoreError> {
    let mut connection = store.connect().await?;
    let now = connection.now().await?;
    let rows = connection
        .fetch_all(
            "SELECT 'cases' AS what, '' AS part, state, count(*) AS number FROM cases GROUP BY state
             UNION ALL SELECT 'closed', CASE closed WHEN 1 THEN 'rejected' ELSE 'corrected' END, 'closed', count(*)
                 FROM cases WHERE closed > 0 GROUP BY closed
             UNION ALL SELECT 'jobs', kind, state, count(*) FROM jobs GROUP BY kind, state",
            args![],
        )
        .await?;
    let read = |row: &Row| {
        let [what, part, state] = ["what", "part", "state"].map(|column| row.get(column));
        let number: i64 = row.get("number")?;
        Ok((what?, part?, state?, number.unsigned_abs()))
    };
    let by_state = rows.iter().map(read).collect::<Result<_, StoreError>>()?;
    let expired = match store.options().keep {
        Some(keep) => {
            let before = now.saturating_sub(microseconds(keep));
            count_expired(&mut connection, before).await?
        }
        None => 0,
    };
    Ok(RowCounts {
        by_state,
        expired,
        oldest: jobs::oldest_of_each_kind(&mut connection, now).await?,
    })
}

impl Store {
    /// The next objects of one kind to which rows of other tables refer, by digest.
    pub(crate) async fn objects_of_tables(
        &self,
        kind: ObjectKind,
        after: Option<&ObjectName>,
        limit: usize,
    ) -> Result<Vec<ObjectName>, StoreError> {
        let mut connection = self.connect().await?;
        let tables = connection.tables();
        tables.objects(&mut connection, kind, after, limit).await
    }
}
