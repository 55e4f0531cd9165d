//! Rejection notes of the PACS (IHE RAD, Imaging Object Change Management).

use case::{CaseId, Failure, LayerId};
use imaging::dicom::Attributes;
use storage::arrivals::{ArrivalSource, REJECTED, Rejection, SeriesQuery, SeriesUids, Uid};
use storage::{ObjectName, StoreError};

use super::Patient;
use crate::application::Cases;
use crate::error::Error;

/// Why a series became nothing.
pub(super) fn reason() -> Failure {
    Failure::unusable(REJECTED, "the PACS has rejected images of the series")
}

impl Cases {
    /// Withdraws what a note names: images are forgotten, cases that were made of them superseded, and layers removed. Images of the
    /// same series that it does not name stay.
    pub(super) async fn reject(
        &self,
        rejection: &Rejection,
        source: ArrivalSource,
    ) -> Result<(), Error> {
        let mut cases = Vec::new();
        for (uids, instances) in &rejection.series {
            cases.extend(self.cases_made_of(uids, instances).await?);
        }
        let store = self.store();
        let images = store.reject(rejection, source, &reason(), &cases).await?;
        let mut layers = 0;
        for (uids, instances) in &rejection.series {
            layers += self.remove_layers_made_of(uids, instances).await?;
            self.withdraw_results_of(uids).await?;
        }
        let cases = cases.len();
        match images + cases + layers {
            0 => tracing::warn!("a rejection note came that names nothing that is here"),
            _ => tracing::warn!(
                images,
                cases,
                layers,
                "a rejection note came, and what it names is withdrawn"
            ),
        }
        Ok(())
    }

    /// The cases of a series that were made of one of these images. One whose source is damaged counts.
    async fn cases_made_of(
        &self,
        uids: &SeriesUids,
        instances: &[Uid],
    ) -> Result<Vec<CaseId>, StoreError> {
        let series = SeriesQuery::Study(uids.study.clone(), Some(uids.series.clone()));
        let mut cases = Vec::new();
        for series in self.store().cases_of(&series).await? {
            let source = self.attributes_of(&series.case).await?;
            if source.is_none_or(|source| is_made_of(&source, instances)) {
                cases.push(series.case);
            }
        }
        Ok(cases)
    }

    /// Removes the layers that are made of a series from all cases, also of other studies.
    pub(crate) async fn remove_layers_of(&self, uids: &SeriesUids) -> Result<(), StoreError> {
        for (case, layer) in self.store().layers_of_series(&uids.series).await? {
            self.withdraw_layer(&case, &layer).await?;
        }
        self.withdraw_results_of(uids).await
    }

    /// Ends results with layers of a series that had been replaced or deleted before its images were corrected or rejected.
    async fn withdraw_results_of(&self, uids: &SeriesUids) -> Result<(), StoreError> {
        let store = self.store();
        let sent = store
            .withdraw_results_of_series(&uids.series, &layer_withdrawn())
            .await?;
        warn_of_sent(sent);
        Ok(())
    }

    /// Removes layers that state another patient than any of these images of a series: those that are made of it, and those on its cases.
    pub(crate) async fn remove_layers_of_others(
        &self,
        uids: &SeriesUids,
        images: &[ObjectName],
    ) -> Result<(), Error> {
        let mut layers = self.store().layers_of_series(&uids.series).await?;
        let series = SeriesQuery::Study(uids.study.clone(), Some(uids.series.clone()));
        let held = self.store().cases_of(&series).await?.into_iter();
        for held in held.filter(|held| held.is_received) {
            let on_case = self.store().layers(&held.case).await?.into_iter();
            layers.extend(on_case.map(|layer| (held.case, layer.id)));
        }
        for (case, layer) in layers {
            let objects = self.store().layer_objects(&case, &layer).await?;
            let source = self.attributes_among(&case, &objects).await?;
            let stated = source.map(|source| Patient::of(|keyword| source.value(keyword)));
            if let Some(stated) = stated
                && self.states_another(images, &stated).await?
            {
                self.withdraw_layer(&case, &layer).await?;
            }
        }
        Ok(())
    }

    async fn withdraw_layer(&self, case: &CaseId, layer: &LayerId) -> Result<(), StoreError> {
        let sent = self
            .store()
            .withdraw_layer(case, layer, &layer_withdrawn())
            .await?;
        warn_of_sent(sent);
        Ok(())
    }

    /// As [`Cases::remove_layers_of`], those alone that were made of one of these images. One whose source is damaged counts.
    /// Returns how many.
    async fn remove_layers_made_of(
        &self,
        uids: &SeriesUids,
        instances: &[Uid],
    ) -> Result<usize, StoreError> {
        let mut removed = 0;
        for (case, layer) in self.store().layers_of_series(&uids.series).await? {
            let objects = self.store().layer_objects(&case, &layer).await?;
            let source = self.attributes_among(&case, &objects).await?;
            let is_named = source.is_none_or(|source| {
                let study = source.value("StudyInstanceUID");
                study == Some(uids.study.as_str()) && is_made_of(&source, instances)
            });
            if is_named {
                self.withdraw_layer(&case, &layer).await?;
                removed += 1;
            }
        }
        Ok(removed)
    }

    /// Removes the layers that are made of a series from a case, all but one, which has more images. What shows the others stays valid.
    pub(crate) async fn remove_other_layers_of(
        &self,
        uids: &SeriesUids,
        case: &CaseId,
        kept: &LayerId,
    ) -> Result<(), StoreError> {
        for (of, layer) in self.store().layers_of_series(&uids.series).await? {
            if of == *case && layer != *kept {
                self.store().delete_layer(case, &layer).await?;
            }
        }
        Ok(())
    }
}

fn warn_of_sent(results: usize) {
    if results > 0 {
        tracing::warn!(
            results,
            "results that were sent may show a layer whose images were corrected or rejected; withdraw them with a rejection note"
        );
    }
}

/// Why results that may show a layer are not sent.
fn layer_withdrawn() -> Failure {
    Failure::unusable(
        "layer-withdrawn",
        "a layer of its case was removed since, because the PACS has corrected or rejected its images, and the result may show it; request it again",
    )
}

/// Whether a volume was made of one of these images.
fn is_made_of(source: &Attributes, instances: &[Uid]) -> bool {
    let mut images = source.instances.iter();
    images.any(|image| {
        let mut instances = instances.iter();
        instances.any(|uid| uid.as_str() == image.sop_instance_uid)
    })
}
