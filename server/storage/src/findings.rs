//! The findings of cases: the one part of a case that changes.
//!
//! They are not derived from anything, so they lie in a row, and a change is one transaction.

use std::collections::BTreeSet;
use std::fmt;

use serde_json::Value;

/// The findings of a case as they are stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredFindings {
    /// JSON.
    pub document: String,
    /// Names this version of the document.
    pub version: FindingsVersion,
}

/// A version of a document: its digest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FindingsVersion(blake3::Hash);

impl fmt::Display for FindingsVersion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0.to_hex()[..32])
    }
}

impl FindingsVersion {
    /// The version of a document.
    pub fn of(document: &str) -> Self {
        Self(blake3::hash(document.as_bytes()))
    }

    pub fn digest(&self) -> &blake3::Hash {
        &self.0
    }
}

/// The document of a case without findings.
pub(crate) const NONE: &str = "[]";

impl StoredFindings {
    /// A document with its version.
    pub(crate) fn new(document: String) -> Self {
        let version = FindingsVersion::of(&document);
        Self { document, version }
    }

    /// What lists state: how many findings are kept, and the names of the authors, a line each.
    pub(crate) fn summary(&self) -> Result<(i64, String), serde_json::Error> {
        let all: Vec<Value> = serde_json::from_str(&self.document)?;
        // As `Finding::is_numbered` of `case`.
        let is_numbered = |one: &&Value| one["is_dismissed"] != true && one["kind"] != "acpc";
        let kept = all.iter().filter(is_numbered).count();
        let authors: BTreeSet<&str> = all
            .iter()
            .filter_map(|one| one["author"].as_str())
            .collect();
        let authors: Vec<&str> = authors
            .into_iter()
            .filter(|name| !name.is_empty())
            .collect();
        Ok((i64::try_from(kept).unwrap_or(i64::MAX), authors.join("\n")))
    }
}

/// The result of an attempt to replace the findings of a case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Replaced {
    /// They are stored.
    Done(StoredFindings),
    /// Somebody else changed them meanwhile; nothing has changed.
    Changed,
    /// There is no such case.
    NoSuchCase,
}
