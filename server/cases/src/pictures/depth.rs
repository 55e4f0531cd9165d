//! Requested depths, and the depth that a case shows.

use case::CaseFacts;

use crate::error::Error;

/// A requested depth below the envelope, in mm: finite and not negative.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct DepthMm(f32);

/// The depth that a case shows for a requested one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShownDepth {
    /// The shown depth, in mm.
    pub mm: f32,
    /// Whether the requested depth exceeds the greatest depth of the case, which is shown instead.
    pub is_clamped: bool,
}

impl DepthMm {
    /// Checks a depth.
    ///
    /// # Errors
    /// [`Error::Parameter`] for `depth_mm`.
    pub fn new(mm: f32) -> Result<Self, Error> {
        if !mm.is_finite() {
            return Err(refused(
                "depth-not-a-number",
                "must be a finite number of mm",
            ));
        }
        Self::check_sign(mm.into())?;
        Ok(Self(mm))
    }

    /// Rejects depths outside the envelope.
    ///
    /// # Errors
    /// [`Error::Parameter`] for `depth_mm`.
    pub fn check_sign(mm: f64) -> Result<(), Error> {
        if mm < 0.0 {
            let detail = "must not be negative; depth is measured inwards from the envelope";
            return Err(refused("depth-negative", detail));
        }
        Ok(())
    }

    /// This depth in a case, limited to its greatest depth.
    pub fn shown_in(self, facts: &CaseFacts) -> ShownDepth {
        ShownDepth {
            mm: self.0.min(facts.max_depth_mm),
            is_clamped: self.0 > facts.max_depth_mm,
        }
    }
}

fn refused(kind: &'static str, detail: &str) -> Error {
    Error::Parameter {
        kind,
        name: "depth_mm".into(),
        detail: detail.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(mm: f32) -> Option<&'static str> {
        match DepthMm::new(mm) {
            Ok(_) => None,
            Err(Error::Parameter { kind, name, .. }) => {
                assert_eq!(name, "depth_mm");
                Some(kind)
            }
            Err(other) => panic!("{other}"),
        }
    }

    #[test]
    fn a_depth_is_finite_and_not_negative() {
        for (mm, expected) in [
            (0.0, None),
            (-0.0, None),
            (f32::MAX, None),
            (-f32::MIN_POSITIVE, Some("depth-negative")),
            (-1.0, Some("depth-negative")),
            (f32::NAN, Some("depth-not-a-number")),
            (f32::INFINITY, Some("depth-not-a-number")),
            (f32::NEG_INFINITY, Some("depth-not-a-number")),
        ] {
            assert_eq!(kind(mm), expected, "{mm}");
        }
    }

    #[test]
    fn a_case_shows_no_more_than_its_greatest_depth() {
        let facts = CaseFacts {
            max_depth_mm: 30.5,
            ..storage::testing::facts()
        };
        for (asked, mm, is_clamped) in [
            (0.0, 0.0, false),
            (30.5, 30.5, false),
            (30.500_002, 30.5, true),
            (f32::MAX, 30.5, true),
        ] {
            let shown = DepthMm::new(asked).unwrap().shown_in(&facts);
            assert_eq!(shown, ShownDepth { mm, is_clamped }, "{asked}");
        }
    }
}
