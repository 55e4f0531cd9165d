//! Models of a phantom head, from a store.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use case::{CaseState, Parameters, SurfaceName};
use geometry::MeshSize;
use imaging::Limits;
use pipeline::Pipeline;
use pipeline::testing::{phantom, upload};
use storage::testing::files_below;
use storage::testing::postgres::PostgresServer;
use storage::{Count, DatabaseAddress, Location, Options, Store, StoreError};

use super::*;
use crate::application::{REMEMBERED_FOR, REMEMBERED_WHILE_AWAY};
use crate::error::Error;
use crate::jobs::start_workers;
use crate::library::{LibraryOptions, Preparation};
use crate::testing::application;
use crate::testing::settled_state;

struct Ready {
    directory: tempfile::TempDir,
    library: Library,
    models: Models,
    id: CaseId,
}

async fn ready() -> Ready {
    let directory = tempfile::tempdir().unwrap();
    let store = Store::open(directory.path(), Options::default());
    let store = store.await.unwrap();
    ready_in(store, directory).await
}

async fn ready_in(store: Store, directory: tempfile::TempDir) -> Ready {
    let library = Library::of(store);
    let workers = start_workers(library.clone(), 1);
    let submitted = library
        .submit(upload(&phantom()), Parameters::default())
        .await
        .unwrap();
    let id = submitted.case.id;
    assert_eq!(settled_state(&library, &id).await, Some(CaseState::Ready));
    workers.shut_down(Duration::from_secs(60)).await;
    let models = Models::new(library.clone());
    Ready {
        directory,
        library,
        models,
        id,
    }
}

impl Ready {
    async fn model(&self) -> WarmModel {
        self.models.get(&self.id, SurfaceName::Whole).await.unwrap()
    }

    /// Models of the same store, none of which is in memory.
    fn cold(&self) -> Models {
        Models::new(Library::of(self.library.store().clone()))
    }

    /// The same, within a budget of bytes.
    fn within(&self, cache_bytes: u64) -> Library {
        let options = LibraryOptions {
            cache_bytes,
            ..LibraryOptions::default()
        };
        let store = self.library.store().clone();
        Library::new(store, Preparation::default(), options)
    }

    fn damage(&self, kind: &str) {
        let file = &files_below(&self.directory.path().join("objects").join(kind))[0];
        let mut bytes = std::fs::read(file).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x10;
        std::fs::write(file, bytes).unwrap();
    }
}

#[tokio::test]
async fn a_model_is_what_was_prepared() {
    let ready = ready().await;
    let never = std::sync::atomic::AtomicBool::new(false);
    let prepared = Pipeline::default().prepare(
        &upload(&phantom()),
        &Parameters::default(),
        &Limits::default(),
        &|_| {},
        &never,
    );
    let prepared = prepared.unwrap();
    let model = ready.model().await;
    assert!(**model.model() == prepared.built.model);
    assert_eq!(model.facts().max_depth_mm, prepared.facts.max_depth_mm);
    assert!(model.distance().await.unwrap() == Some(prepared.built.distance));
    let cache = ready.library.cache();
    assert_eq!((cache.count(), cache.bytes()), (1, model.bytes()));
    // Loaded once: the second is the first.
    assert!(Arc::ptr_eq(model.model(), ready.model().await.model()));
}

#[tokio::test]
async fn what_is_kept_in_memory_does_not_hold_the_store() {
    let ready = ready().await;
    let model = ready.model().await;
    model
        .paths(MeshSize::new(10, 10).unwrap(), PathKind::Forest)
        .await
        .unwrap();
    let lock = std::fs::File::open(ready.directory.path().join("lock")).unwrap();
    lock.try_lock().unwrap_err();
    drop((ready.library, ready.models));
    lock.try_lock().unwrap_err();
    drop(model);
    lock.try_lock().unwrap();
}

#[tokio::test]
async fn tables_are_made_at_their_first_use_and_kept() {
    let ready = ready().await;
    let model = ready.model().await;
    let size = |contours, points| MeshSize::new(contours, points).unwrap();
    let default = model.paths(size(30, 30), PathKind::Forest).await.unwrap();
    assert!(Arc::ptr_eq(&default, model.model().default_paths()));
    let flow = model.paths(size(30, 30), PathKind::Flow).await.unwrap();
    assert!(flow.rows != default.rows);
    assert!(Arc::ptr_eq(
        &flow,
        &model.paths(size(30, 30), PathKind::Flow).await.unwrap()
    ));
    let finer = model.paths(size(40, 50), PathKind::Forest).await.unwrap();
    assert_eq!(finer.size.vertex_count(), 2002);
}

#[tokio::test]
async fn a_mesh_too_fine_for_a_table_is_the_one_that_a_table_would_give() {
    let ready = ready().await;
    let model = ready.model().await;
    let coarse = MeshSize::new(20, 20).unwrap();
    let from_table = model.shrink(coarse, PathKind::Forest, 8.0).await.unwrap();
    let table = model.paths(coarse, PathKind::Forest).await.unwrap();
    assert_eq!(from_table, table.shrink(8.0));
    let finest = MeshSize::new(512, 1024).unwrap();
    assert!(!model.keeps_table_of(finest));
    let shrunk = model.shrink(finest, PathKind::Flow, 8.0).await.unwrap();
    assert_eq!(
        (shrunk.depth_mm, shrunk.positions_in_patient.len()),
        (8.0, 512 * 1024 + 2)
    );
}

#[tokio::test]
async fn a_damaged_forest_is_made_again_when_a_table_needs_it() {
    let ready = ready().await;
    let model = ready.model().await;
    let size = MeshSize::new(10, 12).unwrap();
    let expected = model.paths(size, PathKind::Forest).await.unwrap();
    ready.damage("forest");
    let other = ready.cold();
    let model = other.get(&ready.id, SurfaceName::Whole).await.unwrap();
    assert!(*model.paths(size, PathKind::Forest).await.unwrap() == *expected);
    assert_eq!(ready.library.store().signals().counted(Count::Rebuild), 1);
}

#[tokio::test]
async fn damaged_objects_are_made_again_before_a_model_is_served() {
    let ready = ready().await;
    let first = ready.model().await;
    for (rebuilds, kind) in ["volume", "envelope", "paths"].into_iter().enumerate() {
        ready.damage(kind);
        let cold = ready.cold();
        let model = cold.get(&ready.id, SurfaceName::Whole).await.unwrap();
        assert!(model.model() == first.model());
        assert_eq!(
            ready.library.store().signals().counted(Count::Rebuild),
            rebuilds as u64 + 1,
            "{kind}"
        );
    }
}

/// The file of the whole volume of the only case.
fn whole_file(ready: &Ready) -> Option<std::path::PathBuf> {
    let folder = ready.directory.path().join("objects/whole-volume");
    files_below(&folder).pop()
}

#[tokio::test]
async fn a_lost_whole_volume_comes_from_the_source_and_the_case_is_not_prepared_again() {
    let ready = ready().await;
    let acquired = phantom().volume;
    let whole = async || ready.library.whole_volume(&ready.id).await.unwrap();
    assert!(whole().await.as_ref() == Some(&acquired));
    assert!(ready.model().await.model().volume().voxels().len() < acquired.voxels().len());
    std::fs::remove_file(whole_file(&ready).unwrap()).unwrap();
    assert!(whole().await.as_ref() == Some(&acquired));
    ready.damage("whole-volume");
    assert!(whole().await.as_ref() == Some(&acquired));
    assert_eq!(ready.library.store().signals().counted(Count::Rebuild), 0);
    assert!(whole_file(&ready).is_some(), "it is stored again");
    // The source is not needed as long as the object is there.
    ready.damage("source-volume");
    assert!(whole().await.as_ref() == Some(&acquired));
    ready.damage("whole-volume");
    assert!(whole().await.is_none());
    let case = ready.library.store().case(&ready.id).await.unwrap();
    assert_eq!(case.unwrap().failure.unwrap().name, "source-damaged");
}

#[tokio::test]
async fn a_deleted_case_has_no_model() {
    let ready = ready().await;
    let model = ready.model().await;
    ready.library.store().delete(&ready.id).await.unwrap();
    let gone = ready.models.get(&ready.id, SurfaceName::Whole).await;
    assert!(matches!(gone.map(drop), Err(Error::NoSuchCase)));
    assert_eq!(ready.library.cache().count(), 0);
    let size = MeshSize::new(10, 10).unwrap();
    assert!(matches!(
        model.paths(size, PathKind::Flow).await,
        Err(Error::NoSuchCase)
    ));
}

#[tokio::test]
async fn a_case_deleted_by_another_process_has_no_model_soon_after() {
    let ready = ready().await;
    let cases = application(ready.library.store().clone(), "");
    cases.model(&ready.id).await.unwrap();
    let other = Store::open(ready.directory.path(), Options::default())
        .await
        .unwrap();
    other.delete(&ready.id).await.unwrap();
    cases.pass_time(REMEMBERED_FOR);
    let asked = cases.model(&ready.id).await.map(drop);
    assert!(matches!(asked, Err(Error::NoSuchCase)), "{asked:?}");
    assert_eq!(cases.library.cache().count(), 0);
}

#[tokio::test]
async fn what_was_seen_is_served_for_a_while_without_the_database() {
    let Some(mut postgres) = PostgresServer::start().await else {
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let location = Location {
        database: Some(DatabaseAddress::parse(&postgres.database().await).unwrap()),
        ..directory.path().into()
    };
    let store = Store::open(location, Options::default()).await.unwrap();
    let ready = ready_in(store, directory).await;
    let cases = application(ready.library.store().clone(), "");
    cases.ready(&ready.id).await.unwrap();
    cases.model(&ready.id).await.unwrap();
    postgres.stop();
    // It asks the database, which does not answer.
    cases.pass_time(REMEMBERED_FOR);
    cases.ready(&ready.id).await.unwrap();
    cases.model(&ready.id).await.unwrap();
    cases.pass_time(REMEMBERED_WHILE_AWAY);
    let asked = cases.ready(&ready.id).await.map(drop);
    assert!(
        matches!(&asked, Err(Error::Store(error)) if error.is_away()),
        "{asked:?}"
    );
    let asked = cases.model(&ready.id).await.map(drop);
    assert!(
        matches!(&asked, Err(Error::Store(error)) if error.is_away()),
        "{asked:?}"
    );
}

#[tokio::test]
async fn a_queued_case_has_no_model_yet() {
    let library = Library::of(Store::in_memory(Options::default()).await.unwrap());
    let queued = library
        .submit(upload(&phantom()), Parameters::default())
        .await
        .unwrap();
    let models = Models::new(library);
    let model = models.get(&queued.case.id, SurfaceName::Whole).await;
    assert!(matches!(model.map(drop), Err(Error::NoSuchCase)));
}

#[tokio::test]
async fn the_budget_bounds_what_is_kept() {
    let ready = ready().await;
    let bytes = ready.model().await.bytes();
    let tight = ready.within(bytes - 1);
    let models = Models::new(tight.clone());
    let model = models.get(&ready.id, SurfaceName::Whole).await;
    assert!(model.is_ok());
    assert_eq!((tight.cache().count(), tight.cache().bytes()), (0, 0));
}

#[tokio::test]
async fn all_parts_of_a_case_share_one_budget() {
    let ready = ready().await;
    let answer = |length: usize| async move { Ok::<_, StoreError>(Bytes::from(vec![1; length])) };
    let model_bytes = ready.model().await.bytes();
    let (budget_bytes, length) = (2 * model_bytes, model_bytes as usize / 4 * 3);
    let library = ready.within(budget_bytes);
    let (cache, models) = (library.cache(), Models::new(library.clone()));
    models.get(&ready.id, SurfaceName::Whole).await.unwrap();
    let named = |name: &str| Part::Answer(name.into());
    let first = cache.get_or_make(&ready.id, named("a"), answer(length));
    let first = first.await.unwrap();
    assert_eq!(
        (cache.count(), cache.bytes()),
        (2, model_bytes + length as u64)
    );
    // It is not made again, unlike another name.
    let again = cache.get_or_make(&ready.id, named("a"), answer(1));
    assert!(Arc::ptr_eq(&first, &again.await.unwrap()));
    let second = cache.get_or_make(&ready.id, named("b"), answer(length));
    assert_eq!(second.await.unwrap().len(), length);
    assert!(cache.bytes() <= budget_bytes, "{}", cache.bytes());
    cache.forget(&ready.id);
    assert_eq!(cache.count(), 0);
}
