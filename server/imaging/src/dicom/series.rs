//! A series, described without saying whose it is.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A series as it appears in messages: it contains nothing about the patient.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeriesSummary {
    /// The series number.
    pub number: Option<i64>,
    /// `MR` or `CT`.
    pub modality: String,
    /// Columns, rows and slices.
    pub size: [usize; 3],
    /// Eight hexadecimal digits that name the series: the first four bytes of the BLAKE3 digest of its instance UID.
    pub token: String,
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
            self.modality, self.token
        )
    }
}
