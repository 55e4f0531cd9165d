//! Makes the DICOM object of a result: whose it is, what it was derived from, and its UIDs.

use std::sync::{Arc, LazyLock};

use axum::body::Bytes;
use axum::http::StatusCode;
use case::findings::Finding;
use case::series::Uid;
use case::{
    Case, CaseFacts, CaseId, Closed, LayerId, MaskMethod, ObjectKind, PatientSide, QualityState,
};
use cases::pictures::{Layout, PictureRequest, window_of};
use cases::report::ReportSubject;
use cases::{Cases, Error, Patient};
use geometry::{Grid, Mask};
use imaging::dicom::write::{
    self, Algorithm, Head, KeyObjectTitle, Listed, Property, Segment, WriteError, uid_of,
};
use imaging::dicom::{Attributes, Instance, Mark, Side};
use jiff::Timestamp;
use pipeline::codec::{decode_brain, decode_envelope};
use pipeline::findings::voxels_of;
use render::{
    Frame, FrameSize, PixelFormat, RESEARCH_USE_NOTICE, SHORT_NOTICE, WindowFunction, encode_png,
};
use report::ReportFormat;

use super::draw::Drawing;
use super::moment::{Moment, value};
use super::request::{FindingsPlan, KeyObjectPlan, MaskPlan, Plan, ResultRequest, Title, What};
use crate::series::SEVERAL_PATIENTS;
use crate::state::Pacs;
use crate::values::ResultSeries;
use http::problem::AppError;
use storage::tables::series;

/// A part of every UID. Raise it if the same request gives another object.
const FORMAT: &str = "isocortex result 4";

/// The number of the first series of results.
const FIRST_SERIES: u32 = 9100;

/// What every result is, for people.
static COMMENT: LazyLock<String> =
    LazyLock::new(|| format!("Made by Isocortex. {RESEARCH_USE_NOTICE}"));

/// A result whose UIDs are known and whose pixels are not drawn yet.
#[derive(Debug)]
pub(crate) struct Composer {
    id: CaseId,
    facts: Arc<CaseFacts>,
    source: Attributes,
    study: Uid,
    content: Content,
    /// The layers of the case that it shows, or may show.
    layers: Vec<LayerId>,
    withdrawn: Vec<Uid>,
    /// What distinguishes it from all other results.
    digest: blake3::Hash,
    series_number: u32,
    title: String,
    derivation: String,
    moment: Moment,
}

#[derive(Debug)]
enum Content {
    Pictures(Drawing),
    Mask(MaskPlan),
    KeyObject(KeyObjectTitle, Vec<Listed>),
    Findings(FindingsPlan, Vec<Finding>),
    /// The report as PDF, and when something in it was last changed.
    Report(Bytes, Option<Timestamp>),
}

impl Composer {
    /// Finds the patient, the study and the source of a result.
    ///
    /// # Errors
    /// `closed`, `several-patients`, `no-patient`, `study-known`, `no-frame-of-reference`, and those of [`Cases::ready`].
    pub(crate) async fn begin(
        pacs: &Pacs,
        id: CaseId,
        asked: &ResultRequest,
        plan: Plan,
    ) -> Result<Self, AppError> {
        let cases = pacs.cases();
        let facts = cases.ready(&id).await?;
        let case = cases.case(&id).await?;
        let series = series::of_case(&mut cases.store().connect().await?, &id).await?;
        // What was sent of a wrong patient must still be withdrawn.
        let is_rejection = matches!(plan, Plan::KeyObject(_));
        if let Some(why) = case.closed.filter(|_| !is_rejection) {
            return Err(closed(why));
        }
        let source = source(cases, &id, asked).await?;
        if let Some(series) = series.filter(|_| !is_rejection)
            && let Some(why) = pacs.arrivals().contradiction(&series).await?
        {
            return Err(several_patients(format!(
                "{why}; use a case of what the PACS has sent"
            )));
        }
        let study = value(&source, "StudyInstanceUID").and_then(Uid::parse);
        let study = study.ok_or_else(|| unwritable(WriteError::NoStudy))?;
        if asked.study.is_some() && !is_rejection {
            let named = Patient::of(|keyword| source.value(keyword));
            let arrivals = pacs.arrivals();
            if let Some(why) = arrivals.contradiction_of_study(&study, &named).await? {
                return Err(several_patients(why));
            }
        }
        let withdrawn = match &plan {
            Plan::KeyObject(plan) => plan.instances.clone(),
            _ => Vec::new(),
        };
        // Known before they are drawn: one that is withdrawn meanwhile is noticed.
        let all_layers = cases.layers(&id).await?;
        let content = match plan {
            Plan::Pictures(plan) => Content::Pictures(Drawing::of(cases, &id, plan).await?),
            Plan::Mask(mask) => {
                value(&source, "FrameOfReferenceUID").ok_or_else(no_frame_of_reference)?;
                Content::Mask(mask)
            }
            Plan::KeyObject(plan) => {
                let listed = listed(pacs, &study, &plan).await?;
                Content::KeyObject(key_object_title(plan.title), listed)
            }
            Plan::Findings(plan) => {
                value(&source, "FrameOfReferenceUID").ok_or_else(no_frame_of_reference)?;
                Content::Findings(plan, findings(cases, &id, plan).await?)
            }
            Plan::Report(query) => {
                let changed = last_change(&cases.findings(&id).await?.list);
                let subject = ReportSubject::Named(&source);
                let report = cases.report(&id, query, ReportFormat::Pdf, subject).await?;
                Content::Report(report, changed)
            }
        };
        let layers = match &content {
            Content::Pictures(drawing) => drawing.layers(),
            Content::Report(..) => all_layers.iter().map(|layer| layer.id).collect(),
            Content::Mask(_) | Content::KeyObject(..) | Content::Findings(..) => Vec::new(),
        };
        let made_by = match &content {
            Content::Pictures(drawing) => drawing.made_by(),
            Content::Mask(_) | Content::KeyObject(..) => String::new(),
            Content::Findings(_, findings) => serde_json::to_string(findings).unwrap_or_default(),
            Content::Report(pdf, _) => blake3::hash(pdf).to_string(),
        };
        let made_at = match &content {
            Content::Findings(_, findings) => last_change(findings),
            Content::Report(_, changed) => *changed,
            Content::Pictures(_) | Content::Mask(_) | Content::KeyObject(..) => None,
        };
        let made_at = made_at.unwrap_or(case.created_at);
        let moment = Moment::of(made_at, &source, pacs.time_zone());
        Ok(Self {
            digest: digest(
                &case,
                asked,
                &source,
                &[made_by, format!("{moment:?}")].concat(),
            ),
            series_number: series_number(&content, asked.what),
            title: title(&content, asked.what),
            derivation: derivation(&content, &case, &facts),
            moment,
            id,
            facts,
            source,
            study,
            content,
            layers,
            withdrawn,
        })
    }

    /// The results that it withdraws, if it is a rejection note.
    pub(crate) fn withdrawn(&self) -> Vec<Uid> {
        self.withdrawn.clone()
    }

    /// The layers of the case that it shows, or may show.
    pub(crate) fn layers(&self) -> Vec<LayerId> {
        self.layers.clone()
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
        let class = match &self.content {
            Content::Mask(_) | Content::Findings(FindingsPlan::Segments, _) => write::SEGMENTATION,
            Content::Findings(FindingsPlan::Report, _) => write::MEASUREMENT_REPORT,
            Content::KeyObject(..) => write::KEY_OBJECT,
            Content::Report(..) => write::REPORT,
            Content::Pictures(_) => write::PICTURE,
        };
        ResultSeries {
            sop_class_uid: uid(class),
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
            series_number,
            title,
            derivation,
            moment,
            ..
        } = self;
        let pixels = match content {
            Content::Pictures(drawing) => {
                let is_annotated = drawing.is_annotated();
                Pixels::Picture(drawing.draw(cases).await?, is_annotated)
            }
            Content::Mask(plan) => Pixels::Mask(mask(cases, &id, plan).await?, plan),
            Content::KeyObject(title, listed) => Pixels::None(title, listed),
            Content::Findings(plan, findings) => Pixels::Findings(plan, findings),
            Content::Report(pdf, _) => Pixels::Report(pdf),
        };
        let quality = facts.quality.as_ref();
        // A brain without its skull shows no face, as long as the mask is one of a brain.
        let is_sound = quality.is_some_and(|quality| quality.state == QualityState::Ok);
        let method = quality.map(|quality| quality.method);
        let work = move || {
            let head = Head {
                source: &source,
                series_uid: &series_uid,
                instance_uid: &instance_uid,
                series_number,
                series_description: &title,
                derivation: &derivation,
                comment: &COMMENT,
                version: env!("CARGO_PKG_VERSION"),
                date: &moment.date,
                time: &moment.time,
                offset: moment.offset.as_deref(),
                is_annotated: matches!(pixels, Pixels::Picture(_, true)),
                is_recognizable: is_sound.then_some(false),
            };
            match pixels {
                Pixels::Picture(picture, _) => write::picture(&head, picture),
                Pixels::None(title, listed) => write::key_object(&head, title, &listed),
                Pixels::Mask(mask, plan) => segmentation(&head, mask, plan, &facts, method),
                Pixels::Findings(FindingsPlan::Report, findings) => {
                    let marks: Vec<_> = findings
                        .iter()
                        .map(|each| mark(&id, &source, each))
                        .collect();
                    write::measurement_report(&head, &marks)
                }
                Pixels::Findings(FindingsPlan::Segments, findings) => {
                    segments(&head, &id, &findings, &facts)
                }
                Pixels::Report(pdf) => write::encapsulated_pdf(&head, &title, pdf.into()),
            }
        };
        let written = cases.queue.run(work).await?;
        Ok(written.map_err(unwritable)?.into())
    }
}

enum Pixels {
    /// A picture, and whether it is annotated.
    Picture(write::Picture, bool),
    Mask(Mask, MaskPlan),
    /// A rejection note has none.
    None(KeyObjectTitle, Vec<Listed>),
    /// They are drawn when they are written.
    Findings(FindingsPlan, Vec<Finding>),
    Report(Bytes),
}

/// The findings of a result: all that are confirmed for a report, and of these those to look at for segments.
async fn findings(
    cases: &Cases,
    id: &CaseId,
    plan: FindingsPlan,
) -> Result<Vec<Finding>, AppError> {
    let mut list = cases.findings(id).await?.list;
    list.retain(|finding| !finding.is_unconfirmed);
    if plan == FindingsPlan::Segments {
        list.retain(|finding| !finding.is_dismissed);
    }
    if list.is_empty() {
        return Err(refuse(
            "no-findings",
            "the case has no findings, or only dismissed or unconfirmed ones; mark or confirm something first",
        ));
    }
    Ok(list)
}

/// When one of the findings was last changed.
fn last_change(findings: &[Finding]) -> Option<Timestamp> {
    let times = findings
        .iter()
        .filter_map(|finding| finding.changed_at.as_deref());
    times.filter_map(|time| time.parse().ok()).max()
}

/// A finding of a case as a report states it.
fn mark(id: &CaseId, source: &Attributes, finding: &Finding) -> Mark {
    let parts = [
        "isocortex finding",
        value(source, "FrameOfReferenceUID").unwrap_or_default(),
        &finding.id,
        finding.created_at.as_deref().unwrap_or_default(),
    ];
    Mark {
        id: finding.id.clone(),
        // The same in each report about it, whatever changes about it.
        tracking_uid: uid_of(&hash_of(&parts)),
        kind: finding.kind.name().to_owned(),
        points_in_patient: finding.points_in_patient.clone(),
        depth_mm: finding.depth_mm,
        side: match finding.side {
            Some(PatientSide::Left) => Some(Side::Left),
            Some(PatientSide::Right) => Some(Side::Right),
            Some(PatientSide::Middle | PatientSide::Unknown) | None => None,
        },
        gyrus: finding.gyrus.map(|gyrus| gyrus.name().to_owned()),
        label: finding.label.clone(),
        note: finding.note.clone(),
        certainty: finding
            .certainty
            .map(|certainty| certainty.name().to_owned()),
        colour: finding.colour.clone(),
        from_map: finding.from_map.map(|map| map.name().to_owned()),
        is_dismissed: finding.is_dismissed,
        author: finding.author.clone(),
        case: Some(id.to_string()),
    }
}

/// Findings of a case as segments.
fn segments(
    head: &Head<'_>,
    id: &CaseId,
    findings: &[Finding],
    facts: &CaseFacts,
) -> Result<Vec<u8>, WriteError> {
    let affine = pipeline::affine_of(&facts.native_patient_from_voxel);
    let native = Grid::new(facts.native_size, affine).map_err(|_| WriteError::Size)?;
    let segment = |finding: &Finding| {
        let label = match &*finding.label {
            "" => &finding.id,
            label => label,
        };
        let segment = Segment {
            label: label.to_owned(),
            description: format!("Marked by a reader; {SHORT_NOTICE}"),
            algorithm: Algorithm::Manual,
            property: Property::SelectedRegion,
            mark: Some(mark(id, head.source, finding)),
        };
        Some((segment, voxels_of(finding, &native)?))
    };
    let found: Vec<_> = findings.iter().filter_map(segment).collect();
    let about = write::About {
        content_label: "FINDINGS",
        description: "Findings of a reader; research use only",
    };
    write::segmentation(head, &about, &found, &native, &slices(head.source, facts))
}

fn key_object_title(title: Title) -> KeyObjectTitle {
    match title {
        Title::RejectedForQuality => KeyObjectTitle::RejectedForQuality,
        Title::RejectedForSafety => KeyObjectTitle::RejectedForSafety,
        Title::IncorrectWorklistEntry => KeyObjectTitle::IncorrectWorklistEntry,
        Title::RetentionExpired => KeyObjectTitle::RetentionExpired,
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

fn refuse(kind: &'static str, detail: &str) -> AppError {
    AppError::new(StatusCode::UNPROCESSABLE_ENTITY, kind, detail)
}

fn several_patients(why: impl Into<String>) -> AppError {
    AppError::new(StatusCode::CONFLICT, SEVERAL_PATIENTS, why)
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

fn hash_of(parts: &[&str]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        // With their lengths, no two lists of parts give the same bytes.
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    hasher.finalize()
}

/// What viewers show in their list.
fn title(content: &Content, what: What) -> String {
    let shown = match content {
        Content::Mask(MaskPlan::Brain) => "brain mask".to_owned(),
        Content::Mask(MaskPlan::Envelope) => "brain envelope".to_owned(),
        Content::KeyObject(_, listed) => format!("list of {}", listed.len()),
        Content::Findings(FindingsPlan::Report, _) => "findings".to_owned(),
        Content::Findings(FindingsPlan::Segments, _) => "findings as segments".to_owned(),
        Content::Report(..) => "report".to_owned(),
        Content::Pictures(drawing) => {
            let [first, last] = ends(drawing);
            let [from, to] = [first, last].map(|picture| picture.depth_mm);
            let depths = match from == to {
                true => format!("{from} mm"),
                false => format!("{from} to {to} mm"),
            };
            let view = first.view.map_or("", |view| view.name());
            match what {
                What::View if view.is_empty() => format!("view at {depths}"),
                What::View => format!("{view} view at {depths}"),
                _ => format!("{} at {depths}", what.name()),
            }
        }
    };
    format!("Isocortex {shown}, {SHORT_NOTICE}")
}

/// The number of the series: after those of a scanner, by kind, and within a kind by depth in whole mm.
fn series_number(content: &Content, what: What) -> u32 {
    let depth_mm = match content {
        Content::Pictures(drawing) => ends(drawing)[0].depth_mm.round().clamp(0.0, 99.0),
        Content::Mask(_) | Content::KeyObject(..) | Content::Findings(..) | Content::Report(..) => {
            0.0
        }
    };
    FIRST_SERIES + 100 * what as u32 + depth_mm as u32
}

/// The first and the last picture.
fn ends(drawing: &Drawing) -> [&PictureRequest; 2] {
    let pictures = &drawing.plan().pictures;
    [&pictures[0].asked, &pictures[pictures.len() - 1].asked]
}

/// How the pixels were made.
fn derivation(content: &Content, case: &Case, facts: &CaseFacts) -> String {
    let radius = case.parameters.closing_radius_mm;
    if matches!(content, Content::Findings(..)) {
        return format!(
            "Places that a reader has marked, with a brush of 3 mm. {}",
            *COMMENT
        );
    }
    let Content::Pictures(drawing) = content else {
        // Rejection notes and reports have no derivation.
        return format!(
            "Mask of the brain, sampled at the centres of the voxels of the source. Closing radius of the envelope: {radius} mm. {}",
            *COMMENT
        );
    };
    let [first, last] = ends(drawing);
    let [width, height] = [first.width, first.height];
    let depth = match first.depth_mm == last.depth_mm {
        true => first.depth_mm.to_string(),
        false => format!("{} to {}", first.depth_mm, last.depth_mm),
    };
    let slab = match first.slab_mm == last.slab_mm {
        true => first.slab_mm.to_string(),
        false => format!("{} to {}", first.slab_mm, last.slab_mm),
    };
    let mut text = format!(
        "Isosurface {depth} mm below the envelope of the {} (closing radius {radius} mm), {width} x {height} pixels, renderer {}, ",
        first.surface.words().unwrap_or("brain"),
        drawing.renderer(),
    );
    text += &match &drawing.plan().layout {
        Layout::Sheet { .. } => "a row for each depth and a column for each view, ".to_owned(),
        Layout::Separate | Layout::Animation { .. } => format!("view {}, ", first.direction()),
    };
    text += &match first.window {
        Some(cases::pictures::Numbers([centre, width])) => {
            let function = match first.window_function {
                Some(WindowFunction::Sigmoid) => "sigmoid ",
                Some(WindowFunction::Linear) | None => "",
            };
            format!("{function}window centre {centre} and width {width}, ")
        }
        None if first.layer.is_some() => "window of the layer, ".to_owned(),
        None => {
            let shown = window_of(facts);
            format!(
                "window centre {} and width {}, ",
                shown.centre(),
                shown.width()
            )
        }
    };
    text += &format!(
        "colours {}, mean over {slab} mm to either side, ambient light {}. ",
        first.colormap.name(),
        first.ambient as f32
    );
    if let Some(layer) = &first.layer {
        text += &format!("Texture: layer {layer}. ");
    }
    if let Some(overlay) = &first.overlay {
        text += &format!("Overlay: layer {overlay}. ");
    }
    text + "Intensities are not resampled. " + &COMMENT
}

async fn mask(cases: &Cases, id: &CaseId, plan: MaskPlan) -> Result<Mask, Error> {
    let turn = cases.queue.turn().await?;
    let loaded = match plan {
        MaskPlan::Brain => {
            let decode = |_: &CaseFacts, payloads: &[Bytes]| {
                Some(decode_brain(payloads.first()?)?.mask().clone())
            };
            cases.library.load(id, &[ObjectKind::Mask], decode).await?
        }
        MaskPlan::Envelope => {
            let decode = |_: &CaseFacts, payloads: &[Bytes]| {
                Some(decode_envelope(payloads.first()?)?.mask().clone())
            };
            cases
                .library
                .load(id, &[ObjectKind::Envelope], decode)
                .await?
        }
    };
    drop(turn);
    loaded.ok_or(Error::NoSuchCase)
}

fn segmentation(
    head: &Head<'_>,
    mask: Mask,
    plan: MaskPlan,
    facts: &CaseFacts,
    method: Option<MaskMethod>,
) -> Result<Vec<u8>, WriteError> {
    let affine = pipeline::affine_of(&facts.native_patient_from_voxel);
    let native = Grid::new(facts.native_size, affine).map_err(|_| WriteError::Size)?;
    let (content_label, label, description) = match plan {
        MaskPlan::Brain => ("BRAIN", "Brain", "Brain mask; research use only"),
        MaskPlan::Envelope => (
            "ENVELOPE",
            "Brain envelope",
            "Brain mask, closed over the sulci; research use only",
        ),
    };
    let about = write::About {
        content_label,
        description,
    };
    let segment = Segment {
        label: label.to_owned(),
        description: description.to_owned(),
        property: Property::Brain,
        mark: None,
        algorithm: match method {
            Some(MaskMethod::Network) => Algorithm::Automatic("Isocortex, deepbet network"),
            Some(MaskMethod::TreePruning) => Algorithm::Automatic("Isocortex, tree pruning"),
            Some(MaskMethod::Volume) => Algorithm::Automatic("Isocortex, skull-stripped volume"),
            Some(MaskMethod::Supplied) | None => {
                Algorithm::Semiautomatic("Isocortex, from a supplied mask")
            }
        },
    };
    let slices = slices(head.source, facts);
    write::segmentation(head, &about, &[(segment, mask)], &native, &slices)
}

/// The image of each slice; `None` for an interpolated one.
fn slices<'a>(source: &'a Attributes, facts: &CaseFacts) -> Vec<Option<&'a Instance>> {
    let [_, _, count] = facts.native_size;
    let interpolated = &source.interpolated_slices;
    if source.instances.len() + interpolated.len() != count {
        return vec![None; count];
    }
    let mut instances = source.instances.iter();
    let image = |number: usize| match interpolated.contains(&number) {
        true => None,
        false => instances.next(),
    };
    (1..=count).map(image).collect()
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
