//! The program starts itself again, in the same process, to change its environment.
//!
//! **Secrets leave it.** Whoever has the user of a process reads its environment in `/proc`, and removing a variable changes
//! nothing there. The secrets go through a pipe, which is the standard input of the program that is started.
//!
//! **Large blocks of memory are returned to the system as soon as they are freed.** The allocator of glibc does so only above
//! a threshold, which it raises to the size of the largest block that was freed. Below it, blocks of many megabytes stay in
//! its arenas, of which a server has one for each of its first threads: after eight heads of 1 mm, 256 MB instead of 55 MB
//! with a threshold of 256 KiB. A threshold from the environment is never raised; calling the allocator itself would be
//! unsafe code.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::os::unix::process::CommandExt as _;
use std::process::Command;

use storage::environment::keep_secrets;

/// Smaller blocks stay in the arenas, in bytes.
const THRESHOLD: (&str, &str) = ("MALLOC_MMAP_THRESHOLD_", "1048576");

/// The variable that says that the secrets are on the standard input.
const ON_STDIN: &str = "ISOCORTEX_SECRETS_ON_STDIN";

/// What a pipe holds before somebody reads it.
const MAX_SECRETS_BYTES: usize = 60 << 10;

/// Whether the value of a variable is a secret: a token, a password, or an address that may contain one.
fn is_secret(name: &str) -> bool {
    let is_of_bucket = || {
        name.starts_with("AWS_")
            && !name.ends_with("_FILE")
            && ["KEY", "SECRET", "TOKEN"]
                .iter()
                .any(|word| name.contains(word))
    };
    matches!(
        name,
        "ISOCORTEX_TOKEN" | "ISOCORTEX_DATABASE" | "PGPASSWORD"
    ) || is_of_bucket()
}

/// Takes the secrets that the program before this one passed. Call it before anything else.
///
/// # Errors
/// If they were announced and cannot be read.
pub fn take_secrets() -> io::Result<()> {
    if std::env::var_os(ON_STDIN).is_none() {
        return Ok(());
    }
    let mut passed = Vec::new();
    io::stdin().lock().read_to_end(&mut passed)?;
    rustix::stdio::dup2_stdin(File::open("/dev/null")?)?;
    keep_secrets(serde_json::from_slice(&passed)?);
    Ok(())
}

/// Starts the program again if the environment has a secret, or if it lacks the threshold of memory and `returns_blocks`.
///
/// # Errors
/// If the system refuses. Without a secret, the program then continues as it is.
pub fn start_again(returns_blocks: bool) -> io::Result<()> {
    let secrets: HashMap<String, String> = std::env::vars_os()
        .filter_map(|(name, value)| Some((name.into_string().ok()?, value)))
        .filter(|(name, _)| is_secret(name))
        .map(|(name, value)| (name, value.to_string_lossy().into_owned()))
        .collect();
    let sets_threshold = returns_blocks
        && cfg!(all(target_os = "linux", target_env = "gnu"))
        && std::env::var_os(THRESHOLD.0).is_none();
    let mut arguments = std::env::args_os();
    let (Some(name_of_program), true) = (arguments.next(), sets_threshold || !secrets.is_empty())
    else {
        return Ok(());
    };
    let mut command = Command::new(std::env::current_exe()?);
    command.arg0(name_of_program).args(arguments);
    if sets_threshold {
        command.env(THRESHOLD.0, THRESHOLD.1);
    }
    if secrets.is_empty() {
        // It returns only if it fails.
        let _refused = command.exec();
        return Ok(());
    }
    let passed = serde_json::to_vec(&secrets)?;
    if passed.len() > MAX_SECRETS_BYTES {
        return Err(io::ErrorKind::ArgumentListTooLong.into());
    }
    let (reader, mut writer) = io::pipe()?;
    writer.write_all(&passed)?;
    drop(writer);
    for name in secrets.keys() {
        command.env_remove(name);
    }
    Err(command.env(ON_STDIN, "1").stdin(reader).exec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_passwords_and_keys_are_secrets_and_names_of_files_are_not() {
        for name in [
            "ISOCORTEX_TOKEN",
            "ISOCORTEX_DATABASE",
            "PGPASSWORD",
            "AWS_ACCESS_KEY_ID",
            "AWS_SECRET_ACCESS_KEY",
            "AWS_SESSION_TOKEN",
            "AWS_SSE_CUSTOMER_KEY_BASE64",
        ] {
            assert!(is_secret(name), "{name}");
        }
        for name in [
            "ISOCORTEX_TOKEN_FILE",
            "ISOCORTEX_DATA",
            "PGHOST",
            "AWS_ENDPOINT_URL",
            "AWS_SHARED_CREDENTIALS_FILE",
            "AWS_WEB_IDENTITY_TOKEN_FILE",
            "PATH",
        ] {
            assert!(!is_secret(name), "{name}");
        }
    }
}
