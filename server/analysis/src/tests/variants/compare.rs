//! Other definitions of `blur` and of further signs, compared on the same lesions.
//!
//! The measures of a head are computed once. Those of a head with a lesion are computed again in a box around it, with
//! the tissue scale and the robust statistics of the head without it; `run_head` recomputes everything.

use glam::{DAffine3, DVec3, Vec3};

use super::measures::{Measure, Part};
use super::warp::Warp;
use crate::block::{Block, depth_at};
use crate::coarse::{Coarse, Pair};
use crate::convolve::{Kernel, smooth};
use crate::mirror::mirrored_from_voxel;
use crate::robust::Robust;
use crate::study::{Ground, Lesion, Mark, false_marks_above};
use crate::tissue::{Bias, TissueScale, tissue_scale};

/// The cell size for the sums of surroundings, in mm.
const STEP_MM: f64 = 2.0;
/// The least weights of surroundings and of a mirrored value.
const LEAST_RING: f32 = 1e-4;
const LEAST_MIRRORED: f32 = 0.02;
/// The extent of the filters of all measures, in mm.
const FILTERS_MM: f64 = 9.0;
/// The depths of the search, in mm, the least distance of two marks, and the greatest number of marks.
const DEPTHS_MM: std::ops::RangeInclusive<f32> = 3.0..=24.0;
const APART_MM: f64 = 10.0;
const MARKS: usize = 60;
/// The number of the normal mark that scales a sign, so that several signs can be joined.
const SCALE_MARK: usize = 5;
/// The least spread of any difference.
const LEAST_SPREAD: f32 = 1e-4;

/// A measure compared with its surroundings and the other side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Term {
    /// The measure.
    pub(super) measure: Measure,
    /// The Gaussian of the surroundings, in mm.
    pub(super) ring_mm: f64,
    /// The Gaussian that smooths the mirrored side, in mm.
    pub(super) mirrored_mm: f64,
    /// Whether the mirrored point is corrected by a smooth displacement.
    pub(super) is_warped: bool,
    /// A property of each place. Deviations are computed among the places in one quantile of it.
    pub(super) strata: Strata,
}

/// The places among which a deviation is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Strata {
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
pub(super) enum Rule {
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
pub(super) struct SignOf {
    /// The terms and their weights.
    pub(super) terms: Vec<(Term, f32)>,
    /// The rule.
    pub(super) rule: Rule,
}

/// How several signs become one score.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Join {
    /// The greatest.
    Greatest,
    /// The sum of those above 0.
    Sum,
    /// The least.
    Least,
}

/// A definition of a score.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Variant {
    /// Its name in the table.
    pub(super) name: String,
    /// Its signs.
    pub(super) signs: Vec<SignOf>,
    /// How they are joined.
    pub(super) join: Join,
    /// The Gaussian over the junction, in mm.
    pub(super) candidate_mm: f64,
    /// The weight of a junction with a score of 0 that is added at each place; it lowers the scores of specks.
    pub(super) prior: f32,
}

/// Robust deviations, separately for each stratum.
struct Deviations {
    borders: Vec<f32>,
    robust: Vec<Robust>,
}

impl Deviations {
    fn of(values: &[f32], strata: &[f32], count: usize) -> Self {
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

    fn z(&self, value: f32, stratum: f32) -> f32 {
        self.robust[self.borders.partition_point(|border| *border <= stratum)].z(value)
    }
}

/// A term in the head without a lesion.
struct Known {
    term: Term,
    around: Vec<Pair>,
    mirrored: Vec<Pair>,
    from_ring: Deviations,
    from_mirrored: Deviations,
}

/// A sign in the head without a lesion.
struct KnownSign {
    terms: Vec<(usize, f32)>,
    rule: Rule,
    ring: Robust,
    mirror: Robust,
    /// The scores over the junction, not smoothed.
    scores: Vec<f32>,
    /// A high smoothed score.
    scale: f32,
}

struct KnownVariant {
    signs: Vec<KnownSign>,
    join: Join,
    candidate_mm: f64,
    prior: f32,
    /// The places in the depths of the search, highest first.
    sorted: Vec<(f32, usize)>,
}

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

/// Deviations of the terms at places of the junction: from the surroundings, and from the other side.
type Z = [Vec<f32>; 2];

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

    fn known(&self, term: Term) -> (Known, Z) {
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

    fn known_variant(&self, variant: &Variant, z: &[Z]) -> KnownVariant {
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

    /// For each variant, the number of false marks above a lesion; `None` if it is not found.
    pub(super) fn false_marks(&self, lesion: &Lesion) -> Vec<Option<usize>> {
        let block = &self.whole.block;
        let centre = lesion.centre_in_patient;
        let inner_mm = lesion.reach_mm() + FILTERS_MM;
        let voxel = block.grid.voxel_from_patient().transform_point3(centre);
        let range = |axis: usize, reach_mm: f64, step: usize| {
            let reach = reach_mm / block.spacing_mm[axis];
            let low = ((voxel[axis] - reach).floor().max(0.0) as usize) / step * step;
            let high = ((voxel[axis] + reach).ceil().max(0.0) as usize).min(block.size[axis] - 1);
            [low, high]
        };
        let factor = self.coarse.factor;
        let inner = [0, 1, 2].map(|axis| range(axis, inner_mm, 1));
        let outer = [0, 1, 2].map(|axis| range(axis, inner_mm + FILTERS_MM, factor[axis]));
        let is_inner = |voxel: [usize; 3]| {
            (0..3).all(|axis| (inner[axis][0]..=inner[axis][1]).contains(&voxel[axis]))
        };
        let first = outer.map(|[low, _]| low);
        let size = outer.map(|[low, high]| high - low + 1);
        let box_block = part_of(block, first, size);
        let values = self.values_with(lesion, first, size);
        let part = Part::of(box_block, &values, &self.tissue, &self.whole.measures());
        let in_block = |index: usize| {
            let voxel = part.block.grid.voxel(index);
            [0, 1, 2].map(|axis| voxel[axis] + first[axis])
        };
        // The junction of the box: inside, that of the lesion; at its edge, that of the head.
        let places: Vec<usize> = part
            .junction
            .iter()
            .map(|&voxel| voxel as usize)
            .filter(|&voxel| is_inner(in_block(voxel)))
            .collect();
        let positions: Vec<DVec3> = places
            .iter()
            .map(|&voxel| position(&part.block, voxel))
            .collect();
        let depths_mm: Vec<f32> = positions
            .iter()
            .map(|&place| depth(self.ground, place))
            .collect();
        let box_coarse = Coarse::new(size, part.block.spacing_mm, STEP_MM);
        let box_cell_from_voxel = box_coarse.through(DAffine3::from_translation(
            -DVec3::from_array(first.map(|along| along as f64)),
        ));
        let z: Vec<Z> = self
            .terms
            .iter()
            .map(|known| {
                let values = part.measure(known.term.measure);
                let before = self.whole.measure(known.term.measure);
                let changes = box_coarse.means(|index| {
                    let voxel = in_block(index);
                    if !is_inner(voxel) {
                        return [0.0; 2];
                    }
                    let there = block.grid.index(voxel);
                    let [a, b] = pair(values[index], part.weights[index]);
                    let [c, d] = pair(before[there], self.whole.weights[there]);
                    [a - c, b - d]
                });
                let around = box_coarse.smoothed(&changes, known.term.ring_mm);
                let mirrored = box_coarse.smoothed(&changes, known.term.mirrored_mm);
                let sample = |pairs: &[Pair], changes: &[Pair], voxel: DVec3| {
                    let place = self.cell_from_voxel.transform_point3(voxel).as_vec3();
                    let place_in_box = box_cell_from_voxel.transform_point3(voxel).as_vec3();
                    let [a, b] = self.coarse.sample(pairs, place);
                    let [c, d] = box_coarse.sample(changes, place_in_box);
                    [a + c, b + d]
                };
                let (mut from_ring, mut from_mirrored) = (Vec::new(), Vec::new());
                for (number, &index) in places.iter().enumerate() {
                    let own = DVec3::from_array(in_block(index).map(|along| along as f64));
                    let other = self.mirrored(&known.term, own);
                    let value = values[index];
                    let ring = less(value, sample(&known.around, &around, own), LEAST_RING);
                    let mirror = less(
                        value,
                        sample(&known.mirrored, &mirrored, other),
                        LEAST_MIRRORED,
                    );
                    let stratum = self.stratum(known.term.strata, &part, index, depths_mm[number]);
                    from_ring.push(known.from_ring.z(ring, stratum));
                    from_mirrored.push(known.from_mirrored.z(mirror, stratum));
                }
                [from_ring, from_mirrored]
            })
            .collect();
        // The junction of the head at the edge of the box, by its number in the junction of the head.
        let edge: Vec<(u32, usize)> = self
            .whole
            .junction
            .iter()
            .enumerate()
            .filter_map(|(number, &voxel)| {
                let voxel = block.grid.voxel(voxel as usize);
                let is_in_box =
                    (0..3).all(|axis| (outer[axis][0]..=outer[axis][1]).contains(&voxel[axis]));
                let in_box = || [0, 1, 2].map(|axis| voxel[axis] - first[axis]);
                (is_in_box && !is_inner(voxel))
                    .then(|| (part.block.grid.index(in_box()) as u32, number))
            })
            .collect();
        let mut junction: Vec<u32> = places.iter().map(|&place| place as u32).collect();
        junction.extend(edge.iter().map(|(voxel, _)| *voxel));
        let is_replaced = |place: DVec3| {
            let voxel = block
                .grid
                .voxel_from_patient()
                .transform_point3(place)
                .round();
            is_inner(voxel.to_array().map(|along| along as usize))
        };
        self.variants
            .iter()
            .map(|variant| {
                let mut joined = vec![variant.join.start(); places.len()];
                for sign in &variant.signs {
                    let mut scores: Vec<f32> = (0..places.len())
                        .map(|place| sign.score(&z, place))
                        .collect();
                    scores.extend(edge.iter().map(|(_, number)| sign.scores[*number]));
                    let scores = smoothed(
                        &part.block,
                        &junction,
                        &scores,
                        [variant.candidate_mm, variant.prior.into()],
                    );
                    for (joined, score) in joined.iter_mut().zip(scores) {
                        *joined = variant.join.of(*joined, score / sign.scale);
                    }
                }
                let mut new: Vec<(f32, DVec3)> = joined
                    .into_iter()
                    .enumerate()
                    .filter(|(place, score)| {
                        DEPTHS_MM.contains(&depths_mm[*place]) && !score.is_nan()
                    })
                    .map(|(place, score)| (score, positions[place]))
                    .collect();
                new.sort_by(|a, b| b.0.total_cmp(&a.0));
                let rest = variant
                    .sorted
                    .iter()
                    .map(|&(score, place)| (score, self.positions[place]));
                let rest = rest.filter(|(_, place)| !is_replaced(*place));
                let marks = greedy(merged(new.into_iter(), rest));
                false_marks_above(&marks, centre, lesion.radius_mm)
            })
            .collect()
    }

    /// The tissue scale of a box of the head with a lesion, with the bias and the means of the head without it.
    fn values_with(&self, lesion: &Lesion, first: [usize; 3], size: [usize; 3]) -> Vec<f32> {
        let Ground { head, block, .. } = self.ground;
        let Self { values, tissue, .. } = self;
        let volume = self.ground.with_lesion(lesion);
        let contrast = tissue.white - tissue.grey;
        let mut changed = Vec::with_capacity(size.iter().product());
        for number in 0..size[1] * size[2] {
            let row = [
                first[0],
                first[1] + number % size[1],
                first[2] + number / size[1],
            ];
            let in_block = block.grid.index(row);
            let there = [0, 1, 2].map(|axis| row[axis] + block.first[axis]);
            let native = volume.grid().index(there);
            for x in 0..size[0] {
                let value = values[in_block + x];
                let stored = [head.volume, &volume].map(|volume| volume.voxels()[native + x]);
                if stored[0] == stored[1] {
                    changed.push(value);
                    continue;
                }
                let [before, after] = stored.map(|stored| volume.intensity(f32::from(stored)));
                let per_bias = if before == 0.0 {
                    1.0
                } else {
                    (value * contrast + tissue.grey) / before
                };
                changed.push((after * per_bias - tissue.grey) / contrast);
            }
        }
        changed
    }
}

impl KnownSign {
    fn score(&self, z: &[Z], place: usize) -> f32 {
        let sum = |side: usize| -> f32 {
            self.terms
                .iter()
                .map(|&(term, weight)| weight * z[term][side][place])
                .sum()
        };
        self.rule.score(self.ring.z(sum(0)), self.mirror.z(sum(1)))
    }
}

impl Rule {
    /// Without a mirrored value, only the surroundings count.
    fn score(self, ring: f32, mirror: f32) -> f32 {
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
    fn start(self) -> f32 {
        match self {
            Self::Greatest => f32::NEG_INFINITY,
            Self::Sum => 0.0,
            Self::Least => f32::INFINITY,
        }
    }

    fn of(self, joined: f32, score: f32) -> f32 {
        match self {
            Self::Greatest => joined.max(score),
            Self::Sum => joined + score.max(0.0),
            Self::Least => joined.min(score),
        }
    }
}

/// A part of a block.
fn part_of(block: &Block, first: [usize; 3], size: [usize; 3]) -> Block {
    let grid = block.grid.block(first.map(|voxel| voxel as i64), size);
    let grid = grid.expect("a part of a grid is a grid");
    let zone = |index: usize| {
        let voxel = grid.voxel(index);
        block.zones[block
            .grid
            .index([0, 1, 2].map(|axis| voxel[axis] + first[axis]))]
    };
    Block {
        first: [0, 1, 2].map(|axis| block.first[axis] + first[axis]),
        size,
        spacing_mm: block.spacing_mm,
        zones: (0..grid.voxel_count()).map(zone).collect(),
        grid,
    }
}

fn pair(value: f32, weight: f32) -> Pair {
    if value.is_nan() {
        [0.0; 2]
    } else {
        [value * weight, weight]
    }
}

fn less(own: f32, [sum, weight]: Pair, least: f32) -> f32 {
    if weight > least {
        own - sum / weight
    } else {
        f32::NAN
    }
}

fn in_voxels(block: &Block, voxel: usize) -> DVec3 {
    DVec3::from_array(block.grid.voxel(voxel).map(|along| along as f64))
}

fn position(block: &Block, voxel: usize) -> DVec3 {
    block
        .grid
        .patient_from_voxel()
        .transform_point3(in_voxels(block, voxel))
}

fn depth(ground: &Ground<'_>, position: DVec3) -> f32 {
    let depth = ground.head.depth;
    let place: Vec3 = depth
        .grid()
        .voxel_from_patient()
        .transform_point3(position)
        .as_vec3();
    depth_at(depth, place)
}

/// Scores over the junction, smoothed over the junction alone.
fn smoothed(
    block: &Block,
    junction: &[u32],
    scores: &[f32],
    [sigma_mm, prior]: [f64; 2],
) -> Vec<f32> {
    let kernels = block.in_voxels(sigma_mm).map(Kernel::gaussian);
    let mut sums = vec![0.0; block.voxel_count()];
    let mut weights = vec![0.0; block.voxel_count()];
    for (&voxel, &score) in junction.iter().zip(scores) {
        if !score.is_nan() {
            sums[voxel as usize] = score;
            weights[voxel as usize] = 1.0;
        }
    }
    smooth(&mut sums, block.size, &kernels);
    smooth(&mut weights, block.size, &kernels);
    let mean =
        |&voxel: &u32| sums[voxel as usize] / (weights[voxel as usize] + prior as f32).max(1e-6);
    junction.iter().map(mean).collect()
}

/// Two descending sequences as one.
fn merged(
    a: impl Iterator<Item = (f32, DVec3)>,
    b: impl Iterator<Item = (f32, DVec3)>,
) -> impl Iterator<Item = (f32, DVec3)> {
    let (mut a, mut b) = (a.peekable(), b.peekable());
    std::iter::from_fn(move || match (a.peek(), b.peek()) {
        (Some(x), Some(y)) if x.0 >= y.0 => a.next(),
        (Some(_), None) => a.next(),
        _ => b.next(),
    })
}

/// Marks of descending scores, each at least 10 mm from every higher one.
fn greedy(places: impl Iterator<Item = (f32, DVec3)>) -> Vec<Mark> {
    let mut marks: Vec<Mark> = Vec::new();
    for (score, position_in_patient) in places {
        let is_apart = marks.iter().all(|mark| {
            mark.position_in_patient
                .distance_squared(position_in_patient)
                >= APART_MM * APART_MM
        });
        if is_apart {
            marks.push(Mark {
                position_in_patient,
                score,
            });
        }
        if marks.len() == MARKS {
            break;
        }
    }
    marks
}
