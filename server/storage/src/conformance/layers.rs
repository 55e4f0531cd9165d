//! Checks of the rows of layers.

use std::time::Duration;

use case::images::Image;
use case::{
    CaseId, CaseState, Contrast, JobKind, Layer, LayerChange, LayerId, LayerKind, LayerParameters,
    ObjectKind,
};

use super::{Subject, derived, insert, removed};
use crate::jobs::{Claim, Release};
use crate::rows::{LayerName, NewCase, NewLayer, Pinned, Published, Referred};
use crate::testing::{claim, facts, failure, layer_facts, name, new_case, pinned};
use crate::{ObjectName, Store, StoreError};
use case::series::Uid;

/// A case that is ready.
pub(super) async fn ready_case(store: &Store, contents: &str) -> NewCase {
    let new = insert(store, contents).await;
    let leased = claim(store).await.unwrap();
    let derived = derived(store, contents).await;
    store
        .make_case_ready(&leased, &derived, &facts(), &[])
        .await
        .unwrap();
    new
}

/// A layer of the volume `contents`, whose source is pinned.
async fn new_layer(store: &Store, case: &CaseId, contents: &str) -> NewLayer {
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
        series: Uid::parse("1.2.3"),
        images: Vec::new(),
        sources: pinned(store, &[source]).await,
        most: 20,
        queue_limit: 100,
        client: String::new(),
    }
}

pub(super) async fn insert_layer(store: &Store, case: &CaseId, contents: &str) -> NewLayer {
    insert_layer_of(store, case, contents, &[]).await
}

/// A layer that is made of these images.
pub(super) async fn insert_layer_of(
    store: &Store,
    case: &CaseId,
    contents: &str,
    images: &[Image],
) -> NewLayer {
    let new = NewLayer {
        images: images.to_vec(),
        ..new_layer(store, case, contents).await
    };
    let inserted = store.insert_layer(&new).await.unwrap();
    assert_eq!(inserted, Referred::Done(true));
    new
}

async fn claim_layer(store: &Store) -> Option<Claim> {
    store.claim(JobKind::LAYER, 3).await.unwrap()
}

async fn layer(store: &Store, new: &NewLayer) -> Option<Layer> {
    let layers = store.layers(&new.case).await.unwrap();
    layers.into_iter().find(|layer| layer.id == new.id)
}

async fn names(store: &Store, case: &CaseId) -> Vec<String> {
    let layers = store.layers(case).await.unwrap();
    layers.into_iter().map(|layer| layer.name).collect()
}

async fn publish(store: &Store, leased: &Claim, contents: &str) -> ObjectName {
    let object = name(ObjectKind::Layer, contents);
    let derived = pinned(store, &[object]).await;
    let published = store
        .make_layer_ready(leased, &derived, &layer_facts())
        .await;
    assert_eq!(published.unwrap(), Referred::Done(Published::Done));
    object
}

pub(crate) async fn a_layer_is_inserted_once_and_as_many_as_may(subject: &Subject) {
    let store = &subject.store;
    let case = insert(store, "a").await.id;
    let new = insert_layer(store, &case, "l").await;
    assert_eq!(
        store.insert_layer(&new).await.unwrap(),
        Referred::Unneeded(false)
    );
    let found = layer(store, &new).await.unwrap();
    assert_eq!((found.case, found.id), (case, new.id));
    assert_eq!(
        (found.name.as_str(), found.state),
        ("pet", CaseState::Queued)
    );
    assert_eq!(found.parameters, new.parameters);
    assert_eq!((found.failure, found.facts), (None, None));
    let objects = store.objects_of((&case, &new.id)).await.unwrap();
    assert_eq!(objects, new.sources.names);

    let mut second = new_layer(store, &case, "m").await;
    second.most = 1;
    let refused = store.insert_layer(&second).await;
    assert!(matches!(refused, Err(StoreError::TooManyLayers)));
    second.most = 2;
    second.queue_limit = 1;
    let refused = store.insert_layer(&second).await;
    assert!(matches!(refused, Err(StoreError::QueueFull(_))));
    second.queue_limit = 2;
    second.name = LayerName::Given("pet".to_owned());
    let refused = store.insert_layer(&second).await;
    assert!(matches!(refused, Err(StoreError::LayerNameTaken)));
    second.name = LayerName::Usual("pet".to_owned());
    second.sources.holder = "nobody".to_owned();
    assert_eq!(
        store.insert_layer(&second).await.unwrap(),
        Referred::PinLost
    );
    assert_eq!(names(store, &case).await, ["pet"]);

    let nowhere = CaseId::parse(&"0".repeat(32)).unwrap();
    let lost = new_layer(store, &nowhere, "m").await;
    let refused = store.insert_layer(&lost).await;
    assert!(matches!(refused, Err(StoreError::NoSuchCase)));
}

pub(crate) async fn layers_are_named_and_ordered(subject: &Subject) {
    let store = &subject.store;
    let case = insert(store, "a").await.id;
    let mut ids = Vec::new();
    for contents in ["l", "m", "n"] {
        ids.push(insert_layer(store, &case, contents).await.id);
        subject.pass(1);
    }
    assert_eq!(names(store, &case).await, ["pet", "pet 2", "pet 3"]);
    let change = async |id: &LayerId, name: Option<&str>, place| {
        let name = name.map(str::to_owned);
        let change = LayerChange {
            name,
            place,
            contrast: None,
        };
        store.change_layer(&case, id, &change).await
    };
    let taken = change(&ids[2], Some("pet"), Some(0)).await;
    assert!(matches!(taken, Err(StoreError::LayerNameTaken)));
    let moved = change(&ids[2], Some("first"), Some(0)).await;
    assert!(moved.unwrap());
    assert_eq!(names(store, &case).await, ["first", "pet", "pet 2"]);
    let moved = change(&ids[0], None, Some(99)).await;
    assert!(moved.unwrap());
    assert_eq!(names(store, &case).await, ["first", "pet 2", "pet"]);
    let same = change(&ids[0], Some("pet"), None).await;
    assert!(same.unwrap());
    let stated = LayerChange {
        contrast: Some(Contrast::Flair),
        ..LayerChange::default()
    };
    let changed = store.change_layer(&case, &ids[1], &stated).await;
    assert!(changed.unwrap());
    let layers = store.layers(&case).await.unwrap();
    let flairs = layers.iter().filter(|layer| layer.is_flair());
    let flairs: Vec<_> = flairs.map(|layer| (layer.id, &*layer.name)).collect();
    assert_eq!(flairs, [(ids[1], "pet 2")]);
    assert_eq!(Layer::newest_flair(&layers), None, "it is not ready");
    let stranger = LayerId::parse(&"0".repeat(32)).unwrap();
    let none = change(&stranger, None, Some(0)).await;
    assert!(!none.unwrap());
}

pub(crate) async fn a_layer_is_leased_once_its_case_is_ready(subject: &Subject) {
    let store = &subject.store;
    let case = insert(store, "a").await.id;
    let new = insert_layer(store, &case, "l").await;
    assert_eq!(claim_layer(store).await, None);
    let leased = claim(store).await.unwrap();
    let derived = derived(store, "a").await;
    store
        .make_case_ready(&leased, &derived, &facts(), &[])
        .await
        .unwrap();

    let first = claim_layer(store).await.unwrap();
    assert_eq!(first.owner(), Some(new.owner()));
    let found = layer(store, &new).await.unwrap();
    assert_eq!(found.state, CaseState::Preparing);
    assert_eq!(claim_layer(store).await, None);
    subject.pass(29);
    assert!(store.renew(&first, None).await.unwrap());
    subject.pass(29);
    assert_eq!(claim_layer(store).await, None);
    subject.pass(1);
    let second = claim_layer(store).await.unwrap();
    assert!(second.fence > first.fence);

    let release = Release {
        after: Duration::from_secs(5),
        counts: false,
        failure: None,
    };
    assert!(!store.renew(&first, None).await.unwrap());
    assert!(!store.release(&first, &release).await.unwrap());
    assert!(!store.finish(&first, Err(&failure())).await.unwrap());
    let late = pinned(store, &[name(ObjectKind::Layer, "l")]).await;
    let published = store.make_layer_ready(&first, &late, &layer_facts()).await;
    assert_eq!(published.unwrap(), Referred::Unneeded(Published::Fenced));
    assert!(store.release(&second, &release).await.unwrap());
    assert_eq!(claim_layer(store).await, None);
    subject.pass(5);
    let third = claim_layer(store).await.unwrap();

    let unpinned = Pinned {
        holder: "nobody".to_owned(),
        names: late.names.clone(),
    };
    let published = store
        .make_layer_ready(&third, &unpinned, &layer_facts())
        .await;
    assert_eq!(published.unwrap(), Referred::PinLost);
    let object = publish(store, &third, "l").await;
    let found = layer(store, &new).await.unwrap();
    assert_eq!(found.state, CaseState::Ready);
    assert_eq!(found.facts, Some(layer_facts()));
    let objects = store.objects_of((&case, &new.id)).await.unwrap();
    assert!(objects.contains(&object) && objects.len() == 2);
    assert_eq!(claim_layer(store).await, None);
}

pub(crate) async fn a_layer_that_waits_fails_with_its_case(subject: &Subject) {
    let store = &subject.store;
    let case = insert(store, "a").await.id;
    let new = insert_layer(store, &case, "l").await;
    let other = insert(store, "b").await.id;
    let untouched = insert_layer(store, &other, "m").await;
    let leased = claim(store).await.unwrap();
    assert_eq!(leased.case, Some(case));
    assert!(store.finish(&leased, Err(&failure())).await.unwrap());
    let failed = layer(store, &new).await.unwrap();
    let expected = (CaseState::Failed, Some(failure()));
    assert_eq!((failed.state, failed.failure), expected);
    let waiting = layer(store, &untouched).await.unwrap();
    assert_eq!(waiting.state, CaseState::Queued);
    assert_eq!(claim_layer(store).await, None);
}

pub(crate) async fn a_layer_fails_and_is_queued_again(subject: &Subject) {
    let store = &subject.store;
    let case = ready_case(store, "a").await.id;
    let new = insert_layer(store, &case, "l").await;
    let leased = claim_layer(store).await.unwrap();
    assert!(store.finish(&leased, Err(&failure())).await.unwrap());
    let failed = layer(store, &new).await.unwrap();
    assert_eq!(
        (failed.state, failed.failure),
        (CaseState::Failed, Some(failure()))
    );
    assert_eq!(claim_layer(store).await, None);
    // Its file is of no more use: it is sent again with the layer.
    let objects = store.objects_of((&case, &new.id)).await.unwrap();
    assert_eq!(objects, Vec::new());
    assert_eq!(removed(store, &new.sources.names).await, new.sources.names);
    let again = new_layer(store, &case, "l").await;
    assert_eq!(
        store.insert_layer(&again).await.unwrap(),
        Referred::Done(true)
    );
    // Preparations that are killed end at last.
    for _ in 0..3 {
        assert!(claim_layer(store).await.is_some());
        subject.pass(100);
    }
    assert_eq!(claim_layer(store).await, None);
    let failed = layer(store, &new).await.unwrap();
    assert_eq!(failed.failure.unwrap().name, "preparation-interrupted");
}

pub(crate) async fn a_lost_object_of_a_layer_is_made_again_and_its_place_stays(subject: &Subject) {
    let store = &subject.store;
    let case = ready_case(store, "a").await.id;
    let new = insert_layer(store, &case, "l").await;
    assert!(
        !store
            .prepare_again((&case, &new.id), CaseState::Ready)
            .await
            .unwrap()
    );
    publish(store, &claim_layer(store).await.unwrap(), "l").await;
    assert!(
        store
            .prepare_again((&case, &new.id), CaseState::Ready)
            .await
            .unwrap()
    );
    assert!(claim_layer(store).await.is_some());
    let again = layer(store, &new).await.unwrap();
    assert_eq!(again.facts, Some(layer_facts()));
}

pub(crate) async fn a_version_keeps_the_layers_of_its_case(subject: &Subject) {
    let store = &subject.store;
    let case = ready_case(store, "a").await;
    let new = insert_layer(store, &case.id, "l").await;
    let map = name(ObjectKind::Maps, "l");
    let early = pinned(store, &[map]).await;
    let refused = store.refer((&case.id, &new.id).into(), &early, true).await;
    assert_eq!(refused.unwrap(), Referred::Unneeded(Published::Fenced));
    let own = publish(store, &claim_layer(store).await.unwrap(), "l").await;
    let given = store.refer((&case.id, &new.id).into(), &early, true).await;
    assert_eq!(given.unwrap(), Referred::Done(Published::Done));
    let objects = store.objects_of((&case.id, &new.id)).await.unwrap();
    assert!(objects.contains(&map) && objects.len() == 3);
    let failed = insert_layer(store, &case.id, "m").await;
    let leased = claim_layer(store).await.unwrap();
    assert!(store.finish(&leased, Err(&failure())).await.unwrap());

    let mut version = new_case(store, "b").await;
    version.previous = Some(case.id);
    assert!(matches!(
        store.insert_case(&version).await.unwrap(),
        Referred::Done(_)
    ));
    let layers = store.layers(&version.id).await.unwrap();
    assert_eq!(layers.len(), 1);
    assert_eq!((layers[0].case, layers[0].id), (version.id, new.id));
    assert_eq!(
        (layers[0].state, &layers[0].facts),
        (CaseState::Queued, &Some(layer_facts()))
    );
    let objects = store.objects_of((&version.id, &new.id)).await.unwrap();
    assert_eq!(objects, new.sources.names);

    // What both need goes with the second; what the case alone needs with it.
    assert!(store.delete_rows(&case.id).await.unwrap());
    let sources = [new.sources.names[0], failed.sources.names[0], own, map];
    assert_eq!(removed(store, &sources).await, sources[1..]);
    assert!(store.delete_rows((&version.id, &new.id)).await.unwrap());
    assert!(!store.delete_rows((&version.id, &new.id)).await.unwrap());
    assert_eq!(removed(store, &sources[..1]).await, sources[..1]);
}

pub(crate) async fn a_layer_of_a_deleted_case_cannot_be_published(subject: &Subject) {
    let store = &subject.store;
    let case = ready_case(store, "a").await.id;
    let new = insert_layer(store, &case, "l").await;
    let leased = claim_layer(store).await.unwrap();
    assert!(store.delete_rows(&case).await.unwrap());
    assert_eq!(layer(store, &new).await, None);
    assert!(!store.renew(&leased, None).await.unwrap());
    let late = pinned(store, &[name(ObjectKind::Layer, "l")]).await;
    let published = store.make_layer_ready(&leased, &late, &layer_facts()).await;
    assert_eq!(published.unwrap(), Referred::Unneeded(Published::Fenced));
    assert!(store.unneeded(&new.sources.names).await.unwrap().is_empty());
    assert_eq!(removed(store, &new.sources.names).await, new.sources.names);
}

pub(crate) async fn a_layer_of_another_store_is_copied_as_it_is_there(subject: &Subject) {
    let store = &subject.store;
    let case = ready_case(store, "a").await.id;
    let new = insert_layer(store, &case, "l").await;
    let object = publish(store, &claim_layer(store).await.unwrap(), "l").await;
    let known = layer(store, &new).await.unwrap();
    assert!(store.delete_rows((&case, &new.id)).await.unwrap());
    let names = [new.sources.names[0], object];
    for _ in 0..2 {
        let objects = pinned(store, &names).await;
        store
            .write_copied_layer(&known, None, &objects)
            .await
            .unwrap();
        assert_eq!(layer(store, &new).await.unwrap(), known);
    }
    let objects = store.objects_of((&case, &new.id)).await.unwrap();
    assert!(names.iter().all(|name| objects.contains(name)));
    let queued = Layer {
        state: CaseState::Preparing,
        ..known
    };
    let objects = pinned(store, &names[..1]).await;
    store
        .write_copied_layer(&queued, None, &objects)
        .await
        .unwrap();
    assert_eq!(layer(store, &new).await.unwrap().state, CaseState::Queued);
}
