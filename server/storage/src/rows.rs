//! Rows: cases, their objects, and jobs; the interface to a database.
//!
//! Every method is one transaction, which ends before it returns. The time is the database's own: leases, pins and
//! tombstones of several machines, whose clocks differ, are compared by one clock. Callers give durations.
//!
//! An object is removed in three steps, none of which holds a transaction while the object store works:
//! [`CaseRows::mark`] leaves a tombstone on an unneeded object, the object is deleted, and [`CaseRows::bury`] removes
//! the tombstone. An object with a tombstone cannot be pinned, and a pinned or needed object gets no tombstone; so no
//! object is deleted that a process is about to reference. A tombstone has a lease: if its holder is killed, another
//! sweep takes it over and deletes the object again.

mod due;
mod layers;
mod results;
mod terms;

use std::time::Duration;

use async_trait::async_trait;
use futures_util::stream::BoxStream;

pub use self::due::DueSeries;
pub use self::layers::{
    ChangedLayer, InsertedLayer, LayerChange, LayerClaim, LayerName, LayerRows, NewLayer,
};
pub use self::results::ResultRows;
pub use self::terms::{LeaseTerms, Pinned, Published, Release};
use super::arrivals::{
    Arrival, ArrivalCursor, ArrivalSource, CaseSeries, DueTerms, NewInstance, Outcome, Retrieval,
    SeriesQuery, SeriesUids, TransferEnd, TransferQuery, Uid,
};

use super::{Cursor, ForPacs, ObjectName, Page, StoreError};
use case::{Case, CaseFacts, CaseId, Failure, ObjectKind, Parameters, Progress};

/// A case to be inserted.
#[derive(Debug, Clone)]
pub struct NewCase {
    /// Its name.
    pub id: CaseId,
    /// The parameters from the upload.
    pub parameters: Parameters,
    /// The case of which it is a version.
    pub previous: Option<CaseId>,
    /// Its source objects: durable, and pinned.
    pub sources: Pinned,
    /// How many jobs may wait.
    pub queue_limit: usize,
}

/// The result of an insertion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Inserted {
    /// The case is new, and queued.
    Created,
    /// It existed and had failed; it is queued again.
    Requeued,
    /// It existed.
    Exists,
    /// The queue is full. Nothing has changed.
    QueueFull,
    /// A pin is gone, and perhaps its object too; write the objects again. Nothing has changed.
    PinLost,
}

/// A leased job.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    /// The case to be prepared.
    pub id: CaseId,
    /// The parameters.
    pub parameters: Parameters,
    /// The source objects.
    pub sources: Vec<ObjectName>,
    /// The number of this lease; a greater one fences it off.
    pub fence: i64,
    /// The number of leases that had no result, including this one.
    pub attempt: u32,
}

/// The holder of tombstones, and their lease.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// Unique for each sweep.
    pub holder: String,
    /// After this time, another sweep may take over the tombstones.
    pub lease: Duration,
}

/// How many rows are in which state.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RowCounts {
    /// What they are (`cases`, `arrivals`, `retrievals`, `results`), the node if they have one, their state, and how many.
    pub by_state: Vec<(String, String, String, u64)>,
    /// For how long the oldest result waits that has not been sent.
    pub oldest_unsent: Option<Duration>,
}

/// A change of the rows by any process, including this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// A job waits for a worker.
    Queued,
    /// A case is new or has changed.
    Changed(CaseId),
    /// A case was deleted.
    Deleted(CaseId),
}

/// Cases, the objects they need, and jobs, in a database that several processes may share.
#[async_trait]
pub trait CaseRows: ArrivalRows + LayerRows + ResultRows {
    /// Protects objects from removal for a time, before they are written. `false`, and nothing has changed, if one of
    /// them has a tombstone: try again once it is buried.
    async fn pin(&self, pinned: &Pinned, lease: Duration) -> Result<bool, StoreError>;

    /// Makes pins expire at once, because the objects are not needed.
    async fn unpin(&self, pinned: &Pinned) -> Result<(), StoreError>;

    /// Makes a case and its job, and turns its pins into references; or queues a failed one again. A version gets the
    /// layers of the case that it is a version of.
    async fn insert(&self, new: &NewCase) -> Result<Inserted, StoreError>;

    /// One case.
    async fn case(&self, id: &CaseId) -> Result<Option<Case>, StoreError>;

    /// At most `limit` cases after a cursor, newest first.
    async fn cases(&self, after: Option<&Cursor>, limit: usize) -> Result<Page, StoreError>;

    /// At most `limit` ready cases whose volumes have the same stored values in any order
    /// ([`VoxelFacts::values`](case::VoxelFacts::values)), newest first.
    async fn cases_with_voxels(&self, values: &str, limit: usize) -> Result<Vec<Case>, StoreError>;

    /// The objects that a case needs; none if there is no such case.
    async fn objects(&self, id: &CaseId) -> Result<Vec<ObjectName>, StoreError>;

    /// Changes the label of a case; nothing if there is no such case.
    async fn rename(&self, id: &CaseId, name: &str) -> Result<(), StoreError>;

    /// Removes a case with its job and its layers; returns whether it existed. Its objects are left with expired pins;
    /// its versions become those of the case that it is a version of.
    async fn delete(&self, id: &CaseId) -> Result<bool, StoreError>;

    /// Lets the age of a case count from now, because its input was uploaded again; returns whether it exists.
    async fn uploaded_again(&self, id: &CaseId) -> Result<bool, StoreError>;

    /// Keeps a case for good, or no longer; returns whether it exists.
    async fn keep(&self, id: &CaseId, kept: bool) -> Result<bool, StoreError>;

    /// At most `limit` cases that are ready or failed, not kept, and were last uploaded at least `age` ago; oldest first.
    async fn expired(&self, age: Duration, limit: usize) -> Result<Vec<CaseId>, StoreError>;

    /// As [`CaseRows::delete`], if the case is still [`CaseRows::expired`]; returns whether it was.
    async fn delete_expired(&self, id: &CaseId, age: Duration) -> Result<bool, StoreError>;

    /// How many jobs wait for a lease.
    async fn waiting(&self) -> Result<usize, StoreError>;

    /// Leases the oldest job that waits or whose lease has ended. Jobs with too many attempts behind them fail on the
    /// way.
    async fn claim(&self, terms: &LeaseTerms) -> Result<Option<Claim>, StoreError>;

    /// Renews a lease from now on and notes the progress; `false` if the lease is not ours any more.
    async fn renew(
        &self,
        claim: &Claim,
        lease: Duration,
        progress: Option<Progress>,
    ) -> Result<bool, StoreError>;

    /// Returns a lease; `false` if it is not ours any more.
    async fn release(&self, claim: &Claim, release: Release) -> Result<bool, StoreError>;

    /// Makes a case ready, if the lease is still ours.
    async fn publish(
        &self,
        claim: &Claim,
        derived: &Pinned,
        facts: &CaseFacts,
    ) -> Result<Published, StoreError>;

    /// Makes a case failed, if the lease is still ours; returns whether it was.
    async fn fail(&self, claim: &Claim, failure: &Failure) -> Result<bool, StoreError>;

    /// Gives a ready case other derived objects, after a rebuild. [`Published::Fenced`] where it is not ready.
    async fn replace(&self, id: &CaseId, derived: &Pinned) -> Result<Published, StoreError>;

    /// Makes a ready case failed, because its source is lost; returns whether it was ready.
    async fn condemn(&self, id: &CaseId, failure: &Failure) -> Result<bool, StoreError>;

    /// Leases the rebuild of a case, or renews the lease; `false` if another one has it, or there is no such case.
    async fn begin_rebuild(
        &self,
        id: &CaseId,
        holder: &str,
        lease: Duration,
    ) -> Result<bool, StoreError>;

    /// Releases the rebuild of a case, if the holder still has it.
    async fn end_rebuild(&self, id: &CaseId, holder: &str) -> Result<(), StoreError>;

    /// At most `limit` objects that may have to be removed: with an expired pin, or with a tombstone whose lease has
    /// ended.
    async fn abandoned(&self, limit: usize) -> Result<Vec<ObjectName>, StoreError>;

    /// Leaves the sweep's tombstone on those of the given objects that no case needs, no live pin protects and no other
    /// live sweep removes, and forgets the expired pins of all of them. The objects with the sweep's tombstone are its
    /// own to delete.
    async fn mark(
        &self,
        names: &[ObjectName],
        sweep: &Sweep,
    ) -> Result<Vec<ObjectName>, StoreError>;

    /// Removes the tombstones of a sweep after their objects are deleted, if the sweep still holds them.
    async fn bury(&self, holder: &str) -> Result<(), StoreError>;

    /// Those of the given objects that no case needs, no pin protects and no sweep removes.
    async fn unneeded(&self, names: &[ObjectName]) -> Result<Vec<ObjectName>, StoreError>;

    /// The next objects of one kind that came from a PACS and are no case yet (`instance`), or that are sent to one (`result`), by digest.
    async fn pacs_objects(
        &self,
        kind: ObjectKind,
        after: Option<&ObjectName>,
        limit: usize,
    ) -> Result<Vec<ObjectName>, StoreError>;

    /// Inserts a case of another store as it is there, or makes the one that is here so, and turns its pins into
    /// references; one that is not ready or failed is queued. `false`, and nothing has changed, where it is ready here
    /// and not there.
    async fn adopt(&self, case: &Case, objects: &Pinned) -> Result<bool, StoreError>;

    /// Ends every lease and expires every pin, because no other process runs that could hold one.
    async fn forget_holders(&self) -> Result<(), StoreError>;

    /// Whether the rows can be read and written. Changes nothing.
    async fn check(&self) -> Result<(), StoreError>;

    /// Checks the integrity of the database itself. Takes as long as reading it.
    async fn inspect(&self) -> Result<(), StoreError>;

    /// The changes of all processes from now on, as they are committed; `None` if the database cannot report them. Some
    /// may be missed, so a process that waits for one must also poll.
    async fn changes(&self) -> Result<Option<BoxStream<'static, Change>>, StoreError> {
        Ok(None)
    }

    /// Finishes all work before the process ends. No other method may be called afterwards.
    async fn close(&self) {}
}

/// Series that arrive, are fetched, and are cases, in a database that several processes may share.
#[async_trait]
pub trait ArrivalRows: std::fmt::Debug + Send + Sync {
    /// Adds images, whose objects are durable and pinned, to their series, and turns the pins into references; returns
    /// how many are new. An image that is there already stays as it is. `None`, and nothing has changed, if a pin is
    /// gone: write the objects again.
    async fn receive(
        &self,
        instances: &[NewInstance],
        pinned: &Pinned,
        source: ArrivalSource,
    ) -> Result<Option<usize>, StoreError>;

    /// Makes a series of another store as it is there, and adds images as [`ArrivalRows::receive`] does; `false`, and
    /// nothing has changed, if a pin is gone. A series whose case is not here is read again.
    async fn adopt_arrival(
        &self,
        arrival: &Arrival,
        images: &[NewInstance],
        pinned: &Pinned,
    ) -> Result<bool, StoreError>;

    /// Notes how many images a series has, according to its sender; nothing if none of them has come.
    async fn expect(&self, uids: &SeriesUids, instances: usize) -> Result<(), StoreError>;

    /// Leases the series that is due and has waited longest.
    async fn lease_due(&self, terms: &DueTerms) -> Result<Option<DueSeries>, StoreError>;

    /// Notes what became of a leased series; `false`, and nothing has changed, if the lease is not ours any more, or
    /// the case is gone.
    async fn settle(&self, due: &DueSeries, outcome: &Outcome) -> Result<bool, StoreError>;

    /// At most `limit` series after a cursor, newest first, and the cursor of the next page.
    async fn arrivals(
        &self,
        after: Option<&ArrivalCursor>,
        limit: usize,
    ) -> Result<(Vec<Arrival>, Option<ArrivalCursor>), StoreError>;

    /// A series that came.
    async fn arrival(&self, id: &str) -> Result<Option<Arrival>, StoreError>;

    /// The series that came and that a request names.
    async fn arrivals_of(&self, query: &SeriesQuery) -> Result<Vec<Arrival>, StoreError>;

    /// Forgets settled series for which nothing has come for this long, and abandons their images; returns how many. Also
    /// forgets retrievals and results that ended and are that old. With `keep_cases`, the series of cases stay.
    async fn forget_arrivals(
        &self,
        unchanged: Duration,
        keep_cases: bool,
    ) -> Result<usize, StoreError>;

    /// The images of a series that are here, by their UIDs.
    async fn images_of(&self, uids: &SeriesUids) -> Result<Vec<(Uid, ObjectName)>, StoreError>;

    /// How many cases, series, retrievals and results are in which state, for metrics.
    async fn row_counts(&self) -> Result<RowCounts, StoreError>;

    /// How many series with how many images have come, and how many results there are.
    async fn count_for_pacs(&self) -> Result<ForPacs, StoreError>;

    /// At most `limit` studies of cases after the first `offset` ones, the one with the newest case first.
    async fn studies(&self, offset: usize, limit: usize) -> Result<Vec<Uid>, StoreError>;

    /// Enters the series of a case into the index; nothing if there is no such case.
    async fn index_series(&self, series: &CaseSeries) -> Result<(), StoreError>;

    /// The indexed series of a case.
    async fn series_of(&self, case: &CaseId) -> Result<Option<CaseSeries>, StoreError>;

    /// The cases that a request names, newest first.
    async fn cases_of(&self, query: &SeriesQuery) -> Result<Vec<CaseSeries>, StoreError>;

    /// Queues a retrieval; returns the one that waits already for the same series from the same node.
    async fn request(&self, node: &str, uids: &SeriesUids) -> Result<Retrieval, StoreError>;

    /// At most `limit` retrievals after a cursor, newest first, and the cursor of the next page.
    async fn retrievals(
        &self,
        query: &TransferQuery,
        after: Option<&ArrivalCursor>,
        limit: usize,
    ) -> Result<(Vec<Retrieval>, Option<ArrivalCursor>), StoreError>;

    /// A retrieval.
    async fn retrieval(&self, id: &str) -> Result<Option<Retrieval>, StoreError>;

    /// Leases the retrieval that has waited longest.
    async fn lease_retrieval(&self, lease: Duration) -> Result<Option<Retrieval>, StoreError>;

    /// Renews the lease of a retrieval and notes how far it is; `false` if the lease is not ours any more.
    async fn progress(
        &self,
        retrieval: &Retrieval,
        received: usize,
        expected: Option<usize>,
        lease: Duration,
    ) -> Result<bool, StoreError>;

    /// Ends the lease of a retrieval; `false` if it is not ours any more.
    async fn end_retrieval(
        &self,
        retrieval: &Retrieval,
        fetched: &TransferEnd,
    ) -> Result<bool, StoreError>;
}
