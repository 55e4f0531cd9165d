//! Loaded models: the data of cases for rendering, kept in memory.

mod model;
#[cfg(test)]
mod tests;

use case::{CaseId, SurfaceName};
use pipeline::surfaces::NoSurfaces;
use storage::StoreError;

use crate::cache::Part;
use crate::library::Library;

use self::model::LoadedModel;
pub use self::model::{PathKind, PathsError, WarmModel};

/// The models of the cases of a library, in its cache. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Models {
    library: Library,
}

/// The reason why a model was not loaded.
enum NotLoaded {
    NotReady,
    NoSurfaces(NoSurfaces),
    Failed(StoreError),
}

/// The reason why there is no model of a ready case.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The case has only the surface of the whole brain.
    #[error(transparent)]
    NoSurfaces(NoSurfaces),
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl Models {
    /// Models of the cases of a library.
    pub fn new(library: Library) -> Self {
        Self { library }
    }

    /// The model of a surface of a case that is ready; `None` if there is no such case or it is not ready. What is in memory is answered without
    /// the rows.
    ///
    /// A missing or damaged derived object is rebuilt from the source, and the parts of the brain are divided when one is first
    /// asked for. Concurrent callers wait for one loading.
    ///
    /// # Errors
    /// If the case has no such surface, or the store fails.
    pub async fn get(
        &self,
        id: &CaseId,
        surface: SurfaceName,
    ) -> Result<Option<WarmModel>, ModelError> {
        let (cache, part) = (self.library.cache(), Part::Model(surface));
        match cache.get_or_make(id, part, self.load(id, surface)).await {
            Ok(model) => Ok(Some(WarmModel::new(model, self.library.clone()))),
            Err(NotLoaded::NotReady) => Ok(None),
            Err(NotLoaded::NoSurfaces(reason)) => Err(ModelError::NoSurfaces(reason)),
            Err(NotLoaded::Failed(error)) => Err(error.into()),
        }
    }

    async fn load(&self, id: &CaseId, surface: SurfaceName) -> Result<LoadedModel, NotLoaded> {
        match LoadedModel::load(&self.library, id, surface).await {
            Ok(Some(model)) => {
                // Whoever looks at a case may want its maps next; a picture does not need them.
                if let Err(error) = self.library.ensure_maps(id).await {
                    tracing::warn!(
                        case = id.short(),
                        error = &error as &dyn std::error::Error,
                        "the maps of a case will be computed later"
                    );
                }
                Ok(model)
            }
            Ok(None) => Err(NotLoaded::NotReady),
            Err(ModelError::NoSurfaces(reason)) => Err(NotLoaded::NoSurfaces(reason)),
            Err(ModelError::Store(error)) => Err(NotLoaded::Failed(error)),
        }
    }
}
