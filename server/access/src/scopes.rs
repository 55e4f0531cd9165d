//! What a token may be used for.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use axum::http::Method;
use serde::Deserialize;

use crate::audited::Audited;

/// What a token may be used for. Only scopes are checked; a role is a name for several ([`Role`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Scope {
    /// Look at everything: cases, pictures, findings, the identity of patients, what a PACS sent.
    Read,
    /// Add, change and delete cases, layers and findings.
    Write,
    /// Store images, as a PACS does.
    DicomStore,
    /// Withdraw images by rejection notes, which are stored as images are.
    DicomReject,
    /// Send results to a node.
    Results,
    /// Read the metrics, if they need a token.
    Metrics,
    /// Whatever no other scope permits, such as testing a node.
    Admin,
}

impl Scope {
    pub const ALL: [Self; 7] = [
        Self::Read,
        Self::Write,
        Self::DicomStore,
        Self::DicomReject,
        Self::Results,
        Self::Metrics,
        Self::Admin,
    ];

    /// Its word in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::DicomStore => "dicom-store",
            Self::DicomReject => "dicom-reject",
            Self::Results => "results",
            Self::Metrics => "metrics",
            Self::Admin => "admin",
        }
    }
}

impl fmt::Display for Scope {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl FromStr for Scope {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|scope| scope.name() == word);
        found.ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            format!(
                "`{}` is no scope; the scopes are {known}",
                word.escape_debug()
            )
        })
    }
}

/// A name for several scopes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub enum Role {
    /// Looks at cases.
    Viewer,
    /// Reads: looks, marks, uploads, and sends results.
    Editor,
    /// A PACS, which stores images and asks for cases. It rejects nothing.
    Pacs,
    /// Everything.
    Admin,
}

impl Role {
    pub const ALL: [Self; 4] = [Self::Viewer, Self::Editor, Self::Pacs, Self::Admin];

    /// Its word on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Viewer => "viewer",
            Self::Editor => "editor",
            Self::Pacs => "pacs",
            Self::Admin => "admin",
        }
    }

    /// What it may do.
    pub fn scopes(self) -> &'static [Scope] {
        match self {
            Self::Viewer => &[Scope::Read],
            Self::Editor => &[Scope::Read, Scope::Write, Scope::Results],
            Self::Pacs => &[Scope::Read, Scope::DicomStore],
            Self::Admin => &Scope::ALL,
        }
    }
}

impl FromStr for Role {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|role| role.name() == word);
        found.ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            format!(
                "`{}` is no role; the roles are {known}",
                word.escape_debug()
            )
        })
    }
}

impl TryFrom<String> for Role {
    type Error = String;

    fn try_from(word: String) -> Result<Self, String> {
        word.parse()
    }
}

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

    /// All rows.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_as_they_are_written() {
        for scope in Scope::ALL {
            assert_eq!(scope.name().parse(), Ok(scope));
        }
        assert!(
            "reads"
                .parse::<Scope>()
                .unwrap_err()
                .contains("dicom-store")
        );
    }

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

    #[test]
    fn a_viewer_changes_nothing_and_a_pacs_only_stores() {
        assert_eq!(Role::Viewer.scopes(), [Scope::Read]);
        assert_eq!(Role::Pacs.scopes(), [Scope::Read, Scope::DicomStore]);
        assert_eq!(Role::Admin.scopes(), Scope::ALL);
    }
}
