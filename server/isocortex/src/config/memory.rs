//! How much memory the system gives to this process and its children.

use std::path::Path;

/// What a process needs beside its children and what is kept of cases, in bytes.
pub(super) const REST: u64 = 512 << 20;

/// Larger limits of the first version of cgroups mean that there is none.
const NONE: u64 = 1 << 60;

/// The limit of the cgroup of this process, if it has one: that of its container, as a rule.
pub(super) fn limit() -> Option<u64> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    limit_of(&groups, Path::new("/sys/fs/cgroup"))
}

/// The limit of the addresses of this process (`ulimit -v`), if it has one.
pub(super) fn of_process() -> Option<u64> {
    rustix::process::getrlimit(rustix::process::Resource::As).current
}

/// The memory of the machine, if the kernel states it.
pub(super) fn of_machine() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let kilobytes = text.strip_prefix("MemTotal:")?.split_whitespace().next()?;
    kilobytes.parse::<u64>().ok()?.checked_mul(1024)
}

/// The lowest limit of a group and those above it. `groups` is the text of cgroups(7) in `/proc`.
fn limit_of(groups: &str, mounted: &Path) -> Option<u64> {
    let mut lowest = None;
    for line in groups.lines() {
        let mut fields = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (fields.next(), fields.next()) else {
            continue;
        };
        let (root, file) = match controllers.split(',').any(|name| name == "memory") {
            true => (mounted.join("memory"), "memory.limit_in_bytes"),
            false if controllers.is_empty() => (mounted.to_owned(), "memory.max"),
            false => continue,
        };
        // A container sees its own group as the root, whatever its path is.
        for group in Path::new(path.trim_start_matches('/')).ancestors() {
            let text = std::fs::read_to_string(root.join(group).join(file));
            let bytes = text.ok().and_then(|text| text.trim().parse().ok());
            let bytes = bytes.filter(|&bytes: &u64| bytes < NONE);
            lowest = bytes.into_iter().chain(lowest).min();
        }
    }
    lowest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_limit_of_the_groups_above_counts() {
        let folder = tempfile::tempdir().unwrap();
        let write = |file: &str, text: &str| {
            let file = folder.path().join(file);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, text).unwrap();
        };
        let limit = |groups: &str| limit_of(groups, folder.path());
        assert_eq!(limit("0::/\n"), None, "no file");
        write("memory.max", "max\n");
        assert_eq!(limit("0::/\n"), None);
        write("a/memory.max", "4294967296\n");
        write("a/b/memory.max", "max\n");
        assert_eq!(limit("0::/a/b\n"), Some(4 << 30));
        write("a/b/memory.max", "1073741824\n");
        assert_eq!(limit("0::/a/b\n"), Some(1 << 30));
        write("memory/memory.limit_in_bytes", "9223372036854771712\n");
        assert_eq!(limit("5:memory:/docker/x\n0::/\n"), None);
        write("memory/memory.limit_in_bytes", "2147483648\n");
        assert_eq!(
            limit("4:cpu,cpuacct:/\n5:memory:/docker/x\n"),
            Some(2 << 30)
        );
    }
}
