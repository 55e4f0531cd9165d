//! The report of a reading: the findings of a case, their pictures and numbers, as one file that needs nothing from elsewhere.
//! Its contents are told once, and written as HTML or as PDF.

mod contents;
mod html;
mod pdf;
mod shots;
mod words;

use std::sync::Arc;

use bytes::Bytes;
use case::findings::Finding;
use case::{Case, CaseFacts, CaseId, Layer, LayerKind, MapName, QualityState};
use glam::DVec3;
use imaging::dicom::Attributes;
use pipeline::atlas::Gyri;
use pipeline::maps::NoMaps;
use serde::{Deserialize, Serialize};

pub use self::html::POLICY;
pub use self::words::Language;

use self::shots::{FindingPictures, Overview};
use crate::library::{LoadedMaps, MapsState};
use crate::pictures::{LayerRef, ready};
use crate::profile::{PointProfile, profile};
use crate::{Cases, Error};

/// What a report shows.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::IntoParams, utoipa::ToSchema), into_params(parameter_in = Query))]
#[serde(deny_unknown_fields)]
pub struct ReportQuery {
    /// The language: `en` or `pt-BR`.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub language: Language,
    /// Whether to name the patient and the study, if the case was created from DICOM. The report is patient data then.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", param(default = false))]
    pub patient: bool,
}

/// The form of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportFormat {
    /// HTML without scripts, to read, to print and to keep.
    Html,
    /// PDF, for archives and for paper.
    Pdf,
}

/// From where a report knows its patient.
#[derive(Debug, Clone, Copy)]
pub enum ReportSubject<'a> {
    /// From the files of the case.
    OfCase,
    /// From attributes of the patient and the study.
    Named(&'a Attributes),
}

/// Everything that a report shows.
struct Report {
    case: Case,
    facts: Arc<CaseFacts>,
    query: ReportQuery,
    /// Attributes of the patient and the study, for people; `None` unless requested.
    patient: Option<Vec<(&'static str, String)>>,
    maps: Result<Arc<LoadedMaps>, NoMaps>,
    /// The names of places, if there is an atlas that the head fits.
    gyri: Option<Arc<Gyri>>,
    /// The map of the newest FLAIR, if a layer is one.
    flair: Option<Result<Arc<LoadedMaps>, NoMaps>>,
    /// The acquired layer beside the anatomy, if there is one.
    layer: Option<ShownLayer>,
    /// Those to look at, with their pictures and numbers, in the order of the list.
    findings: Vec<ReportedFinding>,
    dismissed: Vec<Finding>,
    overview: Overview,
}

/// The acquired layer of a report.
struct ShownLayer {
    name: String,
    /// Whether nobody has checked that it lies where the anatomy does.
    may_lie_elsewhere: bool,
}

/// A finding with its pictures and numbers.
struct ReportedFinding {
    finding: Finding,
    pictures: FindingPictures,
    numbers: Option<Numbers>,
}

/// The values at a finding, and at its mirrored point if that is in the brain.
struct Numbers {
    own: PointProfile,
    mirrored: Option<PointProfile>,
}

/// The attributes of a patient and a study that a report names.
const PATIENT: [&str; 7] = [
    "PatientName",
    "PatientID",
    "IssuerOfPatientID",
    "PatientBirthDate",
    "PatientSex",
    "StudyDate",
    "AccessionNumber",
];

impl Cases {
    /// The report of the reading of a ready case. The same reading gives the same bytes.
    ///
    /// # Errors
    /// As [`Cases::ready`]; [`Error::LayerNotReady`] while its maps are computed; [`Error::Busy`] if too much work waits.
    pub async fn report(
        &self,
        id: &CaseId,
        query: ReportQuery,
        format: ReportFormat,
        subject: ReportSubject<'_>,
    ) -> Result<Bytes, Error> {
        let facts = self.ready(id).await?;
        let case = self.case(id).await?;
        let maps = found_or_reason(self.library.maps(id).await?)?;
        let flair = self.library.flair(id).await?;
        let flair = flair
            .map(|flair| found_or_reason(flair.state))
            .transpose()?;
        let gyri = self.gyri(id).await?;
        let layers = self.layers(id).await?;
        let layer = beside(&layers);
        let reference = layer.map(|(layer, _)| LayerRef::from(layer.id));
        let layer = layer.map(|(layer, quality)| ShownLayer {
            name: layer.name.clone(),
            may_lie_elsewhere: quality != QualityState::Ok,
        });
        let mut list = self.findings(id).await?.list;
        for finding in &mut list {
            // The atlas of today counts, not that of when it was written.
            let middle = DVec3::from_array(finding.middle_in_patient());
            finding.gyrus = gyri.as_ref().and_then(|gyri| gyri.at(middle));
        }
        let (dismissed, findings): (Vec<_>, Vec<_>) =
            (list.into_iter()).partition(|finding| finding.is_dismissed);
        let (pictures, overview) = shots::draw(
            self,
            id,
            &facts,
            &findings,
            reference.as_ref(),
            maps.is_ok(),
        )
        .await?;
        let mut reported = Vec::new();
        for (finding, pictures) in findings.into_iter().zip(pictures) {
            let numbers = self.numbers(id, &maps, &finding).await?;
            reported.push(ReportedFinding {
                finding,
                pictures,
                numbers,
            });
        }
        let patient = match (query.patient, subject) {
            (false, _) => None,
            (true, ReportSubject::OfCase) => Some(self.patient(id).await?),
            (true, ReportSubject::Named(attributes)) => Some(named(attributes)),
        };
        let report = Report {
            case,
            facts,
            query,
            patient,
            maps,
            gyri,
            flair,
            layer,
            findings: reported,
            dismissed,
            overview,
        };
        let write = move || {
            let contents = report.contents();
            match format {
                ReportFormat::Html => Ok(contents.html().into()),
                ReportFormat::Pdf => Ok(contents.pdf()?.into()),
            }
        };
        self.queue.run(write).await?
    }

    /// The values at a finding; `None` outside the envelope.
    async fn numbers(
        &self,
        id: &CaseId,
        maps: &Result<Arc<LoadedMaps>, NoMaps>,
        finding: &Finding,
    ) -> Result<Option<Numbers>, Error> {
        let model = self.model(id).await?;
        let maps = maps.clone();
        let position = DVec3::from_array(finding.middle_in_patient());
        let find = move || {
            let maps = maps.as_ref().map(|maps| &**maps).map_err(Clone::clone);
            profile([&model, &model], maps, &[], None, position)
        };
        match self.queue.run(find).await? {
            Ok(found) => Ok(Some(Numbers {
                own: found.own,
                mirrored: found.mirrored,
            })),
            Err(Error::Parameter { .. }) => Ok(None),
            Err(other) => Err(other),
        }
    }

    /// The attributes of the patient; none if the case was not created from DICOM.
    async fn patient(&self, id: &CaseId) -> Result<Vec<(&'static str, String)>, Error> {
        let Some(stored) = self.store().source_dicom(id).await? else {
            return Ok(Vec::new());
        };
        Ok(named(&pipeline::attributes(&stored)?))
    }
}

/// The maps, or the reason for none.
///
/// # Errors
/// [`Error::LayerNotReady`].
fn found_or_reason(state: MapsState) -> Result<Result<Arc<LoadedMaps>, NoMaps>, Error> {
    match state.found() {
        Ok(maps) => Ok(Ok(maps)),
        Err(Error::MapsUndefined(reason)) => Ok(Err(reason)),
        Err(other) => Err(other),
    }
}

/// The attributes of a patient and a study that a report names.
fn named(attributes: &Attributes) -> Vec<(&'static str, String)> {
    let value = |name: &&'static str| Some((*name, attributes.value(name)?.to_owned()));
    PATIENT.iter().filter_map(value).collect()
}

/// The acquired layer to show beside the anatomy, and how far its place can be trusted: a FLAIR before any other, one whose place
/// was checked before one whose was not, and none that certainly lies elsewhere.
fn beside(layers: &[Layer]) -> Option<(&Layer, QualityState)> {
    let usable = layers.iter().filter_map(|layer| {
        let quality = ready(layer).ok()?.placement.quality;
        let is_usable = layer.parameters.kind == LayerKind::Mr && quality != QualityState::Failed;
        is_usable.then_some((layer, quality))
    });
    let order = |(layer, quality): &(&Layer, QualityState)| {
        let is_flair = layer.is_flair() || layer.name.to_lowercase().contains("flair");
        (!is_flair, *quality != QualityState::Ok)
    };
    usable.min_by_key(order)
}

/// The map that shows a finding: the one in whose list it was found, if that lists the thickness; else that of blur.
fn map_of(finding: &Finding) -> MapName {
    match finding.from_map {
        Some(MapName::Thickness) => MapName::Thickness,
        _ => MapName::Blur,
    }
}
