//! The removal of expired cases.

use std::fmt;
use std::pin::Pin;
use std::sync::Arc;

use case::CaseId;
use storage::upkeep::{self, Expired, Removal};
use storage::{Store, StoreError};

type Permission = Pin<Box<dyn Future<Output = bool> + Send>>;

/// What is told of each expired case before it is removed. If it does not agree, the case stays. Cheap to clone.
#[derive(Clone)]
pub struct BeforeRemoval(Arc<dyn Fn(CaseId) -> Permission + Send + Sync>);

impl BeforeRemoval {
    /// What a function says.
    pub fn new<F>(agrees: impl Fn(CaseId) -> F + Send + Sync + 'static) -> Self
    where
        F: Future<Output = bool> + Send + 'static,
    {
        Self(Arc::new(move |id| Box::pin(agrees(id))))
    }
}

/// Every expired case may go.
impl Default for BeforeRemoval {
    fn default() -> Self {
        Self::new(|_| std::future::ready(true))
    }
}

impl fmt::Debug for BeforeRemoval {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("BeforeRemoval")
    }
}

/// Removes the cases that are older than they are kept, as far as they need not wait and `before` agrees.
///
/// # Errors
/// If the rows or the objects cannot be written.
pub async fn remove_expired(
    store: &Store,
    before: &BeforeRemoval,
    removal: Removal,
) -> Result<Expired, StoreError> {
    upkeep::remove_expired(store, removal, |id| before.0(id)).await
}
