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

/// An instance of a series.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Path)]
pub(crate) struct InstancePath {
    /// The Study Instance UID
    study: String,
    /// The Series Instance UID
    series: String,
    /// The SOP Instance UID
    instance: String,
}

/// Frames of an instance.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Path)]
pub(crate) struct FramesPath {
    /// The Study Instance UID
    study: String,
    /// The Series Instance UID
    series: String,
    /// The SOP Instance UID
    instance: String,
    /// Numbers from 1, with commas
    frames: String,
}

impl FramesPath {
    /// The instance, and the numbers of its frames.
    pub(crate) fn parts(self) -> (Named, String) {
        let named = Named {
            study: self.study,
            series: Some(self.series),
            instance: Some(self.instance),
        };
        (named, self.frames)
    }
}

/// A study, or what is named of it. The texts may be anything.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Named {
    pub(crate) study: String,
    pub(crate) series: Option<String>,
    pub(crate) instance: Option<String>,
}

impl From<StudyPath> for Named {
    fn from(path: StudyPath) -> Self {
        Self {
            study: path.study,
            series: None,
            instance: None,
        }
    }
}

impl From<SeriesPath> for Named {
    fn from(path: SeriesPath) -> Self {
        Self {
            study: path.study,
            series: Some(path.series),
            instance: None,
        }
    }
}

impl From<InstancePath> for Named {
    fn from(path: InstancePath) -> Self {
        Self {
            study: path.study,
            series: Some(path.series),
            instance: Some(path.instance),
        }
    }
}
