//! Checks that everything stored is present and intact.

use std::time::Duration;

use case::{Case, CaseId, Failure, LayerId, ObjectKind, SOURCE_DAMAGED};

use super::next_cases;
use crate::sql::expiry::newest_row;
use crate::sql::microseconds;
use crate::{ObjectName, REMOVALS_AT_ONCE, Store, StoreError, Unreadable};

/// A problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Defect {
    /// An object is missing: of a case or of one of its layers, or one that the tables of another crate name.
    Missing(Option<CaseId>, ObjectName),
    /// The same of a damaged object.
    Damaged(Option<CaseId>, ObjectName),
    /// The findings of a case are damaged.
    DamagedFindings(CaseId),
    /// A reading of a case is damaged.
    DamagedReading(CaseId),
    /// A case failed because a source was damaged, and its sources are whole now.
    FailedThoughWhole(CaseId),
    /// The same of a layer.
    LayerFailedThoughWhole(CaseId, LayerId),
    /// An object that no case and no layer needs and no process is about to need.
    Unreferenced(ObjectName),
}

/// How long an object stays that nothing refers to: as long as it takes to notice that rows are missing.
const KEPT_UNREFERENCED: Duration = Duration::from_secs(7 * 24 * 3600);

/// Some objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Amount {
    pub objects: u64,
    /// As stored.
    pub bytes: u64,
}

impl Amount {
    fn add(&mut self, bytes: u64) {
        self.objects += 1;
        self.bytes += bytes;
    }
}

/// The objects that nothing refers to, and what there is beside them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Unreferenced {
    /// Those of at least seven days.
    pub names: Vec<ObjectName>,
    /// How much these are.
    pub old: Amount,
    /// The others that nothing refers to, which stay.
    pub young: Amount,
    /// All objects of the store.
    pub all: Amount,
    /// Whether one of them is younger than every row: the rows may be those of a backup.
    pub is_newer_than_rows: bool,
}

impl Unreferenced {
    /// Whether more than 5 % of the store would be removed, by number or by bytes.
    pub fn is_much(&self) -> bool {
        let is_much = |part: u64, whole: u64| part.saturating_mul(20) > whole;
        is_much(self.old.objects, self.all.objects) || is_much(self.old.bytes, self.all.bytes)
    }
}

fn is_source_damaged(failure: Option<&Failure>) -> bool {
    failure.is_some_and(|failure| failure.name == SOURCE_DAMAGED)
}

/// The numbers of checked cases and objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Inspected {
    pub cases: u64,
    /// Objects that cases and their layers need, each counted for each case, and those that other tables name.
    pub objects: u64,
    /// Bytes of their payloads, unpacked.
    pub bytes: u64,
}

/// Reads every row and every object, and reports problems. It changes nothing, except that a case with damaged
/// facts is queued again, as by any other reader.
///
/// # Errors
/// If the store cannot be reached, or the database itself is damaged.
pub async fn inspect(
    store: &Store,
    report: &mut (dyn FnMut(Defect) + Send),
) -> Result<Inspected, StoreError> {
    store.rows().database.check_file().await?;
    let mut inspected = Inspected::default();
    let mut after = None;
    while let Some(cases) = next_cases(store, &mut after).await? {
        for case in cases {
            inspect_case(store, &case, &mut inspected, report).await?;
        }
    }
    for kind in [ObjectKind::Instance, ObjectKind::Result] {
        inspect_of_tables(store, kind, &mut inspected, report).await?;
    }
    for some in store.objects().list().await?.chunks(REMOVALS_AT_ONCE) {
        let unneeded = store.unneeded(some).await?;
        unneeded
            .into_iter()
            .map(Defect::Unreferenced)
            .for_each(&mut *report);
    }
    Ok(inspected)
}

async fn inspect_case(
    store: &Store,
    case: &Case,
    inspected: &mut Inspected,
    report: &mut (dyn FnMut(Defect) + Send),
) -> Result<(), StoreError> {
    let (id, mut unsound) = (&case.id, Vec::new());
    inspected.cases += 1;
    match store.findings(id).await {
        Err(StoreError::DamagedFindings(id)) => report(Defect::DamagedFindings(id)),
        other => _ = other?,
    }
    for state in store.readings(id).await? {
        match store.reading(id, &state.reader, state.version).await {
            Err(StoreError::DamagedReading(id)) => report(Defect::DamagedReading(id)),
            other => _ = other?,
        }
    }
    for name in all_objects_of(store, id).await? {
        let Some(defect) = inspect_object(store, (Some(*id), name), inspected).await? else {
            continue;
        };
        unsound.push(name);
        // The case or the layer may have been deleted or rebuilt a moment ago.
        if all_objects_of(store, id).await?.contains(&name) {
            report(defect);
        }
    }
    let is_whole = |objects: &[ObjectName]| {
        let mut sources = objects.iter().filter(|name| name.kind.is_source());
        sources.all(|name| !unsound.contains(name))
    };
    if !is_whole(&store.objects_of(id).await?) {
        return Ok(());
    }
    if is_source_damaged(case.failure.as_ref()) {
        report(Defect::FailedThoughWhole(*id));
    }
    for layer in store.layers(id).await? {
        let objects = store.objects_of((id, &layer.id)).await?;
        if is_source_damaged(layer.failure.as_ref()) && is_whole(&objects) {
            report(Defect::LayerFailedThoughWhole(*id, layer.id));
        }
    }
    Ok(())
}

/// Reads the objects of a kind that the tables of another crate name.
async fn inspect_of_tables(
    store: &Store,
    kind: ObjectKind,
    inspected: &mut Inspected,
    report: &mut (dyn FnMut(Defect) + Send),
) -> Result<(), StoreError> {
    let mut after: Option<ObjectName> = None;
    loop {
        let names = store
            .objects_of_tables(kind, after.as_ref(), REMOVALS_AT_ONCE)
            .await?;
        let Some(last) = names.last() else {
            return Ok(());
        };
        after = Some(*last);
        for name in names {
            let Some(defect) = inspect_object(store, (None, name), inspected).await? else {
                continue;
            };
            // It may have become unneeded a moment ago.
            if store.unneeded(&[name]).await?.is_empty() {
                report(defect);
            }
        }
    }
}

async fn inspect_object(
    store: &Store,
    (case, name): (Option<CaseId>, ObjectName),
    inspected: &mut Inspected,
) -> Result<Option<Defect>, StoreError> {
    inspected.objects += 1;
    match store.objects().get(&name).await {
        Ok(payload) => {
            inspected.bytes += payload.len() as u64;
            Ok(None)
        }
        Err(Unreadable::Missing) => Ok(Some(Defect::Missing(case, name))),
        Err(Unreadable::Damaged(_)) => Ok(Some(Defect::Damaged(case, name))),
        Err(Unreadable::Store(error)) => Err(error.into()),
    }
}

/// The objects that a case and its layers need.
pub(crate) async fn all_objects_of(
    store: &Store,
    id: &CaseId,
) -> Result<Vec<ObjectName>, StoreError> {
    let mut names = store.objects_of(id).await?;
    for layer in store.layers(id).await? {
        names.extend(store.objects_of((id, &layer.id)).await?);
    }
    Ok(names)
}

/// What may be removed because nothing refers to it: see [`Unreferenced`]. Ages are measured by the clock of the object store, with
/// an object that is written for it.
///
/// # Errors
/// If the store cannot be reached.
pub async fn unreferenced(store: &Store) -> Result<Unreferenced, StoreError> {
    let now = store.objects().now().await?;
    let newest_row = newest_row(&mut store.connect().await?).await?;
    let mut found = Unreferenced::default();
    for some in store.objects().list_all().await?.chunks(REMOVALS_AT_ONCE) {
        let names: Vec<_> = some.iter().map(|listed| listed.name).collect();
        let unneeded = store.unneeded(&names).await?;
        for listed in some {
            found.all.add(listed.bytes);
            if !unneeded.contains(&listed.name) {
                continue;
            }
            found.is_newer_than_rows |= newest_row.is_none_or(|row| row < listed.modified_us);
            if now.saturating_sub(listed.modified_us) < microseconds(KEPT_UNREFERENCED) {
                found.young.add(listed.bytes);
            } else {
                found.old.add(listed.bytes);
                found.names.push(listed.name);
            }
        }
    }
    Ok(found)
}

/// Removes unreferenced objects, after checking again that they are unreferenced.
///
/// # Errors
/// If the rows or the objects cannot be written.
pub async fn remove_unreferenced(store: &Store, names: &[ObjectName]) -> Result<(), StoreError> {
    for some in names.chunks(REMOVALS_AT_ONCE) {
        store.remove_unneeded(some).await?;
    }
    Ok(())
}
