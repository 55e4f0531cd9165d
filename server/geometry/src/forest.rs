//! The optimal-path forest of the second Euclidean transform.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use crate::core_voxels::neighbour_offsets;
use crate::grid::voxel_at;
use crate::nearest_core::NearestCore;
use crate::{Core, DistanceMap, Grid};

/// The predecessor of each voxel of the envelope on an optimal path from the core.
///
/// This is the second Euclidean image foresting transform of the paper: the seeds are the voxels of the core, there are
/// 26 neighbours, and the cost of a path is the Euclidean distance from its root to its end. That cost depends on the
/// root alone, so every path to the nearest root is optimal. This forest uses the path closest to the straight line,
/// and needs no queue if that line lies in the envelope; otherwise ordered propagation leads around the bay.
///
/// Invariant: every path ends at a root after finitely many steps, all inside the envelope.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Forest {
    size: [usize; 3],
    predecessor: Vec<u8>,
}

impl Forest {
    /// Code of a voxel outside the envelope.
    pub const OUTSIDE: u8 = 255;
    /// Code of a root. The others, 0 to 26, are neighbours: `(dx + 1) + 3 (dy + 1) + 9 (dz + 1)`.
    pub const ROOT: u8 = 13;

    /// A forest from stored codes; `None` unless every path ends at a root.
    pub fn from_stored(grid: &Grid, predecessor: Vec<u8>) -> Option<Self> {
        let size = grid.size();
        let forest =
            (predecessor.len() == grid.voxel_count()).then_some(Self { size, predecessor })?;
        forest.every_path_ends().then_some(forest)
    }

    /// Predecessor codes, x-fastest.
    pub fn predecessor(&self) -> &[u8] {
        &self.predecessor
    }

    /// The voxel before `index` on its path; `None` for a root and outside the envelope.
    #[inline]
    pub fn step(&self, index: usize) -> Option<usize> {
        match self.predecessor[index] {
            Self::ROOT | Self::OUTSIDE => None,
            code => Some(index.wrapping_add_signed(offset_of(code, self.size))),
        }
    }

    /// The voxels from `index` to its root, inclusive.
    pub fn path(&self, index: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(index), |&voxel| self.step(voxel))
    }

    /// The end of the path of `index`.
    pub fn root(&self, index: usize) -> usize {
        self.path(index).last().unwrap_or(index)
    }

    /// Follows each voxel to a root, or to a voxel that is known to lead to one.
    fn every_path_ends(&self) -> bool {
        let mut ends = vec![false; self.predecessor.len()];
        let mut path = Vec::new();
        for start in 0..ends.len() {
            let mut voxel = start;
            while self.predecessor[voxel] != Self::OUTSIDE && !ends[voxel] {
                // Marked at once: a cycle is detected by its length below.
                path.push(voxel);
                if self.predecessor[voxel] == Self::ROOT {
                    break;
                }
                match self.checked_step(voxel) {
                    Some(next) if path.len() <= ends.len() => voxel = next,
                    _ => return false,
                }
            }
            for voxel in path.drain(..) {
                ends[voxel] = true;
            }
        }
        true
    }

    /// Like [`Forest::step`], for untrusted codes: `None` if the step leaves the grid or the envelope.
    fn checked_step(&self, index: usize) -> Option<usize> {
        let [nx, ny, nz] = self.size;
        let code = usize::from(self.predecessor[index]);
        let place = voxel_at(index, self.size);
        let step = [code % 3, code / 3 % 3, code / 9];
        let is_inside = |axis: usize, side: usize| (1..=side).contains(&(place[axis] + step[axis]));
        if code > 26 || !is_inside(0, nx) || !is_inside(1, ny) || !is_inside(2, nz) {
            return None;
        }
        let next = index.wrapping_add_signed(offset_of(code as u8, self.size));
        (self.predecessor[next] != Self::OUTSIDE).then_some(next)
    }
}

/// The offset in the x-fastest order for a predecessor code.
#[inline]
fn offset_of(code: u8, [nx, ny, _]: [usize; 3]) -> isize {
    let code = isize::from(code);
    (code % 3 - 1) + nx as isize * ((code / 3 % 3 - 1) + ny as isize * (code / 9 - 1))
}

/// The code of the neighbour a step away; each component is -1, 0 or 1.
#[inline]
fn code_of([dx, dy, dz]: [i32; 3]) -> u8 {
    (13 + dx + 3 * dy + 9 * dz) as u8
}

/// The second Euclidean transform: every voxel of the envelope joined to its nearest core voxel.
///
/// The distance to the root of a path is the exact distance to the nearest core voxel, except for voxels at the border
/// between the regions of two roots, where 26 neighbours cannot always follow it, and for voxels without a straight
/// line to their nearest root inside the envelope.
pub fn forest(distance: &DistanceMap, core: &Core) -> Forest {
    let nearest = NearestCore::new(distance.grid().size(), core, distance.inside());
    let mut forest = straight_forest(distance.inside(), &nearest);
    let stranded = take_stranded(&mut forest, distance);
    reach_stranded(&mut forest, &nearest, &stranded);
    forest
}

/// Code of a voxel if the straight line to its root leaves the envelope.
const STRANDED: u8 = 254;

/// The step of each voxel towards its nearest root, or [`STRANDED`].
fn straight_forest(inside: &[bool], nearest: &NearestCore) -> Forest {
    let size = nearest.size();
    let [nx, ny, _] = size;
    let mut predecessor = vec![Forest::OUTSIDE; inside.len()];
    let rows = predecessor.par_chunks_mut(nx).zip(inside.par_chunks(nx));
    rows.enumerate().for_each(|(row, (codes, inside_row))| {
        let (y, z) = (row % ny, row / ny);
        for (x, (code, &is_inside)) in codes.iter_mut().zip(inside_row).enumerate() {
            if is_inside {
                *code = straight_step(nearest, inside, [x, y, z], row * nx + x);
            }
        }
    });
    Forest { size, predecessor }
}

/// The neighbour closest to the straight line from a voxel to its root, if it is inside and has the same root.
#[inline]
fn straight_step(nearest: &NearestCore, inside: &[bool], voxel: [usize; 3], index: usize) -> u8 {
    let root = nearest.core_of(index);
    let way = nearest.way(voxel, root);
    let longest = way[0].abs().max(way[1].abs()).max(way[2].abs());
    let step = way.map(|along| {
        if 2 * along.abs() >= longest {
            along.signum()
        } else {
            0
        }
    });
    let [nx, ny, _] = nearest.size().map(|side| side as isize);
    let [dx, dy, dz] = step.map(|along| along as isize);
    let next = index.wrapping_add_signed(dx + nx * (dy + ny * dz));
    if inside[next] && (nearest.core_of(next) == root || longest == 0) {
        return code_of(step);
    }
    best_step(nearest, inside, voxel, index).unwrap_or(STRANDED)
}

/// The neighbour inside with the same root that is nearest to that root, if it is nearer than the voxel itself.
///
/// Without one, a neighbour with another root that is strictly nearer to its own root.
fn best_step(
    nearest: &NearestCore,
    inside: &[bool],
    voxel: [usize; 3],
    index: usize,
) -> Option<u8> {
    let root = nearest.core_of(index);
    let cost = squared_length(nearest.way(voxel, root));
    let steps = (0..27u8).filter_map(|code| {
        let next = index.wrapping_add_signed(offset_of(code, nearest.size()));
        let is_candidate = code != Forest::ROOT && inside[next];
        is_candidate.then(|| {
            let root_there = nearest.core_of(next);
            let cost_there = squared_length(nearest.way(nearest.voxel(next), root_there));
            (root_there != root, cost_there, code)
        })
    });
    steps
        .filter(|&(_, cost_there, _)| cost_there < cost)
        .min()
        .map(|(_, _, code)| code)
}

#[inline]
fn squared_length([x, y, z]: [i32; 3]) -> u32 {
    (x * x + y * y + z * z) as u32
}

/// Also marks voxels as stranded if their path ends at a stranded one, and lists all of them.
fn take_stranded(forest: &mut Forest, distance: &DistanceMap) -> Vec<u32> {
    let stranded = memchr::memchr_iter(STRANDED, &forest.predecessor);
    let mut stranded: Vec<_> = stranded.map(|index| index as u32).collect();
    let offsets = neighbour_offsets(forest.size);
    let mut next = 0;
    while let Some(&voxel) = stranded.get(next) {
        next += 1;
        for offset in offsets {
            let neighbour = (voxel as usize).wrapping_add_signed(offset);
            let is_follower = distance.inside()[neighbour]
                && forest.predecessor[neighbour] != STRANDED
                && forest.step(neighbour) == Some(voxel as usize);
            if is_follower {
                forest.predecessor[neighbour] = STRANDED;
                stranded.push(neighbour as u32);
            }
        }
    }
    stranded
}

/// Reaches the stranded voxels from the others by ordered propagation.
///
/// The cost of a path is the distance to its root, but not less than the cost of the path it extends, so that the order
/// of the queue is the order of reaching.
fn reach_stranded(forest: &mut Forest, nearest: &NearestCore, stranded: &[u32]) {
    let offsets = neighbour_offsets(forest.size);
    let mut queue = BinaryHeap::new();
    let offer = |queue: &mut BinaryHeap<_>, from: usize, to: usize, root: u32, cost: u32| {
        let cost = cost.max(squared_length(nearest.way(nearest.voxel(to), root)));
        queue.push(Reverse((cost, to as u32, from as u32, root)));
    };
    for &voxel in stranded {
        for offset in offsets {
            let neighbour = (voxel as usize).wrapping_add_signed(offset);
            if forest.predecessor[neighbour] < 27 {
                let root = nearest.core_of(neighbour);
                offer(&mut queue, neighbour, voxel as usize, root, 0);
            }
        }
    }
    while let Some(Reverse((cost, voxel, from, root))) = queue.pop() {
        let voxel = voxel as usize;
        if forest.predecessor[voxel] != STRANDED {
            continue;
        }
        let (here, there) = (nearest.voxel(voxel), nearest.voxel(from as usize));
        let step = [0, 1, 2].map(|axis| there[axis] as i32 - here[axis] as i32);
        forest.predecessor[voxel] = code_of(step);
        for offset in offsets {
            let neighbour = voxel.wrapping_add_signed(offset);
            if forest.predecessor[neighbour] == STRANDED {
                offer(&mut queue, voxel, neighbour, root, cost);
            }
        }
    }
    debug_assert!(
        !forest.predecessor.contains(&STRANDED),
        "the envelope is one component"
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{core, distance_map, envelope, phantom};

    fn cases() -> Vec<(&'static str, DistanceMap, Core)> {
        let banana = || {
            // Three quarters of a ring: most voxels have no straight line to their nearest core voxel.
            let ring = phantom::ball(24.0);
            let grid = ring.mask().grid().clone();
            let middle = grid.size().map(|side| (side / 2) as f64);
            let is_ring = |voxel: [usize; 3]| {
                let [x, y, z] = [0, 1, 2].map(|axis| voxel[axis] as f64 - middle[axis]);
                let is_open = x > 0.0 && y > 0.0;
                ((x.hypot(y) - 16.0).hypot(z) < 6.0 + 0.1 * x) && !is_open
            };
            let voxels = (0..grid.voxel_count())
                .map(|index| is_ring(grid.voxel(index)))
                .collect();
            crate::BrainMask::from_mask(&crate::Mask::new(grid.clone(), voxels).unwrap(), &grid)
                .unwrap()
        };
        [
            ("ball", phantom::ball(20.0)),
            ("ellipsoid", phantom::ellipsoid([30.0, 14.0, 17.0], 1.0)),
            ("two lobes", phantom::two_lobes([18.0, 14.0], 34.0, 6.0)),
            ("ring", banana()),
        ]
        .into_iter()
        .map(|(name, brain)| {
            let distance = distance_map(&envelope(&brain, 0.0).unwrap());
            let core = core(&distance);
            (name, distance, core)
        })
        .collect()
    }

    fn length(grid: &Grid, a: usize, b: usize) -> f64 {
        let (a, b) = (grid.voxel(a), grid.voxel(b));
        (0..3)
            .map(|axis| (a[axis] as f64 - b[axis] as f64).powi(2))
            .sum::<f64>()
            .sqrt()
    }

    #[test]
    fn every_path_leads_by_single_steps_through_the_envelope_to_a_root() {
        for (name, distance, core) in cases() {
            let forest = forest(&distance, &core);
            for index in 0..distance.inside().len() {
                if !distance.inside()[index] {
                    assert_eq!(forest.predecessor()[index], Forest::OUTSIDE);
                    continue;
                }
                let mut deepest = distance.depth_mm(index).unwrap();
                let mut end = index;
                for (here, next) in forest.path(index).zip(forest.path(index).skip(1)) {
                    assert!(
                        length(distance.grid(), here, next) < 1.8,
                        "{name}: a step of a voxel"
                    );
                    // Depth changes by at most the length of the step, so no depth is skipped.
                    let change =
                        distance.depth_mm(next).unwrap() - distance.depth_mm(here).unwrap();
                    assert!(f64::from(change.abs()) <= length(distance.grid(), here, next) + 1e-4);
                    deepest = deepest.max(distance.depth_mm(next).unwrap());
                    end = next;
                }
                assert!(
                    core.voxels().binary_search(&(end as u32)).is_ok(),
                    "{name}: no root"
                );
                assert!(deepest >= distance.depth_mm(end).unwrap());
            }
            assert!(Forest::from_stored(distance.grid(), forest.predecessor().to_vec()).is_some());
        }
    }

    /// The image foresting transform by definition: an ordered queue over 26 neighbours.
    fn reference_costs(distance: &DistanceMap, core: &Core) -> Vec<f64> {
        let grid = distance.grid();
        let mut costs = vec![f64::INFINITY; grid.voxel_count()];
        let mut is_done = vec![false; costs.len()];
        let mut queue: BinaryHeap<Reverse<(u64, usize, usize)>> = BinaryHeap::new();
        let key = |cost: f64| (cost * 1e6) as u64;
        for &root in core.voxels() {
            costs[root as usize] = 0.0;
            queue.push(Reverse((0, root as usize, root as usize)));
        }
        while let Some(Reverse((_, voxel, root))) = queue.pop() {
            if std::mem::replace(&mut is_done[voxel], true) {
                continue;
            }
            costs[voxel] = length(grid, voxel, root);
            for offset in neighbour_offsets(grid.size()) {
                let neighbour = voxel.wrapping_add_signed(offset);
                let cost = length(grid, neighbour, root);
                if distance.inside()[neighbour] && !is_done[neighbour] && cost < costs[neighbour] {
                    costs[neighbour] = cost;
                    queue.push(Reverse((key(cost), neighbour, root)));
                }
            }
        }
        costs
    }

    #[test]
    fn costs_are_the_exact_distances_wherever_the_way_is_free() {
        for (name, distance, core) in cases() {
            let forest = forest(&distance, &core);
            let reference = reference_costs(&distance, &core);
            let mut free = 0;
            for index in (0..distance.inside().len()).filter(|&index| distance.inside()[index]) {
                let cost = length(distance.grid(), index, forest.root(index));
                let nearest = core
                    .voxels()
                    .iter()
                    .map(|&root| length(distance.grid(), index, root as usize));
                let exact = nearest.fold(f64::INFINITY, f64::min);
                assert!(cost >= exact - 1e-9, "{name}");
                // The tolerance of the queue, 0.1 voxel, is that of 26 neighbours (0.081 is known for distances).
                if reference[index] <= exact + 0.1 {
                    free += 1;
                    assert!(cost <= exact + 0.1, "{name}: {cost} for {exact}");
                } else {
                    assert!(
                        cost <= reference[index] + 2.0,
                        "{name}: {cost} for {}",
                        reference[index]
                    );
                }
            }
            assert!(free > 100, "{name}: {free} voxels see their root");
        }
    }

    #[test]
    fn a_stored_forest_that_leads_nowhere_is_refused() {
        let (_, distance, core) = cases().swap_remove(0);
        let grid = distance.grid();
        let sound = forest(&distance, &core).predecessor().to_vec();
        let inside = (0..sound.len())
            .find(|&index| sound[index] < 27 && sound[index] != Forest::ROOT)
            .unwrap();
        for damage in [Forest::OUTSIDE - 1, 27, Forest::OUTSIDE] {
            let mut codes = sound.clone();
            // The voxel before: its successor then leads out of the envelope, or to an invalid code.
            let next = inside.wrapping_add_signed(offset_of(codes[inside], grid.size()));
            codes[next] = damage;
            assert_eq!(Forest::from_stored(grid, codes), None, "{damage}");
        }
        let mut circle = sound.clone();
        let next = inside.wrapping_add_signed(offset_of(circle[inside], grid.size()));
        circle[next] = 26 - circle[inside];
        assert_eq!(Forest::from_stored(grid, circle), None);
        assert_eq!(Forest::from_stored(grid, sound[1..].to_vec()), None);
    }
}
