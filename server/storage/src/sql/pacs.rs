//! The interface of the rows of what comes from a PACS.

use std::time::Duration;

use async_trait::async_trait;

use super::connection::{Connection, Row, microseconds};
use super::{SqlRows, arrivals, pins, results, retrievals};
use crate::arrivals::{
    Arrival, ArrivalCursor, ArrivalSource, CaseSeries, DueTerms, NewInstance, Outcome, Retrieval,
    SeriesQuery, SeriesUids, TransferEnd, TransferQuery, Uid,
};
use crate::rows::{ArrivalRows, DueSeries, Pinned, RowCounts};
use crate::{ForPacs, ObjectName, StoreError};
use case::{CaseId, ObjectKind};

/// The next objects of a kind that has rows of its own, by digest; none of another kind.
pub(super) async fn objects(
    connection: &mut Connection,
    kind: ObjectKind,
    after: Option<&ObjectName>,
    limit: usize,
) -> Result<Vec<ObjectName>, StoreError> {
    let sql = match kind {
        ObjectKind::Instance => {
            "SELECT DISTINCT digest FROM arrival_instances WHERE digest > $1 ORDER BY digest LIMIT $2"
        }
        ObjectKind::Result => {
            "SELECT DISTINCT digest FROM results WHERE digest > $1 ORDER BY digest LIMIT $2"
        }
        _ => return Ok(Vec::new()),
    };
    let after = after.map(|name| name.digest.to_string());
    let rows = connection
        .query(sql)
        .bind(after.unwrap_or_default())
        .bind(i64::try_from(limit).unwrap_or(i64::MAX))
        .fetch_all()
        .await?;
    let read = |row: &Row| {
        let digest: String = row.get("digest")?;
        let unreadable = |_| StoreError::Rows("a row has an unreadable digest".into());
        let digest = blake3::Hash::from_hex(digest).map_err(unreadable)?;
        Ok(ObjectName { kind, digest })
    };
    rows.iter().map(read).collect()
}

#[async_trait]
impl ArrivalRows for SqlRows {
    async fn receive(
        &self,
        instances: &[NewInstance],
        pinned: &Pinned,
        source: ArrivalSource,
    ) -> Result<Option<usize>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !pins::consume(&mut transaction, pinned).await? {
            return Ok(None);
        }
        let mut new = 0;
        for instance in instances {
            new += usize::from(arrivals::add(&mut transaction, instance, source, now).await?);
        }
        transaction.commit().await?;
        Ok(Some(new))
    }

    async fn adopt_arrival(
        &self,
        arrival: &Arrival,
        images: &[NewInstance],
        pinned: &Pinned,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        if !pins::consume(&mut transaction, pinned).await? {
            return Ok(false);
        }
        arrivals::adopt(&mut transaction, arrival, images, now).await?;
        transaction.commit().await?;
        Ok(true)
    }

    async fn expect(&self, uids: &SeriesUids, instances: usize) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        arrivals::expect(&mut transaction, uids, instances).await?;
        transaction.commit().await
    }

    async fn lease_due(&self, terms: &DueTerms) -> Result<Option<DueSeries>, StoreError> {
        // Most queries find nothing and must not wait for writers.
        let mut reader = self.database.connect().await?;
        let now = self.now(&mut reader).await?;
        if arrivals::due(&mut reader, terms, now).await?.is_none() {
            return Ok(None);
        }
        drop(reader);
        let (mut transaction, now) = self.write().await?;
        let Some(id) = arrivals::due(&mut transaction, terms, now).await? else {
            return Ok(None);
        };
        let until = now + microseconds(terms.lease);
        let due = arrivals::lease(&mut transaction, &id, until).await?;
        transaction.commit().await?;
        Ok(Some(due))
    }

    async fn settle(&self, due: &DueSeries, outcome: &Outcome) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let settled = arrivals::settle(&mut transaction, due, outcome, now).await?;
        if settled {
            transaction.commit().await?;
        }
        Ok(settled)
    }

    async fn arrivals(
        &self,
        after: Option<&ArrivalCursor>,
        limit: usize,
    ) -> Result<(Vec<Arrival>, Option<ArrivalCursor>), StoreError> {
        arrivals::page(&mut self.database.connect().await?, after, limit).await
    }

    async fn arrival(&self, id: &str) -> Result<Option<Arrival>, StoreError> {
        arrivals::one(&mut self.database.connect().await?, id).await
    }

    async fn arrivals_of(&self, query: &SeriesQuery) -> Result<Vec<Arrival>, StoreError> {
        arrivals::of(&mut self.database.connect().await?, query).await
    }

    async fn images_of(&self, uids: &SeriesUids) -> Result<Vec<(Uid, ObjectName)>, StoreError> {
        arrivals::images_of(&mut self.database.connect().await?, uids).await
    }

    async fn row_counts(&self) -> Result<RowCounts, StoreError> {
        let mut connection = self.database.connect().await?;
        let now = self.now(&mut connection).await?;
        let rows = connection
            .query(
                "SELECT 'cases' AS what, '' AS node, state, count(*) AS number FROM cases GROUP BY state
                 UNION ALL SELECT 'arrivals', '', state, count(*) FROM arrivals GROUP BY state
                 UNION ALL SELECT 'retrievals', node, state, count(*) FROM retrievals GROUP BY node, state
                 UNION ALL SELECT 'results', node, state, count(*) FROM results GROUP BY node, state",
            )
            .fetch_all()
            .await?;
        let read = |row: &Row| {
            let [what, node, state] = ["what", "node", "state"].map(|column| row.get(column));
            let number: i64 = row.get("number")?;
            Ok((what?, node?, state?, number.unsigned_abs()))
        };
        let by_state = rows.iter().map(read).collect::<Result<_, StoreError>>()?;
        let oldest = connection
            .query("SELECT min(created_at) AS oldest FROM results WHERE state IN ('queued', 'running')")
            .fetch_one()
            .await?;
        let oldest: Option<i64> = oldest.get("oldest")?;
        Ok(RowCounts {
            by_state,
            oldest_unsent: oldest.map(|oldest| {
                Duration::from_micros(now.saturating_sub(oldest).max(0).unsigned_abs())
            }),
        })
    }

    async fn count_for_pacs(&self) -> Result<ForPacs, StoreError> {
        let mut connection = self.database.connect().await?;
        let row = connection
            .query(
                "SELECT (SELECT count(*) FROM arrivals) AS series, (SELECT count(*) FROM arrival_instances) AS images,
                        (SELECT count(*) FROM results) AS results",
            )
            .fetch_one()
            .await?;
        let count = |column| row.get::<i64>(column).map(i64::unsigned_abs);
        Ok(ForPacs {
            series: count("series")?,
            images: count("images")?,
            results: count("results")?,
        })
    }

    async fn studies(&self, offset: usize, limit: usize) -> Result<Vec<Uid>, StoreError> {
        arrivals::studies(&mut self.database.connect().await?, offset, limit).await
    }

    async fn forget_arrivals(
        &self,
        unchanged: Duration,
        keep_cases: bool,
    ) -> Result<usize, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let before = now - microseconds(unchanged);
        let forgotten = arrivals::forget(&mut transaction, before, keep_cases, now).await?;
        retrievals::forget(&mut transaction, before).await?;
        results::forget(&mut transaction, before, now).await?;
        transaction.commit().await?;
        Ok(forgotten)
    }

    async fn index_series(&self, series: &CaseSeries) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        arrivals::index(&mut transaction, series).await?;
        transaction.commit().await
    }

    async fn series_of(&self, case: &CaseId) -> Result<Option<CaseSeries>, StoreError> {
        arrivals::series_of(&mut self.database.connect().await?, case).await
    }

    async fn cases_of(&self, query: &SeriesQuery) -> Result<Vec<CaseSeries>, StoreError> {
        arrivals::cases_of(&mut self.database.connect().await?, query).await
    }

    async fn request(&self, node: &str, uids: &SeriesUids) -> Result<Retrieval, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let retrieval = retrievals::request(&mut transaction, node, uids, now).await?;
        transaction.commit().await?;
        Ok(retrieval)
    }

    async fn retrievals(
        &self,
        query: &TransferQuery,
        after: Option<&ArrivalCursor>,
        limit: usize,
    ) -> Result<(Vec<Retrieval>, Option<ArrivalCursor>), StoreError> {
        retrievals::page(&mut self.database.connect().await?, query, after, limit).await
    }

    async fn retrieval(&self, id: &str) -> Result<Option<Retrieval>, StoreError> {
        retrievals::one(&mut self.database.connect().await?, id).await
    }

    async fn lease_retrieval(&self, lease: Duration) -> Result<Option<Retrieval>, StoreError> {
        let mut reader = self.database.connect().await?;
        let now = self.now(&mut reader).await?;
        if retrievals::available(&mut reader, now).await?.is_none() {
            return Ok(None);
        }
        drop(reader);
        let (mut transaction, now) = self.write().await?;
        let Some(id) = retrievals::available(&mut transaction, now).await? else {
            return Ok(None);
        };
        let until = now + microseconds(lease);
        let leased = retrievals::lease(&mut transaction, &id, until).await?;
        transaction.commit().await?;
        Ok(leased)
    }

    async fn progress(
        &self,
        retrieval: &Retrieval,
        received: usize,
        expected: Option<usize>,
        lease: Duration,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let until = now + microseconds(lease);
        let ours =
            retrievals::progress(&mut transaction, retrieval, received, expected, until).await?;
        transaction.commit().await?;
        Ok(ours)
    }

    async fn end_retrieval(
        &self,
        retrieval: &Retrieval,
        fetched: &TransferEnd,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let ended = retrievals::end(&mut transaction, retrieval, fetched, now).await?;
        transaction.commit().await?;
        Ok(ended)
    }
}
