//! The head light.

use crate::RenderError;
use crate::error::checked;

/// A light that shines from the viewer: `ambient + (1 − ambient) · max(0, n · v)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    ambient: f32,
}

impl Light {
    /// A light with the ambient fraction `ambient`, 0 to 1; 1 turns the shading off.
    ///
    /// # Errors
    /// If `ambient` is not in 0..=1.
    pub fn new(ambient: f64) -> Result<Self, RenderError> {
        let ambient = checked("ambient", ambient, 0.0..=1.0, "within 0 to 1")? as f32;
        Ok(Self { ambient })
    }

    /// The ambient fraction.
    pub fn ambient(self) -> f32 {
        self.ambient
    }

    /// Brightness, 0 to 1, of a face whose outward normal has the cosine `facing` with the direction to the viewer.
    #[inline]
    pub fn on(self, facing: f32) -> f32 {
        self.ambient + (1.0 - self.ambient) * facing.clamp(0.0, 1.0)
    }
}

impl Default for Light {
    /// 0.3 ambient: shapes are visible, and no gyrus is too dark.
    fn default() -> Self {
        Self { ambient: 0.3 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_face_is_lit_by_its_cosine() {
        let light = Light::new(0.25).unwrap();
        assert_eq!(light.on(1.0), 1.0);
        assert_eq!(light.on(0.5), 0.625);
        assert_eq!(light.on(-0.5), 0.25);
        assert_eq!(Light::new(1.0).unwrap().on(0.1), 1.0);
    }

    #[test]
    fn ambient_is_a_share() {
        for ambient in [-0.1, 1.1, f64::NAN] {
            assert!(Light::new(ambient).is_err());
        }
    }
}
