//! Reads series that are due, and makes cases of them.

use std::time::{Duration, Instant};

use case::{CaseState, Failure, FailureKind, LayerParameters, Parameters};
use storage::arrivals::{DueTerms, NOT_T1, Outcome, SeriesQuery};
use storage::{DueSeries, StoreError};
use tokio::sync::watch;
use tokio::task::JoinSet;

use super::{ArrivalOptions, SeriesRule};
use crate::application::Cases;
use crate::dicom::{Options, Purpose, copy_objects};
use crate::error::Error;
use crate::intake::VolumeFiles;
use crate::layers::NewLayer;

/// The lease of a series: longer than it takes to read and to check one.
const LEASE: Duration = Duration::from_secs(600);

/// How long to wait before the next attempt if the server, not the series, was the reason.
const RETRY_AFTER: Duration = Duration::from_secs(15);

/// How many times as long as for other series to wait for images that were announced.
const PATIENCE: u32 = 10;

/// How often to look for a series that is due.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// How often to look for series to forget.
const FORGET_EVERY: Duration = Duration::from_secs(600);

/// A running reader. Dropping it stops it; another one takes its series after the lease ends.
#[derive(Debug)]
pub struct ArrivalReader {
    stopping: watch::Sender<bool>,
    tasks: JoinSet<()>,
}

impl ArrivalReader {
    /// Starts to read series on the current runtime, one at a time.
    pub fn start(cases: Cases, options: ArrivalOptions) -> Self {
        let stopping = watch::Sender::new(false);
        let mut tasks = JoinSet::new();
        let stop = stopping.subscribe();
        tasks.spawn(read_all(cases, options, stop));
        Self { stopping, tasks }
    }

    /// Takes no more series, and finishes the one at hand within `grace`.
    pub async fn shut_down(mut self, grace: Duration) {
        self.stopping.send_replace(true);
        let all_done = async { while self.tasks.join_next().await.is_some() {} };
        // What is not finished is read again when its lease ends, or when the program starts again.
        let _unfinished = tokio::time::timeout(grace, all_done).await;
    }
}

async fn read_all(cases: Cases, options: ArrivalOptions, mut stop: watch::Receiver<bool>) {
    let mut forgotten: Option<Instant> = None;
    while !*stop.borrow() {
        match cases.read_due_series(&options).await {
            Ok(true) => continue,
            Ok(false) => {}
            Err(error) => {
                tracing::error!(
                    error = &error as &dyn std::error::Error,
                    "cannot take a series that has come"
                );
            }
        }
        if forgotten.is_none_or(|when| when.elapsed() > FORGET_EVERY) {
            forgotten = Some(Instant::now());
            if let Err(error) = cases.forget_arrivals(&options).await {
                tracing::warn!(
                    error = &error as &dyn std::error::Error,
                    "series that came some days ago will be forgotten later"
                );
            }
        }
        tokio::select! {
            _ = stop.wait_for(|&stop| stop) => {}
            () = tokio::time::sleep(LOOK_EVERY) => {}
        }
    }
}

impl Cases {
    /// Reads the series that has waited longest of those that are due; `false` if there is none.
    ///
    /// # Errors
    /// If the rows cannot be read or written. What is wrong with the series is noted with it.
    pub async fn read_due_series(&self, options: &ArrivalOptions) -> Result<bool, StoreError> {
        let terms = DueTerms {
            stable: options.stable,
            patience: options.stable * PATIENCE,
            lease: LEASE,
        };
        let store = self.store();
        let Some(due) = store.lease_due(&terms).await? else {
            return Ok(false);
        };
        let outcome = self.outcome(&due, options).await;
        match &outcome {
            Outcome::Case(case) => {
                tracing::info!(
                    arrival = due.id,
                    case = case.short(),
                    "a series became a case"
                );
            }
            Outcome::Layer(case) => {
                tracing::info!(
                    arrival = due.id,
                    case = case.short(),
                    "a series became a layer"
                );
            }
            Outcome::Nothing(failure) => {
                let reason = failure.name.as_str();
                tracing::info!(arrival = due.id, reason, "a series became nothing");
            }
            Outcome::Later(_) => tracing::warn!(arrival = due.id, "a series will be read later"),
        }
        if !store.settle(&due, &outcome).await? {
            tracing::info!(arrival = due.id, "more images of a series came meanwhile");
        }
        Ok(true)
    }

    async fn forget_arrivals(&self, options: &ArrivalOptions) -> Result<(), StoreError> {
        let store = self.store();
        let forgotten = store.forget_arrivals(options.keep, options.keep_source);
        let forgotten = forgotten.await?;
        if forgotten > 0 {
            self.store().collect().await?;
        }
        Ok(())
    }

    async fn outcome(&self, due: &DueSeries, options: &ArrivalOptions) -> Outcome {
        match self.make_case(due, options).await {
            Ok(outcome) => outcome,
            Err(Error::Failure(failure)) if is_about_the_series(&failure) => {
                Outcome::Nothing(failure)
            }
            Err(error) => {
                tracing::warn!(arrival = due.id, %error, "a series cannot be read now");
                Outcome::Later(RETRY_AFTER)
            }
        }
    }

    async fn make_case(&self, due: &DueSeries, options: &ArrivalOptions) -> Result<Outcome, Error> {
        let directory = self.store().spool_directory().await?;
        if !copy_objects(self.store(), &due.instances, &directory).await? {
            return Ok(Outcome::Nothing(images_lost()));
        }
        let files = VolumeFiles::Dicom(directory);
        let (upload, choice) = self
            // Images have lost the identity of the patient when they came, if it is not to be kept.
            .read_upload(files, None, &Options::default(), None, false)
            .await?;
        let is_t1 = choice.is_some_and(|choice| choice.is_t1);
        if options.series == SeriesRule::T1 && !is_t1 {
            let layer = self.make_layer(due).await?;
            return Ok(layer.unwrap_or_else(|| Outcome::Nothing(not_t1())));
        }
        // A version is prepared as the case that it is one of.
        let previous = match &due.previous {
            Some(id) => self.store().case(id).await?,
            None => None,
        };
        let (of, parameters) = match previous {
            // Layers, findings and the label stay with the patient whom they are about.
            Some(case) if !self.is_of_patient(&upload, &case.id).await? => {
                let name = None;
                (
                    None,
                    Parameters {
                        name,
                        ..case.parameters
                    },
                )
            }
            Some(case) => (Some(case.id), case.parameters),
            None => (None, Parameters::default()),
        };
        let submitted = self.submit_after(upload, parameters, of).await?;
        Ok(Outcome::Case(submitted.case.id))
    }
}

impl Cases {
    /// Makes a layer of a series; `None` if there is no case of its study that could have it.
    async fn make_layer(&self, due: &DueSeries) -> Result<Option<Outcome>, Error> {
        let study = SeriesQuery::Study(due.uids.study.clone(), None);
        let heads = self.heads(&study).await?.into_iter();
        let mut usable = heads.filter(|head| head.case.state != CaseState::Failed);
        let Some(case) = usable.next().map(|head| head.case.id) else {
            return Ok(None);
        };
        let directory = self.store().spool_directory().await?;
        if !copy_objects(self.store(), &due.instances, &directory).await? {
            return Ok(Some(Outcome::Nothing(images_lost())));
        }
        let new = NewLayer {
            case,
            volume: VolumeFiles::Dicom(directory),
            options: Options {
                purpose: Purpose::Layer,
                ..Options::default()
            },
            name: None,
            kind: None,
            unit: None,
            parameters: LayerParameters::default(),
            client: None,
        };
        let outcome = match self.add_layer_of(new, false).await {
            Ok(_) => Outcome::Layer(case),
            Err(Error::TooManyLayers { .. }) => Outcome::Nothing(Failure::unusable(
                "too-many-layers",
                "the case of the study has as many layers as it may have",
            )),
            Err(error) => return Err(error),
        };
        Ok(Some(outcome))
    }
}

/// Whether a failure will be the same the next time.
fn is_about_the_series(failure: &Failure) -> bool {
    !matches!(
        failure.kind,
        FailureKind::Cancelled | FailureKind::Internal | FailureKind::OutOfMemory
    )
}

fn images_lost() -> Failure {
    Failure::unusable(
        "images-lost",
        "a stored image of the series is missing or damaged; send the series again",
    )
}

fn not_t1() -> Failure {
    Failure::unusable(
        NOT_T1,
        "the series is not T1-weighted, according to its names and timing, and there is no case of its study that it could be a layer of",
    )
}
