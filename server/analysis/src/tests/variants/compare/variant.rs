//! What a variant of a score is.

use crate::tests::variants::measures::Measure;

/// A measure compared with its surroundings and the other side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Term {
    /// The measure.
    pub(crate) measure: Measure,
    /// The Gaussian of the surroundings, in mm.
    pub(crate) ring_mm: f64,
    /// The Gaussian that smooths the mirrored side, in mm.
    pub(crate) mirrored_mm: f64,
    /// Whether the mirrored point is corrected by a smooth displacement.
    pub(crate) is_warped: bool,
    /// A property of each place. Deviations are computed among the places in one quantile of it.
    pub(crate) strata: Strata,
}

/// The places among which a deviation is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Strata {
    /// The whole junction.
    Whole,
    /// Places of about the same depth.
    Depth,
    /// Places with about as much junction around them.
    Density,
    /// Places with about as much white matter around them.
    White,
}

/// How the comparisons with the surroundings and with the other side become one score.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Rule {
    /// The lesser of both.
    Least,
    /// Their mean.
    Mean,
    /// The surroundings alone.
    Ring,
    /// The other side alone.
    Mirror,
    /// The sum of three quarters of the lesser and a quarter of the greater.
    Soft,
}

/// A sign: a weighted sum of terms; a negative weight for a measure that a lesion lowers.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SignOf {
    /// The terms and their weights.
    pub(crate) terms: Vec<(Term, f32)>,
    /// The rule.
    pub(crate) rule: Rule,
}

/// How several signs become one score.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Join {
    /// The greatest.
    Greatest,
    /// The sum of those above 0.
    Sum,
    /// The least.
    Least,
}

/// A definition of a score.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Variant {
    /// Its name in the table.
    pub(crate) name: String,
    /// Its signs.
    pub(crate) signs: Vec<SignOf>,
    /// How they are joined.
    pub(crate) join: Join,
    /// The Gaussian over the junction, in mm.
    pub(crate) candidate_mm: f64,
    /// The weight of a junction with a score of 0 that is added at each place; it lowers the scores of specks.
    pub(crate) prior: f32,
}

impl Rule {
    /// Without a mirrored value, only the surroundings count.
    pub(super) fn score(self, ring: f32, mirror: f32) -> f32 {
        let mirror = if mirror.is_nan() { ring } else { mirror };
        match self {
            Self::Least => ring.min(mirror),
            Self::Mean => (ring + mirror) / 2.0,
            Self::Ring => ring,
            Self::Mirror => mirror,
            Self::Soft => 0.75 * ring.min(mirror) + 0.25 * ring.max(mirror),
        }
    }
}

impl Join {
    pub(super) fn start(self) -> f32 {
        match self {
            Self::Greatest => f32::NEG_INFINITY,
            Self::Sum => 0.0,
            Self::Least => f32::INFINITY,
        }
    }

    pub(super) fn of(self, joined: f32, score: f32) -> f32 {
        match self {
            Self::Greatest => joined.max(score),
            Self::Sum => joined + score.max(0.0),
            Self::Least => joined.min(score),
        }
    }
}
