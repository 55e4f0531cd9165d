//! The scores of the variants in the head without a lesion.

use super::places::{in_voxels, less, pair, smoothed};
use super::variant::{Join, Rule, Strata, Term, Variant};
use super::{LEAST_MIRRORED, LEAST_RING, Tested};
use crate::coarse::Pair;
use crate::robust::Robust;

/// The number of the normal mark that scales a sign, so that several signs can be joined.
const SCALE_MARK: usize = 5;
/// The least spread of any difference.
const LEAST_SPREAD: f32 = 1e-4;

/// Robust deviations, separately for each stratum.
pub(super) struct Deviations {
    borders: Vec<f32>,
    robust: Vec<Robust>,
}

impl Deviations {
    pub(super) fn of(values: &[f32], strata: &[f32], count: usize) -> Self {
        let mut sorted = strata.to_vec();
        sorted.sort_by(f32::total_cmp);
        let border = |number: usize| sorted[number * sorted.len() / count];
        let borders: Vec<f32> = (1..count).map(border).collect();
        let mut parts = vec![Vec::new(); count];
        for (value, stratum) in values.iter().zip(strata) {
            parts[borders.partition_point(|border| border <= stratum)].push(*value);
        }
        Self {
            robust: parts
                .into_iter()
                .map(|part| Robust::of(part.into_iter(), LEAST_SPREAD))
                .collect(),
            borders,
        }
    }

    pub(super) fn z(&self, value: f32, stratum: f32) -> f32 {
        self.robust[self.borders.partition_point(|border| *border <= stratum)].z(value)
    }
}

/// A term in the head without a lesion.
pub(super) struct Known {
    pub(super) term: Term,
    pub(super) around: Vec<Pair>,
    pub(super) mirrored: Vec<Pair>,
    pub(super) from_ring: Deviations,
    pub(super) from_mirrored: Deviations,
}

/// A sign in the head without a lesion.
pub(super) struct KnownSign {
    pub(super) terms: Vec<(usize, f32)>,
    pub(super) rule: Rule,
    pub(super) ring: Robust,
    pub(super) mirror: Robust,
    /// The scores over the junction, not smoothed.
    pub(super) scores: Vec<f32>,
    /// A high smoothed score.
    pub(super) scale: f32,
}

pub(super) struct KnownVariant {
    pub(super) signs: Vec<KnownSign>,
    pub(super) join: Join,
    pub(super) candidate_mm: f64,
    pub(super) prior: f32,
    /// The places in the depths of the search, highest first.
    pub(super) sorted: Vec<(f32, usize)>,
}

/// Deviations of the terms at places of the junction: from the surroundings, and from the other side.
pub(super) type Z = [Vec<f32>; 2];

impl KnownSign {
    pub(super) fn score(&self, z: &[Z], place: usize) -> f32 {
        let sum = |side: usize| -> f32 {
            self.terms
                .iter()
                .map(|&(term, weight)| weight * z[term][side][place])
                .sum()
        };
        self.rule.score(self.ring.z(sum(0)), self.mirror.z(sum(1)))
    }
}

impl Tested<'_> {
    pub(super) fn known(&self, term: Term) -> (Known, Z) {
        let part = &self.whole;
        let values = part.measure(term.measure);
        let means = self
            .coarse
            .means(|index| pair(values[index], part.weights[index]));
        let around = self.coarse.smoothed(&means, term.ring_mm);
        let mirrored = self.coarse.smoothed(&means, term.mirrored_mm);
        let mut from_ring = Vec::with_capacity(part.junction.len());
        let mut from_mirrored = Vec::with_capacity(part.junction.len());
        let mut strata = Vec::with_capacity(part.junction.len());
        for (place, &voxel) in part.junction.iter().enumerate() {
            let voxel = voxel as usize;
            let own = in_voxels(&part.block, voxel);
            let other = self.mirrored(&term, own);
            let [own, other] =
                [own, other].map(|place| self.cell_from_voxel.transform_point3(place).as_vec3());
            let value = values[voxel];
            from_ring.push(less(value, self.coarse.sample(&around, own), LEAST_RING));
            from_mirrored.push(less(
                value,
                self.coarse.sample(&mirrored, other),
                LEAST_MIRRORED,
            ));
            strata.push(self.stratum(term.strata, part, voxel, self.depths_mm[place]));
        }
        let count = if term.strata == Strata::Whole { 1 } else { 8 };
        let known = Known {
            from_ring: Deviations::of(&from_ring, &strata, count),
            from_mirrored: Deviations::of(&from_mirrored, &strata, count),
            term,
            around,
            mirrored,
        };
        for (place, stratum) in strata.into_iter().enumerate() {
            from_ring[place] = known.from_ring.z(from_ring[place], stratum);
            from_mirrored[place] = known.from_mirrored.z(from_mirrored[place], stratum);
        }
        (known, [from_ring, from_mirrored])
    }

    pub(super) fn known_variant(&self, variant: &Variant, z: &[Z]) -> KnownVariant {
        let number = |term: &Term| {
            let is_this = |known: &Known| known.term == *term;
            self.terms.iter().position(is_this).expect("listed above")
        };
        let part = &self.whole;
        let mut joined = vec![variant.join.start(); part.junction.len()];
        let mut signs = Vec::new();
        for sign in &variant.signs {
            let terms: Vec<(usize, f32)> = sign
                .terms
                .iter()
                .map(|(term, weight)| (number(term), *weight))
                .collect();
            let sum = |side: usize| -> Vec<f32> {
                (0..joined.len())
                    .map(|place| {
                        terms
                            .iter()
                            .map(|&(term, weight)| weight * z[term][side][place])
                            .sum()
                    })
                    .collect()
            };
            let (ring, mirror) = (sum(0), sum(1));
            let [ring_robust, mirror_robust] =
                [&ring, &mirror].map(|values| Robust::of(values.iter().copied(), 0.1));
            let scores: Vec<f32> = ring
                .iter()
                .zip(&mirror)
                .map(|(&r, &m)| sign.rule.score(ring_robust.z(r), mirror_robust.z(m)))
                .collect();
            let smoothed = smoothed(
                &part.block,
                &part.junction,
                &scores,
                [variant.candidate_mm, variant.prior.into()],
            );
            let mut sorted = self.sorted(&smoothed);
            let marks = self.greedy(&mut sorted.iter().copied(), |_| false);
            let scale = marks
                .get(SCALE_MARK)
                .map_or(1.0, |mark| mark.score.max(1e-3));
            sorted.clear();
            for (joined, score) in joined.iter_mut().zip(smoothed) {
                *joined = variant.join.of(*joined, score / scale);
            }
            signs.push(KnownSign {
                terms,
                rule: sign.rule,
                ring: ring_robust,
                mirror: mirror_robust,
                scores,
                scale,
            });
        }
        KnownVariant {
            signs,
            join: variant.join,
            candidate_mm: variant.candidate_mm,
            prior: variant.prior,
            sorted: self.sorted(&joined),
        }
    }
}
