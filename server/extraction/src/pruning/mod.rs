//! Tree pruning: the brain is what a flood from within it reaches before it leaks.
//!
//! Source: Bergo, Falcão, Miranda and Rocha, "Automatic Image Segmentation by Tree Pruning", Journal of Mathematical Imaging
//! and Vision 29:141–162, 2007. A forest of optimal paths grows from markers inside of the brain, where the cost of a path is
//! the greatest gradient on it. It fills the brain first, and conquers the rest of the head through the few places where the
//! brain's border is weakest: the paths to the border of the volume all run through these. They are cut there.
//!
//! The steps, and where they leave the paper:
//!
//! 1. Cubes; the two classes of Otsu; the marker is of what is bright and eroded, as there. It is the component that lies
//!    deepest in the head, for the largest can be the face, and it is eroded further while it is larger than a brain's inside.
//! 2. The S that enhances the image ends at the brain's own intensities, which the marker knows; in the paper, at the
//!    mean of the bright class, which fat can draw far upwards.
//! 3. Gradient of seven-valued features, forest, descendants, leaks and their ties, as there. But paths end
//!    close below the head's surface, or where they are too far from the marker, instead of at the faces of the volume: else
//!    they can be cut between the scalp and the air.
//! 4. What is left without fluid, opened by the radius at which the nerves, the vessels and the bone's marrow fall off, closed by the
//!    usual radius of an envelope and grown by what the dura is away from the grey matter. This is not taken from the paper.
//!
//! The lengths and shares were chosen with the heads of `docs/extraction.md` in view.

mod enhance;
mod forest;

use geometry::{GeometryError, Grid, Mask, Volume};
use glam::{DAffine3, DMat3, DVec3};

use crate::canonical::Canonical;
use crate::extract::go_on;
use crate::{ExtractionError, Observe};

use enhance::{Intensities, gradient};
use forest::Forest;

/// Edge of the voxels on which it works, in mm, where those of the volume are not larger.
const FINEST_MM: f64 = 1.0;

/// The most voxels on which it works; they become larger where there would be more.
const MOST_VOXELS: f64 = (1u32 << 25) as f64;

/// By how much what is bright is eroded until the brain hangs together with nothing else, in mm.
const LEAST_EROSION_MM: f64 = 5.0;
const MOST_EROSION_MM: f64 = 12.0;

/// What the marker has at most, in ml: a brain's own inside, and no scalp.
const LARGEST_MARKER_ML: f64 = 700.0;

/// How far from the marker the brain reaches at most, in mm.
const REACH_MM: f64 = 40.0;

/// How deep below the surface of the head the brain begins at least, in mm: less than scalp and bone have. A volume
/// that shows a bare brain loses its rim by this.
const SCALP_MM: f64 = 5.0;

/// How deep below the surface of the head the middle of a brain is, in mm, and nothing of a face.
const CORE_MM: f64 = 25.0;

/// By how much what is not dark is closed to be the head, in mm: bone and sinuses are bridged, and then filled.
const HEAD_CLOSING_MM: f64 = 6.0;

/// By how much what is left of the head is opened, closed and dilated to be the brain up to the dura, in mm.
const OPENING_MM: f64 = 3.0;
const CLOSING_MM: f64 = 10.0;
const DURA_MM: f64 = 1.5;

/// The brain of a volume, on a grid of its own.
///
/// # Errors
/// When nothing in the volume can be a brain, or when `observe` said stop.
pub(crate) fn prune(volume: &Volume, observe: Observe<'_>) -> Result<Mask, ExtractionError> {
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
    let image = intensities.enhanced(&marker)?;
    let gradient = gradient(&image);
    go_on(observe, 0.5)?;
    let forest = Forest::grown(&gradient, &marker, &reach);
    go_on(observe, 0.7)?;
    let kept = Mask::new(reach.grid().clone(), forest.pruned(&gradient, &reach))?;
    go_on(observe, 0.8)?;
    let brain = image.tissue(kept)?.opened(OPENING_MM)?.largest_component();
    if brain.volume_ml() == 0.0 {
        return Err(ExtractionError::NoBrain {
            what: "no part of it that is thick enough holds back its surroundings",
        });
    }
    let brain = brain.closed(CLOSING_MM)?.dilated(DURA_MM)?;
    go_on(observe, 1.0)?;
    Ok(brain)
}

/// The grid along a volume's own axes whose voxels are cubes.
///
/// Its axes come in one order however the volume stores them, so that paths of equal cost, of which the first one is taken, are the
/// same ones.
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

/// Voxels that are surely brain: the deepest part of what is bright, once it is eroded so far that it is not larger than
/// the inside of a brain. In a head that is nowhere thick, the largest part.
fn marker(intensities: &Intensities, head: &Mask) -> Result<Mask, ExtractionError> {
    let bright = intensities.bright()?;
    let core = head.eroded(CORE_MM)?;
    let core = if core.bounds().is_some() {
        core
    } else {
        bright.clone()
    };
    let mut erosion_mm = LEAST_EROSION_MM;
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
        what: "no bright part of it has the size of a brain's inside",
    })
}

/// Where the brain can be: around the marker, and below the scalp.
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
