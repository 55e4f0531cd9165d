//! Follows many lines of sight at once, each in as few steps as provably miss nothing.
//!
//! Sphere tracing (J. C. Hart, "Sphere tracing: a geometric method for the antialiased ray tracing of implicit
//! surfaces", The Visual Computer 12, 1996) with over-relaxation (B. Keinert et al., "Enhanced sphere tracing", STAG
//! 2014).
//!
//! # How far a step is safe
//!
//! The trilinear depth at a place is the mean depth of the voxel that it is rounded to, at random, along each axis, so
//! that the mean place is kept. Round two places s apart with the same dice: along each axis the voxels are then on
//! average as far apart as the places, and by the variance of one such rounding, at most 1/4, their mean squared
//! distance is at most s² + 3/4. Depths of voxels differ by no more than the voxels are apart, so the trilinear depths
//! by at most √(s² + 3/4) ([`safe`]). Near by, that each component of the gradient is a mean of differences between
//! 6-neighbours, which are at most 1 voxel, says more: at most √3 s.
//!
//! Across the envelope's border, voxels u outside and v inside, both depths count from border voxels: the line from u
//! to v enters the envelope by a face of one of them, whose centre is at most √3/2 beside it, which adds at most 1.2
//! voxels.

use multiversion::multiversion;

use crate::isosurface::Isosurface;
use crate::rays::Rays;
use crate::sampler::{LANES, Lanes};

/// The most that the trilinear depth field changes in a voxel's length, in voxels: √3, and the rounding of stored
/// values.
const STEEPEST: f32 = 1.75;

/// By how much the depths of two voxels inside differ more than the voxels are apart: values are rounded, smoothed ones
/// three times more.
const ROUNDING: f32 = 0.03;

/// The same for one voxel outside and one inside.
const ACROSS_BORDER: f32 = 1.23;

/// How near the isosurface a hit is, in voxels of depth: 0.005 mm where voxels are 1 mm wide.
const TOLERANCE: f32 = 0.005;

/// The longest piece of a line of sight that may be passed over without a proof that it is outside, in voxels.
const NEAR: f32 = 0.25;

/// Share of the longest step that would still be safe if the depth went on as before.
const RELAXATION: f32 = 0.95;

/// How often a line of sight that begins inside is begun a voxel higher.
const MOST_RISES: u32 = 8;

/// How often the search between two places on either side of the isosurface is refined.
const MOST_HALVINGS: u32 = 16;

/// A line of sight to follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sight {
    /// Column and row of its pixel.
    pub(super) pixel: [u32; 2],
    /// Its start: it meets nothing above this height.
    pub(super) start: f32,
    /// It meets nothing below this height.
    pub(super) end: f32,
}

/// The greatest height at which each line of sight enters the isosurface; −∞ where it meets nothing.
///
/// Only pieces thinner than [`NEAR`] voxels along the line of sight may be missed.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
pub(super) fn first_hits(
    isosurface: &Isosurface<'_>,
    rays: &Rays,
    sights: &[Sight],
    hits: &mut [f32],
) {
    let mut marchers = Marchers::new(isosurface, rays);
    let mut waiting = sights.iter().enumerate();
    let mut count = 0;
    loop {
        while count < LANES
            && let Some((index, sight)) = waiting.next()
        {
            marchers.begin(count, index as u32, sight);
            count += 1;
        }
        if count == 0 {
            return;
        }
        marchers.look(count);
        marchers.step();
        for lane in (0..count).rev() {
            if marchers.state[lane] < DONE {
                continue;
            }
            hits[marchers.sight[lane] as usize] = if marchers.state[lane] == HIT {
                marchers.place[lane]
            } else {
                f32::NEG_INFINITY
            };
            if let Some((index, sight)) = waiting.next() {
                marchers.begin(lane, index as u32, sight);
            } else {
                count -= 1;
                marchers.move_lane(count, lane);
            }
        }
    }
}

// What a line of sight is about.
/// It was not looked at yet.
const FRESH: u32 = 0;
/// The isosurface is ahead.
const AHEAD: u32 = 1;
/// The isosurface is between two places.
const BETWEEN: u32 = 2;
/// From here on it is finished.
const DONE: u32 = 3;
const HIT: u32 = 3;
const MISS: u32 = 4;

/// Lines of sight on their way, in step.
struct Marchers<'a> {
    isosurface: &'a Isosurface<'a>,
    rays: &'a Rays,
    /// Distances up to which both ends of a step are inside of the envelope.
    inside_up_to: f32,
    /// Which sight each is.
    sight: [u32; LANES],
    state: [u32; LANES],
    rounds: [u32; LANES],
    foot: [Lanes; 3],
    towards_viewer: [Lanes; 3],
    end: Lanes,
    /// Where it is looked, and how far above the isosurface that is.
    place: Lanes,
    distance: Lanes,
    /// The lowest place that is known to be outside with all above it, and its distance.
    high: Lanes,
    above: Lanes,
    /// All above this is outside, but for a piece of [`NEAR`].
    known: Lanes,
    /// A place inside, and its distance, which is negative.
    low: Lanes,
    under: Lanes,
}

impl<'a> Marchers<'a> {
    #[inline(always)]
    fn new(isosurface: &'a Isosurface<'a>, rays: &'a Rays) -> Self {
        Self {
            isosurface,
            rays,
            inside_up_to: if isosurface.is_smoothed() {
                f32::NEG_INFINITY
            } else {
                isosurface.depth_in_voxels() - 2.0
            },
            sight: [0; LANES],
            state: [FRESH; LANES],
            rounds: [0; LANES],
            foot: [[0.0; LANES]; 3],
            towards_viewer: [[0.0; LANES]; 3],
            end: [0.0; LANES],
            place: [0.0; LANES],
            distance: [0.0; LANES],
            high: [0.0; LANES],
            above: [0.0; LANES],
            known: [0.0; LANES],
            low: [0.0; LANES],
            under: [0.0; LANES],
        }
    }

    #[inline(always)]
    fn begin(&mut self, lane: usize, index: u32, sight: &Sight) {
        let [column, row] = sight.pixel.map(|place| place as i32 as f32 + 0.5);
        let ray = self.rays.through(column, row);
        let (foot, towards_viewer) = (ray.foot(), ray.towards_viewer());
        for axis in 0..3 {
            self.foot[axis][lane] = foot[axis];
            self.towards_viewer[axis][lane] = towards_viewer[axis];
        }
        self.sight[lane] = index;
        self.state[lane] = FRESH;
        self.rounds[lane] = 0;
        self.end[lane] = sight.end;
        self.place[lane] = sight.start;
    }

    /// Lets another lane go on with a line of sight.
    #[inline(always)]
    fn move_lane(&mut self, from: usize, to: usize) {
        for axis in self.foot.iter_mut().chain(&mut self.towards_viewer) {
            axis[to] = axis[from];
        }
        for numbers in [&mut self.sight, &mut self.state, &mut self.rounds] {
            numbers[to] = numbers[from];
        }
        for numbers in [
            &mut self.end,
            &mut self.place,
            &mut self.high,
            &mut self.above,
            &mut self.known,
            &mut self.low,
            &mut self.under,
        ] {
            numbers[to] = numbers[from];
        }
    }

    /// Finds how far above the isosurface each place is.
    #[inline(always)]
    fn look(&mut self, count: usize) {
        let lattice = self.rays.lattice();
        let mut positions = [[0.0; LANES]; 3];
        for (axis, positions) in positions.iter_mut().enumerate() {
            let [foot, towards_viewer] = [&self.foot[axis], &self.towards_viewer[axis]];
            for (lane, position) in positions.iter_mut().enumerate() {
                *position = foot[lane] + self.place[lane] * towards_viewer[lane] - lattice;
            }
        }
        self.isosurface
            .below_each(&positions, count, &mut self.distance);
        for distance in &mut self.distance {
            *distance = -*distance;
        }
    }

    /// Finds where each looks next, or that it is done.
    #[inline(always)]
    fn step(&mut self) {
        for lane in 0..LANES {
            let [place, distance] = [self.place[lane], self.distance[lane]];
            let [high, above] = [self.high[lane], self.above[lane]];
            let [low, under] = [self.low[lane], self.under[lane]];
            let (state, rounds) = (self.state[lane], self.rounds[lane]);
            let is_fresh = state == FRESH;
            let is_between = state == BETWEEN;

            let is_outside = distance > TOLERANCE;
            let is_inside = distance < -TOLERANCE;
            let safe = safe(distance, self.inside_up_to);
            let is_known = is_fresh | is_between | (place + safe >= self.known[lane]);

            // Ahead.
            let slope = select(is_fresh, 1.0, (above - distance) / (high - place));
            let passing = distance / greater(slope, 1e-3);
            let surely = safe + NEAR;
            let perhaps = RELAXATION * (surely + distance * (1.0 / STEEPEST))
                / (1.0 + greater(slope, -0.5) * (1.0 / STEEPEST));
            let longest = greater(surely, perhaps);
            let onward = select(passing < longest, passing, longest);
            let ahead = select(
                is_fresh & !is_outside,
                place + 1.0,
                select(is_known, place - onward, self.known[lane]),
            );

            // Between, by false position (the Illinois variant): the end that stays counts half.
            let [new_high, new_above] = [
                select(is_known & is_outside, place, high),
                select(is_known & is_outside, distance, above),
            ];
            let [new_low, new_under] = [
                select(is_known & is_inside, place, low),
                select(is_known & is_inside, distance, under),
            ];
            let half = select(is_between, 0.5, 1.0);
            let new_above = select(is_between & is_inside, new_above * half, new_above);
            let new_under = select(is_between & is_outside, new_under * half, new_under);
            let share = new_above / (new_above - new_under);
            let middle = new_high + (new_low - new_high) * share;

            let becomes_between = is_between | (is_known & is_inside & !is_fresh);
            let is_hit = (is_known & !is_outside & !is_inside & !is_fresh)
                | (is_between & (rounds >= MOST_HALVINGS))
                | (is_fresh & !is_outside & (rounds >= MOST_RISES));
            let is_miss = is_known & is_outside & !is_between & (place < self.end[lane]);
            let going_on = select_state(
                becomes_between,
                BETWEEN,
                select_state(is_fresh & !is_outside, FRESH, AHEAD),
            );
            let next = select_state(is_hit, HIT, select_state(is_miss, MISS, going_on));
            self.state[lane] = next;
            self.rounds[lane] = rounds + u32::from(is_fresh | is_between);
            self.place[lane] = select(is_hit, place, select(becomes_between, middle, ahead));
            self.known[lane] = select(is_known & is_outside, place - surely, self.known[lane]);
            self.high[lane] = new_high;
            self.above[lane] = new_above;
            self.low[lane] = new_low;
            self.under[lane] = new_under;
        }
    }
}

/// How far from a place `distance` above the isosurface there is nothing of it.
#[inline(always)]
fn safe(distance: f32, inside_up_to: f32) -> f32 {
    let allowance = select(distance <= inside_up_to, ROUNDING, ACROSS_BORDER);
    let apart = greater(distance - allowance, 0.0);
    let far = greater(apart * apart - 0.75, 0.0).sqrt();
    greater(far, distance * (1.0 / STEEPEST))
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn select(condition: bool, yes: f32, no: f32) -> f32 {
    if condition { yes } else { no }
}

#[inline(always)]
fn select_state(condition: bool, yes: u32, no: u32) -> u32 {
    if condition { yes } else { no }
}

#[cfg(test)]
mod tests {
    use geometry::{BoundingSphere, DepthField, Envelope, Grid, Mask};

    use super::*;
    use crate::{Camera, FrameSize};

    /// Steps of the plain tracer in a voxel.
    const FINE: f32 = 1.0 / 32.0;

    /// The stretches of a line of sight that are inside, each by its heights, found in many small steps.
    fn plainly(isosurface: &Isosurface<'_>, rays: &Rays, sight: &Sight) -> Vec<[f32; 2]> {
        let [column, row] = sight.pixel.map(|place| place as f32 + 0.5);
        let ray = rays.through(column, row);
        let mut stretches: Vec<[f32; 2]> = Vec::new();
        let mut was_inside = false;
        let mut step = 0.0;
        while sight.start - step * FINE > sight.end - 2.0 {
            let height = sight.start - step * FINE;
            let is_inside = isosurface.below(ray.at(height)) > 0.0;
            match stretches.last_mut() {
                Some(stretch) if was_inside && is_inside => stretch[1] = height,
                _ if is_inside => stretches.push([height; 2]),
                _ => {}
            }
            was_inside = is_inside;
            step += 1.0;
        }
        stretches
    }

    /// A head of 36 × 44 × 34 voxels with bumps, thin sheets and a stick, some of them a voxel wide.
    fn rugged() -> DepthField {
        let grid = Grid::aligned([48, 56, 46], [1.0; 3], glam::DVec3::ZERO).unwrap();
        let inside = |index: usize| {
            let [x, y, z] = grid.voxel(index).map(|place| place as f32);
            let [a, b, c] = [x - 23.5, y - 27.5, z - 22.5];
            let waves = 0.12 * ((x / 2.3).sin() + (y / 2.9).sin() + (z / 1.9).sin());
            let radius = ((a / 17.0).powi(2) + (b / 21.0).powi(2) + (c / 16.0).powi(2)).sqrt();
            let stick =
                (10.0..12.0).contains(&z) && (20.0..22.0).contains(&x) && y > 2.0 && y < 53.0;
            let sheet = (30.0..31.0).contains(&x) && a.abs() + b.abs() + c.abs() < 25.0;
            radius < 0.9 + waves || stick || sheet
        };
        let mask = (0..grid.voxel_count()).map(inside).collect();
        let envelope = Envelope::from_stored(Mask::new(grid, mask).unwrap()).unwrap();
        DepthField::new(&geometry::distance_map(&envelope))
    }

    #[test]
    fn every_line_of_sight_ends_where_the_plain_tracer_ends_it() {
        let field = rugged();
        let normals = field.smoothed(1.5);
        let size = FrameSize::new(72, 72).unwrap();
        let mut counts = [0; 3];
        for (orientation, depth_mm) in [
            ([0.0, 0.0, 0.0, 1.0], 0.0),
            ([0.5, 0.5, 0.5, 0.5], 0.5),
            ([0.3, -0.5, 0.1, 0.8], 1.2),
            ([0.7, 0.2, -0.6, 0.3], 4.0),
            ([0.1, 0.9, 0.4, -0.2], 6.5),
            ([-0.4, 0.3, 0.2, 0.6], 11.0),
        ] {
            let camera = Camera::new(orientation, 1.3, [0.0; 2]).unwrap();
            let bounds = BoundingSphere {
                centre_in_patient: glam::DVec3::new(23.5, 27.5, 22.5),
                radius_mm: 28.0,
            };
            let projection = camera.projection(&bounds, size);
            let rays = Rays::new(&projection, field.grid(), 1.0);
            let isosurface = Isosurface::new(&field, &normals, depth_mm);
            let sights: Vec<Sight> = (0..72 * 72)
                .map(|index| Sight {
                    pixel: [index % 72, index / 72],
                    start: 29.0,
                    end: -29.0,
                })
                .collect();
            let mut hits = vec![f32::NEG_INFINITY; sights.len()];
            first_hits(&isosurface, &rays, &sights, &mut hits);
            for (sight, hit) in sights.iter().zip(hits) {
                let [column, row] = sight.pixel.map(|place| place as f32 + 0.5);
                let ray = rays.through(column, row);
                if hit > f32::NEG_INFINITY {
                    let off = isosurface.below(ray.at(hit)).abs();
                    assert!(
                        off <= TOLERANCE,
                        "{sight:?} {hit}: {off} voxel off at {depth_mm} mm"
                    );
                    counts[0] += 1;
                }
                let stretches = plainly(&isosurface, &rays, sight);
                for [top, bottom] in stretches {
                    if top < hit + 2.0 * FINE {
                        break;
                    }
                    // What was passed over.
                    counts[1] += 1;
                    assert!(
                        top - bottom < NEAR,
                        "{sight:?} {hit} at {depth_mm} mm: passed {top} to {bottom}"
                    );
                }
                counts[2] += 1;
            }
        }
        let [met, passed, all] = counts;
        assert!(met > all / 10 && passed < all / 1000, "{counts:?}");
    }
}
