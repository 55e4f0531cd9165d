//! `isocortex-bench study`.

use std::path::PathBuf;

use bench::study::{
    Criteria, Finished, MaskFrom, Report, Simulator, StudyFolders, StudyHead, StudyParameters,
    View, page,
};
use bench::{BenchError, froc};
use clap::Args;
use serde_json::json;

use super::study_progress::StudyProgress;
use super::trial::TrialArgs;
use super::{create, write};

/// Put synthetic lesions into heads, and count which model observers find them
///
/// The observers are programs, not radiologists: the result only shows what is easier for a model observer. The table
/// contains the hits with fewer than 1, 5 and 20 false marks per head for slices, isosurfaces and maps, followed by the
/// criteria that were fixed beforehand. Without --head, the synthetic head is used; this only shows that the program
/// works. With --bids, real lesions are searched for instead.
#[derive(Debug, Args)]
pub(super) struct StudyArgs {
    /// A head: NAME=VOLUME,MASK or NAME=VOLUME, followed by ",tuned" if parameters were chosen on it. A volume is a NIfTI
    /// file or a folder with one DICOM series, a mask is NIfTI. Without a mask, the brain is extracted. May be given
    /// several times.
    #[arg(long, value_name = "HEAD", value_parser = head)]
    head: Vec<StudyHead>,
    /// The file with the weights of the network that extracts brains, deepbet-1.0.2-py3-none-any.whl. [default: extract
    /// them by tree pruning]
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_NETWORK")]
    network: Option<PathBuf>,
    /// Twelve lesions and four shams per head.
    #[arg(long, conflicts_with = "lesions")]
    quick: bool,
    /// Number of lesions and of shams in each head. [default: 60]
    #[arg(long, value_name = "N")]
    lesions: Option<usize>,
    /// Number of lesions and of shams in each head for the observers of a known place, counting those that are searched
    /// for. [default: those alone]
    #[arg(long, value_name = "N", conflicts_with = "radius_mm")]
    patches: Option<usize>,
    /// Make every lesion a blur or a thickening of this radius in mm, in place of all signs and sizes.
    #[arg(long, value_name = "MM", requires = "alone", value_parser = length)]
    radius_mm: Option<f64>,
    /// The standard deviation of that blur, in mm.
    #[arg(long, value_name = "MM", requires = "radius_mm", group = "alone", value_parser = length)]
    blur_mm: Option<f64>,
    /// Make every lesion a thickening of the cortex by this length in mm.
    #[arg(long, value_name = "MM", requires = "radius_mm", group = "alone", value_parser = length)]
    thickening_mm: Option<f64>,
    /// Number of shams in each head. [default: as many as lesions; none if all lesions are alike]
    #[arg(long, value_name = "N")]
    shams: Option<usize>,
    /// What makes the lesions: displaced (Gaussians and white noise), or painted (boxes, paint, and noise as in the head; blurs
    /// and thickenings alone). No score is adopted unless it wins with both.
    #[arg(long, value_name = "NAME", default_value = "displaced", value_parser = simulator)]
    simulator: Simulator,
    /// Make the page of results: blurs, mixtures, transmantle lesions and thickenings in turn, from both simulators, in the lists
    /// that the program makes. The results of each simulator are in a directory of its own.
    #[arg(long, conflicts_with_all = ["radius_mm", "simulator", "patches", "plot", "write", "quick"])]
    four: bool,
    /// Show maps alone, which takes a third of the time.
    #[arg(long, conflicts_with_all = ["plot", "patches"])]
    maps_only: bool,
    /// The seed of all random choices. [default: the seed of the study]
    #[arg(long)]
    seed: Option<u64>,
    /// Directory for the results of each head. An interrupted run continues with the next trial, a head with results is
    /// not run again, and results of other parameters are refused.
    #[arg(long, value_name = "DIR", default_value = "study")]
    results: PathBuf,
    /// Also write each head with each of its lesions into this directory as NIfTI.
    #[arg(long, value_name = "DIR")]
    write: Option<PathBuf>,
    /// Write the share of lesions found over the number of false marks into this directory as froc.svg.
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    trial: TrialArgs,
}

/// The radius or the blur of a lesion, in mm.
fn length(text: &str) -> Result<f64, String> {
    let length: f64 = text
        .parse()
        .map_err(|_| "write a number in mm".to_owned())?;
    let is_of_a_lesion = (0.5..=20.0).contains(&length);
    is_of_a_lesion
        .then_some(length)
        .ok_or("must be between 0.5 and 20 mm".to_owned())
}

fn simulator(text: &str) -> Result<Simulator, String> {
    let known = Simulator::ALL.into_iter().find(|one| one.name() == text);
    known.ok_or_else(|| format!("write {}", Simulator::ALL.map(Simulator::name).join(" or ")))
}

fn head(text: &str) -> Result<StudyHead, String> {
    let wrong = || {
        "write NAME=VOLUME,MASK or NAME=VOLUME; append ,tuned if parameters were chosen on it"
            .to_owned()
    };
    let (name, files) = text.split_once('=').ok_or_else(wrong)?;
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "-_.".contains(letter);
    if name.is_empty() || !name.chars().all(is_plain) {
        return Err(format!(
            "{name:?} is not a valid name; use letters, digits, - _ ."
        ));
    }
    let (files, is_tuned) = match files.strip_suffix(",tuned") {
        Some(files) => (files, true),
        None => (files, false),
    };
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
        is_tuned,
    })
}

/// Runs and prints.
pub(super) fn run(args: &StudyArgs) -> Result<(), BenchError> {
    if let Some(bids) = &args.trial.bids {
        let network = args.network.as_deref();
        return args.trial.run(bids, (&args.results, network), args.json);
    }
    let mut parameters = if args.quick {
        StudyParameters::QUICK
    } else {
        StudyParameters::FULL
    };
    if let Some(count) = args.lesions {
        (parameters.lesions, parameters.shams) = (count, count);
    }
    parameters.patches = args.patches.unwrap_or(parameters.patches);
    if let Some((radius_mm, blur_mm)) = args.radius_mm.zip(args.blur_mm) {
        parameters = parameters.with_blurs_alone(radius_mm, blur_mm);
    }
    if let Some((radius_mm, thickening_mm)) = args.radius_mm.zip(args.thickening_mm) {
        parameters = parameters.with_thickenings_alone(radius_mm, thickening_mm);
    }
    parameters.shams = args.shams.unwrap_or(parameters.shams);
    parameters.simulator = args.simulator;
    if args.maps_only {
        parameters.views = &View::OF_MAPS;
    }
    parameters.seed = args.seed.unwrap_or(parameters.seed);
    let mut heads = args.head.clone();
    if heads.is_empty() {
        heads.push(StudyHead {
            name: "made-up".to_owned(),
            files: None,
            is_tuned: false,
        });
    }
    let masks = heads.iter_mut().filter_map(|head| head.files.as_mut());
    for (_, mask) in masks {
        if let (MaskFrom::Pruning, Some(network)) = (&mask, &args.network) {
            *mask = MaskFrom::Network(network.clone());
        }
    }
    if args.four {
        let reports = Simulator::ALL.map(|simulator| {
            let folder = args.results.join(simulator.name());
            args.report(&heads, &parameters.with_four_lesions(simulator), folder)
        });
        let reports = reports.into_iter().collect::<Result<Vec<Report>, _>>()?;
        if args.json {
            println!("{:#}", json!({ "reports": reports }));
        } else {
            print!("{}", page(&reports));
        }
        return Ok(());
    }
    let report = args.report(&heads, &parameters, args.results.clone())?;
    if let Some(folder) = &args.plot {
        create(folder)?;
        write(&folder.join("froc.svg"), froc(&report.heads).as_bytes())?;
    }
    if args.json {
        let verdicts = report.verdicts(&Criteria::STANDARD);
        let known_place = report.known_place();
        println!(
            "{:#}",
            json!({ "report": report, "known_place": known_place, "verdicts": verdicts })
        );
    } else {
        print!("{}", report.table(&Criteria::STANDARD));
    }
    Ok(())
}

impl StudyArgs {
    /// Runs the trials of all heads, or reads their results from a directory.
    fn report(
        &self,
        heads: &[StudyHead],
        parameters: &StudyParameters,
        results: PathBuf,
    ) -> Result<Report, BenchError> {
        let folders = StudyFolders {
            results,
            lesions: self.write.clone(),
        };
        for folder in [Some(&folders.results), folders.lesions.as_ref()]
            .into_iter()
            .flatten()
        {
            create(folder)?;
        }
        let mut progress = StudyProgress::new(heads.len());
        let results = heads
            .iter()
            .enumerate()
            .map(|(number, head)| {
                let mut report = |finished: Finished<'_>| progress.report(number, &finished);
                head.trials(parameters, &folders, &mut report)
            })
            .collect::<Result<Vec<_>, _>>();
        progress.end();
        Ok(Report::new(parameters, results?))
    }
}
