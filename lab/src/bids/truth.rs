//! Truths: lesions that people drew, each on its own grid.

use std::collections::HashSet;

use geometry::{Grid, Mask};
use glam::{DAffine3, DVec3};
use serde::Serialize;

use crate::study::{HIT_MM, Touch};

/// The rules by which marks are compared with truths.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rules {
    /// A mark within this distance of the border of a truth, or inside, hits it, in mm.
    pub hit_mm: f64,
    /// A truth larger than this counts as large, in ml.
    pub large_ml: f64,
    /// The hit of a large truth must also be within this distance of its centre, in mm.
    pub from_centre_mm: f64,
    /// A connected part of a truth is a lesion if it is larger than this, in ml.
    pub least_ml: f64,
}

impl Rules {
    /// The rules of the trial.
    pub const STANDARD: Self = Self {
        hit_mm: HIT_MM,
        large_ml: 20.0,
        from_centre_mm: 20.0,
        least_ml: 0.3,
    };
}

/// A connected part of a truth.
#[derive(Debug, Clone, PartialEq)]
struct Part {
    grid: Grid,
    /// From the patient space of the head to that of the truth.
    truth_from_head: DAffine3,
    /// The indices of its voxels.
    voxels: HashSet<u32>,
    /// The voxels at its border.
    border: Vec<DVec3>,
    /// The corners of the box of its voxels, LPS mm of the truth.
    bounds: [DVec3; 2],
    centre_in_head: DVec3,
    volume_ml: f64,
}

/// A lesion: a connected part of a truth, with the parts of other truths that overlap it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Lesion {
    /// The largest part first.
    parts: Vec<Part>,
}

/// The lesions of a head.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Lesions {
    /// Each counts once.
    pub(super) lesions: Vec<Lesion>,
    /// Parts that are too small: marks near them are neither hits nor false.
    pub(super) small: Vec<Lesion>,
}

impl Lesions {
    /// The lesions of the truths of a head, which are given with their places in the head.
    ///
    /// A part larger than the least volume is a lesion. If no part is, the largest one is the only lesion.
    pub(super) fn of(truths: &[(Mask, DAffine3)], rules: &Rules) -> Self {
        let mut found: Vec<Lesion> = Vec::new();
        for (mask, head_from_truth) in truths {
            let parts = parts(mask, *head_from_truth);
            let (own, known) = (parts.into_iter(), found.len());
            for part in own {
                // Parts of one truth do not touch each other.
                let other = found[..known].iter_mut().find(|other| other.meets(&part));
                match other {
                    Some(other) => other.add(part),
                    None => found.push(Lesion { parts: vec![part] }),
                }
            }
        }
        found.sort_by(|one, other| other.volume_ml().total_cmp(&one.volume_ml()));
        let large = found.partition_point(|lesion| lesion.volume_ml() > rules.least_ml);
        let small = found.split_off(large.max(1).min(found.len()));
        Self {
            lesions: found,
            small,
        }
    }

    /// What a mark is to each lesion. `moved` is the position at which it meets them.
    pub(super) fn touches(&self, position_in_head: DVec3, rules: &Rules) -> Vec<Touch> {
        let mut touches: Vec<Touch> = self
            .lesions
            .iter()
            .map(|lesion| lesion.touch(position_in_head, rules))
            .collect();
        let is_near_any = touches.iter().any(|touch| *touch != Touch::False)
            || self
                .small
                .iter()
                .any(|part| part.touch(position_in_head, rules) != Touch::False);
        for touch in &mut touches {
            // The hit of another lesion is no false mark.
            if is_near_any && *touch == Touch::False {
                *touch = Touch::Near;
            }
        }
        touches
    }
}

impl Lesion {
    /// Its volume; the largest one if several truths show it.
    pub(super) fn volume_ml(&self) -> f64 {
        self.parts[0].volume_ml
    }

    /// The centre of gravity of its largest part, LPS mm of the head.
    pub(super) fn centre_in_head(&self) -> DVec3 {
        self.parts[0].centre_in_head
    }

    /// The distance of a position from its border, in mm; 0 inside.
    pub(super) fn distance_mm(&self, position_in_head: DVec3) -> f64 {
        let distances = self
            .parts
            .iter()
            .map(|part| part.distance_mm(position_in_head));
        distances.fold(f64::INFINITY, f64::min)
    }

    /// What a mark at a position is to this lesion alone.
    pub(super) fn touch(&self, position_in_head: DVec3, rules: &Rules) -> Touch {
        let is_beyond_reach = |part: &Part| part.box_distance_mm(position_in_head) > rules.hit_mm;
        if self.parts.iter().all(is_beyond_reach)
            || self.distance_mm(position_in_head) > rules.hit_mm
        {
            return Touch::False;
        }
        let from_centre_mm = position_in_head.distance(self.centre_in_head());
        if self.volume_ml() > rules.large_ml && from_centre_mm > rules.from_centre_mm {
            Touch::Near
        } else {
            Touch::Hit
        }
    }

    /// The positions of the voxels of its largest part, LPS mm of the head.
    pub(super) fn positions_in_head(&self) -> Vec<DVec3> {
        self.parts[0].positions_in_head()
    }

    fn meets(&self, part: &Part) -> bool {
        let positions = part.positions_in_head();
        let is_inside = |position: &DVec3| self.parts.iter().any(|own| own.contains(*position));
        positions.iter().any(is_inside)
    }

    fn add(&mut self, part: Part) {
        self.parts.push(part);
        self.parts
            .sort_by(|one, other| other.volume_ml.total_cmp(&one.volume_ml));
    }
}

impl Part {
    fn new(grid: &Grid, voxels: HashSet<u32>, head_from_truth: DAffine3) -> Self {
        let place =
            |voxel: u32| DVec3::from_array(grid.voxel(voxel as usize).map(|along| along as f64));
        let mut sorted: Vec<u32> = voxels.iter().copied().collect();
        sorted.sort_unstable();
        let is_at_border = |voxel: &u32| {
            let size = grid.size();
            let neighbours = geometry::face_neighbours(size, *voxel as usize);
            neighbours
                .filter(|(_, neighbour)| voxels.contains(&(*neighbour as u32)))
                .count()
                < 6
        };
        let border: Vec<DVec3> = sorted
            .iter()
            .filter(|voxel| is_at_border(voxel))
            .map(|voxel| place(*voxel))
            .collect();
        let patient_from_voxel = grid.patient_from_voxel();
        let corners = border.iter().flat_map(|&place| {
            [0.5, -0.5].into_iter().flat_map(move |x| {
                [0.5, -0.5].into_iter().flat_map(move |y| {
                    [0.5, -0.5].map(move |z| {
                        patient_from_voxel.transform_point3(place + DVec3::new(x, y, z))
                    })
                })
            })
        });
        let bounds = corners.fold(
            [DVec3::INFINITY, DVec3::NEG_INFINITY],
            |[low, high], corner| [low.min(corner), high.max(corner)],
        );
        let sum: DVec3 = sorted.iter().map(|voxel| place(*voxel)).sum();
        let centre = patient_from_voxel.transform_point3(sum / sorted.len() as f64);
        let voxel_ml = patient_from_voxel.matrix3.determinant().abs() / 1000.0;
        Self {
            grid: grid.clone(),
            truth_from_head: head_from_truth.inverse(),
            centre_in_head: head_from_truth.transform_point3(centre),
            volume_ml: voxel_ml * sorted.len() as f64,
            border,
            bounds,
            voxels,
        }
    }

    fn place_in_voxels(&self, position_in_head: DVec3) -> DVec3 {
        let position = self.truth_from_head.transform_point3(position_in_head);
        self.grid.voxel_from_patient().transform_point3(position)
    }

    fn contains(&self, position_in_head: DVec3) -> bool {
        let place = self.place_in_voxels(position_in_head).round();
        self.grid.contains(place) && {
            let voxel = place.to_array().map(|along| along.max(0.0) as usize);
            self.voxels.contains(&(self.grid.index(voxel) as u32))
        }
    }

    /// The distance from the box around it, in mm: never more than that from the part.
    fn box_distance_mm(&self, position_in_head: DVec3) -> f64 {
        let position = self.truth_from_head.transform_point3(position_in_head);
        let [low, high] = self.bounds;
        position.distance(position.clamp(low, high))
    }

    /// The distance from the nearest voxel, which has its full extent, in mm.
    fn distance_mm(&self, position_in_head: DVec3) -> f64 {
        if self.contains(position_in_head) {
            return 0.0;
        }
        let place = self.place_in_voxels(position_in_head);
        let axes = self.grid.patient_from_voxel().matrix3;
        let half = DVec3::splat(0.5);
        let squared = self.border.iter().map(|&voxel| {
            let apart = place - voxel;
            (axes * (apart - apart.clamp(-half, half))).length_squared()
        });
        squared.fold(f64::INFINITY, f64::min).sqrt()
    }

    fn positions_in_head(&self) -> Vec<DVec3> {
        let head_from_voxel = self.truth_from_head.inverse() * self.grid.patient_from_voxel();
        let mut voxels: Vec<u32> = self.voxels.iter().copied().collect();
        voxels.sort_unstable();
        let position = |voxel: u32| {
            let voxel = self.grid.voxel(voxel as usize).map(|along| along as f64);
            head_from_voxel.transform_point3(DVec3::from_array(voxel))
        };
        voxels.into_iter().map(position).collect()
    }
}

/// The connected parts of a mask: voxels that share a face, an edge or a corner belong together.
fn parts(mask: &Mask, head_from_truth: DAffine3) -> Vec<Part> {
    let grid = mask.grid();
    let indices = 0..mask.voxels().len() as u32;
    let voxels: Vec<u32> = indices
        .filter(|&voxel| mask.voxels()[voxel as usize])
        .collect();
    let mut left: HashSet<u32> = voxels.iter().copied().collect();
    let mut parts = Vec::new();
    for voxel in voxels {
        if !left.remove(&voxel) {
            continue;
        }
        let mut part = HashSet::from([voxel]);
        let mut open = vec![voxel];
        while let Some(voxel) = open.pop() {
            for neighbour in neighbours(grid, voxel) {
                if left.remove(&neighbour) {
                    part.insert(neighbour);
                    open.push(neighbour);
                }
            }
        }
        parts.push(Part::new(grid, part, head_from_truth));
    }
    parts
}

/// The voxels that share a face, an edge or a corner with a voxel, and the voxel itself.
fn neighbours(grid: &Grid, voxel: u32) -> impl Iterator<Item = u32> {
    let size = grid.size();
    let voxel = grid.voxel(voxel as usize);
    let [x, y, z] =
        [0, 1, 2].map(|axis| voxel[axis].saturating_sub(1)..=(voxel[axis] + 1).min(size[axis] - 1));
    z.flat_map(move |z| {
        let x = x.clone();
        y.clone().flat_map(move |y| {
            x.clone()
                .map(move |x| (x + size[0] * (y + size[1] * z)) as u32)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULES: Rules = Rules::STANDARD;

    /// Balls on a grid with edges of this length, in mm.
    fn balls(spacing_mm: [f64; 3], balls: &[(DVec3, f64)]) -> Mask {
        let size = spacing_mm.map(|edge| (80.0 / edge) as usize);
        let grid = Grid::aligned(size, spacing_mm, DVec3::splat(-40.0)).unwrap();
        let is_inside = |index: usize| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
            let position = grid.patient_from_voxel().transform_point3(voxel);
            balls
                .iter()
                .any(|(centre, radius)| position.distance(*centre) < *radius)
        };
        let voxels = (0..grid.voxel_count()).map(is_inside).collect();
        Mask::new(grid, voxels).unwrap()
    }

    fn lesions(truths: &[(Mask, DAffine3)]) -> Lesions {
        Lesions::of(truths, &RULES)
    }

    #[test]
    fn distances_are_those_of_the_ball_on_any_grid_and_outside_of_it() {
        for spacing in [[1.0; 3], [0.8, 0.8, 2.5]] {
            let mask = balls(spacing, &[(DVec3::ZERO, 6.0)]);
            let found = lesions(&[(mask, DAffine3::IDENTITY)]);
            let lesion = &found.lesions[0];
            assert!((lesion.volume_ml() - 0.905).abs() < 0.06);
            for direction in [DVec3::X, DVec3::Z, DVec3::ONE.normalize()] {
                for radius in [0.0, 4.0, 12.0, 100.0] {
                    let distance = lesion.distance_mm(direction * radius);
                    let expected = (radius - 6.0f64).max(0.0);
                    assert!((distance - expected).abs() < 1.3, "{distance} {expected}");
                }
            }
        }
    }

    #[test]
    fn hits_are_near_the_border_and_those_of_a_large_truth_near_its_centre_too() {
        let mask = balls([1.0; 3], &[(DVec3::ZERO, 6.0)]);
        let small = lesions(&[(mask, DAffine3::IDENTITY)]);
        let touch = |found: &Lesions, x: f64| found.touches(DVec3::new(x, 0.0, 0.0), &RULES)[0];
        assert_eq!(touch(&small, 3.0), Touch::Hit);
        assert_eq!(touch(&small, 15.0), Touch::Hit);
        assert_eq!(touch(&small, 17.5), Touch::False);
        let mask = balls([1.0; 3], &[(DVec3::ZERO, 18.0)]);
        let large = lesions(&[(mask, DAffine3::IDENTITY)]);
        assert!(large.lesions[0].volume_ml() > 20.0);
        assert_eq!(touch(&large, 17.0), Touch::Hit);
        assert_eq!(touch(&large, 23.0), Touch::Near);
        assert_eq!(touch(&large, 29.5), Touch::False);
    }

    #[test]
    fn parts_count_once_each_and_small_ones_only_if_there_is_no_other() {
        let [left, right, tiny] = [-20.0, 20.0, 0.0].map(|x| DVec3::new(x, 0.0, 0.0));
        let mask = balls([1.0; 3], &[(left, 7.0), (right, 5.0), (tiny, 2.5)]);
        let found = lesions(&[(mask, DAffine3::IDENTITY)]);
        assert_eq!((found.lesions.len(), found.small.len()), (2, 1));
        assert!(found.lesions[0].centre_in_head().distance(left) < 0.1);
        assert_eq!(found.touches(left, &RULES), [Touch::Hit, Touch::Near]);
        assert_eq!(found.touches(tiny, &RULES), [Touch::Near, Touch::Near]);
        let alone = balls([1.0; 3], &[(tiny, 2.5), (left, 2.0)]);
        let found = lesions(&[(alone, DAffine3::IDENTITY)]);
        assert_eq!((found.lesions.len(), found.small.len()), (1, 1));
    }

    #[test]
    fn two_truths_of_one_lesion_count_once_where_their_transforms_bring_them() {
        let one = balls([1.0; 3], &[(DVec3::ZERO, 6.0)]);
        let moved = DVec3::new(25.0, 0.0, 0.0);
        let other = balls([1.0; 3], &[(moved, 8.0)]);
        let apart = lesions(&[
            (one.clone(), DAffine3::IDENTITY),
            (other.clone(), DAffine3::IDENTITY),
        ]);
        assert_eq!(apart.lesions.len(), 2);
        let joined = lesions(&[
            (one, DAffine3::IDENTITY),
            (other, DAffine3::from_translation(-moved)),
        ]);
        assert_eq!(joined.lesions.len(), 1);
        let lesion = &joined.lesions[0];
        assert!(lesion.centre_in_head().length() < 0.1);
        assert!((lesion.distance_mm(DVec3::new(20.0, 0.0, 0.0)) - 12.0).abs() < 1.0);
    }
}
