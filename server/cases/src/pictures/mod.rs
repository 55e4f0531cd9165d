//! Pictures of cases: what may be asked for, who draws it, and where.

mod drawing;
mod encoding;
mod graphics;
mod layers;
mod numbers;
mod request;

pub use self::drawing::{DrawnPicture, PictureJob, backend_for};
pub use self::encoding::{EncodedImage, ImageMetadata, annotated, encode};
pub use self::graphics::{GpuUse, Graphics, GraphicsOptions, GraphicsState};
pub use self::layers::{LayerChoice, MAPS_OFF, MapStyle, maps_of};
pub use self::numbers::{NumberList, Numbers};
pub use self::request::{
    MAX_CONTOURS, MAX_PIXELS, MAX_POINTS, PictureRequest, check_annotation, check_count,
    check_depth, check_size, default_count, default_side, default_zoom, picture_size, window_of,
    window_or,
};
