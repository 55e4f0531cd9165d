//! The series that cases were made of.

use case::series::{AccessionNumber, CaseSeries, PatientDigest, SeriesQuery, SeriesUids, Uid};
use case::{CaseId, CaseState};

use super::Subject;
use crate::tables::series::{cases_of, of_case};
use crate::testing::{claim, new_case, rename};
use crate::{CaseQuery, Store};

fn uid(text: &str) -> Uid {
    Uid::parse(text).unwrap()
}

fn series(number: u32) -> SeriesUids {
    SeriesUids {
        study: uid("1.2.3"),
        series: uid(&format!("1.2.3.{number}")),
    }
}

async fn a_case(store: &Store, contents: &str) -> CaseId {
    let new = new_case(store, contents).await;
    store.insert_case(&new).await.unwrap();
    new.id
}

pub(crate) async fn cases_are_found_by_their_series(subject: &Subject) {
    let store = &subject.store;
    let [first, second] = [a_case(store, "a").await, a_case(store, "b").await];
    let of_first = CaseSeries {
        case: first,
        uids: series(1),
        accession_number: AccessionNumber::parse("A1"),
        patient: None,
    };
    store.index_series(&of_first).await.unwrap();
    let of_second = CaseSeries {
        case: second,
        uids: series(2),
        accession_number: AccessionNumber::parse("A2"),
        patient: None,
    };
    for _ in 0..2 {
        store.index_series(&of_second).await.unwrap();
    }
    assert_eq!(
        of_case(&mut store.connect().await.unwrap(), &second)
            .await
            .unwrap(),
        Some(of_second)
    );
    let found = async |query| {
        let found = cases_of(&mut store.connect().await.unwrap(), &query)
            .await
            .unwrap();
        found
            .into_iter()
            .map(|series| series.case)
            .collect::<Vec<_>>()
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

pub(crate) async fn cases_are_searched_by_what_they_are_and_whose(subject: &Subject) {
    let store = &subject.store;
    let mut cases = Vec::new();
    for (number, label) in ["Left temporal", "100% right", "left FRONTAL"]
        .into_iter()
        .enumerate()
    {
        let case = a_case(store, label).await;
        rename(store, &case, label).await;
        cases.push(store.case(&case).await.unwrap().unwrap());
        subject.pass(60);
        // The third is no DICOM.
        let ids = ["P-1", "P-2"];
        if let Some(id) = ids.get(number) {
            let series = CaseSeries {
                case,
                uids: series(number as u32 + 1),
                accession_number: AccessionNumber::parse("A7").filter(|_| number == 0),
                patient: PatientDigest::of(id),
            };
            store.index_series(&series).await.unwrap();
            assert_eq!(
                of_case(&mut store.connect().await.unwrap(), &case)
                    .await
                    .unwrap(),
                Some(series)
            );
        }
    }
    let running = claim(store).await.unwrap();
    let running = CaseId::parse(&running.key).unwrap();
    let [first, second, third] = [0, 1, 2].map(|number: usize| cases[number].id);
    assert_eq!(running, first, "the oldest is prepared first");
    let found = async |query: CaseQuery| {
        let page = store.cases(&query, None, 9).await.unwrap();
        assert_eq!(page.next, None);
        page.cases.iter().map(|case| case.id).collect::<Vec<_>>()
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
    assert_eq!(page.cases[0].id, second);
    let page = store
        .cases(&study("1.2.3"), page.next.as_ref(), 1)
        .await
        .unwrap();
    assert_eq!((page.cases[0].id, page.next), (first, None));
    store.delete_rows(&second).await.unwrap();
    assert_eq!(found(patient("P-2")).await, []);
}
