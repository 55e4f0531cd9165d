//! The request for a result, and the checked plan.

use case::series::Uid;
use cases::Error;
use cases::pictures::{Part, PicturePlan, PictureRequest, PlanError};
use imaging::dicom::Attributes;
use imaging::dicom::write::KeyObjectTitle;
use render::NamedView;
use report::ReportQuery;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use http::problem::AppError;
use strum::IntoStaticStr;

/// The most pixels of all pictures of an object, which then has 96 MiB.
const MAX_TOTAL_PIXELS: usize = 1 << 25;

/// The most results that one note withdraws.
const MAX_LISTED: usize = 200;

/// What a result shows, with the place of its kind among the numbers of series.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub(crate) enum What {
    /// A picture.
    View = 0,
    /// Pictures at several depths from several sides, on one page.
    Sheet = 1,
    /// The envelope.
    Envelope = 3,
    /// The brain mask.
    Mask = 4,
    /// A rejection note, which withdraws results that were sent.
    #[serde(rename = "key-object")]
    KeyObject = 5,
    /// What readers have marked and written, as a measurement report.
    Findings = 6,
    /// What readers have marked, as segments; what they have dismissed is left out.
    #[serde(rename = "finding-segments")]
    FindingSegments = 7,
    /// The report of a reading, as PDF.
    Report = 8,
}

impl What {
    pub(crate) fn name(self) -> &'static str {
        self.into()
    }
}

/// A result of a case.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ResultRequest {
    /// What it shows.
    #[schema(inline)]
    pub(crate) what: What,
    /// The picture, with the keys of `GET /v1/cases/{id}/render`, but annotated unless `annotate` is false; for `view`
    /// and `sheet`.
    #[serde(default, deserialize_with = "annotated_picture")]
    pub(crate) render: Option<PictureRequest>,
    /// The rows and columns of a sheet.
    #[serde(default)]
    pub(crate) sheet: Option<SheetRequest>,
    /// Nothing. It is a part of the text that UIDs are made of, so that equal requests keep theirs.
    #[serde(skip_deserializing)]
    #[schema(ignore)]
    cine: (),
    /// What a rejection note withdraws.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) key_object: Option<KeyObjectRequest>,
    /// The language of a report, and whether it names the patient on its pages.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) report: Option<ReportQuery>,
    /// The reader of the reading that a report, or findings as a measurement report, are of: as in `…/readings/by/{reader}`. Without one, they are those of
    /// the case, and nobody's conclusion is in them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) reading: Option<String>,
    /// The node of the configuration to which it is sent; without one, the answer is the object.
    #[serde(default, skip_serializing)]
    pub(crate) node: Option<String>,
    /// The patient and the study, if the case was not created from DICOM.
    #[serde(default, skip_serializing)]
    pub(crate) study: Option<StudyRequest>,
}

/// A picture that is annotated unless it is asked not to be: in a PACS, nothing else tells its sides and its use.
fn annotated_picture<'de, D: Deserializer<'de>>(
    value: D,
) -> Result<Option<PictureRequest>, D::Error> {
    let keys = Option::<serde_json::Map<String, serde_json::Value>>::deserialize(value)?;
    let Some(mut keys) = keys else {
        return Ok(None);
    };
    keys.entry("annotate").or_insert_with(|| true.into());
    let picture = PictureRequest::deserialize(serde_json::Value::Object(keys));
    picture.map(Some).map_err(D::Error::custom)
}

/// Results to withdraw.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct KeyObjectRequest {
    /// SOP Instance UIDs of results that were sent, 1 to 200.
    instances: Vec<String>,
    /// Why.
    #[schema(inline)]
    pub(crate) title: KeyObjectTitle,
}

impl KeyObjectRequest {
    fn plan(&self) -> Result<KeyObjectPlan, AppError> {
        let wrong = || {
            let rule = format!("1 to {MAX_LISTED} SOP Instance UIDs");
            AppError::wrong_in_body("key_object.instances", &rule)
        };
        if !(1..=MAX_LISTED).contains(&self.instances.len()) {
            return Err(wrong());
        }
        let instances = self.instances.iter().map(|uid| Uid::parse(uid));
        let instances: Option<Vec<_>> = instances.collect();
        let mut seen = std::collections::HashSet::new();
        let mut instances = instances.ok_or_else(wrong)?;
        instances.retain(|uid| seen.insert(uid.clone()));
        Ok(KeyObjectPlan {
            instances,
            title: self.title,
        })
    }
}

/// A sheet.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SheetRequest {
    /// The depth of each row, in mm. Default: 4, 8, 12, 16.
    #[serde(default = "default_depths")]
    depths_mm: Vec<f32>,
    /// The view of each column. Default: left, right, superior.
    #[serde(default = "default_views")]
    #[schema(value_type = Vec<String>)]
    views: Vec<NamedView>,
}

fn default_depths() -> Vec<f32> {
    vec![4.0, 8.0, 12.0, 16.0]
}

fn default_views() -> Vec<NamedView> {
    vec![NamedView::Left, NamedView::Right, NamedView::Superior]
}

impl Default for SheetRequest {
    fn default() -> Self {
        Self {
            depths_mm: default_depths(),
            views: default_views(),
        }
    }
}

/// The patient and the study of a result, by DICOM keyword. This is patient data.
#[derive(Debug, Clone, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, rename_all = "PascalCase")]
pub(crate) struct StudyRequest {
    /// The study.
    #[serde(rename = "StudyInstanceUID")]
    study_instance_uid: String,
    /// The patient's id.
    #[serde(rename = "PatientID")]
    patient_id: String,
    /// The patient's name, as `Family^Given`.
    #[serde(default)]
    patient_name: String,
    /// The date of birth, as `19670312`.
    #[serde(default)]
    patient_birth_date: String,
    /// `F`, `M` or `O`.
    #[serde(default)]
    patient_sex: String,
    /// The date of the study, as `20261122`.
    #[serde(default)]
    study_date: String,
    /// The time of the study, as `153000`.
    #[serde(default)]
    study_time: String,
    /// The number of the study.
    #[serde(rename = "StudyID", default)]
    study_id: String,
    /// The accession number.
    #[serde(default)]
    accession_number: String,
}

impl StudyRequest {
    /// The attributes as those of a source without images.
    pub(crate) fn attributes(&self) -> Result<Attributes, AppError> {
        let wrong =
            |name: &str, rule: &str| AppError::wrong_in_body(&format!("study.{name}"), rule);
        let study = Uid::parse(&self.study_instance_uid);
        if !study.is_some_and(|uid| uid.is_strict()) {
            let rule = "a UID: numbers without leading zeros and points between them, at most 64 characters";
            return Err(wrong("StudyInstanceUID", rule));
        }
        if self.patient_id.trim().is_empty() {
            return Err(wrong("PatientID", "1 to 64 characters"));
        }
        let texts = [
            ("PatientID", &self.patient_id, 64),
            ("PatientName", &self.patient_name, 324),
            ("StudyID", &self.study_id, 16),
            ("AccessionNumber", &self.accession_number, 16),
        ];
        for (name, text, most) in texts {
            let is_plain = |c: char| !c.is_control() && c != '\\';
            if text.chars().count() > most || !text.chars().all(is_plain) {
                let rule = format!("at most {most} characters without backslashes");
                return Err(wrong(name, &rule));
            }
        }
        let digits = |text: &str, length: usize| {
            text.is_empty()
                || text.len() == length && text.bytes().all(|byte| byte.is_ascii_digit())
        };
        let numbers = [
            ("PatientBirthDate", &self.patient_birth_date, 8),
            ("StudyDate", &self.study_date, 8),
            ("StudyTime", &self.study_time, 6),
        ];
        for (name, text, length) in numbers {
            if !digits(text, length) {
                return Err(wrong(name, &format!("{length} digits")));
            }
        }
        if !["", "F", "M", "O"].contains(&&*self.patient_sex) {
            return Err(wrong("PatientSex", "`F`, `M` or `O`"));
        }
        let known = [
            ("StudyInstanceUID", &self.study_instance_uid),
            ("PatientSex", &self.patient_sex),
        ];
        let all = texts.map(|(name, text, _)| (name, text)).into_iter();
        let all = all.chain(numbers.map(|(name, text, _)| (name, text)));
        let all = all.chain(known).filter(|(_, text)| !text.is_empty());
        Ok(Attributes {
            attributes: all
                .map(|(name, text)| (name.to_owned(), text.clone()))
                .collect(),
            ..Attributes::default()
        })
    }
}

/// What is to be made.
#[derive(Debug, Clone)]
pub(crate) enum Plan {
    Pictures(PicturePlan),
    Mask(MaskPlan),
    KeyObject(KeyObjectPlan),
    /// What readers have marked.
    Findings(FindingsPlan),
    /// The report of a reading.
    Report(ReportQuery),
}

/// How findings become an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FindingsPlan {
    Report,
    Segments,
}

/// What a checked rejection note names.
#[derive(Debug, Clone)]
pub(crate) struct KeyObjectPlan {
    /// Each once, at least one.
    pub(crate) instances: Vec<Uid>,
    pub(crate) title: KeyObjectTitle,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MaskPlan {
    Envelope,
    Brain,
}

/// An error at a place of the body.
fn out_of_range(place: &str, detail: impl Into<String>) -> AppError {
    AppError::bad_request("body-value-out-of-range", detail).at(place)
}

/// The error with the names of the body.
fn named(error: PlanError) -> Error {
    let name = |part| {
        let name = match part {
            Part::Pictures | Part::Sheet => "sheet",
            // A result is no animation.
            _ => "render",
        };
        name.to_owned()
    };
    match error.named("body-value-out-of-range", name) {
        Error::Parameter { kind, name, detail } if name == "render.annotate" => Error::Parameter {
            kind,
            name,
            detail: format!("{detail}, or `false`: results are annotated by default"),
        },
        other => other,
    }
}

impl ResultRequest {
    /// Checks the whole request.
    pub(crate) fn plan(&self) -> Result<Plan, AppError> {
        let is_for = |what, name: &str, is_given: bool| match is_given && self.what != what {
            true => Err(out_of_range(
                name,
                format!("`{name}` is only accepted with that value of `what`"),
            )),
            false => Ok(()),
        };
        is_for(What::Sheet, "sheet", self.sheet.is_some())?;
        is_for(What::KeyObject, "key_object", self.key_object.is_some())?;
        is_for(What::Report, "report", self.report.is_some())?;
        if self.what != What::Findings {
            is_for(What::Report, "reading", self.reading.is_some())?;
        }
        let render = self.render.clone().unwrap_or_else(|| PictureRequest {
            annotate: true,
            ..PictureRequest::default()
        });
        if !render.projection.is_orthographic() {
            let detail = "`render.projection` must be `orthographic` in a result";
            return Err(out_of_range("render.projection", detail));
        }
        let plan = match self.what {
            What::Envelope
            | What::Mask
            | What::KeyObject
            | What::Findings
            | What::FindingSegments
            | What::Report
                if self.render.is_some() =>
            {
                return Err(out_of_range(
                    "render",
                    "`render` is only accepted with `view` and `sheet`",
                ));
            }
            What::Envelope => return Ok(Plan::Mask(MaskPlan::Envelope)),
            What::Mask => return Ok(Plan::Mask(MaskPlan::Brain)),
            What::Findings => return Ok(Plan::Findings(FindingsPlan::Report)),
            What::Report => return Ok(Plan::Report(self.report.unwrap_or_default())),
            What::FindingSegments => return Ok(Plan::Findings(FindingsPlan::Segments)),
            What::KeyObject => {
                let list = self.key_object.as_ref();
                let list =
                    list.ok_or_else(|| out_of_range("key_object", "`key_object` is required"))?;
                return Ok(Plan::KeyObject(list.plan()?));
            }
            What::View => PicturePlan::one(&render),
            What::Sheet => {
                let SheetRequest { depths_mm, views } = self.sheet.clone().unwrap_or_default();
                PicturePlan::grid(&render, &depths_mm, &views)
            }
        };
        let plan = plan.and_then(|plan| plan.within(MAX_TOTAL_PIXELS));
        Ok(Plan::Pictures(plan.map_err(named)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(body: &str) -> Result<Plan, AppError> {
        serde_json::from_str::<ResultRequest>(body).unwrap().plan()
    }

    fn pictures(body: &str) -> PicturePlan {
        match plan(body).unwrap() {
            Plan::Pictures(plan) => plan,
            Plan::Mask(_) | Plan::KeyObject(_) | Plan::Findings(_) | Plan::Report(_) => {
                panic!("pictures are expected")
            }
        }
    }

    #[test]
    fn a_sheet_has_a_row_for_each_depth() {
        let sheet = pictures(r#"{"what": "sheet", "render": {"width": 160, "height": 128}}"#);
        let cells: Vec<_> = sheet
            .pictures
            .iter()
            .map(|cell| (cell.asked.depth_mm, cell.asked.view))
            .collect();
        assert_eq!(cells.len(), 12);
        assert_eq!(cells[4], (8.0, Some(NamedView::Right)));
    }

    #[test]
    fn what_uids_are_made_of_stays_as_it_was() {
        let text = |body: &str| {
            let asked = serde_json::from_str::<ResultRequest>(body).unwrap();
            serde_json::to_string(&asked).unwrap()
        };
        assert_eq!(
            text(r#"{"what": "mask", "node": "pacs"}"#),
            r#"{"what":"mask","render":null,"sheet":null,"cine":null}"#
        );
        assert!(
            serde_json::from_str::<ResultRequest>(r#"{"what": "view", "cine": null}"#).is_err()
        );
    }

    #[test]
    fn results_are_annotated_unless_they_are_asked_not_to_be() {
        for (body, expected) in [
            (r#"{"what": "view"}"#, true),
            (r#"{"what": "view", "render": {"depth_mm": 8.2}}"#, true),
            (r#"{"what": "view", "render": {"annotate": true}}"#, true),
            (
                r#"{"what": "sheet", "render": {"annotate": false, "width": 64}}"#,
                false,
            ),
        ] {
            let pictures = pictures(body).pictures;
            assert!(
                pictures.iter().all(|each| each.asked.annotate == expected),
                "{body}"
            );
        }
        let small = plan(r#"{"what": "view", "render": {"width": 64}}"#)
            .unwrap_err()
            .to_string();
        assert!(
            small.contains("`render.annotate`") && small.contains("128"),
            "{small}"
        );
    }

    #[test]
    fn what_cannot_be_made_is_refused_by_name() {
        for (body, named) in [
            (r#"{"what": "mask", "render": {}}"#, "`render`"),
            (r#"{"what": "key-object"}"#, "`key_object`"),
            (
                r#"{"what": "key-object", "key_object": {"instances": [], "title": "rejected-for-safety"}}"#,
                "1 to 200",
            ),
            (
                r#"{"what": "key-object", "key_object": {"instances": ["Smith"], "title": "rejected-for-safety"}}"#,
                "UIDs",
            ),
            (
                r#"{"what": "view", "key_object": {"instances": ["1.2"], "title": "retention-expired"}}"#,
                "`key_object`",
            ),
            (r#"{"what": "view", "sheet": {}}"#, "`sheet`"),
            (r#"{"what": "findings", "report": {}}"#, "`report`"),
            (r#"{"what": "report", "render": {}}"#, "`render`"),
            (
                r#"{"what": "finding-segments", "reading": "ana"}"#,
                "`reading`",
            ),
            (
                r#"{"what": "view", "render": {"depth_mm": -1}}"#,
                "`render.depth_mm`",
            ),
            (
                r#"{"what": "sheet", "render": {"depth_mm": 1}}"#,
                "`depth_mm`",
            ),
            (
                r#"{"what": "view", "render": {"projection": "map"}}"#,
                "`render.projection`",
            ),
            (r#"{"what": "sheet", "sheet": {"views": []}}"#, "`sheet`"),
            (
                r#"{"what": "sheet", "render": {"width": 4096, "height": 4096}}"#,
                "pixels",
            ),
        ] {
            let refused = plan(body).unwrap_err().to_string();
            assert!(refused.contains(named), "{body}: {refused}");
        }
    }

    #[test]
    fn a_study_has_its_uid_and_its_patient() {
        let read = |body| {
            serde_json::from_str::<StudyRequest>(body)
                .unwrap()
                .attributes()
        };
        let named =
            read(r#"{"StudyInstanceUID": "1.2.3", "PatientID": "P-1", "PatientName": "Müller^A"}"#);
        let attributes = named.unwrap().attributes;
        let value = |name: &str| {
            attributes
                .iter()
                .find(|(known, _)| known == name)
                .map(|(_, text)| text.as_str())
        };
        assert_eq!(value("PatientName"), Some("Müller^A"));
        assert_eq!(value("StudyDate"), None);
        for (body, named) in [
            (
                r#"{"StudyInstanceUID": "1.02", "PatientID": "P"}"#,
                "StudyInstanceUID",
            ),
            (
                r#"{"StudyInstanceUID": "1.2", "PatientID": " "}"#,
                "PatientID",
            ),
            (
                r#"{"StudyInstanceUID": "1.2", "PatientID": "P\\Q"}"#,
                "PatientID",
            ),
            (
                r#"{"StudyInstanceUID": "1.2", "PatientID": "P", "StudyDate": "2026"}"#,
                "StudyDate",
            ),
            (
                r#"{"StudyInstanceUID": "1.2", "PatientID": "P", "PatientSex": "x"}"#,
                "PatientSex",
            ),
        ] {
            let refused = read(body).unwrap_err().to_string();
            assert!(refused.contains(named), "{refused}");
            assert!(!refused.contains("P\\Q"));
        }
    }
}
