//! The flat map: each hemisphere as a disc on which equal areas are equal solid angles.
//!
//! Every pixel of a disc is a line of sight from outside to the centre of a hemisphere. The disc is Lambert's azimuthal
//! equal-area projection of these directions: with the angle θ to the axis of the disc, a pixel lies 2 sin(θ/2) from the
//! centre of the disc. Unlike an orthographic picture, it foreshortens nothing but what stands askew to its line of sight.
//!
//! Source: J. P. Snyder, "Map Projections: A Working Manual", U.S. Geological Survey Professional Paper 1395, 1987,
//! section 24.

use std::f64::consts::SQRT_2;

use glam::{DMat3, DVec3};
use strum::IntoStaticStr;

use crate::{Camera, FrameSize};

/// The radius of the rim of a disc, 90° from its axis, where the radius of the sphere of directions is 1.
pub const MAP_RIM: f64 = SQRT_2;

/// The radius of the paler margin around the rim, which ends 115° from the axis: 2 sin 57.5°.
pub const MAP_MARGIN: f64 = 1.686_782_891_625_771;

/// The radius of the sphere that a map is drawn as, in mm: what `pan` and the scale refer to. The cortex is about as far from
/// the middle of its hemisphere.
pub const MAP_RADIUS_MM: f64 = 70.0;

/// The side of the square around a disc.
const CELL: f64 = 3.5;

/// The share of the surface in the pixels of the margin: the rest is background.
const MARGIN_SHARE: f32 = 0.5;

/// The centre of a disc is a multiple of a pixel's 1024th part, so that left and right are exactly as far from the middle.
const CENTRE_STEPS: f64 = 1024.0;

/// A half of the brain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Hemisphere {
    /// The patient's left one.
    Left,
    /// The patient's right one.
    Right,
}

impl Hemisphere {
    /// Both, as they lie on a map from left to right.
    pub const ALL: [Self; 2] = [Self::Left, Self::Right];

    /// Its letter.
    pub fn letter(self) -> &'static str {
        match self {
            Self::Left => "L",
            Self::Right => "R",
        }
    }

    /// How far it lies to the left of a plane whose normal points to the left, as a sign.
    fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }

    /// Whether a point that is so far to the left of the plane between the hemispheres belongs to it.
    pub fn has(self, left_of_plane_mm: f64) -> bool {
        self.sign() * left_of_plane_mm > 0.0
    }
}

/// A side of a hemisphere.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum MapFace {
    /// The outer side, seen from its own side of the head.
    Outer,
    /// The inner side, seen from the other hemisphere.
    Inner,
}

/// The sides of the hemispheres that a map shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum MapSides {
    /// The outer sides.
    #[default]
    Outer,
    /// The inner sides.
    Inner,
    /// The outer sides, and below them the inner sides.
    Both,
}

impl MapSides {
    /// The name in the interfaces.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Its rows from the top.
    pub fn faces(self) -> &'static [MapFace] {
        match self {
            Self::Outer => &[MapFace::Outer],
            Self::Inner => &[MapFace::Inner],
            Self::Both => &[MapFace::Outer, MapFace::Inner],
        }
    }
}

/// One disc of a map, and its place among the others.
///
/// Left lies on the left of a map. The outer sides are seen as in the views `left` and `right`: anterior lies outwards on both, so
/// that homologous places are equally far from the middle of the map. The inner sides are seen as in `mesial-left` and
/// `mesial-right`: anterior lies inwards on both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapDisc {
    /// The hemisphere.
    pub hemisphere: Hemisphere,
    /// Which of its sides.
    pub face: MapFace,
    /// Where all lines of sight end, LPS mm.
    pub centre_in_patient: DVec3,
    /// The unit normal of the plane between the hemispheres, to the patient's left.
    pub to_the_left: DVec3,
    /// The centre of the disc to the right of and above the centre of the map.
    offset: [f64; 2],
    /// Width and height of the map.
    extent: [f64; 2],
}

impl MapDisc {
    /// The discs of a map of `hemispheres`, row by row. The lines of sight of a hemisphere end where `centre_of` gives; `None` if
    /// that is nowhere.
    pub fn of_map(
        hemispheres: &[Hemisphere],
        sides: MapSides,
        to_the_left: DVec3,
        centre_of: impl Fn(Hemisphere) -> Option<DVec3>,
    ) -> Option<Vec<Self>> {
        let faces = sides.faces();
        let extent = [hemispheres.len(), faces.len()].map(|count| CELL * count as f64);
        let place = |number: usize, length: f64| CELL * (number as f64 + 0.5) - 0.5 * length;
        let mut discs = Vec::new();
        for (row, &face) in faces.iter().enumerate() {
            for (column, &hemisphere) in hemispheres.iter().enumerate() {
                discs.push(Self {
                    hemisphere,
                    face,
                    centre_in_patient: centre_of(hemisphere)?,
                    to_the_left,
                    offset: [place(column, extent[0]), -place(row, extent[1])],
                    extent,
                });
            }
        }
        Some(discs)
    }

    /// Whether the map has one hemisphere alone.
    pub(crate) fn is_alone_in_its_row(&self) -> bool {
        self.extent[0] == CELL
    }

    /// The patient's directions to the right of the disc, up, and from its centre to the viewer.
    fn axes(&self) -> DMat3 {
        let outwards = self.to_the_left * self.hemisphere.sign();
        let towards_viewer = match self.face {
            MapFace::Outer => outwards,
            MapFace::Inner => -outwards,
        };
        let up = DVec3::Z - self.to_the_left * self.to_the_left.z;
        let up = up.try_normalize().unwrap_or(DVec3::Z);
        DMat3::from_cols(up.cross(towards_viewer), up, towards_viewer)
    }

    /// The projection of the disc into a picture. The camera's zoom and pan move the map; it has no use for the orientation.
    pub fn projection(&self, camera: &Camera, size: FrameSize) -> MapProjection {
        let sides = [size.width(), size.height()].map(f64::from);
        let fitting = (sides[0] / self.extent[0]).min(sides[1] / self.extent[1]);
        let pixels_per_unit = camera.zoom() * fitting;
        let [right, up] = camera.pan_mm().map(|pan_mm| pan_mm / MAP_RADIUS_MM);
        let exact = |place: f64| (place * CENTRE_STEPS).round() / CENTRE_STEPS;
        MapProjection {
            size,
            units_per_pixel: 1.0 / pixels_per_unit,
            centre: [
                exact(0.5 * sides[0] + (self.offset[0] + right) * pixels_per_unit),
                exact(0.5 * sides[1] - (self.offset[1] + up) * pixels_per_unit),
            ],
            centre_in_patient: self.centre_in_patient,
            axes: self.axes(),
        }
    }
}

/// The projection of one disc of a map.
///
/// Places of the picture are in pixels to the right and down from its top left corner, so that the centre of pixel (0, 0) is at
/// (0.5, 0.5). Heights are in mm from the centre of the hemisphere outwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapProjection {
    size: FrameSize,
    units_per_pixel: f64,
    centre: [f64; 2],
    centre_in_patient: DVec3,
    /// The directions to the right, up and towards the viewer.
    axes: DMat3,
}

impl MapProjection {
    /// The picture's size.
    pub fn size(&self) -> FrameSize {
        self.size
    }

    /// Pixels of the radius of the sphere of directions, along which the rim is at [`MAP_RIM`].
    pub fn pixels_per_unit(&self) -> f64 {
        1.0 / self.units_per_pixel
    }

    /// The place of the centre of the disc.
    pub fn centre(&self) -> [f64; 2] {
        self.centre
    }

    /// Where all lines of sight end, LPS mm.
    pub fn centre_in_patient(&self) -> DVec3 {
        self.centre_in_patient
    }

    /// The patient's directions to the right of the disc, up, and from its centre to the viewer.
    pub fn axes(&self) -> DMat3 {
        self.axes
    }

    /// The part of the radius of the sphere of directions that a pixel is wide.
    pub(crate) fn units_per_pixel(&self) -> f64 {
        self.units_per_pixel
    }

    /// The distance of a place from the centre of the disc, of which the rim has [`MAP_RIM`].
    pub fn radius_at(&self, [x, y]: [f64; 2]) -> f64 {
        (x - self.centre[0]).hypot(y - self.centre[1]) * self.units_per_pixel
    }

    /// The unit vector from the centre of the hemisphere to the viewer, at a place; `None` beyond the margin.
    pub fn direction(&self, place: [f64; 2]) -> Option<DVec3> {
        let [right, up] = [place[0] - self.centre[0], self.centre[1] - place[1]]
            .map(|offset| offset * self.units_per_pixel);
        let squared = right * right + up * up;
        let stretch = (1.0 - 0.25 * squared).max(0.0).sqrt();
        let direction = DVec3::new(right * stretch, up * stretch, 1.0 - 0.5 * squared);
        (squared <= MAP_MARGIN * MAP_MARGIN).then(|| self.axes * direction)
    }

    /// The position in LPS mm at a height above a place; `None` beyond the margin.
    pub fn position_in_patient(&self, place: [f64; 2], height_mm: f64) -> Option<DVec3> {
        let direction = self.direction(place)?;
        Some(self.centre_in_patient + direction * height_mm)
    }

    /// The place of a position (LPS mm); `None` if that lies beyond the margin.
    pub fn place_of(&self, position_in_patient: DVec3) -> Option<[f64; 2]> {
        let direction = (position_in_patient - self.centre_in_patient).try_normalize()?;
        let [right, up, towards] = (self.axes.transpose() * direction).to_array();
        let radius_squared = 2.0 * (1.0 - towards);
        let stretch = (2.0 / (1.0 + towards)).sqrt() / self.units_per_pixel;
        (radius_squared <= MAP_MARGIN * MAP_MARGIN).then(|| {
            [
                self.centre[0] + right * stretch,
                self.centre[1] - up * stretch,
            ]
        })
    }

    /// The shares of a row of pixels that the disc covers: half in the margin.
    pub(crate) fn coverage(&self, row: usize) -> impl Iterator<Item = f32> {
        let units_per_pixel = self.units_per_pixel as f32;
        let up = (self.centre[1] as f32 - (row as f32 + 0.5)) * units_per_pixel;
        let centre = self.centre[0] as f32;
        (0..self.size.width()).map(move |column| {
            let right = (column as f32 + 0.5 - centre) * units_per_pixel;
            let radius = (right * right + up * up).sqrt();
            let inside = |edge: f64| {
                let pixels = (edge as f32 - radius) / units_per_pixel;
                (0.5 + pixels).clamp(0.0, 1.0)
            };
            let rim = MARGIN_SHARE + (1.0 - MARGIN_SHARE) * inside(MAP_RIM);
            rim * inside(MAP_MARGIN)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The discs of a map of a head about the origin with hemispheres 30 mm aside.
    fn discs(sides: MapSides) -> Vec<MapDisc> {
        MapDisc::of_map(&Hemisphere::ALL, sides, DVec3::X, |hemisphere| {
            Some(DVec3::new(30.0 * hemisphere.sign(), 0.0, 0.0))
        })
        .unwrap()
    }

    fn camera() -> Camera {
        Camera::new([0.0, 0.0, 0.0, 1.0], 1.0, [0.0; 2]).unwrap()
    }

    fn projections(sides: MapSides) -> Vec<MapProjection> {
        let size = FrameSize::new(700, 350 * sides.faces().len() as u32).unwrap();
        let discs = discs(sides);
        discs
            .iter()
            .map(|disc| disc.projection(&camera(), size))
            .collect()
    }

    /// Where a point at the end of a vector from the centre of each disc lies, in units of the radius from the centre.
    fn offsets(sides: MapSides, vectors: [DVec3; 4]) -> Vec<[f64; 2]> {
        let projections = projections(sides).into_iter().zip(vectors);
        let offset = |(projection, vector): (MapProjection, DVec3)| {
            let position = projection.centre_in_patient() + vector;
            let place = projection.place_of(position).unwrap();
            let [x, y] = [0, 1].map(|axis| place[axis] - projection.centre()[axis]);
            [x, -y].map(|along| (along * projection.units_per_pixel * 1e6).round() / 1e6)
        };
        projections.map(offset).collect()
    }

    #[test]
    fn anterior_lies_outwards_on_the_outer_discs_and_inwards_on_the_inner_ones_and_superior_up() {
        let rim = (MAP_RIM * 1e6).round() / 1e6;
        let anterior = offsets(MapSides::Both, [DVec3::NEG_Y; 4]);
        assert_eq!(anterior, [[-rim, 0.0], [rim, 0.0], [rim, 0.0], [-rim, 0.0]]);
        let superior = offsets(MapSides::Both, [DVec3::Z; 4]);
        assert_eq!(superior, [[0.0, rim]; 4]);
        let [left, right] = [DVec3::X, DVec3::NEG_X];
        let axes = offsets(MapSides::Both, [left, right, right, left]);
        assert_eq!(axes, [[0.0; 2]; 4]);
    }

    #[test]
    fn the_discs_lie_side_by_side_left_at_the_left_and_the_inner_sides_below() {
        let centres = |sides| {
            let projections = projections(sides).into_iter();
            projections.map(|one| one.centre()).collect::<Vec<_>>()
        };
        assert_eq!(centres(MapSides::Outer), [[175.0; 2], [525.0, 175.0]]);
        let both = [[175.0; 2], [525.0, 175.0], [175.0, 525.0], [525.0, 525.0]];
        assert_eq!(centres(MapSides::Both), both);
    }

    #[test]
    fn a_place_comes_back_from_its_position() {
        for projection in projections(MapSides::Both) {
            let [x, y] = projection.centre();
            for offset in [[0.0, 0.0], [90.0, -40.0], [-120.0, 100.0], [3.0, 165.0]] {
                let place = [x + offset[0], y + offset[1]];
                let position = projection.position_in_patient(place, 63.0).unwrap();
                let back = projection.place_of(position).unwrap();
                assert!((back[0] - place[0]).abs() < 1e-9, "{back:?} {place:?}");
                assert!((back[1] - place[1]).abs() < 1e-9, "{back:?} {place:?}");
            }
            assert_eq!(projection.position_in_patient([x + 169.0, y], 63.0), None);
        }
    }

    #[test]
    fn equal_solid_angles_have_equal_areas() {
        let projection = projections(MapSides::Outer)[0];
        let per_pixel = |place: [f64; 2]| {
            let at = |x: f64, y: f64| projection.direction([place[0] + x, place[1] + y]).unwrap();
            let across = at(0.5, 0.0) - at(-0.5, 0.0);
            let down = at(0.0, 0.5) - at(0.0, -0.5);
            across.cross(down).length()
        };
        let [x, y] = projection.centre();
        let middle = per_pixel([x, y]);
        for offset in [[50.0, 20.0], [-100.0, 60.0], [10.0, -140.0], [150.0, 60.0]] {
            let there = per_pixel([x + offset[0], y + offset[1]]);
            assert!((there / middle - 1.0).abs() < 1e-3, "{there} {middle}");
        }
    }

    #[test]
    fn zoom_and_pan_move_the_whole_map() {
        let size = FrameSize::new(700, 350).unwrap();
        let moved = camera().with_zoom(2.0).unwrap();
        let moved = moved.with_pan_mm([35.0, -70.0]).unwrap();
        let right = discs(MapSides::Outer)[1].projection(&moved, size);
        assert_eq!(right.pixels_per_unit(), 200.0);
        // 1.75 + 0.5 radii to the right of the centre, and 1 below it.
        assert_eq!(right.centre(), [350.0 + 450.0, 175.0 + 200.0]);
    }

    #[test]
    fn a_disc_is_covered_to_its_margin_which_is_paler() {
        let projection = projections(MapSides::Outer)[0];
        let row: Vec<f32> = projection.coverage(175).collect();
        let at = |radius: f64| row[(175.0 + radius * projection.pixels_per_unit()) as usize];
        assert_eq!([at(0.0), at(1.38), at(1.6), at(1.74)], [1.0, 1.0, 0.5, 0.0]);
        assert!(row[345..355].iter().all(|&share| share == 0.0));
    }
}
