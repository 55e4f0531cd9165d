//! Rejection notes of the PACS (IHE RAD, Imaging Object Change Management).

use case::{CaseId, Failure, Layer, LayerId, ObjectKind};
use storage::arrivals::{ArrivalSource, REJECTED, Rejection, SeriesQuery, SeriesUids};
use storage::{StoreError, Unreadable};

use crate::application::Cases;
use crate::error::Error;

/// Why a series became nothing.
pub(super) fn reason() -> Failure {
    Failure::unusable(REJECTED, "the PACS has rejected images of the series")
}

impl Cases {
    /// Withdraws what a note names: images are forgotten, cases of their series superseded, and layers removed.
    pub(super) async fn reject(
        &self,
        rejection: &Rejection,
        source: ArrivalSource,
    ) -> Result<(), Error> {
        self.store().reject(rejection, source, &reason()).await?;
        for (uids, _) in &rejection.series {
            self.remove_layers_of(uids).await?;
        }
        let series = rejection.series.len();
        tracing::warn!(
            series,
            "a rejection note came, and what it names is withdrawn"
        );
        Ok(())
    }

    /// Removes the layers that are of a series from the cases of its study.
    pub(super) async fn remove_layers_of(&self, uids: &SeriesUids) -> Result<(), StoreError> {
        let study = SeriesQuery::Study(uids.study.clone(), None);
        for series in self.store().cases_of(&study).await? {
            self.remove_other_layers_of(uids, &series.case, None)
                .await?;
        }
        Ok(())
    }

    /// Removes the layers that are of a series from a case, all but one.
    pub(crate) async fn remove_other_layers_of(
        &self,
        uids: &SeriesUids,
        case: &CaseId,
        kept: Option<&LayerId>,
    ) -> Result<(), StoreError> {
        for layer in self.store().layers(case).await? {
            if kept != Some(&layer.id) && self.is_layer_of(case, &layer, uids).await? {
                self.store().delete_layer(case, &layer.id).await?;
            }
        }
        Ok(())
    }

    async fn is_layer_of(
        &self,
        case: &CaseId,
        layer: &Layer,
        uids: &SeriesUids,
    ) -> Result<bool, StoreError> {
        let objects = self.store().layer_objects(case, &layer.id).await?;
        let source = objects
            .iter()
            .find(|name| name.kind == ObjectKind::SourceDicom);
        let Some(source) = source else {
            return Ok(false);
        };
        let stored = match self.store().object(source).await {
            Ok(stored) => stored,
            Err(Unreadable::Store(error)) => return Err(error.into()),
            Err(_) => return Ok(false),
        };
        let attributes = pipeline::attributes(&stored).map(|stored| stored.attributes);
        Ok(attributes.is_ok_and(|attributes| {
            let mut attributes = attributes.iter();
            attributes
                .any(|(name, value)| name == "SeriesInstanceUID" && value == uids.series.as_str())
        }))
    }
}
