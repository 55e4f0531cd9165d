//! The head for the measurements.

use std::path::{Path, PathBuf};

use bench::{BenchError, Head, HeadFacts, PreparedHead};
use clap::Args;

/// Colin27 and its brain mask from the Debian package mricron-data.
const COLIN27: [&str; 2] = [
    "/usr/share/mricron/templates/ch2.nii.gz",
    "/usr/share/mricron/templates/ch2bet.nii.gz",
];

/// Edge of a voxel of the synthetic head, which is used if no real one is found, in mm.
const PHANTOM_MM: f64 = 1.0;

/// The range of closing radii, in mm.
const CLOSING_MM: std::ops::RangeInclusive<f64> = 0.0..=50.0;

#[derive(Debug, Args)]
pub(super) struct HeadArgs {
    /// An MR volume, NIfTI.
    #[arg(
        long,
        value_name = "FILE",
        env = "ISOCORTEX_DEMO_VOLUME",
        requires = "mask"
    )]
    volume: Option<PathBuf>,
    /// Its brain mask, NIfTI.
    #[arg(
        long,
        value_name = "FILE",
        env = "ISOCORTEX_DEMO_MASK",
        requires = "volume"
    )]
    mask: Option<PathBuf>,
    /// Use the synthetic head with voxels of this size, 0.5 to 4 mm.
    #[arg(long, value_name = "MM", conflicts_with = "volume", value_parser = phantom_spacing)]
    phantom: Option<f64>,
    /// Radius of the ball that closes the brain mask to the envelope, 0 to 50 mm.
    #[arg(long, value_name = "MM", default_value_t = 10.0, value_parser = closing_radius)]
    pub(super) closing_radius_mm: f64,
    /// Threads to use. [default: all]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

fn number_within(
    text: &str,
    accepted: std::ops::RangeInclusive<f64>,
    refusal: &str,
) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if accepted.contains(&number) {
        Ok(number)
    } else {
        Err(refusal.to_owned())
    }
}

fn phantom_spacing(text: &str) -> Result<f64, String> {
    number_within(text, 0.5..=4.0, "must be within 0.5 to 4 mm")
}

fn closing_radius(text: &str) -> Result<f64, String> {
    number_within(text, CLOSING_MM, "must be within 0 to 50 mm")
}

impl HeadArgs {
    /// Limits the threads and selects the requested head, or the best available one.
    pub(super) fn read(&self) -> Result<Head, BenchError> {
        if let Some(threads) = self.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let started = pool.build_global();
            started.map_err(|error| BenchError::Threads(error.to_string()))?;
        }
        if let Some((volume, mask)) = self.volume.as_ref().zip(self.mask.as_ref()) {
            let name = volume.file_name().unwrap_or_default().to_string_lossy();
            return from_files(&name, [volume, mask]);
        }
        let colin27 = COLIN27.map(Path::new);
        let is_installed = colin27.iter().all(|file| file.exists());
        match self.phantom {
            None if is_installed => from_files("Colin27", colin27),
            spacing_mm => Head::phantom(spacing_mm.unwrap_or(PHANTOM_MM)),
        }
    }

    /// The facts about the head in a report.
    pub(super) fn facts(&self, head: &Head, prepared: &PreparedHead) -> HeadFacts {
        HeadFacts::of(&head.name, prepared, self.closing_radius_mm)
    }
}

fn from_files(name: &str, [volume, mask]: [&Path; 2]) -> Result<Head, BenchError> {
    Ok(Head {
        name: name.to_owned(),
        volume: read(volume)?,
        mask: read(mask)?,
    })
}

fn read(path: &Path) -> Result<Vec<u8>, BenchError> {
    std::fs::read(path).map_err(|reason| BenchError::Unreadable {
        path: path.to_owned(),
        reason,
    })
}
