//! A series, described without saying whose it is.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A series, without the identity of the patient.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = DicomSeries))]
pub struct SeriesSummary {
    /// The scanner's number of the series.
    pub number: Option<i64>,
    /// `MR`, `CT` or `PT`.
    pub modality: String,
    /// The kind of the sequence, as far as its header tells: `T1`, `FLAIR`, `T2`, `PET`, `CT` and so on.
    pub name: String,
    /// The unit of its values, if the header states it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Pixels of a row, rows, and slices.
    pub size: [usize; 3],
    /// Whether it could be a volume, and so a layer: enough slices, no localizer, no mosaic.
    pub is_volume: bool,
    /// The token for `series`.
    pub token: String,
}

/// A file of an image that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = UnreadDicomFile))]
pub struct UnreadFile {
    /// Its number among the files, from 1, in the order of the archive or of the parts of the form.
    pub file: usize,
    /// Its instance number, if it can be read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instance: Option<i64>,
    /// The token of its series, if that can be read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub series: Option<String>,
    /// Why it cannot be read.
    pub reason: String,
}

impl fmt::Display for UnreadFile {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "file {}", self.file)?;
        if let Some(instance) = self.instance {
            write!(formatter, " (instance number {instance})")?;
        }
        write!(formatter, ": {}", self.reason)
    }
}

/// The token of a series: the first four bytes of the BLAKE3 digest of its instance UID in hexadecimal digits.
pub(super) fn token_of(series_uid: &str) -> String {
    let digest = blake3::hash(series_uid.as_bytes()).to_hex();
    digest[..8].to_owned()
}

impl fmt::Display for SeriesSummary {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [columns, rows, slices] = self.size;
        match self.number {
            Some(number) => write!(formatter, "series {number}")?,
            None => write!(formatter, "a series without a number")?,
        }
        write!(
            formatter,
            " ({}, {columns} × {rows} × {slices}, token {})",
            self.words(),
            self.token
        )
    }
}

impl SeriesSummary {
    /// Modality and kind: `MR FLAIR`; `CT`.
    fn words(&self) -> String {
        match self.name.as_str() {
            "" | "MR" | "CT" | "PET" => self.modality.clone(),
            name => format!("{} {name}", self.modality),
        }
    }
}
