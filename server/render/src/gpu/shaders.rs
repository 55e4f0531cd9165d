//! The source of the shaders, assembled from the files of the folder `shaders/`.

macro_rules! wgsl {
    ($($name:literal),+) => {
        concat!($(include_str!(concat!("../../shaders/", $name, ".wgsl")), "\n"),+)
    };
}

/// The source from these files, after everything that shades a point of a surface.
macro_rules! shaded {
    ($($name:literal),+) => {
        wgsl!("picture", "trilinear", "gradient", "window", "colormap", "overlay", "light", "shade", $($name),+)
    };
}

/// The mesh from plain vertices: `mesh_vertex`, `mesh_shaded`, `mesh_height`.
pub(super) const MESH: &str = shaded!("mesh");

/// The mesh's vertices from the table of all depths: `shrunk_vertex`. The page draws with them.
pub(super) const SHRINK: &str = wgsl!("picture", "trilinear", "gradient", "shrink");

/// The same with the entry points of [`MESH`], for tests.
#[cfg(test)]
pub(super) const SHRUNK_MESH: &str = shaded!("mesh", "shrink");

/// The isosurface itself: `screen_vertex`, `trace_shaded`, `trace_height`.
pub(super) const TRACE: &str = shaded!("sight", "trace");

/// The mesh from its depth buffer: `screen_vertex`, `mesh_resolved`.
pub(super) const RESOLVE: &str = shaded!("sight", "resolve", "multisampled");

/// The mesh from a depth buffer of the pane's own size or twice that: `screen_vertex`, `mesh_reduced`. The page draws with it.
pub(super) const REDUCE: &str = shaded!("sight", "resolve", "enlarged");

/// A slice: `screen_vertex`, `slice_shaded`. The page draws with it; [`draw_slice`](crate::draw_slice) is its twin.
pub(super) const SLICE: &str = shaded!("sight", "edges", "slice");

/// A stage of a shader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PageStage {
    /// Called for each vertex.
    Vertex,
    /// Called for each pixel.
    Fragment,
}

/// One stage of a program that the page draws with, to be translated.
#[derive(Debug, Clone, Copy)]
pub struct PageShader {
    /// Its file in `web/shaders/`.
    pub file: &'static str,
    /// WGSL.
    pub source: &'static str,
    /// The stage.
    pub stage: PageStage,
    /// The entry point of the stage.
    pub entry_point: &'static str,
}

/// All stages that the page draws with.
pub const PAGE_SHADERS: [PageShader; 6] = {
    use PageStage::{Fragment, Vertex};
    [
        page_shader("mesh.vert.glsl", MESH, Vertex, "mesh_vertex"),
        page_shader("shrink.vert.glsl", SHRINK, Vertex, "shrunk_vertex"),
        page_shader("reduce.frag.glsl", REDUCE, Fragment, "mesh_reduced"),
        page_shader("screen.vert.glsl", TRACE, Vertex, "screen_vertex"),
        page_shader("trace.frag.glsl", TRACE, Fragment, "trace_shaded"),
        page_shader("slice.frag.glsl", SLICE, Fragment, "slice_shaded"),
    ]
};

const fn page_shader(
    file: &'static str,
    source: &'static str,
    stage: PageStage,
    entry_point: &'static str,
) -> PageShader {
    PageShader {
        file,
        source,
        stage,
        entry_point,
    }
}
