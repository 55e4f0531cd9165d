//! What a token may be used for.

use std::fmt;
use std::str::FromStr;

use serde::Deserialize;
use strum::IntoStaticStr;

/// What a token may be used for. Only scopes are checked; a role is a name for several ([`Role`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
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
        self.into()
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[serde(try_from = "String")]
pub enum Role {
    Viewer,
    /// Reads: looks, marks, uploads, and sends results.
    Editor,
    /// A PACS, which stores images and asks for cases. It rejects nothing.
    Pacs,
    Admin,
}

impl Role {
    pub const ALL: [Self; 4] = [Self::Viewer, Self::Editor, Self::Pacs, Self::Admin];

    /// Its word on the command line.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// What it may do.
    pub fn scopes(self) -> &'static [Scope] {
        match self {
            Self::Viewer => &[Scope::Read],
            Self::Editor => &[Scope::Read, Scope::Write, Scope::Results],
            Self::Pacs => &[Scope::DicomStore],
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
    fn a_viewer_changes_nothing_and_a_pacs_only_stores() {
        assert_eq!(Role::Viewer.scopes(), [Scope::Read]);
        assert_eq!(Role::Pacs.scopes(), [Scope::DicomStore]);
        assert_eq!(Role::Admin.scopes(), Scope::ALL);
    }
}
