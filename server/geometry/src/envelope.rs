//! The closed mask that hugs the dura.

use glam::DVec3;

use crate::beyond_cuts::Extended;
use crate::runs::{Connectivity, fill_holes, keep_largest_component};
use crate::transform::{MAX_DISTANCE, transformed};
use crate::{BrainMask, Cut, GeometryError, Grid, Mask};

/// The largest radius of the closing, in mm.
const MAX_CLOSING_RADIUS_MM: f64 = 50.0;

/// The greatest number of voxels of the padded mask, at five bytes each.
const MAX_PADDED_VOXELS: f64 = 3e8;

/// The Euclidean closing of a brain mask: its surface bridges the sulci and follows the dura.
///
/// Invariants: at least one voxel, none on a face of the grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope {
    mask: Mask,
    cuts: Vec<Cut>,
    fence: Vec<u32>,
}

impl Envelope {
    /// An envelope from a stored mask that [`envelope`] made before.
    ///
    /// # Errors
    /// If the mask is empty, if its grid is not isotropic along the patient axes, or if the mask touches a face of its
    /// grid.
    pub fn from_stored(mask: Mask) -> Result<Self, GeometryError> {
        mask.check_working()?;
        Ok(Self {
            mask,
            cuts: Vec::new(),
            fence: Vec::new(),
        })
    }

    /// The same envelope with the cuts of the volume.
    pub fn with_cuts(self, cuts: Vec<Cut>) -> Self {
        Self { cuts, ..self }
    }

    /// The same envelope with a fence: the border voxels, ascending, at which its border runs through tissue.
    pub fn with_fence(self, fence: Vec<u32>) -> Self {
        Self { fence, ..self }
    }

    /// The part of the envelope for which `is_kept` holds, with its holes filled; of several components, the largest. It has
    /// the same cuts and no fence, and its grid is the block that it needs.
    ///
    /// # Errors
    /// If nothing is left.
    pub fn clipped(&self, is_kept: impl Fn(usize) -> bool) -> Result<Self, GeometryError> {
        let voxels = self.mask.voxels().iter().enumerate();
        let kept = voxels.map(|(index, &is_inside)| is_inside && is_kept(index));
        let kept = Mask::new(self.grid().clone(), kept.collect())?;
        let kept = kept.largest_component().filled().cropped()?;
        Ok(Self::from_stored(kept)?.with_cuts(self.cuts.clone()))
    }

    /// The working grid.
    pub fn grid(&self) -> &Grid {
        self.mask.grid()
    }

    /// The mask on the working grid.
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// The faces of the volume that cut it; its border there is not dura.
    pub fn cuts(&self) -> &[Cut] {
        &self.cuts
    }

    /// Whether a depth at a position (LPS mm) is known as far as the cuts go: none may be nearer than the dura.
    pub fn cuts_leave(&self, position_in_patient: DVec3, depth_mm: f32) -> bool {
        Cut::all_leave(&self.cuts, position_in_patient, depth_mm, self.spacing_mm())
    }

    /// The border voxels at which the border runs through tissue, ascending; it is not dura there.
    pub fn fence(&self) -> &[u32] {
        &self.fence
    }

    /// Edge of a voxel, in mm.
    pub fn spacing_mm(&self) -> f64 {
        self.grid().spacing_mm()[0]
    }

    /// Its volume, in millilitres.
    pub fn volume_ml(&self) -> f64 {
        self.mask.volume_ml()
    }
}

/// Closes a brain mask by a ball of `closing_radius_mm`, fills the holes and keeps the largest component.
///
/// The closing is exact: a dilation and an erosion by thresholds of two exact distance transforms. It is computed with
/// padding for the whole ball, so that no face of a volume cuts it.
///
/// # Errors
/// If the radius is not within 0 to 50 mm, or is too large for voxels of this size.
pub fn envelope(brain: &BrainMask, closing_radius_mm: f64) -> Result<Envelope, GeometryError> {
    check_closing(brain.mask().grid(), closing_radius_mm)?;
    Ok(Envelope {
        mask: closed_and_filled(brain.mask(), closing_radius_mm)?,
        cuts: Vec::new(),
        fence: Vec::new(),
    })
}

/// The envelope of a brain that faces of the volume cut: like [`envelope`], but the faces do not count as dura.
///
/// The closing must also bridge sulci that a face cuts open. So the brain is continued beyond the faces along its
/// outline, closed, and cut again.
///
/// # Errors
/// As [`envelope`].
pub fn cut_envelope(
    brain: &BrainMask,
    closing_radius_mm: f64,
    cuts: &[Cut],
) -> Result<Envelope, GeometryError> {
    let grid = brain.mask().grid();
    let is_extended = !cuts.is_empty() && closing_radius_mm >= grid.spacing_mm()[0];
    if !is_extended {
        return Ok(envelope(brain, closing_radius_mm)?.with_cuts(cuts.to_vec()));
    }
    check_closing(grid, closing_radius_mm)?;
    let extended = Extended::new(brain, closing_radius_mm, cuts)?;
    let closed = closed_and_filled(extended.mask(), closing_radius_mm)?;
    let mut kept = extended.cropped(&closed, cuts);
    keep_largest_component(grid.size(), &mut kept, Connectivity::Corners);
    let envelope = Envelope::from_stored(Mask::new(grid.clone(), kept)?)?;
    Ok(envelope.with_cuts(cuts.to_vec()))
}

fn closed_and_filled(mask: &Mask, closing_radius_mm: f64) -> Result<Mask, GeometryError> {
    let grid = mask.grid();
    let size = grid.size();
    let radius = closing_radius_mm / grid.spacing_mm()[0];
    let mut closed = close(size, mask.voxels(), radius);
    keep_largest_component(size, &mut closed, Connectivity::Corners);
    fill_holes(size, &mut closed);
    Mask::new(grid.clone(), closed)
}

/// Whether a ball of `closing_radius_mm` can close a mask on a working grid.
///
/// # Errors
/// As [`envelope`].
pub fn check_closing(grid: &Grid, closing_radius_mm: f64) -> Result<(), GeometryError> {
    if !(0.0..=MAX_CLOSING_RADIUS_MM).contains(&closing_radius_mm) {
        return Err(GeometryError::Parameter {
            name: "closing_radius_mm",
            value: closing_radius_mm,
            range: "from 0 to 50",
        });
    }
    let radius = closing_radius_mm / grid.spacing_mm()[0];
    let padded_sides = grid.size().map(|side| side as f64 + 2.0 * (radius + 1.0));
    if radius >= f64::from(MAX_DISTANCE) || padded_sides.iter().product::<f64>() > MAX_PADDED_VOXELS
    {
        return Err(GeometryError::Parameter {
            name: "closing_radius_mm",
            value: closing_radius_mm,
            range: "smaller for voxels of this size",
        });
    }
    Ok(())
}

/// The closing of a set of voxels by a ball of `radius` voxels.
///
/// A closing stays within the convex hull of the set, so the result needs no more padding than the set.
pub(crate) fn close(size: [usize; 3], voxels: &[bool], radius: f64) -> Vec<bool> {
    if radius < 1.0 {
        return voxels.to_vec();
    }
    // Only distances up to the radius matter; the bound exceeds it.
    let bound = radius.floor() as u8 + 1;
    let within = (radius * radius).floor() as u16;
    let pad = usize::from(bound);
    let [px, py, pz] = size.map(|side| side + 2 * pad);
    let mut to_set = padded(size, voxels, pad, bound);
    let mut to_rest = transformed([px, py, pz], &mut to_set, 0, |squared| {
        if squared <= within { bound } else { 0 }
    });
    // The axes are x, z, y now, and x, y, z again after this.
    transformed([px, pz, py], &mut to_rest, pad, |squared| squared > within)
}

/// The bounds of distances to a set, with a padding of `pad` voxels on all sides.
fn padded([nx, ny, nz]: [usize; 3], set: &[bool], pad: usize, bound: u8) -> Vec<u8> {
    let [px, py, pz] = [nx, ny, nz].map(|side| side + 2 * pad);
    let mut block = vec![bound; px * py * pz];
    for (row, set) in set.chunks_exact(nx).enumerate() {
        let start = pad + px * (row % ny + pad + py * (row / ny + pad));
        for (out, &is_set) in block[start..start + nx].iter_mut().zip(set) {
            *out = if is_set { 0 } else { bound };
        }
    }
    block
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom;

    /// The closing by definition: a voxel is in it if every ball that contains the voxel touches the set.
    fn closed_by_definition(size: [usize; 3], voxels: &[bool], radius: f64) -> Vec<bool> {
        let reach = radius.floor() as isize;
        let [nx, ny, nz] = size.map(|side| side as isize);
        let offsets: Vec<[isize; 3]> = (-reach..=reach)
            .flat_map(|x| {
                (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |z| [x, y, z]))
            })
            .filter(|offset| {
                offset.iter().map(|along| along * along).sum::<isize>() as f64 <= radius * radius
            })
            .collect();
        let is_set = |[x, y, z]: [isize; 3]| {
            (0..nx).contains(&x)
                && (0..ny).contains(&y)
                && (0..nz).contains(&z)
                && voxels[(x + nx * (y + ny * z)) as usize]
        };
        let shifted = |voxel: [isize; 3], offset: &[isize; 3]| {
            [0, 1, 2].map(|axis| voxel[axis] + offset[axis])
        };
        let is_near_set = |voxel| offsets.iter().any(|offset| is_set(shifted(voxel, offset)));
        let voxel = |index: isize| [index % nx, index / nx % ny, index / (nx * ny)];
        let is_closed = |index| {
            offsets
                .iter()
                .all(|offset| is_near_set(shifted(voxel(index), offset)))
        };
        (0..nx * ny * nz).map(is_closed).collect()
    }

    #[test]
    fn the_closing_is_that_of_its_definition() {
        let size = [15, 13, 11];
        let mut state = 1u32;
        let voxels: Vec<bool> = (0..size.iter().product())
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                state >> 28 == 0
            })
            .collect();
        for radius in [0.5, 1.0, 2.0, 2.5, 3.7] {
            let expected = closed_by_definition(size, &voxels, radius);
            assert_eq!(close(size, &voxels, radius), expected, "radius {radius}");
        }
    }

    #[test]
    fn closing_a_closed_set_changes_nothing() {
        let first = envelope(&phantom::two_lobes([14.0, 11.0], 26.0, 4.0), 6.0).unwrap();
        let again = close(first.grid().size(), first.mask().voxels(), 6.0);
        assert_eq!(again, first.mask().voxels());
    }

    #[test]
    fn the_closing_bridges_a_gap_and_keeps_a_ball() {
        let ball = phantom::ball(15.0);
        assert_eq!(envelope(&ball, 10.0).unwrap().mask(), ball.mask());
        let lobes = phantom::two_lobes([12.0, 12.0], 20.0, 3.0);
        let closed = envelope(&lobes, 8.0).unwrap();
        let count = |mask: &Mask| mask.voxels().iter().filter(|&&voxel| voxel).count();
        assert!(count(closed.mask()) > count(lobes.mask()));
    }

    #[test]
    fn a_mask_that_fills_its_volume_is_not_cut() {
        let grid = Grid::aligned([20, 18, 16], [1.0; 3], glam::DVec3::ZERO).unwrap();
        let mask = Mask::new(grid.clone(), vec![true; grid.voxel_count()]).unwrap();
        let brain = BrainMask::from_mask(&mask, &grid).unwrap();
        let closed = envelope(&brain, 10.0).unwrap();
        assert!((closed.volume_ml() - 20.0 * 18.0 * 16.0 / 1000.0).abs() < 1e-9);
        assert!(Envelope::from_stored(closed.mask().clone()).is_ok());
    }

    #[test]
    fn a_radius_out_of_range_is_refused() {
        for radius in [-1.0, 51.0, f64::NAN, f64::INFINITY] {
            let refused = envelope(&phantom::ball(5.0), radius);
            assert!(
                matches!(refused, Err(GeometryError::Parameter { .. })),
                "{radius}"
            );
        }
        let tiny = phantom::ellipsoid([5.0; 3], 0.1);
        assert!(matches!(
            envelope(&tiny, 30.0),
            Err(GeometryError::Parameter { .. })
        ));
    }

    #[test]
    fn what_is_no_envelope_is_not_taken_for_one() {
        let grid = Grid::aligned([8; 3], [1.0; 3], glam::DVec3::ZERO).unwrap();
        let full = Mask::new(grid.clone(), vec![true; 512]).unwrap();
        assert_eq!(Envelope::from_stored(full), Err(GeometryError::CutEnvelope));
        let empty = Mask::new(grid, vec![false; 512]).unwrap();
        assert_eq!(Envelope::from_stored(empty), Err(GeometryError::EmptyMask));
    }
}
