//! The jobs of a device.

use std::fmt;
use std::sync::Arc;

use geometry::{DeformableModel, MeshSize, ShrunkMesh};

use crate::{KeyedLayers, RenderRequest, Scene};

/// Identifies a case and its textures. The same key must always mean the same scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct CaseKey(pub u128);

/// A shared model, and the key of its textures.
#[derive(Clone)]
pub struct KeyedModel {
    /// The key: the same one always means the same model.
    pub key: CaseKey,
    /// The model.
    pub model: Arc<DeformableModel>,
}

impl KeyedModel {
    /// Its scene.
    pub fn scene(&self) -> Scene<'_> {
        Scene::from(&*self.model)
    }
}

impl fmt::Debug for KeyedModel {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("KeyedModel")
            .field("key", &self.key)
            .finish_non_exhaustive()
    }
}

/// The surface to draw.
#[derive(Debug, Clone, PartialEq)]
pub enum GpuSurface {
    /// The facets of a mesh, lit and coloured at each pixel's point of the facet.
    Mesh {
        /// The size of the mesh, which determines its triangles.
        size: MeshSize,
        /// Its vertices.
        mesh: ShrunkMesh,
    },
    /// The isosurface {depth = D} itself.
    Trace,
}

/// A requested picture.
#[derive(Debug, Clone)]
pub struct GpuJob {
    /// The model to draw.
    pub case: KeyedModel,
    /// How to draw it.
    pub request: RenderRequest,
    /// Layers to show in addition to its intensities, or instead of them.
    pub layers: KeyedLayers,
    /// The surface to draw.
    pub surface: GpuSurface,
}

/// A requested picture of a borrowed scene.
#[derive(Clone, Copy)]
pub(super) struct Call<'a> {
    pub(super) key: CaseKey,
    pub(super) scene: Scene<'a>,
    pub(super) request: &'a RenderRequest,
    pub(super) layers: &'a KeyedLayers,
    pub(super) surface: &'a GpuSurface,
}

impl GpuJob {
    pub(super) fn call(&self) -> Call<'_> {
        Call {
            key: self.case.key,
            scene: self.case.scene().with_layers(self.layers.layers()),
            request: &self.request,
            layers: &self.layers,
            surface: &self.surface,
        }
    }
}
