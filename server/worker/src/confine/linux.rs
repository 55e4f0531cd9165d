//! What Linux gives to confine a process.

use std::collections::BTreeMap;
use std::os::fd::BorrowedFd;

use landlock::{
    ABI, Access as _, AccessFs, AccessNet, PathBeneath, Ruleset, RulesetAttr as _,
    RulesetCreatedAttr as _, RulesetError, RulesetStatus, Scope,
};
use rustix::fs::{Gid, Uid};
use rustix::process::{DumpableBehavior, Signal};
use rustix::thread::{CapabilitySet, CapabilitySets};
use seccompiler::{
    BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition, SeccompFilter,
    SeccompRule, TargetArch,
};

use super::{Confinement, Directory, Needs};

/// The first user of confined processes of a server that runs as root: each process adds its number. Accounts, systemd
/// and containers leave these numbers free.
const OWN_USERS: u32 = 2_000_000_000;

/// The user `nobody`, where a user namespace has no number as large.
const NOBODY: u32 = 65_534;

/// The error of a forbidden system call.
const FORBIDDEN: u32 = libc::EPERM.unsigned_abs();

/// Confines this thread, and those that it starts from now on, for the rest of the process.
pub(crate) fn confine(needs: &Needs<'_>) -> Confinement {
    hide();
    let own_user = take_own_user(needs);
    let keeps = match needs.reads {
        // Its user may read the files of a folder only as root.
        Some(Directory { is_own: false, .. }) if !own_user => CapabilitySet::DAC_READ_SEARCH,
        _ => CapabilitySet::empty(),
    };
    drop_capabilities(keeps);
    // A change of the user undoes both.
    hide();
    let _refused = rustix::process::set_parent_process_death_signal(Some(Signal::KILL));
    let no_new_privileges = rustix::thread::set_no_new_privs(true).is_ok();
    let own_files = keep_to_own_files(needs).unwrap_or(false);
    // It is the last, because it forbids the calls of the others.
    let few_calls = no_new_privileges && keep_to_few_calls(needs.threads);
    Confinement {
        no_new_privileges,
        own_user,
        own_files,
        few_calls,
    }
}

/// Makes the memory and the environment of this process unreadable for others of the same user, in `/proc` and by `ptrace`.
pub fn hide() {
    let _refused = rustix::process::set_dumpable_behavior(DumpableBehavior::NotDumpable);
}

/// Takes a user that no other process has; `false` unless this process is root and the directories can be given away.
fn take_own_user(needs: &Needs<'_>) -> bool {
    // With the last, the server still removes what it gave away.
    let may = CapabilitySet::SETUID
        | CapabilitySet::SETGID
        | CapabilitySet::CHOWN
        | CapabilitySet::DAC_OVERRIDE;
    let has = rustix::thread::capabilities(None).is_ok_and(|sets| sets.effective.contains(may));
    let keeps = matches!(needs.reads, Some(Directory { is_own: false, .. }));
    if !has || keeps || !rustix::process::geteuid().is_root() {
        return false;
    }
    let own = OWN_USERS.saturating_add(std::process::id());
    let mut users = [own, NOBODY].into_iter();
    users.any(|user| become_user(user, needs).is_ok())
}

fn become_user(user: u32, needs: &Needs<'_>) -> rustix::io::Result<()> {
    let (uid, gid) = (Uid::from_raw(user), Gid::from_raw(user));
    let give = |file: BorrowedFd<'_>| rustix::fs::fchown(file, Some(uid), Some(gid));
    if let Some(Directory { directory, .. }) = needs.reads {
        for entry in rustix::fs::Dir::read_from(directory)? {
            let entry = entry?;
            let follow = rustix::fs::AtFlags::SYMLINK_NOFOLLOW;
            let name = entry.file_name();
            if name.to_bytes() != b".." {
                rustix::fs::chownat(directory, name, Some(uid), Some(gid), follow)?;
            }
        }
    }
    needs.writes.map(give).transpose()?;
    rustix::thread::set_thread_groups(&[])?;
    rustix::thread::set_thread_res_gid(gid, gid, gid)?;
    rustix::thread::set_thread_res_uid(uid, uid, uid)
}

fn drop_capabilities(except: CapabilitySet) {
    let _none = rustix::thread::clear_ambient_capability_set();
    let Ok(before) = rustix::thread::capabilities(None) else {
        return;
    };
    let left = before.permitted & except;
    let sets = CapabilitySets {
        effective: left,
        permitted: left,
        inheritable: CapabilitySet::empty(),
    };
    let _refused = rustix::thread::set_capabilities(None, sets);
}

/// Leaves this process the directories that it needs, and no network. An older kernel gives less of it, but never the
/// file of another.
fn keep_to_own_files(needs: &Needs<'_>) -> Result<bool, RulesetError> {
    let rules = Ruleset::default()
        .handle_access(AccessFs::from_all(ABI::V5))?
        .handle_access(AccessNet::from_all(ABI::V4))?
        .scope(Scope::from_all(ABI::V6))?;
    let mut rules = rules.create()?;
    if let Some(Directory { directory, .. }) = needs.reads {
        let access = AccessFs::ReadFile | AccessFs::ReadDir;
        rules = rules.add_rule(PathBeneath::new(directory, access))?;
    }
    if let Some(directory) = needs.writes {
        let access = AccessFs::WriteFile | AccessFs::MakeReg | AccessFs::Truncate;
        rules = rules.add_rule(PathBeneath::new(directory, access))?;
    }
    Ok(rules.restrict_self()?.ruleset != RulesetStatus::NotEnforced)
}

/// Forbids all system calls but a few.
fn keep_to_few_calls(threads: bool) -> bool {
    let Some([first, second]) = filters(threads) else {
        return false;
    };
    let apply = |filter: &BpfProgram| seccompiler::apply_filter(filter).is_ok();
    (!threads || apply(&first)) && apply(&second)
}

/// What threads need first, and what is allowed at all; `None` on a processor for which there is no filter.
fn filters(threads: bool) -> Option<[BpfProgram; 2]> {
    let processor = TargetArch::try_from(std::env::consts::ARCH).ok()?;
    // `clone3` hides its flags from the filter; the C library uses `clone` where the kernel does not know it.
    let unknown = SeccompFilter::new(
        BTreeMap::from([(libc::SYS_clone3, Vec::new())]),
        SeccompAction::Allow,
        SeccompAction::Errno(libc::ENOSYS.unsigned_abs()),
        processor,
    );
    let mut allowed = allowed_calls()?;
    if threads {
        allowed.extend(calls_of_threads()?);
    }
    let few = SeccompFilter::new(
        allowed,
        SeccompAction::Errno(FORBIDDEN),
        SeccompAction::Allow,
        processor,
    );
    Some([unknown.ok()?.try_into().ok()?, few.ok()?.try_into().ok()?])
}

/// The system calls that start a thread of this process, but no other process.
fn calls_of_threads() -> Option<BTreeMap<i64, Vec<SeccompRule>>> {
    let thread = u64::from(libc::CLONE_THREAD.unsigned_abs());
    let is_thread = only(0, SeccompCmpOp::MaskedEq(thread), thread)?;
    let names = u64::from(libc::PR_SET_NAME.unsigned_abs());
    Some(BTreeMap::from([
        (libc::SYS_clone, vec![is_thread]),
        (libc::SYS_clone3, Vec::new()),
        (libc::SYS_prctl, vec![only(0, SeccompCmpOp::Eq, names)?]),
        (libc::SYS_set_robust_list, Vec::new()),
        (libc::SYS_rseq, Vec::new()),
    ]))
}

/// The system calls for reading, writing and creating files, memory, time and the end: no process, no program, no socket,
/// no signal to others, no memory that can be executed.
fn allowed_calls() -> Option<BTreeMap<i64, Vec<SeccompRule>>> {
    let mut calls: BTreeMap<i64, Vec<SeccompRule>> = ALWAYS
        .iter()
        .chain(OLD)
        .map(|&call| (call, Vec::new()))
        .collect();
    let bits = SeccompCmpOp::MaskedEq;
    let executable = bits(u64::from(libc::PROT_EXEC.unsigned_abs()));
    calls.insert(libc::SYS_mmap, vec![only(2, executable.clone(), 0)?]);
    calls.insert(libc::SYS_mprotect, vec![only(2, executable, 0)?]);
    let itself = u64::from(std::process::id());
    calls.insert(libc::SYS_tgkill, vec![only(0, SeccompCmpOp::Eq, itself)?]);
    calls.insert(libc::SYS_prlimit64, vec![only(2, SeccompCmpOp::Eq, 0)?]);
    let about_files = [
        libc::F_DUPFD_CLOEXEC,
        libc::F_GETFD,
        libc::F_SETFD,
        libc::F_GETFL,
    ];
    let each = about_files.map(|what| only(1, SeccompCmpOp::Eq, u64::from(what.unsigned_abs())));
    calls.insert(libc::SYS_fcntl, each.into_iter().collect::<Option<_>>()?);
    Some(calls)
}

/// A rule about one argument.
fn only(argument: u8, is: SeccompCmpOp, value: u64) -> Option<SeccompRule> {
    let condition = SeccompCondition::new(argument, SeccompCmpArgLen::Qword, is, value);
    SeccompRule::new(vec![condition.ok()?]).ok()
}

const ALWAYS: &[i64] = &[
    // Files.
    libc::SYS_read,
    libc::SYS_readv,
    libc::SYS_pread64,
    libc::SYS_write,
    libc::SYS_writev,
    libc::SYS_pwrite64,
    libc::SYS_lseek,
    libc::SYS_openat,
    libc::SYS_close,
    libc::SYS_fstat,
    libc::SYS_newfstatat,
    libc::SYS_statx,
    libc::SYS_getdents64,
    libc::SYS_ftruncate,
    // Memory.
    libc::SYS_brk,
    libc::SYS_munmap,
    libc::SYS_mremap,
    libc::SYS_madvise,
    // Time, chance and this process itself.
    libc::SYS_clock_gettime,
    libc::SYS_gettimeofday,
    libc::SYS_nanosleep,
    libc::SYS_clock_nanosleep,
    libc::SYS_getrandom,
    libc::SYS_futex,
    libc::SYS_sched_yield,
    libc::SYS_sched_getaffinity,
    libc::SYS_sysinfo,
    libc::SYS_getpid,
    libc::SYS_gettid,
    libc::SYS_restart_syscall,
    // Signals to itself, such as that of `abort`, and the end.
    libc::SYS_rt_sigaction,
    libc::SYS_rt_sigprocmask,
    libc::SYS_rt_sigreturn,
    libc::SYS_sigaltstack,
    libc::SYS_exit,
    libc::SYS_exit_group,
];

/// The same under older names, which musl uses.
#[cfg(target_arch = "x86_64")]
const OLD: &[i64] = &[libc::SYS_open, libc::SYS_stat, libc::SYS_lstat];

#[cfg(not(target_arch = "x86_64"))]
const OLD: &[i64] = &[];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_can_be_made_and_has_no_call_that_leaves_the_process() {
        for threads in [false, true] {
            let filters = filters(threads).unwrap();
            assert!(filters.iter().all(|filter| !filter.is_empty()));
        }
        let allowed = allowed_calls().unwrap();
        for call in [
            libc::SYS_socket,
            libc::SYS_socketpair,
            libc::SYS_connect,
            libc::SYS_ptrace,
            libc::SYS_process_vm_readv,
            libc::SYS_process_vm_writev,
            libc::SYS_execve,
            libc::SYS_execveat,
            libc::SYS_clone,
            libc::SYS_clone3,
            libc::SYS_kill,
            libc::SYS_pidfd_getfd,
            libc::SYS_io_uring_setup,
            libc::SYS_bpf,
            libc::SYS_unshare,
            libc::SYS_mount,
        ] {
            assert!(!allowed.contains_key(&call), "{call}");
        }
    }
}
