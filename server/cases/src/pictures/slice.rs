//! Pictures of slices with the contours of isosurfaces.

use case::{CaseFacts, CaseId, MapName, SurfaceName};
use geometry::DeformableModel;
use glam::DVec3;
use render::{
    ColorMap, Frame, KeyedLayers, Layer, Layers, Oblique, Projection, Scene, SliceConvention,
    SliceParameters, SlicePlane, SliceRequest, Window,
};
use serde::{Deserialize, Serialize};

use super::across::{Across, across_the_sulcus};
use super::{
    ChosenLayers, DepthMm, LayerChoice, LayerRef, NumberList, Numbers, PictureLayers,
    check_annotation, default_side, default_zoom, picture_size, surface_version, window_of,
    window_of_numbers,
};
use crate::Cases;
use crate::error::Error;

/// A picture of a slice.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::IntoParams), into_params(parameter_in = Query))]
#[serde(default, deny_unknown_fields)]
pub struct SliceQuery {
    /// The LPS coordinate across the plane, in mm; by default the middle of the grid. Not for `oblique`.
    pub position_mm: Option<f64>,
    /// A point of an oblique plane (LPS mm), which is shown in the middle: `x,y,z`. Required for `oblique`, and only for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "-38,-20,30"))]
    pub position: Option<Numbers<3>>,
    /// The direction across an oblique plane (LPS): `x,y,z`. By default the plane is the one across the sulcus: it holds the normal
    /// of the surface below the envelope and the steepest direction of the map `blur`; of the intensities if the case has no maps.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "0,1,0"))]
    pub normal: Option<Numbers<3>>,
    /// Turns the plane across the sulcus about the normal of the surface, in degrees. Not with `normal`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turn_deg: Option<f64>,
    /// The surface below which depths are measured. `left` and `right` are the halves of the cerebrum, closed along the falx;
    /// `cerebrum` is without cerebellum and brain stem. There are no contours where a fence is nearer than the dura.
    #[serde(skip_serializing_if = "SurfaceName::is_whole")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub surface: SurfaceName,
    /// Depths in mm of the contours: at most 16, separated by commas.
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "5,10"))]
    pub depth_mm: NumberList,
    /// Width in pixels.
    #[cfg_attr(feature = "openapi", param(minimum = 1, maximum = 4096, default = 512))]
    pub width: u32,
    /// Height in pixels.
    #[cfg_attr(feature = "openapi", param(minimum = 1, maximum = 4096, default = 512))]
    pub height: u32,
    /// 1 shows the slice at the scale of a render.
    #[cfg_attr(feature = "openapi", param(minimum = 0.01, maximum = 100, default = 1))]
    pub zoom: f64,
    /// The shift of the slice to the right and up, in mm: `x,y`.
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "0,0"))]
    pub pan: Option<Numbers<2>>,
    /// Window centre and width, in intensities: `c,w`; by default from the case. As in DICOM (LINEAR), the ramp from
    /// black to white is `w - 1` long and its middle is `c - 0.5`: 0 is black and 0.25 white in `0.625,1.25`. The width
    /// is at least 1.
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "80,120"))]
    pub window: Option<Numbers<2>>,
    /// The colour map.
    #[cfg_attr(feature = "openapi", param(inline))]
    pub colormap: ColorMap,
    /// On which side of axial and coronal slices the patient's left is: at the right (radiological) or at the left.
    #[serde(skip_serializing_if = "SliceConvention::is_default")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub convention: SliceConvention,
    /// Whether to draw the label, day and short id of the case, position, window, scale, depths of the contours,
    /// directions and the notice into the picture.
    #[cfg_attr(feature = "openapi", param(default = false))]
    pub annotate: bool,
    /// The layer to show instead of the intensities: the name of a map, or the name or id of an added layer. `window`
    /// then refers to its values.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "FLAIR"))]
    pub layer: Option<LayerRef>,
    /// The layer to show in colours over the grey texture: the name of a map, or the name or id of an added layer.
    /// Undefined parts are transparent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "blur"))]
    pub overlay: Option<LayerRef>,
    /// The values of the first and last colour of the overlay: `low,high`; by default from the layer.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(value_type = Option<String>, example = "2.5,5"))]
    pub overlay_window: Option<Numbers<2>>,
    /// The colours of the overlay; by default from the layer.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(inline))]
    pub overlay_colormap: Option<ColorMap>,
    /// Values of the overlay up to this are transparent; for diverging colours, magnitudes. Above it, the overlay fades
    /// in over a tenth of its window. By default from the layer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overlay_threshold: Option<f64>,
    /// The opacity of the overlay, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", param(minimum = 0, maximum = 1))]
    pub overlay_opacity: Option<f64>,
    /// Whether the overlay is drawn as its edges alone: lines where its values rise steepest within its window. Its
    /// colours, threshold and opacity do not matter then. A label map has no edges.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    #[cfg_attr(feature = "openapi", param(default = false))]
    pub edges: bool,
}

impl Default for SliceQuery {
    fn default() -> Self {
        Self {
            position_mm: None,
            position: None,
            normal: None,
            turn_deg: None,
            surface: SurfaceName::default(),
            depth_mm: NumberList::default(),
            width: default_side(),
            height: default_side(),
            zoom: default_zoom(),
            pan: None,
            window: None,
            colormap: ColorMap::default(),
            convention: SliceConvention::default(),
            annotate: false,
            layer: None,
            overlay: None,
            overlay_window: None,
            overlay_colormap: None,
            overlay_threshold: None,
            overlay_opacity: None,
            edges: false,
        }
    }
}

impl SliceQuery {
    fn layers(&self) -> LayerChoice {
        LayerChoice {
            layer: self.layer.clone(),
            overlay: self.overlay.clone(),
            overlay_window: self.overlay_window,
            overlay_colormap: self.overlay_colormap,
            overlay_threshold: self.overlay_threshold,
            overlay_opacity: self.overlay_opacity,
        }
    }

    /// The checked values.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an invalid value.
    pub fn checked(&self) -> Result<CheckedSlice, Error> {
        if self.position_mm.is_some_and(|mm| !mm.is_finite()) {
            let detail = "must be a finite number of mm";
            return Err(Error::out_of_range("position_mm", detail));
        }
        for &depth_mm in &self.depth_mm.0 {
            DepthMm::check_sign(depth_mm)?;
        }
        let oblique = self.oblique()?;
        check_annotation(self.annotate, [self.width, self.height])?;
        self.layers().check()?;
        if self.edges && self.overlay.is_none() {
            return Err(Error::out_of_range("edges", "needs `overlay`"));
        }
        let window = self.window.map(window_of_numbers).transpose()?;
        let request = SliceRequest::new(SliceParameters {
            plane: SlicePlane::Axial,
            convention: self.convention,
            position_mm: self.position_mm.unwrap_or(0.0),
            oblique: None,
            depths_mm: self.depth_mm.0.clone(),
            zoom: self.zoom,
            pan_mm: self.pan.map_or([0.0; 2], |Numbers(pan)| pan),
            size: picture_size(self.width, self.height)?,
            window: window.unwrap_or_else(|| Window::between(0.0, 1.0)),
            colormap: self.colormap,
            has_edges: self.edges,
        })?;
        Ok(CheckedSlice {
            asked: self.clone(),
            oblique,
            window,
            request,
        })
    }

    /// The oblique plane; `None` if none is described.
    fn oblique(&self) -> Result<Option<ObliquePlane>, Error> {
        let turn_deg = self.turn_deg.unwrap_or(0.0);
        if !turn_deg.is_finite() {
            return Err(Error::out_of_range(
                "turn_deg",
                "must be a finite number of degrees",
            ));
        }
        let Some(Numbers(position)) = self.position else {
            return match (self.normal, self.turn_deg) {
                (None, None) => Ok(None),
                (Some(_), _) => Err(Error::out_of_range("normal", "needs `position`")),
                (None, Some(_)) => Err(Error::out_of_range("turn_deg", "needs `position`")),
            };
        };
        // Any normal will do to check the position.
        let normal = self
            .normal
            .map_or([1.0, 0.0, 0.0], |Numbers(normal)| normal);
        let plane = Oblique::new(position, normal)?;
        Ok(Some(match (self.normal, self.turn_deg) {
            (Some(_), None) => ObliquePlane::Given(plane),
            (Some(_), Some(_)) => {
                let detail = "turns the plane across the sulcus; omit it or `normal`";
                return Err(Error::out_of_range("turn_deg", detail));
            }
            (None, _) => ObliquePlane::AcrossTheSulcus {
                position: plane.centre_in_patient(),
                turn_deg,
            },
        }))
    }
}

/// A plane in any direction.
#[derive(Debug, Clone, Copy)]
enum ObliquePlane {
    Given(Oblique),
    AcrossTheSulcus { position: DVec3, turn_deg: f64 },
}

/// Which slice is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SliceKind {
    /// Across an axis of the patient.
    Standard(SlicePlane),
    Oblique,
}

impl SliceKind {
    /// The name in the interfaces.
    pub fn name(self) -> &'static str {
        match self {
            Self::Standard(plane) => plane.name(),
            Self::Oblique => "oblique",
        }
    }
}

impl std::str::FromStr for SliceKind {
    type Err = render::RenderError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        match name {
            "oblique" => Ok(Self::Oblique),
            name => name.parse().map(Self::Standard),
        }
    }
}

/// A checked request for a slice of any case.
#[derive(Debug, Clone)]
pub struct CheckedSlice {
    pub asked: SliceQuery,
    /// The oblique plane, if it is one.
    oblique: Option<ObliquePlane>,
    /// The window; by default from the layer or the case.
    window: Option<Window>,
    /// All other values, for the axial plane through the origin.
    request: SliceRequest,
}

impl CheckedSlice {
    /// Whether the keys are those of a kind of slice.
    fn check_kind(&self, kind: SliceKind) -> Result<(), Error> {
        let refused = |name, detail: &str| Err(Error::out_of_range(name, detail));
        match kind {
            SliceKind::Standard(_) if self.oblique.is_some() => refused(
                "position",
                "is accepted for `oblique` only; set `position_mm`",
            ),
            SliceKind::Oblique if self.oblique.is_none() => refused(
                "position",
                "is required for `oblique`: LPS coordinates in mm",
            ),
            SliceKind::Oblique if self.asked.position_mm.is_some() => refused(
                "position_mm",
                "is not accepted for `oblique`; set `position`",
            ),
            _ => Ok(()),
        }
    }

    /// The slice of a case, and about what its plane is turned.
    fn of_case(
        &self,
        kind: SliceKind,
        facts: &CaseFacts,
        layers: &PictureLayers,
        steepness: Option<&Layer>,
        model: &DeformableModel,
    ) -> (SliceRequest, Option<DVec3>) {
        let plane = match kind {
            SliceKind::Standard(plane) => plane,
            SliceKind::Oblique => SlicePlane::Axial,
        };
        let middle_mm = || middle_mm(facts, plane.axis());
        let position_mm = self.asked.position_mm.unwrap_or_else(middle_mm);
        let usual = || layers.window.unwrap_or_else(|| window_of(facts));
        let window = self.window.unwrap_or_else(usual);
        let request = self.request.clone().shown(plane, position_mm, window);
        match self.oblique {
            None => (request, None),
            Some(ObliquePlane::Given(oblique)) => (request.across(oblique), None),
            Some(ObliquePlane::AcrossTheSulcus { position, turn_deg }) => {
                let Across { plane, outwards } =
                    across_the_sulcus(model, steepness, position, turn_deg);
                (request.across(plane), Some(outwards))
            }
        }
    }
}

/// The map whose steepest direction a plane holds, and its version; `None` if the case has no maps.
async fn steepness(cases: &Cases, id: &CaseId) -> Result<Option<(KeyedLayers, String)>, Error> {
    let blur = LayerChoice {
        layer: Some(LayerRef::from(MapName::Blur)),
        ..LayerChoice::default()
    };
    // A case that is not there has no maps either, and never will.
    cases.ready(id).await?;
    let chosen = blur.of_case(&cases.library, id).await?;
    match chosen.load(&cases.library, id).await {
        Ok(layers) => Ok(Some((layers.keyed, chosen.version().unwrap_or_default()))),
        Err(Error::MapsUndefined(_)) => Ok(None),
        Err(other) => Err(other),
    }
}

/// The coordinate of the middle of the working grid along a patient axis.
fn middle_mm(facts: &CaseFacts, axis: usize) -> f64 {
    let row = facts.patient_from_voxel[axis];
    let centres = facts.grid_size.map(|side| (side - 1) as f64 / 2.0);
    row[0] * centres[0] + row[1] * centres[1] + row[2] * centres[2] + row[3]
}

/// A slice of one case, with its layers.
#[derive(Debug)]
pub struct SlicePicture {
    id: CaseId,
    kind: SliceKind,
    slice: CheckedSlice,
    layers: ChosenLayers,
    /// The map whose steepest direction the plane holds, if that is not given.
    steepness: Option<(KeyedLayers, String)>,
    /// What is written of the case into the picture, if it is annotated.
    identity: Option<String>,
}

#[derive(Debug)]
pub struct DrawnSlice {
    pub png: Vec<u8>,
    pub projection: Projection,
    /// Its plane, if that is oblique.
    pub oblique: Option<Oblique>,
    /// The direction about which that plane is turned, if it is the one across the sulcus.
    turned_about: Option<DVec3>,
    /// On which side the patient's left is.
    convention: SliceConvention,
}

/// How an oblique plane lies in the patient.
#[derive(Debug, Clone, Serialize)]
pub struct PlaneFacts {
    /// The rotation from patient to view space, as a quaternion `x, y, z, w`.
    orientation: [f64; 4],
    /// The direction outwards about which `turn_deg` turns the plane (LPS).
    #[serde(skip_serializing_if = "Option::is_none")]
    turned_about: Option<[f64; 3]>,
    /// The nearest standard plane and by how many degrees it is turned: `cor > sag 32 > ax 10`.
    angles: String,
}

impl DrawnSlice {
    /// How its plane lies in the patient, if that is oblique.
    pub fn plane(&self) -> Option<PlaneFacts> {
        let oblique = self.oblique?;
        Some(PlaneFacts {
            orientation: oblique.orientation(self.convention).to_array(),
            turned_about: self.turned_about.map(|about| about.to_array()),
            // Headers are ASCII.
            angles: oblique.angles().replace('°', ""),
        })
    }
}

impl SlicePicture {
    /// Finds the layers of a slice of a case.
    ///
    /// # Errors
    /// [`Error::NoSuchLayer`], those of layers that are not ready, [`Error::Parameter`] for the edges of a label map, or an
    /// error of the store.
    pub async fn of(
        cases: &Cases,
        id: &CaseId,
        kind: SliceKind,
        slice: CheckedSlice,
    ) -> Result<Self, Error> {
        slice.check_kind(kind)?;
        let layers = slice.asked.layers().of_case(&cases.library, id).await?;
        if slice.asked.edges && layers.has_labels_above() {
            let detail = "is not possible for a label map, because labels have no edges; choose another `overlay`";
            return Err(Error::out_of_range("edges", detail));
        }
        let steepness = match slice.oblique {
            Some(ObliquePlane::AcrossTheSulcus { .. }) => steepness(cases, id).await?,
            Some(ObliquePlane::Given(_)) | None => None,
        };
        Ok(Self {
            identity: cases.identity(id, slice.asked.annotate).await?,
            id: *id,
            kind,
            slice,
            layers,
            steepness,
        })
    }

    /// What is written of the case into the picture; `None` if it is not annotated.
    pub fn identity(&self) -> Option<&str> {
        self.identity.as_deref()
    }

    /// The versions of the layers and of a part's surface; `None` if there are none.
    pub fn version(&self) -> Option<String> {
        let steepness = self.steepness.as_ref().map(|(_, version)| version.clone());
        let surface = surface_version(self.slice.asked.surface);
        let versions = self.layers.version().into_iter();
        let versions: Vec<_> = versions.chain(steepness).chain(surface).collect();
        (!versions.is_empty()).then(|| versions.join(", "))
    }

    /// Draws it.
    ///
    /// # Errors
    /// As [`Cases::surface`]; [`Error::Busy`] if too much work waits; those of the layers.
    pub async fn draw(self, cases: &Cases) -> Result<DrawnSlice, Error> {
        let facts = cases.ready(&self.id).await?;
        let layers = self.layers.load(&cases.library, &self.id).await?;
        let whole = cases.model(&self.id).await?;
        let model = cases.surface(&self.id, self.slice.asked.surface).await?;
        let steepness = self
            .steepness
            .as_ref()
            .and_then(|(map, _)| map.layers().base);
        let (request, turned_about) =
            (self.slice).of_case(self.kind, &facts, &layers, steepness, model.model());
        let layers = layers.keyed;
        let volume = cases.whole_volume(&self.id).await?;
        let draw = move || {
            let scene = Scene {
                volume: &volume,
                // A slice shows the whole head, whichever surface has its contours.
                bounds: whole.scene().bounds,
                ..model.scene().with_layers(layers.layers())
            };
            let frame = render::draw_slice(&scene, &request);
            let projection = request.projection(&scene.bounds);
            let (layers, named) = (&scene.layers, self.identity.as_deref());
            let png = encode_slice(frame, &request, &projection, layers, &self.id, named)?;
            Ok(DrawnSlice {
                png,
                projection,
                oblique: request.parameters().oblique,
                turned_about,
                convention: request.parameters().convention,
            })
        };
        cases.queue.run(draw).await?
    }
}

/// The file of a slice; with the line about its case, annotated.
///
/// # Errors
/// If it cannot be encoded.
pub(super) fn encode_slice(
    frame: Frame,
    request: &SliceRequest,
    projection: &Projection,
    layers: &Layers<'_>,
    id: &CaseId,
    identity: Option<&str>,
) -> Result<Vec<u8>, Error> {
    let frame = match identity {
        Some(_) => render::annotate_slice(frame, request, projection, layers, identity),
        None => frame,
    };
    let mut texts = render::slice_texts(&id.to_string(), request, layers);
    texts.retain(|(_, text)| !text.is_empty());
    Ok(render::encode_png(&frame, &texts)?)
}
