//! What the store asks of the tables of the PACS.

use async_trait::async_trait;
use case::images::Fingerprint;
use case::series::Uid;
use case::{CaseId, Failure, JobKind, ObjectKind};
use storage::args;
use storage::tables::{Connection, Migrations, Row, Tables};
use storage::{Made, ObjectName, StoreError};

use super::columns::{count, read_digest};
use super::{arrivals, images, results};
use crate::values::{SEND, SERIES};

const SQLITE: &Migrations = &[(
    210,
    "pacs",
    include_str!("../../migrations/sqlite/0210_pacs.sql"),
)];

const POSTGRES: &Migrations = &[(
    210,
    "pacs",
    include_str!("../../migrations/postgres/0210_pacs.sql"),
)];

/// The tables of the PACS. Every store of the program has them ([`storage::Options::tables`]).
#[derive(Debug)]
pub struct PacsTables;

#[async_trait]
impl Tables for PacsTables {
    fn migrations(&self) -> [&'static Migrations; 2] {
        [SQLITE, POSTGRES]
    }

    async fn needs(
        &self,
        connection: &mut Connection,
        object: &ObjectName,
    ) -> Result<bool, StoreError> {
        let sql = match object.kind {
            ObjectKind::Instance => {
                "SELECT EXISTS (SELECT 1 FROM arrival_instances WHERE digest = $1) AS needed"
            }
            ObjectKind::Result => {
                "SELECT EXISTS (SELECT 1 FROM results WHERE digest = $1) AS needed"
            }
            _ => return Ok(false),
        };
        let row = connection.fetch_one(sql, args![object.digest.to_string()]);
        row.await?.get("needed")
    }

    async fn objects(
        &self,
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
            .fetch_all(sql, args![after.unwrap_or_default(), count(limit)])
            .await?;
        let read = |row: &Row| {
            let digest = read_digest(row)?;
            Ok(ObjectName { kind, digest })
        };
        rows.iter().map(read).collect()
    }

    async fn leave_case(
        &self,
        connection: &mut Connection,
        case: &CaseId,
        now: i64,
    ) -> Result<(), StoreError> {
        arrivals::remove_of_case(connection, case, now).await?;
        results::abandon_of_case(connection, case, now).await
    }

    async fn last_sent(
        &self,
        connection: &mut Connection,
        image: &Uid,
    ) -> Result<Option<Fingerprint>, StoreError> {
        images::last_sent(connection, image).await
    }

    async fn judge(&self, connection: &mut Connection, made: &Made) -> Result<(), StoreError> {
        images::judge_made(connection, made).await
    }

    async fn refusal(
        &self,
        connection: &mut Connection,
        kind: JobKind,
        key: &str,
    ) -> Result<Option<Failure>, StoreError> {
        match kind {
            SEND => results::not_to_send(connection, key).await,
            _ => Ok(None),
        }
    }

    async fn job_failed(
        &self,
        connection: &mut Connection,
        kind: JobKind,
        key: &str,
        failure: &Failure,
    ) -> Result<(), StoreError> {
        match kind {
            SERIES => arrivals::make_nothing(connection, key, failure).await,
            _ => Ok(()),
        }
    }

    fn kept_jobs(&self) -> Option<JobKind> {
        Some(SEND)
    }
}
