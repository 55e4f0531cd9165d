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

    /// A position (LPS mm) mirrored at the plane.
    pub fn reflected(&self, position_in_patient: DVec3) -> DVec3 {
        let distance_mm = self.normal.dot(position_in_patient) - self.offset_mm;
        position_in_patient - self.normal * (2.0 * distance_mm)
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

/// The plane of [`midsagittal_plane`], and how alike the two sides are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MidsagittalFit {
    pub plane: MidsagittalPlane,
    /// The correlation of the intensities inside the envelope with those at their mirror images, smoothed by about 3 mm,
    /// 0 to 1.
    pub correlation: f64,
}

/// As [`midsagittal_plane`], with its correlation.
pub fn midsagittal_fit(envelope: &Envelope, volume: &Volume) -> MidsagittalFit {
    let shape = Image::shape(envelope).smoothed().smoothed();
    let fine = Image::new(envelope, volume).smoothed().smoothed();
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
    MidsagittalFit {
        plane: MidsagittalPlane {
            normal,
            offset_mm: normal.dot(centroid) + pose.shift_mm(),
        },
        correlation: fine.correlation(pose, &shape),
    }
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
