//! The scores of the variants in the head with a lesion, computed again around it.

use glam::{DAffine3, DVec3};

use super::known::Z;
use super::places::{depth, greedy, less, merged, pair, part_of, position, smoothed};
use super::{DEPTHS_MM, LEAST_MIRRORED, LEAST_RING, STEP_MM, Tested};
use crate::coarse::{Coarse, Pair};
use crate::study::{Ground, Lesion, false_marks_above};
use crate::tests::variants::measures::Part;

/// The extent of the filters of all measures, in mm.
const FILTERS_MM: f64 = 9.0;

impl Tested<'_> {
    /// For each variant, the number of false marks above a lesion; `None` if it is not found.
    pub(crate) fn false_marks(&self, lesion: &Lesion) -> Vec<Option<usize>> {
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
