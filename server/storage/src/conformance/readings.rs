//! Checks of the readings of cases.

use super::{Subject, insert};
use crate::{Store, StoreError, StoredReading, WrittenReading, upkeep};
use case::CaseId;

const ANA: &str = "proxy:ana";

async fn write(
    store: &Store,
    id: &CaseId,
    reader: &str,
    known: Option<&StoredReading>,
    document: &str,
) -> WrittenReading {
    let written = store.write_reading(id, reader, known, document.to_owned());
    written.await.unwrap()
}

fn done(written: WrittenReading) -> StoredReading {
    match written {
        WrittenReading::Done(stored) => stored,
        other => panic!("{other:?}"),
    }
}

async fn documents(store: &Store, id: &CaseId) -> Vec<(String, u32, String, bool)> {
    let mut documents = Vec::new();
    for state in store.readings(id).await.unwrap() {
        let stored = store.reading(id, &state.reader, state.version).await;
        let stored = stored.unwrap().unwrap();
        assert_eq!(stored.state, state);
        let is_signed = state.signed_at.is_some();
        documents.push((state.reader, state.version, stored.document, is_signed));
    }
    documents
}

pub(crate) async fn a_reading_is_changed_until_it_is_signed_and_corrected_by_its_next_version(
    subject: &Subject,
) {
    let store = &subject.store;
    let id = insert(store, "a").await.id;
    assert_eq!(store.readings(&id).await.unwrap(), []);
    let first = done(write(store, &id, ANA, None, "1").await);
    // The same reader on two screens: the second of them changes nothing.
    let late = write(store, &id, ANA, None, "0").await;
    assert_eq!(late, WrittenReading::Changed);
    subject.pass(1);
    let second = done(write(store, &id, ANA, Some(&first), "2").await);
    let late = store.sign_reading(&id, &first).await.unwrap();
    assert_eq!(late, WrittenReading::Changed);
    let signed = done(store.sign_reading(&id, &second).await.unwrap());
    assert_eq!((signed.state.version, &*signed.document), (1, "2"));
    let late = write(store, &id, ANA, Some(&second), "3").await;
    assert_eq!(late, WrittenReading::Changed);
    let corrected = done(write(store, &id, ANA, Some(&signed), "3").await);
    assert_eq!(
        (corrected.state.version, corrected.state.signed_at),
        (2, None)
    );
    let corrected = done(write(store, &id, ANA, Some(&corrected), "4").await);
    done(store.sign_reading(&id, &corrected).await.unwrap());
    let expected = [
        (ANA.to_owned(), 1, "2".to_owned(), true),
        (ANA.to_owned(), 2, "4".to_owned(), true),
    ];
    assert_eq!(documents(store, &id).await, expected);
}

pub(crate) async fn readings_belong_to_their_readers_and_go_with_their_case(subject: &Subject) {
    let store = &subject.store;
    let id = insert(store, "a").await.id;
    let other = insert(store, "b").await.id;
    let of_ana = done(write(store, &id, ANA, None, "ana").await);
    done(write(store, &id, "ben", None, "ben").await);
    done(store.sign_reading(&id, &of_ana).await.unwrap());
    let expected = [
        ("ben".to_owned(), 1, "ben".to_owned(), false),
        (ANA.to_owned(), 1, "ana".to_owned(), true),
    ];
    assert_eq!(documents(store, &id).await, expected);
    assert_eq!(store.readings(&other).await.unwrap(), []);
    assert!(store.delete_rows(&id).await.unwrap());
    let late = write(store, &id, ANA, None, "late").await;
    assert_eq!(late, WrittenReading::NoSuchCase);
    assert_eq!(insert(store, "a").await.id, id);
    assert_eq!(store.readings(&id).await.unwrap(), []);
}

pub(crate) async fn a_damaged_reading_is_never_shown(subject: &Subject) {
    let store = &subject.store;
    let id = insert(store, "a").await.id;
    let written = done(write(store, &id, ANA, None, "1").await);
    store.damage_readings(&id).await;
    let read = store.reading(&id, ANA, 1).await;
    assert!(matches!(read, Err(StoreError::DamagedReading(damaged)) if damaged == id));
    let signed = store.sign_reading(&id, &written).await;
    assert!(matches!(signed, Err(StoreError::DamagedReading(_))));
    let mut found = Vec::new();
    let inspected = upkeep::inspect(store, &mut |defect| found.push(defect)).await;
    inspected.unwrap();
    assert!(
        found.contains(&upkeep::Defect::DamagedReading(id)),
        "{found:?}"
    );
}
