//! The variables of this process, with the secrets among them, which a program may have taken out of its environment.
//!
//! Whoever has the user of a process reads the environment that it was started with; removing a variable changes nothing
//! there. So the program starts itself again without its secrets and keeps them here.

use std::collections::HashMap;
use std::ffi::OsString;
use std::sync::OnceLock;

static SECRETS: OnceLock<HashMap<String, String>> = OnceLock::new();

/// Keeps variables that are in the environment no more. The first call counts.
pub fn keep_secrets(secrets: HashMap<String, String>) {
    let _kept_before = SECRETS.set(secrets);
}

pub fn variable(name: &str) -> Option<String> {
    let kept = SECRETS.get().and_then(|secrets| secrets.get(name));
    kept.cloned().or_else(|| std::env::var(name).ok())
}

/// All variables that are text.
pub(crate) fn variables() -> HashMap<String, String> {
    let as_text = |(name, value): (OsString, OsString)| {
        Some((name.into_string().ok()?, value.into_string().ok()?))
    };
    let mut variables: HashMap<_, _> = std::env::vars_os().filter_map(as_text).collect();
    variables.extend(SECRETS.get().cloned().unwrap_or_default());
    variables
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_secret_is_found_like_a_variable() {
        let secret = ("ISOCORTEX_TEST_SECRET".to_owned(), "kept".to_owned());
        keep_secrets(HashMap::from([secret.clone()]));
        assert_eq!(variable(&secret.0), Some(secret.1.clone()));
        assert_eq!(variables().get(&secret.0), Some(&secret.1));
        assert_eq!(variable("PATH"), std::env::var("PATH").ok());
        assert!(variables().contains_key("PATH"));
    }
}
