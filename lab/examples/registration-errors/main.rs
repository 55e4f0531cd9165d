//! How far registrations are off, of pairs with known transforms, and what the verdict says to what is not the same head.
//!
//! `cargo run --release --manifest-path lab/Cargo.toml --example registration-errors -- [--each N] [--pairs DIR] HEAD...`
//!
//! A HEAD is `VOLUME:MASK`, two NIfTI files: a T1 and a mask of its brain. N motions of up to 20° and 20 mm are drawn for each
//! head and kind. With `--pairs` the pairs are written to a folder, for `lab/peers/registration.py`.

mod pairs;

use std::path::{Path, PathBuf};
use std::time::Duration;

use analysis::{Registration, Verdict, register};
use geometry::Mask;
use glam::{DAffine3, DMat3, DVec3};
use imaging::nifti;
use pairs::{Head, Kind, Lot, border, errors_mm, motion, placed};

type Failure = Box<dyn std::error::Error>;

/// The greatest turn and shift.
const DEGREES: f64 = 20.0;
const SHIFT_MM: f64 = 20.0;

struct Options {
    each: u64,
    pairs: Option<PathBuf>,
    heads: Vec<Head>,
}

struct Line {
    kind: Kind,
    /// The greatest distance at the envelope.
    error_mm: f64,
    cpu: Duration,
    found: Registration,
}

fn main() -> Result<(), Failure> {
    let options = options()?;
    let mut lines = Vec::new();
    let mut strangers = Vec::new();
    for (number, head) in options.heads.iter().enumerate() {
        if let Some(folder) = &options.pairs {
            write_head(&folder.join(format!("head-{number}")), head)?;
        }
        for kind in Kind::ALL {
            for draw in 0..options.each {
                let seed = 1_000_000 * number as u64 + 1000 * kind as u64 + draw;
                let mut lot = Lot::new(seed);
                let (degrees, shift_mm) = (DEGREES * lot.unit(), SHIFT_MM * lot.unit());
                let truth = motion(&mut lot, head.centre(), degrees, shift_mm);
                let layer = head.layer(kind, truth, &mut lot);
                if let Some(folder) = &options.pairs {
                    let folder = folder.join(format!("head-{number}"));
                    write_pair(&folder, &format!("{kind:?}-{draw}"), &layer, truth)?;
                }
                let begun = cpu_time();
                let found = register(&head.volume, &head.envelope, &layer);
                let cpu = cpu_time() - begun;
                let [mean, most] = errors_mm(&head.envelope, truth, found.case_from_layer);
                eprintln!(
                    "head {number}, {:26} {degrees:4.1}° {shift_mm:4.1} mm: {mean:6.3} {most:6.3} mm, {cpu:.2?} {}",
                    kind.name(),
                    words(&found)
                );
                lines.push(Line {
                    kind,
                    error_mm: most,
                    cpu,
                    found,
                });
                if draw == 0 {
                    strangers.extend(not_the_same(&options.heads, number, kind, &layer));
                }
            }
        }
    }
    print_errors(&lines);
    print_strangers(&strangers);
    Ok(())
}

fn options() -> Result<Options, Failure> {
    let mut options = Options {
        each: 2,
        pairs: None,
        heads: Vec::new(),
    };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--each" => options.each = arguments.next().ok_or("--each needs a number")?.parse()?,
            "--pairs" => {
                options.pairs = Some(arguments.next().ok_or("--pairs needs a folder")?.into());
            }
            head => {
                let (volume, mask) = head.split_once(':').ok_or("a HEAD is VOLUME:MASK")?;
                options
                    .heads
                    .push(Head::read(Path::new(volume), Path::new(mask))?);
            }
        }
    }
    if options.heads.is_empty() {
        return Err("arguments: [--each N] [--pairs DIR] VOLUME:MASK...".into());
    }
    Ok(options)
}

/// What must not be called registered: the layer on another head, mirrored, and with a header that is false by half a turn.
fn not_the_same(
    heads: &[Head],
    number: usize,
    kind: Kind,
    layer: &geometry::Volume,
) -> Vec<(&'static str, Registration)> {
    let head = &heads[number];
    let centre = head.centre();
    let about = |linear: DMat3| {
        DAffine3::from_translation(centre)
            * DAffine3::from_mat3(linear)
            * DAffine3::from_translation(-centre)
    };
    let mirror = about(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)));
    let half_turn = about(DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)));
    let mut found = vec![
        (
            "mirrored",
            register(&head.volume, &head.envelope, &placed(layer, mirror)),
        ),
        (
            "header false by 180°",
            register(&head.volume, &head.envelope, &placed(layer, half_turn)),
        ),
    ];
    let others = heads
        .iter()
        .enumerate()
        .filter(|(other, _)| *other != number);
    found.extend(others.map(|(_, other)| {
        (
            "another head",
            register(&other.volume, &other.envelope, layer),
        )
    }));
    for (what, found) in &found {
        eprintln!("    {:26} {what}: {}", kind.name(), words(found));
    }
    found
}

fn words(found: &Registration) -> String {
    format!(
        "{:?}, NMI {:.4} → {:.4}, overlap {:.2}, residual {:.2} mm",
        found.verdict,
        found.nmi_before,
        found.nmi_after,
        found.overlap,
        found.residual_mm.unwrap_or(f64::NAN)
    )
}

fn print_errors(lines: &[Line]) {
    println!(
        "| pair | pairs | median, mm | 95 %, mm | most, mm | within the limit | not registered | greatest residual, mm | CPU, s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for kind in Kind::ALL {
        print_row(kind.name(), lines.iter().filter(|line| line.kind == kind));
    }
    print_row("all", lines.iter());
}

fn print_row<'a>(name: &str, lines: impl Iterator<Item = &'a Line>) {
    let lines: Vec<&Line> = lines.collect();
    let mut errors: Vec<f64> = lines.iter().map(|line| line.error_mm).collect();
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| errors[(((errors.len() - 1) as f64) * share).round() as usize];
    let within = lines
        .iter()
        .filter(|line| line.error_mm <= line.kind.limit_mm())
        .count();
    let failed = lines
        .iter()
        .filter(|line| matches!(line.found.verdict, Verdict::Failed(_)))
        .count();
    let residual = lines
        .iter()
        .filter_map(|line| line.found.residual_mm)
        .fold(0.0, f64::max);
    let cpu = lines.iter().map(|line| line.cpu.as_secs_f64()).sum::<f64>() / lines.len() as f64;
    println!(
        "| {name} | {} | {:.2} | {:.2} | {:.2} | {within} | {failed} | {residual:.2} | {cpu:.2} |",
        lines.len(),
        at(0.5),
        at(0.95),
        at(1.0)
    );
}

fn print_strangers(strangers: &[(&'static str, Registration)]) {
    println!("\n| not the same | registrations | failed | least residual, mm |\n|---|---|---|---|");
    for kind in ["another head", "mirrored", "header false by 180°"] {
        let found: Vec<_> = strangers.iter().filter(|(what, _)| *what == kind).collect();
        let failed = found
            .iter()
            .filter(|(_, found)| matches!(found.verdict, Verdict::Failed(_)))
            .count();
        let residuals = found.iter().filter_map(|(_, found)| found.residual_mm);
        let least = residuals.fold(f64::INFINITY, f64::min);
        println!("| {kind} | {} | {failed} | {least:.2} |", found.len());
    }
}

fn write_head(folder: &Path, head: &Head) -> Result<(), Failure> {
    std::fs::create_dir_all(folder)?;
    std::fs::write(
        folder.join("case.nii.gz"),
        nifti::write_volume(&head.volume)?,
    )?;
    let mask: &Mask = head.envelope.mask();
    std::fs::write(folder.join("envelope.nii.gz"), nifti::write_mask(mask)?)?;
    let points = border(&head.envelope)
        .into_iter()
        .map(|point| point.to_array());
    let lines: Vec<String> = points.map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    Ok(std::fs::write(folder.join("border.txt"), lines.concat())?)
}

fn write_pair(
    folder: &Path,
    name: &str,
    layer: &geometry::Volume,
    truth: DAffine3,
) -> Result<(), Failure> {
    std::fs::write(
        folder.join(format!("{name}.nii.gz")),
        nifti::write_volume(layer)?,
    )?;
    let numbers = truth.to_cols_array().map(|number| format!("{number}"));
    Ok(std::fs::write(
        folder.join(format!("{name}.txt")),
        numbers.join(" "),
    )?)
}

/// The processor time of this process, of all its threads; the system counts hundredths of a second.
fn cpu_time() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat
        .rsplit(')')
        .next()
        .unwrap_or_default()
        .split_whitespace();
    let ticks: u64 = fields
        .skip(11)
        .take(2)
        .filter_map(|field| field.parse::<u64>().ok())
        .sum();
    Duration::from_millis(ticks * 10)
}
