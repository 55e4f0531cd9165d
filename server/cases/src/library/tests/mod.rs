//! The library on a whole store; each file has a subject.

mod cases;
mod damage;
mod deletion;
mod kills;
mod processes;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use case::{CaseFacts, CaseId, CaseState, ObjectKind};
use storage::Store;
use storage::testing::files_below;
use tempfile::TempDir;

use super::Library;
use crate::jobs::start_workers;
use crate::testing::{Fake, fake_objects, library_on, options, settled_state, submit};

const GRACE: Duration = Duration::from_secs(20);

async fn open(directory: &TempDir, fake: &Arc<Fake>) -> Library {
    let store = Store::open(directory.path(), options()).await;
    library_on(store.unwrap(), fake)
}

/// A library with one ready case.
async fn ready(directory: &TempDir, fake: &Arc<Fake>) -> (Library, CaseId) {
    let library = open(directory, fake).await;
    let workers = start_workers(library.clone(), 1);
    let id = submit(&library, "volume").await.id;
    assert_eq!(settled_state(&library, &id).await, Some(CaseState::Ready));
    workers.shut_down(GRACE).await;
    (library, id)
}

fn as_they_are(_: &CaseFacts, payloads: &[Bytes]) -> Option<Vec<Bytes>> {
    Some(payloads.to_vec())
}

/// The derived objects of a case, as a reader gets them.
async fn load(library: &Library, id: &CaseId) -> Option<Vec<Bytes>> {
    library
        .load(id, &ObjectKind::DERIVED, as_they_are)
        .await
        .unwrap()
}

fn expected(volume: &str) -> Vec<Bytes> {
    fake_objects(volume.as_bytes())
        .into_iter()
        .map(|(_, payload)| payload)
        .collect()
}

fn object_files(directory: &Path, kind: ObjectKind) -> Vec<std::path::PathBuf> {
    files_below(&directory.join("objects").join(kind.name()))
}
