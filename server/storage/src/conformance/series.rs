//! The series that cases were made of.

use case::series::{AccessionNumber, CaseSeries, PatientDigest, SeriesQuery, SeriesUids, Uid};
use case::{CaseId, CaseState};

use super::Subject;
use crate::rows::NewCase;
use crate::tables::series::{cases_of, of_case};
use crate::testing::{claim, new_case, rename};
use crate::{CaseQuery, Store, args};

fn uid(text: &str) -> Uid {
    Uid::parse(text).unwrap()
}

fn series(number: u32) -> SeriesUids {
    SeriesUids {
        study: uid("1.2.3"),
        series: uid(&format!("1.2.3.{number}")),
    }
}

async fn a_case(store: &Store, contents: &str, series: Option<CaseSeries>) -> NewCase {
    let new = NewCase {
        series,
        ..new_case(store, contents).await
    };
    store.insert_case(&new).await.unwrap();
    new
}

async fn series_of(store: &Store, case: &CaseId) -> Option<CaseSeries> {
    let mut connection = store.connect().await.unwrap();
    of_case(&mut connection, case).await.unwrap()
}

pub(crate) async fn cases_are_found_by_their_series(subject: &Subject) {
    let store = &subject.store;
    let of_first = CaseSeries {
        uids: series(1),
        accession_number: AccessionNumber::parse("A1"),
        patient: None,
    };
    let of_second = CaseSeries {
        uids: series(2),
        accession_number: AccessionNumber::parse("A2"),
        patient: None,
    };
    let first = a_case(store, "a", Some(of_first)).await.id;
    let second = a_case(store, "b", Some(of_second.clone())).await.id;
    assert_eq!(series_of(store, &second).await, Some(of_second));
    let found = async |query| {
        let found = cases_of(&mut store.connect().await.unwrap(), &query)
            .await
            .unwrap();
        found.into_iter().map(|(case, _)| case).collect::<Vec<_>>()
    };
    let mut both = found(SeriesQuery::Study(uid("1.2.3"), None)).await;
    both.sort_by_key(|id| *id == second);
    assert_eq!(both, [first, second]);
    let one = SeriesQuery::Study(uid("1.2.3"), Some(uid("1.2.3.1")));
    assert_eq!(found(one).await, [first]);
    let number = |text| SeriesQuery::AccessionNumber(AccessionNumber::parse(text).unwrap());
    assert_eq!(found(number("A1")).await, [first]);
    assert_eq!(found(number("A2")).await, [second]);
    assert_eq!(found(number("A")).await, []);
    store.delete_rows(&second).await.unwrap();
    assert_eq!(found(number("A2")).await, []);
}

pub(crate) async fn a_case_and_its_series_are_written_together_and_what_is_lost_of_it_comes_again(
    subject: &Subject,
) {
    let store = &subject.store;
    let one = Some(CaseSeries {
        uids: series(1),
        accession_number: AccessionNumber::parse("A1"),
        patient: PatientDigest::of("P-1"),
    });
    let another = CaseSeries {
        uids: series(2),
        ..one.clone().unwrap()
    };
    let case = a_case(store, "a", one.clone()).await;
    assert_eq!(series_of(store, &case.id).await, one);
    a_case(store, "a", Some(another)).await;
    assert_eq!(series_of(store, &case.id).await, one, "it stays");
    let version = NewCase {
        previous: Some(case.id),
        images: None,
        ..new_case(store, "version").await
    };
    store.insert_case(&version).await.unwrap();
    assert_eq!(series_of(store, &version.id).await, one);

    lose_series(store).await;
    assert_eq!(series_of(store, &case.id).await, None);
    for known in [&case, &version] {
        let again = store.uploaded_again(known).await.unwrap().unwrap();
        assert!(!again.created);
        assert_eq!(series_of(store, &known.id).await, one);
    }
    lose_series(store).await;
    a_case(store, "a", one.clone()).await;
    assert_eq!(series_of(store, &case.id).await, one);
}

/// Empties the index.
async fn lose_series(store: &Store) {
    let (mut transaction, _) = store.write().await.unwrap();
    let deleted = transaction.execute("DELETE FROM case_series", args![]);
    deleted.await.unwrap();
    transaction.commit().await.unwrap();
}

pub(crate) async fn cases_are_searched_by_what_they_are_and_whose(subject: &Subject) {
    let store = &subject.store;
    let mut cases = Vec::new();
    for (number, label) in ["Left temporal", "100% right", "left FRONTAL"]
        .into_iter()
        .enumerate()
    {
        // The third is no DICOM.
        let series = ["P-1", "P-2"].get(number).map(|id| CaseSeries {
            uids: series(number as u32 + 1),
            accession_number: AccessionNumber::parse("A7").filter(|_| number == 0),
            patient: PatientDigest::of(id),
        });
        let case = a_case(store, label, series.clone()).await.id;
        assert_eq!(series_of(store, &case).await, series);
        rename(store, &case, label).await;
        cases.push(store.case(&case).await.unwrap().unwrap());
        subject.pass(60);
    }
    let running = claim(store).await.unwrap();
    let running = CaseId::parse(&running.key).unwrap();
    let [first, second, third] = [0, 1, 2].map(|number: usize| cases[number].id);
    assert_eq!(running, first, "the oldest is prepared first");
    let found = async |query: CaseQuery| {
        let page = store.cases(&query, None, 9).await.unwrap();
        assert_eq!(page.next, None);
        page.cases
            .iter()
            .map(|listed| listed.case.id)
            .collect::<Vec<_>>()
    };
    let every = CaseQuery::default;
    let label = |text: &str| CaseQuery {
        label: Some(text.to_owned()),
        ..every()
    };
    let state = |state| CaseQuery {
        state: Some(state),
        ..every()
    };
    let patient = |id| CaseQuery {
        patient: PatientDigest::of(id),
        ..every()
    };
    let study = |text| CaseQuery {
        study: Some(uid(text)),
        ..every()
    };
    let of_series = |number| CaseQuery {
        series: Some(series(number).series),
        ..every()
    };
    let number = |text| CaseQuery {
        accession_number: AccessionNumber::parse(text),
        ..every()
    };
    assert_eq!(found(every()).await, [third, second, first]);
    assert_eq!(found(label("LEFT")).await, [third, first]);
    assert_eq!(found(label("%")).await, [second], "no pattern");
    assert_eq!(found(state(CaseState::Preparing)).await, [first]);
    assert_eq!(found(state(CaseState::Queued)).await, [third, second]);
    assert_eq!(found(state(CaseState::Ready)).await, []);
    assert_eq!(found(patient("P-2")).await, [second]);
    assert_eq!(found(patient("P-")).await, []);
    assert_eq!(found(study("1.2.3")).await, [second, first]);
    assert_eq!(found(study("1.2")).await, []);
    assert_eq!(found(of_series(2)).await, [second]);
    assert_eq!(found(number("A7")).await, [first]);
    let since = |at: usize| CaseQuery {
        since: Some(cases[at].created_at),
        ..every()
    };
    let until = |at: usize| CaseQuery {
        until: Some(cases[at].created_at),
        ..every()
    };
    assert_eq!(found(since(1)).await, [third, second]);
    assert_eq!(found(until(1)).await, [first]);
    // Each condition must hold.
    let both = |id| CaseQuery {
        patient: PatientDigest::of(id),
        ..number("A7")
    };
    assert_eq!(found(both("P-1")).await, [first]);
    assert_eq!(found(both("P-2")).await, []);
    let all = CaseQuery {
        state: Some(CaseState::Queued),
        until: Some(cases[2].created_at),
        ..study("1.2.3")
    };
    assert_eq!(found(all).await, [second]);
    // Pages are those of what is found.
    let page = store.cases(&study("1.2.3"), None, 1).await.unwrap();
    assert_eq!(page.cases[0].case.id, second);
    let page = store
        .cases(&study("1.2.3"), page.next.as_ref(), 1)
        .await
        .unwrap();
    assert_eq!((page.cases[0].case.id, page.next), (first, None));
    store.delete_rows(&second).await.unwrap();
    assert_eq!(found(patient("P-2")).await, []);
}
