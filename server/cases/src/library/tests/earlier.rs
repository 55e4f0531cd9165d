//! Folders of earlier versions.

use std::sync::Arc;

use case::{CaseId, CaseState, ObjectKind, Parameters};
use storage::testing::{assert_nothing_left_over, facts};
use storage::{NewMask, Version};
use tempfile::TempDir;

use super::{GRACE, expected, load, open, ready};
use crate::jobs::Workers;
use crate::testing::{settled, settled_state};

/// What the first version of the program left behind: its schema, and a ready case in its rows, with its source stored.
async fn first_versions_folder(directory: &TempDir) -> CaseId {
    let fake = Arc::default();
    let (library, id) = ready(directory, &fake).await;
    let facts = serde_json::to_value(facts()).unwrap();
    let mut facts = facts.as_object().unwrap().clone();
    for later in ["quality", "native_patient_from_voxel", "envelope_sphere"] {
        facts.remove(later);
    }
    let names = library.store().rows().objects(&id).await.unwrap();
    drop(library);
    for file in ["rows.sqlite", "rows.sqlite-wal", "rows.sqlite-shm"] {
        let _gone = std::fs::remove_file(directory.path().join(file));
    }
    let options = sqlx::sqlite::SqliteConnectOptions::new()
        .filename(directory.path().join("rows.sqlite"))
        .create_if_missing(true);
    let pool = sqlx::SqlitePool::connect_with(options).await.unwrap();
    let mut migrator = sqlx::migrate!("../storage/migrations/sqlite");
    migrator.migrations.to_mut().truncate(1);
    migrator.run(&pool).await.unwrap();
    sqlx::query(
        "INSERT INTO cases (id, closing_radius_mm, name, state, facts, created_at)
         VALUES (?, 7.3, 'old', 'ready', ?, 5)",
    )
    .bind(id.to_string())
    .bind(serde_json::Value::from(facts).to_string())
    .execute(&pool)
    .await
    .unwrap();
    // It kept no mask.
    for name in names.iter().filter(|name| name.kind != ObjectKind::Mask) {
        sqlx::query("INSERT INTO case_objects (case_id, kind, digest) VALUES (?, ?, ?)")
            .bind(id.to_string())
            .bind(name.kind.name())
            .bind(name.digest.to_string())
            .execute(&pool)
            .await
            .unwrap();
    }
    pool.close().await;
    id
}

#[tokio::test]
async fn a_folder_of_the_first_version_is_taken_over() {
    let directory = tempfile::tempdir().unwrap();
    let id = first_versions_folder(&directory).await;
    let fake = Arc::default();
    let library = open(&directory, &fake).await;
    let case = library.store().case(&id).await.unwrap().unwrap();
    let expected_parameters = Parameters {
        closing_radius_mm: 7.3,
        name: Some("old".to_owned()),
        ..Parameters::default()
    };
    assert_eq!((case.state, case.facts), (CaseState::Queued, None));
    assert_eq!(case.parameters, expected_parameters);
    assert_eq!((case.previous, case.next), (None, Vec::new()));
    // What the first version did not keep and did not tell is made from the source.
    let workers = Workers::start(library.clone(), 1);
    let case = settled(&library, &id).await.unwrap();
    assert_eq!((case.state, case.facts), (CaseState::Ready, Some(facts())));
    assert_eq!(load(&library, &id).await, Some(expected("volume")));
    assert_eq!(fake.run_count(), 1);
    assert_eq!(library.store().counters().bad_objects, 0);
    // The case can have versions, which outlive it.
    let version = library
        .store()
        .submit_version(Version {
            of: id,
            mask: NewMask::None,
            parameters: Parameters {
                offset_mm: 2.0,
                ..Parameters::default()
            },
        })
        .await
        .unwrap()
        .unwrap();
    assert!(version.created);
    assert_eq!(version.case.previous, Some(id));
    assert_eq!(version.case.parameters.name.as_deref(), Some("old"));
    let case = library.store().case(&id).await.unwrap().unwrap();
    assert_eq!(case.next, [version.case.id]);
    library.store().delete(&id).await.unwrap();
    assert_eq!(
        settled_state(&library, &version.case.id).await,
        Some(CaseState::Ready)
    );
    workers.shut_down(GRACE).await;
    assert_nothing_left_over(library.store(), directory.path()).await;
}
