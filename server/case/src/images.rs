//! The images that a case, a layer or a result was made of, and whether a PACS still stands by them.
//!
//! A case (a layer, a result) is closed if an image that it was made of is rejected, or if the last image that a PACS sent under
//! its SOP Instance UID is another one. Otherwise it is open.

use std::fmt;

use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

use crate::series::Uid;

/// How far a corner of an image may move, in mm: numbers may be written with fewer digits.
const ROUNDING_MM: f64 = 0.1;

/// Digits of the digest in a fingerprint.
const DIGITS: usize = 32;

/// What an image states and shows: a keyed digest of patient, study, kind and decoded pixels, and where its corners lie.
#[derive(Clone, PartialEq)]
pub struct Fingerprint {
    contents: String,
    is_lossy: bool,
    /// x, y and z of each corner in LPS, in mm.
    corners_mm: Vec<f64>,
}

impl Fingerprint {
    /// `None` if the digest is not one, or the numbers are no points.
    pub fn new(contents: &str, is_lossy: bool, corners_mm: Vec<f64>) -> Option<Self> {
        let is_digit = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
        let is_digest = contents.len() == DIGITS && contents.bytes().all(is_digit);
        let are_points =
            corners_mm.len().is_multiple_of(3) && corners_mm.iter().all(|mm| mm.is_finite());
        (is_digest && are_points).then(|| Self {
            contents: contents.to_owned(),
            is_lossy,
            corners_mm,
        })
    }

    /// Reads the output of `Display`; `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let (contents, rest) = text.split_at_checked(DIGITS)?;
        let (is_lossy, rest) = match rest.strip_prefix('~') {
            Some(rest) => (true, rest),
            None => (false, rest.strip_prefix(':')?),
        };
        let numbers = rest.split(',').filter(|number| !number.is_empty());
        let corners_mm = numbers.map(|number| number.parse().ok());
        Self::new(contents, is_lossy, corners_mm.collect::<Option<_>>()?)
    }

    /// Whether both are of one image: they state and show the same, and no corner lies more than 0.1 mm apart.
    pub fn is_same(&self, other: &Self) -> bool {
        let is_near = |(one, other): (&[f64], &[f64])| {
            let differences = one.iter().zip(other).map(|(one, other)| one - other);
            differences.map(|mm| mm * mm).sum::<f64>().sqrt() <= ROUNDING_MM
        };
        let [here, there] = [self, other].map(|print| print.corners_mm.chunks_exact(3));
        self.contents == other.contents && here.len() == there.len() && here.zip(there).all(is_near)
    }

    /// Whether this one is compressed with loss, and another one is not.
    pub fn has_lost(&self, other: &Self) -> bool {
        self.is_lossy && !other.is_lossy
    }

    /// What another image under the same UID is, if this one came last.
    pub fn followed_by(&self, new: &Self) -> Following {
        if self.is_same(new) || new.has_lost(self) {
            Following::Same
        } else if new.corners_mm.is_empty() && !self.corners_mm.is_empty() {
            Following::Unusable
        } else {
            Following::Another
        }
    }
}

/// An image under a known UID.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Following {
    /// It is the same, or has lost something that the known one has.
    Same,
    /// It is another one, and counts from now on.
    Another,
    /// It states no place, and the known one does, or it has lost something of a file that is not kept in its series.
    Unusable,
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let separator = if self.is_lossy { '~' } else { ':' };
        write!(formatter, "{}{separator}", self.contents)?;
        for (number, mm) in self.corners_mm.iter().enumerate() {
            let comma = if number > 0 { "," } else { "" };
            write!(formatter, "{comma}{mm}")?;
        }
        Ok(())
    }
}

/// Digests of patients are not shown in logs.
impl fmt::Debug for Fingerprint {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Fingerprint(…)")
    }
}

impl Serialize for Fingerprint {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Fingerprint {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Self::parse(&text)
            .ok_or_else(|| serde::de::Error::custom("it is no fingerprint of an image"))
    }
}

/// An image that something was made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Image {
    pub uid: Uid,
    pub fingerprint: Fingerprint,
    /// How often a PACS had sent it when it was read; 0 if it was uploaded.
    #[serde(default)]
    pub times: u64,
}

/// Why a case, a layer or a result is closed. The first that holds is stated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Closed {
    /// The PACS has sent another image under the UID of one that it was made of.
    Corrected,
    /// The PACS has rejected an image that it was made of.
    Rejected,
}

impl Closed {
    /// The word in answers.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The reason as a sentence without its end.
    pub fn sentence(self) -> &'static str {
        match self {
            Self::Corrected => {
                "the PACS has sent other images in place of those that it was made of: another patient, another place, or other pixels"
            }
            Self::Rejected => "the PACS has rejected images that it was made of",
        }
    }
}

impl Serialize for Closed {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTENTS: &str = "0123456789abcdef0123456789abcdef";

    fn print(is_lossy: bool, corners_mm: &[f64]) -> Fingerprint {
        Fingerprint::new(CONTENTS, is_lossy, corners_mm.to_vec()).unwrap()
    }

    #[test]
    fn a_fingerprint_is_read_back_as_it_was_written() {
        for print in [print(false, &[]), print(true, &[-1.25, 0.0, 1e-3])] {
            assert_eq!(Fingerprint::parse(&print.to_string()), Some(print));
        }
        for text in [
            "",
            CONTENTS,
            "x",
            &format!("{CONTENTS}:1,2"),
            &format!("{CONTENTS}:NaN,0,0"),
        ] {
            assert_eq!(Fingerprint::parse(text), None, "{text}");
        }
    }

    #[test]
    fn rounding_and_loss_make_no_other_image_and_another_place_does() {
        let before = print(false, &[1.0, 2.0, 3.0]);
        let after = |is_lossy, corners: &[f64]| before.followed_by(&print(is_lossy, corners));
        assert_eq!(after(false, &[1.05, 2.0, 3.0]), Following::Same);
        assert_eq!(after(false, &[1.0, 2.2, 3.0]), Following::Another);
        assert_eq!(after(true, &[1.0, 2.2, 3.0]), Following::Same);
        assert_eq!(after(false, &[]), Following::Unusable);
        let lossy = print(true, &[1.0, 2.0, 3.0]);
        assert_eq!(
            lossy.followed_by(&print(true, &[9.0, 2.0, 3.0])),
            Following::Another
        );
        assert_eq!(lossy.followed_by(&before), Following::Same);
    }
}
