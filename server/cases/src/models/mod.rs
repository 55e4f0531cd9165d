//! Loaded models: the data of cases for rendering, kept in memory.

mod model;
#[cfg(test)]
mod tests;

use case::{CaseId, SurfaceName};

use crate::cache::Part;
use crate::error::Error;
use crate::library::Library;

use self::model::LoadedModel;
pub use self::model::{PathKind, WarmModel};

/// The models of the cases of a library, in its cache. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Models {
    library: Library,
}

impl Models {
    /// Models of the cases of a library.
    pub fn new(library: Library) -> Self {
        Self { library }
    }

    /// The model of a surface of a case that is ready. What is in memory is answered without the rows.
    ///
    /// A missing or damaged derived object is rebuilt from the source, and the parts of the brain are divided when one is first
    /// asked for. Concurrent callers wait for one loading.
    ///
    /// # Errors
    /// [`Error::NoSuchCase`], also if the case is not ready; [`Error::NoSurfaces`]; or an error of the store.
    pub async fn get(&self, id: &CaseId, surface: SurfaceName) -> Result<WarmModel, Error> {
        let (cache, part) = (self.library.cache(), Part::Model(surface));
        let model = cache.get_or_make(id, part, self.load(id, surface)).await?;
        Ok(WarmModel::new(model, self.library.clone()))
    }

    async fn load(&self, id: &CaseId, surface: SurfaceName) -> Result<LoadedModel, Error> {
        let model = LoadedModel::load(&self.library, id, surface).await?;
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
}
