//! The image foresting transform with the greatest level of a path as its cost: a watershed.

use crate::grid::voxel_at;

/// Floods a grid from seeds along paths whose greatest level is least, over six neighbours; among paths of equal cost,
/// the first one found. Returns the voxels in the order of reaching, the seeds first.
///
/// Every voxel has a mark. The flood enters voxels with the mark `open` alone, which must not be the mark of a seed, and
/// marks each with `mark(from, direction)`: from the mark of the voxel before it on its path and the direction of the
/// step (0 to 5: before and after along x, y and z). The level of a seed does not count.
///
/// A flood whose marks are copied is a watershed of the seeds; one whose marks are directions is a forest of optimal
/// paths.
///
/// Source: Falcão, Stolfi and Lotufo, "The Image Foresting Transform: Theory, Algorithms, and Applications", IEEE
/// Transactions on Pattern Analysis and Machine Intelligence 26, 2004.
pub fn flood(
    size: [usize; 3],
    level: impl Fn(usize) -> u16,
    (marks, open): (&mut [u8], u8),
    seeds: impl IntoIterator<Item = u32>,
    mark: impl Fn(u8, u8) -> u8,
) -> Vec<u32> {
    // A voxel is first reached at its least cost, so no voxel moves in the queue.
    let mut queue: Vec<Vec<u32>> = vec![seeds.into_iter().collect()];
    let mut cost = 0;
    while cost < queue.len() {
        let mut next = 0;
        while let Some(&voxel) = queue[cost].get(next) {
            next += 1;
            let here = marks[voxel as usize];
            for (direction, neighbour) in face_neighbours(size, voxel as usize) {
                if marks[neighbour] != open {
                    continue;
                }
                marks[neighbour] = mark(here, direction);
                let cost = cost.max(usize::from(level(neighbour)));
                if queue.len() <= cost {
                    queue.resize_with(cost + 1, Vec::new);
                }
                queue[cost].push(neighbour as u32);
            }
        }
        cost += 1;
    }
    queue.concat()
}

/// The neighbours of a voxel that share a face with it, each with the number of its direction; opposite directions differ
/// in the last bit.
#[inline]
pub fn face_neighbours(size: [usize; 3], voxel: usize) -> impl Iterator<Item = (u8, usize)> {
    let ([nx, ny, nz], [x, y, z]) = (size, voxel_at(voxel, size));
    let before = |is_there: bool, step: usize| is_there.then(|| voxel - step);
    let after = |is_there: bool, step: usize| is_there.then(|| voxel + step);
    let neighbours = [
        before(x > 0, 1),
        after(x + 1 < nx, 1),
        before(y > 0, nx),
        after(y + 1 < ny, nx),
        before(z > 0, nx * ny),
        after(z + 1 < nz, nx * ny),
    ];
    let numbered = (0..).zip(neighbours);
    numbered.filter_map(|(direction, neighbour)| Some((direction, neighbour?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels with a ridge between two basins, which is lowest in one place.
    const LEVELS: [u16; 27] = [
        0, 1, 1, 5, 2, 1, 0, 3, 0, //
        1, 0, 2, 5, 4, 0, 1, 2, 0, //
        2, 0, 1, 6, 3, 0, 1, 1, 2,
    ];
    const SIZE: [usize; 3] = [9, 3, 1];

    #[test]
    fn each_basin_gets_the_mark_of_its_seed_and_meets_the_other_at_the_ridge() {
        let mut marks = [0u8; 27];
        (marks[0], marks[8]) = (1, 2);
        let order = flood(
            SIZE,
            |index| LEVELS[index],
            (&mut marks, 0),
            [0, 8],
            |mark, _| mark,
        );
        assert_eq!(order.len(), 27);
        for (index, &mark) in marks.iter().enumerate() {
            match index % 9 {
                0..=2 => assert_eq!(mark, 1, "{index}"),
                4.. => assert_eq!(mark, 2, "{index}"),
                _ => assert_ne!(mark, 0),
            }
        }
    }

    #[test]
    fn the_greatest_level_of_a_path_is_the_least_possible() {
        const ROOT: u8 = 6;
        const OPEN: u8 = 7;
        let mut marks = [OPEN; 27];
        marks[0] = ROOT;
        // A closed voxel is never entered.
        marks[1] = 8;
        let order = flood(
            SIZE,
            |index| LEVELS[index],
            (&mut marks, OPEN),
            [0],
            |_, direction| direction ^ 1,
        );
        assert_eq!((order[0], order.len(), marks[1]), (0, 26, 8));
        let greatest = |mut voxel: usize| {
            let mut greatest = 0;
            while marks[voxel] != ROOT {
                greatest = greatest.max(LEVELS[voxel]);
                let back =
                    face_neighbours(SIZE, voxel).find(|(direction, _)| *direction == marks[voxel]);
                voxel = back.unwrap().1;
            }
            greatest
        };
        // Relaxed until nothing changes.
        let mut least = [u16::MAX; 27];
        least[0] = 0;
        for _ in 0..27 {
            for voxel in (0..27).filter(|&voxel| voxel != 1) {
                for (_, neighbour) in face_neighbours(SIZE, voxel) {
                    let through = least[neighbour].max(LEVELS[voxel]);
                    if neighbour != 1 && voxel != 0 && least[neighbour] < u16::MAX {
                        least[voxel] = least[voxel].min(through);
                    }
                }
            }
        }
        for voxel in (0..27).filter(|&voxel| voxel != 1) {
            assert_eq!(greatest(voxel), least[voxel], "{voxel}");
        }
    }
}
