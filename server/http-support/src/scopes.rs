//! What a token may be used for.

use std::fmt;
use std::str::FromStr;

use axum::http::Method;

/// What a token may be used for. Only scopes are checked; a role is a name for several ([`Role`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Scope {
    /// Look at everything: cases, pictures, findings, the identity of patients, what a PACS sent.
    Read,
    /// Add, change and delete cases, layers and findings.
    Write,
    /// Store images, as a PACS does.
    DicomStore,
    /// Send results to a node.
    Results,
    /// Whatever no other scope permits, such as testing a node.
    Admin,
}

impl Scope {
    /// All scopes.
    pub const ALL: [Self; 5] = [
        Self::Read,
        Self::Write,
        Self::DicomStore,
        Self::Results,
        Self::Admin,
    ];

    /// Its word in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::DicomStore => "dicom-store",
            Self::Results => "results",
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Looks at cases.
    Viewer,
    /// Reads: looks, marks, uploads, and sends results.
    Editor,
    /// A PACS, which stores images and asks for cases.
    Pacs,
    /// Everything.
    Admin,
}

impl Role {
    /// All roles.
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

/// A method, the template of a path, and the scope that both need.
pub type Row = (Method, &'static str, Scope);

/// The scope of each route that changes something. What is only read needs [`Scope::Read`], and what is in no row needs
/// [`Scope::Admin`].
#[derive(Debug, Clone, Copy)]
pub struct ScopeTable(pub &'static [Row]);

impl ScopeTable {
    /// The scope that a request needs. `path` is the template of its route.
    pub fn needed(&self, method: &Method, path: &str) -> Scope {
        let row = (self.0.iter()).find(|(of, template, _)| of == method && *template == path);
        match row {
            Some((.., scope)) => *scope,
            None if method.is_safe() => Scope::Read,
            None => Scope::Admin,
        }
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
        const ROWS: &[Row] = &[(Method::POST, "/a", Scope::Results)];
        let table = ScopeTable(ROWS);
        assert_eq!(table.needed(&Method::POST, "/a"), Scope::Results);
        assert_eq!(table.needed(&Method::GET, "/a"), Scope::Read);
        assert_eq!(table.needed(&Method::HEAD, "/b"), Scope::Read);
        assert_eq!(table.needed(&Method::DELETE, "/a"), Scope::Admin);
        assert_eq!(table.needed(&Method::POST, "/a/b"), Scope::Admin);
    }

    #[test]
    fn a_viewer_changes_nothing_and_a_pacs_only_stores() {
        assert_eq!(Role::Viewer.scopes(), [Scope::Read]);
        assert!(!Role::Pacs.scopes().contains(&Scope::Write));
        assert_eq!(Role::Admin.scopes(), Scope::ALL);
    }
}
