//! The media types of retrieved instances and frames.

use axum::http::{HeaderMap, StatusCode};

use crate::rendered::media::accepted_ranges;
use http_support::problem::AppError;

/// A file.
pub(crate) const DICOM: &str = "application/dicom";

/// A frame without compression.
pub(crate) const FRAME: &str = "application/octet-stream";

/// The transfer syntax of what states none (PS3.18 §8.7.3.5.2).
const EXPLICIT: &str = "1.2.840.10008.1.2.1";

/// What the client accepts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Accepted {
    /// Transfer syntaxes; `*` stands for all.
    pub(crate) syntaxes: Vec<String>,
    /// Whether each file is a part.
    pub(crate) is_multipart: bool,
}

impl Accepted {
    /// What is accepted of a kind. Only one file may be sent without parts.
    pub(crate) fn read(headers: &HeaderMap, kind: &str, is_one: bool) -> Result<Self, AppError> {
        let mut syntaxes = Vec::new();
        let is_any = |kind: &str| matches!(kind, "*/*" | "application/*");
        let (mut parts, mut single) = (false, false);
        for range in accepted_ranges(headers) {
            if range.parameter("q").and_then(|q| q.parse::<f64>().ok()) == Some(0.0) {
                continue;
            }
            let of_parts = range.parameter("type").unwrap_or(kind);
            match range.essence.as_str() {
                "multipart/related" if is_any(of_parts) || of_parts.eq_ignore_ascii_case(kind) => {
                    parts = true;
                }
                "*/*" | "multipart/*" => parts = true,
                essence if is_one && (essence == kind || essence == "application/*") => {
                    single = true;
                }
                _ => continue,
            }
            let syntax = range.parameter("transfer-syntax").unwrap_or(EXPLICIT);
            syntaxes.push(syntax.to_owned());
        }
        let is_possible = syntaxes
            .iter()
            .any(|syntax| syntax == "*" || syntax == EXPLICIT);
        // A file may be stored in another accepted syntax, but whether it is cannot be promised.
        if !is_possible {
            return Err(AppError::new(
                StatusCode::NOT_ACCEPTABLE,
                "not-acceptable",
                format!(
                    "none of the accepted media types is available; available is {kind}, as parts of multipart/related or alone if there is one, with transfer-syntax={EXPLICIT} or *"
                ),
            ));
        }
        Ok(Self {
            syntaxes,
            is_multipart: parts || !single,
        })
    }
}

#[cfg(test)]
mod tests {
    use axum::http::header;

    use super::*;

    fn read(accept: &str, kind: &str, is_one: bool) -> Option<(Vec<String>, bool)> {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT, accept.parse().unwrap());
        let accepted = Accepted::read(&headers, kind, is_one).ok()?;
        Some((accepted.syntaxes, accepted.is_multipart))
    }

    fn syntaxes(all: &[&str]) -> Vec<String> {
        all.iter().map(|&each| each.to_owned()).collect()
    }

    #[test]
    fn files_are_parts_in_the_plainest_syntax_unless_another_is_accepted() {
        let parts = r#"multipart/related; type="application/dicom""#;
        let plain = syntaxes(&[EXPLICIT]);
        assert_eq!(read("*/*", DICOM, false), Some((plain.clone(), true)));
        assert_eq!(read(parts, DICOM, false), Some((plain.clone(), true)));
        let any = format!("{parts}; transfer-syntax=*");
        assert_eq!(read(&any, DICOM, false), Some((syntaxes(&["*"]), true)));
        assert_eq!(
            read("application/dicom", DICOM, true),
            Some((plain.clone(), false))
        );
        let both = format!("application/dicom, {parts}");
        let twice = syntaxes(&[EXPLICIT, EXPLICIT]);
        assert_eq!(read(&both, DICOM, true), Some((twice, true)));
        let any_parts = r#"multipart/related; type="*/*""#;
        assert_eq!(read(any_parts, FRAME, true), Some((plain, true)));
        let frame = r#"multipart/related; type="application/octet-stream"; transfer-syntax=*"#;
        assert_eq!(read(frame, FRAME, true), Some((syntaxes(&["*"]), true)));
    }

    #[test]
    fn what_cannot_be_sent_is_refused() {
        for accept in [
            "text/html",
            "application/dicom",
            "image/jpeg",
            r#"multipart/related; type="image/jls""#,
            r#"multipart/related; type="application/dicom"; transfer-syntax=1.2.840.10008.1.2.4.90"#,
            "*/*;q=0",
        ] {
            assert_eq!(read(accept, DICOM, false), None, "{accept}");
        }
    }
}
