#![doc = include_str!("../README.md")]
#![warn(missing_docs)]

mod annotate;
mod apng;
mod backend;
mod camera;
mod canvas;
pub mod choice;
mod colormap;
#[cfg(any(test, feature = "conformance"))]
pub mod conformance;
mod error;
mod frame;
pub mod gpu;
mod hits;
mod isosurface;
mod jpeg;
mod known;
mod layer;
mod lettering;
mod look;
mod map;
mod map_marks;
mod mesh;
mod notice;
mod png;
mod points;
mod quality;
mod rays;
mod sampler;
mod scene;
mod seeds;
mod settle;
mod shade;
mod sheet;
mod silhouette;
mod slice;
mod splat;
mod state;
mod surface;
mod trace;
mod window;

pub use annotate::{
    Caption, MIN_ANNOTATED_SIDE, annotate, annotate_slice, edge_letters, mark_sides,
};
pub use apng::AnimatedPng;
pub use backend::{RenderBackend, RenderJob, SizedMesh};
pub use camera::{Camera, NamedView, Projection};
pub use colormap::{ColorMap, label_color};
pub use error::RenderError;
pub use frame::{Frame, FrameSize, MAX_SIDE, PixelFormat, RenderedFrame};
pub use hits::Hits;
pub use isosurface::solid;
pub use jpeg::encode_jpeg;
pub use layer::{
    KeyedLayer, KeyedLayers, Layer, LayerKey, LayerValues, Layers, Overlay, OverlayParameters,
    OverlayStyle,
};
pub use look::{Background, Look};
pub use map::{
    Hemisphere, MAP_MARGIN, MAP_RADIUS_MM, MAP_RIM, MapDisc, MapFace, MapProjection, MapSides,
};
pub use map_marks::{DrawnMap, MapScale, annotate_map};
pub use mesh::{Facets, draw_mesh, mesh_hits};
pub use notice::{RESEARCH_USE_NOTICE, SHORT_NOTICE};
pub use png::encode_png;
pub use quality::draw_quality_sheet;
pub use scene::{RenderParameters, RenderRequest, Scene};
pub use sheet::{Sheet, SheetPlan};
pub use slice::{
    MAX_CONTOURS, Oblique, SliceConvention, SliceParameters, SlicePlane, SliceRequest,
    draw_acquired_slice, draw_slice,
};
pub use splat::{draw_splat, splat_hits};
pub use state::{SOFTWARE, sheet_texts, slice_texts, state_texts};
pub use surface::Wanted;
pub use trace::{draw_trace, trace_hits};
pub use window::{Window, WindowFunction};
