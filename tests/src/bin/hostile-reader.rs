//! The process that reads DICOM files, or prepares a case, taken over: once it has confined itself, it tries to reach what is not its own.
//!
//! It is built for the tests alone. `hostile-reader read …` stands for the server and starts `hostile-reader child …`;
//! `hostile-reader control …` tries the same without being confined.

use std::fs::{File, OpenOptions};
use std::io::{self, IoSliceMut, Read as _};
use std::net::{TcpStream, UdpSocket};
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use cases::dicom::{DicomReader, Input, Options, Program};
use imaging::Limits;
use nix::sys::uio::RemoteIoVec;
use nix::unistd::Pid;

/// A file that the server has inherited, by its number; to close it is to reach it.
const INHERITED: i32 = 9;

/// What is not the child's.
struct Targets {
    /// The store of the server.
    store: PathBuf,
    /// The file of the next patient, which lies beside the child's own.
    next: PathBuf,
    /// The server, its port, and the process that started this one, which this one may not ask for.
    server: i32,
    port: u16,
    parent: i32,
}

impl Targets {
    fn parse(arguments: &[String]) -> Option<Self> {
        let [store, next, server, port, parent] = arguments else {
            return None;
        };
        Some(Self {
            store: store.into(),
            next: next.into(),
            server: server.parse().ok()?,
            port: port.parse().ok()?,
            parent: parent.parse().ok()?,
        })
    }

    fn arguments(&self) -> Vec<std::ffi::OsString> {
        let numbers = [self.server, i32::from(self.port), self.parent];
        let numbers = numbers.map(|number| number.to_string());
        let paths = [self.store.clone().into(), self.next.clone().into()];
        paths.into_iter().chain(numbers.map(Into::into)).collect()
    }

    /// Tries everything. A line for each attempt says `reached` or why not.
    fn attack(&self) -> Vec<String> {
        let mut lines = Vec::new();
        let mut tried = |what: &str, tried: io::Result<()>| {
            let result = match tried {
                Ok(()) => "reached".to_owned(),
                Err(error) => format!("{:?}", error.kind()),
            };
            lines.push(format!("{what}={result}"));
        };
        for (who, process) in [("server", self.server), ("parent", self.parent)] {
            let file = |name| PathBuf::from(format!("/proc/{process}/{name}"));
            tried(&format!("environment-of-{who}"), read(&file("environ")));
            tried(
                &format!("memory-of-{who}"),
                File::open(file("mem")).map(drop),
            );
            tried(&format!("maps-of-{who}"), read(&file("maps")));
            tried(&format!("open-files-of-{who}"), list(&file("fd")));
            tried(&format!("root-of-{who}"), list(&file("root/etc")));
            let process = Pid::from_raw(process);
            tried(&format!("vm-of-{who}"), read_memory(process));
            tried(
                &format!("signal-to-{who}"),
                plain(nix::sys::signal::kill(process, None)),
            );
        }
        tried("trace-of-server", trace(Pid::from_raw(self.server)));
        tried("store-list", list(&self.store));
        tried("store-rows", read(&self.store.join("rows.sqlite")));
        tried("store-write", write(&self.store.join("intruder")));
        tried("next-read", read(&self.next));
        tried("next-write", append(&self.next));
        let beside = Path::new("..");
        tried("beside-list", list(beside));
        if let Some(name) = self.next.file_name() {
            tried("beside-read", read(&beside.join(name)));
        }
        tried("passwords", read(Path::new("/etc/passwd")));
        tried(
            "temporary",
            write(&std::env::temp_dir().join(format!("intruder-{}", std::process::id()))),
        );
        tried(
            "network-tcp",
            TcpStream::connect(("127.0.0.1", self.port)).map(drop),
        );
        tried("network-udp", UdpSocket::bind("127.0.0.1:0").map(drop));
        let name = SocketAddr::from_abstract_name(format!("isocortex-{}", self.server));
        let connected = name.and_then(|name| UnixStream::connect_addr(&name));
        tried("network-unix", connected.map(drop));
        let inherited = nix::unistd::close(INHERITED);
        tried("inherited-file", plain(inherited));
        tried("process", Command::new("/bin/true").status().map(drop));
        tried("thread", std::thread::Builder::new().spawn(|| {}).map(drop));
        tried(
            "root",
            plain(nix::unistd::setuid(nix::unistd::Uid::from_raw(0))),
        );
        lines
    }
}

fn plain<T>(result: nix::Result<T>) -> io::Result<()> {
    result.map(drop).map_err(io::Error::from)
}

fn read(path: &Path) -> io::Result<()> {
    File::open(path)?.read_to_end(&mut Vec::new()).map(drop)
}

fn list(path: &Path) -> io::Result<()> {
    std::fs::read_dir(path)?.for_each(drop);
    Ok(())
}

fn write(path: &Path) -> io::Result<()> {
    std::fs::write(path, "intruder")?;
    std::fs::remove_file(path)
}

fn append(path: &Path) -> io::Result<()> {
    OpenOptions::new().append(true).open(path).map(drop)
}

/// Reads from an address where programs begin; another error than `EFAULT` says that the memory is closed.
fn read_memory(process: Pid) -> io::Result<()> {
    let mut bytes = [0; 8];
    let from = [RemoteIoVec {
        base: 0x40_0000,
        len: bytes.len(),
    }];
    match nix::sys::uio::process_vm_readv(process, &mut [IoSliceMut::new(&mut bytes)], &from) {
        Ok(_) | Err(nix::Error::EFAULT) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

fn trace(process: Pid) -> io::Result<()> {
    nix::sys::ptrace::seize(process, nix::sys::ptrace::Options::empty())?;
    // A tracee cannot be let go while it runs; it is when this process ends.
    Ok(())
}

/// In place of reading a series or preparing a case.
fn child(targets: &Targets) -> ExitCode {
    worker::run_instead(|confinement| {
        let mut lines = targets.attack();
        // If it succeeded, there would be no outcome.
        let error = Command::new("/bin/true").exec();
        lines.push(format!("program={:?}", error.kind()));
        format!(
            "no-new-privileges={} own-user={} own-files={} few-calls={} {}",
            confinement.no_new_privileges,
            confinement.own_user,
            confinement.own_files,
            confinement.few_calls,
            lines.join(" ")
        )
    })
}

/// Reads one file, and a directory of files, and prepares a case, as the server does, in a process that is taken over.
async fn server(targets: &Targets) -> io::Result<()> {
    let scratch = tempfile::tempdir_in(&targets.store)?;
    let own = scratch.path().join("own");
    std::fs::write(&own, "the file of this patient")?;
    let next = scratch.path().join("next");
    std::fs::write(&next, "the file of the next patient")?;
    let targets = Targets {
        next,
        store: targets.store.clone(),
        parent: std::process::id().cast_signed(),
        ..*targets
    };
    let arguments = ["child".into()].into_iter().chain(targets.arguments());
    let program = Program::other(std::env::current_exe()?, arguments.collect());
    let reader = DicomReader::new(program.clone(), Limits::default(), 1 << 20);
    let directory = tempfile::tempdir_in(scratch.path())?;
    std::fs::write(directory.path().join("0"), "a file of this patient")?;
    for input in [Input::Path(&own), Input::Directory(&directory)] {
        match reader
            .read(input, &Options::default(), scratch.path())
            .await
        {
            Err(error) => println!("{error}"),
            Ok(_) => println!("it was read"),
        }
    }
    match worker::prepare_by(program, "the volume of this patient".into(), scratch.path()) {
        Err(failure) => println!("{}", failure.detail),
        Ok(_) => println!("it was prepared"),
    }
    Ok(())
}

/// Whether the kernel has Landlock, not asked by the code that is tested.
fn has_landlock() -> bool {
    use landlock::{
        ABI, Access as _, AccessFs, CompatLevel, Compatible as _, Ruleset, RulesetAttr as _,
    };
    let rules = Ruleset::default().set_compatibility(CompatLevel::HardRequirement);
    let rules = rules.handle_access(AccessFs::from_all(ABI::V1));
    rules.and_then(Ruleset::create).is_ok()
}

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let Some((role, rest)) = arguments.split_first() else {
        return ExitCode::FAILURE;
    };
    let Some(targets) = Targets::parse(rest) else {
        return ExitCode::FAILURE;
    };
    match role.as_str() {
        "child" => child(&targets),
        "control" => {
            // Somebody listens, so that a connection can be made.
            let name = SocketAddr::from_abstract_name(format!("isocortex-{}", targets.server));
            let _listener = name.and_then(|name| UnixListener::bind_addr(&name));
            println!("{}", targets.attack().join(" "));
            ExitCode::SUCCESS
        }
        "read" => {
            // As the server does.
            worker::hide();
            println!("landlock={}", has_landlock());
            let runtime = tokio::runtime::Builder::new_multi_thread()
                .enable_all()
                .build();
            match runtime.and_then(|runtime| runtime.block_on(server(&targets))) {
                Ok(()) => ExitCode::SUCCESS,
                Err(_) => ExitCode::FAILURE,
            }
        }
        _ => ExitCode::FAILURE,
    }
}
