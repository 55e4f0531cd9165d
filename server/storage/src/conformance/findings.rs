//! Checks of the findings of cases.

use std::time::Duration;

use super::layers::ready_case;
use super::{Subject, insert, new_case};
use crate::rows::Referred;
use crate::{FindingsVersion, Replaced, Store, StoreError, upkeep};
use case::CaseId;

async fn put(store: &Store, id: &CaseId, version: FindingsVersion, document: &str) -> Replaced {
    let replaced = store.replace_findings(id, version, document.to_owned());
    replaced.await.unwrap()
}

async fn document(store: &Store, id: &CaseId) -> String {
    store.findings(id).await.unwrap().document
}

pub(crate) async fn findings_are_replaced_by_whoever_knows_them(subject: &Subject) {
    let store = &subject.store;
    let id = insert(store, "a").await.id;
    let none = store.findings(&id).await.unwrap();
    assert_eq!(none.document, "[]");
    let Replaced::Done(first) = put(store, &id, none.version, "[1]").await else {
        panic!("the first findings")
    };
    assert_eq!(store.findings(&id).await.unwrap(), first);
    // Two readers know the first ones: the second of them changes nothing.
    let second = put(store, &id, first.version, "[2]").await;
    assert!(matches!(second, Replaced::Done(_)));
    let late = put(store, &id, first.version, "[3]").await;
    assert_eq!(late, Replaced::Changed);
    assert_eq!(document(store, &id).await, "[2]");
    let other = insert(store, "b").await.id;
    assert_eq!(document(store, &other).await, "[]");
}

pub(crate) async fn findings_go_with_their_case(subject: &Subject) {
    let store = &subject.store;
    let id = insert(store, "a").await.id;
    let none = store.findings(&id).await.unwrap().version;
    put(store, &id, none, "[1]").await;
    assert!(store.delete_rows(&id).await.unwrap());
    assert_eq!(put(store, &id, none, "[1]").await, Replaced::NoSuchCase);
    assert_eq!(insert(store, "a").await.id, id);
    assert_eq!(document(store, &id).await, "[]");
}

pub(crate) async fn a_version_begins_with_the_findings_of_its_case(subject: &Subject) {
    let store = &subject.store;
    let id = insert(store, "a").await.id;
    let none = store.findings(&id).await.unwrap().version;
    put(store, &id, none, "[1]").await;
    let mut version = new_case(store, "b").await;
    version.previous = Some(id);
    let inserted = store.insert_case(&version).await.unwrap();
    assert!(matches!(inserted, Referred::Done(_)));
    let inherited = store.findings(&version.id).await.unwrap();
    assert_eq!(inherited.document, "[1]");
    put(store, &version.id, inherited.version, "[1,2]").await;
    assert_eq!(document(store, &id).await, "[1]");
}

pub(crate) async fn a_change_of_findings_makes_a_case_young_again(subject: &Subject) {
    let store = &subject.store;
    let id = ready_case(store, "a").await.id;
    let age = Duration::from_secs(60);
    subject.pass(61);
    assert_eq!(upkeep::expired(store, age, 10).await.unwrap(), [id]);
    let none = store.findings(&id).await.unwrap().version;
    put(store, &id, none, "[1]").await;
    assert_eq!(upkeep::expired(store, age, 10).await.unwrap(), []);
}

pub(crate) async fn damaged_findings_are_never_shown(subject: &Subject) {
    let store = &subject.store;
    let id = insert(store, "a").await.id;
    let none = store.findings(&id).await.unwrap().version;
    put(store, &id, none, "[1]").await;
    store.damage_findings(&id).await;
    let read = store.findings(&id).await;
    assert!(matches!(read, Err(StoreError::DamagedFindings(damaged)) if damaged == id));
    let written = store.replace_findings(&id, none, "[2]".to_owned()).await;
    assert!(matches!(written, Err(StoreError::DamagedFindings(_))));
    let mut found = Vec::new();
    let inspected = upkeep::inspect(store, &mut |finding| found.push(finding)).await;
    inspected.unwrap();
    assert!(
        found.contains(&upkeep::Defect::DamagedFindings(id)),
        "{found:?}"
    );
}
