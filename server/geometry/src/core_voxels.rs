//! The seeds of the second transform.

use crate::DistanceMap;

/// The deepest voxels of the envelope, at which the shrinking ends.
///
/// Invariants: at least one voxel; indices ascend.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Core {
    voxels: Vec<u32>,
}

impl Core {
    #[cfg(test)]
    pub(crate) fn from_voxels(voxels: Vec<u32>) -> Self {
        Self { voxels }
    }

    /// Indices of the core voxels on the working grid, ascending; at least one.
    pub fn voxels(&self) -> &[u32] {
        &self.voxels
    }
}

/// The regional maxima of a distance map (26-neighbourhood) that are at least half as deep as its deepest voxel.
///
/// With little or no closing, each bump and each notch of the surface has its own maxima. As seeds they would stop the
/// vertices near them at a shallow depth. The true maxima of a brain are much deeper than half of its depth (in one
/// head: the two deepest at 58 mm; without closing about fifty more, all shallower than 10 mm), so this rule removes
/// the spurious ones and keeps both hemispheres.
pub fn core(distance: &DistanceMap) -> Core {
    let squared = distance.squared();
    let least = squared[distance.deepest()].div_ceil(4);
    let maxima = Maxima {
        distance,
        neighbours: neighbour_offsets(distance.grid().size()),
    };
    let mut seen = vec![false; squared.len()];
    let mut voxels = Vec::new();
    for index in 0..squared.len() {
        if distance.inside()[index] && squared[index] >= least && !seen[index] {
            voxels.extend(maxima.plateau_if_maximal(index, &mut seen));
        }
    }
    voxels.sort_unstable();
    Core { voxels }
}

struct Maxima<'a> {
    distance: &'a DistanceMap,
    neighbours: [isize; 26],
}

impl Maxima<'_> {
    /// The connected voxels of the same depth as `index`, if none of them has a deeper neighbour.
    fn plateau_if_maximal(&self, index: usize, seen: &mut [bool]) -> Vec<u32> {
        let depth = self.distance.squared()[index];
        let mut plateau = vec![index as u32];
        let mut is_maximal = true;
        let mut next = 0;
        seen[index] = true;
        while let Some(&voxel) = plateau.get(next) {
            next += 1;
            for neighbour in self.inside_neighbours(voxel as usize) {
                let depth_there = self.distance.squared()[neighbour];
                if depth_there > depth {
                    is_maximal = false;
                } else if depth_there == depth && !seen[neighbour] {
                    seen[neighbour] = true;
                    plateau.push(neighbour as u32);
                }
            }
        }
        if is_maximal { plateau } else { Vec::new() }
    }

    /// The 26 neighbours that are inside. No neighbour of a voxel inside is beyond the grid.
    fn inside_neighbours(&self, index: usize) -> impl Iterator<Item = usize> {
        let neighbours = self
            .neighbours
            .iter()
            .map(move |&offset| index.strict_add_signed(offset));
        neighbours.filter(|&neighbour| self.distance.inside()[neighbour])
    }
}

/// The offsets in the x-fastest order from a voxel to its 26 neighbours, ascending.
pub(crate) fn neighbour_offsets([nx, ny, _]: [usize; 3]) -> [isize; 26] {
    let [nx, plane] = [nx as isize, (nx * ny) as isize];
    let offset = |code: isize| (code % 3 - 1) + nx * (code / 3 % 3 - 1) + plane * (code / 9 - 1);
    std::array::from_fn(|i| offset(if i < 13 { i } else { i + 1 } as isize))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{distance_map, envelope, phantom};

    fn core_of(brain: &crate::BrainMask, closing_mm: f64) -> (DistanceMap, Core) {
        let distance = distance_map(&envelope(brain, closing_mm).unwrap());
        let core = core(&distance);
        (distance, core)
    }

    #[test]
    fn the_core_of_a_ball_is_its_centre() {
        let (distance, core) = core_of(&phantom::ball(20.0), 0.0);
        let middle = distance.grid().size().map(|side| side / 2);
        for &voxel in core.voxels() {
            let voxel = distance.grid().voxel(voxel as usize);
            assert!(
                (0..3).all(|axis| voxel[axis].abs_diff(middle[axis]) <= 1),
                "{voxel:?}"
            );
        }
    }

    #[test]
    fn both_lobes_have_a_core() {
        let (distance, core) = core_of(&phantom::two_lobes([20.0, 16.0], 40.0, 5.0), 0.0);
        let middle = distance.grid().size()[0] / 2;
        let is_left = |&voxel: &u32| distance.grid().voxel(voxel as usize)[0] < middle;
        let left = core.voxels().iter().filter(|voxel| is_left(voxel)).count();
        assert!(left > 0 && left < core.voxels().len());
    }

    #[test]
    fn shallow_maxima_of_a_bumpy_surface_are_no_core() {
        // A ball with pits of a few voxels: without a closing, each pit has maxima beside it.
        let ball = phantom::ball(24.0);
        let grid = ball.mask().grid().clone();
        let centre = grid.size().map(|side| (side / 2) as f64);
        let is_pit = |voxel: [usize; 3]| {
            let offset = [0, 1, 2].map(|axis| voxel[axis] as f64 - centre[axis]);
            let radius = offset.iter().map(|along| along * along).sum::<f64>().sqrt();
            let block = offset.map(|along| (along / 3.0).floor() as i32);
            let hash = block
                .into_iter()
                .fold(7i32, |hash, part| (hash ^ part).wrapping_mul(0x2545_f491));
            radius > 18.0 && (hash >> 16) % 3 == 0
        };
        let voxels = (0..grid.voxel_count())
            .map(|index| ball.mask().voxels()[index] && !is_pit(grid.voxel(index)))
            .collect();
        let pitted = crate::Mask::new(grid.clone(), voxels).unwrap();
        let pitted = crate::BrainMask::from_mask(&pitted, &grid).unwrap();
        let (distance, core) = core_of(&pitted, 0.0);
        let maxima = Maxima {
            distance: &distance,
            neighbours: neighbour_offsets(grid.size()),
        };
        let mut seen = vec![false; distance.squared().len()];
        let all: usize = (0..seen.len())
            .filter(|&index| distance.inside()[index])
            .map(|index| {
                if seen[index] {
                    0
                } else {
                    maxima.plateau_if_maximal(index, &mut seen).len()
                }
            })
            .sum();
        assert!(
            all >= core.voxels().len() + 10,
            "{all} maxima, {} in the core",
            core.voxels().len()
        );
        for &voxel in core.voxels() {
            let depth = distance.depth_mm(voxel as usize).unwrap();
            assert!(depth >= distance.max_depth_mm() / 2.0);
        }
    }
}
