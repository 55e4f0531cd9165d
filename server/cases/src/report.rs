//! Gathers what the report of a reading shows: the findings of a case, their pictures and numbers.

mod shots;

use std::sync::Arc;

use ::report::{
    ListedMap, Numbers, Reason, Report, ReportFormat, ReportMaps, ReportQuery, ReportedFinding,
    ReportedReading, ShownLayer, ShownPatient, Values,
};
use bytes::Bytes;
use case::findings::Finding;
use case::{CaseId, Layer, LayerId, LayerKind, MapName, QualityState};
use glam::DVec3;
use imaging::dicom::Attributes;
use pipeline::Undefined;
use pipeline::ac_pc::AcPc;

use crate::gyri::PlaceNames;
use crate::library::{LoadedMaps, MapsState};
use crate::patient::{Patient, day};
use crate::pictures::{LayerRef, ready};
use crate::profile::{PointProfile, SampledLayer, profile};
use crate::readings::KeptReading;
use crate::{Cases, Error};

/// From where a report knows its patient.
#[derive(Debug, Clone, Copy)]
pub enum ReportSubject<'a> {
    /// From the files of the case.
    OfCase,
    /// From attributes of the patient and the study.
    Named(&'a Attributes),
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

/// A report that somebody asks for.
#[derive(Debug)]
pub struct AskedReport<'a> {
    pub query: ReportQuery,
    pub format: ReportFormat,
    pub subject: ReportSubject<'a>,
    /// The reading that it is of, with the name of its reader for people; `None`: the findings of the case.
    pub reading: Option<(KeptReading, String)>,
}

impl Cases {
    /// The report of the reading of a ready case. The same reading gives the same bytes.
    ///
    /// # Errors
    /// As [`Cases::ready`]; [`Error::LayerNotReady`] while its maps are computed; [`Error::Busy`] if too much work waits.
    pub async fn report(&self, id: &CaseId, asked: AskedReport<'_>) -> Result<Bytes, Error> {
        Ok(self.report_and_findings(id, asked).await?.0)
    }

    /// The same, with the findings that it is of, as it names them.
    ///
    /// # Errors
    /// As [`Cases::report`].
    pub async fn report_and_findings(
        &self,
        id: &CaseId,
        AskedReport {
            query,
            format,
            subject,
            reading,
        }: AskedReport<'_>,
    ) -> Result<(Bytes, Vec<Finding>), Error> {
        let facts = self.ready(id).await?;
        let mut case = self.case(id).await?;
        // A label may be a name; what is handed on has none unless it names the patient.
        if format == ReportFormat::Text && !query.patient {
            case.parameters.name = None;
        }
        let maps = found_or_reason(self.library.maps(id).await?)?;
        let flair = self.library.flair(id).await?;
        let mapped = flair.as_ref().and_then(|flair| flair.layer);
        let flair = flair
            .map(|flair| found_or_reason(flair.state))
            .transpose()?;
        let gyri = self.gyri(id).await?;
        let layers = self.layers(id).await?;
        let layer = beside(&layers, mapped);
        let reference = layer.map(|(layer, _)| LayerRef::from(layer.id));
        let mut sampled = Vec::new();
        if let Some((layer, _)) = layer {
            sampled.push(self.library.sampled(layer).await?);
        }
        let layer = layer.map(|(layer, quality)| ShownLayer {
            name: layer.name.clone(),
            may_lie_elsewhere: quality != QualityState::Ok,
        });
        let (mut list, reading) = match reading {
            None => (self.findings(id).await?.list, None),
            Some((kept, reader)) => {
                let of_reader = ReportedReading {
                    reader,
                    conclusion: kept.reading.conclusion,
                    template: kept.reading.template,
                    signed_at: kept.signed_at.map(|at| at.to_string()),
                };
                (kept.reading.findings, Some(of_reader))
            }
        };
        let names = PlaceNames {
            gyri: gyri.as_deref(),
            ac_pc: AcPc::of(&list, &facts.midsagittal),
        };
        for finding in &mut list {
            // The atlas of today counts, not that of when it was written.
            names.name(finding);
        }
        let named = list.clone();
        let (findings, others): (Vec<_>, Vec<_>) =
            (list.into_iter()).partition(Finding::is_numbered);
        let dismissed = others
            .into_iter()
            .filter(|finding| finding.is_dismissed)
            .collect();
        let own = maps.is_ok().then_some([MapName::Blur, MapName::Thickness]);
        let of_flair = matches!(flair, Some(Ok(_))).then_some(MapName::Flair);
        let drawn: Vec<_> = own.into_iter().flatten().chain(of_flair).collect();
        let (pictures, overview) = match format {
            ReportFormat::Text => shots::none(&findings),
            ReportFormat::Html | ReportFormat::Pdf => {
                shots::draw(self, id, &facts, &findings, reference.as_ref(), &drawn).await?
            }
        };
        let mut reported = Vec::new();
        for (finding, pictures) in findings.into_iter().zip(pictures) {
            let numbers = self.numbers(id, &maps, &sampled, &finding).await?;
            reported.push(ReportedFinding {
                finding,
                pictures,
                numbers,
            });
        }
        let patient = match (query.patient, subject) {
            (false, _) => None,
            (true, ReportSubject::OfCase) => Some(self.shown_patient(id).await?),
            (true, ReportSubject::Named(attributes)) => Some(shown_patient(attributes)),
        };
        let report = Report {
            case,
            facts,
            query,
            reading,
            patient,
            maps: match &maps {
                Ok(maps) => Ok(maps_of(maps, &names)),
                Err(reason) => Err(reason_of(reason)),
            },
            flair: flair.map(|flair| match flair {
                Ok(maps) => Ok(listed(&maps, MapName::Flair, &names)),
                Err(reason) => Err(reason_of(&reason)),
            }),
            layer,
            findings: reported,
            dismissed,
            overview,
        };
        let written = self.queue.run(move || report.write(format)).await?;
        let file = written.map_err(|_| Error::Internal)?;
        Ok((file.into(), named))
    }

    /// The values at a finding; `None` outside the envelope.
    async fn numbers(
        &self,
        id: &CaseId,
        maps: &Result<Arc<LoadedMaps>, Undefined>,
        layers: &[SampledLayer],
        finding: &Finding,
    ) -> Result<Option<Numbers>, Error> {
        let model = self.model(id).await?;
        let (maps, layers) = (maps.clone(), layers.to_vec());
        let position = DVec3::from_array(finding.middle_in_patient());
        let find = move || {
            let maps = maps.as_ref().map(|maps| &**maps).map_err(Clone::clone);
            profile([&model, &model], maps, &layers, None, position)
        };
        match self.queue.run(find).await? {
            Ok(found) => Ok(Some(Numbers {
                own: values_at(&found.own),
                mirrored: found.mirrored.as_ref().map(values_at),
            })),
            Err(Error::Parameter { .. }) => Ok(None),
            Err(other) => Err(other),
        }
    }

    /// The patient in the files of the case.
    ///
    /// # Errors
    /// As [`Store::source_dicom`](storage::Store::source_dicom).
    pub async fn shown_patient(&self, id: &CaseId) -> Result<ShownPatient, Error> {
        let Some(stored) = self.store().source_dicom(id).await? else {
            return Ok(ShownPatient::NotFromDicom);
        };
        Ok(shown_patient(&pipeline::attributes(&stored)?))
    }
}

fn maps_of(maps: &LoadedMaps, names: &PlaceNames<'_>) -> ReportMaps {
    ReportMaps {
        blur: listed(maps, MapName::Blur, names),
        elsewhere: names.of_places(&maps.elsewhere),
        thickness: listed(maps, MapName::Thickness, names),
        regions: maps.regions.clone(),
    }
}

/// The places of a map, with what is known about its scores.
fn listed(maps: &LoadedMaps, map: MapName, names: &PlaceNames<'_>) -> ListedMap {
    let judgement = maps.judgement(map);
    ListedMap {
        places: names.of_places(maps.places(map)),
        has_limits: judgement.limits.is_some(),
        caveat: judgement.caveat.map(|caveat| Reason {
            code: caveat.code().to_owned(),
            sentence: caveat.to_string(),
        }),
    }
}

fn reason_of(reason: &Undefined) -> Reason {
    Reason {
        code: reason.code.to_string(),
        sentence: reason.sentence.to_string(),
    }
}

fn values_at(profile: &PointProfile) -> Values {
    let at = &profile.point;
    Values {
        intensity: at.intensity,
        of_layer: at.layers.first().copied().flatten(),
        blur: at.blur,
        thickness: at.thickness,
        sharpness: at.sharpness,
    }
}

/// The maps, or the reason for none.
///
/// # Errors
/// [`Error::LayerNotReady`].
pub(crate) fn found_or_reason(
    state: MapsState,
) -> Result<Result<Arc<LoadedMaps>, Undefined>, Error> {
    match state.found() {
        Ok(maps) => Ok(Ok(maps)),
        Err(Error::MapsUndefined(reason)) => Ok(Err(reason)),
        Err(other) => Err(other),
    }
}

/// The patient and the study of some attributes, for people.
fn shown_patient(attributes: &Attributes) -> ShownPatient {
    let value = |keyword: &str| attributes.value(keyword).filter(|value| !value.is_empty());
    if PATIENT
        .iter()
        .all(|keyword| attributes.value(keyword).is_none())
    {
        return ShownPatient::NotFromDicom;
    }
    ShownPatient::Named {
        patient: Patient::of(value).words(),
        sex: value("PatientSex").map(str::to_owned),
        study_day: value("StudyDate").map(day),
        accession_number: value("AccessionNumber").map(str::to_owned),
    }
}

/// The acquired layer to show beside the anatomy, and how far its place can be trusted. The FLAIR that has the map comes first, then other FLAIRs,
/// then other layers. Of equals, a layer whose place was checked comes first. A layer that certainly lies elsewhere is never shown.
fn beside(layers: &[Layer], mapped: Option<LayerId>) -> Option<(&Layer, QualityState)> {
    let usable = layers.iter().filter_map(|layer| {
        let quality = ready(layer).ok()?.placement.quality;
        let is_usable = layer.parameters.kind == LayerKind::Mr && quality != QualityState::Failed;
        is_usable.then_some((layer, quality))
    });
    let order = |(layer, quality): &(&Layer, QualityState)| {
        let is_flair = layer.is_flair() || layer.name.to_lowercase().contains("flair");
        let is_mapped = Some(layer.id) == mapped;
        (!is_mapped, !is_flair, *quality != QualityState::Ok)
    };
    usable.min_by_key(order)
}

/// The map that shows a finding: the one in whose list it was found, if it is one that lists places; else that of blur.
fn map_of(finding: &Finding, maps: &[MapName]) -> Option<MapName> {
    let wanted = [finding.from_map, Some(MapName::Blur)].into_iter();
    wanted.flatten().find(|map| maps.contains(map))
}
