//! Synthetic lesions in heads: what is easier to find where.
//!
//! `cargo run --release -p isocortex-analysis --features study --example study -- [--quick | --lesions N] FOLDER HEAD…`
//!
//! A head is `NAME=VOLUME,MASK`, or `NAME=VOLUME,MASK,tuned` if parameters were chosen on it; a volume is a NIfTI file or a folder with one
//! DICOM series. FOLDER gets a JSON file for each head, which is not run again, and `study.md` with the table of all.

use std::error::Error;
use std::ops::ControlFlow;
use std::path::Path;

use analysis::study::{Criteria, HeadResult, Report, StudyParameters, run_head};
use analysis::{Head, midsagittal_plane};
use geometry::{BrainMask, DepthField, Volume, distance_map, envelope};

fn main() -> Result<(), Box<dyn Error>> {
    let mut parameters = StudyParameters::FULL;
    let mut names = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--quick" => parameters = StudyParameters::QUICK,
            "--lesions" => {
                let count = arguments.next().ok_or("name how many lesions")?.parse()?;
                parameters.lesions = count;
                parameters.shams = count;
            }
            _ => names.push(argument),
        }
    }
    let [folder, heads @ ..] = &names[..] else {
        return Err("name a folder for the results, then heads as NAME=VOLUME,MASK".into());
    };
    let folder = Path::new(folder);
    std::fs::create_dir_all(folder)?;
    let mut results = Vec::new();
    for head in heads {
        let (name, files) = head.split_once('=').ok_or("a head is NAME=VOLUME,MASK")?;
        let kept = folder.join(format!("{name}.json"));
        if !kept.exists() {
            let result = run(name, files, &parameters)?;
            std::fs::write(&kept, serde_json::to_vec_pretty(&result)?)?;
        }
        results.push(serde_json::from_slice(&std::fs::read(kept)?)?);
        let report = Report::new(parameters.seed, results.clone());
        std::fs::write(folder.join("study.md"), report.table(&Criteria::STANDARD))?;
    }
    let report = Report::new(parameters.seed, results);
    println!("{}", report.table(&Criteria::STANDARD));
    Ok(())
}

fn run(
    name: &str,
    files: &str,
    parameters: &StudyParameters,
) -> Result<HeadResult, Box<dyn Error>> {
    let parts: Vec<&str> = files.split(',').collect();
    let [volume, mask, rest @ ..] = &parts[..] else {
        return Err("a head is NAME=VOLUME,MASK".into());
    };
    let volume = read_volume(Path::new(volume))?;
    let mask = imaging::nifti::read_mask(&std::fs::read(mask)?, &imaging::Limits::default())?;
    let brain = BrainMask::from_mask(&mask, volume.grid())?;
    let envelope = envelope(&brain, 10.0)?;
    let depth = DepthField::new(&distance_map(&envelope));
    let plane = midsagittal_plane(&envelope, &volume);
    let head = Head {
        volume: &volume,
        depth: &depth,
        plane: &plane,
    };
    let mut done = 0;
    let trials = run_head(head, parameters, |trial, count| {
        done += 1;
        eprintln!(
            "{name}: {done} of {count}, {}, {} mm",
            trial.sign.name(),
            trial.radius_mm
        );
        ControlFlow::Continue(())
    })?;
    Ok(HeadResult {
        name: name.to_owned(),
        is_tuned: rest == ["tuned"],
        trials,
    })
}

fn read_volume(path: &Path) -> Result<Volume, Box<dyn Error>> {
    let limits = imaging::Limits::default();
    let bytes = if path.is_dir() {
        let entries = std::fs::read_dir(path)?;
        let mut files = entries
            .map(|entry| std::fs::read(entry?.path()))
            .collect::<Result<Vec<_>, _>>()?;
        let options = imaging::dicom::Options::default();
        imaging::dicom::convert(&mut files, &options, &limits)?.nifti
    } else {
        std::fs::read(path)?
    };
    Ok(imaging::nifti::read_volume(&bytes, &limits)?)
}
