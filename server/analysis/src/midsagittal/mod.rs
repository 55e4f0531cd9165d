//! The plane between the hemispheres.

mod fit;
mod image;
#[cfg(test)]
mod tests;

use glam::DVec3;

use self::fit::Level;
use self::image::Image;
use geometry::{Envelope, Volume};

/// The plane at which a head is most like its mirror image: the points `p` (LPS mm) with `normal · p = offset_mm`.
///
/// Invariant: the normal has length 1 and points to the patient's left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MidsagittalPlane {
    normal: DVec3,
    offset_mm: f64,
}

/// How far from 1 the length of a normal may be.
const LENGTH_TOLERANCE: f64 = 1e-6;

impl MidsagittalPlane {
    /// A plane that was fitted before; `None` if the normal has not length 1, or a number is not finite.
    pub fn new(normal: DVec3, offset_mm: f64) -> Option<Self> {
        let is_unit = (normal.length() - 1.0).abs() <= LENGTH_TOLERANCE;
        (is_unit && offset_mm.is_finite()).then_some(Self { normal, offset_mm })
    }

    /// The unit normal, LPS, which points to the patient's left.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// The distance of the plane from the origin of patient space along the normal, in mm.
    pub fn offset_mm(&self) -> f64 {
        self.offset_mm
    }

    /// How far to the left of the plane a position (LPS mm) is, in mm.
    pub fn left_mm(&self, position_in_patient: DVec3) -> f64 {
        self.normal.dot(position_in_patient) - self.offset_mm
    }

    /// A position (LPS mm) mirrored at the plane.
    pub fn reflected(&self, position_in_patient: DVec3) -> DVec3 {
        position_in_patient - self.normal * (2.0 * self.left_mm(position_in_patient))
    }
}

/// Finds the plane at which the head is most like its mirror image.
///
/// The image is the intensities inside the envelope, between the 2nd and the 98th percentile, and 0 outside, at no more
/// than 64 points along the longest side. The plane minimises the mean difference between a point and its mirror image;
/// a great difference (a lesion) counts no more than a moderate one. The search begins with planes near the centroid
/// within 30° of the patient's sagittal plane about either axis, and continues with Gauss-Newton steps on three images,
/// from coarse to fine. A head without a preferred plane (a ball) gets one near the sagittal plane.
///
/// The result is the same for any number of threads. It is a plane of symmetry: if the fissure between the hemispheres
/// is bent, it is the best plane and not the fissure.
///
/// Sources: Ardekani, Kershaw, Braun and Kanno, "Automatic Detection of the Mid-Sagittal Plane in 3-D Brain Images",
/// IEEE Trans. Med. Imaging 16, 1997 (similarity across the plane, from coarse to fine); Prima, Ourselin and Ayache,
/// "Computation of the Mid-Sagittal Plane in 3-D Brain Images", IEEE Trans. Med. Imaging 21, 2002 (robust against what
/// has no counterpart).
pub fn midsagittal_plane(envelope: &Envelope, volume: &Volume) -> MidsagittalPlane {
    midsagittal_fit(envelope, volume).plane
}

/// The plane of [`midsagittal_plane`], and how alike its two sides are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MidsagittalFit {
    pub plane: MidsagittalPlane,
    /// The correlation of the intensities inside the envelope with those at their mirror images, smoothed by about 3 mm,
    /// 0 to 1.
    pub correlation: f64,
    /// The distance of the plane from the centroid of the envelope, in mm.
    pub off_centre_mm: f64,
    /// The share of the tissue on the side of the plane that has less of it, over that on the other side, 0 to 1.
    pub balance: f64,
    /// The extent of the envelope from left to right over that from front to back.
    pub breadth: f64,
}

/// The limits of a plane that is believed. Sound heads have a correlation of 0.85 to 0.94, those with a mass that displaces the middle
/// by 12 mm at most 0.4; half a cerebrum of fluid leaves up to 0.59, with a plane 18 to 21 mm inside the sound half.
const LEAST_CORRELATION: f64 = 0.5;
/// The same of its distance from the centroid of the envelope: at most 1.5 mm in sound heads.
const MOST_OFF_CENTRE_MM: f64 = 6.0;
/// The same of the tissue on both sides: a third less on one side is no mirror image.
const LEAST_BALANCE: f64 = 2.0 / 3.0;
/// With less than this correlation, what the mask leaves of a head may be half of it, of which the plane is the middle: up to 0.73 in
/// heads without half of the cerebrum, or a whole half. A mass of 32 mm leaves 0.46 to 0.83 and does not move the plane.
const SURE_CORRELATION: f64 = 0.8;
/// Then the plane is less than this from the centroid of the envelope, in mm, unless something is missing on one side, ...
const MOST_OFF_CENTRE_IF_UNSURE_MM: f64 = 3.0;
/// ... and the head is at least this broad, unless one side is missing: sound heads have 0.69 to 0.93.
const LEAST_BREADTH_IF_UNSURE: f64 = 0.6;

impl MidsagittalFit {
    /// Whether the two sides are so unlike that the plane may be wrong.
    pub fn is_doubtful(&self) -> bool {
        let may_be_half = self.off_centre_mm > MOST_OFF_CENTRE_IF_UNSURE_MM
            || self.breadth < LEAST_BREADTH_IF_UNSURE;
        self.correlation < LEAST_CORRELATION
            || self.off_centre_mm > MOST_OFF_CENTRE_MM
            || self.balance < LEAST_BALANCE
            || (self.correlation < SURE_CORRELATION && may_be_half)
    }
}

/// As [`midsagittal_plane`], with its correlation.
pub fn midsagittal_fit(envelope: &Envelope, volume: &Volume) -> MidsagittalFit {
    let shape = Image::shape(envelope).smoothed().smoothed();
    let middle_of_envelope = centroid(&shape);
    let fine = Image::new(envelope, volume).smoothed().smoothed();
    let points: Vec<(DVec3, f32)> = fine.points(2).collect();
    let middle = fine.halved().smoothed();
    let coarse = middle.halved().smoothed();
    let centroid = centroid(&fine);
    // An eighth of the points of the finest image is enough.
    let [coarse, middle, fine] = [(coarse, 1), (middle, 1), (fine, 2)]
        .map(|(image, stride)| Level::new(image, stride, centroid));
    let begun = coarse.search();
    let levels = [&coarse, &middle, &fine];
    let pose = levels.iter().fold(begun, |pose, level| level.refined(pose));
    let normal = pose.normal();
    let plane = MidsagittalPlane {
        normal,
        offset_mm: normal.dot(centroid) + pose.shift_mm(),
    };
    MidsagittalFit {
        plane,
        correlation: fine.correlation(pose, &shape),
        off_centre_mm: plane.left_mm(middle_of_envelope).abs(),
        balance: balance(plane, &points),
        breadth: breadth(envelope),
    }
}

fn breadth(envelope: &Envelope) -> f64 {
    let [first, last] = envelope.mask().bounds().unwrap_or_default();
    let extent = |axis: usize| (last[axis] - first[axis] + 1) as f64;
    extent(0) / extent(1)
}

/// The lesser number of points with tissue on one side of a plane over that on the other. Tissue is at least half as bright as the
/// median: how bright it is does not count, because coils and contrast agents make one side brighter.
fn balance(plane: MidsagittalPlane, points: &[(DVec3, f32)]) -> f64 {
    let mut values: Vec<f32> = points.iter().map(|&(_, value)| value).collect();
    let middle = values.len() / 2;
    let median = match values.is_empty() {
        true => 0.0,
        false => *values.select_nth_unstable_by(middle, f32::total_cmp).1,
    };
    let mut counts = [0u32; 2];
    for &(position, _) in points.iter().filter(|&&(_, value)| value >= median / 2.0) {
        counts[usize::from(plane.left_mm(position) > 0.0)] += 1;
    }
    f64::from(counts[0].min(counts[1])) / f64::from(counts[0].max(counts[1]).max(1))
}

/// The centroid, weighted by value; the values come from an envelope, which is not empty.
fn centroid(image: &Image) -> DVec3 {
    let (sum, weight) = image
        .points(1)
        .fold((DVec3::ZERO, 0.0), |(sum, weight), (place, value)| {
            (sum + place * f64::from(value), weight + f64::from(value))
        });
    sum / weight
}
