//! How surfaces fit the cortex of a head.

use analysis::JunctionPlaces;
use case::{CaseFacts, SurfaceFit};
use geometry::{Envelope, Volume};
use glam::DVec3;

use crate::maps::{junction_places, mirror_plane};

/// The fewest vertices in the head that tell whether a surface follows the cortex.
const LEAST_PLACES: usize = 500;

/// How far a surface is moved to see whether its place matters, in mm: two thicknesses of the cortex.
const MOVED_MM: f64 = 6.0;

/// Compares the places of vertices of some surfaces, LPS mm, with the head of a case.
pub(super) fn fit(
    facts: &CaseFacts,
    envelope: &Envelope,
    volume: &Volume,
    surfaces: &[Vec<DVec3>],
) -> SurfaceFit {
    let places = surfaces.concat();
    let junction = junction_places(facts, envelope, volume).ok();
    let [junction_median_mm, junction_p95_mm] = match junction {
        Some(junction) if places.len() >= LEAST_PLACES => distances(&junction, &places).map(Some),
        _ => [None; 2],
    };
    let plane = mirror_plane(facts);
    SurfaceFit {
        junction_median_mm,
        junction_p95_mm,
        ..spreads(volume, surfaces, |place| plane.reflected(place))
    }
}

/// Median and 95th percentile of the distances from the junction, in mm.
fn distances(junction: &JunctionPlaces, places: &[DVec3]) -> [f32; 2] {
    let mut found: Vec<f32> = places
        .iter()
        .map(|&place| junction.distance_mm(place))
        .collect();
    found.sort_by(f32::total_cmp);
    [50, 95].map(|percent| found[percent * (found.len() - 1) / 100])
}

/// The mean of the spreads of the surfaces: white and pial lie along different intensities.
fn spreads(
    volume: &Volume,
    surfaces: &[Vec<DVec3>],
    mirror: impl Fn(DVec3) -> DVec3,
) -> SurfaceFit {
    let mirrored = surfaces
        .iter()
        .map(|places| places.iter().map(|&place| mirror(place)).collect());
    let mirrored: Vec<Vec<DVec3>> = mirrored.collect();
    let mean = |of: &[Vec<DVec3>], spread: &dyn Fn(&[DVec3]) -> Option<f32>| {
        let found: Vec<f32> = of.iter().filter_map(|places| spread(places)).collect();
        (!found.is_empty()).then(|| found.iter().sum::<f32>() / found.len() as f32)
    };
    let as_they_are = |places: &[DVec3]| spread(volume, places.iter().copied());
    SurfaceFit {
        spread: mean(surfaces, &as_they_are),
        mirrored_spread: mean(&mirrored, &as_they_are),
        mirrored_moved_spread: mean(&mirrored, &|places| spread(volume, moved(places))),
        ..SurfaceFit::default()
    }
}

/// Places that are moved along each axis, both ways.
fn moved(places: &[DVec3]) -> impl Iterator<Item = DVec3> {
    let [x, y, z] = DVec3::AXES.map(|axis| MOVED_MM * axis);
    let steps = [x, -x, y, -y, z, -z];
    places
        .iter()
        .flat_map(move |&place| steps.map(|step| place + step))
}

/// The range that holds the middle half of the intensities at some places; `None` if too few of them lie in the volume.
fn spread(volume: &Volume, places: impl Iterator<Item = DVec3>) -> Option<f32> {
    let mut found: Vec<f32> = places
        .filter_map(|place| volume.intensity_at(place))
        .collect();
    if found.len() < LEAST_PLACES {
        return None;
    }
    found.sort_by(f32::total_cmp);
    let [low, high] = [1, 3].map(|quarter| found[quarter * (found.len() - 1) / 4]);
    Some(high - low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Grid, Rescale};
    use glam::DAffine3;

    #[test]
    fn a_surface_that_follows_a_border_has_a_narrow_spread_and_its_mirror_image_a_wide_one() {
        // A wavy border between dark and bright, which is not its own mirror image.
        let border = |y: f64| 30.0 + 6.0 * (y / 4.0).sin();
        let grid = Grid::new([60, 60, 20], DAffine3::IDENTITY).unwrap();
        let bright = |index: usize| {
            let [x, y, _] = grid.voxel(index).map(|along| along as f64);
            (1000.0 / (1.0 + (border(y) - x).exp())) as u16
        };
        let voxels = (0..grid.voxel_count()).map(bright).collect();
        let rescale = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        let volume = Volume::new(grid.clone(), voxels, rescale).unwrap();
        let places = (0..2000).map(|number| {
            let y = 5.0 + f64::from(number % 100) / 2.0;
            DVec3::new(border(y), y, 1.0 + f64::from(number / 200))
        });
        let fit = |places: Vec<DVec3>| {
            let mirror = |at: DVec3| DVec3::new(60.0 - at.x, at.y, at.z);
            spreads(&volume, &[places], mirror)
        };
        let own = fit(places.clone().collect());
        assert_eq!(own.follows_cortex(), Some(true), "{own:?}");
        assert!(!own.is_mirrored());
        let mirrored = fit(places
            .clone()
            .map(|at| DVec3::new(60.0 - at.x, at.y, at.z))
            .collect());
        assert!(mirrored.is_mirrored(), "{mirrored:?}");
        assert_eq!(mirrored.follows_cortex(), Some(false));
        let moved = fit(places.map(|at| at + DVec3::Y * 6.0).collect());
        assert_eq!(moved.follows_cortex(), Some(false), "{moved:?}");
        assert!(!moved.is_mirrored());
        assert_eq!(fit(Vec::new()).follows_cortex(), None);
    }
}
