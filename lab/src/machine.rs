//! The machine of a measurement.

use serde::Serialize;

/// The machine and the program, for comparing two tables.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// The CPU, as the system names it.
    pub processor: String,
    /// Number of threads that this process can run at a time.
    pub threads: usize,
    /// Number of threads that the measured work used.
    pub threads_used: usize,
    /// The widest vector instructions of the CPU; the program uses AVX2 if it is available.
    pub vectors: &'static str,
    /// Memory in MiB, if the system reports it.
    pub memory_mib: Option<u64>,
    /// Operating system and architecture.
    pub system: String,
    /// The version of the program.
    pub version: &'static str,
    /// The commit it was built from, if `ISOCORTEX_COMMIT` was set during the build.
    pub commit: Option<&'static str>,
    /// Whether it is a release build.
    pub release_build: bool,
}

impl Machine {
    /// This machine.
    pub fn this() -> Self {
        Self {
            processor: processor().unwrap_or_else(|| "unknown".to_owned()),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            threads_used: rayon::current_num_threads(),
            vectors: vectors(),
            memory_mib: kibibytes("/proc/meminfo", "MemTotal:").map(|kib| kib / 1024),
            system: system(),
            version: env!("CARGO_PKG_VERSION"),
            commit: option_env!("ISOCORTEX_COMMIT"),
            release_build: !cfg!(debug_assertions),
        }
    }

    /// A description in one line.
    pub fn line(&self) -> String {
        let memory = self.memory_mib.map_or_else(String::new, |mib| {
            format!(", {:.0} GiB", mib as f64 / 1024.0)
        });
        let commit = self
            .commit
            .map_or_else(String::new, |commit| format!(" ({commit})"));
        let build = if self.release_build {
            ""
        } else {
            ", NOT a release build"
        };
        format!(
            "{} ({}, {} of {} threads used{memory}), {}; isocortex-bench {}{commit}{build}",
            self.processor,
            self.vectors,
            self.threads_used,
            self.threads,
            self.system,
            self.version,
        )
    }
}

fn kibibytes(path: &str, line: &str) -> Option<u64> {
    let text = std::fs::read_to_string(path).ok()?;
    let rest = text.lines().find_map(|found| found.strip_prefix(line))?;
    rest.split_whitespace().next()?.parse().ok()
}

fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

fn system() -> String {
    let release = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    let words = [std::env::consts::OS, release.trim(), std::env::consts::ARCH];
    let known: Vec<_> = words.into_iter().filter(|word| !word.is_empty()).collect();
    known.join(" ")
}

#[cfg(target_arch = "x86_64")]
fn vectors() -> &'static str {
    if std::is_x86_feature_detected!("avx512f") {
        "AVX-512"
    } else if std::is_x86_feature_detected!("avx2") {
        "AVX2"
    } else if std::is_x86_feature_detected!("sse4.1") {
        "SSE4.1"
    } else {
        "SSE2"
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn vectors() -> &'static str {
    std::env::consts::ARCH
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_is_told_in_one_line_that_names_the_version() {
        let line = Machine::this().line();
        assert!(line.contains(env!("CARGO_PKG_VERSION")) && !line.contains('\n'));
        assert!(line.contains("threads used"), "{line}");
    }
}
