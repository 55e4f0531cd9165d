//! The seeds of the second transform.

use crate::DistanceMap;

/// The deepest places of the envelope, where its shrinking ends.
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
/// Where the envelope was closed by little or nothing, each bump and each notch of its surface makes maxima of its
/// own. As seeds they would stop the vertices near them at a shallow depth. The brain's own maxima lie far below
/// half of its depth (for one head: the two deepest at 58 mm, and with no closing some fifty, none but these below
/// 10 mm), so that the rule removes the spurious ones and keeps both hemispheres.
pub fn core(distance: &DistanceMap) -> Core {
    let squared = distance.squared();
    let least = squared[distance.deepest()].div_ceil(4);
    let mut maxima = Maxima {
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
    fn plateau_if_maximal(&mut self, index: usize, seen: &mut [bool]) -> Vec<u32> {
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

    /// The 26 neighbours that are inside; none of a voxel inside is beyond the grid.
    fn inside_neighbours(&self, index: usize) -> impl Iterator<Item = usize> {
        let neighbours = self
            .neighbours
            .iter()
            .map(move |&offset| index.strict_add_signed(offset));
        neighbours.filter(|&neighbour| self.distance.inside()[neighbour])
    }
}

/// Distances in the x-fastest order from a voxel to its 26 neighbours, in the order of that index.
pub(crate) fn neighbour_offsets([nx, ny, _]: [usize; 3]) -> [isize; 26] {
    let [nx, plane] = [nx as isize, (nx * ny) as isize];
    let offset = |code: isize| (code % 3 - 1) + nx * (code / 3 % 3 - 1) + plane * (code / 9 - 1);
    std::array::from_fn(|i| offset(if i < 13 { i } else { i + 1 } as isize))
}
