//! The ids of cases.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::{MaskKind, Parameters};

/// A part of every [`CaseId`]. It changes if the same input must give another case.
const ID_FORMAT: u8 = 1;

/// The id of a case, a digest: 32 lower-case hexadecimal digits.
///
/// It is the first half of a BLAKE3 digest over the volume, the mask and the parameters that affect the result. The same
/// input gives the same case, on any server and at any time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CaseId([u8; 16]);

impl CaseId {
    /// The id of the case with these inputs. The digests are BLAKE3 over the uploaded bytes.
    ///
    /// [`Parameters::name`] is a label and has no influence: the same upload under another name renames the case. The case that
    /// it is a version of has no influence either.
    pub fn of(volume: &blake3::Hash, mask: Option<&blake3::Hash>, parameters: &Parameters) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"isocortex case");
        hasher.update(&[ID_FORMAT]);
        hasher.update(volume.as_bytes());
        hasher.update(&[u8::from(mask.is_some())]);
        if let Some(mask) = mask {
            hasher.update(mask.as_bytes());
        }
        // Adding 0 turns −0 into 0.
        hasher.update(&(Self::closing_radius_mm(parameters) + 0.0).to_le_bytes());
        // Defaults are omitted, so that a new parameter does not change the ids of existing cases.
        let defaults = Self::about_mask(&Parameters::default());
        let about_mask = Self::about_mask(parameters);
        if about_mask != defaults {
            hasher.update(&about_mask);
        }
        let mut id = [0; 16];
        id.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
        Self(id)
    }

    /// An envelope is not closed, so its radius does not matter. The default stands for it, so that stored ids stay valid.
    fn closing_radius_mm(parameters: &Parameters) -> f64 {
        match parameters.mask_kind {
            MaskKind::Brain => parameters.closing_radius_mm,
            MaskKind::Envelope => Parameters::default().closing_radius_mm,
        }
    }

    fn about_mask(parameters: &Parameters) -> [u8; 18] {
        let mut bytes = [0; 18];
        bytes[0] = parameters.mask as u8;
        bytes[1] = parameters.mask_kind as u8;
        bytes[2..10].copy_from_slice(&(parameters.threshold + 0.0).to_le_bytes());
        bytes[10..].copy_from_slice(&(parameters.offset_mm + 0.0).to_le_bytes());
        bytes
    }

    /// Parses 32 lower-case hexadecimal digits; `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let digit = |byte: u8| match byte {
            b'0'..=b'9' => Some(byte - b'0'),
            b'a'..=b'f' => Some(byte - b'a' + 10),
            _ => None,
        };
        let digits: &[u8; 32] = text.as_bytes().try_into().ok()?;
        let mut id = [0; 16];
        for (byte, pair) in id.iter_mut().zip(digits.chunks_exact(2)) {
            *byte = digit(pair[0])? << 4 | digit(pair[1])?;
        }
        Some(Self(id))
    }
}

impl CaseId {
    /// The id as a number.
    pub fn number(&self) -> u128 {
        u128::from_be_bytes(self.0)
    }
}

impl fmt::Display for CaseId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0
            .iter()
            .try_for_each(|byte| write!(formatter, "{byte:02x}"))
    }
}

/// The text is not a [`CaseId`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the id of a case is 32 lower-case hexadecimal digits")]
pub struct NotACaseId;

impl FromStr for CaseId {
    type Err = NotACaseId;

    fn from_str(text: &str) -> Result<Self, NotACaseId> {
        Self::parse(text).ok_or(NotACaseId)
    }
}

impl Serialize for CaseId {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for CaseId {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = <std::borrow::Cow<'de, str>>::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MaskSource;

    #[test]
    fn an_id_is_read_back_as_it_was_written() {
        let id = CaseId::of(&blake3::hash(b"volume"), None, &Parameters::default());
        assert_eq!(CaseId::parse(&id.to_string()), Some(id));
        assert_eq!(
            serde_json::from_str::<CaseId>(&serde_json::to_string(&id).unwrap()).unwrap(),
            id
        );
    }

    #[test]
    fn the_names_of_cases_that_are_stored_already_stay() {
        let id = CaseId::of(&blake3::hash(b"volume"), None, &Parameters::default());
        assert_eq!(id.to_string(), "c4a2355cd84497c3678626aa8188b7c3");
    }

    #[test]
    fn anything_but_32_lower_case_digits_is_no_id() {
        for text in [
            "",
            "00",
            &"g".repeat(32),
            &"A".repeat(32),
            &"0".repeat(33),
            "../../../../../../../../etc/pass",
        ] {
            assert_eq!(CaseId::parse(text), None, "{text}");
        }
    }

    #[test]
    fn each_input_but_the_name_changes_the_id() {
        let [a, b] = [blake3::hash(b"a"), blake3::hash(b"b")];
        let parameters = Parameters::default();
        let id = CaseId::of(&a, None, &parameters);
        assert_ne!(id, CaseId::of(&b, None, &parameters));
        assert_ne!(id, CaseId::of(&a, Some(&b), &parameters));
        assert_ne!(
            CaseId::of(&a, Some(&b), &parameters),
            CaseId::of(&b, Some(&a), &parameters)
        );
        assert_ne!(
            id,
            CaseId::of(
                &a,
                None,
                &Parameters {
                    closing_radius_mm: 9.0,
                    ..Parameters::default()
                }
            )
        );
        for other in [
            Parameters {
                mask: MaskSource::Volume,
                ..Parameters::default()
            },
            Parameters {
                mask: MaskSource::Network,
                ..Parameters::default()
            },
            Parameters {
                mask: MaskSource::Pruning,
                ..Parameters::default()
            },
            Parameters {
                mask_kind: MaskKind::Envelope,
                ..Parameters::default()
            },
            Parameters {
                threshold: 0.4,
                ..Parameters::default()
            },
            Parameters {
                offset_mm: -1.0,
                ..Parameters::default()
            },
        ] {
            assert_ne!(id, CaseId::of(&a, None, &other));
        }
        assert_eq!(
            id,
            CaseId::of(
                &a,
                None,
                &Parameters {
                    name: Some("x".to_owned()),
                    ..parameters
                }
            )
        );
    }

    #[test]
    fn the_radius_of_a_closing_that_is_not_done_takes_no_part_in_the_id() {
        let volume = blake3::hash(b"volume");
        let id = |mask_kind, closing_radius_mm| {
            let parameters = Parameters {
                mask_kind,
                closing_radius_mm,
                ..Parameters::default()
            };
            CaseId::of(&volume, None, &parameters)
        };
        assert_eq!(id(MaskKind::Envelope, 10.0), id(MaskKind::Envelope, 4.0));
        assert_ne!(id(MaskKind::Brain, 10.0), id(MaskKind::Brain, 4.0));
        assert_ne!(id(MaskKind::Brain, 10.0), id(MaskKind::Envelope, 10.0));
    }
}
