//! Shows the progress of a preparation: a bar on a terminal, lines elsewhere.

use std::io::IsTerminal as _;
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};

use case::{Progress, Stage};

/// Steps of the bar.
const STEPS: u64 = 1000;

/// Shows progress on standard error until it is dropped.
pub(super) struct ProgressDisplay {
    bar: Option<ProgressBar>,
    last: Mutex<Option<Stage>>,
}

impl ProgressDisplay {
    pub(super) fn new() -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(STEPS);
            let style = ProgressStyle::with_template("{bar:30} {percent:>3} %  {msg}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        Self {
            bar,
            last: Mutex::default(),
        }
    }

    pub(super) fn show(&self, progress: Progress) {
        let words = words(progress.stage);
        if let Some(bar) = &self.bar {
            bar.set_position((STEPS as f32 * progress.fraction) as u64);
            bar.set_message(words);
            return;
        }
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.replace(progress.stage) != Some(progress.stage) {
            eprintln!("{words} …");
        }
    }
}

impl Drop for ProgressDisplay {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

fn words(stage: Stage) -> &'static str {
    match stage {
        Stage::Reading => "reading the volume",
        Stage::Extracting => "extracting the brain",
        Stage::Mask => "resampling the mask to the working grid",
        Stage::Closing => "closing the mask to the envelope",
        Stage::Distance => "measuring depths",
        Stage::Core => "finding the core",
        Stage::Forest => "growing the forest",
        Stage::Mesh => "building the mesh and its paths",
        Stage::Storing => "storing",
    }
}
