//! The keys with which objects are encrypted, from a file.
//!
//! Each line has a key, 64 hexadecimal digits, or the word `none`. The first line says with which key objects are written;
//! the others are for reading. Empty lines and lines that begin with `#` have no meaning.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};

/// Length of a key, in bytes.
const KEY_LENGTH: usize = 32;

/// The line for objects that are not encrypted.
const NONE: &str = "none";

/// Separates the ids of keys from everything else that is derived from them.
const ID_CONTEXT: &str = "isocortex 2026-11-25 id of a key";

/// The name of a key: a digest, which reveals nothing of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct KeyId(pub(crate) [u8; 8]);

impl KeyId {
    /// Parses 16 hexadecimal digits.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        bytes_of(text).map(Self)
    }
}

impl fmt::Display for KeyId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0
            .iter()
            .try_for_each(|byte| write!(formatter, "{byte:02x}"))
    }
}

/// A key. Its `Debug` shows its id alone.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct Key {
    pub(crate) id: KeyId,
    pub(crate) secret: [u8; KEY_LENGTH],
}

impl Key {
    fn new(secret: [u8; KEY_LENGTH]) -> Self {
        let digest = blake3::derive_key(ID_CONTEXT, &secret);
        let mut id = [0; 8];
        id.copy_from_slice(&digest[..8]);
        Self {
            id: KeyId(id),
            secret,
        }
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Key({})", self.id)
    }
}

/// The reason why a file of keys cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BadKeys {
    /// It cannot be read.
    #[error("it cannot be read: {0}")]
    Unreadable(#[from] std::io::Error),
    /// A line is no key.
    #[error("line {0} is no key: write 64 hexadecimal digits, or `none`")]
    NoKey(usize),
    /// A key, or `none`, is there twice.
    #[error("line {0} repeats an earlier one")]
    Repeated(usize),
    /// It has no line.
    #[error("it has no key; make one with `isocortex key new`")]
    Empty,
}

/// The keys of a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct KeyRing(Vec<Option<Key>>);

impl KeyRing {
    fn parse(text: &str) -> Result<Self, BadKeys> {
        let mut keys = Vec::new();
        for (index, line) in text.lines().map(str::trim).enumerate() {
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let key = match line {
                NONE => None,
                digits => {
                    let secret = bytes_of(digits).ok_or(BadKeys::NoKey(index + 1))?;
                    Some(Key::new(secret))
                }
            };
            if keys.contains(&key) {
                return Err(BadKeys::Repeated(index + 1));
            }
            keys.push(key);
        }
        match keys.is_empty() {
            true => Err(BadKeys::Empty),
            false => Ok(Self(keys)),
        }
    }

    /// The key for new objects; `None` if they are not encrypted.
    pub(crate) fn for_writing(&self) -> Option<&Key> {
        self.0.first()?.as_ref()
    }

    /// The key with this id.
    pub(crate) fn find(&self, id: KeyId) -> Option<&Key> {
        self.0.iter().flatten().find(|key| key.id == id)
    }
}

/// The keys of a store: those of a file, which is read again when it changes, or none.
#[derive(Debug, Clone, Default)]
pub struct Keys(Option<Arc<KeyFile>>);

#[derive(Debug)]
struct KeyFile {
    path: PathBuf,
    /// Held only briefly; each change is one step.
    latest: RwLock<Latest>,
}

#[derive(Debug)]
struct Latest {
    state: Option<FileState>,
    ring: Arc<KeyRing>,
}

/// Length, time of the last change, and number of the file.
type FileState = (u64, std::time::SystemTime, u64);

impl Keys {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, or has something else than keys.
    pub fn read(path: &Path) -> Result<Self, BadKeys> {
        let state = state_of(path);
        let ring = ring_of(path)?;
        let latest = RwLock::new(Latest {
            state,
            ring: Arc::new(ring),
        });
        Ok(Self(Some(Arc::new(KeyFile {
            path: path.to_owned(),
            latest,
        }))))
    }

    /// A line with a new key for such a file, and its id.
    ///
    /// # Errors
    /// If this machine gives no random numbers.
    pub fn new_line() -> Result<(String, KeyId), std::io::Error> {
        let mut secret = [0; KEY_LENGTH];
        getrandom::fill(&mut secret).map_err(std::io::Error::other)?;
        let digits: String = secret.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok((format!("{digits}\n"), Key::new(secret).id))
    }

    /// The id of the key for new objects; `None` if they are not encrypted.
    pub fn current(&self) -> Option<KeyId> {
        self.ring().for_writing().map(|key| key.id)
    }

    /// The keys as they are in the file now. If it cannot be used any more, those of before, and the log says so once.
    pub(crate) fn ring(&self) -> Arc<KeyRing> {
        match &self.0 {
            Some(file) => file.ring(),
            None => Arc::default(),
        }
    }
}

impl KeyFile {
    fn ring(&self) -> Arc<KeyRing> {
        let state = state_of(&self.path);
        {
            let latest = self.latest.read().unwrap_or_else(PoisonError::into_inner);
            // A file that is gone for a moment, while it is replaced, changes nothing.
            if state.is_none() || latest.state == state {
                return Arc::clone(&latest.ring);
            }
        }
        let read = ring_of(&self.path);
        let mut latest = self.latest.write().unwrap_or_else(PoisonError::into_inner);
        latest.state = state;
        match read {
            Ok(ring) => {
                tracing::info!("the keys of the store were read again");
                latest.ring = Arc::new(ring);
            }
            Err(error) => {
                tracing::error!(%error, "the keys of the store stay as they were");
            }
        }
        Arc::clone(&latest.ring)
    }
}

fn ring_of(path: &Path) -> Result<KeyRing, BadKeys> {
    let text = std::fs::read_to_string(path)?;
    KeyRing::parse(&text)
}

fn state_of(path: &Path) -> Option<FileState> {
    let metadata = std::fs::metadata(path).ok()?;
    #[cfg(unix)]
    let number = std::os::unix::fs::MetadataExt::ino(&metadata);
    #[cfg(not(unix))]
    let number = 0;
    Some((metadata.len(), metadata.modified().ok()?, number))
}

/// The bytes of twice as many hexadecimal digits.
fn bytes_of<const N: usize>(text: &str) -> Option<[u8; N]> {
    let digits = text.as_bytes();
    if digits.len() != 2 * N || !digits.iter().all(u8::is_ascii_hexdigit) {
        return None;
    }
    let mut bytes = [0; N];
    for (byte, pair) in bytes.iter_mut().zip(digits.chunks(2)) {
        *byte = u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok()?;
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digits(byte: u8) -> String {
        format!("{byte:02x}").repeat(KEY_LENGTH)
    }

    #[test]
    fn the_first_line_writes_and_all_read() {
        let [one, two] = [1, 2].map(|byte| Key::new([byte; KEY_LENGTH]));
        let text = format!("# ours\n\n  {}\n{}\n", digits(2), digits(1));
        let ring = KeyRing::parse(&text).unwrap();
        assert_eq!(ring.for_writing(), Some(&two));
        assert_eq!(ring.find(one.id), Some(&one));
        assert_eq!(ring.find(KeyId([0; 8])), None);
        let leaving = KeyRing::parse(&format!("none\n{}", digits(1))).unwrap();
        assert_eq!(leaving.for_writing(), None);
        assert_eq!(leaving.find(one.id), Some(&one));
        assert_eq!(KeyId::parse(&one.id.to_string()), Some(one.id));
    }

    #[test]
    fn what_is_wrong_with_a_file_is_said_without_a_key() {
        let key = digits(7);
        for (text, words) in [
            (String::new(), "it has no key"),
            ("# nothing\n".to_owned(), "it has no key"),
            (format!("{key}\nsecret"), "line 2 is no key"),
            (key[1..].to_owned(), "line 1 is no key"),
            (format!("+{}", &key[1..]), "line 1 is no key"),
            (
                format!("{key}\n#\n{key}\n"),
                "line 3 repeats an earlier one",
            ),
            ("none\nnone".to_owned(), "line 2 repeats"),
        ] {
            let error = KeyRing::parse(&text).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
            assert!(
                !error.contains("0707") && !error.contains("secret"),
                "{error}"
            );
        }
        let ring = KeyRing::parse(&key).unwrap();
        assert!(!format!("{ring:?}").contains("0707"), "{ring:?}");
        assert!(!format!("{ring:?}").contains("7, 7"), "{ring:?}");
    }

    #[test]
    fn a_file_that_changes_is_read_again_and_a_wrong_one_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        assert!(matches!(Keys::read(&path), Err(BadKeys::Unreadable(_))));
        let (line, first) = Keys::new_line().unwrap();
        std::fs::write(&path, &line).unwrap();
        let keys = Keys::read(&path).unwrap();
        assert_eq!(keys.current(), Some(first));
        std::fs::write(&path, "no key").unwrap();
        assert_eq!(keys.current(), Some(first));
        let (newer, second) = Keys::new_line().unwrap();
        assert_ne!(first, second);
        std::fs::write(&path, format!("{newer}{line}")).unwrap();
        assert_eq!(keys.current(), Some(second));
        assert!(keys.ring().find(first).is_some());
        std::fs::remove_file(&path).unwrap();
        assert_eq!(keys.current(), Some(second));
        assert_eq!(Keys::default().current(), None);
    }
}
