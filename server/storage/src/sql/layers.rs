//! Layers of cases, and their jobs.

use case::{CaseId, CaseState, Failure, FailureKind, Layer, LayerFacts, LayerId, LayerParameters};
use jiff::Timestamp;

use super::cases::read_state;
use super::connection::{Connection, Row, microseconds};
use super::{fence, pins, upkeep};
use crate::rows::{
    ChangedLayer, InsertedLayer, LayerChange, LayerClaim, LayerName, LeaseTerms, NewLayer, Pinned,
    Release,
};
use crate::{ObjectName, StoreError};

/// A layer, which `read` understands. A `WHERE` or `ORDER BY` may follow.
macro_rules! select_layer {
    ($rest:literal) => {
        concat!(
            "SELECT case_id, id, name, parameters, state, failure, facts, facts_digest, created_at FROM layers ",
            $rest
        )
    };
}

pub(super) async fn insert(
    connection: &mut Connection,
    new: &NewLayer,
    now: i64,
) -> Result<InsertedLayer, StoreError> {
    if !connection.has_case(&new.case.to_string()).await? {
        return Ok(InsertedLayer::NoCase);
    }
    let others = of_case(connection, &new.case).await?;
    let known = others.iter().find(|layer| layer.id == new.id);
    if known.is_some_and(|layer| layer.state != CaseState::Failed) {
        return Ok(InsertedLayer::Exists);
    }
    if known.is_none() && others.len() >= new.most {
        return Ok(InsertedLayer::TooMany);
    }
    if waiting(connection).await? >= new.queue_limit {
        return Ok(InsertedLayer::QueueFull);
    }
    if known.is_some() {
        queue_again(
            connection,
            [&new.case.to_string(), &new.id.to_string()],
            now,
        )
        .await?;
    } else {
        let Some(name) = free_name(&new.name, &others) else {
            return Ok(InsertedLayer::NameTaken);
        };
        insert_row(connection, new, &name, now).await?;
    }
    if !refer(connection, (&new.case, &new.id), &new.sources, now).await? {
        return Ok(InsertedLayer::PinLost);
    }
    Ok(match known {
        Some(_) => InsertedLayer::Requeued,
        None => InsertedLayer::Created,
    })
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
        .query(
            "INSERT INTO layers (case_id, id, name, place, parameters, state, created_at, available_at)
             VALUES ($1, $2, $3, (SELECT coalesce(max(place) + 1, 0) FROM layers WHERE case_id = $1), $4, 'queued', $5, $5)",
        )
        .bind(new.case.to_string())
        .bind(new.id.to_string())
        .bind(name)
        .bind(serde_json::to_string(&new.parameters)?)
        .bind(now)
        .execute()
        .await?;
    Ok(())
}

async fn queue_again(
    connection: &mut Connection,
    [case, layer]: [&str; 2],
    now: i64,
) -> Result<(), StoreError> {
    connection
        .query(
            "UPDATE layers SET state = 'queued', failure = NULL, available_at = $3, attempts = 0, fence = 0, lease_until = NULL
             WHERE case_id = $1 AND id = $2",
        )
        .bind(case)
        .bind(layer)
        .bind(now)
        .execute()
        .await?;
    Ok(())
}

/// Gives a new version of a case the layers of the case, to be prepared with its own envelope; their placement stays.
pub(super) async fn inherit(
    connection: &mut Connection,
    case: &CaseId,
    previous: &CaseId,
    now: i64,
) -> Result<(), StoreError> {
    connection
        .query(
            "INSERT INTO layers (case_id, id, name, place, parameters, state, facts, facts_digest, created_at, available_at)
             SELECT $1, id, name, place, parameters, 'queued', facts, facts_digest, created_at, $3 FROM layers
             WHERE case_id = $2 AND state <> 'failed'",
        )
        .bind(case.to_string())
        .bind(previous.to_string())
        .bind(now)
        .execute()
        .await?;
    connection
        .query(
            "INSERT INTO layer_objects (case_id, layer_id, kind, digest)
             SELECT $1, layer_id, kind, digest FROM layer_objects JOIN layers ON layers.case_id = $1 AND layers.id = layer_id
             WHERE layer_objects.case_id = $2 AND kind <> 'layer'",
        )
        .bind(case.to_string())
        .bind(previous.to_string())
        .execute()
        .await?;
    Ok(())
}

/// The number of layers of ready cases that wait for a lease.
async fn waiting(connection: &mut Connection) -> Result<usize, StoreError> {
    let row = connection
        .query("SELECT count(*) AS count FROM layers WHERE state = 'queued'")
        .fetch_one()
        .await?;
    let count: i64 = row.get("count")?;
    Ok(usize::try_from(count).unwrap_or(0))
}

/// Turns pins into references of a layer; `false` if a pin is gone. Objects that it no longer needs are abandoned.
pub(super) async fn refer(
    connection: &mut Connection,
    (case, layer): (&CaseId, &LayerId),
    pinned: &Pinned,
    now: i64,
) -> Result<bool, StoreError> {
    if !pins::consume(connection, pinned).await? {
        return Ok(false);
    }
    let before = objects(connection, case, layer).await?;
    for name in &pinned.names {
        connection
            .query(
                "INSERT INTO layer_objects (case_id, layer_id, kind, digest) VALUES ($1, $2, $3, $4)
                 ON CONFLICT (case_id, layer_id, kind) DO UPDATE SET digest = excluded.digest",
            )
            .bind(case.to_string())
            .bind(layer.to_string())
            .bind(name.kind.name())
            .bind(name.digest.to_string())
            .execute()
            .await?;
    }
    let after = objects(connection, case, layer).await?;
    let dropped = before.into_iter().filter(|name| !after.contains(name));
    pins::abandon(connection, dropped.collect(), now).await?;
    Ok(true)
}

pub(super) async fn objects(
    connection: &mut Connection,
    case: &CaseId,
    layer: &LayerId,
) -> Result<Vec<ObjectName>, StoreError> {
    let rows = connection
        .query("SELECT kind, digest FROM layer_objects WHERE case_id = $1 AND layer_id = $2 ORDER BY kind")
        .bind(case.to_string())
        .bind(layer.to_string())
        .fetch_all()
        .await?;
    rows.iter().map(pins::read_name).collect()
}

/// Leaves the objects of all layers of a case with expired pins, before the case is deleted.
pub(super) async fn abandon_all(
    connection: &mut Connection,
    case: &CaseId,
    now: i64,
) -> Result<(), StoreError> {
    let rows = connection
        .query("SELECT kind, digest FROM layer_objects WHERE case_id = $1")
        .bind(case.to_string())
        .fetch_all()
        .await?;
    let names = rows.iter().map(pins::read_name);
    pins::abandon(connection, names.collect::<Result<_, _>>()?, now).await
}

pub(super) async fn of_case(
    connection: &mut Connection,
    case: &CaseId,
) -> Result<Vec<Layer>, StoreError> {
    let rows = connection
        .query(select_layer!("WHERE case_id = $1 ORDER BY place, id"))
        .bind(case.to_string())
        .fetch_all()
        .await?;
    rows.iter().map(read).collect()
}

pub(super) async fn change(
    connection: &mut Connection,
    (case, layer): (&CaseId, &LayerId),
    change: &LayerChange,
) -> Result<ChangedLayer, StoreError> {
    let layers = of_case(connection, case).await?;
    let Some(from) = layers.iter().position(|known| known.id == *layer) else {
        return Ok(ChangedLayer::NoLayer);
    };
    if let Some(name) = &change.name {
        let is_taken = |other: &Layer| other.name == *name && other.id != *layer;
        if layers.iter().any(is_taken) {
            return Ok(ChangedLayer::NameTaken);
        }
        connection
            .query("UPDATE layers SET name = $1 WHERE case_id = $2 AND id = $3")
            .bind(name)
            .bind(case.to_string())
            .bind(layer.to_string())
            .execute()
            .await?;
    }
    if let Some(place) = change.place {
        let mut ids: Vec<LayerId> = layers.iter().map(|layer| layer.id).collect();
        ids.remove(from);
        ids.insert(place.min(ids.len()), *layer);
        for (place, id) in (0i64..).zip(ids) {
            connection
                .query("UPDATE layers SET place = $1 WHERE case_id = $2 AND id = $3")
                .bind(place)
                .bind(case.to_string())
                .bind(id.to_string())
                .execute()
                .await?;
        }
    }
    Ok(ChangedLayer::Done)
}

pub(super) async fn delete(
    connection: &mut Connection,
    case: &CaseId,
    layer: &LayerId,
    now: i64,
) -> Result<bool, StoreError> {
    let needed = objects(connection, case, layer).await?;
    pins::abandon(connection, needed, now).await?;
    let deleted = connection
        .query("DELETE FROM layers WHERE case_id = $1 AND id = $2")
        .bind(case.to_string())
        .bind(layer.to_string())
        .execute()
        .await?;
    Ok(deleted > 0)
}

pub(super) struct Available {
    case: String,
    id: String,
    attempts: i64,
}

pub(super) async fn oldest_available(
    connection: &mut Connection,
    now: i64,
) -> Result<Option<Available>, StoreError> {
    let row = connection
        .query(
            "SELECT layers.case_id, layers.id, attempts FROM layers JOIN cases ON cases.id = layers.case_id
             WHERE layers.state IN ('queued', 'preparing') AND cases.state = 'ready' AND available_at <= $1
                   AND (lease_until IS NULL OR lease_until <= $1)
             ORDER BY available_at, layers.case_id, layers.place LIMIT 1",
        )
        .bind(now)
        .fetch_optional()
        .await?;
    row.map(|row| {
        Ok(Available {
            case: row.get("case_id")?,
            id: row.get("id")?,
            attempts: row.get("attempts")?,
        })
    })
    .transpose()
}

pub(super) async fn claim(
    connection: &mut Connection,
    terms: &LeaseTerms,
    now: i64,
) -> Result<Option<LayerClaim>, StoreError> {
    while let Some(job) = oldest_available(connection, now).await? {
        if job.attempts < i64::from(terms.max_attempts) {
            let until = now + microseconds(terms.lease);
            return Ok(Some(lease(connection, &job, until).await?));
        }
        let detail = format!(
            "the preparation of the layer was interrupted {} times and abandoned; upload it again to retry",
            job.attempts
        );
        let failure = Failure::new(FailureKind::Internal, "preparation-interrupted", detail);
        make_failed(connection, [&job.case, &job.id], &failure).await?;
    }
    Ok(None)
}

async fn lease(
    connection: &mut Connection,
    job: &Available,
    until: i64,
) -> Result<LayerClaim, StoreError> {
    let fence = fence::next(connection, until).await?;
    let row = connection
        .query(
            "UPDATE layers SET state = 'preparing', attempts = attempts + 1, fence = $1, lease_until = $2
             WHERE case_id = $3 AND id = $4
             RETURNING case_id, id, name, parameters, state, failure, facts, facts_digest, created_at",
        )
        .bind(fence)
        .bind(until)
        .bind(&job.case)
        .bind(&job.id)
        .fetch_one()
        .await?;
    let layer = read(&row)?;
    Ok(LayerClaim { layer, fence })
}

pub(super) async fn renew(
    connection: &mut Connection,
    claim: &LayerClaim,
    until: i64,
) -> Result<bool, StoreError> {
    let renewed = connection
        .query("UPDATE layers SET lease_until = $1 WHERE case_id = $2 AND id = $3 AND fence = $4 AND state = 'preparing'")
        .bind(until)
        .bind(claim.layer.case.to_string())
        .bind(claim.layer.id.to_string())
        .bind(claim.fence)
        .execute()
        .await?;
    Ok(renewed > 0)
}

pub(super) async fn release(
    connection: &mut Connection,
    claim: &LayerClaim,
    release: Release,
    now: i64,
) -> Result<bool, StoreError> {
    // Without its fence, the former holder can neither renew nor publish.
    let released = connection
        .query(
            "UPDATE layers SET state = 'queued', lease_until = NULL, fence = 0, available_at = $1, attempts = attempts - $2
             WHERE case_id = $3 AND id = $4 AND fence = $5 AND state = 'preparing'",
        )
        .bind(now + microseconds(release.after))
        .bind(i64::from(!release.counts))
        .bind(claim.layer.case.to_string())
        .bind(claim.layer.id.to_string())
        .bind(claim.fence)
        .execute()
        .await?;
    Ok(released > 0)
}

/// Makes a layer ready where the lease is still the claim's; whether it was.
pub(super) async fn make_ready(
    connection: &mut Connection,
    claim: &LayerClaim,
    facts: &LayerFacts,
) -> Result<bool, StoreError> {
    let facts = serde_json::to_string(facts)?;
    let made = connection
        .query(
            "UPDATE layers SET state = 'ready', facts = $1, facts_digest = $2, failure = NULL, fence = 0, lease_until = NULL
             WHERE case_id = $3 AND id = $4 AND fence = $5 AND state = 'preparing'",
        )
        .bind(&facts)
        .bind(upkeep::digest(&facts))
        .bind(claim.layer.case.to_string())
        .bind(claim.layer.id.to_string())
        .bind(claim.fence)
        .execute()
        .await?;
    Ok(made > 0)
}

/// Makes a layer failed where the lease is still the claim's; whether it was.
pub(super) async fn fail(
    connection: &mut Connection,
    claim: &LayerClaim,
    failure: &Failure,
    now: i64,
) -> Result<bool, StoreError> {
    if !renew(connection, claim, 0).await? {
        return Ok(false);
    }
    let Layer { case, id, .. } = &claim.layer;
    let needed = objects(connection, case, id).await?;
    pins::abandon(connection, needed, now).await?;
    let [case, layer] = [case.to_string(), id.to_string()];
    connection
        .query("DELETE FROM layer_objects WHERE case_id = $1 AND layer_id = $2")
        .bind(&*case)
        .bind(&*layer)
        .execute()
        .await?;
    make_failed(connection, [&case, &layer], failure).await?;
    Ok(true)
}

async fn make_failed(
    connection: &mut Connection,
    [case, layer]: [&str; 2],
    failure: &Failure,
) -> Result<(), StoreError> {
    connection
        .query(
            "UPDATE layers SET state = 'failed', failure = $1, facts = NULL, facts_digest = NULL, fence = 0, lease_until = NULL
             WHERE case_id = $2 AND id = $3",
        )
        .bind(serde_json::to_string(failure)?)
        .bind(case)
        .bind(layer)
        .execute()
        .await?;
    Ok(())
}

/// Queues a ready layer again; whether it was ready.
pub(super) async fn prepare_again(
    connection: &mut Connection,
    case: &CaseId,
    layer: &LayerId,
    now: i64,
) -> Result<bool, StoreError> {
    let layers = of_case(connection, case).await?;
    let is_ready = |known: &Layer| known.id == *layer && known.state == CaseState::Ready;
    if !layers.iter().any(is_ready) {
        return Ok(false);
    }
    queue_again(connection, [&case.to_string(), &layer.to_string()], now).await?;
    Ok(true)
}

pub(super) async fn adopt(
    connection: &mut Connection,
    layer: &Layer,
    objects: &Pinned,
    now: i64,
) -> Result<(), StoreError> {
    let state = match layer.state.is_final() {
        true => layer.state,
        false => CaseState::Queued,
    };
    let facts = layer
        .facts
        .as_ref()
        .map(serde_json::to_string)
        .transpose()?;
    let failure = layer
        .failure
        .as_ref()
        .map(serde_json::to_string)
        .transpose()?;
    let others = of_case(connection, &layer.case).await?;
    let name = free_name(&LayerName::Usual(layer.name.clone()), &others);
    connection
        .query(
            "INSERT INTO layers (case_id, id, name, place, parameters, state, failure, facts, facts_digest, created_at, available_at)
             VALUES ($1, $2, $3, (SELECT coalesce(max(place) + 1, 0) FROM layers WHERE case_id = $1), $4, $5, $6, $7, $8, $9, $10)
             ON CONFLICT (case_id, id) DO UPDATE SET state = excluded.state, failure = excluded.failure,
                                                     facts = excluded.facts, facts_digest = excluded.facts_digest",
        )
        .bind(layer.case.to_string())
        .bind(layer.id.to_string())
        .bind(name.unwrap_or_default())
        .bind(serde_json::to_string(&layer.parameters)?)
        .bind(state.name())
        .bind(failure)
        .bind(facts.as_deref())
        .bind(facts.as_deref().map(upkeep::digest))
        .bind(layer.created_at.as_microsecond())
        .bind(now)
        .execute()
        .await?;
    if !refer(connection, (&layer.case, &layer.id), objects, now).await? {
        return Err(StoreError::Rows("a pin was lost".into()));
    }
    Ok(())
}

/// Queues a layer again whose facts are damaged: they are made again from the source.
pub(super) async fn forget_facts(
    connection: &mut Connection,
    case: &CaseId,
    layer: &LayerId,
    now: i64,
) -> Result<(), StoreError> {
    tracing::error!("the facts of a layer are damaged; it will be placed again from its source");
    let [case, layer] = [case.to_string(), layer.to_string()];
    connection
        .query("UPDATE layers SET facts = NULL, facts_digest = NULL WHERE case_id = $1 AND id = $2")
        .bind(&case)
        .bind(&layer)
        .execute()
        .await?;
    queue_again(connection, [&case, &layer], now).await
}

pub(super) async fn end_leases(connection: &mut Connection, now: i64) -> Result<(), StoreError> {
    connection
        .query("UPDATE layers SET lease_until = $1 WHERE lease_until > $1")
        .bind(now)
        .execute()
        .await?;
    Ok(())
}

fn read(row: &Row) -> Result<Layer, StoreError> {
    let unreadable =
        |what: &str| StoreError::Rows(format!("a layer's row has an unknown {what}").into());
    let [case, id]: [String; 2] = [row.get("case_id")?, row.get("id")?];
    let case = CaseId::parse(&case).ok_or_else(|| unreadable("case"))?;
    let id = LayerId::parse(&id).ok_or_else(|| unreadable("id"))?;
    let facts: Option<String> = row.get("facts")?;
    let digest: Option<String> = row.get("facts_digest")?;
    if facts.as_deref().map(upkeep::digest) != digest {
        return Err(StoreError::DamagedLayer(case, id));
    }
    let [parameters, state]: [String; 2] = [row.get("parameters")?, row.get("state")?];
    let failure: Option<String> = row.get("failure")?;
    let created_at = Timestamp::from_microsecond(row.get("created_at")?);
    Ok(Layer {
        case,
        id,
        name: row.get("name")?,
        parameters: serde_json::from_str::<LayerParameters>(&parameters)?,
        state: read_state(&state).ok_or_else(|| unreadable("state"))?,
        failure: failure
            .as_deref()
            .map(serde_json::from_str::<Failure>)
            .transpose()?,
        facts: facts
            .as_deref()
            .map(serde_json::from_str::<LayerFacts>)
            .transpose()?,
        created_at: created_at.map_err(|_| unreadable("time"))?,
    })
}
