//! Results that are sent to a node.

use std::time::Duration;

use case::{CaseId, ObjectKind};

use super::RowsSubject;
use crate::arrivals::{ArrivalCursor, TransferEnd, TransferQuery, TransferState, Uid};
use crate::results::{NewResult, ResultSeries, SentResult};
use crate::rows::{CaseRows, Sweep};
use crate::testing::{failure, new_case, pinned};

const LEASE: Duration = Duration::from_secs(30);

fn uid(text: &str) -> Uid {
    Uid::parse(text).unwrap()
}

async fn a_case(rows: &dyn CaseRows) -> CaseId {
    let new = new_case(rows, "a").await;
    rows.insert(&new).await.unwrap();
    new.id
}

fn result(case: CaseId, node: &str, contents: &str) -> NewResult {
    NewResult {
        case,
        node: node.to_owned(),
        study: uid("1.2.3"),
        series: ResultSeries {
            sop_class_uid: uid("1.2.840.10008.5.1.4.1.1.7"),
            series_uid: uid("2.25.8"),
            number: 9001,
            description: "a view".to_owned(),
        },
        instance: uid("2.25.7"),
        digest: blake3::hash(contents.as_bytes()),
    }
}

async fn queue(rows: &dyn CaseRows, new: &NewResult) -> SentResult {
    let pinned = pinned(rows, &[new.object()]).await;
    let queued = rows.queue_result(new, &pinned).await.unwrap();
    queued.expect("the pin is there")
}

pub async fn a_result_is_queued_once_for_a_node_and_sent_until_it_is_there(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = a_case(rows).await;
    assert_eq!(rows.lease_result(LEASE).await.unwrap(), None);
    let first = queue(rows, &result(case, "pacs", "one")).await;
    assert_eq!((first.state, first.attempts), (TransferState::Queued, 0));
    assert_eq!(rows.result(&first.id).await.unwrap(), Some(first.clone()));
    // The same result, although its file was made again: the first file counts.
    let again = queue(rows, &result(case, "pacs", "two")).await;
    assert_eq!(again, first);
    let known = rows.object_of_result(&uid("2.25.7")).await.unwrap();
    assert_eq!(known, Some(first.object));
    assert_eq!(rows.object_of_result(&uid("2.25.8")).await.unwrap(), None);
    let listed = async |kind| rows.pacs_objects(kind, None, 9).await.unwrap();
    assert_eq!(listed(ObjectKind::Result).await, [first.object]);
    assert_eq!(listed(ObjectKind::Volume).await, []);
    let gone = pinned(rows, &[first.object]).await;
    rows.unpin(&gone).await.unwrap();
    let sweep = Sweep {
        holder: "sweep".to_owned(),
        lease: LEASE,
    };
    let two = result(case, "pacs", "two").object();
    assert_eq!(
        rows.mark(&[first.object, two], &sweep).await.unwrap(),
        [two]
    );

    let leased = rows.lease_result(LEASE).await.unwrap().unwrap();
    assert_eq!((leased.state, leased.attempts), (TransferState::Running, 1));
    assert_eq!(rows.lease_result(LEASE).await.unwrap(), None);
    subject.pass(31);
    let stolen = rows.lease_result(LEASE).await.unwrap().unwrap();
    assert!(!rows.end_result(&leased, &TransferEnd::Done).await.unwrap());
    let later = TransferEnd::Later(Duration::from_secs(10));
    assert!(rows.end_result(&stolen, &later).await.unwrap());
    assert_eq!(rows.lease_result(LEASE).await.unwrap(), None);
    subject.pass(11);
    let third = rows.lease_result(LEASE).await.unwrap().unwrap();
    assert_eq!(third.attempts, 3);
    let failed = TransferEnd::Failed(failure());
    assert!(rows.end_result(&third, &failed).await.unwrap());
    let seen = rows.result(&first.id).await.unwrap().unwrap();
    assert_eq!(
        (seen.state, seen.reason),
        (TransferState::Failed, Some(failure()))
    );
    // Whoever requests it again wants it sent again.
    let again = queue(rows, &result(case, "pacs", "one")).await;
    assert_eq!(
        (again.id, again.state, again.attempts),
        (first.id, TransferState::Queued, 0)
    );
    assert_eq!(again.reason, None);
    rows.forget_holders().await.unwrap();
}

pub async fn a_result_is_kept_until_it_is_forgotten_or_its_case_deleted(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = a_case(rows).await;
    let [one, other] = ["pacs", "other"].map(|node| result(case, node, "one"));
    let sent = queue(rows, &one).await;
    let leased = rows.lease_result(LEASE).await.unwrap().unwrap();
    assert!(rows.end_result(&leased, &TransferEnd::Done).await.unwrap());
    queue(rows, &other).await;
    // A search finds it once, though it goes to two nodes.
    let held = rows.results_of(&uid("1.2.3")).await.unwrap();
    assert_eq!(held.len(), 1);
    assert_eq!(held[0].series, one.series);
    assert_eq!(held[0].object, one.object());
    assert_eq!(rows.results_of(&uid("1.2.4")).await.unwrap(), []);
    let objects = [one.object()];
    assert_eq!(objects[0].kind, ObjectKind::Result);
    subject.pass(3600);
    rows.forget_arrivals(Duration::from_secs(7200), true)
        .await
        .unwrap();
    assert!(rows.result(&sent.id).await.unwrap().is_some());
    rows.forget_arrivals(Duration::from_secs(60), true)
        .await
        .unwrap();
    assert_eq!(rows.result(&sent.id).await.unwrap(), None);
    // The other node still waits for the same object.
    assert_eq!(rows.unneeded(&objects).await.unwrap(), []);
    rows.delete(&case).await.unwrap();
    assert_eq!(rows.lease_result(LEASE).await.unwrap(), None);
    let sweep = Sweep {
        holder: "sweep".to_owned(),
        lease: LEASE,
    };
    subject.pass(1);
    assert_eq!(rows.mark(&objects, &sweep).await.unwrap(), objects);
    // A case that is gone gets no results.
    let pinned = pinned(rows, &[result(case, "pacs", "three").object()]).await;
    let late = result(case, "pacs", "three");
    assert!(rows.queue_result(&late, &pinned).await.is_err());
}

pub async fn results_are_listed_by_case_and_state_in_pages(subject: &RowsSubject) {
    let rows = &*subject.rows;
    let case = a_case(rows).await;
    let mut ids = Vec::new();
    for node in ["first", "second", "third"] {
        subject.pass(1);
        ids.push(queue(rows, &result(case, node, "one")).await.id);
    }
    ids.reverse();
    let list = async |query: &TransferQuery, after: Option<&ArrivalCursor>, limit| {
        let (page, next) = rows.results(query, after, limit).await.unwrap();
        let ids: Vec<_> = page.into_iter().map(|result| result.id).collect();
        (ids, next)
    };
    let every = TransferQuery::default();
    assert_eq!(list(&every, None, 9).await, (ids.clone(), None));
    let (page, next) = list(&every, None, 2).await;
    assert_eq!(page, ids[..2]);
    assert_eq!(
        list(&every, next.as_ref(), 2).await,
        (ids[2..].to_vec(), None)
    );
    let leased = rows.lease_result(LEASE).await.unwrap().unwrap();
    let of = |case, state| TransferQuery { case, state };
    let running = Some(TransferState::Running);
    assert_eq!(list(&of(Some(case), running), None, 9).await.0, [leased.id]);
    assert_eq!(
        list(&of(None, Some(TransferState::Queued)), None, 9)
            .await
            .0
            .len(),
        2
    );
    let other = CaseId::parse(&"0".repeat(case.to_string().len()));
    assert!(other.is_some() && list(&of(other, None), None, 9).await.0.is_empty());
}
