//! Projects: what one has, no other sees, changes or removes.

use case::{CaseId, Failure, JobKind, ObjectKind, Project};

use super::Subject;
use super::results::queue;
use crate::arrivals::{
    ArrivalQuery, ArrivalSource, CaseSeries, DueTerms, NewInstance, Outcome, REJECTED, Rejection,
    SeriesQuery, SeriesUids, TransferQuery, Uid,
};
use crate::jobs::{JobQuery, NewJob};
use crate::rows::{Inserted, Referred, Sweep};
use crate::testing::{name, new_case, new_result, pinned};
use crate::{ObjectName, Store};

const TERMS: DueTerms = DueTerms {
    stable: std::time::Duration::from_secs(20),
    patience: std::time::Duration::from_secs(200),
};

fn uid(text: &str) -> Uid {
    Uid::parse(text).unwrap()
}

fn uids() -> SeriesUids {
    SeriesUids {
        study: uid("1.2.3"),
        series: uid("1.2.3.4"),
    }
}

fn study() -> SeriesQuery {
    SeriesQuery::Study(uid("1.2.3"), None)
}

/// The store for two projects and for the one without a name.
fn stores(store: &Store) -> [Store; 3] {
    ["one", "two", ""].map(|name| store.in_project(Project::with_name(name).unwrap()))
}

/// The same case in the project of a store.
async fn insert(store: &Store) -> CaseId {
    let mut new = new_case(store, "the same").await;
    new.id = new.id.in_project(store.project());
    let inserted = store.insert_case(&new).await.unwrap();
    assert_eq!(
        inserted,
        Referred::Done(Inserted::Created),
        "as if it were new"
    );
    new.id
}

async fn listed(store: &Store) -> Vec<CaseId> {
    let page = store.cases(None, 10).await.unwrap();
    page.cases.into_iter().map(|case| case.id).collect()
}

pub(crate) async fn projects_have_the_same_case_apart(subject: &Subject) {
    let [one, two, plain] = &stores(&subject.store);
    let first = insert(one).await;
    let second = insert(two).await;
    assert_eq!(first.to_string(), second.to_string());
    assert_eq!(
        plain
            .case(&CaseId::parse(&first.to_string()).unwrap())
            .await
            .unwrap(),
        None
    );
    assert_eq!(listed(plain).await, []);
    let third = insert(plain).await;
    for (store, id) in [(one, first), (two, second), (plain, third)] {
        assert_eq!(listed(store).await, [id]);
        let page = store.cases(None, 1).await.unwrap();
        assert_eq!(page.next, None, "no other case follows");
        assert_eq!(store.case(&id).await.unwrap().unwrap().id, id);
    }
    assert_eq!(listed(&subject.store.of_all_projects()).await.len(), 3);
    assert_eq!(plain.waiting(JobKind::PREPARE).await.unwrap(), 3);

    one.rename(&first, "ours").await.unwrap();
    one.keep(&first, true).await.unwrap();
    let other = two.case(&second).await.unwrap().unwrap();
    assert_eq!((other.parameters.name, other.kept), (None, false));

    let source = name(ObjectKind::SourceVolume, "the same");
    let marked = async || {
        let sweep = Sweep {
            holder: "a sweep".to_owned(),
            lease: std::time::Duration::from_secs(60),
        };
        plain.mark(&[source], &sweep).await.unwrap()
    };
    for (id, left) in [(first, 2), (third, 1)] {
        assert!(plain.delete_case(&id).await.unwrap());
        assert_eq!(marked().await, [], "the others need its object");
        assert_eq!(listed(&subject.store.of_all_projects()).await.len(), left);
    }
    assert_eq!(listed(two).await, [second]);
    two.delete_case(&second).await.unwrap();
    assert_eq!(marked().await, [source]);
}

async fn receive(store: &Store) -> usize {
    let image = NewInstance {
        uids: uids(),
        accession_number: None,
        digest: blake3::hash(b"image"),
        sop_instance_uid: uid("1.2.3.4.1"),
        label: None,
        replaces: None,
    };
    let images = [image];
    let known = store.known(&[(uids(), uid("1.2.3.4.1"))]).await.unwrap();
    assert_eq!(known, [None], "nobody else's image is known");
    let names: Vec<_> = images.iter().map(ObjectName::from).collect();
    let pinned = pinned(store, &names).await;
    let source = ArrivalSource::Stow;
    match store.insert_images(&images, &pinned, source).await.unwrap() {
        Referred::Done(received) => received.new,
        other => panic!("{other:?}"),
    }
}

pub(crate) async fn projects_receive_the_same_series_apart(subject: &Subject) {
    let [one, two, plain] = &stores(&subject.store);
    let first = insert(one).await;
    let second = insert(two).await;
    assert_eq!(receive(one).await, 1);
    subject.pass(1);
    assert_eq!(receive(two).await, 1);
    let every = ArrivalQuery::default();
    for (store, count) in [(one, 1), (two, 1), (plain, 0)] {
        assert_eq!(store.arrivals_of(&study()).await.unwrap().len(), count);
        assert_eq!(
            store.arrivals(&every, None, 9).await.unwrap().0.len(),
            count
        );
        assert_eq!(store.images_of(&uids()).await.unwrap().len(), count);
    }
    let [of_one, of_two] = [one, two].map(async |store| {
        let arrival = store.arrivals_of(&study()).await.unwrap().remove(0);
        assert_eq!(arrival.project, store.project());
        arrival.id
    });
    let (of_one, of_two) = (of_one.await, of_two.await);
    assert_eq!(two.arrival(&of_one).await.unwrap(), None);
    assert_eq!(plain.arrival(&of_two).await.unwrap(), None);

    // Whoever reads series is told whose each is.
    subject.pass(30);
    assert_eq!(plain.queue_due_series(&TERMS).await.unwrap(), 2);
    for (store, case) in [(one, first), (two, second)] {
        let claim = plain.claim(JobKind::SERIES, 3).await.unwrap().unwrap();
        let due = plain.series_to_read(&claim).await.unwrap().unwrap();
        assert_eq!((due.project, due.uids), (store.project(), uids()));
        assert!(plain.settle(&claim, &Outcome::Case(case)).await.unwrap());
    }
    for (store, case) in [(one, Some(first)), (two, Some(second)), (plain, None)] {
        let found = store.cases_of(&study()).await.unwrap();
        assert_eq!(found.first().map(|series| series.case), case);
        assert_eq!(found.len(), usize::from(case.is_some()));
    }

    // What is corrected or rejected in one project stays as it is in the other.
    let rejection = Rejection {
        may_return: false,
        series: vec![(uids(), vec![uid("1.2.3.4.1")])],
    };
    let reason = Failure::unusable(REJECTED, "it was rejected");
    let source = ArrivalSource::Stow;
    let cases = [first];
    let rejected = one.reject(&rejection, source, &reason, &cases);
    rejected.await.unwrap();
    let superseded = async |store: &Store, case: &CaseId| -> Option<CaseSeries> {
        let series = store.series_of(case).await.unwrap();
        series.filter(CaseSeries::is_superseded)
    };
    assert!(superseded(one, &first).await.is_some());
    assert_eq!(superseded(two, &second).await, None);
    let asked = [uid("1.2.3.4.1")];
    assert_eq!(one.are_withdrawn(&asked).await.unwrap(), [true]);
    assert_eq!(two.are_withdrawn(&asked).await.unwrap(), [false]);
    assert_eq!(one.images_of(&uids()).await.unwrap().len(), 0);
    assert_eq!(two.images_of(&uids()).await.unwrap().len(), 1);
    plain.delete_case(&first).await.unwrap();
    assert_eq!(two.arrivals_of(&study()).await.unwrap().len(), 1);
}

pub(crate) async fn projects_have_their_own_results_and_retrievals(subject: &Subject) {
    const FETCH: JobKind = JobKind::new("fetch", "retrieval");
    let [one, two, plain] = &stores(&subject.store);
    let mut ids = Vec::new();
    for (store, contents) in [(one, "of one"), (two, "of two")] {
        let new = new_result(insert(store).await, "pacs", contents);
        assert_eq!(store.object_of_result(&new.instance).await.unwrap(), None);
        let queued = queue(store, &new).await;
        assert_eq!(queued.object, new.object());
        ids.push(queued.id);
        let job = NewJob {
            for_project: store.project(),
            ..NewJob::new(FETCH, format!("key {contents}"))
        };
        ids.push(store.enqueue(&job).await.unwrap().unwrap().id);
    }
    let (every, fetched) = (
        TransferQuery::default(),
        JobQuery {
            kind: FETCH,
            state: None,
            key_prefix: String::new(),
        },
    );
    for (store, own) in [(one, &ids[..2]), (two, &ids[2..]), (plain, &[])] {
        let results = store.results(&every, None, 9).await.unwrap().0;
        let jobs = store.jobs(&fetched, None, 9).await.unwrap().0;
        let found = results.into_iter().map(|result| result.id);
        let found: Vec<_> = found.chain(jobs.into_iter().map(|job| job.id)).collect();
        assert_eq!(found, own);
        for (number, id) in ids.iter().enumerate() {
            let is_found = match number % 2 {
                0 => store.result(id).await.unwrap().is_some(),
                _ => store.job(id).await.unwrap().is_some(),
            };
            assert_eq!(is_found, own.contains(id));
        }
        let of_study = store.results_of(&uid("1.2.3")).await.unwrap();
        assert_eq!(of_study.len(), own.len() / 2);
        let object = store.object_of_result(&uid("2.25.7")).await.unwrap();
        assert_eq!(object.is_some(), !own.is_empty());
    }
}

/// The text of an id lacks its project: a statement that is bound to it would find the case of the project without a name.
#[test]
fn statements_name_cases_by_their_keys() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/sql");
    let mut files = 0;
    for file in std::fs::read_dir(folder).unwrap() {
        let path = file.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        for wrong in [
            "case.to_string()",
            "case.id.to_string()",
            "previous.to_string()",
            "CaseId::parse(",
        ] {
            assert!(!text.contains(wrong), "{wrong} in {}", path.display());
        }
        files += 1;
    }
    assert!(files > 10);
}
