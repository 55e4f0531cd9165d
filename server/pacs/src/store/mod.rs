//! The rows of the PACS in the store: what came from it, what it has rejected, and what is sent to it.

mod arrivals;
mod columns;
#[cfg(test)]
mod conformance;
mod copy;
mod counts;
mod images;
mod receive;
mod results;
mod tables;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::time::Duration;

use storage::args;
use storage::tables::{Row, microseconds};
use storage::upkeep::{self, Removal, Waiting};
use storage::{Store, StoreError};

pub use self::copy::{CopiedStep, CopyCounts};
use self::counts::ImageCounts;
pub use self::counts::ImageStatus;
pub(crate) use self::results::REJECTION_NOTE;
pub use self::tables::PacsTables;
use crate::values::ArrivalSource;

/// How long to remember what rejection notes have withdrawn: a PACS that sends the images again does so within days, and
/// UIDs should not stay for ever.
const REJECTIONS_KEPT: Duration = Duration::from_secs(365 * 24 * 3600);

/// The store with the rows of the PACS. Cheap to clone.
#[derive(Debug, Clone)]
pub struct PacsStore {
    store: Store,
    counts: Arc<ImageCounts>,
}

impl PacsStore {
    /// Of a store that was opened with [`PacsTables`].
    pub fn new(store: Store) -> Self {
        Self {
            store,
            counts: Arc::default(),
        }
    }

    /// The store itself.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// How many images came on which way and what became of them, since the process started.
    pub fn images(&self) -> Vec<(&'static str, ImageStatus, u64)> {
        self.counts.images()
    }

    /// Counts images that came.
    pub(crate) fn images_came(&self, source: ArrivalSource, status: ImageStatus, count: usize) {
        self.counts.came(source, status, count);
    }

    /// Forgets settled series for which nothing has come for this long, and results whose sending ended that long ago, and
    /// removes the objects that nobody needs then. What was withdrawn is remembered for a year. Returns why all of it stays, if some of it
    /// is too old and a wrong clock may be the reason, by the rules for cases.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written.
    pub async fn forget(
        &self,
        unchanged: Duration,
        removal: Removal,
    ) -> Result<Option<Waiting>, StoreError> {
        let waiting = upkeep::received_waits(&self.store, unchanged, removal).await?;
        if waiting.is_some() {
            let is_any = self
                .too_old(unchanged)
                .await?
                .iter()
                .any(|number| *number > 0);
            return Ok(waiting.filter(|_| is_any));
        }
        let (mut transaction, now) = self.store.write().await?;
        let [before, long_ago] = times_before(now, unchanged);
        arrivals::forget(&mut transaction, before, now).await?;
        results::forget(&mut transaction, before, now).await?;
        images::forget(&mut transaction, long_ago).await?;
        transaction.commit().await?;
        self.store.collect().await?;
        Ok(None)
    }

    /// How many series, and how many rejections, are older than [`PacsStore::forget`] leaves them.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn too_old(&self, unchanged: Duration) -> Result<[u64; 2], StoreError> {
        let mut connection = self.store.connect().await?;
        let [before, long_ago] = times_before(connection.now().await?, unchanged);
        let row = connection
            .fetch_one(
                "SELECT (SELECT count(*) FROM arrivals WHERE state <> 'receiving' AND last_at <= $1) AS series,
                        (SELECT count(*) FROM rejections WHERE rejected_at <= $2) AS rejections",
                args![before, long_ago],
            )
            .await?;
        let [series, rejections] = ["series", "rejections"].map(|column| row.get::<i64>(column));
        Ok([series?.unsigned_abs(), rejections?.unsigned_abs()])
    }

    /// How many series and results are in which state, as [`storage::upkeep::RowCounts`] has them.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn counts_by_state(&self) -> Result<Vec<(String, String, String, u64)>, StoreError> {
        let rows = self.store.connect()
            .await?
            .fetch_all(
                "SELECT 'arrivals' AS what, '' AS part, state, count(*) AS number FROM arrivals GROUP BY state
                 UNION ALL SELECT 'results', node, state, count(*) FROM
                     (SELECT node, coalesce((SELECT jobs.state FROM jobs WHERE jobs.key = results.id
                                             ORDER BY jobs.created_at DESC, jobs.id DESC LIMIT 1), 'done') AS state
                      FROM results) AS sent GROUP BY node, state",
                args![],
            )
            .await?;
        let read = |row: &Row| {
            let [what, part, state] = ["what", "part", "state"].map(|column| row.get(column));
            Ok((
                what?,
                part?,
                state?,
                row.get::<i64>("number")?.unsigned_abs(),
            ))
        };
        rows.iter().map(read).collect()
    }

    /// How many series with how many images have come, and how many results there are.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn count(&self) -> Result<CopyCounts, StoreError> {
        let mut connection = self.store.connect().await?;
        let row = connection
            .fetch_one(
                "SELECT (SELECT count(*) FROM arrivals) AS series, (SELECT count(*) FROM arrival_instances) AS images,
                        (SELECT count(*) FROM results) AS results",
                args![],
            )
            .await?;
        let count = |column| row.get::<i64>(column).map(i64::unsigned_abs);
        Ok(CopyCounts {
            series: count("series")?,
            images: count("images")?,
            results: count("results")?,
        })
    }
}

/// Before which times series and results, and before which rejections, are too old.
fn times_before(now: i64, unchanged: Duration) -> [i64; 2] {
    [unchanged, REJECTIONS_KEPT.max(unchanged)].map(|age| now.saturating_sub(microseconds(age)))
}
