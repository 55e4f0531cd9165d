//! Other definitions of `blur` and of further signs, compared on the same lesions.
//!
//! The measures of a head are computed once. Those of a head with a lesion are computed again in a box around it, with
//! the tissue scale and the robust statistics of the head without it; `run_head` recomputes everything.

mod known;
mod places;
mod variant;
mod with_lesion;

use glam::{DAffine3, DVec3};

use super::measures::{Measure, Part};
use super::warp::Warp;
use crate::coarse::Coarse;
use crate::mirror::mirrored_from_voxel;
use crate::study::{Ground, Mark};
use crate::tissue::{Bias, TissueScale, tissue_scale};
use known::{Known, KnownVariant, Z};
use places::{depth, greedy, position};
pub(super) use variant::{Join, Rule, SignOf, Strata, Term, Variant};

/// The cell size for the sums of surroundings, in mm.
const STEP_MM: f64 = 2.0;
/// The least weights of surroundings and of a mirrored value.
const LEAST_RING: f32 = 1e-4;
const LEAST_MIRRORED: f32 = 0.02;
/// The depths of the search, in mm.
const DEPTHS_MM: std::ops::RangeInclusive<f32> = 3.0..=24.0;

/// A head with the measures and the scores of all variants.
pub(super) struct Tested<'a> {
    ground: &'a Ground<'a>,
    values: Vec<f32>,
    tissue: TissueScale,
    whole: Part,
    coarse: Coarse,
    cell_from_voxel: DAffine3,
    mirrored_from_voxel: DAffine3,
    warp: Option<Warp>,
    positions: Vec<DVec3>,
    depths_mm: Vec<f32>,
    terms: Vec<Known>,
    variants: Vec<KnownVariant>,
}

impl<'a> Tested<'a> {
    /// Computes the measures that the variants need.
    pub(super) fn new(ground: &'a Ground<'a>, variants: &[Variant], bias: &Bias) -> Self {
        let mut terms: Vec<Term> = Vec::new();
        for (term, _) in variants
            .iter()
            .flat_map(|v| v.signs.iter().flat_map(|s| &s.terms))
        {
            if !terms.contains(term) {
                terms.push(*term);
            }
        }
        let mut measures: Vec<Measure> = Vec::new();
        for term in &terms {
            if !measures.contains(&term.measure) {
                measures.push(term.measure);
            }
        }
        let block = ground.block.clone();
        let (values, tissue) =
            tissue_scale(ground.head.volume, &block, bias).expect("a head with maps");
        let whole = Part::of(block, &values, &tissue, &measures);
        let block = &whole.block;
        let coarse = Coarse::new(block.size, block.spacing_mm, STEP_MM);
        let reflected = mirrored_from_voxel(&block.grid, ground.head.plane);
        let warp = terms
            .iter()
            .any(|term| term.is_warped)
            .then(|| Warp::fitted(ground, reflected));
        let place = |&voxel: &u32| position(block, voxel as usize);
        let positions: Vec<DVec3> = whole.junction.iter().map(place).collect();
        let depths_mm = positions
            .iter()
            .map(|&place| depth(ground, place))
            .collect();
        let mut tested = Self {
            ground,
            values,
            tissue,
            cell_from_voxel: coarse.through(DAffine3::IDENTITY),
            mirrored_from_voxel: reflected,
            coarse,
            warp,
            positions,
            depths_mm,
            terms: Vec::new(),
            variants: Vec::new(),
            whole,
        };
        let (known, z): (Vec<Known>, Vec<Z>) = terms.iter().map(|term| tested.known(*term)).unzip();
        tested.terms = known;
        tested.variants = variants
            .iter()
            .map(|variant| tested.known_variant(variant, &z))
            .collect();
        tested
    }

    pub(super) fn variant_count(&self) -> usize {
        self.variants.len()
    }

    /// The correlation of the two sides without and with displacements, and the mean displacement in mm.
    pub(super) fn correlations(&self) -> Option<[f64; 3]> {
        let warp = self.warp.as_ref()?;
        Some(warp.correlations(self.ground, self.mirrored_from_voxel))
    }

    fn stratum(&self, strata: Strata, part: &Part, voxel: usize, depth_mm: f32) -> f32 {
        match strata {
            Strata::Whole => 0.0,
            Strata::Depth => depth_mm,
            Strata::Density => part.density[voxel],
            Strata::White => part.white[voxel],
        }
    }

    /// Where the mirrored point of a voxel of the block is, in voxels of the block.
    fn mirrored(&self, term: &Term, voxel: DVec3) -> DVec3 {
        let there = self.mirrored_from_voxel.transform_point3(voxel);
        match (&self.warp, term.is_warped) {
            (Some(warp), true) => there + warp.at(voxel),
            _ => there,
        }
    }

    /// The places in the depths of the search, highest first.
    fn sorted(&self, scores: &[f32]) -> Vec<(f32, usize)> {
        let mut sorted: Vec<(f32, usize)> = (0..scores.len())
            .filter(|&place| DEPTHS_MM.contains(&self.depths_mm[place]) && !scores[place].is_nan())
            .map(|place| (scores[place], place))
            .collect();
        sorted.sort_by(|a, b| b.0.total_cmp(&a.0));
        sorted
    }

    fn greedy(
        &self,
        sorted: &mut dyn Iterator<Item = (f32, usize)>,
        is_left_out: impl Fn(DVec3) -> bool,
    ) -> Vec<Mark> {
        let places = sorted.map(|(score, place)| (score, self.positions[place]));
        greedy(places.filter(|(_, position)| !is_left_out(*position)))
    }

    /// The marks of a variant in the head without a lesion, highest first.
    pub(super) fn marks(&self, variant: usize) -> Vec<Mark> {
        self.greedy(&mut self.variants[variant].sorted.iter().copied(), |_| {
            false
        })
    }
}
