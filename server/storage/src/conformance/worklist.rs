//! Checks of the list of cases: what it states, its filters and its orders.

use super::layers::{insert_layer, ready_case};
use super::{Subject, derived, insert};
use crate::testing::{claim, facts, rename};
use crate::{CaseQuery, Has, Listed, Order, Status, Store, WrittenReading};
use case::{CaseChange, CaseFacts, CaseId, CaseState, QualityState};

/// A reading in which nothing is left.
const EMPTY: &str = r#"{"conclusion":"","findings":[]}"#;

async fn listed(store: &Store, query: CaseQuery) -> Vec<Listed> {
    store.cases(&query, None, 9).await.unwrap().cases
}

async fn found(store: &Store, query: CaseQuery) -> Vec<CaseId> {
    let listed = listed(store, query).await;
    listed.iter().map(|listed| listed.case.id).collect()
}

async fn write(store: &Store, id: &CaseId, document: &str) {
    let before = store.findings(id).await.unwrap().version;
    let replaced = store.replace_findings(id, before, document.to_owned());
    replaced.await.unwrap();
}

pub(crate) async fn a_list_states_what_is_to_be_done_and_is_sorted_by_it(subject: &Subject) {
    let store = &subject.store;
    let mut ids = Vec::new();
    for contents in ["first", "second", "third"] {
        ids.push(ready_case(store, contents).await.id);
        subject.pass(60);
    }
    let waits = insert(store, "waits").await.id;
    assert!(
        claim(store).await.is_some(),
        "one that is being prepared waits no less"
    );
    let [first, second, third] = [0, 1, 2].map(|number: usize| ids[number]);
    for (id, label) in [(first, "case 10"), (second, "Case 9"), (third, "Head")] {
        rename(store, &id, label).await;
    }
    write(
        store,
        &first,
        r#"[{"author": "Zoe"}, {"author": "Ana"}, {"author": "Ana", "is_dismissed": true}, {"kind": "acpc"}, {}]"#,
    )
    .await;
    write(store, &second, "[]").await;
    insert_layer(store, &first, "a layer").await;
    store.note_places((&first).into(), 1).await.unwrap();
    store.note_places((&third).into(), 4).await.unwrap();

    let all = listed(store, CaseQuery::default()).await;
    let stated: Vec<_> = all
        .iter()
        .map(|one| (one.case.id, one.status, one.places, one.findings))
        .collect();
    assert_eq!(
        stated,
        [
            (waits, Status::Preparing, None, 0),
            (third, Status::New, Some(4), 0),
            (second, Status::New, None, 0),
            (first, Status::Begun, Some(1), 3),
        ]
    );
    assert_eq!(all[3].readers, ["Ana", "Zoe"]);
    assert_eq!(all[3].layers, ["pet"]);

    let sorted = async |order| {
        let query = CaseQuery {
            order,
            ..CaseQuery::default()
        };
        found(store, query).await
    };
    assert_eq!(sorted(Order::Oldest).await, [first, second, third, waits]);
    assert_eq!(sorted(Order::Label).await, [second, first, third, waits]);
    assert_eq!(sorted(Order::Places).await, [third, first, waits, second]);
    assert_eq!(sorted(Order::Findings).await, [first, waits, third, second]);

    let of = async |status| {
        let query = CaseQuery {
            status: Some(status),
            ..CaseQuery::default()
        };
        found(store, query).await
    };
    assert_eq!(of(Status::Begun).await, [first]);
    assert_eq!(of(Status::New).await, [third, second]);
    assert_eq!(of(Status::Preparing).await, [waits]);
    assert_eq!(of(Status::Failed).await, []);
    // A case is signed once every reader has signed who has begun.
    let begun = async |reader: &str| {
        let begun = store.write_reading(&first, reader, None, "{}".to_owned());
        match begun.await.unwrap() {
            WrittenReading::Done(reading) => reading,
            other => panic!("{other:?}"),
        }
    };
    let readings = [begun("ana").await, begun("ben").await];
    for (reading, (open, signed)) in readings
        .iter()
        .zip([(vec![first], vec![]), (vec![], vec![first])])
    {
        store.sign_reading(&first, reading).await.unwrap();
        assert_eq!(of(Status::Begun).await, open);
        assert_eq!(of(Status::Signed).await, signed);
    }
    // What is left of a reading that was emptied is as if it had not been begun.
    for (case, status) in [(first, Status::Signed), (second, Status::New)] {
        let mut known = None;
        for (document, expected) in [("{}", Status::Begun), (EMPTY, status)] {
            let written = store.write_reading(&case, "cleo", known.as_ref(), document.to_owned());
            let WrittenReading::Done(reading) = written.await.unwrap() else {
                panic!("it is written")
            };
            assert!(of(expected).await.contains(&case), "{document}");
            known = Some(reading);
        }
    }

    let has = async |has| {
        let query = CaseQuery {
            has: Some(has),
            ..CaseQuery::default()
        };
        found(store, query).await
    };
    assert_eq!(has(Has::Places).await, [third, first]);
    assert_eq!(has(Has::Findings).await, [first]);
    assert_eq!(has(Has::Layers).await, [first]);
    let of_layer = CaseQuery {
        layer: Some("PE".to_owned()),
        ..CaseQuery::default()
    };
    assert_eq!(found(store, of_layer).await, [first]);
    let of_reader = CaseQuery {
        reader: Some("zO".to_owned()),
        ..CaseQuery::default()
    };
    assert_eq!(found(store, of_reader).await, [first]);

    let text = async |text: &str| {
        let query = CaseQuery {
            text: Some(text.to_owned()),
            ..CaseQuery::default()
        };
        found(store, query).await
    };
    assert!(text("cASE").await.contains(&second));
    assert_eq!(text("zO").await, [first], "who has read it");
    assert_eq!(text(&waits.to_string()[..8]).await, [waits]);
    assert_eq!(text("%").await, [], "no pattern");
}

pub(crate) async fn a_list_is_paged_by_position_and_leaves_the_trash_out(subject: &Subject) {
    let store = &subject.store;
    let mut ids = Vec::new();
    for contents in ["a", "b", "c", "d", "e"] {
        ids.push(insert(store, contents).await.id);
        subject.pass(60);
    }
    let trashed = CaseChange {
        trashed: Some(true),
        ..CaseChange::default()
    };
    assert!(store.change_case(&ids[2], &trashed).await.unwrap());
    assert!(store.case(&ids[2]).await.unwrap().unwrap().trashed);
    let page = async |order, skip| {
        let query = CaseQuery {
            trashed: Some(false),
            order,
            skip: Some(skip),
            ..CaseQuery::default()
        };
        let page = store.cases(&query, None, 2).await.unwrap();
        let ids: Vec<_> = page.cases.iter().map(|listed| listed.case.id).collect();
        (ids, page.total)
    };
    let oldest = Order::Oldest;
    assert_eq!(page(oldest, 0).await, (vec![ids[0], ids[1]], Some(4)));
    assert_eq!(page(oldest, 2).await, (vec![ids[3], ids[4]], Some(4)));
    assert_eq!(page(oldest, 9).await, (vec![], Some(4)));
    assert_eq!(page(Order::Newest, 3).await, (vec![ids[0]], Some(4)));
    let in_trash = CaseQuery {
        trashed: Some(true),
        ..CaseQuery::default()
    };
    assert_eq!(found(store, in_trash).await, [ids[2]]);
    let page = store.cases(&CaseQuery::default(), None, 9).await.unwrap();
    assert_eq!((page.cases.len(), page.total), (5, None), "upkeep sees all");
}

/// The facts of a case with a rating.
fn rated(state: &str) -> CaseFacts {
    let numbers = serde_json::json!({
        "brain_ml": 1400.0, "closing_added": 0.1, "largest_component": 1.0, "extents_mm": [140.0, 170.0, 130.0],
        "cut_area_cm2": [0, 0, 0, 0, 0, 0],
    });
    let quality = serde_json::json!({"state": state, "method": "supplied", "numbers": numbers, "reasons": []});
    CaseFacts {
        quality: Some(serde_json::from_value(quality).unwrap()),
        ..facts()
    }
}

pub(crate) async fn cases_are_found_by_the_rating_of_their_masks(subject: &Subject) {
    let store = &subject.store;
    let mut ids = Vec::new();
    for state in ["ok", "review", "failed"] {
        ids.push(insert(store, state).await.id);
        let leased = claim(store).await.unwrap();
        let derived = derived(store, state).await;
        let facts = rated(state);
        let made = store.make_case_ready(&leased, &derived, &facts, &[]);
        made.await.unwrap();
        subject.pass(60);
    }
    insert(store, "waits").await;
    let of = async |mask| {
        let query = CaseQuery {
            mask: Some(mask),
            ..CaseQuery::default()
        };
        found(store, query).await
    };
    assert_eq!(of(QualityState::Ok).await, [ids[0]]);
    assert_eq!(of(QualityState::Review).await, [ids[1]]);
    assert_eq!(of(QualityState::Failed).await, [ids[2]]);
    let is_ready = CaseState::Ready;
    assert!(store.prepare_again(&ids[2], is_ready).await.unwrap());
    assert_eq!(of(QualityState::Failed).await, [], "it is not ready");
}
