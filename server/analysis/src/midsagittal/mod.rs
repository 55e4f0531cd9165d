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

impl MidsagittalPlane {
    /// The direction across the plane, to the patient's left, of length 1, in LPS.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// How far the plane is from the origin of patient space, along the normal, in mm.
    pub fn offset_mm(&self) -> f64 {
        self.offset_mm
    }

    /// The position (LPS mm) mirrored at the plane.
    pub fn reflected(&self, position_in_patient: DVec3) -> DVec3 {
        let distance_mm = self.normal.dot(position_in_patient) - self.offset_mm;
        position_in_patient - self.normal * (2.0 * distance_mm)
    }
}

/// Finds the plane that mirrors the head onto itself best.
///
/// The head is its intensities inside the envelope, between the 2nd and the 98th percentile, and 0 outside; they are sampled
/// at no more than 64 places along the longest side. The plane is that of the least mean difference between a place and its
/// mirror image, where a great difference (a lesion) counts no more than a moderate one. The search begins with planes
/// through about the centroid within 30° of the patient's sagittal plane along either axis, and goes on in Gauss-Newton
/// steps on three images, the finest last. A head that prefers no plane (a ball) gets one near the sagittal plane.
///
/// The result is the same for any number of threads. It is a plane of symmetry: where the fissure between the hemispheres
/// is bent, it is the best plane through it and not the fissure.
///
/// Sources: Ardekani, Kershaw, Braun and Kanno, "Automatic Detection of the Mid-Sagittal Plane in 3-D Brain Images", IEEE
/// Trans. Med. Imaging 16, 1997 (similarity across the plane, from coarse to fine); Prima, Ourselin and Ayache,
/// "Computation of the Mid-Sagittal Plane in 3-D Brain Images", IEEE Trans. Med. Imaging 21, 2002 (robust against what has
/// no counterpart).
pub fn midsagittal_plane(envelope: &Envelope, volume: &Volume) -> MidsagittalPlane {
    let fine = Image::new(envelope, volume).smoothed().smoothed();
    let middle = fine.halved().smoothed();
    let coarse = middle.halved().smoothed();
    let centroid = centroid(&fine);
    // Of the finest image an eighth of the places is enough.
    let [coarse, middle, fine] = [(coarse, 1), (middle, 1), (fine, 2)]
        .map(|(image, stride)| Level::new(image, stride, centroid));
    let begun = coarse.search();
    let pose = [coarse, middle, fine]
        .iter()
        .fold(begun, |pose, level| level.refined(pose));
    let normal = pose.normal();
    MidsagittalPlane {
        normal,
        offset_mm: normal.dot(centroid) + pose.shift_mm(),
    }
}

/// The mean place, weighted by value; the values are those of an envelope, which is not empty.
fn centroid(image: &Image) -> DVec3 {
    let (sum, weight) = image
        .points(1)
        .fold((DVec3::ZERO, 0.0), |(sum, weight), (place, value)| {
            (sum + place * f64::from(value), weight + f64::from(value))
        });
    sum / weight
}
