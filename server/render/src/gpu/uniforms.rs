//! Computes the uniforms of the shaders from a scene and a request.

use glam::{DAffine3, DMat4, DVec3};

use super::case::CaseMaps;
use super::layer::LayerTexture;
use super::layout::Picture;
use crate::isosurface::smooth_share;
use crate::known::{CutPlane, MOST_CUTS, cut_planes};
use crate::layer::OverlayRamp;
use crate::rays::single;
use crate::shade::{slab_offsets, texture_rescale};
use crate::{ColorMap, MapProjection, RenderRequest, Scene};

/// How far the isosurface may lie outside the bounding ball and box shrunk by its depth, in voxels.
///
/// Near each of its points, at most one voxel away along each axis, is a voxel at least as deep. That voxel is at least
/// its own depth inside the box, but for one voxel, and inside the ball, but for one voxel more, because the border
/// voxel lies beside the line from the centre. The smoothed field differs by less than a voxel.
const BOX_MARGIN: f64 = 2.01;
const BALL_MARGIN: f64 = 4.0;

/// How far the mesh may lie outside the ball around the envelope, in voxels.
const CLIP_MARGIN: f64 = 4.0;

/// The greatest difference of depth, in pixels, between the samples of one piece of the surface in a pixel: a face at a
/// steep angle.
const PIECE_PIXELS: f64 = 8.0;

/// The layers of a picture, on the device.
pub(super) struct LayerTextures {
    pub(super) base: Option<LayerTexture>,
    pub(super) overlay: Option<LayerTexture>,
}

/// The uniforms of a picture.
pub(super) fn picture(
    scene: &Scene<'_>,
    request: &RenderRequest,
    maps: &CaseMaps,
    layers: &LayerTextures,
) -> Picture {
    let parameters = request.parameters();
    let projection = parameters.camera.projection(&scene.bounds, parameters.size);
    let map = request.map_projection();
    let field_grid = scene.field.grid();
    let voxel_mm = field_grid.spacing_mm()[0];
    let field_from_patient = field_grid.voxel_from_patient();
    let heights_in_voxels = DAffine3::from_scale(DVec3::new(1.0, 1.0, voxel_mm));
    let depth = parameters.depth_mm / voxel_mm;
    let reach_mm = scene.bounds.radius_mm + CLIP_MARGIN * voxel_mm;
    let window = parameters.window.line(texture_rescale(scene));
    let slab = slab_offsets(parameters.look.slab_mm, parameters.depth_mm, scene.volume);
    let size = [parameters.size.width(), parameters.size.height()].map(f64::from);
    let patient_from_field = field_grid.patient_from_voxel();
    let base = layers.base.as_ref();
    let overlay = layers.overlay.as_ref();
    let style = scene.layers.overlay.map(|overlay| overlay.style);
    let ramp = style.map(|style| style.ramp());
    let of_ramp = |number: fn(&OverlayRamp) -> f32| ramp.as_ref().map_or(0.0, number);
    Picture {
        field_from_frame: columns(match &map {
            Some(map) => field_from_disc(field_from_patient, map, voxel_mm),
            None => field_from_patient * projection.patient_from_frame() * heights_in_voxels,
        }),
        volume_from_field: columns(match base {
            Some(base) => base.voxel_from_case * patient_from_field,
            None => volume_from_field(scene, maps),
        }),
        field_from_patient: columns(field_from_patient),
        clip_from_patient: columns(
            clip_from_frame(size, reach_mm) * projection.frame_from_patient(),
        ),
        volume_size: base
            .map_or(maps.volume_size, |base| base.size)
            .map(|side| side as f32),
        stored_scale: base.map_or(maps.texels.stored_scale(), |base| base.scale),
        field_size: field_grid.size().map(|side| side as f32),
        stored_offset: base.map_or(maps.stored_offset.into(), |base| base.offset),
        towards_viewer: single(projection.towards_viewer_in_patient()),
        depth_scale: maps.texels.depth_scale(),
        box_low: single(maps.envelope_in_field[0] + (depth - BOX_MARGIN)),
        depth: depth as f32,
        box_high: single(maps.envelope_in_field[1] - (depth - BOX_MARGIN)),
        voxel_mm: voxel_mm as f32,
        sphere_centre: single(field_from_patient.transform_point3(scene.bounds.centre_in_patient)),
        sphere_radius: (scene.bounds.radius_mm / voxel_mm - depth + BALL_MARGIN) as f32,
        size: size.map(|side| side as f32),
        ambient: parameters.look.ambient as f32,
        color_row: color_row(parameters.look.colormap),
        window_black: window.black,
        window_factor: window.factor,
        window_offset: window.offset,
        slab_count: slab.len().max(1) as u32,
        slab_first: slab.first().copied().unwrap_or_default(),
        slab_step: slab.get(1).map_or(0.0, |second| second - slab[0]),
        clip_reach: (reach_mm / voxel_mm) as f32,
        smooth_share: smooth_share(depth as f32),
        window_is_sigmoid: u32::from(window.is_sigmoid),
        cuts: cuts(scene, parameters.depth_mm),
        overlay_from_field: columns(overlay.map_or(DAffine3::IDENTITY, |overlay| {
            overlay.voxel_from_case * patient_from_field
        })),
        overlay_size: overlay
            .map_or([1; 3], |overlay| overlay.size)
            .map(|side| side as f32),
        overlay_scale: overlay.map_or(0.0, |overlay| overlay.scale),
        overlay_offset: overlay.map_or(0.0, |overlay| overlay.offset),
        overlay_low: of_ramp(|ramp| ramp.low),
        overlay_factor: of_ramp(|ramp| ramp.factor),
        overlay_threshold: of_ramp(|ramp| ramp.threshold),
        overlay_steepness: of_ramp(|ramp| ramp.steepness),
        overlay_opacity: of_ramp(|ramp| ramp.opacity),
        overlay_color_row: style.map_or(0, |style| color_row(style.parameters().colormap)),
        overlay_is_diverging: u32::from(ramp.is_some_and(|ramp| ramp.is_diverging)),
        volume_has_gaps: u32::from(base.is_some()),
        overlay_is_nearest: u32::from(overlay.is_some_and(|overlay| overlay.is_nearest)),
        map_centre: map.map_or([0.0; 2], |map| map.centre().map(|place| place as f32)),
        map_units_per_pixel: map.map_or(0.0, |map| map.units_per_pixel() as f32),
        clip_piece: (PIECE_PIXELS * projection.mm_per_pixel() / (2.0 * reach_mm)) as f32,
        _padding_0: Default::default(),
        _padding_1: Default::default(),
    }
}

/// The directions of a disc to the right, up and towards the viewer, a working voxel long, and the middle of its hemisphere.
fn field_from_disc(field_from_patient: DAffine3, map: &MapProjection, voxel_mm: f64) -> DAffine3 {
    DAffine3 {
        matrix3: field_from_patient.matrix3 * map.axes() * voxel_mm,
        translation: field_from_patient.transform_point3(map.centre_in_patient()),
    }
}

/// The planes beyond which the isosurface is unknown, and planes beyond which nothing is.
fn cuts(scene: &Scene<'_>, depth_mm: f64) -> [CutPlane; MOST_CUTS] {
    const FAR: CutPlane = [0.0, 0.0, 0.0, 1e9];
    let planes = cut_planes(scene.field, depth_mm);
    std::array::from_fn(|index| planes.get(index).copied().unwrap_or(FAR))
}

/// From voxel coordinates of the depth field to texels of the volume's texture.
fn volume_from_field(scene: &Scene<'_>, maps: &CaseMaps) -> DAffine3 {
    let native_from_field =
        scene.volume.grid().voxel_from_patient() * scene.field.grid().patient_from_voxel();
    // The centre of a block of n voxels is (n − 1)/2 voxels after the centre of its first voxel.
    let block = DVec3::from(maps.reduction.map(|voxels| voxels as f64));
    let texel_from_native = DAffine3::from_scale(block.recip())
        * DAffine3::from_translation((DVec3::ONE - block) / 2.0);
    texel_from_native * native_from_field
}

/// From the frame to the clip space of WebGPU: x and y within ±1, y up, z 0 at the height `reach_mm` and 1 at minus
/// that.
fn clip_from_frame([width, height]: [f64; 2], reach_mm: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(-1.0, 1.0, 0.5))
        * DAffine3::from_scale(DVec3::new(2.0 / width, -2.0 / height, -0.5 / reach_mm))
}

/// The row of a colour map in the table of colours.
fn color_row(colormap: ColorMap) -> u32 {
    let row = ColorMap::ALL.into_iter().position(|map| map == colormap);
    row.unwrap_or_default() as u32
}

fn columns(affine: DAffine3) -> [[f32; 4]; 4] {
    DMat4::from(affine)
        .to_cols_array_2d()
        .map(|column| column.map(|entry| entry as f32))
}
