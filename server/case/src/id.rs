//! The ids of cases.

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
    /// The first 8 of its digits: enough to follow a case through the log, and no address.
    pub fn short(&self) -> String {
        self.to_string()[..8].to_owned()
    }

    /// The id as a number.
    pub fn number(&self) -> u128 {
        u128::from_be_bytes(self.0)
    }

    /// The id of the case with these inputs. The digests are BLAKE3 over the uploaded bytes.
    ///
    /// [`Parameters::name`] is a label and has no influence: the same upload under another name is the same case. The case that
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
        Self::of_digits(half(&hasher))
    }

    fn of_digits(digest: [u8; 16]) -> Self {
        Self(digest)
    }

    fn digits(&self) -> [u8; 16] {
        self.0
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
}

/// Gives an id of 16 bytes its text: 32 lower-case hexadecimal digits, in JSON too.
macro_rules! id_as_text {
    ($id:ident, $not_an_id:ident, $words:literal) => {
        impl $id {
            /// Parses 32 lower-case hexadecimal digits; `None` for anything else.
            pub fn parse(text: &str) -> Option<Self> {
                $crate::id::parse_digits(text).map(Self::of_digits)
            }
        }

        impl std::fmt::Display for $id {
            fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(formatter, "{:032x}", u128::from_be_bytes(self.digits()))
            }
        }

        #[doc = concat!("The text is not a [`", stringify!($id), "`].")]
        #[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
        #[error($words)]
        pub struct $not_an_id;

        impl std::str::FromStr for $id {
            type Err = $not_an_id;

            fn from_str(text: &str) -> Result<Self, $not_an_id> {
                Self::parse(text).ok_or($not_an_id)
            }
        }

        impl serde::Serialize for $id {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(self)
            }
        }

        impl<'de> serde::Deserialize<'de> for $id {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let text = <std::borrow::Cow<'de, str>>::deserialize(deserializer)?;
                text.parse().map_err(serde::de::Error::custom)
            }
        }
    };
}
pub(crate) use id_as_text;

id_as_text!(
    CaseId,
    NotACaseId,
    "the id of a case is 32 lower-case hexadecimal digits"
);

/// The bytes of 32 lower-case hexadecimal digits; `None` for anything else.
pub(crate) fn parse_digits(text: &str) -> Option<[u8; 16]> {
    let is_digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
    let are_digits = text.len() == 32 && text.bytes().all(is_digit);
    let number = are_digits.then(|| u128::from_str_radix(text, 16).ok());
    number.flatten().map(u128::to_be_bytes)
}

/// The first half of a digest.
pub(crate) fn half(hasher: &blake3::Hasher) -> [u8; 16] {
    let mut id = [0; 16];
    id.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
    id
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
