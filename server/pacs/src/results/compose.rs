//! Makes the DICOM object of a result: whose it is, what it was derived from, and its UIDs.

use std::sync::Arc;

use axum::body::Bytes;
use axum::http::StatusCode;
use case::findings::Finding;
use case::series::Uid;
use case::{Case, CaseFacts, CaseId, Closed, LayerId, QualityState};
use cases::readings::KeptReading;
use cases::report::{AskedReport, ReportSubject};
use cases::{Cases, Error, Patient};
use imaging::dicom::Attributes;
use imaging::dicom::write::{self, Conclusion, Head, KeyObjectTitle, Listed, WriteError, uid_of};
use render::{Frame, FrameSize, PixelFormat, SHORT_NOTICE, encode_png};
use report::ReportFormat;

use super::draw::Drawing;
use super::moment::{Moment, value};
use super::outline::{COMMENT, Outline, hash_of, refuse};
use super::request::{FindingsPlan, KeyObjectPlan, MaskPlan, Plan, ResultRequest, What};
use super::{findings, mask};
use crate::series::SEVERAL_PATIENTS;
use crate::state::Pacs;
use crate::values::ResultSeries;
use http::problem::AppError;

/// A part of every UID. Raise it if the same request gives another object.
const FORMAT: &str = "isocortex result 4";

/// The number of the first series of results.
const FIRST_SERIES: u32 = 9100;

/// Writes an object whose pixels are there.
type Writing = Box<dyn FnOnce(&Head<'_>) -> Result<Vec<u8>, WriteError> + Send>;

/// A result whose UIDs are known and whose pixels are not drawn yet.
#[derive(Debug)]
pub(crate) struct Composer {
    id: CaseId,
    facts: Arc<CaseFacts>,
    source: Attributes,
    study: Uid,
    content: Content,
    outline: Outline,
    withdrawn: Vec<Uid>,
    /// What distinguishes it from all other results.
    digest: blake3::Hash,
    series_number: u32,
    moment: Moment,
}

#[derive(Debug)]
enum Content {
    Pictures(Drawing),
    Mask(MaskPlan),
    KeyObject(KeyObjectTitle, Vec<Listed>),
    Findings(FindingsPlan, Vec<Finding>, Option<Conclusion>),
    /// As PDF.
    Report(Bytes),
}

impl Composer {
    /// Finds the patient, the study and the source of a result.
    ///
    /// # Errors
    /// `closed`, `several-patients`, `withdrawn`, `no-patient`, `study-known`, `no-frame-of-reference`, and those of [`Cases::ready`].
    pub(crate) async fn begin(
        pacs: &Pacs,
        id: CaseId,
        asked: &ResultRequest,
        plan: Plan,
        reading: Option<(KeptReading, String)>,
    ) -> Result<Self, AppError> {
        let cases = pacs.cases();
        let facts = cases.ready(&id).await?;
        let case = cases.case(&id).await?;
        // What was sent of a wrong patient must still be withdrawn.
        let is_rejection = matches!(plan, Plan::KeyObject(_));
        if let Some(why) = case.closed.filter(|_| !is_rejection) {
            return Err(closed(why));
        }
        let source = source(cases, &id, asked).await?;
        let study = value(&source, "StudyInstanceUID").and_then(Uid::parse);
        let study = study.ok_or_else(|| unwritable(WriteError::NoStudy))?;
        let named = Patient::of(|keyword| source.value(keyword));
        let named = std::future::ready(Ok(Some(named)));
        if !is_rejection
            && let Some(why) = pacs.arrivals().contradiction(&id, &study, named).await?
        {
            return Err(AppError::new(StatusCode::CONFLICT, SEVERAL_PATIENTS, why));
        }
        let withdrawn = match &plan {
            Plan::KeyObject(plan) => plan.instances.clone(),
            _ => Vec::new(),
        };
        let (content, outline) = match plan {
            Plan::Pictures(plan) => {
                let drawing = Drawing::of(cases, &id, plan).await?;
                let outline = drawing.outline(asked.what, &case, &facts);
                (Content::Pictures(drawing), outline)
            }
            Plan::Mask(plan) => {
                value(&source, "FrameOfReferenceUID").ok_or_else(no_frame_of_reference)?;
                (Content::Mask(plan), mask::outline(plan, &case))
            }
            Plan::KeyObject(plan) => {
                let listed = listed(pacs, &study, &plan).await?;
                let shown = format!("list of {}", listed.len());
                let outline = Outline::new(write::KEY_OBJECT, shown);
                (Content::KeyObject(plan.title, listed), outline)
            }
            Plan::Findings(plan) => {
                value(&source, "FrameOfReferenceUID").ok_or_else(no_frame_of_reference)?;
                let findings = findings::read(cases, &id, plan, reading.as_ref()).await?;
                let outline = findings::outline(plan, &findings, reading.as_ref());
                let conclusion = reading.map(findings::conclusion);
                (Content::Findings(plan, findings, conclusion), outline)
            }
            Plan::Report(query) => {
                // Known before they are drawn: one that is withdrawn meanwhile is noticed. What is closed already is not shown.
                let mut layers = cases.layers(&id).await?;
                layers.retain(|layer| layer.closed.is_none());
                let made_at = match &reading {
                    Some(of) => findings::last_change(&of.0.reading.findings).max(of.0.signed_at),
                    None => findings::last_change(&cases.findings(&id).await?.list),
                };
                let report = AskedReport {
                    query,
                    format: ReportFormat::Pdf,
                    subject: ReportSubject::Named(&source),
                    reading,
                };
                let pdf = cases.report(&id, report).await?;
                let outline = Outline {
                    layers: layers.iter().map(|layer| layer.id).collect(),
                    made_by: blake3::hash(&pdf).to_string(),
                    made_at,
                    ..Outline::new(write::REPORT, "report")
                };
                (Content::Report(pdf), outline)
            }
        };
        let made_at = outline.made_at.unwrap_or(case.created_at);
        let moment = Moment::of(made_at, &source, pacs.options().time_zone.as_ref());
        let made_by = [outline.made_by.clone(), format!("{moment:?}")].concat();
        let composer = Self {
            digest: digest(&case, asked, &source, &made_by),
            series_number: series_number(asked.what, outline.depth_mm),
            moment,
            id,
            facts,
            source,
            study,
            content,
            outline,
            withdrawn,
        };
        let instance = [composer.instance()];
        if pacs.store().are_withdrawn(&instance).await? == [true] {
            return Err(AppError::new(
                StatusCode::CONFLICT,
                "withdrawn",
                "this result was withdrawn by a rejection note, and a PACS would not accept it again; request another picture",
            ));
        }
        Ok(composer)
    }

    /// The results that it withdraws, if it is a rejection note.
    pub(crate) fn withdrawn(&self) -> Vec<Uid> {
        self.withdrawn.clone()
    }

    /// The layers of the case that it shows, or may show.
    pub(crate) fn layers(&self) -> Vec<LayerId> {
        self.outline.layers.clone()
    }

    /// The study of the result.
    pub(crate) fn study(&self) -> Uid {
        self.study.clone()
    }

    pub(crate) fn instance(&self) -> Uid {
        let uid = uid_of(&self.digest);
        Uid::parse(&uid).expect("digits and points are a UID")
    }

    /// Its series, which has no other instance.
    pub(crate) fn series(&self) -> ResultSeries {
        let uid = |text: &str| Uid::parse(text).expect("digits and points are a UID");
        ResultSeries {
            sop_class_uid: uid(self.outline.class),
            series_uid: uid(&self.series_uid()),
        }
    }

    fn series_uid(&self) -> String {
        let series = [self.digest.as_bytes().as_slice(), b"series"].concat();
        uid_of(&blake3::hash(&series))
    }

    /// The picture of the result, as PNG.
    ///
    /// # Errors
    /// `not-acceptable`, if it has none.
    pub(crate) async fn preview(self, cases: &Cases) -> Result<Bytes, AppError> {
        let Content::Pictures(drawing) = self.content else {
            return Err(AppError::new(
                StatusCode::NOT_ACCEPTABLE,
                "not-acceptable",
                "only a `view` and a `sheet` have a picture; available type: application/dicom",
            ));
        };
        let picture = drawing.draw(cases).await?;
        let work = move || -> Result<Vec<u8>, Error> {
            let size = FrameSize::new(picture.width.into(), picture.height.into());
            let size = size.map_err(|_| Error::Internal)?;
            let frame = Frame::new(size, PixelFormat::Rgb8, picture.rgb);
            encode_png(&frame, &[]).map_err(|_| Error::Internal)
        };
        Ok(cases.queue.run(work).await??.into())
    }

    /// Draws or reads the pixels, and writes the object.
    pub(crate) async fn file(self, cases: &Cases) -> Result<Bytes, AppError> {
        let instance_uid = self.instance().as_str().to_owned();
        let series_uid = self.series_uid();
        let Self {
            id,
            facts,
            source,
            content,
            outline,
            series_number,
            moment,
            ..
        } = self;
        let title = format!("Isocortex {}, {SHORT_NOTICE}", outline.shown);
        let quality = facts.quality.as_ref();
        // A brain without its skull shows no face, as long as the mask is one of a brain.
        let is_sound = quality.is_some_and(|quality| quality.state == QualityState::Ok);
        // Pixels are drawn or read here; the object is written on a thread that may compute.
        let write: Writing = match content {
            Content::Pictures(drawing) => {
                let picture = drawing.draw(cases).await?;
                Box::new(|head| write::picture(head, picture))
            }
            Content::Mask(plan) => {
                let mask = mask::load(cases, &id, plan).await?;
                Box::new(move |head| mask::segmentation(head, mask, plan, &facts))
            }
            Content::KeyObject(title, listed) => {
                Box::new(move |head| write::key_object(head, title, &listed))
            }
            Content::Findings(FindingsPlan::Report, findings, conclusion) => {
                Box::new(move |head| findings::report(head, &id, &findings, conclusion.as_ref()))
            }
            Content::Findings(FindingsPlan::Segments, findings, _) => {
                Box::new(move |head| findings::segments(head, &id, &findings, &facts))
            }
            Content::Report(pdf) => {
                Box::new(|head| write::encapsulated_pdf(head, head.series_description, pdf.into()))
            }
        };
        let work = move || {
            write(&Head {
                source: &source,
                series_uid: &series_uid,
                instance_uid: &instance_uid,
                series_number,
                series_description: &title,
                derivation: &outline.derivation,
                comment: &COMMENT,
                version: env!("CARGO_PKG_VERSION"),
                date: &moment.date,
                time: &moment.time,
                offset: moment.offset.as_deref(),
                is_annotated: outline.is_annotated,
                is_recognizable: is_sound.then_some(false),
            })
        };
        let written = cases.queue.run(work).await?;
        Ok(written.map_err(unwritable)?.into())
    }
}

/// Classes and series of the results that a note withdraws, also of those that do not count any more. Images of a PACS are not ours to withdraw.
async fn listed(pacs: &Pacs, study: &Uid, plan: &KeyObjectPlan) -> Result<Vec<Listed>, AppError> {
    let results = pacs.store().results_of(study).await?;
    let of_result = |uid: &Uid| {
        let (_, series) = results.iter().find(|(result, _)| result == uid)?;
        Some(Listed {
            series_uid: series.series_uid.as_str().to_owned(),
            sop_class_uid: series.sop_class_uid.as_str().to_owned(),
            sop_instance_uid: uid.as_str().to_owned(),
        })
    };
    let known: Option<Vec<_>> = plan.instances.iter().map(of_result).collect();
    known.ok_or_else(|| {
        refuse(
            "no-such-instance",
            "an instance of `key_object` is no result that was sent and is still known",
        )
    })
}

fn closed(why: Closed) -> AppError {
    let detail = format!(
        "the case is closed: {}; use the case of what the PACS has now",
        why.sentence()
    );
    AppError::new(StatusCode::CONFLICT, "closed", detail)
}

fn no_patient() -> AppError {
    refuse(
        "no-patient",
        "the case was not created from DICOM, so its patient and study are not known; name them in `study`",
    )
}

fn no_frame_of_reference() -> AppError {
    refuse(
        "no-frame-of-reference",
        "the source of the case has no Frame of Reference UID, so segments and findings have no place; request a `view` or a `sheet`",
    )
}

fn unwritable(error: WriteError) -> AppError {
    match error {
        WriteError::NoStudy => refuse(
            "no-patient",
            "the Study Instance UID of the case is missing or not valid (digits and points, at most 64 of them), as some anonymisers \
             write it, so no result can refer to its study; anonymise the images again with valid UIDs",
        ),
        WriteError::NoFrameOfReference => no_frame_of_reference(),
        WriteError::Empty => refuse(
            "mask-empty",
            "the mask, or what was marked, has no voxel in the source",
        ),
        WriteError::Size | WriteError::Encoding => Error::Internal.into(),
    }
}

/// The patient, the study and the images of the source, or what the request names.
async fn source(cases: &Cases, id: &CaseId, asked: &ResultRequest) -> Result<Attributes, AppError> {
    let stored = cases.store().source_dicom(id).await?;
    match (stored, &asked.study) {
        (Some(_), Some(_)) => Err(AppError::bad_request(
            "study-known",
            "the case was created from DICOM, so its study is known; omit `study`",
        )),
        (Some(stored), None) => {
            let mut attributes = pipeline::attributes(&stored).map_err(Error::from)?;
            // What is not required and has an invalid value would make the result invalid.
            attributes
                .attributes
                .retain(|(name, value)| is_writable(name, value));
            Ok(attributes)
        }
        (None, Some(study)) => study.attributes(),
        (None, None) => Err(no_patient()),
    }
}

/// Whether an optional attribute of the patient has a value of its kind (PS3.5 §6.2); all others are copied as they are.
fn is_writable(name: &str, value: &str) -> bool {
    match name {
        "PatientAge" => {
            let is_unit = |unit: &u8| b"DWMY".contains(unit);
            let (digits, unit) = value.as_bytes().split_at(value.len().min(3));
            digits.len() == 3
                && digits.iter().all(u8::is_ascii_digit)
                && matches!(unit, [unit] if is_unit(unit))
        }
        "PatientSize" | "PatientWeight" => {
            let number = value.parse::<f64>().ok();
            value.len() <= 16 && number.is_some_and(f64::is_finite)
        }
        "StudyDescription" => value.chars().count() <= 64,
        _ => true,
    }
}

/// Equal requests about equal cases have equal digests.
fn digest(case: &Case, asked: &ResultRequest, source: &Attributes, made_by: &str) -> blake3::Hash {
    hash_of(&[
        FORMAT,
        env!("CARGO_PKG_VERSION"),
        &case.id.to_string(),
        &case.created_at.to_string(),
        made_by,
        &serde_json::to_string(asked).unwrap_or_default(),
        &serde_json::to_string(source).unwrap_or_default(),
    ])
}

/// The number of the series: after those of a scanner, by kind, and within a kind by depth in whole mm.
fn series_number(what: What, depth_mm: f32) -> u32 {
    FIRST_SERIES + 100 * what as u32 + depth_mm.round().clamp(0.0, 99.0) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn optional_values_that_are_invalid_are_omitted() {
        for (name, value, expected) in [
            ("PatientAge", "042Y", true),
            ("PatientAge", "42", false),
            ("PatientAge", "042X", false),
            ("PatientAge", "ä", false),
            ("PatientAge", "", false),
            ("PatientWeight", "71.5", true),
            ("PatientWeight", "71 kg", false),
            ("PatientName", "42", true),
        ] {
            assert_eq!(is_writable(name, value), expected, "{name} {value}");
        }
    }
}
