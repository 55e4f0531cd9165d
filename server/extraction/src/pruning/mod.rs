//! Tree pruning: the brain is the region that a flood from inside it reaches before it leaks.
//!
//! Source: Bergo, Falcão, Miranda and Rocha, "Automatic Image Segmentation by Tree Pruning", Journal of Mathematical
//! Imaging and Vision 29:141–162, 2007. A forest of optimal paths grows from markers inside the brain; the cost of a
//! path is the greatest gradient on it. The forest fills the brain first and then the rest of the head through the few
//! places at which the border of the brain is weakest. All paths to the border of the volume run through these leaks,
//! and are cut there.
//!
//! The steps, and their differences from the paper:
//!
//! 1. Cubic voxels, two classes by Otsu's method, and a marker from the eroded bright voxels, as in the paper. But the
//!    marker is the component deepest in the head, because the largest one can be the face, and it is eroded further if
//!    it is larger than the inside of a brain.
//! 2. The curve that enhances the image ends at the intensities of the brain, known from the marker. In the paper it
//!    ends at the mean of the bright class, which fat can raise a lot.
//! 3. Gradients of seven-valued features, forest, descendants, leaks and ties, as in the paper. But paths end just
//!    below the surface of the head, or where they are too far from the marker, instead of at the faces of the volume:
//!    otherwise they can be cut between the scalp and the air.
//! 4. The result without fluid, opened by a radius that removes nerves, vessels and bone marrow, closed by the default
//!    radius of an envelope, and grown by the distance of the dura from the grey matter. This step is not from the
//!    paper.

mod enhance;
mod forest;

use geometry::{GeometryError, Grid, Mask, Volume};
use glam::{DAffine3, DMat3, DVec3};

use crate::canonical::Canonical;
use crate::observe::go_on;
use crate::{ExtractionError, Observe};

pub(crate) use enhance::Classes;
use enhance::{Intensities, gradient};
use forest::Forest;

/// The edge of its voxels, in mm, unless the voxels of the volume are larger.
const FINEST_MM: f64 = 1.0;

/// The greatest number of voxels; with more, the voxels become larger.
const MOST_VOXELS: f64 = (1u32 << 25) as f64;

/// The greatest radius of the erosion that separates the brain from everything else, in mm.
const MOST_EROSION_MM: f64 = 12.0;

/// The greatest volume of the marker, in ml: the inside of a brain, without scalp.
const LARGEST_MARKER_ML: f64 = 700.0;

// Which heads the following lengths and the fraction were chosen on: `lab/docs/extraction.md`.

/// The least radius of the erosion that separates the brain from everything else, in mm.
const EROSION_MM: f64 = 5.0;

/// The greatest distance of the brain from the marker, in mm.
const REACH_MM: f64 = 40.0;

/// The least depth of the brain below the surface of the head, in mm: less than scalp and bone. A volume of a bare brain loses its rim
/// by this.
const SCALP_MM: f64 = 5.0;

/// A depth below the surface of the head that the middle of a brain reaches, but no part of a face, in mm.
const CORE_MM: f64 = 25.0;

/// The radius of the closing from bright voxels to the head, in mm: it bridges bone and sinuses, which are then filled.
const HEAD_CLOSING_MM: f64 = 6.0;

/// The intensity that becomes white, as a fraction of the way from the dark class to the median of the marker. In T1, grey matter is
/// about two thirds as bright as white matter, and the marker is mostly white matter: both become white, and only the border of the
/// brain remains.
const WHITE_SHARE: f32 = 0.7;

/// The radius of the opening of the pruned voxels, in mm.
const OPENING_MM: f64 = 3.0;

/// The radius of the closing after it, in mm.
const CLOSING_MM: f64 = 10.0;

/// The dilation from the brain up to the dura, in mm.
const DURA_MM: f64 = 1.5;

/// The brain of a volume by tree pruning, on a grid of its own; not rated.
///
/// # Errors
/// If nothing in the volume can be a brain, or if `observe` stops the work.
pub(crate) fn tree_pruned(volume: &Volume, observe: Observe<'_>) -> Result<Mask, ExtractionError> {
    go_on(observe, 0.0)?;
    let intensities = Intensities::of(volume, &isotropic_grid(&Canonical::new(volume).grid()?)?)?;
    go_on(observe, 0.1)?;
    let head = intensities.not_air()?.closed(HEAD_CLOSING_MM)?.filled();
    go_on(observe, 0.2)?;
    let marker = marker(&intensities, &head)?;
    go_on(observe, 0.3)?;
    let reach = reach(&head, &marker)?;
    drop(head);
    go_on(observe, 0.4)?;
    let image = intensities.enhanced(&marker, WHITE_SHARE)?;
    let gradient = gradient(&image);
    go_on(observe, 0.5)?;
    let forest = Forest::grown(&gradient, &marker, &reach);
    go_on(observe, 0.7)?;
    let kept = Mask::new(reach.grid().clone(), forest.pruned(&gradient, &reach))?;
    go_on(observe, 0.8)?;
    let brain = image.tissue(kept)?.opened(OPENING_MM)?.largest_component();
    if brain.volume_ml() == 0.0 {
        return Err(ExtractionError::NoBrain {
            what: "no part that is thick enough is separated from its surroundings",
        });
    }
    let brain = brain.closed(CLOSING_MM)?.dilated(DURA_MM)?;
    go_on(observe, 1.0)?;
    Ok(brain)
}

/// A grid of cubic voxels along the axes of a volume.
///
/// The order of its axes does not depend on how the volume stores them, so that the choice between paths of equal cost,
/// the first one found, is always the same.
fn isotropic_grid(native: &Grid) -> Result<Grid, ExtractionError> {
    let spacing = native.spacing_mm();
    let size = native.size();
    let extents = [0, 1, 2].map(|axis| size[axis] as f64 * spacing[axis]);
    let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
    let edge = finest
        .max(FINEST_MM)
        .max((extents.iter().product::<f64>() / MOST_VOXELS).cbrt());
    let ratio = DVec3::from_array(spacing.map(|spacing| edge / spacing));
    let native_from_here = DAffine3 {
        matrix3: DMat3::from_diagonal(ratio),
        translation: ratio / 2.0 - 0.5,
    };
    let sides = extents.map(|extent| (extent / edge).round().max(1.0) as usize);
    Ok(Grid::new(
        sides,
        native.patient_from_voxel() * native_from_here,
    )?)
}

/// Voxels that are certainly brain: the deepest component of the bright voxels, eroded until it is not larger than the
/// inside of a brain. In a head that is thick nowhere, the largest component.
fn marker(intensities: &Intensities, head: &Mask) -> Result<Mask, ExtractionError> {
    let bright = intensities.bright()?;
    let core = head.eroded(CORE_MM)?;
    let core = if core.bounds().is_some() {
        core
    } else {
        bright.clone()
    };
    let mut erosion_mm = EROSION_MM;
    while erosion_mm <= MOST_EROSION_MM {
        let marker = bright.eroded(erosion_mm)?.component_with_most_of(&core)?;
        let volume_ml = marker.volume_ml();
        if volume_ml == 0.0 {
            break;
        }
        if volume_ml <= LARGEST_MARKER_ML {
            return Ok(marker);
        }
        erosion_mm += 1.0;
    }
    Err(ExtractionError::NoBrain {
        what: "no bright part has the size of the inside of a brain",
    })
}

/// The voxels where the brain can be: around the marker and below the scalp.
fn reach(head: &Mask, marker: &Mask) -> Result<Mask, GeometryError> {
    let grid = head.grid();
    let outside = head.voxels().iter().map(|&is_head| !is_head).collect();
    let scalp = Mask::new(grid.clone(), outside)?.dilated(SCALP_MM)?;
    let around = marker.dilated(REACH_MM)?;
    let is_within =
        |index: usize| marker.voxels()[index] || (around.voxels()[index] && !scalp.voxels()[index]);
    Mask::new(
        grid.clone(),
        (0..grid.voxel_count()).map(is_within).collect(),
    )
}
