//! Who goes first where processors are short: answers before computations.

/// The priority of threads that compute: a nice value of 5 gives a thread a third of the time of one that answers, if both need a processor.
#[cfg(target_os = "linux")]
const COMPUTES: i32 = 5;

/// Lets this thread, and those that it starts from now on, yield to those that answer requests, which need a processor only briefly. A thread cannot
/// take this back.
pub fn yield_to_answers() {
    // Elsewhere, all threads of a process have one priority.
    #[cfg(target_os = "linux")]
    {
        use rustix::process::{getpriority_process, setpriority_process};
        // It can only be refused by a sandbox; then nothing changes.
        if getpriority_process(None).is_ok_and(|now| now < COMPUTES) {
            let _refused = setpriority_process(None, COMPUTES);
        }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use rustix::process::getpriority_process;

    use super::*;

    #[test]
    fn only_the_thread_that_computes_yields() {
        let before = getpriority_process(None).unwrap();
        let computing = std::thread::spawn(|| {
            yield_to_answers();
            yield_to_answers();
            getpriority_process(None).unwrap()
        });
        assert_eq!(computing.join().unwrap(), before.max(COMPUTES));
        assert_eq!(getpriority_process(None).unwrap(), before);
    }
}
