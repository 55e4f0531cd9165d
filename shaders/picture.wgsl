// What every pass is given.
//
// Frame space has x in pixels to the right and y in pixels down, both from the picture's top left corner, and z, the
// height, in voxels of the depth field towards the viewer. Directions in the depth field's voxel space are those of
// the patient, for its grid lies along L, P and S.

struct Picture {
    field_from_frame: mat4x4<f32>,
    volume_from_field: mat4x4<f32>,
    field_from_patient: mat4x4<f32>,
    clip_from_patient: mat4x4<f32>,
    // Voxels along x, y, z of each texture.
    volume_size: vec3<f32>,
    // A stored intensity is scale times texel plus offset.
    stored_scale: f32,
    field_size: vec3<f32>,
    stored_offset: f32,
    towards_viewer: vec3<f32>,
    // Voxels of depth in a texel of 1.
    depth_scale: f32,
    // Where the isosurface may be, in voxels of the depth field.
    box_low: vec3<f32>,
    // Depth of the isosurface, in voxels.
    depth: f32,
    box_high: vec3<f32>,
    voxel_mm: f32,
    sphere_centre: vec3<f32>,
    sphere_radius: f32,
    // Width and height in pixels.
    size: vec2<f32>,
    ambient: f32,
    // Row of the table of colours.
    color_row: u32,
    // The window: (stored - black) * factor + offset is the brightness, 0 to 255.
    window_black: f32,
    window_factor: f32,
    window_offset: f32,
    // The slab: samples along the depth; one for the isosurface alone.
    slab_count: u32,
    slab_first: f32,
    slab_step: f32,
    // Height, in voxels, of what is nearest in clip space, and how far apart there samples of one piece of the surface are.
    clip_reach: f32,
    clip_piece: f32,
    // How much of the smoothed depth there is in the isosurface's: near the envelope, whose voxels would show.
    smooth_share: f32,
    // 1 if the brightness is 255 / (1 + exp(-x)) of the ramp x.
    window_is_sigmoid: u32,
    // Planes in voxel coordinates of the depth field: the distance in mm from where the isosurface becomes unknown, 1e9 for no cut.
    cuts: array<vec4<f32>, 6>,
    overlay_from_field: mat4x4<f32>,
    // Voxels along x, y, z of the overlay.
    overlay_size: vec3<f32>,
    // A value of the overlay is scale times texel plus offset.
    overlay_scale: f32,
    overlay_offset: f32,
    // (value - low) * factor is the number of the overlay's colour, 0 to 255.
    overlay_low: f32,
    overlay_factor: f32,
    // What is at most this is transparent; above it an overlay fades in over 1 / steepness.
    overlay_threshold: f32,
    overlay_steepness: f32,
    // 0 if there is no overlay.
    overlay_opacity: f32,
    overlay_color_row: u32,
    // 1 if the threshold is one of magnitudes.
    overlay_is_diverging: u32,
    // 1 if the volume is a layer: the second part of its texels is then whether they are defined.
    volume_has_gaps: u32,
    // 1 if a position has the value of the overlay's nearest voxel, as labels have.
    overlay_is_nearest: u32,
    // On a disc of the flat map: its centre in pixels, and the part of the radius of the sphere of directions that a pixel is wide, 0
    // elsewhere. The columns of field_from_frame are then the directions to the right, up and towards the viewer, and the middle of
    // the hemisphere.
    map_centre: vec2<f32>,
    map_units_per_pixel: f32,
}

@group(0) @binding(0) var<uniform> picture: Picture;
@group(0) @binding(1) var volume: texture_3d<f32>;
@group(0) @binding(2) var field: texture_3d<f32>;
// The gradient of the smoothed depth at voxel centres, without unit.
@group(0) @binding(3) var normals: texture_3d<f32>;
@group(0) @binding(6) var smoothed: texture_3d<f32>;
@group(0) @binding(4) var colors: texture_2d<f32>;
@group(0) @binding(5) var linear: sampler;
// Of each voxel a value and, as 0 or 1, whether it is defined; of one that is not the value is 0.
@group(0) @binding(7) var overlay: texture_3d<f32>;
