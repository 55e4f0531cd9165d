//! Reads series that are due, and makes cases or layers of them.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use case::images::Image;
use case::series::{SeriesQuery, SeriesUids};
use case::{
    CaseId, CaseState, Failure, FailureKind, JobKind, LayerId, LayerParameters, MaskSource,
    Parameters,
};
use cases::dicom::{Options, Purpose, copy_objects};
use cases::layers::ReceivedLayer;
use cases::runner::{End, Failed, Runner, Running, Terms, Work};
use cases::{DailyWarning, Error, VolumeFiles, series_of};
use storage::tables::{layers, made, series};
use storage::upkeep::Removal;
use storage::{Count, Made, Store, StoreError, Unreadable, Upload};
use tempfile::TempDir;

use super::becomes::{Becomes, becomes};
use super::{ArrivalOptions, Arrivals, SeriesRule};
use crate::store::PacsStore;
use crate::values::{
    DueSeries, DueTerms, IMAGES_LOST, INCOMPLETE_CORRECTION, NO_CASE, NOT_T1, Outcome, SERIES,
    TakenAs, images_rejected,
};

/// How often to forget what came some days ago.
const FORGET_EVERY: Duration = Duration::from_secs(600);

/// How long to wait before the second attempt if the server, not the series, was the reason.
const RETRY_AFTER: Duration = Duration::from_secs(15);

/// How many times as long as for other series to wait for images that were announced.
const PATIENCE: u32 = 10;

/// Starts to read the series of a PACS on the current runtime, one at a time.
pub fn start_series_reader(arrivals: Arrivals, options: ArrivalOptions) -> Runner {
    let store = arrivals.store().clone();
    let work = Arc::new(ReadSeries { arrivals, options });
    let mut runner = Runner::start(store.store(), vec![vec![work]]);
    let warning = Arc::<DailyWarning>::default();
    runner.repeat(FORGET_EVERY, move || {
        forget(store.clone(), options.keep, Arc::clone(&warning))
    });
    runner
}

/// Reads one series that is due; `false` if there is none.
#[cfg(test)]
pub(super) async fn read_one_series(arrivals: &Arrivals, options: ArrivalOptions) -> bool {
    let arrivals = arrivals.clone();
    let store = arrivals.store().clone();
    cases::runner::once(store.store(), Arc::new(ReadSeries { arrivals, options })).await
}

/// Forgets what came some days ago, and results that were sent then. What waits is logged once a day.
async fn forget(store: PacsStore, keep: Duration, warning: Arc<DailyWarning>) {
    match store.forget(keep, Removal::Automatic).await {
        Ok(why) => {
            if let Some(why) = warning.to_say(why) {
                let [series, rejections] = match store.too_old(keep).await {
                    Ok(numbers) => numbers.map(Some),
                    Err(_) => [None; 2],
                };
                tracing::warn!(
                    series,
                    rejections,
                    "series older than pacs.keep_days, and rejections older than a year, stay: {}",
                    why.sentence()
                );
            }
        }
        Err(error) => tracing::warn!(
            error = &error as &dyn std::error::Error,
            "series and results of some days ago will be forgotten later"
        ),
    }
}

struct ReadSeries {
    arrivals: Arrivals,
    options: ArrivalOptions,
}

#[async_trait]
impl Work for ReadSeries {
    fn kind(&self) -> JobKind {
        SERIES
    }

    fn terms(&self) -> Terms {
        let options = self.arrivals.cases.store().options();
        Terms {
            max_attempts: options.max_attempts,
            retry_after: RETRY_AFTER,
            longest: options.longest_preparation,
        }
    }

    async fn run(&self, job: &Running) -> Result<End, Failed> {
        let (store, arrival) = (self.arrivals.store(), &job.claim.key);
        let Some(due) = store.series_to_read(&job.claim).await? else {
            return Ok(End::Done);
        };
        let outcome = self.arrivals.read_series(&due, &self.options).await?;
        match &outcome {
            Outcome::Case(case) => {
                tracing::info!(arrival, case = case.short(), "a series became a case");
            }
            Outcome::Layer(case) => {
                tracing::info!(arrival, case = case.short(), "a series became a layer");
            }
            Outcome::Nothing(failure) => {
                let reason = failure.name.as_str();
                tracing::info!(arrival, reason, "a series became nothing");
            }
        }
        if !store.settle(&job.claim, &outcome).await? {
            tracing::info!(arrival, "more images of a series came meanwhile");
        }
        Ok(End::Settled)
    }

    /// Queues the series for which nothing has come for a while.
    async fn look(&self, _: &Store) -> Result<(), StoreError> {
        let terms = DueTerms {
            stable: self.options.stable,
            patience: self.options.stable * PATIENCE,
        };
        let store = self.arrivals.store();
        store.queue_due_series(&terms).await.map(drop)
    }
}

impl Arrivals {
    /// What a series becomes.
    async fn read_series(
        &self,
        due: &DueSeries,
        options: &ArrivalOptions,
    ) -> Result<Outcome, Failed> {
        match self.make_case(due, options).await {
            Ok(outcome) => Ok(outcome),
            Err(Error::Failure(failure)) if is_about_the_series(&failure) => {
                Ok(Outcome::Nothing(failure))
            }
            Err(Error::Failure(failure)) => Err(Failed::ForNow(failure)),
            Err(Error::Store(error)) => Err(error.into()),
            Err(error) => {
                tracing::warn!(%error, "a series cannot be read now");
                let detail = "the server could not read the series";
                Err(Failed::ForNow(Failure::new(
                    FailureKind::Internal,
                    "reading-failed",
                    detail,
                )))
            }
        }
    }

    async fn make_case(&self, due: &DueSeries, options: &ArrivalOptions) -> Result<Outcome, Error> {
        if due.images.is_empty() {
            return Ok(Outcome::Nothing(images_rejected()));
        }
        let directory = self.cases.store().spools().directory().await?;
        if !self.copy_images(due, &directory).await? {
            return Ok(Outcome::Nothing(images_damaged()));
        }
        let files = VolumeFiles::Dicom(directory);
        let (mut upload, choice) = self
            .cases
            // Images have lost the identity of the patient when they came, if it is not to be kept.
            .read_upload(files, None, &reading(due), false)
            .await?;
        // What comes meanwhile has come again.
        let times: HashMap<_, _> = (due.images.iter())
            .map(|image| (&image.uid, image.times))
            .collect();
        for image in &mut upload.images {
            image.times = times.get(&image.uid).copied().unwrap_or(0);
        }
        let is_t1 = choice.is_some_and(|choice| choice.is_t1);
        let (is_case, otherwise) = match due.taken.map(|taken| taken.kind) {
            Some(TakenAs::Case) => (true, not_t1()),
            Some(TakenAs::Layer) => (false, no_case()),
            None => (options.series == SeriesRule::Any || is_t1, not_t1()),
        };
        if !is_case {
            let layer = self.make_layer(due, &upload).await?;
            return Ok(layer.unwrap_or(Outcome::Nothing(otherwise)));
        }
        let made = self.store().made_of_any(&upload.images).await?;
        let (of, parameters) = match becomes(
            &upload.images,
            &made,
            due.taken.is_some() && !due.is_corrected,
        ) {
            Becomes::Known(case) => {
                let attributes = self.cases.attributes_of(&case).await?;
                let (mut transaction, _) = self.cases.store().write().await?;
                // It may have been made before its series was written with it.
                if let Some(of) = attributes.as_ref().and_then(series_of) {
                    series::index(&mut transaction, &case, &of).await?;
                }
                // From now on they have not come again.
                made::make(&mut transaction, &Made::case(&case), &upload.images).await?;
                transaction.commit().await?;
                return Ok(Outcome::Case(case));
            }
            Becomes::Incomplete { again, of } => {
                return Ok(Outcome::Nothing(incomplete_correction(again, of)));
            }
            Becomes::New(None) => (None, Parameters::default()),
            // A version uses the parameters of its original.
            Becomes::New(Some(of)) => {
                let parameters = self.cases.case(&of).await?.parameters;
                (Some(of), self.of_whole_series(parameters))
            }
        };
        let submitted = self.cases.submit_after(upload, parameters, of).await?;
        Ok(Outcome::Case(submitted.case.id))
    }

    /// Copies the images of a series; `false` if one is damaged.
    ///
    /// # Errors
    /// [`StoreError::SourceMissing`] if one is missing, or an error of the store.
    async fn copy_images(&self, due: &DueSeries, directory: &TempDir) -> Result<bool, Error> {
        let images: Vec<_> = due.images.iter().map(|image| image.object).collect();
        if copy_objects(self.cases.store(), &images, directory).await? {
            return Ok(true);
        }
        for image in &images {
            if let Err(Unreadable::Missing) = self.cases.store().object(image).await {
                self.cases.store().signals().count(Count::MissingSource);
                return Err(StoreError::SourceMissing.into());
            }
        }
        Ok(false)
    }

    /// The parameters of a version. Without a network, `pruning` is what became of `auto`, and the whole series may be skull-stripped although
    /// a part of it did not look so.
    fn of_whole_series(&self, parameters: Parameters) -> Parameters {
        let mask = match parameters.mask {
            MaskSource::Pruning if !self.cases.library.has_network() => MaskSource::Auto,
            mask => mask,
        };
        Parameters { mask, ..parameters }
    }

    /// Makes a layer of a series; `None` if there is no case of its study and its patient that could have it.
    async fn make_layer(&self, due: &DueSeries, upload: &Upload) -> Result<Option<Outcome>, Error> {
        let study = SeriesQuery::Study(due.uids.study.clone(), None);
        let heads = self.heads(&study).await?.into_iter();
        let (mut of_patient, mut is_another_here) = (None, false);
        for head in heads.filter(|head| head.case.state != CaseState::Failed) {
            match self.cases.is_of_patient(upload, &head.case.id).await? {
                Some(true) => {
                    of_patient = Some(head.case.id);
                    break;
                }
                Some(false) => is_another_here = true,
                None => {}
            }
        }
        let Some(case) = of_patient else {
            return Ok(is_another_here.then(|| Outcome::Nothing(case_of_another_patient(due))));
        };
        let directory = self.cases.store().spools().directory().await?;
        if !self.copy_images(due, &directory).await? {
            return Ok(Some(Outcome::Nothing(images_damaged())));
        }
        let new = ReceivedLayer {
            case,
            volume: VolumeFiles::Dicom(directory),
            options: Options {
                purpose: Purpose::Layer,
                ..reading(due)
            },
            name: None,
            kind: None,
            unit: None,
            parameters: LayerParameters::default(),
        };
        let outcome = match self.cases.add_layer_of(new, false).await {
            Ok((added, _)) => {
                // Of fewer images than have come since.
                self.remove_smaller_layers_of(&due.uids, &case, &added.layer.id)
                    .await?;
                Outcome::Layer(case)
            }
            Err(Error::Store(StoreError::TooManyLayers)) => Outcome::Nothing(Failure::unusable(
                "too-many-layers",
                "the case of the study has as many layers as it may have",
            )),
            Err(error) => return Err(error),
        };
        Ok(Some(outcome))
    }
}

impl Arrivals {
    /// Removes the open layers of a case that are made of fewer images of a series than another one, but for that. What shows them stays
    /// valid.
    async fn remove_smaller_layers_of(
        &self,
        uids: &SeriesUids,
        case: &CaseId,
        kept: &LayerId,
    ) -> Result<(), StoreError> {
        let open = self.cases.store().layers(case).await?.into_iter();
        let open: Vec<_> = open.filter(|layer| layer.closed.is_none()).collect();
        let mut connection = self.cases.store().connect().await?;
        let all = made::of(&mut connection, &Made::layer(case, kept)).await?;
        let of_series = layers::of_series(&mut connection, &uids.series).await?;
        drop(connection);
        let has = |image: &Image| {
            let mut all = all.iter().filter(|known| known.uid == image.uid);
            all.any(|known| known.fingerprint.is_same(&image.fingerprint))
        };
        for (of, layer) in of_series {
            let is_open = open.iter().any(|open| open.id == layer);
            if of != *case || layer == *kept || !is_open {
                continue;
            }
            let made = Made::layer(case, &layer);
            let some = made::of(&mut self.cases.store().connect().await?, &made).await?;
            if some.len() < all.len() && some.iter().all(has) {
                self.cases.store().delete((case, &layer)).await?;
            }
        }
        Ok(())
    }
}

/// How the images of a series are read.
fn reading(due: &DueSeries) -> Options {
    Options {
        allow_gaps: due.taken.is_some_and(|taken| taken.allow_gaps),
        ..Options::default()
    }
}

/// Whether a failure will be the same the next time.
fn is_about_the_series(failure: &Failure) -> bool {
    !matches!(
        failure.kind,
        FailureKind::Cancelled | FailureKind::Internal | FailureKind::OutOfMemory
    )
}

fn incomplete_correction(again: usize, of: usize) -> Failure {
    let detail = format!(
        "the PACS has corrected or rejected images of a case of this series, and {again} of its {of} images came again since; send the whole \
         series, or take what is here"
    );
    Failure::unusable(INCOMPLETE_CORRECTION, detail)
}

fn images_damaged() -> Failure {
    Failure::unusable(
        IMAGES_LOST,
        "a stored image of the series is damaged; send the series again",
    )
}

fn no_case() -> Failure {
    Failure::unusable(
        NO_CASE,
        "there is no case of the study that the series could be a layer of; take a T1-weighted series of it first",
    )
}

/// It may become a layer when a case of its own patient comes, as any other that is refused for want of a case.
fn case_of_another_patient(due: &DueSeries) -> Failure {
    let detail =
        "the case of its study is of another patient, so the series cannot be a layer of it";
    match due.taken {
        Some(_) => Failure::unusable(NO_CASE, detail),
        None => Failure::unusable(
            NOT_T1,
            format!(
                "the series is not T1-weighted, according to its names and timing, and {detail}"
            ),
        ),
    }
}

fn not_t1() -> Failure {
    Failure::unusable(
        NOT_T1,
        "the series is not T1-weighted, according to its names and timing, and there is no case of its study that it could be a layer of",
    )
}

#[cfg(test)]
mod tests;
