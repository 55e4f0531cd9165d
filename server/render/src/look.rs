//! What a picture of a surface looks like.

use crate::error::checked;
use crate::{ColorMap, RenderError};

/// What a picture of a surface looks like, whatever it shows: each key with its unit, range and default. The window stands beside it,
/// because its default depends on the case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// The colour map.
    pub colormap: ColorMap,
    /// Intensities are averaged over this depth to either side of the isosurface, 0 to 20 mm, but never beyond the
    /// envelope.
    pub slab_mm: f64,
    /// The fraction of ambient light, 0 to 1; 1 turns the shading off.
    pub ambient: f64,
    /// The background.
    pub background: Background,
}

/// The background.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Background {
    /// Opaque black.
    #[default]
    Black,
    /// Nothing: alpha 0.
    Transparent,
}

impl Default for Look {
    /// Grey on black, not averaged, and so lit that shapes are visible and no gyrus is too dark.
    fn default() -> Self {
        Self {
            colormap: ColorMap::Grey,
            slab_mm: 0.0,
            ambient: f64::from(0.3_f32),
            background: Background::Black,
        }
    }
}

impl From<Background> for Look {
    /// The default on this background.
    fn from(background: Background) -> Self {
        Self {
            background,
            ..Self::default()
        }
    }
}

impl Look {
    /// The same, if its numbers are in their ranges.
    ///
    /// # Errors
    /// If `ambient` is not in 0..=1 or `slab_mm` not in 0..=20.
    pub fn checked(self) -> Result<Self, RenderError> {
        checked("ambient", self.ambient, 0.0..=1.0, "within 0 to 1")?;
        checked("slab_mm", self.slab_mm, 0.0..=20.0, "within 0 to 20")?;
        Ok(self)
    }

    /// Brightness, 0 to 1, of a face whose outward normal has the cosine `facing` with the direction to the viewer, from where the
    /// light shines: twin of `light_on` in `light.wgsl`.
    #[inline]
    pub(crate) fn light_on(&self, facing: f32) -> f32 {
        let ambient = self.ambient as f32;
        ambient + (1.0 - ambient) * facing.clamp(0.0, 1.0)
    }

    /// The values in words, for the description of how pixels were made.
    pub fn words(&self) -> String {
        format!(
            "colours {}, mean over {} mm to either side, ambient light {}",
            self.colormap.name(),
            self.slab_mm,
            self.ambient as f32
        )
    }

    /// The values under the keys of a request, for the file of a picture.
    pub(crate) fn texts(&self) -> [(&'static str, String); 4] {
        let background = match self.background {
            Background::Black => "black",
            Background::Transparent => "transparent",
        };
        [
            ("colormap", self.colormap.name().to_owned()),
            ("slab_mm", self.slab_mm.to_string()),
            ("ambient", (self.ambient as f32).to_string()),
            ("background", background.to_owned()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lit(ambient: f64) -> Look {
        Look {
            ambient,
            ..Look::default()
        }
    }

    #[test]
    fn a_face_is_lit_by_its_cosine() {
        let look = lit(0.25);
        assert_eq!(look.light_on(1.0), 1.0);
        assert_eq!(look.light_on(0.5), 0.625);
        assert_eq!(look.light_on(-0.5), 0.25);
        assert_eq!(lit(1.0).light_on(0.1), 1.0);
    }

    #[test]
    fn numbers_beyond_their_ranges_are_refused() {
        for ambient in [-0.1, 1.1, f64::NAN] {
            assert!(lit(ambient).checked().is_err());
        }
        for slab_mm in [-0.5, 21.0, f64::NAN] {
            let look = Look {
                slab_mm,
                ..Look::default()
            };
            assert!(look.checked().is_err());
        }
    }
}
