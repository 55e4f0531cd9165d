//! What a device is asked to draw, and its answers.

use std::fmt;
use std::sync::Arc;

use geometry::{DeformableModel, MeshSize, ShrunkMesh};

use crate::{KeyedLayers, RenderRequest, Scene};

/// Which case a scene is of: textures are kept under it. The same key must always mean the same scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct CaseKey(pub u128);

/// A model that threads share, and the key of its textures.
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

/// What is drawn of a case.
#[derive(Debug, Clone, PartialEq)]
pub enum GpuSurface {
    /// The facets of a mesh, lit and coloured at each pixel's point of the facet.
    Mesh {
        /// How fine it is: its triangles.
        size: MeshSize,
        /// Its vertices.
        mesh: ShrunkMesh,
    },
    /// The isosurface {depth = D} itself.
    Trace,
}

/// A picture that is asked for.
#[derive(Debug, Clone)]
pub struct GpuJob {
    /// The model to draw.
    pub case: KeyedModel,
    /// How to draw it.
    pub request: RenderRequest,
    /// What is seen beside or in place of its intensities.
    pub layers: KeyedLayers,
    /// What to draw of it.
    pub surface: GpuSurface,
}

/// A picture that is asked for, of a scene that is at hand.
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
