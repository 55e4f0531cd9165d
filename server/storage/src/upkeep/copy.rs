//! Copies one store into another: a move between back ends, or a backup.

use case::{CaseId, CaseState, Layer, ObjectKind};

use super::next_cases;
use crate::rows::{Made, Pinned};
use crate::tables::{made, series};
use crate::{ObjectName, Store, StoreError, Unreadable};

/// The result of a copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Copied {
    /// Cases that were new to the target or were updated there.
    pub cases: u64,
    /// Objects written.
    pub objects: u64,
    /// Their bytes, as stored.
    pub bytes: u64,
    /// Intact objects that the target already had.
    pub kept: u64,
    /// Cases and layers that were not copied, because a source is missing or damaged; objects of other tables that are missing or damaged.
    pub lost: u64,
}

/// A step of a copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CopyStep {
    /// A case was copied.
    Case(CaseId),
    /// A case, or one of its layers, was not copied.
    LostCase(CaseId),
}

/// Receives each step with the result so far.
type Report<'r> = &'r mut (dyn FnMut(CopyStep, &Copied) + Send);

/// Copies every case, and what users have chosen for themselves, into another store. Intact objects that the target already has are kept, so an interrupted
/// copy continues where it stopped, and a repeated copy adds what is new. Cases that only the target has stay
/// there, and so does what users have chosen there since.
///
/// A case that is not prepared yet is prepared there. Each object is verified against its digest when it is read,
/// and read back after it is written.
///
/// # Errors
/// If a store cannot be reached.
pub async fn copy_into(from: &Store, to: &Store, report: Report<'_>) -> Result<Copied, StoreError> {
    let mut ids = Vec::new();
    let mut walk = None;
    while let Some(cases) = next_cases(from, &mut walk).await? {
        ids.extend(cases.into_iter().map(|case| case.id));
    }
    let mut copied = Copied::default();
    // A case comes before its versions.
    for id in ids.iter().rev() {
        let step = match copy_case(from, to, id, &mut copied).await? {
            true => CopyStep::Case(*id),
            false => CopyStep::LostCase(*id),
        };
        report(step, &copied);
    }
    for preferences in from.all_preferences().await? {
        to.write_copied_preferences(preferences).await?;
    }
    Ok(copied)
}

/// Returns `false` if a source is lost.
async fn copy_case(
    from: &Store,
    to: &Store,
    id: &CaseId,
    copied: &mut Copied,
) -> Result<bool, StoreError> {
    let Some(case) = from.case(id).await? else {
        // The case was deleted meanwhile.
        return Ok(true);
    };
    let mut names = from.objects_of(id).await?;
    if case.state != CaseState::Ready {
        names.retain(is_of_upload);
    }
    let write = |pinned: Pinned, lost: Vec<ObjectName>| async move {
        // Derived objects are rebuilt on first use, and a manifest by `check-store --repair`.
        if lost.iter().any(|name| name.kind.is_source()) {
            return Ok(None);
        }
        let is_new = to.write_copied_case(&case, &pinned).await?;
        copy_of_case(from, to, id).await?;
        Ok(Some(is_new))
    };
    let Some(is_new) = copy_objects(from, to, &names, copied, write).await? else {
        copied.lost += 1;
        return Ok(false);
    };
    copied.cases += u64::from(is_new);
    let mut is_whole = true;
    let layers = from.layers(id).await?;
    // An earlier copy may have what was deleted, corrected or rejected since.
    for former in to.layers(id).await? {
        if layers.iter().all(|layer| layer.id != former.id) {
            to.delete((id, &former.id)).await?;
        }
    }
    for layer in layers {
        is_whole &= copy_layer(from, to, layer, copied).await?;
    }
    Ok(is_whole)
}

/// Copies the series of a case, of which images it was made, its findings, and its readings.
async fn copy_of_case(from: &Store, to: &Store, id: &CaseId) -> Result<(), StoreError> {
    let series = series::of_case(&mut from.connect().await?, id).await?;
    let known = series::of_case(&mut to.connect().await?, id).await?;
    if let Some(series) = series.filter(|_| known.is_none()) {
        let (mut transaction, _) = to.write().await?;
        series::index(&mut transaction, id, &series).await?;
        transaction.commit().await?;
    }
    copy_made_of(from, to, &Made::case(id)).await?;
    let findings = from.findings(id).await?;
    if findings != to.findings(id).await? {
        to.write_copied_findings(id, &findings).await?;
    }
    let known = to.readings(id).await?;
    for state in from.readings(id).await? {
        if !known.contains(&state)
            && let Some(reading) = from.reading(id, &state.reader, state.version).await?
        {
            to.write_copied_reading(id, &reading).await?;
        }
    }
    Ok(())
}

/// Copies of which images something was made.
async fn copy_made_of(from: &Store, to: &Store, made: &Made) -> Result<(), StoreError> {
    let images = made::of(&mut from.connect().await?, made).await?;
    let (mut transaction, _) = to.write().await?;
    made::make(&mut transaction, made, &images).await?;
    transaction.commit().await
}

/// Returns `false` if a source is lost.
async fn copy_layer(
    from: &Store,
    to: &Store,
    mut layer: Layer,
    copied: &mut Copied,
) -> Result<bool, StoreError> {
    let mut names = from.objects_of((&layer.case, &layer.id)).await?;
    if layer.state != CaseState::Ready {
        names.retain(is_of_upload);
    }
    let write = |mut pinned: Pinned, mut lost: Vec<ObjectName>| async move {
        if lost.iter().any(|name| name.kind.is_source()) {
            return Ok(false);
        }
        lost.retain(|name| name.kind != ObjectKind::Manifest);
        if !lost.is_empty() {
            // It is made again from the source; its placement stays.
            layer.state = CaseState::Queued;
            pinned.names.retain(|pinned| !lost.contains(pinned));
        }
        let series = from.series_of_layer(&layer.case, &layer.id).await?;
        to.write_copied_layer(&layer, series.as_ref(), &pinned)
            .await?;
        let made = Made::layer(&layer.case, &layer.id);
        copy_made_of(from, to, &made).await?;
        Ok(true)
    };
    let is_whole = copy_objects(from, to, &names, copied, write).await?;
    copied.lost += u64::from(!is_whole);
    Ok(is_whole)
}

/// Copies objects, which are pinned in the other store until `write` has referred to them. It also gets those that are missing or
/// damaged here. Ends at a source that is lost.
///
/// # Errors
/// If a store cannot be reached.
pub async fn copy_objects<T, F>(
    from: &Store,
    to: &Store,
    names: &[ObjectName],
    copied: &mut Copied,
    write: impl FnOnce(Pinned, Vec<ObjectName>) -> F,
) -> Result<T, StoreError>
where
    F: Future<Output = Result<T, StoreError>>,
{
    let pinned = to.pin(names.iter().copied()).await?;
    let mut lost = Vec::new();
    for name in names {
        if !copy_object(from, to, name, copied).await? {
            lost.push(*name);
            if name.kind.is_source() {
                break;
            }
        }
    }
    let written = write(pinned.clone(), lost).await?;
    to.abandon(&pinned).await;
    Ok(written)
}

/// Copies an object that is pinned in another store; `false` if it is missing or damaged here.
async fn copy_object(
    from: &Store,
    to: &Store,
    name: &ObjectName,
    copied: &mut Copied,
) -> Result<bool, StoreError> {
    match to.objects().get(name).await {
        Ok(_) => {
            copied.kept += 1;
            return Ok(true);
        }
        Err(Unreadable::Store(error)) => return Err(error.into()),
        Err(_) => {}
    }
    let framed = match from.objects().get_framed(name).await {
        Ok(framed) => framed,
        Err(Unreadable::Store(error)) => return Err(error.into()),
        Err(_) => return Ok(false),
    };
    copied.objects += 1;
    copied.bytes += framed.len() as u64;
    to.objects().put_framed(name, framed).await?;
    match to.objects().get(name).await {
        Ok(_) => Ok(true),
        Err(Unreadable::Store(error)) => Err(error.into()),
        Err(fault) => Err(StoreError::Objects(Box::new(fault))),
    }
}

/// Whether an object was there when its case or its layer was uploaded.
fn is_of_upload(name: &ObjectName) -> bool {
    name.kind.is_source() || name.kind == ObjectKind::Manifest
}
