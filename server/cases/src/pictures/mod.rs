//! Pictures of cases: requests, drawing and encoding.

mod acquired;
mod across;
mod depth;
mod drawing;
mod encoding;
mod graphics;
mod layers;
mod map;
mod numbers;
mod plan;
mod request;
mod series;
mod slice;

pub use self::acquired::{AcquiredQuery, CheckedAcquired};
pub use self::depth::{DepthMm, ShownDepth};
pub use self::drawing::{DrawnPicture, PictureJob, backend_for, positions, shown_depth, warm_jobs};
pub use self::encoding::{EncodedImage, ImageMetadata, annotated, encode, marked};
pub use self::graphics::{Graphics, GraphicsState};
pub use self::layers::{
    ChosenLayer, ChosenLayers, LayerChoice, LayerRef, MAPS_OFF, NO_FLAIR, PictureLayers, ready,
    style_of_layer, style_of_map,
};
pub use self::map::{MapRequest, PictureProjection};
pub use self::numbers::{NumberList, Numbers};
pub use self::plan::{Layout, MAX_PICTURES, Part, PicturePlan, PlanError, Sweep, Swivel};
pub use self::request::{
    CheckedPicture, MAX_CONTOURS, MAX_PIXELS, MAX_POINTS, PictureRequest, check_count,
    default_count, default_picture_count, mesh_size, surface_version, window_of,
};
use self::request::{
    check_annotation, default_side, default_zoom, picture_size, window_of_numbers,
};
pub use self::series::{PictureSeries, SeriesPicture};
pub use self::slice::{CheckedSlice, DrawnSlice, PlaneFacts, SliceKind, SlicePicture, SliceQuery};
