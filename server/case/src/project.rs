//! Projects: whose cases are whose.

use std::fmt;
use std::str::FromStr;

/// The greatest number of characters of a name.
const MAX_LENGTH: usize = 32;

/// A project, to which cases and series belong. It is its name; the one without a name is the default, and the only one of a
/// server that knows no projects.
///
/// A [`CaseId`](crate::CaseId) has its project, so what is kept by the id of a case is kept for each project.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Project([u8; MAX_LENGTH]);

/// The text is not the name of a [`Project`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the name of a project is 1 to {MAX_LENGTH} lower-case letters, digits, points, `-` and `_`, and begins with a letter or a digit"
)]
pub struct NotAProject;

impl Project {
    /// The project without a name.
    pub const DEFAULT: Self = Self([0; MAX_LENGTH]);

    /// Parses a name; `None` for anything else. The default has none.
    pub fn parse(name: &str) -> Option<Self> {
        let is_inner = |byte: &u8| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'.' | b'-' | b'_');
        let bytes = name.as_bytes();
        let begins = bytes.first()?.is_ascii_alphanumeric();
        let is_name = begins && bytes.len() <= MAX_LENGTH && bytes.iter().all(is_inner);
        is_name.then(|| {
            let mut project = Self::DEFAULT;
            project.0[..bytes.len()].copy_from_slice(bytes);
            project
        })
    }

    /// Its name; empty for the default.
    pub fn name(&self) -> &str {
        let length = self.0.iter().position(|&byte| byte == 0);
        std::str::from_utf8(&self.0[..length.unwrap_or(MAX_LENGTH)]).unwrap_or_default()
    }

    /// The reverse of [`Project::name`]; `None` for anything else.
    pub fn with_name(name: &str) -> Option<Self> {
        match name {
            "" => Some(Self::DEFAULT),
            name => Self::parse(name),
        }
    }

    /// Whether it is the one without a name.
    pub fn is_default(&self) -> bool {
        *self == Self::DEFAULT
    }
}

impl fmt::Debug for Project {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Project({:?})", self.name())
    }
}

impl fmt::Display for Project {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl FromStr for Project {
    type Err = NotAProject;

    fn from_str(name: &str) -> Result<Self, NotAProject> {
        Self::parse(name).ok_or(NotAProject)
    }
}

impl TryFrom<String> for Project {
    type Error = NotAProject;

    fn try_from(name: String) -> Result<Self, NotAProject> {
        name.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_read_back_as_it_was_written() {
        for name in ["a", "epilepsy", "2026_study-b.1", &"z".repeat(32)] {
            let project = Project::parse(name).unwrap();
            assert_eq!(project.name(), name);
            assert_eq!(Project::with_name(name), Some(project));
        }
        assert_eq!(Project::with_name(""), Some(Project::DEFAULT));
        assert_eq!(Project::DEFAULT.name(), "");
    }

    #[test]
    fn other_texts_are_no_names() {
        let long = "z".repeat(33);
        for name in ["", "A", ".", "-a", "a b", "a:b", "a/b", "é", &long] {
            assert_eq!(Project::parse(name), None, "{name}");
        }
    }
}
