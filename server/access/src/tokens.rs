//! Named tokens: who a request is from, what it may do, and until when.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::SystemTime;

use crate::scopes::Scope;

/// A token that is known by its digest. The token itself is nowhere but with its holder: it is random and long, so its
/// plain digest tells nothing of it.
#[derive(Debug, Clone)]
pub struct NamedToken {
    pub holder: Holder,
    /// The BLAKE3 digest of its characters.
    pub digest: blake3::Hash,
    /// When it ends; `None`: never.
    pub ends: Option<SystemTime>,
}

/// Who holds a token, and what it may be used for. Handlers find it in the extensions of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holder {
    /// The name of the token.
    pub name: Arc<str>,
    /// What it may be used for.
    pub scopes: BTreeSet<Scope>,
}

/// The name of the token without a name, which no other token may have.
pub const UNNAMED: &str = "token";

/// The name of everybody on this machine, if no token is required.
pub const ANYBODY: &str = "anybody";

/// What the names of those begin with whom a proxy has signed in, so that none is the name of a token.
pub const PROXY_PREFIX: &str = "proxy:";

/// The greatest length of a name of somebody else's that is shown as it is.
const LONGEST_NAME: usize = 128;

/// The length of a digest that stands for a name.
const DIGEST_DIGITS: usize = 32;

/// A name for the record of somebody whom others know: the name that they state, if it is a plain word, otherwise its digest. What it begins with
/// makes it differ from the names of tokens and the titles of peers. A name that could be a digest is not shown as it is, so that nobody has the
/// name of somebody else.
pub(crate) fn name_by(prefix: &str, stated: &[u8]) -> Arc<str> {
    let is_plain = stated.iter().all(u8::is_ascii_graphic);
    if is_plain && !is_digest(stated) && stated.len() <= LONGEST_NAME {
        return format!("{prefix}{}", String::from_utf8_lossy(stated)).into();
    }
    let digest = blake3::hash(stated).to_hex();
    format!("{prefix}{}", &digest[..DIGEST_DIGITS]).into()
}

/// Whether a name looks like a digest, as no name does that is shown as it is.
fn is_digest(stated: &[u8]) -> bool {
    stated.len() == DIGEST_DIGITS && stated.iter().all(u8::is_ascii_hexdigit)
}

impl Holder {
    /// Whether it is one person or program, and not everybody who has the token without a name, or is on this machine.
    pub fn is_named(&self) -> bool {
        ![ANYBODY, UNNAMED].contains(&&*self.name)
    }

    /// Whether people can read the name: a proxy may have stated one of which only the digest is known here.
    pub fn is_readable(&self) -> bool {
        let stated = self.name.strip_prefix(PROXY_PREFIX);
        !stated.is_some_and(|stated| is_digest(stated.as_bytes()))
    }

    /// The holder of a token without a name, who may do everything.
    pub(crate) fn of_everything() -> Self {
        Self::named_of_everything(UNNAMED)
    }

    /// Everybody on this machine.
    pub(crate) fn anybody() -> Self {
        Self::named_of_everything(ANYBODY)
    }

    fn named_of_everything(name: &str) -> Self {
        Self {
            name: name.into(),
            scopes: Scope::ALL.into(),
        }
    }
}

/// Why a token does not open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mismatch {
    Unknown,
    Ended,
}

/// All tokens that open.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tokens(Vec<NamedToken>);

impl Tokens {
    pub(crate) fn new(tokens: Vec<NamedToken>) -> Self {
        Self(tokens)
    }

    /// When the next of them ends that has not ended yet.
    pub(crate) fn next_end(&self) -> Option<SystemTime> {
        let now = SystemTime::now();
        let ends = self.0.iter().filter_map(|token| token.ends);
        ends.filter(|&end| end > now).min()
    }

    /// The given token, if it opens.
    pub(crate) fn open(&self, given: &[u8]) -> Result<&NamedToken, Mismatch> {
        self.with_digest(&blake3::hash(given))
    }

    /// The token with a digest, if it opens. Digests are compared in constant time.
    pub(crate) fn with_digest(&self, digest: &blake3::Hash) -> Result<&NamedToken, Mismatch> {
        let found = self.0.iter().find(|token| token.digest == *digest);
        let token = found.ok_or(Mismatch::Unknown)?;
        match token.ends {
            Some(end) if SystemTime::now() >= end => Err(Mismatch::Ended),
            _ => Ok(token),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_name_that_is_stated_is_nobody_elses() {
        let named = |stated: &str| name_by("proxy:", stated.as_bytes());
        assert_eq!(&*named("u-17"), "proxy:u-17");
        let long = named(&"x".repeat(500));
        let digest = long.strip_prefix("proxy:").unwrap();
        assert_eq!(digest.len(), DIGEST_DIGITS);
        // Somebody who is called like the digest of somebody else.
        assert_ne!(named(digest), long);
        assert_ne!(named("two words"), named("two  words"));
        let is_readable = |name: &str| {
            let scopes = BTreeSet::new();
            let name = name.into();
            Holder { name, scopes }.is_readable()
        };
        assert!(is_readable("proxy:u-17") && !is_readable(&named("João da Silva")));
        // A token may be named as its owner likes.
        assert!(is_readable(digest));
    }

    fn token(name: &str, text: &str, ends: Option<SystemTime>) -> NamedToken {
        NamedToken {
            holder: Holder {
                name: name.into(),
                scopes: [Scope::Read].into(),
            },
            digest: blake3::hash(text.as_bytes()),
            ends,
        }
    }

    #[test]
    fn a_token_tells_its_holder_until_it_ends() {
        let now = SystemTime::now();
        let tokens = Tokens::new(vec![
            token("reader", "a", None),
            token("guest", "b", Some(now - Duration::from_secs(1))),
            token("locum", "c", Some(now + Duration::from_secs(3600))),
        ]);
        let opens = |given: &[u8]| tokens.open(given).map(|token| &*token.holder.name);
        assert_eq!(opens(b"a"), Ok("reader"));
        assert_eq!(opens(b"b"), Err(Mismatch::Ended));
        assert_eq!(opens(b"c"), Ok("locum"));
        assert_eq!(opens(b"d"), Err(Mismatch::Unknown));
        assert!(Tokens::default().open(b"a").is_err());
        assert_eq!(tokens.next_end(), Some(now + Duration::from_secs(3600)));
        assert_eq!(Tokens::default().next_end(), None);
    }
}
