//! `isocortex-bench study`.

use std::path::PathBuf;

use bench::BenchError;
use bench::study::{
    Finished, HeadResult, MaskFrom, Simulator, StudyFolders, StudyHead, StudyParameters, page,
};
use clap::Args;
use serde_json::json;

use super::create;
use super::study_progress::StudyProgress;

/// Put synthetic lesions into heads, and count which the lists of the program find
///
/// Blurs, mixtures, transmantle lesions and thickenings in turn, from three simulators. The table contains the hits with fewer
/// than 1, 5 and 20 false marks per head. Without --head, the synthetic head is used; this only shows that the program works.
#[derive(Debug, Args)]
pub(super) struct StudyArgs {
    /// A head: NAME=VOLUME,MASK or NAME=VOLUME. A volume is a NIfTI file or a folder with one DICOM series, a mask is NIfTI.
    /// Without a mask, the brain is extracted. May be given several times.
    #[arg(long, value_name = "HEAD", value_parser = head)]
    head: Vec<StudyHead>,
    /// The file with the weights of the network that extracts brains, deepbet-1.0.2-py3-none-any.whl. [default: extract
    /// them by tree pruning]
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_NETWORK")]
    network: Option<PathBuf>,
    /// Number of lesions in each head and from each simulator.
    #[arg(long, value_name = "N", default_value_t = 48)]
    lesions: usize,
    /// Number of shams in each head.
    #[arg(long, value_name = "N", default_value_t = 12)]
    shams: usize,
    /// Directory for the results of each head, with a directory for each simulator. An interrupted run continues with the next
    /// trial, a head with results is not run again, and results of other parameters are refused.
    #[arg(long, value_name = "DIR", default_value = "study")]
    results: PathBuf,
    /// Also write each head with each of its lesions as NIfTI into this directory, with a directory for each simulator.
    #[arg(long, value_name = "DIR")]
    write: Option<PathBuf>,
    /// Print JSON instead of a page.
    #[arg(long)]
    json: bool,
}

fn head(text: &str) -> Result<StudyHead, String> {
    let wrong = || "write NAME=VOLUME,MASK or NAME=VOLUME".to_owned();
    let (name, files) = text.split_once('=').ok_or_else(wrong)?;
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "-_.".contains(letter);
    if name.is_empty() || !name.chars().all(is_plain) {
        return Err(format!(
            "{name:?} is not a valid name; use letters, digits, - _ ."
        ));
    }
    let (volume, mask) = match files.split_once(',') {
        Some((volume, mask)) => (volume, MaskFrom::File(mask.into())),
        None => (files, MaskFrom::Pruning),
    };
    if volume.is_empty() || mask == MaskFrom::File(PathBuf::new()) {
        return Err(wrong());
    }
    Ok(StudyHead {
        name: name.to_owned(),
        files: Some((volume.into(), mask)),
    })
}

/// Runs and prints.
pub(super) fn run(args: &StudyArgs) -> Result<(), BenchError> {
    let mut heads = args.head.clone();
    if heads.is_empty() {
        heads.push(StudyHead {
            name: "made-up".to_owned(),
            files: None,
        });
    }
    let masks = heads.iter_mut().filter_map(|head| head.files.as_mut());
    for (_, mask) in masks {
        if let (MaskFrom::Pruning, Some(network)) = (&mask, &args.network) {
            *mask = MaskFrom::Network(network.clone());
        }
    }
    let results = |simulator| Ok((simulator, args.results(&heads, simulator)?));
    let reports = Simulator::ALL.into_iter().map(results);
    let reports = reports.collect::<Result<Vec<_>, BenchError>>()?;
    if args.json {
        println!("{:#}", json!(reports));
    } else {
        print!("{}", page(&reports));
    }
    Ok(())
}

impl StudyArgs {
    /// Runs the trials of all heads with a simulator, or reads their results from a directory.
    fn results(
        &self,
        heads: &[StudyHead],
        simulator: Simulator,
    ) -> Result<Vec<HeadResult>, BenchError> {
        let parameters = StudyParameters {
            lesions: self.lesions,
            shams: self.shams,
            simulator,
        };
        let folders = StudyFolders {
            results: self.results.join(simulator.name()),
            lesions: (self.write.as_ref()).map(|folder| folder.join(simulator.name())),
        };
        create(&folders.results)?;
        if let Some(lesions) = &folders.lesions {
            create(lesions)?;
        }
        let mut progress = StudyProgress::new(heads.len());
        let results = heads
            .iter()
            .enumerate()
            .map(|(number, head)| {
                let mut report = |finished: Finished<'_>| progress.report(number, &finished);
                head.trials(&parameters, &folders, &mut report)
            })
            .collect();
        progress.end();
        results
    }
}
