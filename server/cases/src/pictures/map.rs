//! The flat map of a case: which hemispheres it shows from which sides, and of which surfaces.

use case::SurfaceName;
use glam::DVec3;
use render::{Hemisphere, MapDisc, MapFace, MapSides};
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::models::WarmModel;

/// How a picture sees the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Projection))]
#[serde(rename_all = "lowercase")]
pub enum PictureProjection {
    /// From one direction.
    #[default]
    Orthographic,
    /// The flat map.
    Map,
}

impl PictureProjection {
    /// Whether it is that from one direction.
    pub fn is_orthographic(&self) -> bool {
        *self == Self::Orthographic
    }
}

/// The flat map of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MapRequest {
    /// The surface of the outer sides, and the hemispheres that are shown: both, or the only one that it has.
    pub surface: SurfaceName,
    pub sides: MapSides,
}

impl MapRequest {
    /// What the label of a column of a sheet calls it.
    pub(crate) fn title(self) -> String {
        match self.sides {
            MapSides::Outer => "map".to_owned(),
            sides => format!("map, {}", sides.name()),
        }
    }

    fn hemispheres(self) -> &'static [Hemisphere] {
        match self.surface {
            SurfaceName::Whole | SurfaceName::Cerebrum => &Hemisphere::ALL,
            SurfaceName::Left => &[Hemisphere::Left],
            SurfaceName::Right => &[Hemisphere::Right],
        }
    }

    /// The surface of a disc.
    fn surface_of(self, hemisphere: Hemisphere, face: MapFace) -> SurfaceName {
        match (face, hemisphere) {
            (MapFace::Outer, _) => self.surface,
            (MapFace::Inner, Hemisphere::Left) => SurfaceName::Left,
            (MapFace::Inner, Hemisphere::Right) => SurfaceName::Right,
        }
    }

    /// The surfaces that it is made of, each once: the requested one, in which the hemispheres have their centres, and those of the
    /// inner sides.
    pub(crate) fn surfaces(self) -> Vec<SurfaceName> {
        let mut shown = vec![self.surface];
        for &face in self.sides.faces() {
            for &hemisphere in self.hemispheres() {
                let surface = self.surface_of(hemisphere, face);
                if !shown.contains(&surface) {
                    shown.push(surface);
                }
            }
        }
        shown
    }

    /// The discs of the map of the models of [`MapRequest::surfaces`], each with the model that it shows.
    ///
    /// # Errors
    /// If the brain has no voxel on one side of the plane between the hemispheres.
    ///
    /// # Panics
    /// If one of its surfaces is not among the models.
    pub(crate) fn discs(self, models: &[WarmModel]) -> Result<Vec<(MapDisc, WarmModel)>, Error> {
        let model_of = |hemisphere, face| {
            let surface = self.surface_of(hemisphere, face);
            let model = models.iter().find(|model| model.surface() == surface);
            model.expect("the surfaces of the map are loaded")
        };
        let to_the_left = DVec3::from_array(models[0].facts().midsagittal.normal);
        let centre = |hemisphere| models[0].hemisphere_centre(hemisphere);
        let discs = MapDisc::of_map(self.hemispheres(), self.sides, to_the_left, centre);
        let discs = discs.ok_or_else(|| {
            let detail = "is not possible as `map`: all of the brain lies on one side of the plane between the hemispheres";
            Error::out_of_range("projection", detail)
        })?;
        let with_model = |disc: MapDisc| {
            let model = model_of(disc.hemisphere, disc.face);
            (disc, model.clone())
        };
        Ok(discs.into_iter().map(with_model).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inner_sides_are_those_of_the_hemispheres() {
        use SurfaceName::{Cerebrum, Left, Right, Whole};
        for (surface, sides, shown) in [
            (Whole, MapSides::Outer, &[Whole][..]),
            (Whole, MapSides::Inner, &[Whole, Left, Right]),
            (Whole, MapSides::Both, &[Whole, Left, Right]),
            (Cerebrum, MapSides::Both, &[Cerebrum, Left, Right]),
            (Left, MapSides::Both, &[Left]),
            (Right, MapSides::Inner, &[Right]),
        ] {
            let map = MapRequest { surface, sides };
            assert_eq!(map.surfaces(), shown, "{map:?}");
        }
    }
}
