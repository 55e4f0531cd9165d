//! The parameters of an upload.

use serde::{Deserialize, Serialize};

use crate::{Failure, is_control};

/// Where the brain mask comes from if none is supplied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum MaskSource {
    /// From the volume if it is skull-stripped; otherwise the brain is extracted.
    #[default]
    Auto,
    /// From the volume, which must be skull-stripped: its background is exactly 0.
    Volume,
    /// Extracted by the network. Its weights must be installed.
    Network,
    /// Extracted by tree pruning. `auto` becomes this if the brain must be extracted without a network.
    Pruning,
}

/// What a supplied mask contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum MaskKind {
    /// The brain; it is closed to the envelope.
    #[default]
    Brain,
    /// The envelope itself; it is not closed, but its largest component is kept and its holes are filled.
    Envelope,
}

/// The parameters of an upload.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Parameters {
    /// Radius of the ball that closes the brain mask to the envelope, in mm: 0 to 50.
    pub closing_radius_mm: f64,
    /// Where the mask comes from if none is supplied.
    pub mask: MaskSource,
    /// What the mask contains.
    pub mask_kind: MaskKind,
    /// The probability above which the network counts a voxel as brain: 0.05 to 0.95.
    pub threshold: f64,
    /// How far the surface of the mask is moved outwards (if negative, inwards) before it is closed, in mm: -20 to 20.
    pub offset_mm: f64,
    /// A label for lists: at most [`Parameters::MAX_NAME_LENGTH`] characters, without control characters.
    ///
    /// It does not affect the [`CaseId`](crate::CaseId): the same input with another label is the same case.
    pub name: Option<String>,
}

impl Parameters {
    /// The longest accepted [`name`](Self::name), in characters.
    pub const MAX_NAME_LENGTH: usize = 200;

    /// Checks the parameters.
    ///
    /// # Errors
    /// A [`Failure`] of [`FailureKind::Unusable`](crate::FailureKind) if a number is out of range, or if the name is too long or
    /// contains control characters.
    pub fn check(&self) -> Result<(), Failure> {
        Self::check_numbers(
            Some(self.closing_radius_mm),
            Some(self.threshold),
            Some(self.offset_mm),
        )?;
        Self::check_name(self.name.as_deref().unwrap_or_default())
    }

    /// Checks a label.
    ///
    /// # Errors
    /// As [`Parameters::check`].
    pub fn check_name(name: &str) -> Result<(), Failure> {
        if name.chars().count() > Self::MAX_NAME_LENGTH {
            return Err(Failure::unusable(
                "name-too-long",
                format!(
                    "the name is longer than {} characters",
                    Self::MAX_NAME_LENGTH
                ),
            ));
        }
        if name.chars().any(is_control) {
            return Err(Failure::unusable(
                "name-not-text",
                "the name contains a control character".to_owned(),
            ));
        }
        Ok(())
    }

    /// Checks those numbers that are given.
    ///
    /// # Errors
    /// As [`Parameters::check`].
    pub fn check_numbers(
        closing_radius_mm: Option<f64>,
        threshold: Option<f64>,
        offset_mm: Option<f64>,
    ) -> Result<(), Failure> {
        for (parameter, value, range) in [
            ("closing_radius_mm", closing_radius_mm, 0.0..=50.0),
            ("threshold", threshold, 0.05..=0.95),
            ("offset_mm", offset_mm, -20.0..=20.0),
        ] {
            if let Some(value) = value.filter(|value| !range.contains(value)) {
                let (least, most) = range.into_inner();
                let name = format!(
                    "{}-out-of-range",
                    parameter.trim_end_matches("_mm").replace('_', "-")
                );
                let detail = format!("{parameter} is {value}; it must be {least} to {most}");
                return Err(Failure::unusable(&name, detail));
            }
        }
        Ok(())
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            closing_radius_mm: 10.0,
            mask: MaskSource::default(),
            mask_kind: MaskKind::default(),
            threshold: 0.5,
            offset_mm: 0.0,
            name: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FailureKind;

    #[test]
    fn bad_parameters_are_named() {
        let radius = Parameters {
            closing_radius_mm: f64::NAN,
            ..Parameters::default()
        }
        .check()
        .unwrap_err();
        assert_eq!(radius.name, "closing-radius-out-of-range");
        let name = Parameters {
            name: Some("a\u{7}".to_owned()),
            ..Parameters::default()
        }
        .check()
        .unwrap_err();
        assert_eq!(
            (name.name.as_str(), name.kind),
            ("name-not-text", FailureKind::Unusable)
        );
    }
}
