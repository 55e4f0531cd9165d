//! What a crate needs that has tables of its own in the database of the store: it answers what the store must know of them ([`Tables`]),
//! and its statements run in the transactions of the store ([`Store::write`](crate::Store::write)).

use std::fmt;

use async_trait::async_trait;
use case::images::Fingerprint;
use case::series::Uid;
use case::{CaseId, Failure, JobKind, ObjectKind};

use crate::{Made, ObjectName, StoreError};

pub use crate::pinned::Writing;
pub use crate::rows::Referred;
pub use crate::sql::cases::read_state;
pub use crate::sql::connection::{
    Column, Connection, Query, Row, Value, containing, microseconds, new_id, read_time, unreadable,
};
pub use crate::sql::made::{as_it_is_known, read_closed, read_fingerprint, read_uid};
pub use crate::sql::series::{read_accession_number, read_case, read_uids};

/// The migrations of a database, oldest first: a number, a name and the statements of each. A database remembers the digests of those that
/// it has had, so what stands here never changes.
pub type Migrations = [(i64, &'static str, &'static str)];

/// Statements about jobs.
pub mod jobs {
    pub use crate::sql::jobs::{
        became, cancel, enqueue, finish, latest_of_key, remove, write_copied,
    };
}

/// Statements about the images that something was made of.
pub mod made {
    pub use crate::sql::made::{forget, make};
}

/// Statements about layers.
pub mod layers {
    pub use crate::sql::layers::of_case;
}

/// Statements about the pins of objects, which a transaction turns into references, or leaves on what it no longer needs.
pub mod pins {
    pub use crate::sql::hold;
    pub use crate::sql::pins::{abandon, consume};
}

/// Tables of another crate, whose rows refer to cases, objects and jobs of the store. A database that has them is opened with them only:
/// whoever does not ask them removes their objects.
#[async_trait]
pub trait Tables: fmt::Debug + Send + Sync {
    /// Those of SQLite and those of PostgreSQL. Their numbers follow those of the store.
    fn migrations(&self) -> [&'static Migrations; 2] {
        [&[], &[]]
    }

    /// Whether a row refers to an object, which then stays.
    async fn needs(&self, _: &mut Connection, _object: &ObjectName) -> Result<bool, StoreError> {
        Ok(false)
    }

    /// The next objects of a kind to which rows refer, by digest.
    async fn objects(
        &self,
        _: &mut Connection,
        _kind: ObjectKind,
        _after: Option<&ObjectName>,
        _limit: usize,
    ) -> Result<Vec<ObjectName>, StoreError> {
        Ok(Vec::new())
    }

    /// Prepares for the deletion of a case: abandons the objects of the rows that go with it.
    async fn leave_case(
        &self,
        _: &mut Connection,
        _: &CaseId,
        _now: i64,
    ) -> Result<(), StoreError> {
        Ok(())
    }

    /// The image that was sent last under a UID.
    async fn last_sent(
        &self,
        _: &mut Connection,
        _: &Uid,
    ) -> Result<Option<Fingerprint>, StoreError> {
        Ok(None)
    }

    /// Writes whether something is closed, by the images that it was made of.
    async fn judge(&self, _: &mut Connection, _: &Made) -> Result<(), StoreError> {
        Ok(())
    }

    /// Why a job with this key must not be done any more, which is asked when it is claimed.
    async fn refusal(
        &self,
        _: &mut Connection,
        _: JobKind,
        _key: &str,
    ) -> Result<Option<Failure>, StoreError> {
        Ok(None)
    }

    /// Notes that a job with this key has failed for good.
    async fn job_failed(
        &self,
        _: &mut Connection,
        _: JobKind,
        _key: &str,
        _: &Failure,
    ) -> Result<(), StoreError> {
        Ok(())
    }

    /// The kind of the jobs that stay after their end until their row here goes.
    fn kept_jobs(&self) -> Option<JobKind> {
        None
    }
}

/// No tables.
impl Tables for () {}
