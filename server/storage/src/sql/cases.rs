//! Cases.

use jiff::Timestamp;

use super::connection::{Connection, Row, Value, containing, unreadable};
use super::made::{self, read_closed};
use super::{Rows, findings, jobs, layers, owners, series};
use crate::args;
use crate::jobs::{Claim, NewJob};
use crate::natural::natural_key;
use crate::rows::{Made, NewCase, Owner, Pinned, Published, Referred, Submitted};
use crate::{CaseQuery, Cursor, Has, Listed, Order, Page, Status, Store, StoreError};
use case::images::Closed;
use case::series::{AccessionNumber, PatientDigest, Uid};
use case::{
    Case, CaseChange, CaseFacts, CaseId, CaseState, Failure, JobKind, Parameters, QualityState,
};

impl Store {
    /// One case.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn case(&self, id: &CaseId) -> Result<Option<Case>, StoreError> {
        let mut read = one(&mut self.connect().await?, id).await;
        if let Err(StoreError::DamagedFacts(id)) = read {
            self.make_facts_again(&id).await?;
            read = one(&mut self.connect().await?, &id).await;
        }
        Ok(read?.map(|case| self.completed(case)))
    }

    /// At most `limit` cases of a search, after a cursor if they are listed newest first.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn cases(
        &self,
        query: &CaseQuery,
        after: Option<&Cursor>,
        limit: usize,
    ) -> Result<Page, StoreError> {
        let mut page = loop {
            let mut connection = self.connect().await?;
            match page(&mut connection, query, after, limit).await {
                Err(StoreError::DamagedFacts(id)) => {
                    drop(connection);
                    self.make_facts_again(&id).await?;
                }
                read => break read?,
            }
        };
        let completed = |listed: Listed| Listed {
            case: self.completed(listed.case),
            ..listed
        };
        page.cases = page.cases.into_iter().map(completed).collect();
        Ok(page)
    }

    /// Queues a case again whose facts are damaged: they are made again from the source.
    pub(crate) async fn make_facts_again(&self, id: &CaseId) -> Result<(), StoreError> {
        tracing::error!(
            case = id.short(),
            "the facts of a case are damaged; the case will be prepared again from its source"
        );
        let (mut transaction, now) = self.write().await?;
        if transaction.has_case(&id.to_string()).await? {
            owners::queue_again(&mut transaction, id.into(), "", now).await?;
        }
        transaction.commit().await
    }

    /// Makes a case and its job, and turns its pins into references; or queues a failed one again. A version gets the
    /// layers of the case that it is a version of.
    pub(crate) async fn insert_case(
        &self,
        new: &NewCase,
    ) -> Result<Referred<Submitted>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let submitted = submit(&mut transaction, new, now).await?;
        if submitted != Referred::PinLost {
            transaction.commit().await?;
        }
        Ok(submitted)
    }

    /// A case that is there and was uploaded again. `None`, and nothing has changed, if it must be inserted or queued again: then
    /// nobody waits for the writer.
    pub(crate) async fn uploaded_again(
        &self,
        new: &NewCase,
    ) -> Result<Option<Submitted>, StoreError> {
        let state = owners::state(&mut self.connect().await?, (&new.id).into()).await?;
        if state.is_none_or(|state| state == CaseState::Failed) {
            return Ok(None);
        }
        let (mut transaction, now) = self.write().await?;
        let Referred::Unneeded(known) = submit(&mut transaction, new, now).await? else {
            return Ok(None);
        };
        transaction.commit().await?;
        Ok(Some(known))
    }

    /// Renames a case, keeps it for good or no longer, or puts it into the trash or takes it out; returns whether it exists.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn change_case(&self, id: &CaseId, change: &CaseChange) -> Result<bool, StoreError> {
        let (mut transaction, _) = self.write().await?;
        let changed = transaction
            .execute(
                "UPDATE cases SET name = coalesce($1, name), kept = coalesce($2, kept), trashed = coalesce($3, trashed),
                                  label_key = coalesce($5, label_key) WHERE id = $4",
                args![
                    &change.name, change.kept, change.trashed, id.to_string(),
                    change.name.as_deref().map(natural_key),
                ],
            )
            .await?;
        transaction.commit().await?;
        Ok(changed > 0)
    }

    /// Notes how many places of the maps of a case, or of the map of its layer, stand out.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn note_places(&self, owner: Owner, places: usize) -> Result<(), StoreError> {
        let places = i64::try_from(places).unwrap_or(i64::MAX);
        let [case, layer] = owner.columns();
        let [read, write] = match owner.layer {
            None => [
                "SELECT places FROM cases WHERE id = $1 AND $2 = ''",
                "UPDATE cases SET places = $3 WHERE id = $1 AND $2 = ''",
            ],
            Some(_) => [
                "SELECT places FROM layers WHERE case_id = $1 AND id = $2",
                "UPDATE layers SET places = $3 WHERE case_id = $1 AND id = $2",
            ],
        };
        // Maps are read often, and nobody waits for the writer for what is known.
        let known = self
            .connect()
            .await?
            .fetch_optional(read, args![&case, &layer])
            .await?;
        let Some(known) = known else { return Ok(()) };
        if known.get::<Option<i64>>("places")? == Some(places) {
            return Ok(());
        }
        let (mut transaction, _) = self.write().await?;
        transaction
            .execute(write, args![&case, &layer, places])
            .await?;
        transaction.commit().await
    }

    /// Doubts the axes of a ready case, because another one has the same voxels with other axes; nothing if it has no verdict.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn doubt_axes(&self, id: &CaseId) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        let case = one(&mut transaction, id).await?;
        let Some(mut facts) = case.and_then(|case| case.facts) else {
            return Ok(());
        };
        let quality = facts.quality.as_mut();
        if !quality.is_some_and(|quality| quality.set_axes_corrected(true)) {
            return Ok(());
        }
        change_facts(&mut transaction, id, &facts).await?;
        transaction.commit().await?;
        self.signals().changed(id);
        Ok(())
    }

    /// Makes a case ready, ends its job and queues the next ones, if the lease is still ours.
    pub(crate) async fn make_case_ready(
        &self,
        claim: &Claim,
        derived: &Pinned,
        facts: &CaseFacts,
        next: &[JobKind],
    ) -> Result<Referred<Published>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let Some(id) = &claim.case else {
            return Ok(Referred::Unneeded(Published::Fenced));
        };
        if !jobs::finish(&mut transaction, claim, Ok(()), now).await? {
            return Ok(Referred::Unneeded(Published::Fenced));
        }
        if !owners::refer(&mut transaction, id.into(), derived, now).await? {
            return Ok(Referred::PinLost);
        }
        let stored = serde_json::to_string(facts)?;
        transaction.execute(
            "UPDATE cases SET state = 'ready', facts = $1, facts_digest = $2, voxels = $3, mask = $5, failure = NULL WHERE id = $4",
            args![&stored, owners::digest(&stored), values_of(facts), id.to_string(), mask_of(facts)],
        )
        .await?;
        for &kind in next {
            jobs::enqueue(&mut transaction, &NewJob::about(kind, id), now).await?;
        }
        transaction.commit().await?;
        Ok(Referred::Done(Published::Done))
    }

    /// Makes a ready case failed, because its source is lost; returns whether it was ready.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn make_case_failed(
        &self,
        id: &CaseId,
        failure: &Failure,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let state = owners::state(&mut transaction, id.into()).await?;
        if state == Some(CaseState::Ready) {
            make_failed(&mut transaction, id, failure, now).await?;
            transaction.commit().await?;
        }
        Ok(state == Some(CaseState::Ready))
    }

    /// Inserts a case of another store as it is there, or makes the one that is here so, and turns its pins into
    /// references; one that is not ready or failed is queued. `false`, and nothing has changed, where it is ready here
    /// and not there.
    pub(crate) async fn write_copied_case(
        &self,
        case: &Case,
        objects: &Pinned,
    ) -> Result<bool, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let (state, [failure, facts, digest]) =
            owners::copied(case.state, case.failure.as_ref(), case.facts.as_ref())?;
        let written = transaction
            .execute(
                "INSERT INTO cases (id, closing_radius_mm, parameters, name, state, failure, facts, facts_digest, voxels, created_at,
                                    uploaded_at, kept, trashed, previous, label_key, mask)
                 VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, (SELECT id FROM cases WHERE id = $14), $15, $16)
                 ON CONFLICT (id) DO UPDATE SET name = excluded.name, label_key = excluded.label_key, mask = excluded.mask, state = excluded.state, failure = excluded.failure,
                                                facts = excluded.facts, facts_digest = excluded.facts_digest,
                                                voxels = excluded.voxels,
                                                uploaded_at = excluded.uploaded_at, kept = excluded.kept,
                                                trashed = excluded.trashed
                 WHERE cases.state <> 'ready' OR excluded.state = 'ready'",
                args![
                    case.id.to_string(), case.parameters.closing_radius_mm,
                    without_columns(&case.parameters)?, &case.parameters.name, state.name(), failure,
                    facts, digest,
                    case.facts.as_ref().and_then(values_of), case.created_at.as_microsecond(),
                    case.uploaded_at.as_microsecond(), case.kept, case.trashed,
                    case.previous.map(|id| id.to_string()), key_of(case.parameters.name.as_deref()),
                    case.facts.as_ref().map(mask_of),
                ],
            )
            .await?;
        if written == 0 {
            return Ok(false);
        }
        if !owners::refer(&mut transaction, (&case.id).into(), objects, now).await? {
            return Err(StoreError::Rows("a pin was lost".into()));
        }
        jobs::cancel(&mut transaction, JobKind::PREPARE, &case.id.to_string()).await?;
        if !case.state.is_final() {
            let job = NewJob::about(JobKind::PREPARE, &case.id);
            jobs::enqueue(&mut transaction, &job, now).await?;
        }
        transaction.commit().await?;
        Ok(true)
    }
}

/// The columns of a case with its job's progress, which `read` understands; others may follow.
macro_rules! case_columns {
    () => {
        "SELECT id, closing_radius_mm, parameters, name, state, failure, facts, facts_digest, created_at,
                COALESCE(uploaded_at, created_at) AS uploaded_at, kept, trashed, previous,
                closed,
                (SELECT jobs.state FROM jobs WHERE jobs.kind = 'prepare' AND jobs.key = cases.id
                 AND jobs.state IN ('queued', 'running')) AS job_state,
                (SELECT jobs.progress FROM jobs WHERE jobs.kind = 'prepare' AND jobs.key = cases.id
                 AND jobs.state IN ('queued', 'running')) AS progress,
                (SELECT string_agg(version.id, ',' ORDER BY version.created_at, version.id) FROM cases AS version
                 WHERE version.previous = cases.id) AS next"
    };
}

/// A case. A `WHERE` or `ORDER BY` may follow.
macro_rules! select_case {
    ($rest:literal) => {
        concat!(case_columns!(), " FROM cases ", $rest)
    };
}

/// How many places of the maps of a case stand out, with those of its newest FLAIR; NULL if that is not known.
macro_rules! places {
    () => {
        "places + coalesce((SELECT layers.places FROM layers WHERE layers.case_id = cases.id AND layers.places IS NOT NULL
                            ORDER BY layers.created_at DESC LIMIT 1), 0)"
    };
}

/// The number of findings of a case; NULL without a document.
macro_rules! kept_findings {
    () => {
        "(SELECT findings.kept FROM findings WHERE findings.case_id = cases.id)"
    };
}

/// What is to be done with a case: one of [`Status`]. A reading in which nothing is left is as one that was not begun.
macro_rules! status {
    () => {
        "CASE state WHEN 'queued' THEN 'preparing' WHEN 'failed' THEN 'failed'
         ELSE CASE WHEN EXISTS (SELECT 1 FROM readings WHERE readings.case_id = cases.id AND readings.signed_at IS NULL
                                AND readings.document <> '{\"conclusion\":\"\",\"findings\":[]}')
              THEN 'begun'
              WHEN EXISTS (SELECT 1 FROM readings WHERE readings.case_id = cases.id AND readings.signed_at IS NOT NULL)
              THEN 'signed'
              WHEN EXISTS (SELECT 1 FROM findings WHERE findings.case_id = cases.id AND findings.document <> '[]')
              THEN 'begun' ELSE 'new' END END"
    };
}

/// The conditions of a search; the first ones have an index.
macro_rules! conditions {
    ($($by:tt)*) => {
        concat!(
            $($by)*,
            " AND (created_at, id) < ($1, $2) AND created_at >= $3
              AND ($4 = '' OR lower(name) LIKE lower($4) ESCAPE '!')
              AND $5 IN ('', CASE WHEN state = 'queued' AND EXISTS (SELECT 1 FROM jobs WHERE jobs.kind = 'prepare'
                                       AND jobs.key = cases.id AND jobs.state = 'running')
                                  THEN 'preparing' ELSE state END)
              AND ($6 = '' OR lower(name) LIKE lower($6) ESCAPE '!' OR id LIKE lower(substr($6, 2)) ESCAPE '!'
                   OR EXISTS (SELECT 1 FROM findings WHERE findings.case_id = cases.id
                              AND lower(findings.readers) LIKE lower($6) ESCAPE '!'))
              AND $7 IN ('', ",
            status!(),
            ") AND (trashed = $8 OR $8 IS NULL)
              AND ($13 = '' OR (state = 'ready' AND mask = $13))
              AND ($14 = '' OR EXISTS (SELECT 1 FROM layers WHERE layers.case_id = cases.id
                                       AND lower(layers.name) LIKE lower($14) ESCAPE '!'))
              AND ($15 = '' OR EXISTS (SELECT 1 FROM findings WHERE findings.case_id = cases.id
                                       AND lower(findings.readers) LIKE lower($15) ESCAPE '!'))
              AND CASE $16 WHEN 'places' THEN coalesce(",
            places!(),
            ", 0) > 0 WHEN 'findings' THEN coalesce(",
            kept_findings!(),
            ", 0) > 0 WHEN 'layers' THEN EXISTS (SELECT 1 FROM layers WHERE layers.case_id = cases.id)
                   ELSE TRUE END "
        )
    };
}

/// Cases that were made of certain series, of which one key has an index.
macro_rules! made_of {
    ($by:literal) => {
        concat!(
            "id IN (SELECT case_id FROM case_series WHERE ",
            $by,
            " AND (study_uid = $9 OR $9 IS NULL) AND (series_uid = $10 OR $10 IS NULL)
              AND (accession_number = $11 OR $11 IS NULL) AND (patient = $12 OR $12 IS NULL))"
        )
    };
}

/// The page of cases that fulfil conditions, in an order. What is stated about each is read for these alone.
macro_rules! select_page {
    ([$($by:tt)*], [$($order:tt)*]) => {
        concat!(
            case_columns!(),
            ", ", places!(), " AS standing_out, ", kept_findings!(), " AS findings, ", status!(), " AS status,
             (SELECT findings.readers FROM findings WHERE findings.case_id = cases.id) AS readers,
             (SELECT string_agg(layers.name, '\n' ORDER BY layers.place, layers.id) FROM layers
              WHERE layers.case_id = cases.id) AS layers
             FROM cases WHERE id IN (SELECT id FROM cases WHERE ",
            conditions!($($by)*), $($order)*, " LIMIT $17 OFFSET $18)",
            $($order)*
        )
    };
}

/// How many cases a search finds; a page of them, newest first; and one in the order of `$19`.
macro_rules! search {
    ($($by:tt)*) => {
        [
            concat!("SELECT count(*) AS count FROM cases WHERE ", conditions!($($by)*)),
            select_page!([$($by)*], [" ORDER BY created_at DESC, id DESC"]),
            select_page!([$($by)*], [concat!(
                " ORDER BY CASE $19 WHEN 'label' THEN nullif(label_key, '') END NULLS LAST,
                  CASE $19 WHEN 'oldest' THEN -created_at WHEN 'places' THEN coalesce(", places!(), ", -1)
                           WHEN 'findings' THEN coalesce(", kept_findings!(), ", 0) END DESC,
                  created_at DESC, id DESC"
            )]),
        ]
    };
}

/// Inserts a case with its references, its job, and, for a version, the layers and the findings of the case that
/// it is a version of.
pub(crate) async fn submit(
    connection: &mut Connection,
    new: &NewCase,
    now: i64,
) -> Result<Referred<Submitted>, StoreError> {
    let (id, name) = (&new.id, new.parameters.name.as_deref());
    let state = owners::came_again(connection, id, name, new.relabel, now).await?;
    if state.is_some_and(|state| state != CaseState::Failed) {
        make(connection, new).await?;
        return Ok(Referred::Unneeded(submitted(connection, id, false).await?));
    }
    jobs::check_room(
        connection,
        JobKind::PREPARE,
        new.queue_limit,
        &new.client,
        now,
    )
    .await?;
    if state.is_none() {
        insert(connection, new, now).await?;
    }
    owners::queue_again(connection, id.into(), &new.client, now).await?;
    if !owners::refer(connection, id.into(), &new.sources, now).await? {
        return Ok(Referred::PinLost);
    }
    make(connection, new).await?;
    // What lies in images that do not count any more is not taken over into those that do.
    if let (None, Some(previous)) = (state, &new.previous)
        && (closed(connection, id).await?.is_some()
            || closed(connection, previous).await?.is_none())
    {
        layers::inherit(connection, id, previous, now).await?;
        findings::inherit(connection, id, previous).await?;
    }
    Ok(Referred::Done(submitted(connection, id, true).await?))
}

async fn submitted(
    connection: &mut Connection,
    id: &CaseId,
    created: bool,
) -> Result<Submitted, StoreError> {
    let case = one(connection, id).await?.ok_or(StoreError::NoSuchCase)?;
    Ok(Submitted { case, created })
}

/// Writes of which images and of which series a case is made.
async fn make(connection: &mut Connection, new: &NewCase) -> Result<(), StoreError> {
    if let Some(series) = &new.series {
        series::index(connection, &new.id, series).await?;
    }
    match (&new.images, &new.previous) {
        (Some(own), _) if own.is_empty() => Ok(()),
        (Some(own), _) => made::make(connection, &Made::case(&new.id), own).await,
        (None, Some(previous)) => {
            series::inherit(connection, &new.id, previous).await?;
            made::inherit(connection, &new.id, previous).await
        }
        (None, None) => Ok(()),
    }
}

/// Why a case is closed; nothing if there is none.
pub async fn closed(
    connection: &mut Connection,
    id: &CaseId,
) -> Result<Option<Closed>, StoreError> {
    let row = connection
        .fetch_optional(
            "SELECT closed FROM cases WHERE id = $1",
            args![id.to_string()],
        )
        .await?;
    match row {
        Some(row) => read_closed(&row, "closed"),
        None => Ok(None),
    }
}

/// Writes the row of a new case.
async fn insert(connection: &mut Connection, new: &NewCase, now: i64) -> Result<(), StoreError> {
    connection.execute(
        "INSERT INTO cases (id, closing_radius_mm, parameters, name, state, created_at, previous, label_key)
         VALUES ($1, $2, $3, $4, 'queued', $5, (SELECT id FROM cases WHERE id = $6), $7)",
        args![
            new.id.to_string(), new.parameters.closing_radius_mm, without_columns(&new.parameters)?,
            &new.parameters.name, now, new.previous.map(|id| id.to_string()),
            key_of(new.parameters.name.as_deref()),
        ],
    )
    .await?;
    Ok(())
}

/// The parameters that have no column of their own, as JSON.
fn without_columns(parameters: &Parameters) -> Result<String, StoreError> {
    let mut json = serde_json::to_value(parameters)?;
    if let Some(members) = json.as_object_mut() {
        members.remove("closing_radius_mm");
        members.remove("name");
    }
    Ok(json.to_string())
}

/// The parameters of a row with the columns `closing_radius_mm`, `parameters` and `name`.
pub(super) fn read_parameters(row: &Row) -> Result<Parameters, StoreError> {
    let others: String = row.get("parameters")?;
    Ok(Parameters {
        closing_radius_mm: row.get("closing_radius_mm")?,
        name: row.get("name")?,
        ..serde_json::from_str(&others)?
    })
}

/// Changes the facts of a ready case.
pub(super) async fn change_facts(
    connection: &mut Connection,
    id: &CaseId,
    facts: &CaseFacts,
) -> Result<(), StoreError> {
    let stored = serde_json::to_string(facts)?;
    connection
        .execute(
            "UPDATE cases SET facts = $1, facts_digest = $2, mask = $4 WHERE id = $3 AND state = 'ready'",
            args![&stored, owners::digest(&stored), id.to_string(), mask_of(facts)],
        )
        .await?;
    Ok(())
}

/// What labels are sorted by.
fn key_of(label: Option<&str>) -> String {
    label.map(natural_key).unwrap_or_default()
}

/// The rating of the mask, as the list is filtered by it.
fn mask_of(facts: &CaseFacts) -> &'static str {
    let quality = facts.quality.as_ref();
    quality.map_or("", |quality| quality.state.name())
}

/// The cases that [`write_keys`] completes at once.
const KEYS_AT_ONCE: i64 = 200;

/// Writes the keys of some cases that a program without them has written; whether there may be more.
pub(super) async fn write_keys(rows: &Rows) -> Result<bool, StoreError> {
    let missing = "SELECT id, name, facts FROM cases WHERE label_key IS NULL LIMIT $1";
    // Nobody waits for the writer where there is nothing to write.
    let mut connection = rows.connect().await?;
    let one = connection.fetch_optional(missing, args![1_i64]).await?;
    drop(connection);
    if one.is_none() {
        return Ok(false);
    }
    let (mut transaction, _) = rows.write().await?;
    let found = transaction.fetch_all(missing, args![KEYS_AT_ONCE]).await?;
    for row in &found {
        let [id, name, facts]: [Option<String>; 3] =
            [row.get("id")?, row.get("name")?, row.get("facts")?];
        // Damaged facts are made again, and then rated.
        let facts = facts.and_then(|facts| serde_json::from_str::<CaseFacts>(&facts).ok());
        transaction
            .execute(
                "UPDATE cases SET label_key = $1, mask = coalesce(mask, $2) WHERE id = $3",
                args![key_of(name.as_deref()), facts.as_ref().map(mask_of), id],
            )
            .await?;
    }
    transaction.commit().await?;
    Ok(true)
}

/// What [`with_voxels`] finds a case by.
fn values_of(facts: &CaseFacts) -> Option<&str> {
    facts.voxels.as_ref().map(|voxels| voxels.values.as_str())
}

/// Makes a case failed, and with it the layers that wait for it, and their jobs.
pub(super) async fn make_failed(
    connection: &mut Connection,
    id: &CaseId,
    failure: &Failure,
    now: i64,
) -> Result<(), StoreError> {
    let failure = serde_json::to_string(failure)?;
    connection.execute(
        "UPDATE cases SET state = 'failed', failure = $1, facts = NULL, facts_digest = NULL WHERE id = $2",
        args![failure.clone(), id.to_string()],
    )
        .await?;
    connection
        .execute(
            "UPDATE layers SET state = 'failed', failure = $1, facts = NULL, facts_digest = NULL
             WHERE case_id = $2 AND state = 'queued'",
            args![failure.clone(), id.to_string()],
        )
        .await?;
    connection
        .execute(
            "UPDATE jobs SET state = 'failed', failure = $1, ended_at = $2, fence = 0, lease_until = NULL
             WHERE case_id = $3 AND needs_ready AND state IN ('queued', 'running')",
            args![failure, now, id.to_string()],
        )
        .await?;
    Ok(())
}

/// Removes the row of a case, and abandons the objects of what goes with it; whether it was there.
pub(super) async fn delete(
    connection: &mut Connection,
    id: &CaseId,
    now: i64,
) -> Result<bool, StoreError> {
    let known = one(connection, id).await?;
    layers::abandon_all(connection, id, now).await?;
    let tables = connection.tables();
    tables.leave_case(connection, id, now).await?;
    // Its versions become those of the case that it is itself a version of.
    connection.execute(
        "UPDATE cases SET previous = (SELECT previous FROM cases WHERE id = $1) WHERE previous = $1",
        args![id.to_string()],
    )
        .await?;
    // The jobs, the layers and the references go with the case (ON DELETE CASCADE).
    let deleted = connection
        .execute("DELETE FROM cases WHERE id = $1", args![id.to_string()])
        .await?;
    if let Some(values) = known
        .as_ref()
        .and_then(|case| values_of(case.facts.as_ref()?))
    {
        forget_contradictions(connection, values).await?;
    }
    Ok(deleted > 0)
}

/// How many cases with the same voxels are compared.
const MOST_COMPARED: usize = 100;

/// Withdraws the doubt about the axes of cases with these stored values that no other case contradicts any more.
async fn forget_contradictions(
    connection: &mut Connection,
    values: &str,
) -> Result<(), StoreError> {
    let same = with_voxels(connection, values, MOST_COMPARED).await?;
    let voxels = |case: &Case| case.facts.as_ref()?.voxels.clone();
    for case in &same {
        let Some(own) = voxels(case) else { continue };
        let mut others = same.iter().filter_map(voxels);
        let is_contradicted = others.any(|other| own.has_other_axes(&other));
        let Some(mut facts) = case.facts.clone().filter(|_| !is_contradicted) else {
            continue;
        };
        let quality = facts.quality.as_mut();
        if quality.is_some_and(|quality| quality.set_axes_corrected(false)) {
            change_facts(connection, &case.id, &facts).await?;
        }
    }
    Ok(())
}

pub(super) async fn one(
    connection: &mut Connection,
    id: &CaseId,
) -> Result<Option<Case>, StoreError> {
    let row = connection
        .fetch_optional(select_case!("WHERE id = $1"), args![id.to_string()])
        .await?;
    row.as_ref().map(read).transpose()
}

/// At most `limit` ready cases whose volumes have the same stored values in any order
/// ([`VoxelFacts::values`](case::VoxelFacts::values)), newest first.
pub async fn with_voxels(
    connection: &mut Connection,
    values: &str,
    limit: usize,
) -> Result<Vec<Case>, StoreError> {
    let rows = connection
        .fetch_all(
            select_case!(
            "WHERE voxels = $1 AND cases.state = 'ready' ORDER BY created_at DESC, id DESC LIMIT $2"
        ),
            args![values, i64::try_from(limit).unwrap_or(i64::MAX)],
        )
        .await?;
    rows.iter().map(read).collect()
}

async fn page(
    connection: &mut Connection,
    query: &CaseQuery,
    after: Option<&Cursor>,
    limit: usize,
) -> Result<Page, StoreError> {
    let until = query.until.map_or(i64::MAX, Timestamp::as_microsecond);
    let after = after.filter(|cursor| cursor.at < until);
    let (created_at, id) = after.map_or((until, ""), |cursor| (cursor.at, &cursor.id));
    let study = query.study.as_ref().map(Uid::as_str);
    let series = query.series.as_ref().map(Uid::as_str);
    let number = query.accession_number.as_ref().map(AccessionNumber::as_str);
    let patient = query.patient.map(PatientDigest::to_hex);
    let [count, newest, sorted] = match (study, number, &patient, series) {
        (Some(_), ..) => search!(made_of!("study_uid = $9")),
        (_, Some(_), ..) => search!(made_of!("accession_number = $11")),
        (_, _, Some(_), _) => search!(made_of!("patient = $12")),
        (.., Some(_)) => search!(made_of!("series_uid = $10")),
        (None, None, None, None) => search!("coalesce($9, $10, $11, $12) IS NULL"),
    };
    let part = |text: &Option<String>| text.as_deref().map_or_else(String::new, containing);
    let conditions = || -> Vec<Value> {
        args![
            created_at,
            id,
            query.since.map_or(i64::MIN, Timestamp::as_microsecond),
            part(&query.label),
            query.state.map_or("", CaseState::name),
            part(&query.text),
            query.status.map_or("", Status::name),
            query.trashed,
            study,
            series,
            number,
            &patient,
            query.mask.map_or("", QualityState::name),
            part(&query.layer),
            part(&query.reader),
            query.has.map_or("", Has::name),
        ]
    };
    let number = |number: usize| i64::try_from(number).unwrap_or(i64::MAX);
    let total = match query.skip {
        None => None,
        Some(_) => {
            let row = connection.fetch_one(count, conditions()).await?;
            Some(u64::try_from(row.get::<i64>("count")?).unwrap_or_default())
        }
    };
    let mut args = conditions();
    args.extend::<Vec<Value>>(args![
        number(limit.saturating_add(1)),
        number(query.skip.unwrap_or_default()),
    ]);
    let is_newest = query.order == Order::Newest;
    if !is_newest {
        args.push(query.order.name().into());
    }
    let statement = if is_newest { newest } else { sorted };
    let rows = connection.fetch_all(statement, args).await?;
    let listed = rows.iter().map(read_listed).collect::<Result<_, _>>()?;
    let place = |listed: &Listed| (listed.case.created_at, listed.case.id.to_string());
    let (cases, next) = Cursor::page(listed, limit, place);
    let next = next.filter(|_| is_newest);
    Ok(Page { cases, next, total })
}

fn read_listed(row: &Row) -> Result<Listed, StoreError> {
    let status: String = row.get("status")?;
    let count = |column: &str| -> Result<Option<u32>, StoreError> {
        let count: Option<i64> = row.get(column)?;
        Ok(count.and_then(|count| u32::try_from(count).ok()))
    };
    let lines = |column: &str| -> Result<Vec<String>, StoreError> {
        let text: Option<String> = row.get(column)?;
        let text = text.unwrap_or_default();
        Ok(text.lines().map(str::to_owned).collect())
    };
    Ok(Listed {
        case: read(row)?,
        status: Status::from_name(&status).ok_or_else(|| unreadable("a status"))?,
        places: count("standing_out")?,
        findings: count("findings")?.unwrap_or_default(),
        readers: lines("readers")?,
        layers: lines("layers")?,
    })
}

fn read(row: &Row) -> Result<Case, StoreError> {
    let unreadable =
        |what: &str| StoreError::Rows(format!("a case's row has an unknown {what}").into());
    let id: String = row.get("id")?;
    let progress: Option<String> = row.get("progress")?;
    let failure: Option<String> = row.get("failure")?;
    let facts: Option<String> = row.get("facts")?;
    let id = CaseId::parse(&id).ok_or_else(|| unreadable("id"))?;
    let digest: Option<String> = row.get("facts_digest")?;
    if facts.as_deref().map(owners::digest) != digest {
        return Err(StoreError::DamagedFacts(id));
    }
    let [previous, next]: [Option<String>; 2] = [row.get("previous")?, row.get("next")?];
    let versions = |ids: Option<String>| {
        let ids = ids.unwrap_or_default();
        let ids = ids.split(',').filter(|id| !id.is_empty());
        ids.map(|id| CaseId::parse(id).ok_or_else(|| unreadable("version")))
            .collect::<Result<Vec<_>, _>>()
    };
    let time = |column: &str| {
        let read = Timestamp::from_microsecond(row.get(column)?);
        read.map_err(|_| unreadable("time"))
    };
    Ok(Case {
        id,
        parameters: read_parameters(row)?,
        state: jobs::read_state(row).ok_or_else(|| unreadable("state"))?,
        progress: progress.as_deref().map(serde_json::from_str).transpose()?,
        failure: failure
            .as_deref()
            .map(serde_json::from_str::<Failure>)
            .transpose()?,
        facts: facts
            .as_deref()
            .map(serde_json::from_str::<CaseFacts>)
            .transpose()?,
        previous: versions(previous)?.pop(),
        next: versions(next)?,
        created_at: time("created_at")?,
        uploaded_at: time("uploaded_at")?,
        closed: read_closed(row, "closed")?,
        kept: row.get("kept")?,
        trashed: row.get("trashed")?,
        expires_at: None,
    })
}
