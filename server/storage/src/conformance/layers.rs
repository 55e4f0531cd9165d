//! Checks of the rows of layers.

use std::time::Duration;

use case::{CaseId, CaseState, Layer, LayerId, LayerKind, LayerParameters, ObjectKind};

use super::{LEASE, RowsSubject, derived, insert, removed};
use crate::ObjectName;
use crate::rows::{
    CaseRows, ChangedLayer, Inserted, InsertedLayer, LayerChange, LayerClaim, LayerName,
    LeaseTerms, NewCase, NewLayer, Pinned, Published, Release,
};
use crate::testing::{claim, facts, failure, layer_facts, name, new_case, pinned};

/// A case that is ready.
async fn ready_case(rows: &dyn CaseRows, contents: &str) -> NewCase {
    let new = insert(rows, contents).await;
    let leased = claim(rows).await.unwrap();
    let derived = derived(rows, contents).await;
    rows.publish(&leased, &derived, &facts()).await.unwrap();
    new
}

/// A layer of the volume `contents`, whose source is pinned.
async fn new_layer(rows: &dyn CaseRows, case: &CaseId, contents: &str) -> NewLayer {
    let source = name(ObjectKind::SourceLayer, contents);
    let parameters = LayerParameters {
        kind: LayerKind::Pet,
        unit: "SUV".to_owned(),
        ..LayerParameters::default()
    };
    NewLayer {
        case: *case,
        id: LayerId::of(&source.digest, None, &parameters),
        name: LayerName::Usual("pet".to_owned()),
        parameters,
        sources: pinned(rows, &[source]).await,
        most: 20,
        queue_limit: 100,
    }
}

async fn insert_layer(rows: &dyn CaseRows, case: &CaseId, contents: &str) -> NewLayer {
    let new = new_layer(rows, case, contents).await;
    let inserted = rows.insert_layer(&new).await.unwrap();
    assert_eq!(inserted, InsertedLayer::Created);
    new
}

async fn claim_layer(rows: &dyn CaseRows) -> Option<LayerClaim> {
    let terms = LeaseTerms {
        lease: LEASE,
        max_attempts: 3,
    };
    rows.claim_layer(&terms).await.unwrap()
}

async fn layer(rows: &dyn CaseRows, new: &NewLayer) -> Option<Layer> {
    let layers = rows.layers(&new.case).await.unwrap();
    layers.into_iter().find(|layer| layer.id == new.id)
}

async fn names(rows: &dyn CaseRows, case: &CaseId) -> Vec<String> {
    let layers = rows.layers(case).await.unwrap();
    layers.into_iter().map(|layer| layer.name).collect()
}

async fn publish(rows: &dyn CaseRows, leased: &LayerClaim, contents: &str) -> ObjectName {
    let object = name(ObjectKind::Layer, contents);
    let derived = pinned(rows, &[object]).await;
    let published = rows.publish_layer(leased, &derived, &layer_facts()).await;
    assert_eq!(published.unwrap(), Published::Done);
    object
}

pub async fn a_layer_is_inserted_once_and_as_many_as_may(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = insert(rows, "a").await.id;
    let new = insert_layer(rows, &case, "l").await;
    assert_eq!(
        rows.insert_layer(&new).await.unwrap(),
        InsertedLayer::Exists
    );
    let found = layer(rows, &new).await.unwrap();
    assert_eq!((found.case, found.id), (case, new.id));
    assert_eq!(
        (found.name.as_str(), found.state),
        ("pet", CaseState::Queued)
    );
    assert_eq!(found.parameters, new.parameters);
    assert_eq!((found.failure, found.facts), (None, None));
    let objects = rows.layer_objects(&case, &new.id).await.unwrap();
    assert_eq!(objects, new.sources.names);

    let mut second = new_layer(rows, &case, "m").await;
    second.most = 1;
    assert_eq!(
        rows.insert_layer(&second).await.unwrap(),
        InsertedLayer::TooMany
    );
    second.most = 2;
    second.queue_limit = 1;
    assert_eq!(
        rows.insert_layer(&second).await.unwrap(),
        InsertedLayer::QueueFull
    );
    second.queue_limit = 2;
    second.name = LayerName::Given("pet".to_owned());
    assert_eq!(
        rows.insert_layer(&second).await.unwrap(),
        InsertedLayer::NameTaken
    );
    second.name = LayerName::Usual("pet".to_owned());
    second.sources.holder = "nobody".to_owned();
    assert_eq!(
        rows.insert_layer(&second).await.unwrap(),
        InsertedLayer::PinLost
    );
    assert_eq!(names(rows, &case).await, ["pet"]);

    let nowhere = CaseId::parse(&"0".repeat(32)).unwrap();
    let lost = new_layer(rows, &nowhere, "m").await;
    assert_eq!(
        rows.insert_layer(&lost).await.unwrap(),
        InsertedLayer::NoCase
    );
}

pub async fn layers_are_named_and_ordered(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = insert(rows, "a").await.id;
    let mut ids = Vec::new();
    for contents in ["l", "m", "n"] {
        ids.push(insert_layer(rows, &case, contents).await.id);
        subject.pass(1);
    }
    assert_eq!(names(rows, &case).await, ["pet", "pet 2", "pet 3"]);
    let change = async |id: &LayerId, name: Option<&str>, place| {
        let name = name.map(str::to_owned);
        let change = LayerChange { name, place };
        rows.change_layer(&case, id, &change).await.unwrap()
    };
    let taken = change(&ids[2], Some("pet"), Some(0)).await;
    assert_eq!(taken, ChangedLayer::NameTaken);
    let moved = change(&ids[2], Some("first"), Some(0)).await;
    assert_eq!(moved, ChangedLayer::Done);
    assert_eq!(names(rows, &case).await, ["first", "pet", "pet 2"]);
    let moved = change(&ids[0], None, Some(99)).await;
    assert_eq!(moved, ChangedLayer::Done);
    assert_eq!(names(rows, &case).await, ["first", "pet 2", "pet"]);
    let same = change(&ids[0], Some("pet"), None).await;
    assert_eq!(same, ChangedLayer::Done);
    let stranger = LayerId::parse(&"0".repeat(32)).unwrap();
    let none = change(&stranger, None, Some(0)).await;
    assert_eq!(none, ChangedLayer::NoLayer);
}

pub async fn a_layer_is_leased_once_its_case_is_ready(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = insert(rows, "a").await.id;
    let new = insert_layer(rows, &case, "l").await;
    assert_eq!(claim_layer(rows).await, None);
    let leased = claim(rows).await.unwrap();
    let derived = derived(rows, "a").await;
    rows.publish(&leased, &derived, &facts()).await.unwrap();

    let first = claim_layer(rows).await.unwrap();
    assert_eq!((first.layer.case, first.layer.id), (case, new.id));
    assert_eq!(first.layer.state, CaseState::Preparing);
    assert_eq!(claim_layer(rows).await, None);
    subject.pass(29);
    assert!(rows.renew_layer(&first, LEASE).await.unwrap());
    subject.pass(29);
    assert_eq!(claim_layer(rows).await, None);
    subject.pass(1);
    let second = claim_layer(rows).await.unwrap();
    assert!(second.fence > first.fence);

    let release = Release {
        after: Duration::from_secs(5),
        counts: false,
    };
    assert!(!rows.renew_layer(&first, LEASE).await.unwrap());
    assert!(!rows.release_layer(&first, release).await.unwrap());
    assert!(!rows.fail_layer(&first, &failure()).await.unwrap());
    let late = pinned(rows, &[name(ObjectKind::Layer, "l")]).await;
    let published = rows.publish_layer(&first, &late, &layer_facts()).await;
    assert_eq!(published.unwrap(), Published::Fenced);
    assert!(rows.release_layer(&second, release).await.unwrap());
    assert_eq!(claim_layer(rows).await, None);
    subject.pass(5);
    let third = claim_layer(rows).await.unwrap();

    let unpinned = Pinned {
        holder: "nobody".to_owned(),
        names: late.names.clone(),
    };
    let published = rows.publish_layer(&third, &unpinned, &layer_facts()).await;
    assert_eq!(published.unwrap(), Published::PinLost);
    let object = publish(rows, &third, "l").await;
    let found = layer(rows, &new).await.unwrap();
    assert_eq!(found.state, CaseState::Ready);
    assert_eq!(found.facts, Some(layer_facts()));
    let objects = rows.layer_objects(&case, &new.id).await.unwrap();
    assert!(objects.contains(&object) && objects.len() == 2);
    assert_eq!(claim_layer(rows).await, None);
}

pub async fn a_layer_that_waits_fails_with_its_case(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = insert(rows, "a").await.id;
    let new = insert_layer(rows, &case, "l").await;
    let other = insert(rows, "b").await.id;
    let untouched = insert_layer(rows, &other, "m").await;
    let leased = claim(rows).await.unwrap();
    assert_eq!(leased.id, case);
    assert!(rows.fail(&leased, &failure()).await.unwrap());
    let failed = layer(rows, &new).await.unwrap();
    let expected = (CaseState::Failed, Some(failure()));
    assert_eq!((failed.state, failed.failure), expected);
    let waiting = layer(rows, &untouched).await.unwrap();
    assert_eq!(waiting.state, CaseState::Queued);
    assert_eq!(claim_layer(rows).await, None);
}

pub async fn a_layer_fails_and_is_queued_again(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = ready_case(rows, "a").await.id;
    let new = insert_layer(rows, &case, "l").await;
    let leased = claim_layer(rows).await.unwrap();
    assert!(rows.fail_layer(&leased, &failure()).await.unwrap());
    let failed = layer(rows, &new).await.unwrap();
    assert_eq!(
        (failed.state, failed.failure),
        (CaseState::Failed, Some(failure()))
    );
    assert_eq!(claim_layer(rows).await, None);
    // Its file is of no more use: it is sent again with the layer.
    let objects = rows.layer_objects(&case, &new.id).await.unwrap();
    assert_eq!(objects, Vec::new());
    assert_eq!(removed(rows, &new.sources.names).await, new.sources.names);
    let again = new_layer(rows, &case, "l").await;
    assert_eq!(
        rows.insert_layer(&again).await.unwrap(),
        InsertedLayer::Requeued
    );
    // Preparations that are killed end at last.
    for _ in 0..3 {
        assert!(claim_layer(rows).await.is_some());
        subject.pass(100);
    }
    assert_eq!(claim_layer(rows).await, None);
    let failed = layer(rows, &new).await.unwrap();
    assert_eq!(failed.failure.unwrap().name, "preparation-interrupted");
}

pub async fn a_lost_object_of_a_layer_is_made_again_and_its_place_stays(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = ready_case(rows, "a").await.id;
    let new = insert_layer(rows, &case, "l").await;
    assert!(!rows.prepare_layer_again(&case, &new.id).await.unwrap());
    publish(rows, &claim_layer(rows).await.unwrap(), "l").await;
    assert!(rows.prepare_layer_again(&case, &new.id).await.unwrap());
    let again = claim_layer(rows).await.unwrap();
    assert_eq!(again.layer.facts, Some(layer_facts()));
}

pub async fn a_version_keeps_the_layers_of_its_case(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = ready_case(rows, "a").await;
    let new = insert_layer(rows, &case.id, "l").await;
    let own = publish(rows, &claim_layer(rows).await.unwrap(), "l").await;
    let failed = insert_layer(rows, &case.id, "m").await;
    let leased = claim_layer(rows).await.unwrap();
    assert!(rows.fail_layer(&leased, &failure()).await.unwrap());

    let mut version = new_case(rows, "b").await;
    version.previous = Some(case.id);
    assert_eq!(rows.insert(&version).await.unwrap(), Inserted::Created);
    let layers = rows.layers(&version.id).await.unwrap();
    assert_eq!(layers.len(), 1);
    assert_eq!((layers[0].case, layers[0].id), (version.id, new.id));
    assert_eq!(
        (layers[0].state, &layers[0].facts),
        (CaseState::Queued, &Some(layer_facts()))
    );
    let objects = rows.layer_objects(&version.id, &new.id).await.unwrap();
    assert_eq!(objects, new.sources.names);

    // What both need goes with the second; what the case alone needs with it.
    assert!(rows.delete(&case.id).await.unwrap());
    let sources = [new.sources.names[0], failed.sources.names[0], own];
    assert_eq!(removed(rows, &sources).await, sources[1..]);
    assert!(rows.delete_layer(&version.id, &new.id).await.unwrap());
    assert!(!rows.delete_layer(&version.id, &new.id).await.unwrap());
    assert_eq!(removed(rows, &sources[..1]).await, sources[..1]);
}

pub async fn a_layer_of_a_deleted_case_cannot_be_published(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = ready_case(rows, "a").await.id;
    let new = insert_layer(rows, &case, "l").await;
    let leased = claim_layer(rows).await.unwrap();
    assert!(rows.delete(&case).await.unwrap());
    assert_eq!(layer(rows, &new).await, None);
    assert!(!rows.renew_layer(&leased, LEASE).await.unwrap());
    let late = pinned(rows, &[name(ObjectKind::Layer, "l")]).await;
    let published = rows.publish_layer(&leased, &late, &layer_facts()).await;
    assert_eq!(published.unwrap(), Published::Fenced);
    assert!(rows.unneeded(&new.sources.names).await.unwrap().is_empty());
    assert_eq!(removed(rows, &new.sources.names).await, new.sources.names);
}

pub async fn a_layer_of_another_store_is_adopted_as_it_is_there(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = ready_case(rows, "a").await.id;
    let new = insert_layer(rows, &case, "l").await;
    let object = publish(rows, &claim_layer(rows).await.unwrap(), "l").await;
    let known = layer(rows, &new).await.unwrap();
    assert!(rows.delete_layer(&case, &new.id).await.unwrap());
    let names = [new.sources.names[0], object];
    for _ in 0..2 {
        let objects = pinned(rows, &names).await;
        rows.adopt_layer(&known, &objects).await.unwrap();
        assert_eq!(layer(rows, &new).await.unwrap(), known);
    }
    let objects = rows.layer_objects(&case, &new.id).await.unwrap();
    assert!(names.iter().all(|name| objects.contains(name)));
    let queued = Layer {
        state: CaseState::Preparing,
        ..known
    };
    let objects = pinned(rows, &names[..1]).await;
    rows.adopt_layer(&queued, &objects).await.unwrap();
    assert_eq!(layer(rows, &new).await.unwrap().state, CaseState::Queued);
}
