//! What named users have chosen and saved for themselves, in whatever browser they sit.

use case::findings::FindingRefused;
use serde_json::{Map, Value};
use storage::{FindingsVersion, StoreError};

use crate::findings::NotReplaced;
use crate::{Cases, Error};

/// The longest document, in bytes.
pub const MAX_BYTES: usize = 64 << 10;

/// The document of a user: the page owns its members.
#[derive(Debug, Clone)]
pub struct Preferences {
    pub members: Map<String, Value>,
    /// Names this version.
    pub version: FindingsVersion,
    /// `None` before anything is.
    stored: Option<String>,
}

impl Preferences {
    fn read(user: &str, stored: Option<String>) -> Result<Self, Error> {
        let document = stored.as_deref().unwrap_or("{}");
        Ok(Self {
            members: serde_json::from_str(document).map_err(StoreError::from)?,
            // Two users may have chosen the same: whoever knows the one does not know the other.
            version: FindingsVersion::of(&format!("{user}\n{document}")),
            stored,
        })
    }
}

impl Cases {
    /// What a user has chosen; nothing before anything is.
    ///
    /// # Errors
    /// An error of the store.
    pub async fn preferences(&self, user: &str) -> Result<Preferences, Error> {
        Preferences::read(user, self.store().preferences(user).await?)
    }

    /// Replaces what a user has chosen, if it is still of one of the versions that the client knows. It is durable then.
    ///
    /// # Errors
    /// [`NotReplaced`]: `Refused` if it is too long.
    pub async fn replace_preferences(
        &self,
        user: &str,
        known: &[&str],
        members: Map<String, Value>,
    ) -> Result<Preferences, NotReplaced<Preferences>> {
        let before = self.preferences(user).await?;
        if !known.contains(&&*before.version.to_string()) {
            return Err(NotReplaced::Changed(before));
        }
        let document = serde_json::to_string(&members).map_err(StoreError::from)?;
        if document.len() > MAX_BYTES {
            return Err(NotReplaced::Refused(FindingRefused {
                path: "body".to_owned(),
                detail: "must not be longer than 64 KiB".to_owned(),
            }));
        }
        let stored = before.stored.as_deref();
        let replaced = self
            .store()
            .replace_preferences(user, stored, Some(&document));
        match replaced.await? {
            true => Ok(Preferences::read(user, Some(document))?),
            false => Err(NotReplaced::Changed(self.preferences(user).await?)),
        }
    }

    /// Removes what a user has chosen, whatever it is.
    ///
    /// # Errors
    /// An error of the store.
    pub async fn remove_preferences(&self, user: &str) -> Result<(), Error> {
        loop {
            let known = self.store().preferences(user).await?;
            let removed = self
                .store()
                .replace_preferences(user, known.as_deref(), None);
            if removed.await? {
                return Ok(());
            }
        }
    }
}
