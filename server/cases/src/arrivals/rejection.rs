//! Rejection notes of the PACS (IHE RAD, Imaging Object Change Management).

use case::{CaseId, Failure, Layer, LayerId};
use imaging::dicom::Attributes;
use storage::StoreError;
use storage::arrivals::{ArrivalSource, REJECTED, Rejection, SeriesQuery, SeriesUids, Uid};

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
            layers += self.remove_layers_made_of(uids, Some(instances)).await?;
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

    /// Removes the layers that are of a series from the cases of its study.
    pub(super) async fn remove_layers_of(&self, uids: &SeriesUids) -> Result<(), StoreError> {
        self.remove_layers_made_of(uids, None).await.map(drop)
    }

    /// As [`Cases::remove_layers_of`], those alone that were made of one of these images, if any are named. Returns how many.
    async fn remove_layers_made_of(
        &self,
        uids: &SeriesUids,
        instances: Option<&[Uid]>,
    ) -> Result<usize, StoreError> {
        let mut removed = 0;
        let study = SeriesQuery::Study(uids.study.clone(), None);
        for series in self.store().cases_of(&study).await? {
            for layer in self.store().layers(&series.case).await? {
                let source = self.source_of_layer(&series.case, &layer, uids).await?;
                let is_named = source.is_some_and(|source| {
                    instances.is_none_or(|instances| is_made_of(&source, instances))
                });
                if is_named {
                    self.store().delete_layer(&series.case, &layer.id).await?;
                    removed += 1;
                }
            }
        }
        Ok(removed)
    }

    /// Removes the layers that are of a series from a case, all but one.
    pub(crate) async fn remove_other_layers_of(
        &self,
        uids: &SeriesUids,
        case: &CaseId,
        kept: &LayerId,
    ) -> Result<(), StoreError> {
        for layer in self.store().layers(case).await? {
            let is_other = *kept != layer.id;
            if is_other && self.source_of_layer(case, &layer, uids).await?.is_some() {
                self.store().delete_layer(case, &layer.id).await?;
            }
        }
        Ok(())
    }

    /// The source of a layer, if it is of a series.
    async fn source_of_layer(
        &self,
        case: &CaseId,
        layer: &Layer,
        uids: &SeriesUids,
    ) -> Result<Option<Attributes>, StoreError> {
        let objects = self.store().layer_objects(case, &layer.id).await?;
        let source = self.attributes_among(case, &objects).await?;
        Ok(source.filter(|source| source.value("SeriesInstanceUID") == Some(uids.series.as_str())))
    }
}

/// Whether a volume was made of one of these images.
fn is_made_of(source: &Attributes, instances: &[Uid]) -> bool {
    let mut images = source.instances.iter();
    images.any(|image| {
        let mut instances = instances.iter();
        instances.any(|uid| uid.as_str() == image.sop_instance_uid)
    })
}
