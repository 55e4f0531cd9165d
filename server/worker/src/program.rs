//! The program of confined processes.

use std::ffi::OsString;
use std::io;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};
use std::time::Duration;

use serde::de::DeserializeOwned;
use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::process::{Child, ChildStdin, ChildStdout};

use crate::SUBCOMMAND;
use crate::error::Error;
use crate::message::Order;

/// The greatest number of files or series to read at a time; each may need more memory than a volume.
const MOST_AT_A_TIME: usize = 4;

/// The longest answer on the standard output of a child, in bytes: that about a measurement report of 20,000 points with long
/// notes.
const MAX_ANSWER_BYTES: u64 = 16 << 20;

/// How long a process that has closed its output may take to end.
const ENDS_WITHIN: Duration = Duration::from_secs(1);

/// The program of the child: this program, except in tests.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Program(Option<(PathBuf, Vec<OsString>)>);

impl Program {
    /// Another program that calls [`crate::run_child`], with its arguments.
    pub fn other(program: PathBuf, arguments: Vec<OsString>) -> Self {
        Self(Some((program, arguments)))
    }

    /// The command, without environment.
    fn command(&self) -> io::Result<Command> {
        let mut command = match &self.0 {
            Some((program, arguments)) => {
                let mut command = Command::new(program);
                command.args(arguments);
                command
            }
            None => {
                let mut command = this_program()?;
                command.arg(SUBCOMMAND);
                command
            }
        };
        command
            // What a terminal or a supervisor sends to the group of the server, such as Ctrl-C, is for the server alone.
            .process_group(0)
            .env_clear()
            .current_dir("/")
            .stdin(Stdio::piped())
            .stderr(Stdio::null());
        Ok(command)
    }

    /// Starts the process. It is ended with its handle.
    pub(crate) fn start(&self, answers: Stdio) -> io::Result<Process> {
        let mut command = tokio::process::Command::from(self.command()?);
        let mut child = command.stdout(answers).kill_on_drop(true).spawn()?;
        Ok(Process {
            orders: child.stdin.take(),
            answers: child.stdout.take(),
            child,
        })
    }

    /// Starts the process for a thread that waits for it.
    pub(crate) fn start_now(&self) -> io::Result<std::process::Child> {
        self.command()?.stdout(Stdio::piped()).spawn()
    }
}

/// The program that runs here, even if its file was replaced since: an update does this under a running server.
fn this_program() -> io::Result<Command> {
    let file = std::env::current_exe()?;
    if cfg!(not(target_os = "linux")) {
        return Ok(Command::new(file));
    }
    let mut command = Command::new("/proc/self/exe");
    command.arg0(file);
    Ok(command)
}

pub(crate) struct Process {
    pub(crate) child: Child,
    orders: Option<ChildStdin>,
    answers: Option<ChildStdout>,
}

impl Process {
    /// Sends the order. If the child has already ended, its status tells why.
    pub(crate) async fn tell(&mut self, order: &Order) -> io::Result<()> {
        let mut line = serde_json::to_vec(order)?;
        line.push(b'\n');
        if let Some(mut orders) = self.orders.take() {
            let _ = orders.write_all(&line).await;
        }
        Ok(())
    }

    /// Whether it ended without an answer because it [was interrupted](was_interrupted).
    pub(crate) async fn was_interrupted(&mut self) -> bool {
        let ended = tokio::time::timeout(ENDS_WITHIN, self.child.wait()).await;
        matches!(ended, Ok(Ok(status)) if was_interrupted(status))
    }

    /// The answer on its standard output; `None` if it does not answer as it must.
    pub(crate) async fn ask<T: DeserializeOwned>(&mut self, order: &Order) -> Option<T> {
        self.tell(order).await.ok()?;
        let mut answers = BufReader::new(self.answers.take()?).take(MAX_ANSWER_BYTES);
        loop {
            let mut answer = String::new();
            if answers.read_line(&mut answer).await.ok()? == 0 {
                return None;
            }
            // Every answer begins a line; a test program says other things, too.
            if answer.starts_with('{') {
                return serde_json::from_str(&answer).ok();
            }
        }
    }
}

/// Whether a process was ended by a signal that asks for an end, as supervisors send it to all processes of a service that stops. The same
/// input may be right the next time.
pub(crate) fn was_interrupted(status: ExitStatus) -> bool {
    let signals = [libc::SIGTERM, libc::SIGINT, libc::SIGHUP];
    status
        .signal()
        .is_some_and(|signal| signals.contains(&signal))
}

/// How many files or series to read at a time: as many as there are CPUs, so that a slow one does not block the others.
pub fn at_a_time() -> usize {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    processors.clamp(2, MOST_AT_A_TIME)
}

pub(crate) fn cannot_run(error: io::Error) -> Error {
    tracing::error!(kind = %error.kind(), "cannot start the process that reads DICOM files");
    Error::NotRun
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_process_is_not_in_the_group_of_the_server() {
        let arguments = ["-c", "exec cat"].map(Into::into).into();
        let program = Program::other("/bin/sh".into(), arguments);
        let process = program.start(Stdio::null()).unwrap();
        let id = rustix::process::Pid::from_raw(process.child.id().unwrap() as i32);
        assert_eq!(rustix::process::getpgid(id).unwrap(), id.unwrap());
    }
}
