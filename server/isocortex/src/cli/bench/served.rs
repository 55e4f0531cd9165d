//! This program, serving in a process of its own.

use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use measure::memory_of;

use crate::cli::status::{CliError, ExitStatus};

/// What the server prints before its address.
const ANNOUNCEMENT: &str = "listens on http://";

/// Units of the processor times in Linux's `/proc/PID/stat`, a second.
const TICKS: f64 = 100.0;

/// A server process; it ends when this is dropped.
#[derive(Debug)]
pub(super) struct Served {
    child: Child,
    /// Where it listens.
    pub(super) address: SocketAddr,
    /// Time from the start of the process until it said so, in seconds.
    pub(super) start_s: f64,
}

impl Served {
    /// Starts this program on the store of a directory and waits until it listens.
    pub(super) fn start(directory: &Path) -> Result<Self, CliError> {
        let failed = |error: &dyn std::fmt::Display| {
            let message = format!("the server cannot be started: {error}");
            CliError::new(ExitStatus::Unavailable, message)
        };
        let program = std::env::current_exe().map_err(|error| failed(&error))?;
        let begin = Instant::now();
        let mut command = Command::new(program);
        for (name, _) in std::env::vars_os() {
            // What the user's own server is told is not for this one.
            if name.to_string_lossy().starts_with("ISOCORTEX_") {
                command.env_remove(name);
            }
        }
        let mut child = command
            .args(["serve", "--listen", "127.0.0.1:0", "--log", "error"])
            .args(["--gpu", "off", "--data"])
            .arg(directory)
            .stdout(Stdio::piped())
            .stdin(Stdio::null())
            .spawn()
            .map_err(|error| failed(&error))?;
        let lines = child.stdout.take().map(BufReader::new);
        let address = lines.into_iter().flat_map(BufRead::lines).find_map(|line| {
            let line = line.ok()?;
            let (_, address) = line.split_once(ANNOUNCEMENT)?;
            address.trim().parse().ok()
        });
        let start_s = begin.elapsed().as_secs_f64();
        match address {
            Some(address) => Ok(Self {
                child,
                address,
                start_s,
            }),
            None => {
                end(&mut child);
                Err(failed(&"it did not say where it listens"))
            }
        }
    }

    /// Memory that it holds, in MiB, where the system tells.
    pub(super) fn memory_mib(&self) -> Option<f64> {
        memory_of(&self.child.id().to_string(), "VmRSS:")
    }

    /// The most memory that it held, in MiB, where the system tells.
    pub(super) fn peak_memory_mib(&self) -> Option<f64> {
        memory_of(&self.child.id().to_string(), "VmHWM:")
    }

    /// Processor time that it took so far, in seconds, where the system tells.
    pub(super) fn cpu_s(&self) -> Option<f64> {
        let text = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id())).ok()?;
        // The name, in parentheses, may hold anything; user and system time are the 12th and 13th word after it.
        let (_, after) = text.rsplit_once(')')?;
        let words = after.split_whitespace().skip(11).take(2);
        let ticks: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
        Some(ticks?.iter().sum::<f64>() / TICKS)
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

fn end(child: &mut Child) {
    // It may have ended by itself.
    let _ = child.kill();
    let _ = child.wait();
}
