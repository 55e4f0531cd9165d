//! Routes that need a token, and what each needs.

use std::borrow::Cow;

use axum::http::Method;
use axum::routing::MethodRouter;
use utoipa::openapi::path::PathItem;
use utoipa_axum::router::{OpenApiRouter, UtoipaMethodRouter};

use crate::audited::Audited;
use crate::scopes::Scope;

/// A method, the template of a path, the scope that both need, and what is recorded.
pub type Row = (Method, &'static str, Scope, Audited);

/// The scope of each route, and what is recorded of its requests. What is in no row needs [`Scope::Admin`].
#[derive(Debug, Clone, Default)]
pub struct ScopeTable(Vec<(Method, Cow<'static, str>, Scope, Audited)>);

impl ScopeTable {
    /// A table that is written out.
    pub fn of(rows: &[Row]) -> Self {
        let rows = rows.iter().cloned();
        let row = |(method, path, scope, audited)| (method, Cow::Borrowed(path), scope, audited);
        Self(rows.map(row).collect())
    }

    pub(crate) fn add(&mut self, method: Method, path: &str, scope: Scope, audited: Audited) {
        self.0
            .push((method, path.to_owned().into(), scope, audited));
    }

    /// The rows of both.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        self.0.extend(other.0);
        self
    }

    pub fn rows(&self) -> impl Iterator<Item = (&Method, &str, Scope, Audited)> {
        let rows = self.0.iter();
        rows.map(|(method, path, scope, audited)| (method, &**path, *scope, *audited))
    }

    /// The scope that a request needs, and what is recorded of it. `path` is the template of its route.
    pub(crate) fn row(&self, method: &Method, path: &str) -> (Scope, Audited) {
        // The head of an answer is read by the same handler.
        let method = match *method {
            Method::HEAD => &Method::GET,
            _ => method,
        };
        let row = (self.rows()).find(|(of, template, ..)| *of == method && *template == path);
        row.map_or(
            (Scope::Admin, Audited::Operation),
            |(.., scope, audited)| (scope, audited),
        )
    }
}

/// Routes of another protocol that need a token, which stand beside those of the service and behind the same guards.
pub struct ProtocolRoutes {
    /// Those that take files, which have the time of an upload.
    pub uploads: GuardedRoutes<()>,
    /// The others, which have the time of an answer.
    pub answers: GuardedRoutes<()>,
}

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

    /// These and a handler of one path and method that no description names.
    #[must_use]
    pub fn with_undescribed(
        mut self,
        scope: Scope,
        audited: Audited,
        (method, path): (Method, &str),
        handler: MethodRouter<S>,
    ) -> Self {
        self.scopes.add(method, path, scope, audited);
        self.routes = self.routes.route(path, handler);
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

    /// These with their state.
    pub fn with_state<T: Clone + Send + Sync + 'static>(self, state: S) -> GuardedRoutes<T> {
        GuardedRoutes {
            routes: self.routes.with_state(state),
            scopes: self.scopes,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_row_names_is_for_nobody_but_the_administrator() {
        const ROWS: &[Row] = &[
            (Method::POST, "/a", Scope::Results, Audited::Result),
            (Method::GET, "/a", Scope::Read, Audited::View),
        ];
        let row = |method: Method, path| ScopeTable::of(ROWS).row(&method, path);
        let read = (Scope::Read, Audited::View);
        assert_eq!(row(Method::POST, "/a"), (Scope::Results, Audited::Result));
        assert_eq!(row(Method::GET, "/a"), read);
        assert_eq!(row(Method::HEAD, "/a"), read);
        for (method, path) in [
            (Method::GET, "/b"),
            (Method::HEAD, "/b"),
            (Method::DELETE, "/a"),
            (Method::OPTIONS, "/a"),
            (Method::POST, "/a/b"),
        ] {
            assert_eq!(row(method, path), (Scope::Admin, Audited::Operation));
        }
    }
}
