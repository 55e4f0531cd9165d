//! The choice of a renderer.

/// The renderer that a client requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Renderer {
    /// The exact isosurface, as `trace`.
    #[default]
    Auto,
    /// Voxels of a thin shell, on the CPU (section 3.3 of the paper).
    Splat,
    /// The facets of the mesh.
    Mesh,
    /// Sphere tracing of the distance map.
    Trace,
}
