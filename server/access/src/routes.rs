//! Routes that need a token.

use axum::http::Method;
use utoipa::openapi::path::PathItem;
use utoipa_axum::router::{OpenApiRouter, UtoipaMethodRouter};

use crate::audited::Audited;
use crate::scopes::{Scope, ScopeTable};

/// Routes that need a token. Each states where it is added what the token must permit, and what is recorded of its requests.
pub struct GuardedRoutes<S> {
    routes: OpenApiRouter<S>,
    scopes: ScopeTable,
}

impl<S: Clone + Send + Sync + 'static> Default for GuardedRoutes<S> {
    fn default() -> Self {
        Self {
            routes: OpenApiRouter::new(),
            scopes: ScopeTable::default(),
        }
    }
}

impl<S: Clone + Send + Sync + 'static> GuardedRoutes<S> {
    /// These and handlers of one path (`routes!`), whose methods and template their descriptions state.
    #[must_use]
    pub fn with(mut self, scope: Scope, audited: Audited, handlers: UtoipaMethodRouter<S>) -> Self {
        let (_, described, _) = &handlers;
        for (path, item) in &described.paths {
            for method in methods(item) {
                self.scopes.add(method, path, scope, audited);
            }
        }
        self.routes = self.routes.routes(handlers);
        self
    }

    /// These and others.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            routes: self.routes.merge(other.routes),
            scopes: self.scopes.and(other.scopes),
        }
    }

    /// These with a layer or a limit.
    #[must_use]
    pub fn map(self, change: impl FnOnce(OpenApiRouter<S>) -> OpenApiRouter<S>) -> Self {
        Self {
            routes: change(self.routes),
            ..self
        }
    }

    /// The routes without their guard, and what it must know.
    pub fn into_parts(self) -> (OpenApiRouter<S>, ScopeTable) {
        (self.routes, self.scopes)
    }
}

/// The methods of the handlers of a path.
fn methods(item: &PathItem) -> impl Iterator<Item = Method> {
    let described = [
        (&item.get, Method::GET),
        (&item.put, Method::PUT),
        (&item.post, Method::POST),
        (&item.patch, Method::PATCH),
        (&item.delete, Method::DELETE),
    ];
    let described = described.into_iter();
    described.filter_map(|(operation, method)| operation.as_ref().map(|_| method))
}
