//! Tree pruning: the brain is what a flood from within it reaches before it leaks.
//!
//! Source: Bergo, Falcão, Miranda and Rocha, "Automatic Image Segmentation by Tree Pruning", Journal of Mathematical Imaging
//! and Vision 29:141–162, 2007. A forest of optimal paths grows from markers inside of the brain, where the cost of a path is
//! the greatest gradient on it. It fills the brain first, and conquers the rest of the head through the few places where the
//! brain's border is weakest: the paths to the border of the volume all run through these. They are cut there.

mod enhance;
mod forest;

use geometry::{Grid, Mask, Volume};
use glam::{DAffine3, DMat3, DVec3};

use crate::extract::go_on;
use crate::{ExtractionError, Observe};

use enhance::{Image, gradient};
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
const REACH_MM: f64 = 30.0;

/// The brain of a volume, on a grid of its own.
///
/// # Errors
/// When nothing in the volume can be a brain, or when `observe` said stop.
pub(crate) fn prune(volume: &Volume, observe: Observe<'_>) -> Result<Mask, ExtractionError> {
    go_on(observe, 0.0)?;
    let image = Image::enhanced(volume, &isotropic_grid(volume.grid())?)?;
    go_on(observe, 0.1)?;
    let marker = marker(&image)?;
    let reach = marker.dilated(REACH_MM)?;
    go_on(observe, 0.3)?;
    let gradient = gradient(&image);
    go_on(observe, 0.4)?;
    let forest = Forest::grown(&gradient, &marker, &reach);
    go_on(observe, 0.7)?;
    let kept = Mask::new(reach.grid().clone(), forest.pruned(&gradient, &reach))?;
    go_on(observe, 0.8)?;
    // The opening removes what the brain continues into: the cord, the orbits and the optic nerves.
    let brain = kept.closed(3.0)?.opened(7.0)?.largest_component();
    if brain.volume_ml() == 0.0 {
        return Err(ExtractionError::NoBrain {
            what: "no part of it that is thick enough holds back its surroundings",
        });
    }
    let brain = brain.closed(10.0)?.dilated(1.5)?;
    go_on(observe, 1.0)?;
    Ok(brain)
}

/// The grid along a volume's own axes whose voxels are cubes.
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

/// Voxels that are surely brain: the largest part of what is bright, once it is eroded so far that it is not larger than
/// the inside of a brain.
fn marker(image: &Image) -> Result<Mask, ExtractionError> {
    let bright = image.bright()?;
    let mut erosion_mm = LEAST_EROSION_MM;
    while erosion_mm <= MOST_EROSION_MM {
        let marker = bright.eroded(erosion_mm)?.largest_component_by_faces();
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
