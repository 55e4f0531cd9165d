//! Whether two scans of one person give the same places.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use analysis::{Doubt, Head, UNUSUAL_ABOVE, Verdict, register, tissue_of};
use case::Parameters;
use geometry::DepthField;
use glam::DVec3;
use imaging::{Limits, nifti};
use pipeline::maps::{compute_maps, mirror_plane};
use pipeline::{Pipeline, Prepared, Source};
use serde::Serialize;

use super::folder::{Truths, heads, name_of};
use crate::BenchError;
use crate::files::read;
use crate::study::{HIT_MM, Mark, half_a_voxel_further, seed_of};

/// How many of the first marks of each scan are compared.
const FIRST: [usize; 3] = [1, 5, 20];

/// Two scans of one person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pair {
    /// The name of the head.
    pub name: String,
    /// The first scan, NIfTI.
    pub first: PathBuf,
    /// The second one; `None` to make it from the first, with voxels half a voxel further along each axis and new noise.
    pub second: Option<PathBuf>,
}

/// The share of marks of each scan that the other one repeats, within 10 mm.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Repeated {
    /// The name of the head.
    pub head: String,
    /// Where the second scan comes from.
    pub second: String,
    /// How the second scan was brought to the first, or why nothing was compared.
    pub placement: String,
    /// Of the first 1, 5 and 20 marks, those that are among as many of the other scan.
    pub of_first: Option<[f64; 3]>,
    /// The same with the marks of the second scan mirrored: what chance repeats.
    pub by_chance: Option<[f64; 3]>,
    /// The number of marks above the limit for unusual, in each scan.
    pub unusual: Option<[usize; 2]>,
    /// The share of these that the first 20 of the other scan repeat; `None` if there are none.
    pub of_unusual: Option<f64>,
}

/// The heads of a BIDS folder with two T1-weighted volumes or more: the first two of each.
///
/// # Errors
/// If the folder cannot be listed, or no head has two.
pub fn pairs(bids: &Path) -> Result<Vec<Pair>, BenchError> {
    let nothing = Truths {
        folder: None,
        pattern: "anat/*_roi.nii*".to_owned(),
    };
    let pairs: Vec<Pair> = heads(bids, &nothing)?
        .into_iter()
        .filter_map(|head| match head.t1.as_slice() {
            [first, second, ..] => Some(Pair {
                name: head.name,
                first: first.clone(),
                second: Some(second.clone()),
            }),
            _ => None,
        })
        .collect();
    if pairs.is_empty() {
        return Err(BenchError::Usage(format!(
            "no head in {} has two T1-weighted volumes (sessions or runs)",
            bids.display()
        )));
    }
    Ok(pairs)
}

/// A prepared scan and its marks, the highest first.
struct Scan {
    prepared: Prepared,
    marks: Vec<Mark>,
}

impl Scan {
    /// The reason, if the head cannot be prepared or has no maps.
    fn of(volume: Vec<u8>, pipeline: &Pipeline) -> Result<Self, String> {
        let source = Source {
            volume: volume.into(),
            ..Source::default()
        };
        let never = AtomicBool::new(false);
        let (parameters, limits) = (Parameters::default(), Limits::default());
        let prepared = pipeline.prepare(&source, &parameters, &limits, &|_| {}, &never);
        let prepared = prepared.map_err(|failure| failure.detail)?;
        let volume = prepared.built.model.volume();
        let maps = compute_maps(&prepared.facts, prepared.envelope(), volume);
        let maps = maps.map_err(|reason| reason.to_string())?;
        let marks = maps.candidates.iter().map(|candidate| Mark {
            position_in_patient: DVec3::from_array(candidate.position_in_patient),
            score: candidate.score,
        });
        Ok(Self {
            marks: marks.collect(),
            prepared,
        })
    }

    /// The same head with other voxels and noise, as NIfTI.
    fn resampled(&self, name: &str) -> Result<Vec<u8>, BenchError> {
        let tissue = {
            let (_, _, tissue) = tissue_of(Head {
                volume: self.prepared.built.model.volume(),
                depth: &DepthField::new(&self.prepared.built.distance),
                plane: &mirror_plane(&self.prepared.facts),
            })?;
            tissue
        };
        let volume = half_a_voxel_further(&self.prepared.native, &tissue, seed_of(name));
        Ok(nifti::write_volume(&volume)?)
    }
}

impl Pair {
    /// Compares the marks of both scans.
    ///
    /// # Errors
    /// If a file cannot be read. A head without maps is no error: the result states the reason.
    pub fn compare(&self, pipeline: &Pipeline) -> Result<Repeated, BenchError> {
        let second_name = match &self.second {
            Some(second) => name_of(second),
            None => "made from the first: half a voxel further, new noise".to_owned(),
        };
        let refused = |placement: String| Repeated {
            head: self.name.clone(),
            second: second_name.clone(),
            placement,
            of_first: None,
            by_chance: None,
            unusual: None,
            of_unusual: None,
        };
        let first = match Scan::of(read(&self.first)?, pipeline) {
            Ok(scan) => scan,
            Err(reason) => return Ok(refused(format!("the first scan has no maps: {reason}"))),
        };
        let bytes = match &self.second {
            Some(second) => read(second)?,
            None => first.resampled(&self.name)?,
        };
        let second = match Scan::of(bytes, pipeline) {
            Ok(scan) => scan,
            Err(reason) => return Ok(refused(format!("the second scan has no maps: {reason}"))),
        };
        let Scan { prepared, marks } = &first;
        let found = register(
            prepared.built.model.volume(),
            prepared.envelope(),
            second.prepared.built.model.volume(),
        );
        let placement = match found.verdict {
            Verdict::Unchanged => "fits by its header",
            Verdict::Registered => "registered",
            Verdict::Failed(
                Doubt::NoContrast | Doubt::Overlap | Doubt::Mirrored | Doubt::Parts,
            ) => {
                let reason = "the two scans do not fit each other: are they of one person?";
                return Ok(refused(reason.to_owned()));
            }
        };
        let brought: Vec<Mark> = second
            .marks
            .iter()
            .map(|mark| Mark {
                position_in_patient: found
                    .case_from_layer
                    .transform_point3(mark.position_in_patient),
                ..*mark
            })
            .collect();
        let plane = mirror_plane(&prepared.facts);
        let mirrored: Vec<Mark> = brought
            .iter()
            .map(|mark| Mark {
                position_in_patient: plane.reflected(mark.position_in_patient),
                ..*mark
            })
            .collect();
        let unusual = [marks, &brought].map(|marks| unusual(marks).len());
        Ok(Repeated {
            of_first: Some(FIRST.map(|count| repeated(marks, &brought, count))),
            by_chance: Some(FIRST.map(|count| repeated(marks, &mirrored, count))),
            of_unusual: (unusual != [0, 0]).then(|| {
                let most = FIRST[2];
                let hits = |some: &[Mark], others: &[Mark]| {
                    hits(self::unusual(some), first_of(others, most))
                };
                let both = hits(marks, &brought) + hits(&brought, marks);
                both as f64 / (unusual[0] + unusual[1]) as f64
            }),
            unusual: Some(unusual),
            ..refused(placement.to_owned())
        })
    }
}

fn unusual(marks: &[Mark]) -> &[Mark] {
    let count = marks.partition_point(|mark| mark.score > UNUSUAL_ABOVE);
    &marks[..count]
}

fn first_of(marks: &[Mark], count: usize) -> &[Mark] {
    &marks[..count.min(marks.len())]
}

/// The number of marks that lie within the distance of a hit of others.
fn hits(marks: &[Mark], others: &[Mark]) -> usize {
    let is_repeated = |mark: &&Mark| {
        let mut others = others.iter();
        others.any(|other| {
            let apart = mark.position_in_patient.distance(other.position_in_patient);
            apart <= HIT_MM
        })
    };
    marks.iter().filter(is_repeated).count()
}

/// The share of the first marks of two scans that the first ones of the other repeat.
fn repeated(one: &[Mark], other: &[Mark], count: usize) -> f64 {
    let [one, other] = [one, other].map(|marks| first_of(marks, count));
    let both = hits(one, other) + hits(other, one);
    both as f64 / (one.len() + other.len()).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marks(places: &[f64]) -> Vec<Mark> {
        let mark = |(number, &x): (usize, &f64)| Mark {
            position_in_patient: DVec3::new(x, 0.0, 0.0),
            score: 3.0 - number as f32,
        };
        places.iter().enumerate().map(mark).collect()
    }

    #[test]
    fn a_mark_is_repeated_by_one_of_as_many_within_10_mm() {
        let (one, other) = (marks(&[0.0, 50.0, 100.0]), marks(&[9.0, 130.0, 52.0]));
        assert_eq!(repeated(&one, &other, 1), 1.0);
        assert_eq!(repeated(&one, &other, 2), 0.5);
        assert_eq!(repeated(&one, &other, 20), 4.0 / 6.0);
        assert_eq!(repeated(&one, &[], 20), 0.0);
        assert_eq!(unusual(&one).len(), 1);
    }
}
