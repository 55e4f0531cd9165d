//! Depth along a straight segment of the path of a vertex.

use glam::Vec3;

use crate::DepthField;

/// The tolerance of depths on a segment, in mm.
const TOLERANCE_MM: f32 = 0.004;

/// A point of a path in voxel coordinates, and its depth in mm.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    pub(crate) position: Vec3,
    pub(crate) depth_mm: f32,
}

/// The segment from one corner of a path to the next, or the rest of it after a point.
///
/// Points are fractions of the segment. Within one cell of the grid the trilinear depth is a cubic of the fraction; it
/// is computed once, and then no voxel is read.
#[derive(Debug, Clone)]
pub(crate) struct Segment {
    from: Corner,
    to: Corner,
    is_in_one_cell: bool,
    cubic: Option<[f32; 4]>,
    start: f32,
    depth_at_start: f32,
}

impl Segment {
    pub(crate) fn new(from: Corner, to: Corner) -> Self {
        let (low, high) = (
            from.position.min(to.position),
            from.position.max(to.position),
        );
        let is_in_one_cell = high.cmple(low.floor() + 1.0).all();
        Self {
            from,
            to,
            is_in_one_cell,
            cubic: None,
            start: 0.0,
            depth_at_start: from.depth_mm,
        }
    }

    /// The position at a fraction.
    pub(crate) fn at(&self, place: f32) -> Vec3 {
        self.from.position.lerp(self.to.position, place)
    }

    /// Drops the part before a fraction.
    pub(crate) fn start_at(&mut self, place: f32, depth_mm: f32) {
        (self.start, self.depth_at_start) = (place, depth_mm);
    }

    /// The fraction with the depth `depth_mm`, which must be between the depths of start and end.
    pub(crate) fn reaching(&mut self, field: &DepthField, depth_mm: f32) -> f32 {
        let excesses = [self.depth_at_start - depth_mm, self.to.depth_mm - depth_mm];
        if excesses[1] <= TOLERANCE_MM {
            return 1.0;
        }
        if self.is_in_one_cell {
            let cubic = *self
                .cubic
                .get_or_insert_with(|| cubic_along(field, &self.from, &self.to));
            crossing(self.start, excesses, |place| {
                evaluate(cubic, place) - depth_mm
            })
        } else {
            crossing(self.start, excesses, |place| {
                field.depth_mm(self.at(place)) - depth_mm
            })
        }
    }

    /// Whether the depth from the start to a fraction is linear within a tolerance; `false` if the cubic is unknown.
    pub(crate) fn is_straight(&self, place: f32, depths_mm: [f32; 2], tolerance_mm: f32) -> bool {
        let [near, far] = depths_mm;
        self.cubic.is_some_and(|cubic| {
            [0.25, 0.5, 0.75].into_iter().all(|fraction| {
                let depth = evaluate(cubic, self.start + (place - self.start) * fraction);
                (depth - near - (far - near) * fraction).abs() <= tolerance_mm
            })
        })
    }
}

/// The cubic of the depth between two points of one cell, lowest power first, from four values.
fn cubic_along(field: &DepthField, from: &Corner, to: &Corner) -> [f32; 4] {
    let depth_at = |place: f32| field.depth_mm(from.position.lerp(to.position, place));
    let (a, b) = (from.depth_mm, depth_at(1.0 / 3.0));
    let (c, d) = (depth_at(2.0 / 3.0), to.depth_mm);
    [
        a,
        (-11.0 * a + 18.0 * b - 9.0 * c + 2.0 * d) / 2.0,
        9.0 * (2.0 * a - 5.0 * b + 4.0 * c - d) / 2.0,
        9.0 * (-a + 3.0 * b - 3.0 * c + d) / 2.0,
    ]
}

#[inline]
fn evaluate([a, b, c, d]: [f32; 4], place: f32) -> f32 {
    a + place * (b + place * (c + place * d))
}

/// The zero between `start` and 1 of a function that is negative at the former and positive at the latter.
///
/// Regula falsi in its Illinois form (Dowell and Jarratt, 1971).
#[inline]
fn crossing(start: f32, excesses: [f32; 2], excess_at: impl Fn(f32) -> f32) -> f32 {
    let (mut low, mut high) = (start, 1.0);
    let [mut excess_low, mut excess_high] = excesses;
    let mut was_low = None;
    for _ in 0..24 {
        let place = (low * excess_high - high * excess_low) / (excess_high - excess_low);
        let excess = excess_at(place);
        if excess.abs() <= TOLERANCE_MM {
            return place;
        }
        let is_low = excess < 0.0;
        if is_low {
            (low, excess_low) = (place, excess);
            excess_high *= if was_low == Some(true) { 0.5 } else { 1.0 };
        } else {
            (high, excess_high) = (place, excess);
            excess_low *= if was_low == Some(false) { 0.5 } else { 1.0 };
        }
        was_low = Some(is_low);
    }
    high
}
