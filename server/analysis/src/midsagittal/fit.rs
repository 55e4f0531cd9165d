//! Fits the plane at which an image is most like its mirror image.

use glam::{DMat3, DVec3, Vec3};

use super::image::Image;

/// The greatest turn of the plane from the patient's sagittal plane about either axis, as a tangent: 30°.
const MAX_TANGENT: f64 = 0.577_350_269;
/// The number of initial turns and shifts to either side.
const TURNS: i32 = 3;
const SHIFTS: i32 = 1;
/// Distance between initial shifts, in voxels of the coarsest image.
const SHIFT_STEP: f64 = 0.75;
/// The greatest distance of the plane from the centroid, as a fraction of the width of the image.
const MAX_SHIFT: f64 = 0.2;
/// The scale of the robust cost: larger differences hardly count more (Geman and McClure).
const MODERATE: f64 = 0.3;
/// The prior cost of a turn, per squared tangent; a wrong turn costs about a hundred times as much.
const TURN_COST: f64 = 0.01;
/// The prior cost of a shift, per squared voxel.
const SHIFT_COST: f64 = 1e-6;
/// The fraction of the surroundings of a point that must lie inside for it to count in the correlation.
const LEAST_INSIDE: f32 = 0.95;
/// The least variance of values, 0 to 1, for a correlation.
const LEAST_VARIANCE: f64 = 1e-9;
/// The greatest number of steps on one image, and the step, in tangents and voxels, at which the iteration ends.
const MAX_STEPS: usize = 12;
const LEAST_STEP: f64 = 3e-4;

/// A plane: the tangents of its turns from the sagittal plane towards y and z, and its shift from the centroid in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose(DVec3);

impl Pose {
    pub(super) fn normal(self) -> DVec3 {
        DVec3::new(1.0, self.0.x, self.0.y).normalize()
    }

    pub(super) fn shift_mm(self) -> f64 {
        self.0.z
    }
}

/// The parameters of a plane: the two tangents, and the shift in voxels of an image.
type Parameters = DVec3;

/// The cost of a plane, half of its gradient, and half of its Gauss-Newton Hessian.
struct Cost {
    value: f64,
    slope: DVec3,
    curvature: DMat3,
}

impl Cost {
    /// The damped step to the expected minimum.
    fn step(&self, damping: f64) -> DVec3 {
        let diagonal = DVec3::new(
            self.curvature.x_axis.x,
            self.curvature.y_axis.y,
            self.curvature.z_axis.z,
        );
        // The prior cost of each parameter keeps the matrix invertible.
        let damped = self.curvature + DMat3::from_diagonal(diagonal * damping);
        -(damped.inverse() * self.slope)
    }
}

/// The prior cost of a plane, and the weight of each parameter in it.
fn own_cost(parameters: Parameters) -> (f64, DVec3) {
    let weights = DVec3::new(TURN_COST, TURN_COST, SHIFT_COST);
    (weights.dot(parameters * parameters), weights)
}

/// A plane in the coordinates of a level.
struct Mirror {
    normal: Vec3,
    shift: f32,
    /// The derivatives of the normal by each tangent.
    turns: [Vec3; 2],
}

impl Mirror {
    fn new(parameters: Parameters) -> Self {
        let across = DVec3::new(1.0, parameters.x, parameters.y);
        let normal = across.normalize();
        let turn = |axis: DVec3| ((axis - normal * normal.dot(axis)) / across.length()).as_vec3();
        Self {
            normal: normal.as_vec3(),
            shift: parameters.z as f32,
            turns: [turn(DVec3::Y), turn(DVec3::Z)],
        }
    }

    fn distance(&self, place: Vec3) -> f32 {
        self.normal.dot(place) - self.shift
    }

    fn image_of(&self, place: Vec3) -> Vec3 {
        place - self.normal * (2.0 * self.distance(place))
    }

    /// The derivatives of the difference between a point and its mirror image by the parameters, given the slope of the
    /// image.
    fn slope_at(&self, place: Vec3, slope: Vec3) -> Vec3 {
        let across = slope.dot(self.normal);
        let lever = place * across + slope * self.distance(place);
        let [y, z] = self.turns;
        2.0 * Vec3::new(y.dot(lever), z.dot(lever), -across)
    }
}

/// One image and the compared points.
pub(super) struct Level {
    image: Image,
    /// The points relative to the centroid, in voxels, with their values.
    places: Vec<(Vec3, f32)>,
    /// The centroid, in voxels.
    centre: Vec3,
    /// The greatest shift, in voxels.
    max_shift: f64,
}

impl Level {
    pub(super) fn new(image: Image, stride: usize, centroid: DVec3) -> Self {
        let centre = image.place_of(centroid);
        let max_shift = MAX_SHIFT * image.width() as f64;
        let places = image
            .points(stride)
            .map(|(position, value)| (image.place_of(position) - centre, value))
            .collect();
        Self {
            image,
            places,
            centre,
            max_shift,
        }
    }

    /// The best of planes 10° apart, some of them beside the centroid.
    pub(super) fn search(&self) -> Pose {
        let tangent = |turn: i32| (f64::from(turn) * MAX_TANGENT.atan() / f64::from(TURNS)).tan();
        let turns = || (-TURNS..=TURNS).map(tangent);
        let shifts = || (-SHIFTS..=SHIFTS).map(|shift| f64::from(shift) * SHIFT_STEP);
        let poses = turns().flat_map(|y| turns().map(move |z| (y, z)));
        let poses = poses.flat_map(|(y, z)| shifts().map(move |shift| DVec3::new(y, z, shift)));
        let costs = poses.map(|pose| (self.cost_of(pose), pose));
        let best = costs.min_by(|(a, _), (b, _)| a.total_cmp(b));
        self.pose(best.map_or(Parameters::ZERO, |(_, pose)| pose))
    }

    /// The correlation of the values of the points in `shape` with those at their mirror images in it, 0 to 1.
    pub(super) fn correlation(&self, pose: Pose, shape: &Image) -> f64 {
        let mirror = Mirror::new(self.parameters(pose));
        let is_inside = |place: Vec3| shape.sample(place + self.centre).0 > LEAST_INSIDE;
        let pairs = self.places.iter().filter_map(|&(place, here)| {
            let image = mirror.image_of(place);
            let (there, _) = self.image.sample(image + self.centre);
            (is_inside(place) && is_inside(image)).then(|| [here, there].map(f64::from))
        });
        correlation(pairs)
    }

    fn pose(&self, parameters: Parameters) -> Pose {
        Pose(parameters * DVec3::new(1.0, 1.0, self.image.step_mm))
    }

    fn parameters(&self, pose: Pose) -> Parameters {
        pose.0 / DVec3::new(1.0, 1.0, self.image.step_mm)
    }

    /// The pose after Gauss-Newton steps, damped so that each one reduces the cost (Levenberg, Marquardt).
    pub(super) fn refined(&self, pose: Pose) -> Pose {
        let mut parameters = self.parameters(pose);
        let mut cost = self.cost(parameters);
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            let next = self.bounded(parameters + cost.step(damping));
            let next_cost = self.cost(next);
            let is_better = next_cost.value < cost.value;
            let moved = (next - parameters).abs().max_element();
            if is_better {
                (parameters, cost) = (next, next_cost);
                damping /= 5.0;
            } else {
                damping *= 10.0;
            }
            if moved < LEAST_STEP {
                break;
            }
        }
        self.pose(parameters)
    }

    fn bounded(&self, parameters: DVec3) -> DVec3 {
        let bounds = DVec3::new(MAX_TANGENT, MAX_TANGENT, self.max_shift);
        parameters.clamp(-bounds, bounds)
    }

    /// The cost alone.
    fn cost_of(&self, parameters: Parameters) -> f64 {
        let mirror = Mirror::new(parameters);
        let cost = |&(place, value): &(Vec3, f32)| {
            let (other, _) = self.image.sample(mirror.image_of(place) + self.centre);
            let squared = f64::from(value - other).powi(2);
            squared / (1.0 + squared / MODERATE.powi(2))
        };
        let sum: f64 = self.places.iter().map(cost).sum();
        sum / self.places.len() as f64 + own_cost(parameters).0
    }

    fn cost(&self, parameters: Parameters) -> Cost {
        let mirror = Mirror::new(parameters);
        let (mut value, mut slope, mut curvature) = (0.0, DVec3::ZERO, DMat3::ZERO);
        for &(place, here) in &self.places {
            let (there, image_slope) = self.image.sample(mirror.image_of(place) + self.centre);
            let difference = f64::from(here - there);
            let change = mirror.slope_at(place, image_slope).as_dvec3();
            let excess = 1.0 + (difference / MODERATE).powi(2);
            let weighted = change / (excess * excess);
            value += difference * difference / excess;
            slope += weighted * difference;
            curvature += outer_product(weighted, change);
        }
        let (own, weights) = own_cost(parameters);
        let count = self.places.len() as f64;
        Cost {
            value: value / count + own,
            slope: slope / count + weights * parameters,
            curvature: curvature * (1.0 / count) + DMat3::from_diagonal(weights),
        }
    }
}

/// The correlation of pairs; 0 if it is negative, or if one side has a single value.
fn correlation(pairs: impl Iterator<Item = [f64; 2]>) -> f64 {
    let (mut count, mut sums, mut squares, mut products) = (0.0, [0.0; 2], [0.0; 2], 0.0);
    for [a, b] in pairs {
        count += 1.0;
        sums = [sums[0] + a, sums[1] + b];
        squares = [squares[0] + a * a, squares[1] + b * b];
        products += a * b;
    }
    let [a, b] = sums.map(|sum| sum / count);
    let scale = ((squares[0] / count - a * a) * (squares[1] / count - b * b)).sqrt();
    // Also false for NaN, of no pairs.
    if scale > LEAST_VARIANCE {
        ((products / count - a * b) / scale).clamp(0.0, 1.0)
    } else {
        0.0
    }
}

fn outer_product(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}
