#![doc = include_str!("../README.md")]

mod contents;
mod heads;
mod html;
mod pdf;
mod pictures;
mod words;

use std::sync::Arc;

use case::findings::Finding;
use case::readings::Template;
use case::{CandidateFacts, Case, CaseFacts, RegionFacts};
use serde::{Deserialize, Serialize};

pub use heads::{ListedHead, page_of_heads};
pub use html::POLICY;
pub use pictures::{DEPTHS_MM, FindingPictures, Overview, Shot, Shows, Through};
pub use words::Language;

/// What a report shows.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct ReportQuery {
    /// The language: `en` or `pt-BR`.
    #[serde(default)]
    pub language: Language,
    /// Whether to name the patient and the study, if the case was created from DICOM. The report is patient data then.
    #[serde(default)]
    pub patient: bool,
}

/// The form of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportFormat {
    /// HTML without scripts, to read, to print and to keep.
    Html,
    /// PDF, for archives and for paper.
    Pdf,
    /// The words alone, as a part of an HTML document; the report needs no pictures then.
    Text,
}

/// Why there is no report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// A picture cannot be embedded.
    #[error("a picture is not as the renderers write them")]
    Picture,
}

/// Everything that a report shows.
#[derive(Debug)]
pub struct Report {
    pub case: Case,
    pub facts: Arc<CaseFacts>,
    pub query: ReportQuery,
    /// Whose it is; `None`: it is that of the findings of the case.
    pub reading: Option<ReportedReading>,
    /// `None` unless requested.
    pub patient: Option<ShownPatient>,
    pub maps: Result<ReportMaps, Reason>,
    /// The map of the newest FLAIR, if a layer is one.
    pub flair: Option<Result<ListedMap, Reason>>,
    /// The acquired layer beside the anatomy, if there is one.
    pub layer: Option<ShownLayer>,
    /// Those to look at, with their pictures and numbers, in the order of the list.
    pub findings: Vec<ReportedFinding>,
    pub dismissed: Vec<Finding>,
    pub overview: Overview,
}

impl Report {
    /// The file.
    ///
    /// # Errors
    /// [`Error::Picture`].
    pub fn write(&self, format: ReportFormat) -> Result<Vec<u8>, Error> {
        let contents = self.contents();
        match format {
            ReportFormat::Html => Ok(contents.html().into()),
            ReportFormat::Pdf => contents.pdf(),
            ReportFormat::Text => Ok(contents.text().into()),
        }
    }
}

/// What a named reader concludes.
#[derive(Debug)]
pub struct ReportedReading {
    /// As people know the reader.
    pub reader: String,
    pub conclusion: String,
    /// The same in fixed words.
    pub template: Template,
    /// `2026-11-28T10:20:30Z`; `None` while it is open.
    pub signed_at: Option<String>,
}

/// The patient and the study.
#[derive(Debug)]
pub enum ShownPatient {
    /// The case was not created from DICOM.
    NotFromDicom,
    /// For people.
    Named {
        patient: String,
        sex: Option<String>,
        study_day: Option<String>,
        accession_number: Option<String>,
    },
}

/// A reason with its stable name, for translations.
#[derive(Debug)]
pub struct Reason {
    pub code: String,
    pub sentence: String,
}

/// What the maps of a case tell.
#[derive(Debug)]
pub struct ReportMaps {
    /// The most blurred places of the cerebrum.
    pub blur: ListedMap,
    /// The same elsewhere in the brain.
    pub elsewhere: Vec<CandidateFacts>,
    /// The places with the thickest cortex compared with the other side.
    pub thickness: ListedMap,
    /// The regions of the brain.
    pub regions: RegionFacts,
}

/// The places of a map, the highest first, and what is known about its scores.
#[derive(Debug)]
pub struct ListedMap {
    pub places: Vec<CandidateFacts>,
    /// Whether it is known from which scores on a place is unusual.
    pub has_limits: bool,
    /// What is to be known before a score is believed to be unusual.
    pub caveat: Option<Reason>,
}

/// The acquired layer of a report.
#[derive(Debug)]
pub struct ShownLayer {
    pub name: String,
    /// Whether nobody has checked that it lies where the anatomy does.
    pub may_lie_elsewhere: bool,
}

/// A finding with its pictures and numbers.
#[derive(Debug)]
pub struct ReportedFinding {
    pub finding: Finding,
    pub pictures: FindingPictures,
    pub numbers: Option<Numbers>,
}

/// The values at a finding, and at its mirrored point if that is in the brain.
#[derive(Debug)]
pub struct Numbers {
    pub own: Values,
    pub mirrored: Option<Values>,
}

/// The values at a point; `None` where one is undefined.
#[derive(Debug)]
pub struct Values {
    pub intensity: Option<f32>,
    /// The value of the acquired layer.
    pub of_layer: Option<f32>,
    pub blur: Option<f32>,
    pub thickness: Option<f32>,
    pub sharpness: Option<f32>,
}
