//! Slices of what was acquired, for which a case need not be ready.

use case::CaseId;
use geometry::{BoundingSphere, Volume};
use render::{Layers, SliceConvention, SliceParameters, SlicePlane, SliceRequest, Window};
use serde::{Deserialize, Serialize};

use super::slice::encode_slice;
use super::{
    Numbers, check_annotation, default_side, default_zoom, picture_size, window_of_numbers,
};
use crate::error::Error;

/// A picture of a slice of what was acquired.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::IntoParams), into_params(parameter_in = Query))]
#[serde(deny_unknown_fields)]
pub struct AcquiredQuery {
    /// The LPS coordinate across the plane, in mm; by default the middle of the volume.
    pub position_mm: Option<f64>,
    /// Width in pixels.
    #[serde(default = "default_side")]
    #[cfg_attr(feature = "openapi", param(minimum = 1, maximum = 4096, default = 512))]
    pub width: u32,
    /// Height in pixels.
    #[serde(default = "default_side")]
    #[cfg_attr(feature = "openapi", param(minimum = 1, maximum = 4096, default = 512))]
    pub height: u32,
    /// 1 fits the longest side of the volume into the picture.
    #[serde(default = "default_zoom")]
    #[cfg_attr(feature = "openapi", param(minimum = 0.01, maximum = 100, default = 1))]
    pub zoom: f64,
    /// The shift of the slice to the right and up, in mm: `x,y`.
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "0,0"))]
    pub pan: Option<Numbers<2>>,
    /// Window centre and width, in intensities: `c,w`; by default from the 2nd to the 98th percentile of all voxels.
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "80,120"))]
    pub window: Option<Numbers<2>>,
    /// On which side of axial and coronal slices the patient's left is: at the right (radiological) or at the left.
    #[serde(default, skip_serializing_if = "SliceConvention::is_default")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub convention: SliceConvention,
    /// Whether to draw the label, day and short id of the case, position, window, scale, directions and the notice into
    /// the picture.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", param(default = false))]
    pub annotate: bool,
}

impl AcquiredQuery {
    /// The checked values.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an invalid value.
    pub fn checked(&self) -> Result<CheckedAcquired, Error> {
        check_annotation(self.annotate, [self.width, self.height])?;
        let window = self.window.map(window_of_numbers).transpose()?;
        let usual = Window::between(0.0, 1.0);
        let request = SliceRequest::new(SliceParameters {
            convention: self.convention,
            zoom: self.zoom,
            pan_mm: self.pan.map_or([0.0; 2], |Numbers(pan)| pan),
            size: picture_size(self.width, self.height)?,
            ..SliceParameters::new(
                SlicePlane::Axial,
                self.position_mm.unwrap_or(0.0),
                window.unwrap_or(usual),
            )
        })?;
        Ok(CheckedAcquired {
            position_mm: self.position_mm,
            window,
            request,
        })
    }
}

/// A checked request for a slice of what was acquired.
#[derive(Debug)]
pub struct CheckedAcquired {
    position_mm: Option<f64>,
    window: Option<Window>,
    /// All other values, for the axial plane through the origin.
    request: SliceRequest,
}

impl CheckedAcquired {
    /// Draws the slice of a volume as a PNG; with `named`, annotated.
    ///
    /// # Errors
    /// If the picture cannot be encoded.
    pub fn draw(
        self,
        volume: &Volume,
        case: &CaseId,
        plane: SlicePlane,
        named: Option<&str>,
    ) -> Result<Vec<u8>, Error> {
        let bounds = BoundingSphere::of_grid(volume.grid());
        let position_mm = self.position_mm.unwrap_or_else(|| plane.middle_mm(&bounds));
        let window = self.window.unwrap_or_else(|| {
            let [low, high] = volume.percentiles([0.02, 0.98]);
            Window::between(low, high)
        });
        let request = self.request.shown(plane, position_mm, window);
        let frame = render::draw_acquired_slice(volume, &bounds, &request);
        let projection = request.projection(&bounds);
        let layers = Layers::default();
        encode_slice(frame, &request, &projection, &layers, case, named)
    }
}
