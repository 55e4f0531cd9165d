//! The Rust twins of the shaders' structs, which `cargo run -p shader-translate` writes.

use bytemuck::{Pod, Zeroable};

/// Twin of `Picture` in `picture.wgsl`, which describes each field. Matrices are column by column.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(super) struct Picture {
    pub(super) field_from_frame: [[f32; 4]; 4],
    pub(super) volume_from_field: [[f32; 4]; 4],
    pub(super) field_from_patient: [[f32; 4]; 4],
    pub(super) clip_from_patient: [[f32; 4]; 4],
    pub(super) volume_size: [f32; 3],
    pub(super) stored_scale: f32,
    pub(super) field_size: [f32; 3],
    pub(super) stored_offset: f32,
    pub(super) towards_viewer: [f32; 3],
    pub(super) depth_scale: f32,
    pub(super) box_low: [f32; 3],
    pub(super) depth: f32,
    pub(super) box_high: [f32; 3],
    pub(super) voxel_mm: f32,
    pub(super) sphere_centre: [f32; 3],
    pub(super) sphere_radius: f32,
    pub(super) size: [f32; 2],
    pub(super) ambient: f32,
    pub(super) color_row: u32,
    pub(super) window_black: f32,
    pub(super) window_factor: f32,
    pub(super) window_offset: f32,
    pub(super) slab_count: u32,
    pub(super) slab_first: f32,
    pub(super) slab_step: f32,
    pub(super) clip_reach: f32,
    pub(super) clip_piece: f32,
    pub(super) smooth_share: f32,
    pub(super) window_is_sigmoid: u32,
    pub(super) _padding_0: [u32; 2],
    pub(super) cuts: [[f32; 4]; 6],
    pub(super) overlay_from_field: [[f32; 4]; 4],
    pub(super) overlay_size: [f32; 3],
    pub(super) overlay_scale: f32,
    pub(super) overlay_offset: f32,
    pub(super) overlay_low: f32,
    pub(super) overlay_factor: f32,
    pub(super) overlay_threshold: f32,
    pub(super) overlay_steepness: f32,
    pub(super) overlay_opacity: f32,
    pub(super) overlay_color_row: u32,
    pub(super) overlay_is_diverging: u32,
    pub(super) volume_has_gaps: u32,
    pub(super) overlay_is_nearest: u32,
    pub(super) map_centre: [f32; 2],
    pub(super) map_units_per_pixel: f32,
    pub(super) _padding_1: [u32; 3],
}

/// Twin of `Paths` in `shrink.wgsl`, which describes each field. Matrices are column by column.
#[cfg(test)]
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(super) struct Paths {
    pub(super) origin_in_patient: [f32; 3],
    pub(super) step_mm: f32,
    pub(super) depth_mm: f32,
    pub(super) row_mm: f32,
    pub(super) row: u32,
    pub(super) vertex_count: u32,
    pub(super) first_piece: u32,
    pub(super) piece_count: u32,
    pub(super) _padding_0: [u32; 2],
}
