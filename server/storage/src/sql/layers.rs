//! Layers of cases.

use case::series::Uid;
use case::{
    CaseId, CaseState, Failure, JobKind, Layer, LayerChange, LayerFacts, LayerId, LayerParameters,
    ObjectKind,
};
use jiff::Timestamp;

use super::connection::{Connection, Row, read_name};
use super::made::{self, read_closed};
use super::{jobs, owners, pins};
use crate::args;
use crate::jobs::{Claim, NewJob};
use crate::rows::{LayerName, Made, NewLayer, Owner, Pinned, Published, Referred};
use crate::{Store, StoreError};

impl Store {
    /// The layers of a case, in their order.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn layers(&self, case: &CaseId) -> Result<Vec<Layer>, StoreError> {
        loop {
            let read = of_case(&mut self.connect().await?, case).await;
            match read {
                Err(StoreError::DamagedLayer(case, layer)) => {
                    let (mut transaction, now) = self.write().await?;
                    forget_facts(&mut transaction, (&case, &layer).into(), now).await?;
                    transaction.commit().await?;
                }
                _ => return read,
            }
        }
    }

    /// A layer of a case.
    ///
    /// # Errors
    /// If the rows cannot be read or written.
    pub async fn layer(&self, case: &CaseId, id: &LayerId) -> Result<Option<Layer>, StoreError> {
        let layers = self.layers(case).await?;
        Ok(layers.into_iter().find(|layer| layer.id == *id))
    }

    /// Makes a layer and its job, and turns its pins into references; or queues a failed one again. Returns whether it was queued.
    pub(crate) async fn insert_layer(&self, new: &NewLayer) -> Result<Referred<bool>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let inserted = submit(&mut transaction, new, now).await?;
        if matches!(inserted, Referred::Done(_)) {
            transaction.commit().await?;
        }
        Ok(inserted)
    }

    /// Renames a layer, or moves it in the list; returns whether there is such a layer.
    ///
    /// # Errors
    /// [`StoreError::LayerNameTaken`], or if the rows cannot be written.
    pub async fn change_layer(
        &self,
        case: &CaseId,
        layer: &LayerId,
        change: &LayerChange,
    ) -> Result<bool, StoreError> {
        let (mut transaction, _) = self.write().await?;
        let layers = of_case(&mut transaction, case).await?;
        let Some(from) = layers.iter().position(|known| known.id == *layer) else {
            return Ok(false);
        };
        if let Some(name) = &change.name {
            let is_taken = |other: &Layer| other.name == *name && other.id != *layer;
            if layers.iter().any(is_taken) {
                return Err(StoreError::LayerNameTaken);
            }
            transaction
                .execute(
                    "UPDATE layers SET name = $1 WHERE case_id = $2 AND id = $3",
                    args![name, case.to_string(), layer.to_string()],
                )
                .await?;
        }
        if let Some(contrast) = change.contrast {
            let parameters = LayerParameters {
                contrast: Some(contrast),
                ..layers[from].parameters.clone()
            };
            transaction
                .execute(
                    "UPDATE layers SET parameters = $1 WHERE case_id = $2 AND id = $3",
                    args![
                        serde_json::to_string(&parameters)?,
                        case.to_string(),
                        layer.to_string()
                    ],
                )
                .await?;
        }
        if let Some(place) = change.place {
            let mut ids: Vec<LayerId> = layers.iter().map(|layer| layer.id).collect();
            ids.remove(from);
            ids.insert(place.min(ids.len()), *layer);
            for (place, id) in (0i64..).zip(ids) {
                transaction
                    .execute(
                        "UPDATE layers SET place = $1 WHERE case_id = $2 AND id = $3",
                        args![place, case.to_string(), id.to_string()],
                    )
                    .await?;
            }
        }
        transaction.commit().await?;
        self.signals().changed(case);
        Ok(true)
    }

    /// Makes a layer ready and ends its job, if the lease is still ours.
    pub(crate) async fn make_layer_ready(
        &self,
        claim: &Claim,
        derived: &Pinned,
        facts: &LayerFacts,
    ) -> Result<Referred<Published>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let Some(owner) = claim.owner() else {
            return Ok(Referred::Unneeded(Published::Fenced));
        };
        if !jobs::finish(&mut transaction, claim, Ok(()), now).await? {
            return Ok(Referred::Unneeded(Published::Fenced));
        }
        if !owners::refer(&mut transaction, owner, derived, now).await? {
            return Ok(Referred::PinLost);
        }
        let facts = serde_json::to_string(facts)?;
        let [case, layer] = owner.columns();
        transaction
            .execute(
                "UPDATE layers SET state = 'ready', facts = $1, facts_digest = $2, failure = NULL WHERE case_id = $3 AND id = $4",
                args![&facts, owners::digest(&facts), case, layer],
            )
            .await?;
        transaction.commit().await?;
        Ok(Referred::Done(Published::Done))
    }

    /// Inserts a layer of another store, after those that are here, unless it is here, and turns its pins into references. What is
    /// neither ready nor failed is queued.
    pub(crate) async fn write_copied_layer(
        &self,
        layer: &Layer,
        series: Option<&Uid>,
        objects: &Pinned,
    ) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        let (state, [failure, facts, digest]) =
            owners::copied(layer.state, layer.failure.as_ref(), layer.facts.as_ref())?;
        let others = of_case(&mut transaction, &layer.case).await?;
        let name = free_name(&LayerName::Usual(layer.name.clone()), &others);
        transaction
            .execute(
                "INSERT INTO layers (case_id, id, name, place, parameters, state, failure, facts, facts_digest, created_at, series_uid)
                 VALUES ($1, $2, $3, (SELECT coalesce(max(place) + 1, 0) FROM layers WHERE case_id = $1), $4, $5, $6, $7, $8, $9, $10)
                 ON CONFLICT (case_id, id) DO UPDATE SET state = excluded.state, failure = excluded.failure,
                                                         facts = excluded.facts, facts_digest = excluded.facts_digest",
                args![
                    layer.case.to_string(), layer.id.to_string(), name.unwrap_or_default(),
                    serde_json::to_string(&layer.parameters)?, state.name(), failure, facts,
                    digest, layer.created_at.as_microsecond(),
                    series.map(Uid::as_str),
                ],
            )
            .await?;
        let owner = Owner::from((&layer.case, &layer.id));
        if !owners::refer(&mut transaction, owner, objects, now).await? {
            return Err(StoreError::Rows("a pin was lost".into()));
        }
        if !layer.state.is_final() {
            let job = NewJob::about(JobKind::LAYER, owner);
            jobs::enqueue(&mut transaction, &job, now).await?;
        }
        transaction.commit().await
    }

    /// The series that a layer is made of, if that is known.
    pub(crate) async fn series_of_layer(
        &self,
        case: &CaseId,
        layer: &LayerId,
    ) -> Result<Option<Uid>, StoreError> {
        let mut connection = self.connect().await?;
        let row = connection
            .fetch_optional(
                "SELECT series_uid FROM layers WHERE case_id = $1 AND id = $2",
                args![case.to_string(), layer.to_string()],
            )
            .await?;
        let series: Option<String> = match row {
            Some(row) => row.get("series_uid")?,
            None => None,
        };
        Ok(series.as_deref().and_then(Uid::parse))
    }
}

/// A layer, which `read` understands. A `WHERE` or `ORDER BY` may follow.
macro_rules! select_layer {
    ($rest:literal) => {
        concat!(
            "SELECT case_id, id, name, parameters, state, failure, facts, facts_digest, created_at, closed,
                    (SELECT jobs.state FROM jobs WHERE jobs.kind = 'layer' AND jobs.key = layers.case_id || '/' || layers.id
                     AND jobs.state IN ('queued', 'running')) AS job_state
             FROM layers ",
            $rest
        )
    };
}

/// Inserts a layer, and its job; or queues a failed one again.
pub(crate) async fn submit(
    connection: &mut Connection,
    new: &NewLayer,
    now: i64,
) -> Result<Referred<bool>, StoreError> {
    if !connection.has_case(&new.case.to_string()).await? {
        return Err(StoreError::NoSuchCase);
    }
    let others = of_case(connection, &new.case).await?;
    let known = others.iter().find(|layer| layer.id == new.id);
    if known.is_some_and(|layer| layer.state != CaseState::Failed) {
        return Ok(Referred::Unneeded(false));
    }
    if known.is_none() && others.len() >= new.most {
        return Err(StoreError::TooManyLayers);
    }
    jobs::check_room(
        connection,
        JobKind::LAYER,
        new.queue_limit,
        &new.client,
        now,
    )
    .await?;
    if known.is_some() {
        owners::queue_again(connection, new.owner(), &new.client, now).await?;
    } else {
        let name = free_name(&new.name, &others).ok_or(StoreError::LayerNameTaken)?;
        insert_row(connection, new, &name, now).await?;
    }
    let made = Made::layer(&new.case, &new.id);
    made::make(connection, &made, &new.images).await?;
    match owners::refer(connection, new.owner(), &new.sources, now).await? {
        true => Ok(Referred::Done(true)),
        false => Ok(Referred::PinLost),
    }
}

/// The name of a new layer; `None` if a given one is taken.
fn free_name(name: &LayerName, others: &[Layer]) -> Option<String> {
    let is_taken = |name: &str| others.iter().any(|layer| layer.name == name);
    match name {
        LayerName::Given(name) => (!is_taken(name)).then(|| name.clone()),
        LayerName::Usual(name) => {
            let numbered = (2..).map(|number| format!("{name} {number}"));
            let mut names = std::iter::once(name.clone()).chain(numbered);
            names.find(|name| !is_taken(name))
        }
    }
}

async fn insert_row(
    connection: &mut Connection,
    new: &NewLayer,
    name: &str,
    now: i64,
) -> Result<(), StoreError> {
    connection
        .execute(
            "INSERT INTO layers (case_id, id, name, place, parameters, state, created_at, series_uid)
             VALUES ($1, $2, $3, (SELECT coalesce(max(place) + 1, 0) FROM layers WHERE case_id = $1), $4, 'queued', $5, $6)",
            args![
                new.case.to_string(), new.id.to_string(), name,
                serde_json::to_string(&new.parameters)?, now, new.series.as_ref().map(Uid::as_str),
            ],
        )
        .await?;
    let job = NewJob::about(JobKind::LAYER, new.owner());
    jobs::enqueue_for(connection, &job, &new.client, now).await
}

/// Gives a new version of a case the layers of the case, to be prepared with its own envelope; their placement stays.
pub(super) async fn inherit(
    connection: &mut Connection,
    case: &CaseId,
    previous: &CaseId,
    now: i64,
) -> Result<(), StoreError> {
    connection
        .execute(
            "INSERT INTO layers (case_id, id, name, place, parameters, state, facts, facts_digest, created_at, series_uid, closed)
             SELECT $1, id, name, place, parameters, 'queued', facts, facts_digest, created_at, series_uid, closed FROM layers
             WHERE case_id = $2 AND state <> 'failed'",
            args![case.to_string(), previous.to_string()],
        )
        .await?;
    for layer in of_case(connection, case).await? {
        let job = NewJob::about(JobKind::LAYER, (case, &layer.id));
        jobs::enqueue(connection, &job, now).await?;
    }
    made::inherit_layers(connection, case, previous).await?;
    connection
        .execute(
            "INSERT INTO layer_objects (case_id, layer_id, kind, digest)
             SELECT $1, layer_id, kind, digest FROM layer_objects JOIN layers ON layers.case_id = $1 AND layers.id = layer_id
             WHERE layer_objects.case_id = $2 AND kind NOT IN ('layer', 'maps')",
            args![case.to_string(), previous.to_string()],
        )
        .await?;
    Ok(())
}

/// Leaves the objects of all layers of a case with expired pins, before the case is deleted.
pub(super) async fn abandon_all(
    connection: &mut Connection,
    case: &CaseId,
    now: i64,
) -> Result<(), StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT kind, digest FROM layer_objects WHERE case_id = $1",
            args![case.to_string()],
        )
        .await?;
    let names = rows.iter().map(read_name);
    pins::abandon(connection, names.collect::<Result<_, _>>()?, now).await
}

pub async fn of_case(connection: &mut Connection, case: &CaseId) -> Result<Vec<Layer>, StoreError> {
    let rows = connection
        .fetch_all(
            select_layer!("WHERE case_id = $1 ORDER BY place, id"),
            args![case.to_string()],
        )
        .await?;
    rows.iter().map(read).collect()
}

/// The layers that are made of a series, of whichever case and study.
pub async fn of_series(
    connection: &mut Connection,
    series: &Uid,
) -> Result<Vec<(CaseId, LayerId)>, StoreError> {
    let rows = connection
        .fetch_all(
            "SELECT case_id, id FROM layers WHERE series_uid = $1 ORDER BY case_id, place",
            args![series.as_str()],
        )
        .await?;
    rows.iter().map(read_ids).collect()
}

/// Makes a layer failed, which then needs no objects.
pub(super) async fn make_failed(
    connection: &mut Connection,
    owner: Owner,
    failure: &Failure,
    now: i64,
) -> Result<(), StoreError> {
    let needed = owners::objects(connection, owner).await?;
    pins::abandon(connection, needed, now).await?;
    let [case, layer] = owner.columns();
    connection
        .execute(
            "DELETE FROM layer_objects WHERE case_id = $1 AND layer_id = $2",
            args![&case, &layer],
        )
        .await?;
    connection
        .execute(
            "UPDATE layers SET state = 'failed', failure = $1, facts = NULL, facts_digest = NULL WHERE case_id = $2 AND id = $3",
            args![serde_json::to_string(failure)?, case, layer],
        )
        .await?;
    Ok(())
}

/// Removes the row of a layer; whether it was there. Its references go with it (ON DELETE CASCADE).
pub(super) async fn delete(
    connection: &mut Connection,
    case: &CaseId,
    layer: &LayerId,
) -> Result<bool, StoreError> {
    jobs::remove(connection, &Owner::from((case, layer)).key()).await?;
    made::forget(connection, &Made::layer(case, layer)).await?;
    let deleted = connection
        .execute(
            "DELETE FROM layers WHERE case_id = $1 AND id = $2",
            args![case.to_string(), layer.to_string()],
        )
        .await?;
    Ok(deleted > 0)
}

/// Queues a layer again whose facts are damaged: they are made again from the source, and so is its map, because it may lie
/// elsewhere then.
async fn forget_facts(
    connection: &mut Connection,
    owner: Owner,
    now: i64,
) -> Result<(), StoreError> {
    tracing::error!(
        case = owner.case.short(),
        "the facts of a layer are damaged; it will be placed again from its source"
    );
    let mut maps = owners::objects(connection, owner).await?;
    maps.retain(|name| name.kind == ObjectKind::Maps);
    pins::abandon(connection, maps, now).await?;
    let [case, layer] = owner.columns();
    connection
        .execute(
            "DELETE FROM layer_objects WHERE case_id = $1 AND layer_id = $2 AND kind = 'maps'",
            args![&case, &layer],
        )
        .await?;
    connection
        .execute(
            "UPDATE layers SET facts = NULL, facts_digest = NULL WHERE case_id = $1 AND id = $2",
            args![case, layer],
        )
        .await?;
    owners::queue_again(connection, owner, "", now).await
}

fn unreadable(what: &str) -> StoreError {
    StoreError::Rows(format!("a layer's row has an unknown {what}").into())
}

fn read_ids(row: &Row) -> Result<(CaseId, LayerId), StoreError> {
    let [case, id]: [String; 2] = [row.get("case_id")?, row.get("id")?];
    let case = CaseId::parse(&case).ok_or_else(|| unreadable("case"))?;
    let id = LayerId::parse(&id).ok_or_else(|| unreadable("id"))?;
    Ok((case, id))
}

fn read(row: &Row) -> Result<Layer, StoreError> {
    let (case, id) = read_ids(row)?;
    let facts: Option<String> = row.get("facts")?;
    let digest: Option<String> = row.get("facts_digest")?;
    if facts.as_deref().map(owners::digest) != digest {
        return Err(StoreError::DamagedLayer(case, id));
    }
    let parameters: String = row.get("parameters")?;
    let failure: Option<String> = row.get("failure")?;
    let created_at = Timestamp::from_microsecond(row.get("created_at")?);
    Ok(Layer {
        case,
        id,
        name: row.get("name")?,
        parameters: serde_json::from_str::<LayerParameters>(&parameters)?,
        state: jobs::read_state(row).ok_or_else(|| unreadable("state"))?,
        failure: failure
            .as_deref()
            .map(serde_json::from_str::<Failure>)
            .transpose()?,
        facts: facts
            .as_deref()
            .map(serde_json::from_str::<LayerFacts>)
            .transpose()?,
        created_at: created_at.map_err(|_| unreadable("time"))?,
        closed: read_closed(row, "closed")?,
    })
}
