//! What cases and layers have in common: a state, a job that prepares them, the digest of their facts, their age, and the objects that they need.

use case::{CaseId, CaseState, Failure, JobKind};
use serde::Serialize;

use super::connection::{Connection, read_name};
use super::{jobs, pins};
use crate::args;
use crate::jobs::NewJob;
use crate::natural::natural_key;
use crate::rows::{Owner, Pinned, Published, Referred, Relabel};
use crate::{ObjectName, Store, StoreError};

impl Store {
    /// The objects that a case or a layer needs; none if there is none.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn objects_of(&self, owner: impl Into<Owner>) -> Result<Vec<ObjectName>, StoreError> {
        objects(&mut self.connect().await?, owner.into()).await
    }

    /// Gives a case or a layer further objects, or others of their kinds. [`Published::Fenced`] if it is not there, or not ready though it
    /// must be.
    pub(crate) async fn refer(
        &self,
        owner: Owner,
        pinned: &Pinned,
        must_be_ready: bool,
    ) -> Result<Referred<Published>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let state = state(&mut transaction, owner).await?;
        if state.is_none_or(|state| must_be_ready && state != CaseState::Ready) {
            return Ok(Referred::Unneeded(Published::Fenced));
        }
        if !refer(&mut transaction, owner, pinned, now).await? {
            return Ok(Referred::PinLost);
        }
        transaction.commit().await?;
        Ok(Referred::Done(Published::Done))
    }

    /// Queues a case or a layer again if it is failed, or ready; returns whether it was. The placement of a layer stays.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub async fn prepare_again(
        &self,
        owner: impl Into<Owner>,
        if_it_is: CaseState,
    ) -> Result<bool, StoreError> {
        let owner = owner.into();
        let (mut transaction, now) = self.write().await?;
        if state(&mut transaction, owner).await? != Some(if_it_is) {
            return Ok(false);
        }
        queue_again(&mut transaction, owner, "", now).await?;
        transaction.commit().await?;
        self.signals().queued();
        self.signals().changed(&owner.case);
        Ok(true)
    }
}

/// The columns `state`, `failure`, `facts` and `facts_digest` of a case or a layer that is copied: what has not ended is queued.
pub(super) fn copied(
    state: CaseState,
    failure: Option<&Failure>,
    facts: Option<&impl Serialize>,
) -> Result<(CaseState, [Option<String>; 3]), StoreError> {
    let state = match state.is_final() {
        true => state,
        false => CaseState::Queued,
    };
    let failure = failure.map(serde_json::to_string).transpose()?;
    let facts = facts.map(serde_json::to_string).transpose()?;
    let digest = facts.as_deref().map(digest);
    Ok((state, [failure, facts, digest]))
}

/// The digest of facts, as it is stored beside them.
pub(super) fn digest(facts: &str) -> String {
    blake3::hash(facts.as_bytes()).to_string()
}

/// The state of a case to which something comes again, if there is one: its age counts from now, and it may get this label.
pub(super) async fn came_again(
    connection: &mut Connection,
    id: &CaseId,
    name: Option<&str>,
    relabel: Relabel,
    now: i64,
) -> Result<Option<CaseState>, StoreError> {
    let first = name.filter(|_| relabel == Relabel::Any);
    let last = name.filter(|_| relabel == Relabel::Unlabelled);
    let row = connection
        .fetch_optional(
            "UPDATE cases SET uploaded_at = $1, name = coalesce($2, name, $3),
                              label_key = coalesce($5, CASE WHEN name IS NULL THEN $6 END, label_key) WHERE id = $4
             RETURNING state, NULL AS job_state",
            args![now, first, last, id.to_string(), first.map(natural_key), last.map(natural_key)],
        )
        .await?;
    Ok(row.as_ref().and_then(jobs::read_state))
}

/// The state of a case or a layer as it is written; `None` if there is none.
pub(super) async fn state(
    connection: &mut Connection,
    owner: Owner,
) -> Result<Option<CaseState>, StoreError> {
    let [case, layer] = owner.columns();
    let row = connection
        .fetch_optional(
            "SELECT state, NULL AS job_state FROM cases WHERE id = $1 AND $2 = ''
             UNION ALL SELECT state, NULL FROM layers WHERE case_id = $1 AND id = $2",
            args![case, layer],
        )
        .await?;
    Ok(row.as_ref().and_then(jobs::read_state))
}

/// Queues the preparation of a case or a layer that is there.
pub(super) async fn queue_again(
    connection: &mut Connection,
    owner: Owner,
    client: &str,
    now: i64,
) -> Result<(), StoreError> {
    let case = owner.case.to_string();
    let (kind, queued) = match owner.layer {
        None => {
            let sql = "UPDATE cases SET state = 'queued', failure = NULL, facts = NULL, facts_digest = NULL WHERE id = $1";
            (JobKind::PREPARE, connection.execute(sql, args![case]))
        }
        Some(layer) => {
            let sql =
                "UPDATE layers SET state = 'queued', failure = NULL WHERE case_id = $1 AND id = $2";
            let args = args![case, layer.to_string()];
            (JobKind::LAYER, connection.execute(sql, args))
        }
    };
    queued.await?;
    jobs::enqueue_for(connection, &NewJob::about(kind, owner), client, now).await
}

/// The objects that a case or a layer needs.
pub(super) async fn objects(
    connection: &mut Connection,
    owner: Owner,
) -> Result<Vec<ObjectName>, StoreError> {
    let [case, layer] = owner.columns();
    let rows = connection
        .fetch_all(
            "SELECT kind, digest FROM case_objects WHERE case_id = $1 AND $2 = ''
             UNION ALL SELECT kind, digest FROM layer_objects WHERE case_id = $1 AND layer_id = $2 ORDER BY kind",
            args![case, layer],
        )
        .await?;
    rows.iter().map(read_name).collect()
}

/// Turns pins into references; `false` if a pin is gone. Objects that are no longer needed are abandoned.
pub(super) async fn refer(
    connection: &mut Connection,
    owner: Owner,
    pinned: &Pinned,
    now: i64,
) -> Result<bool, StoreError> {
    if !pins::consume(connection, pinned).await? {
        return Ok(false);
    }
    let before = objects(connection, owner).await?;
    for name in &pinned.names {
        let (case, digest) = (owner.case.to_string(), name.digest.to_string());
        let inserted = match owner.layer {
            None => connection.execute(
                "INSERT INTO case_objects (case_id, kind, digest) VALUES ($1, $2, $3)
                 ON CONFLICT (case_id, kind) DO UPDATE SET digest = excluded.digest",
                args![case, name.kind.name(), digest],
            ),
            Some(layer) => connection.execute(
                "INSERT INTO layer_objects (case_id, layer_id, kind, digest) VALUES ($1, $2, $3, $4)
                 ON CONFLICT (case_id, layer_id, kind) DO UPDATE SET digest = excluded.digest",
                args![case, layer.to_string(), name.kind.name(), digest],
            ),
        };
        inserted.await?;
    }
    let after = objects(connection, owner).await?;
    let dropped = before.into_iter().filter(|name| !after.contains(name));
    pins::abandon(connection, dropped.collect(), now).await?;
    Ok(true)
}
