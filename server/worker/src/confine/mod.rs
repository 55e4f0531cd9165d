//! Confines this process to what it needs, before it looks at what a stranger sent.
//!
//! Code that takes such a process over through a damaged file finds no capability, no file but its own, no socket, and
//! no other process that it may look at. What the kernel lacks is left out, and the server says so when it starts.

use std::fmt;
use std::fs::File;
use std::io;
use std::os::fd::BorrowedFd;

use rustix::fs::{Mode, OFlags};
use rustix::process::{Resource, Rlimit, setrlimit};
use serde::{Deserialize, Serialize};

use case::Failure;

#[cfg(target_os = "linux")]
mod linux;
#[cfg(target_os = "linux")]
pub(crate) use linux::confine;
#[cfg(target_os = "linux")]
pub use linux::hide;

/// Files open at a time in a process with threads.
const OPEN_FILES: u64 = 64;

/// What a process needs after it is confined. Files that are open already stay open.
#[derive(Debug, Default)]
pub(crate) struct Needs<'a> {
    /// A directory to read.
    pub(crate) reads: Option<Directory<'a>>,
    /// An empty directory to write files into.
    pub(crate) writes: Option<BorrowedFd<'a>>,
    /// Whether it starts threads.
    pub(crate) threads: bool,
}

/// A directory to read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Directory<'a> {
    pub(crate) directory: BorrowedFd<'a>,
    /// Whether it was made for this process, so that it may be given to a user of its own with the files in it.
    pub(crate) is_own: bool,
}

/// What the kernel gave.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Confinement {
    /// Whether it can never gain a privilege.
    pub no_new_privileges: bool,
    /// Whether its user is no other process's.
    pub own_user: bool,
    /// Whether it opens no files but its own (Landlock).
    pub own_files: bool,
    /// Whether it makes no system calls but those that reading needs (seccomp).
    pub few_calls: bool,
}

/// Other code to run once this process is confined, in place of reading a series or preparing a case; it returns words about what it
/// reached. Tests have it.
pub(crate) type Instead<'a> = &'a mut dyn FnMut(&Confinement) -> String;

/// What other code has said, as a failure.
pub(crate) fn said(words: String) -> Failure {
    Failure::unusable("other-code", words)
}

impl Confinement {
    /// Whether nothing is missing that this program can have without being root.
    pub fn is_whole(&self) -> bool {
        self.no_new_privileges && self.own_files && self.few_calls
    }
}

impl fmt::Display for Confinement {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [
            (self.no_new_privileges, "no new privileges"),
            (self.own_files, "its own files only (Landlock)"),
            (self.few_calls, "few system calls (seccomp)"),
            (self.own_user, "a user of its own"),
        ];
        let words = |given: bool| {
            let parts = parts.iter().filter(|(is_given, _)| *is_given == given);
            parts.map(|(_, words)| *words).collect::<Vec<_>>()
        };
        let (given, missing) = (words(true), words(false));
        let given = match given.is_empty() {
            true => "nothing".to_owned(),
            false => given.join(", "),
        };
        formatter.write_str(&given)?;
        if !missing.is_empty() {
            write!(formatter, "; without {}", missing.join(", "))?;
        }
        Ok(())
    }
}

/// Limits of the kernel for a process with threads: memory that it may write, and CPU time of all threads together, after which
/// `SIGXCPU` ends it.
pub(crate) fn limit_data(bytes: u64, seconds: u64) -> io::Result<()> {
    let limits = [
        (Resource::Data, bytes, bytes),
        (Resource::Cpu, seconds, seconds.saturating_add(5)),
        (Resource::Nofile, OPEN_FILES, OPEN_FILES),
        // A core file would contain images of a patient.
        (Resource::Core, 0, 0),
    ];
    set_limits(&limits)
}

/// Sets limits of the kernel for this process: what it may use, and what it may at most permit itself. On other systems than
/// Linux, a limit that the kernel does not know is left out.
pub(crate) fn set_limits(limits: &[(Resource, u64, u64)]) -> io::Result<()> {
    for &(resource, current, maximum) in limits {
        let limit = Rlimit {
            current: Some(current),
            maximum: Some(maximum),
        };
        match setrlimit(resource, limit) {
            Err(rustix::io::Errno::INVAL) if cfg!(not(target_os = "linux")) => {}
            set => set?,
        }
    }
    Ok(())
}

/// A new file in a directory that was opened before this process was confined.
pub(crate) fn create_in(directory: &File, name: &str) -> io::Result<File> {
    let flags = OFlags::CREATE | OFlags::EXCL | OFlags::WRONLY | OFlags::CLOEXEC;
    let mode = Mode::RUSR | Mode::WUSR;
    Ok(rustix::fs::openat(directory, name, flags, mode)?.into())
}

/// Confines nothing: there are means for it on Linux alone.
#[cfg(not(target_os = "linux"))]
pub(crate) fn confine(_needs: &Needs<'_>) -> Confinement {
    Confinement::default()
}

/// Hides nothing: there are means for it on Linux alone.
#[cfg(not(target_os = "linux"))]
pub fn hide() {}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(own_files: bool, few_calls: bool) -> Confinement {
        Confinement {
            no_new_privileges: true,
            own_user: false,
            own_files,
            few_calls,
        }
    }

    #[test]
    fn what_the_kernel_gave_is_said_in_one_line() {
        assert_eq!(
            given(true, true).to_string(),
            "no new privileges, its own files only (Landlock), few system calls (seccomp); without a user of its own"
        );
        assert!(given(true, true).is_whole(), "only root may change users");
        assert!(!given(false, true).is_whole());
        assert!(!given(true, false).is_whole());
    }
}
