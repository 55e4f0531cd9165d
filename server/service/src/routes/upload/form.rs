//! The form of an upload.

use axum::extract::multipart::{Field, Multipart};
use axum::extract::{FromRequest as _, Request};
use case::Parameters;
use cases::dicom::{Options, SeriesName};
use serde_json::{Map, Value};
use storage::Spooled;
use tempfile::TempDir;

use super::super::refusals::without_input;
use super::parts::{DicomParts, Incoming};
use crate::form_body::HeaderBudget;
use crate::problem::AppError;

/// The most bytes of the part `parameters`.
const MAX_PARAMETERS_BYTES: usize = 64 << 10;

/// A form, read to its end.
pub(super) struct Form {
    pub(super) volume: Volume,
    pub(super) mask: Option<Spooled>,
    pub(super) sent: SentParameters,
}

/// The part `parameters`.
#[derive(Debug, Default, PartialEq)]
pub(super) struct SentParameters {
    pub(super) parameters: Parameters,
    /// The choice among DICOM files.
    pub(super) options: Options,
    /// Whether an existing case keeps its label.
    pub(super) keep_name: bool,
}

/// The uploaded volume.
pub(super) enum Volume {
    /// One file, of any kind.
    File(Spooled),
    /// DICOM files in a directory.
    Dicom(TempDir),
}

impl Form {
    /// Reads the parts in any order.
    pub(super) async fn read(incoming: &Incoming<'_>, request: Request) -> Result<Self, AppError> {
        let budget = HeaderBudget::default();
        let request = request.map(|body| budget.watch(body));
        let mut form = Multipart::from_request(request, &())
            .await
            .map_err(|_| AppError::UnsupportedMediaType)?;
        let (mut volume, mut mask, mut sent) = (None, None, None);
        let mut dicom = DicomParts::default();
        while let Some(field) = incoming.in_time(form.next_field()).await? {
            budget.end_header();
            let name = field.name().unwrap_or_default().to_owned();
            match name.as_str() {
                "volume" => set_once(&mut volume, &name, incoming.spool(field).await?)?,
                "mask" => set_once(&mut mask, &name, incoming.spool(field).await?)?,
                "parameters" => set_once(&mut sent, &name, read_sent(incoming, field).await?)?,
                "dicom" => dicom.add(incoming, field).await?,
                _ => return Err(unknown_part()),
            }
            budget.begin_header();
        }
        Ok(Self {
            volume: Volume::of(volume, dicom.into_directory())?,
            mask,
            sent: sent.unwrap_or_default(),
        })
    }
}

impl Volume {
    fn of(file: Option<Spooled>, dicom: Option<TempDir>) -> Result<Self, AppError> {
        let (kind, detail) = match (file, dicom) {
            (Some(file), None) => return Ok(Self::File(file)),
            (None, Some(directory)) => return Ok(Self::Dicom(directory)),
            (None, None) => (
                "volume-missing",
                "the form has neither a part `volume` nor a part `dicom`; send the volume as `volume`",
            ),
            (Some(_), Some(_)) => (
                "volume-twice",
                "the form has both `volume` and `dicom`; send only one of them",
            ),
        };
        Err(AppError::Upload {
            kind,
            detail: detail.to_owned(),
        })
    }
}

/// The name is not repeated, because it may be anything, such as the name of a patient.
fn unknown_part() -> AppError {
    AppError::Upload {
        kind: "unknown-part",
        detail:
            "the form has an unknown part; send only `volume`, `dicom`, `mask` and `parameters`"
                .to_owned(),
    }
}

fn set_once<T>(slot: &mut Option<T>, name: &str, value: T) -> Result<(), AppError> {
    if slot.is_some() {
        return Err(AppError::Upload {
            kind: "part-twice",
            detail: format!("the form has two parts `{name}`; send only one"),
        });
    }
    *slot = Some(value);
    Ok(())
}

async fn read_sent(incoming: &Incoming<'_>, field: Field<'_>) -> Result<SentParameters, AppError> {
    let text = incoming.short(field, MAX_PARAMETERS_BYTES).await?;
    let text = text.ok_or_else(|| AppError::PartTooLarge {
        detail: format!("the part `parameters` is larger than {MAX_PARAMETERS_BYTES} bytes"),
    })?;
    SentParameters::parse(&text)
}

fn unreadable(what: &dyn std::fmt::Display) -> AppError {
    let what = without_input(&what.to_string());
    AppError::Upload {
        kind: "parameters-unreadable",
        detail: format!("the part `parameters` {what}"),
    }
}

impl SentParameters {
    fn parse(text: &[u8]) -> Result<Self, AppError> {
        // Parsed as an object first, because serde would also accept a list of the values in order.
        let mut object: Map<String, Value> =
            serde_json::from_slice(text).map_err(|error| unreadable(&error))?;
        let options = take_options(&mut object).map_err(|what| unreadable(&what))?;
        let keep_name = take_flag(&mut object, "keep_name")
            .ok_or_else(|| unreadable(&"`keep_name` must be true or false"))?;
        let parameters = serde_json::from_value(Value::Object(object));
        Ok(Self {
            parameters: parameters.map_err(|error| unreadable(&error))?,
            options,
            keep_name,
        })
    }
}

/// Takes a flag out of the parameters: false if it is missing, `None` if it is neither true nor false.
fn take_flag(object: &mut Map<String, Value>, name: &str) -> Option<bool> {
    match object.remove(name) {
        None => Some(false),
        Some(value) => value.as_bool(),
    }
}

/// Takes the options that are not part of the preparation out of the parameters.
fn take_options(object: &mut Map<String, Value>) -> Result<Options, &'static str> {
    let series = match object.remove("series") {
        None | Some(Value::Null) => None,
        Some(Value::Number(number)) => Some(number.to_string()),
        Some(Value::String(text)) => Some(text),
        Some(_) => return Err("`series` must be a number or a text"),
    };
    let series = series.map(|text| SeriesName::parse(&text));
    if series == Some(None) {
        return Err("`series` must be the number, the instance UID or the token of a series");
    }
    let allow_gaps = take_flag(object, "allow_gaps").ok_or("`allow_gaps` must be true or false")?;
    Ok(Options {
        series: series.flatten(),
        allow_gaps,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(json: &str) -> Result<SentParameters, String> {
        SentParameters::parse(json.as_bytes()).map_err(|error| {
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
            r#"{"series": 7, "allow_gaps": true, "keep_name": true, "closing_radius_mm": 5, "name": "A"}"#,
        );
        let sent = sent.unwrap();
        assert_eq!(sent.options.series, SeriesName::parse("7"));
        assert!(sent.options.allow_gaps && sent.keep_name);
        assert_eq!(sent.parameters.closing_radius_mm, 5.0);
        assert_eq!(sent.parameters.name.as_deref(), Some("A"));
    }

    #[test]
    fn what_cannot_be_read_is_refused_without_repeating_it() {
        for (json, words) in [
            ("", "cannot be read"),
            ("[10]", "must be a map"),
            ("{} {}", "cannot be read"),
            (r#"{"Smith": 1}"#, "has an unknown key"),
            (r#"{"series": [1]}"#, "`series` must be a number or a text"),
            (
                r#"{"series": "Smith, Anna"}"#,
                "`series` must be the number, the instance UID or the token",
            ),
            (
                r#"{"allow_gaps": "Smith"}"#,
                "`allow_gaps` must be true or false",
            ),
            (r#"{"keep_name": 1}"#, "`keep_name` must be true or false"),
            (r#"{"closing_radius_mm": "Smith"}"#, "must be f64"),
            (r#"{"mask": "Smith"}"#, "must be"),
        ] {
            let detail = parse(json).unwrap_err();
            assert!(detail.starts_with("the part `parameters` "), "{detail}");
            assert!(detail.contains(words), "{json}: {detail}");
            assert!(!detail.contains("Smith"), "{detail}");
        }
    }
}
