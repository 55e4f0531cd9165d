//! Reads series that are due, and makes cases or layers of them.

use std::collections::HashSet;
use std::time::Duration;

use async_trait::async_trait;
use case::{
    Case, CaseId, CaseState, Failure, FailureKind, JobKind, LayerParameters, MaskSource,
    ObjectKind, Parameters,
};
use storage::arrivals::{DueTerms, NO_CASE, NOT_T1, Outcome, SeriesQuery, TakenAs};
use storage::{Count, DueSeries, Store, StoreError, Unreadable, Upload};
use tempfile::TempDir;

use crate::application::Cases;
use crate::arrivals::{ArrivalOptions, Patient, SeriesRule};
use crate::dicom::{Options, Purpose, copy_objects};
use crate::error::Error;
use crate::intake::VolumeFiles;
use crate::layers::ReceivedLayer;
use crate::runner::{End, Failed, Running, Terms, Work};

/// How long to wait before the second attempt if the server, not the series, was the reason.
const RETRY_AFTER: Duration = Duration::from_secs(15);

/// How many times as long as for other series to wait for images that were announced.
const PATIENCE: u32 = 10;

pub(super) struct ReadSeries {
    pub(super) cases: Cases,
    pub(super) options: ArrivalOptions,
}

#[async_trait]
impl Work for ReadSeries {
    fn kind(&self) -> JobKind {
        JobKind::SERIES
    }

    fn terms(&self) -> Terms {
        let options = self.cases.store().options();
        Terms {
            max_attempts: options.max_attempts,
            retry_after: RETRY_AFTER,
            longest: options.longest_preparation,
        }
    }

    async fn run(&self, job: &Running) -> Result<End, Failed> {
        let (store, arrival) = (self.cases.store(), &job.claim.key);
        let Some(due) = store.series_to_read(&job.claim).await? else {
            return Ok(End::Done);
        };
        let outcome = self.cases.read_series(&due, &self.options).await?;
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
    async fn look(&self, store: &Store) -> Result<(), StoreError> {
        let terms = DueTerms {
            stable: self.options.stable,
            patience: self.options.stable * PATIENCE,
        };
        store.queue_due_series(&terms).await.map(drop)
    }
}

impl Cases {
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
            Err(Error::SourceMissing) => Err(StoreError::SourceMissing.into()),
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
        let directory = self.store().spool_directory().await?;
        if !self.copy_images(due, &directory).await? {
            return Ok(Outcome::Nothing(images_damaged()));
        }
        let previous = self.previous(due).await?;
        if let Some(before) = &previous
            && due.previous.is_none()
        {
            self.compare_patients(due, &before.id).await?;
        }
        // Nor may a layer stay under the name of another patient, even if these images make no volume.
        self.remove_layers_of_others(&due.uids, &due.instances)
            .await?;
        let files = VolumeFiles::Dicom(directory);
        let (upload, choice) = self
            // Images have lost the identity of the patient when they came, if it is not to be kept.
            .read_upload(files, None, &reading(due), false)
            .await?;
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
        // A version uses the parameters of its original.
        let previous = match previous {
            Some(case) => Some((self.is_of_patient(&upload, &case.id).await?, case)),
            None => None,
        };
        let (of, parameters) = match previous {
            // Layers, findings and the label stay with the patient whom they are about.
            Some((is_same, case)) if is_same != Some(true) => {
                // Known since the images came, unless those before them are not kept any more.
                if is_same == Some(false) {
                    self.store().correct_series_of(&case.id).await?;
                }
                let parameters = Parameters {
                    name: None,
                    ..case.parameters
                };
                (None, parameters)
            }
            Some((_, case)) => {
                // Neither may findings and layers stay where they lay, if the images lie elsewhere now.
                if self.is_moved_since(&upload, &case).await? {
                    self.store().move_case(&case.id).await?;
                }
                (
                    Some(self.newest_of_same_images(&case.id, due).await?),
                    case.parameters,
                )
            }
            None => (None, Parameters::default()),
        };
        let parameters = self.of_whole_series(parameters);
        let submitted = self.submit_after(upload, parameters, of).await?;
        // A correction that came while the images were read has found no case to supersede.
        if self.is_changed(due).await? {
            self.store().move_case(&submitted.case.id).await?;
        }
        Ok(Outcome::Case(submitted.case.id))
    }

    /// Copies the images of a series; `false` if one is damaged.
    ///
    /// # Errors
    /// [`Error::SourceMissing`] if one is missing, or an error of the store.
    async fn copy_images(&self, due: &DueSeries, directory: &TempDir) -> Result<bool, Error> {
        if copy_objects(self.store(), &due.instances, directory).await? {
            return Ok(true);
        }
        for image in &due.instances {
            if let Err(Unreadable::Missing) = self.store().object(image).await {
                self.store().signals().count(Count::MissingSource);
                return Err(Error::SourceMissing);
            }
        }
        Ok(false)
    }

    /// Whether any image of a series was corrected or rejected since it was copied.
    async fn is_changed(&self, due: &DueSeries) -> Result<bool, StoreError> {
        let images = self.store().images_of(&due.uids).await?.into_iter();
        let images: HashSet<_> = images.map(|(_, image)| image.digest).collect();
        let mut copied = due.instances.iter();
        Ok(copied.any(|image| !images.contains(&image.digest)))
    }
}

impl Cases {
    /// The case that a series became before, also if it was forgotten since that it did. A case of which it became a layer is of another
    /// series.
    async fn previous(&self, due: &DueSeries) -> Result<Option<Case>, StoreError> {
        let series = SeriesQuery::Study(due.uids.study.clone(), Some(due.uids.series.clone()));
        let mut before = self.store().cases_of(&series).await?.into_iter();
        let before = match &due.previous {
            Some(id) => before.find(|before| before.case == *id),
            None => before.find(|before| before.is_received),
        };
        match before {
            Some(before) => self.store().case(&before.case).await,
            None => Ok(None),
        }
    }

    /// Notes that a series is of another patient than the case that it became before it was forgotten, if an image of that case has come
    /// again and states another one. All others may still be missing.
    async fn compare_patients(&self, due: &DueSeries, before: &CaseId) -> Result<(), Error> {
        let Some(source) = self.attributes_of(before).await? else {
            return Ok(());
        };
        let known: HashSet<_> = (source.instances.iter())
            .map(|image| image.sop_instance_uid.as_str())
            .collect();
        let images = self.store().images_of(&due.uids).await?.into_iter();
        let again: Vec<_> = images
            .filter(|(uid, _)| known.contains(uid.as_str()))
            .map(|(_, image)| image)
            .collect();
        let held = Patient::of(|keyword| source.value(keyword));
        if self.states_another(&again, &held).await? {
            self.store().correct_series_of(before).await?;
        }
        Ok(())
    }

    /// The parameters of a version. Without a network, `pruning` is what became of `auto`, and the whole series may be skull-stripped although
    /// a part of it did not look so.
    fn of_whole_series(&self, parameters: Parameters) -> Parameters {
        let mask = match parameters.mask {
            MaskSource::Pruning if !self.library.has_network() => MaskSource::Auto,
            mask => mask,
        };
        Parameters { mask, ..parameters }
    }

    /// The newest ready version of the images of a case, which readers see: it may have another mask, and what they marked there.
    async fn newest_of_same_images(
        &self,
        of: &CaseId,
        due: &DueSeries,
    ) -> Result<CaseId, StoreError> {
        let images = async |case: &CaseId| {
            let names = self.store().case_objects(case).await?.into_iter();
            let kinds = [ObjectKind::SourceVolume, ObjectKind::SourceDicom];
            let mut images: Vec<_> = names.filter(|name| kinds.contains(&name.kind)).collect();
            images.sort_by_key(|name| name.kind.name());
            Ok::<_, StoreError>(images)
        };
        let own = images(of).await?;
        let series = SeriesQuery::Study(due.uids.study.clone(), Some(due.uids.series.clone()));
        for version in self.store().cases_of(&series).await? {
            let case = self.store().case(&version.case).await?;
            let is_ready = case.is_some_and(|case| case.state == CaseState::Ready);
            if is_ready && images(&version.case).await? == own {
                return Ok(version.case);
            }
        }
        Ok(*of)
    }

    /// Makes a layer of a series; `None` if there is no case of its study and its patient that could have it.
    async fn make_layer(&self, due: &DueSeries, upload: &Upload) -> Result<Option<Outcome>, Error> {
        let study = SeriesQuery::Study(due.uids.study.clone(), None);
        let heads = self.heads(&study).await?.into_iter();
        let (mut of_patient, mut is_another_here) = (None, false);
        for head in heads.filter(|head| head.case.state != CaseState::Failed) {
            match self.is_of_patient(upload, &head.case.id).await? {
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
        let directory = self.store().spool_directory().await?;
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
        let outcome = match self.add_layer_of(new, false).await {
            Ok((added, _)) => {
                // Of fewer images than have come since.
                self.remove_other_layers_of(&due.uids, &case, &added.layer.id)
                    .await?;
                // A correction that came while the images were read has found no layer to remove.
                if self.is_changed(due).await? {
                    self.remove_layers_of(&due.uids).await?;
                }
                Outcome::Layer(case)
            }
            Err(Error::TooManyLayers { .. }) => Outcome::Nothing(Failure::unusable(
                "too-many-layers",
                "the case of the study has as many layers as it may have",
            )),
            Err(error) => return Err(error),
        };
        Ok(Some(outcome))
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

fn images_damaged() -> Failure {
    Failure::unusable(
        "images-lost",
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
mod tests {
    use std::path::Path;

    use storage::Spooled;
    use storage::arrivals::{ArrivalSource, Change, NewInstance, SeriesUids, Superseded, Uid};

    use super::*;
    use crate::arrivals::tests::application;

    /// The UIDs of the series of a head, and of one that is a layer of it.
    const SERIES: [&str; 2] = ["1.2.3", "1.2.4"];

    fn uid(text: &str) -> Uid {
        Uid::parse(text).unwrap()
    }

    /// A server whose child copies a volume and its description from a folder.
    struct Setup {
        cases: Cases,
        folder: TempDir,
    }

    async fn setup() -> Setup {
        let folder = tempfile::tempdir().unwrap();
        let volume = pipeline::testing::nifti(&pipeline::testing::phantom().volume);
        let room = vec![0; Spooled::START as usize];
        let file = [&room[..], &volume].concat();
        std::fs::write(folder.path().join("volume.nii.gz"), file).unwrap();
        let store = Store::in_memory(crate::testing::options()).await.unwrap();
        Setup {
            cases: application(store, &copy_from(folder.path())),
            folder,
        }
    }

    fn copy_from(folder: &Path) -> String {
        format!(
            r#"order=$(/bin/cat); output=${{order#*\"output\":\"}}; /bin/cp {}/* "${{output%%\"*}}""#,
            folder.display()
        )
    }

    impl Setup {
        async fn receive(&self, series: &str, content: &'static str, replaces: Option<Change>) {
            let store = self.cases.store();
            let file = store.spool_all(content.into()).await.unwrap();
            let image = NewInstance {
                uids: SeriesUids {
                    study: uid("1.2"),
                    series: uid(series),
                },
                accession_number: None,
                sop_instance_uid: uid(&format!("{series}.1")),
                digest: *file.digest(),
                label: None,
                replaces,
            };
            let received = store.receive(vec![(image, file)], ArrivalSource::CStore);
            received.await.unwrap();
        }

        /// The case that a series becomes, or of which it becomes a layer. It may be corrected after a worker has taken it.
        async fn read(&self, series: &str, rule: SeriesRule, is_corrected: bool) -> CaseId {
            let outcome = serde_json::json!({"read": {
                "attributes": {
                    "attributes": [
                        ["PatientID", "P-1"],
                        ["StudyInstanceUID", "1.2"],
                        ["SeriesInstanceUID", series],
                    ],
                    "instances": [],
                    "interpolated_slices": [],
                },
                "series": {
                    "number": 1,
                    "modality": "MR",
                    "name": "FLAIR",
                    "size": [9, 9, 9],
                    "is_volume": true,
                    "token": "01234567",
                },
                "is_t1": false,
                "others": [],
                "ignored_files": 0,
                "unread": [],
            }});
            let file = self.folder.path().join("outcome.json");
            std::fs::write(file, outcome.to_string()).unwrap();
            self.receive(series, "an image", None).await;
            let store = self.cases.store();
            let terms = DueTerms {
                stable: Duration::ZERO,
                patience: Duration::ZERO,
            };
            assert_eq!(store.queue_due_series(&terms).await.unwrap(), 1);
            let claim = store.claim(JobKind::SERIES, 3).await.unwrap().unwrap();
            let due = store.series_to_read(&claim).await.unwrap().unwrap();
            if is_corrected {
                // The file of the image stays, as if it had been copied before the correction.
                self.receive("1.2.5", "an image", None).await;
                let change = Some(Change::Owner);
                self.receive(series, "a correction", change).await;
            }
            let options = ArrivalOptions {
                series: rule,
                ..ArrivalOptions::default()
            };
            let outcome = self.cases.read_series(&due, &options).await.unwrap();
            assert_eq!(store.settle(&claim, &outcome).await.unwrap(), !is_corrected);
            match outcome {
                Outcome::Case(case) | Outcome::Layer(case) => case,
                Outcome::Nothing(failure) => panic!("{failure:?}"),
            }
        }
    }

    #[tokio::test]
    async fn a_correction_during_the_reading_supersedes_the_case_of_the_images_before_it() {
        for is_corrected in [false, true] {
            let setup = setup().await;
            let case = setup.read(SERIES[0], SeriesRule::Any, is_corrected).await;
            let series = setup.cases.store().series_of(&case).await.unwrap();
            let expected = is_corrected.then_some(Superseded::Moved);
            assert_eq!(series.unwrap().superseded, expected);
        }
    }

    #[tokio::test]
    async fn a_correction_during_the_reading_removes_the_layer_of_the_images_before_it() {
        for is_corrected in [false, true] {
            let setup = setup().await;
            let head = setup.read(SERIES[0], SeriesRule::Any, false).await;
            let case = setup.read(SERIES[1], SeriesRule::T1, is_corrected).await;
            assert_eq!(case, head);
            let layers = setup.cases.store().layers(&head).await.unwrap();
            assert_eq!(layers.len(), usize::from(!is_corrected));
        }
    }
}
