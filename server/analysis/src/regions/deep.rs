//! What is no cortex within the cerebrum: nuclei, and the edges of ventricles.

use geometry::flood;
use glam::DVec3;

use super::lattice::Lattice;
use super::parts::{CEREBRUM, OPEN, OUTSIDE};

/// The marks of the flood.
const CORTEX: u8 = 1;
pub(super) const DEEP: u8 = 2;

// All lengths below are in mm of a head of usual size, along its axes; x is to either side.

/// An ellipsoid: its centre and its half-axes.
struct Ellipsoid(DVec3, DVec3);

impl Ellipsoid {
    fn contains(&self, side: DVec3) -> bool {
        self.contains_within(side, 0.0)
    }

    /// The same with half-axes that are longer by `more_mm`.
    fn contains_within(&self, side: DVec3, more_mm: f64) -> bool {
        ((side - self.0) / (self.1 + more_mm)).length_squared() < 1.0
    }
}

/// The middles of putamen, caudate nucleus, thalamus and midbrain.
const NUCLEI: [Ellipsoid; 4] = [
    Ellipsoid(DVec3::new(24.0, 21.0, -12.5), DVec3::new(5.0, 11.0, 8.0)),
    Ellipsoid(DVec3::new(12.0, 30.0, -9.0), DVec3::new(4.0, 7.0, 8.0)),
    Ellipsoid(DVec3::new(11.0, 2.5, -3.0), DVec3::new(7.0, 9.0, 7.0)),
    Ellipsoid(DVec3::new(0.0, -7.0, -14.0), DVec3::new(11.0, 8.0, 7.0)),
];
/// Where the fluid of the ventricles is: that of their bodies and front horns, and that of their back horns.
const VENTRICLES: [Ellipsoid; 2] = [
    Ellipsoid(DVec3::new(0.0, 12.0, -2.0), DVec3::new(26.0, 40.0, 20.0)),
    Ellipsoid(DVec3::new(24.0, -22.0, 0.0), DVec3::new(13.0, 28.0, 16.0)),
];
/// Where fluid may be that of a ventricle: no seed of the cortex.
const CENTRE: Ellipsoid = Ellipsoid(DVec3::new(0.0, 14.0, -4.0), DVec3::new(28.0, 38.0, 22.0));
/// The tissue scale of fluid in a ventricle, and beside cortex.
const VENTRICLE_BELOW: f32 = -0.4;
const FLUID_BELOW: f32 = -0.3;
/// The least depth of a ventricle, and the depth up to which everything is cortex.
const VENTRICLE_FROM_MM: f32 = 20.0;
const CORTEX_TO_MM: f32 = 13.0;
/// Above this, in front of this and behind this, everything is cortex.
const ABOVE_MM: f64 = 28.0;
const BEFORE_MM: f64 = 62.0;
const BEHIND_MM: f64 = -45.0;

/// The edge of putamen, caudate nucleus and thalamus is a cell beside what the flood found, within this distance of their middles and
/// not farther to the side, where the insula is.
///
/// Read off six heads: all eight places of their lists that were at nuclei lie there, and none at cortex.
const EDGE_WITHIN_MM: f64 = 8.0;
const EDGE_TO_SIDE_MM: f64 = 33.0;

/// The level of a tissue scale in a flood: white matter is highest, so that it divides grey matter of cortex and nuclei.
fn level(value: f32) -> u16 {
    ((value + 0.2) * 40.0).clamp(0.0, 80.0) as u16
}

/// Brighter cells are white matter, which may be on either side.
const WHITE_FROM: f32 = 0.9;

/// The cells of the cerebrum that are [`DEEP`]: those, darker than white matter, that a flood from nuclei and ventricles reaches before one from the
/// cortex and the fluid around it, and the edge of the nuclei. `marks` are the parts of the cells.
pub(super) fn deep(lattice: &Lattice, marks: &[u8]) -> Vec<u8> {
    let mut flooded: Vec<u8> = (0..marks.len())
        .map(|index| match marks[index] {
            CEREBRUM => seed(lattice, index),
            _ => OUTSIDE,
        })
        .collect();
    let seeds = (0u32..).zip(&flooded);
    let seeds: Vec<u32> = seeds
        .filter(|(_, mark)| matches!(**mark, CORTEX | DEEP))
        .map(|(index, _)| index)
        .collect();
    let level = |index: usize| level(lattice.values[index]);
    flood(
        lattice.size,
        level,
        (&mut flooded, OPEN),
        seeds,
        |mark, _| mark,
    );
    for (mark, &value) in flooded.iter_mut().zip(&lattice.values) {
        if *mark == DEEP && value >= WHITE_FROM {
            *mark = CORTEX;
        }
    }
    with_edges(lattice, flooded)
}

/// Adds the cells at the edge of nuclei, which has a junction with white matter of its own.
///
/// A cell below a nucleus is not its edge: the amygdala and the cortex of the frontal base lie there, with no white matter between.
fn with_edges(lattice: &Lattice, marks: Vec<u8>) -> Vec<u8> {
    let [nx, ny, _] = lattice.size;
    let is_edge = |index: usize| {
        let place = lattice.usual_position(index);
        let side = DVec3::new(place.x.abs(), place.y, place.z);
        let [putamen, caudate, thalamus, _] = &NUCLEI;
        side.x < EDGE_TO_SIDE_MM
            && [putamen, caudate, thalamus]
                .iter()
                .any(|nucleus| nucleus.contains_within(side, EDGE_WITHIN_MM))
            && geometry::face_neighbours(lattice.size, index)
                .any(|(_, other)| marks[other] == DEEP && other != index + nx * ny)
    };
    let edged = marks.iter().enumerate().map(|(index, &mark)| match mark {
        CORTEX if is_edge(index) => DEEP,
        mark => mark,
    });
    edged.collect()
}

/// The mark of a cell of the cerebrum before the flood.
fn seed(lattice: &Lattice, index: usize) -> u8 {
    let (value, depth_mm) = (lattice.values[index], lattice.depths[index]);
    let place = lattice.usual_position(index);
    let side = DVec3::new(place.x.abs(), place.y, place.z);
    let is_ventricle = depth_mm > VENTRICLE_FROM_MM
        && VENTRICLES.iter().any(|ventricle| ventricle.contains(side))
        && is_thick_fluid(lattice, index);
    let is_outer =
        depth_mm < CORTEX_TO_MM || place.z > ABOVE_MM || place.y > BEFORE_MM || place.y < BEHIND_MM;
    match value {
        _ if is_ventricle || NUCLEI.iter().any(|nucleus| nucleus.contains(side)) => DEEP,
        _ if is_outer => CORTEX,
        _ if value < FLUID_BELOW && !CENTRE.contains(side) => CORTEX,
        _ => OPEN,
    }
}

/// Whether a cell and all that share a face with it are fluid, which those in a sulcus are not.
fn is_thick_fluid(lattice: &Lattice, index: usize) -> bool {
    let is_fluid = |index: usize| lattice.values[index] < VENTRICLE_BELOW;
    is_fluid(index)
        && geometry::face_neighbours(lattice.size, index).all(|(_, other)| is_fluid(other))
}
