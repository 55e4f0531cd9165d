//! The shaders' text, put together from the files of the folder `shaders/`.

macro_rules! wgsl {
    ($($name:literal),+) => {
        concat!($(include_str!(concat!("../../../../shaders/", $name, ".wgsl")), "\n"),+)
    };
}

/// The same after all that shades a point of a surface.
macro_rules! shaded {
    ($($name:literal),+) => {
        wgsl!("picture", "trilinear", "gradient", "window", "colormap", "light", "shade", $($name),+)
    };
}

/// The mesh from plain vertices: `mesh_vertex`, `mesh_shaded`, `mesh_height`.
pub(super) const MESH: &str = shaded!("mesh");

/// The mesh's vertices from the table of all depths: `shrunk_vertex`. The page draws with them.
#[cfg(test)]
pub(super) const SHRINK: &str = wgsl!("picture", "trilinear", "gradient", "shrink");

/// The same beside the entry points of [`MESH`], for a test to draw with.
#[cfg(test)]
pub(super) const SHRUNK_MESH: &str = shaded!("mesh", "shrink");

/// The isosurface itself: `screen_vertex`, `trace_shaded`, `trace_height`.
pub(super) const TRACE: &str = shaded!("sight", "trace");

/// The mesh from its depth buffer: `screen_vertex`, `mesh_resolved`.
pub(super) const RESOLVE: &str = shaded!("sight", "resolve", "multisampled");

/// The mesh from a depth buffer of the pane's own size or twice that: `screen_vertex`, `mesh_reduced`. The page draws with it.
#[cfg(test)]
pub(super) const REDUCE: &str = shaded!("sight", "resolve", "enlarged");
