//! `isocortex-bench study --bids`.

use std::path::{Path, PathBuf};

use bench::BenchError;
use bench::bids::{Choice, TrialParameters, Truths, run};
use clap::{Args, ValueEnum};

use super::{create, progress};

/// A published data set whose files and columns are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Like {
    /// OpenNeuro ds004199: patients with FCD II and controls, lesions drawn as *_roi.nii.gz.
    Bonn,
    /// OpenNeuro ds005602: operated patients without controls, resections as masks/N/N_MaskInOrig.nii.gz.
    Ideas,
}

/// The trial on real lesions.
#[derive(Debug, Args)]
#[command(next_help_heading = "Real lesions in a BIDS folder")]
pub(super) struct TrialArgs {
    /// Search for the lesions that people drew in the heads of a BIDS folder, sub-*/anat/*_T1w.nii.gz, and write report.html and
    /// report.json into the directory of results.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["head", "lesions", "shams", "write"])]
    pub(super) bids: Option<PathBuf>,
    /// The files and columns of a published data set, unless others are given.
    #[arg(long, requires = "bids")]
    like: Option<Like>,
    /// The files with the lesions, relative to the folder of each head; * is any text. [default: anat/*_roi.nii*]
    #[arg(long, value_name = "PATTERN", requires = "bids")]
    truth: Option<String>,
    /// Look for the pattern of --truth in this folder instead; {id} is the name of a head without sub-, {n} the same without leading
    /// zeros.
    #[arg(long, value_name = "DIR", requires = "bids")]
    truth_dir: Option<PathBuf>,
    /// The table of participants, tab- or comma-separated. [default: participants.tsv of the folder]
    #[arg(long, value_name = "FILE", requires = "bids")]
    participants: Option<PathBuf>,
    /// Which participants are patients. [default: every head with a truth that is no control]
    #[arg(long, value_name = "COLUMN=VALUE", requires = "bids", value_parser = Choice::parse)]
    patients: Option<Choice>,
    /// Which participants are controls.
    #[arg(long, value_name = "COLUMN=VALUE", requires = "bids", value_parser = Choice::parse)]
    controls: Option<Choice>,
    /// Run without controls.
    #[arg(long, requires = "bids", conflicts_with = "controls")]
    no_controls: bool,
    /// Take these participants alone.
    #[arg(long, value_name = "COLUMN=VALUE", requires = "bids", value_parser = Choice::parse)]
    split: Option<Choice>,
    /// Which patients were reported as normal when their MR was first read; a stratum of the report.
    #[arg(long, value_name = "COLUMN=VALUE", requires = "bids", value_parser = Choice::parse)]
    mri_negative: Option<Choice>,
    /// A further column whose values are strata. May be given several times.
    #[arg(long, value_name = "COLUMN", requires = "bids")]
    stratum: Vec<String>,
    /// Lock the program and all parameters before the first result: their hashes are written and appear in the report, and a changed
    /// program or parameter is refused from then on.
    #[arg(long, requires = "bids")]
    freeze: bool,
    /// Also judge the marks of another program: a table with participant_id, x, y, z and score. x, y and z are the mm of the
    /// T1-weighted NIfTI file (to the right, front and top). May be given several times.
    #[arg(long, value_name = "FILE", requires = "bids")]
    candidates_of: Vec<PathBuf>,
    /// Number of heads at the same time; each needs about 2 GB.
    #[arg(long, value_name = "N", requires = "bids", default_value_t = 1, value_parser = jobs)]
    jobs: usize,
}

fn jobs(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| (1..=64).contains(number));
    number.ok_or("must be between 1 and 64".to_owned())
}

impl TrialArgs {
    /// Runs the trial and prints its summary.
    pub(super) fn run(
        &self,
        bids: &Path,
        (results, network): (&Path, Option<&Path>),
        is_json: bool,
    ) -> Result<(), BenchError> {
        create(results)?;
        let report = run(&self.parameters(bids, results, network), &progress)?;
        if is_json {
            println!("{:#}", report.json());
        } else {
            print!("{}", report.text());
            println!("\n{}", results.join("report.html").display());
        }
        Ok(())
    }

    fn parameters(&self, bids: &Path, results: &Path, network: Option<&Path>) -> TrialParameters {
        let like = |wanted| self.like == Some(wanted);
        let choice = |given: &Option<Choice>, usual: &str, of| {
            let usual = || Choice::parse(usual).expect("a choice");
            given.clone().or_else(|| like(of).then(usual))
        };
        let (folder, pattern) = match self.like {
            Some(Like::Ideas) => (
                Some(bids.join("masks")),
                "{n}/{n}_MaskInOrig.nii*".to_owned(),
            ),
            Some(Like::Bonn) | None => (None, "anat/*_roi.nii*".to_owned()),
        };
        let mut strata = self.stratum.clone();
        if like(Like::Bonn) && !strata.iter().any(|column| column == "split") {
            strata.push("split".to_owned());
        }
        TrialParameters {
            bids: bids.to_owned(),
            truths: Truths {
                folder: self.truth_dir.clone().or(folder),
                pattern: self.truth.clone().unwrap_or(pattern),
            },
            participants: self.participants.clone(),
            patients: choice(&self.patients, "group=fcd", Like::Bonn),
            controls: choice(&self.controls, "group=hc", Like::Bonn).filter(|_| !self.no_controls),
            split: self.split.clone(),
            mri_negative: self.mri_negative.clone(),
            strata,
            needs_controls: !self.no_controls,
            network: network.map(Path::to_owned),
            results: results.to_owned(),
            jobs: self.jobs,
            freeze: self.freeze,
            candidates_of: self.candidates_of.clone(),
        }
    }
}
