//! What the address of a DICOMweb resource names.

use serde::Deserialize;
use utoipa::IntoParams;

/// A study.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Path)]
pub(crate) struct StudyPath {
    /// The Study Instance UID
    pub(crate) study: String,
}

/// A series of a study.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Path)]
pub(crate) struct SeriesPath {
    /// The Study Instance UID
    study: String,
    /// The Series Instance UID
    series: String,
}

/// A study, or a series of it. The texts may be anything.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Named {
    pub(crate) study: String,
    pub(crate) series: Option<String>,
}

impl From<StudyPath> for Named {
    fn from(path: StudyPath) -> Self {
        Self {
            study: path.study,
            series: None,
        }
    }
}

impl From<SeriesPath> for Named {
    fn from(path: SeriesPath) -> Self {
        Self {
            study: path.study,
            series: Some(path.series),
        }
    }
}
