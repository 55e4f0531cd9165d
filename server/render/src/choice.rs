//! Which renderer is asked for.

/// The renderer that a client asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Renderer {
    /// The best that this machine has.
    #[default]
    Auto,
    /// Voxels of a thin shell, in software (the paper's section 3.3).
    Splat,
    /// The facets of the mesh.
    Mesh,
    /// Sphere tracing of the distance map.
    Trace,
}
