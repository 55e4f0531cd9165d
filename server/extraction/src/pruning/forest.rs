//! The forest of optimal paths, and its leaks.

use geometry::{Mask, face_neighbours, flood};

/// No predecessor: a voxel of the marker.
const ROOT: u8 = 6;

/// Not reached.
const NONE: u8 = 7;

/// Out of reach.
const OUTSIDE: u8 = 8;

/// Paths from the marker to every voxel within reach that minimise the greatest gradient on the path.
#[derive(Debug)]
pub(super) struct Forest {
    size: [usize; 3],
    /// The neighbour from which each voxel was reached.
    predecessors: Vec<u8>,
    /// Voxels in the order of reaching: each one after its predecessor.
    order: Vec<u32>,
}

/// The leak of a path: the node with the most descendants; among equals, the one with the largest gradient.
#[derive(Debug, Clone, Copy)]
struct Leak {
    voxel: u32,
    descendants: u32,
}

impl Forest {
    /// The image foresting transform with the greatest gradient of a path as its cost, over six neighbours; among paths
    /// of equal cost, the first one found.
    pub(super) fn grown(gradient: &[u16], marker: &Mask, reach: &Mask) -> Self {
        let size = marker.grid().size();
        let within = reach.voxels().iter();
        let reached = |&is_within: &bool| if is_within { NONE } else { OUTSIDE };
        let mut predecessors: Vec<u8> = within.map(reached).collect();
        let mut seeds = Vec::new();
        for (index, &is_marked) in marker.voxels().iter().enumerate() {
            if is_marked {
                predecessors[index] = ROOT;
                seeds.push(index as u32);
            }
        }
        let level = |index: usize| gradient[index];
        let back = |_, direction| direction ^ 1;
        let order = flood(size, level, (&mut predecessors, NONE), seeds, back);
        Self {
            size,
            predecessors,
            order,
        }
    }

    /// The predecessor of a voxel; `None` for a voxel of the marker.
    fn predecessor(&self, voxel: u32) -> Option<usize> {
        let [nx, ny, _] = self.size;
        let voxel = voxel as usize;
        match self.predecessors[voxel] {
            0 => Some(voxel - 1),
            1 => Some(voxel + 1),
            2 => Some(voxel - nx),
            3 => Some(voxel + nx),
            4 => Some(voxel - nx * ny),
            5 => Some(voxel + nx * ny),
            _ => None,
        }
    }

    /// The voxels that remain when each path to the border of `reach` is cut at its leak; x-fastest.
    pub(super) fn pruned(&self, gradient: &[u16], reach: &Mask) -> Vec<bool> {
        let ends = self.ends(reach);
        let mut descendants = vec![0u32; gradient.len()];
        for &end in &ends {
            descendants[end as usize] = 1;
        }
        for &voxel in self.order.iter().rev() {
            if let Some(predecessor) = self.predecessor(voxel) {
                descendants[predecessor] += descendants[voxel as usize];
            }
        }
        let mut leaks = vec![None; gradient.len()];
        for &voxel in &self.order {
            let descendants = descendants[voxel as usize];
            if let (Some(predecessor), 1..) = (self.predecessor(voxel), descendants) {
                let here = Leak { voxel, descendants };
                leaks[voxel as usize] = Some(match leaks[predecessor] {
                    Some(leak) => worse_leak(leak, here, gradient),
                    None => here,
                });
            }
        }
        let mut kept = vec![false; gradient.len()];
        let mut is_cut = vec![false; gradient.len()];
        for leak in ends.iter().filter_map(|&end| leaks[end as usize]) {
            is_cut[leak.voxel as usize] = true;
        }
        for &voxel in &self.order {
            let is_held = self
                .predecessor(voxel)
                .is_none_or(|predecessor| kept[predecessor]);
            kept[voxel as usize] = is_held && !is_cut[voxel as usize];
        }
        kept
    }

    /// The reached voxels with a neighbour out of reach or outside the grid.
    fn ends(&self, reach: &Mask) -> Vec<u32> {
        let is_end = |&&voxel: &&u32| {
            let within = face_neighbours(self.size, voxel as usize);
            within
                .filter(|&(_, neighbour)| reach.voxels()[neighbour])
                .count()
                < 6
        };
        self.order.iter().filter(is_end).copied().collect()
    }
}

fn worse_leak(so_far: Leak, here: Leak, gradient: &[u16]) -> Leak {
    let strength = |leak: Leak| (leak.descendants, gradient[leak.voxel as usize]);
    if strength(here) > strength(so_far) {
        here
    } else {
        so_far
    }
}
