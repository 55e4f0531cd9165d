//! The form of an upload.

use axum::extract::multipart::{Field, Multipart};
use axum::extract::{FromRequest as _, Request};
use case::Parameters;
use cases::VolumeFiles;
use cases::dicom::{Form as NiftiForm, Options, SeriesName};
use serde_json::{Map, Value};
use storage::Spooled;
use tempfile::TempDir;

use super::parts::{DicomParts, Incoming};
use http::form_body::HeaderBudget;
use http::problem::AppError;
use http::sent::{from_json, json_value};

/// The most bytes of the part `parameters`.
const MAX_PARAMETERS_BYTES: usize = 64 << 10;

/// A form, read to its end.
pub(super) struct Form {
    pub(super) volume: VolumeFiles,
    pub(super) mask: Option<Spooled>,
    pub(super) sent: SentParameters,
}

/// The part `parameters`.
#[derive(Debug, Default, PartialEq)]
pub(super) struct SentParameters {
    pub(super) parameters: Parameters,
    /// The choice among DICOM files.
    pub(super) options: Options,
    /// Whether an existing case gets this label although it has one.
    pub(super) renames: bool,
}

impl Form {
    /// Reads the parts in any order.
    pub(super) async fn read(incoming: &Incoming<'_>, request: Request) -> Result<Self, AppError> {
        let budget = HeaderBudget::default();
        let request = request.map(|body| budget.watch(body));
        let mut form = Multipart::from_request(request, &())
            .await
            .map_err(|_| AppError::not_a_form())?;
        let (mut volume, mut mask, mut sent) = (None, None, None);
        let mut dicom = DicomParts::default();
        while let Some(field) = incoming.in_time(form.next_field()).await? {
            budget.end_header();
            let name = field.name().unwrap_or_default().to_owned();
            match name.as_str() {
                "volume" => set_once(&mut volume, &name, incoming.spool(field).await?)?,
                "mask" => set_once(&mut mask, &name, incoming.spool(field).await?)?,
                "parameters" => {
                    let object = read_parameters(incoming, field).await?;
                    set_once(&mut sent, &name, SentParameters::parse(object)?)?;
                }
                "dicom" => dicom.add(incoming, field).await?,
                _ => {
                    return Err(unknown_part_of(
                        "`volume`, `dicom`, `mask` and `parameters`",
                    ));
                }
            }
            budget.begin_header();
        }
        Ok(Self {
            volume: only_one(volume, dicom.into_directory())?,
            mask,
            sent: sent.unwrap_or_default(),
        })
    }
}

/// The volume: one file, or DICOM files.
pub(super) fn only_one(
    file: Option<Spooled>,
    dicom: Option<TempDir>,
) -> Result<VolumeFiles, AppError> {
    let (kind, detail) = match (file, dicom) {
        (Some(file), None) => return Ok(VolumeFiles::One(file)),
        (None, Some(directory)) => return Ok(VolumeFiles::Dicom(directory)),
        (None, None) => (
            "volume-missing",
            "the form has neither a part `volume` nor a part `dicom`; send the volume as `volume`",
        ),
        (Some(_), Some(_)) => (
            "volume-twice",
            "the form has both `volume` and `dicom`; send only one of them",
        ),
    };
    Err(AppError::bad_request(kind, detail))
}

/// The name is not repeated, because it may be anything, such as the name of a patient.
pub(super) fn unknown_part_of(known: &str) -> AppError {
    let detail = format!("the form has an unknown part; send only {known}");
    AppError::bad_request("unknown-part", detail)
}

pub(super) fn set_once<T>(slot: &mut Option<T>, name: &str, value: T) -> Result<(), AppError> {
    if slot.is_some() {
        let detail = format!("the form has two parts `{name}`; send only one");
        return Err(AppError::bad_request("part-twice", detail));
    }
    *slot = Some(value);
    Ok(())
}

/// The part `parameters`.
pub(super) async fn read_parameters(
    incoming: &Incoming<'_>,
    field: Field<'_>,
) -> Result<Map<String, Value>, AppError> {
    let text = incoming.short(field, MAX_PARAMETERS_BYTES).await?;
    let too_large = || format!("the part `parameters` is larger than {MAX_PARAMETERS_BYTES} bytes");
    let text = text.ok_or_else(|| AppError::part_too_large(too_large()))?;
    object_of(&text)
}

/// A JSON object. serde would also accept a list of the values in order.
fn object_of(text: &[u8]) -> Result<Map<String, Value>, AppError> {
    match json_value(text).map_err(|detail| unreadable(".", &detail))? {
        Value::Object(object) => Ok(object),
        _ => Err(unreadable(".", &"must be an object")),
    }
}

/// Something is wrong with a key of the part `parameters`, or with the part itself (`.`).
pub(super) fn unreadable(key: &str, what: &dyn std::fmt::Display) -> AppError {
    let detail = match key {
        "." => format!("the part `parameters` {what}"),
        key => format!("`{key}` in the part `parameters` {what}"),
    };
    AppError::bad_request("parameters-unreadable", detail)
}

impl SentParameters {
    fn parse(mut object: Map<String, Value>) -> Result<Self, AppError> {
        let options = take_options(&mut object)?;
        let renames = !take_flag(&mut object, "keep_name", true)?;
        let parameters = from_json(Value::Object(object));
        Ok(Self {
            parameters: parameters.map_err(|(path, refusal)| unreadable(&path, &refusal))?,
            options,
            renames,
        })
    }
}

/// Takes a flag out of the parameters.
fn take_flag(object: &mut Map<String, Value>, name: &str, default: bool) -> Result<bool, AppError> {
    let flag = object.remove(name).unwrap_or(Value::Bool(default));
    flag.as_bool()
        .ok_or_else(|| unreadable(name, &"must be true or false"))
}

/// Takes the options that are not part of the preparation out of the parameters.
pub(super) fn take_options(object: &mut Map<String, Value>) -> Result<Options, AppError> {
    let series = match object.remove("series") {
        None | Some(Value::Null) => None,
        Some(Value::Number(number)) => Some(number.to_string()),
        Some(Value::String(text)) => Some(text),
        Some(_) => return Err(unreadable("series", &"must be a number or a text")),
    };
    let series = series.map(|text| SeriesName::parse(&text));
    if series == Some(None) {
        let detail = "must be the number, the instance UID or the token of a series";
        return Err(unreadable("series", &detail));
    }
    let form = match object.remove("affine") {
        None | Some(Value::Null) => None,
        Some(Value::String(text)) => Some(NiftiForm::of_name(&text)),
        Some(_) => Some(None),
    };
    if form == Some(None) {
        return Err(unreadable("affine", &"must be `sform` or `qform`"));
    }
    Ok(Options {
        form: form.flatten(),
        series: series.flatten(),
        allow_gaps: take_flag(object, "allow_gaps", false)?,
        ..Options::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(json: &str) -> Result<SentParameters, String> {
        object_of(json.as_bytes())
            .and_then(SentParameters::parse)
            .map_err(|error| {
                let problem = error.problem();
                assert_eq!(problem.status, 400);
                assert!(problem.kind.ends_with(":parameters-unreadable"));
                problem.detail
            })
    }

    #[test]
    fn what_is_not_sent_has_its_default() {
        assert_eq!(parse("{}"), Ok(SentParameters::default()));
        assert_eq!(parse(r#"{"series": null}"#), Ok(SentParameters::default()));
    }

    #[test]
    fn options_are_told_from_parameters() {
        let sent = parse(
            r#"{"series": 7, "allow_gaps": true, "affine": "qform", "keep_name": false, "closing_radius_mm": 5, "name": "A"}"#,
        );
        let sent = sent.unwrap();
        assert_eq!(sent.options.series, SeriesName::parse("7"));
        assert!(sent.options.allow_gaps && sent.renames);
        assert_eq!(sent.options.form, Some(NiftiForm::Qform));
        assert_eq!(sent.parameters.closing_radius_mm, 5.0);
        assert_eq!(sent.parameters.name.as_deref(), Some("A"));
    }

    #[test]
    fn what_cannot_be_read_is_refused_without_repeating_it() {
        let series = "`series` in the part `parameters` must be";
        for (json, words) in [
            ("", "the part `parameters` is not JSON: EOF"),
            ("[10]", "the part `parameters` must be an object"),
            ("{} {}", "the part `parameters` is not JSON: trailing"),
            (
                r#"{"Smith": 1}"#,
                "the part `parameters` has an unknown key; known: `closing",
            ),
            (
                r#"{"series": [1]}"#,
                &format!("{series} a number or a text"),
            ),
            (
                r#"{"series": "Smith, Anna"}"#,
                &format!("{series} the number, the instance UID or the token"),
            ),
            (
                r#"{"allow_gaps": "Smith"}"#,
                "`allow_gaps` in the part `parameters` must be true or false",
            ),
            (
                r#"{"affine": "Smith"}"#,
                "`affine` in the part `parameters` must be `sform` or `qform`",
            ),
            (
                r#"{"affine": 1}"#,
                "`affine` in the part `parameters` must be `sform` or `qform`",
            ),
            (
                r#"{"keep_name": 1}"#,
                "`keep_name` in the part `parameters` must be true or false",
            ),
            (
                r#"{"closing_radius_mm": "Smith"}"#,
                "`closing_radius_mm` in the part `parameters` must be a number",
            ),
            (
                r#"{"mask": "Smith"}"#,
                "`mask` in the part `parameters` must be one of `auto`, `volume`",
            ),
        ] {
            let detail = parse(json).unwrap_err();
            assert!(detail.starts_with(words), "{json}: {detail}");
            assert!(!detail.contains("Smith"), "{detail}");
        }
    }
}
