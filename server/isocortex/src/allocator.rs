//! Large blocks of memory are returned to the system as soon as they are freed.
//!
//! The allocator of glibc does so only above a threshold, which it raises to the size of the largest block that was freed.
//! Below it, blocks of many megabytes stay in its arenas, of which a server has one for each of its first threads: after
//! eight heads of 1 mm, 256 MB instead of 55 MB with a threshold of 256 KiB. A threshold from the environment is never raised. The program sets it by
//! starting itself again, because calling the allocator itself would be unsafe code.

/// Smaller blocks stay in the arenas, in bytes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const THRESHOLD: (&str, &str) = ("MALLOC_MMAP_THRESHOLD_", "1048576");

/// Starts the program again with the threshold in its environment, in the same process, unless there is one already.
///
/// Call it before the program does anything else. If the system refuses, the program continues as it is.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn return_large_blocks() {
    use std::os::unix::process::CommandExt as _;

    let (name, value) = THRESHOLD;
    if std::env::var_os(name).is_some() {
        return;
    }
    let mut arguments = std::env::args_os();
    if let (Some(name_of_program), Ok(program)) = (arguments.next(), std::env::current_exe()) {
        let mut command = std::process::Command::new(program);
        command
            .arg0(name_of_program)
            .args(arguments)
            .env(name, value);
        // It returns only if it fails.
        let _refused = command.exec();
    }
}

/// Other allocators need no threshold.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn return_large_blocks() {}
