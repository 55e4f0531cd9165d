//! The forest of optimal paths, and its leaks.

use geometry::Mask;

/// No predecessor: a voxel of the marker.
const ROOT: u8 = 6;

/// Not reached.
const NONE: u8 = 7;

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
        let mut predecessors = vec![NONE; gradient.len()];
        let highest = gradient.iter().copied().max().unwrap_or_default();
        // A voxel is first reached at its least cost, so no voxel moves in the queue.
        let mut queue = vec![Vec::new(); usize::from(highest) + 1];
        for (index, &is_marked) in marker.voxels().iter().enumerate() {
            if is_marked {
                predecessors[index] = ROOT;
                queue[0].push(index as u32);
            }
        }
        for cost in 0..queue.len() {
            let mut next = 0;
            while let Some(&voxel) = queue[cost].get(next) {
                next += 1;
                for (direction, neighbour) in neighbours(size, voxel as usize) {
                    if predecessors[neighbour] == NONE && reach.voxels()[neighbour] {
                        predecessors[neighbour] = direction ^ 1;
                        let cost = cost.max(usize::from(gradient[neighbour]));
                        queue[cost].push(neighbour as u32);
                    }
                }
            }
        }
        Self {
            size,
            predecessors,
            order: queue.concat(),
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
            let within = neighbours(self.size, voxel as usize);
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

/// The neighbours of a voxel that share a face with it, each with the number of its direction; opposite directions
/// differ in the last bit.
fn neighbours([nx, ny, nz]: [usize; 3], voxel: usize) -> impl Iterator<Item = (u8, usize)> {
    let [x, y, z] = [voxel % nx, voxel / nx % ny, voxel / (nx * ny)];
    let steps = [(x, nx, 1), (y, ny, nx), (z, nz, nx * ny)];
    steps
        .into_iter()
        .zip(0u8..)
        .flat_map(move |((place, side, step), axis)| {
            let before = (place > 0).then(|| (2 * axis, voxel - step));
            let after = (place + 1 < side).then(|| (2 * axis + 1, voxel + step));
            before.into_iter().chain(after)
        })
}
