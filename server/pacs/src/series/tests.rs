//! What is stored and cannot be read, for a reason that is not its own.

use std::sync::Arc;
use std::time::Duration;

use case::series::{SeriesQuery, SeriesUids, Uid};
use cases::testing::{application, options};
use storage::{Options, Store};

use super::read::read_one_series;
use super::{ArrivalOptions, Arrivals, SeriesRule};
use crate::store::PacsTables;
use crate::values::{ArrivalSource, ArrivalState, NewInstance, Reception};

/// A child that reports that there is not enough memory.
const OUT_OF_MEMORY: &str = r#"order=$(/bin/cat); output=${order#*\"output\":\"}; output=${output%%\"*}
printf '%s' '{"refused":{"name":"dicom-out-of-memory","kind":"out_of_memory","detail":"too little memory"}}' > "$output/outcome.json""#;

/// Options of a store with the tables of the PACS.
pub(super) fn with_tables() -> Options {
    Options {
        tables: Arc::new(PacsTables),
        ..options()
    }
}

fn uid(text: &str) -> Uid {
    Uid::parse(text).unwrap()
}

#[tokio::test]
async fn a_series_that_is_out_of_memory_each_time_becomes_nothing() {
    let store = Store::in_memory(with_tables()).await.unwrap();
    let arrivals = Arrivals::new(application(store, OUT_OF_MEMORY));
    let file = arrivals
        .cases
        .store()
        .spools()
        .of("an image".into())
        .await
        .unwrap();
    let image = NewInstance {
        uids: SeriesUids {
            study: uid("1.2"),
            series: uid("1.2.3"),
        },
        accession_number: None,
        sop_instance_uid: uid("1.2.3.4"),
        digest: *file.digest(),
        label: None,
        fingerprint: None,
    };
    let received = arrivals
        .store()
        .receive(vec![(image, file)], ArrivalSource::CStore);
    assert_eq!(received.await.unwrap(), [Reception::New]);
    let options = ArrivalOptions {
        stable: Duration::ZERO,
        series: SeriesRule::Any,
        ..ArrivalOptions::default()
    };
    let mut attempts = 0;
    while attempts < 100 && read_one_series(&arrivals, options).await {
        attempts += 1;
        arrivals
            .cases
            .store()
            .pass_time(Duration::from_secs(24 * 3600));
    }
    let query = SeriesQuery::Study(uid("1.2"), None);
    let arrival = arrivals.store().arrivals_of(&query).await.unwrap();
    let arrival = arrival.into_iter().next().unwrap();
    assert_eq!(arrival.state, ArrivalState::Nothing);
    let words = arrival.reason.unwrap().detail;
    assert!(words.contains(&format!("{attempts} attempts")), "{words}");
    assert!(words.contains("too little memory"), "{words}");
}
