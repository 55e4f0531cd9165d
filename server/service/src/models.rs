//! Warm models: what rendering needs of a case, kept in memory within a budget of bytes.

use std::sync::Arc;

use geometry::{DepthField, GeometryError, MeshSize, PathKind, PathTable, ShellIndex, Volume};

use crate::case::{CaseFacts, CaseId};
use crate::store::{Store, StoreError};

/// Everything of a case that rendering and meshes need.
#[derive(Debug)]
pub struct Model {
    /// Intensities, cropped to the envelope with a margin.
    pub volume: Volume,
    /// Depth as a continuous function.
    pub field: DepthField,
    /// The same, smoothed: normals are its gradient.
    pub normals: DepthField,
    /// The envelope's voxels by depth.
    pub shell: ShellIndex,
    /// What clients are told.
    pub facts: CaseFacts,
}

/// Why a table of paths could not be had.
#[derive(Debug, thiserror::Error)]
pub enum PathsError {
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The mesh cannot be made.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

impl Model {
    /// The table of all depths of a mesh. The default one (30 × 30, forest) is always there; others are made at the first call.
    ///
    /// # Errors
    /// When the mesh cannot be cut, or the store fails.
    pub async fn paths(
        &self,
        size: MeshSize,
        kind: PathKind,
    ) -> Result<Arc<PathTable>, PathsError> {
        let _ = (size, kind);
        todo!()
    }

    /// Memory held, in bytes.
    pub fn bytes(&self) -> u64 {
        todo!()
    }
}

/// The models in memory, at most a budget of bytes of them.
#[derive(Debug, Clone)]
pub struct Models {
    store: Store,
}

impl Models {
    /// Models of the cases of a store, `budget_bytes` of them at most.
    pub fn new(store: Store, budget_bytes: u64) -> Self {
        let _ = budget_bytes;
        Self { store }
    }

    /// The model of a case that is ready; `None` where there is no such case or it is not ready.
    ///
    /// # Errors
    /// When the store fails. A missing or damaged derived object is rebuilt from the source instead.
    pub async fn get(&self, id: &CaseId) -> Result<Option<Arc<Model>>, StoreError> {
        let _ = (id, &self.store);
        todo!()
    }
}
