//! Normals: the mean and the deviation of measures over the controls of a scanner, on cells of 4 mm of a common space; and the places
//! of a head that differ from them.
//!
//! This is an experiment. No score of the program uses normals, and nothing here was tuned.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use analysis::steps::{CELL_MM, CELLS, CellMeasures, HeadCells, cell_at, cell_centre};
use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};

use super::head::{FoundMark, MadeWith};
use super::judge::MarkList;
use crate::BenchError;
use crate::files::{read, write};
use crate::study::{Mark, greedy};

/// The version of the files of normals and of cells.
const FORMAT: u32 = 1;
/// The measures of a cell.
const MEASURES: [&str; 4] = ["sharpness_per_mm", "detail", "thickness_mm", "mean_tissue"];
/// The fewest controls in a cell, beside the head that is scored, and the fewest controls of a scanner.
const LEAST_CONTROLS: u32 = 5;
/// The least deviation in a cell, as a share of the median of all cells of the scanner: few heads may agree by chance.
const LEAST_DEVIATION: f64 = 0.5;
/// The greatest deviation of a measure from its normals.
const MOST_Z: f64 = 8.0;
/// The shares of detail and sharpness in the score for a blur, and of the thickness beside the mean in the one for thickening: those of
/// the maps.
const DETAIL_SHARE: f64 = 0.7;
const THICKNESS_SHARE: f64 = 0.7;
/// The share of the score against normals that is added to `blur`.
const ADDED_SHARE: f64 = 0.35;

/// The cells of one head, as a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct CellsFile {
    format: u32,
    made_with: MadeWith,
    /// The hash of the T1-weighted file: who the head is.
    t1: String,
    /// From the common space to the patient, LPS mm: the columns of the axes, then the translation.
    patient_from_common: [f64; 12],
    cells: Vec<(u32, CellMeasures)>,
}

impl CellsFile {
    pub(super) fn new(made_with: &MadeWith, t1: &str, cells: HeadCells) -> Self {
        Self {
            format: FORMAT,
            made_with: made_with.clone(),
            t1: t1.to_owned(),
            patient_from_common: cells.patient_from_common.to_cols_array(),
            cells: cells.cells,
        }
    }

    /// The file of a head, if it was made by this program from this T1-weighted file; `None` if it is missing, or was not.
    pub(super) fn stored(path: &Path, made_with: &MadeWith, t1: &str) -> Option<Self> {
        let stored: Self = serde_json::from_slice(&std::fs::read(path).ok()?).ok()?;
        let is_same = stored.format == FORMAT && stored.made_with == *made_with && stored.t1 == t1;
        is_same.then_some(stored)
    }

    fn at(&self, cell: u32) -> Option<CellMeasures> {
        let place = self.cells.binary_search_by_key(&cell, |(cell, _)| *cell);
        Some(self.cells[place.ok()?].1)
    }
}

/// A cell over the controls of a scanner: how many have junction in it, and the mean and the sample deviation of each measure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Cell {
    controls: u32,
    mean: [f64; 4],
    deviation: [f64; 4],
}

impl Cell {
    const EMPTY: Self = Self {
        controls: 0,
        mean: [0.0; 4],
        deviation: [0.0; 4],
    };

    /// The same with one more control, or with one of them taken out.
    ///
    /// Source: Welford, "Note on a method for calculating corrected sums of squares and products", Technometrics 4, 1962.
    fn changed(self, measures: CellMeasures, is_added: bool) -> Self {
        let sign = if is_added { 1.0 } else { -1.0 };
        let before = f64::from(self.controls);
        let after = before + sign;
        if after < 1.0 {
            return Self::EMPTY;
        }
        let mut changed = Self {
            controls: after as u32,
            ..self
        };
        for (axis, measure) in measures.into_iter().enumerate() {
            let off = f64::from(measure) - self.mean[axis];
            changed.mean[axis] += sign * off / after;
            let squares = self.deviation[axis].powi(2) * (before - 1.0).max(0.0)
                + sign * off * (f64::from(measure) - changed.mean[axis]);
            changed.deviation[axis] = (squares.max(0.0) / (after - 1.0).max(1.0)).sqrt();
        }
        changed
    }
}

/// The controls of one scanner.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct Scanner {
    /// The hashes of their T1-weighted files.
    controls: BTreeSet<String>,
    cells: BTreeMap<u32, Cell>,
}

/// The normals of some scanners, as a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Normals {
    format: u32,
    made_with: MadeWith,
    cell_mm: f64,
    size: [usize; 3],
    measures: Vec<String>,
    scanners: BTreeMap<String, Scanner>,
}

impl Normals {
    fn empty(made_with: &MadeWith) -> Self {
        Self {
            format: FORMAT,
            made_with: made_with.clone(),
            cell_mm: CELL_MM,
            size: CELLS,
            measures: MEASURES.map(str::to_owned).to_vec(),
            scanners: BTreeMap::new(),
        }
    }

    /// The normals of controls, which are given with their scanners. A file counts once, and a scanner with too few controls is left
    /// out; the second value names these with their counts.
    pub(super) fn of<'a>(
        made_with: &MadeWith,
        controls: impl Iterator<Item = (&'a str, &'a CellsFile)>,
    ) -> (Self, Vec<(String, usize)>) {
        let mut normals = Self::empty(made_with);
        for (scanner, head) in controls {
            let scanner = normals.scanners.entry(scanner.to_owned()).or_default();
            if head.cells.is_empty() || !scanner.controls.insert(head.t1.clone()) {
                continue;
            }
            for &(cell, measures) in &head.cells {
                let cell = scanner.cells.entry(cell).or_insert(Cell::EMPTY);
                *cell = cell.changed(measures, true);
            }
        }
        let mut left_out = Vec::new();
        normals.scanners.retain(|name, scanner| {
            let count = scanner.controls.len();
            let is_enough = count >= LEAST_CONTROLS as usize;
            if !is_enough {
                left_out.push((name.clone(), count));
            }
            is_enough
        });
        (normals, left_out)
    }

    /// Writes the file.
    ///
    /// # Errors
    /// If no scanner has enough controls, or the file cannot be written.
    pub(super) fn write(
        &self,
        path: &Path,
        left_out: &[(String, usize)],
    ) -> Result<(), BenchError> {
        if self.scanners.is_empty() {
            let counts: Vec<String> = (left_out.iter())
                .map(|(scanner, count)| format!("{scanner}: {count}"))
                .collect();
            return Err(BenchError::Usage(format!(
                "no normals were written: a scanner needs at least {LEAST_CONTROLS} controls with cells ({})",
                counts.join("; ")
            )));
        }
        write(path, &serde_json::to_vec(self).expect("names and numbers"))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// If it is no file of normals, or was made by another version, with another network, or on other cells.
    pub(super) fn read(path: &Path, made_with: &MadeWith) -> Result<Self, BenchError> {
        let refused = |reason: String| {
            let path = path.display();
            Err(BenchError::Usage(format!(
                "{path} {reason}; write it again with --write-normals"
            )))
        };
        let normals: Self = match serde_json::from_slice(&read(path)?) {
            Ok(normals) => normals,
            Err(error) => return refused(format!("is no file of normals: {error}")),
        };
        let this = Self::empty(made_with);
        if normals.format != this.format {
            return refused(format!(
                "has the format {}; this program reads {FORMAT}",
                normals.format
            ));
        }
        if (normals.cell_mm, normals.size) != (this.cell_mm, this.size)
            || normals.measures != this.measures
        {
            return refused(format!(
                "has other cells or measures: {} mm, {:?}, {}; this program has {CELL_MM} mm, {CELLS:?}, {}",
                normals.cell_mm,
                normals.size,
                normals.measures.join(", "),
                this.measures.join(", ")
            ));
        }
        if normals.made_with != *made_with {
            return refused(
                "was made by another version, or with another network for the brain masks"
                    .to_owned(),
            );
        }
        Ok(normals)
    }

    /// Checks that each head has normals of its scanner, without itself.
    ///
    /// # Errors
    /// If one has not: all scanners that lack controls are named.
    pub(super) fn check<'a>(
        &self,
        path: &Path,
        heads: impl Iterator<Item = (&'a str, &'a str, &'a CellsFile)>,
    ) -> Result<(), BenchError> {
        let mut missing: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for (head, scanner, cells) in heads {
            let others = self.scanners.get(scanner).map_or(0, |found| {
                found.controls.len() - usize::from(found.controls.contains(&cells.t1))
            });
            if others < LEAST_CONTROLS as usize {
                missing.entry(scanner).or_default().push(head);
            }
        }
        if missing.is_empty() {
            return Ok(());
        }
        let listed: Vec<String> = missing
            .iter()
            .map(|(scanner, heads)| format!("\n  {scanner}: {}", heads.join(", ")))
            .collect();
        let known: Vec<&str> = self.scanners.keys().map(String::as_str).collect();
        Err(BenchError::Usage(format!(
            "{} has fewer than {LEAST_CONTROLS} controls, the head itself left out, of the scanners of these heads; it has those of {}. \
             State the scanners with --scanner COLUMN, or omit these heads with --split:{}",
            path.display(),
            known.join(", "),
            listed.concat()
        )))
    }

    /// How far the cells of a head deviate from the controls of its scanner: for a blur, and for a thick cortex; higher is more
    /// suspicious. The head itself does not count among the controls.
    fn deviations(&self, scanner: &str, head: &CellsFile) -> Vec<(u32, [f64; 2])> {
        let Some(scanner) = self.scanners.get(scanner) else {
            return Vec::new();
        };
        let is_among_them = scanner.controls.contains(&head.t1);
        let without_head = |cell: u32| {
            let found = *scanner.cells.get(&cell)?;
            Some(match head.at(cell) {
                Some(own) if is_among_them => found.changed(own, false),
                _ => found,
            })
        };
        let counted: Vec<(u32, Cell)> = (scanner.cells.keys())
            .filter_map(|&cell| Some((cell, without_head(cell)?)))
            .filter(|(_, cell)| cell.controls >= LEAST_CONTROLS)
            .collect();
        let least = [0, 1, 2, 3].map(|measure| {
            let mut deviations: Vec<f64> = counted
                .iter()
                .map(|(_, cell)| cell.deviation[measure])
                .collect();
            deviations.sort_by(f64::total_cmp);
            LEAST_DEVIATION * deviations.get(deviations.len() / 2).copied().unwrap_or(0.0)
        });
        counted
            .iter()
            .filter_map(|(cell, normal)| {
                let own = head.at(*cell)?;
                let [sharpness, detail, thickness, mean] = [0, 1, 2, 3].map(|measure| {
                    let deviation = normal.deviation[measure].max(least[measure]).max(1e-6);
                    let off = f64::from(own[measure]) - normal.mean[measure];
                    (off / deviation).clamp(-MOST_Z, MOST_Z)
                });
                let blur = -DETAIL_SHARE * detail - (1.0 - DETAIL_SHARE) * sharpness;
                Some((*cell, [blur, THICKNESS_SHARE * thickness - mean]))
            })
            .collect()
    }

    /// Three lists of marks: the cells that deviate most for a blur and for a thick cortex, and the marks of `blur` in the order of
    /// their score plus 0.35 times the deviation of their cell.
    pub(super) fn lists<'a>(
        &self,
        heads: impl Iterator<Item = (&'a str, &'a str, &'a CellsFile, &'a [FoundMark])>,
    ) -> [MarkList; 3] {
        let named = |name: &str| MarkList {
            name: name.to_owned(),
            heads: BTreeMap::new(),
            unknown: Vec::new(),
        };
        let mut lists = [
            named("normals"),
            named("normals, thickness"),
            named("blur + 0.35 normals"),
        ];
        for (name, scanner, head, blur) in heads {
            let deviations = self.deviations(scanner, head);
            let place = DAffine3::from_cols_array(&head.patient_from_common);
            let of = |sign: usize| -> BTreeMap<u32, f64> {
                let own = deviations.iter().map(|(cell, of)| (*cell, of[sign]));
                averaged(&own.collect())
            };
            for (sign, list) in lists.iter_mut().take(2).enumerate() {
                let marks = of(sign).into_iter().map(|(cell, score)| Mark {
                    position_in_patient: place.transform_point3(cell_centre(cell)),
                    score: score as f32,
                });
                list.heads.insert(name.to_owned(), greedy(marks));
            }
            let against_normals = of(0);
            let common = place.inverse();
            let added = |mark: &FoundMark| {
                let position = DVec3::from_array(mark.position_in_patient);
                let cell = cell_at(common.transform_point3(position));
                let deviation = cell.and_then(|cell| against_normals.get(&cell));
                Mark {
                    position_in_patient: position,
                    score: mark.score + (ADDED_SHARE * deviation.copied().unwrap_or(0.0)) as f32,
                }
            };
            let mut marks: Vec<Mark> = blur.iter().map(added).collect();
            marks.sort_by(|one, other| other.score.total_cmp(&one.score));
            lists[2].heads.insert(name.to_owned(), marks);
        }
        lists
    }
}

/// The mean of each cell and its 26 neighbours, as far as they have a value.
fn averaged(cells: &BTreeMap<u32, f64>) -> BTreeMap<u32, f64> {
    let mean = |cell: u32| {
        let centre = cell_centre(cell);
        let (mut sum, mut count) = (0.0, 0.0);
        for number in 0..27_u32 {
            let off = [number % 3, number / 3 % 3, number / 9].map(|along| f64::from(along) - 1.0);
            let there = cell_at(centre + DVec3::from_array(off) * CELL_MM);
            if let Some(value) = there.and_then(|there| cells.get(&there)) {
                sum += value;
                count += 1.0;
            }
        }
        sum / count
    };
    cells.keys().map(|&cell| (cell, mean(cell))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made_with() -> MadeWith {
        MadeWith::network(None).unwrap()
    }

    /// A head with the same measures in every cell, but for what is changed.
    fn head(name: &str, base: f32, changed: &[(u32, f32)]) -> CellsFile {
        let cells = (20_000..20_400).map(|cell| {
            let own = changed.iter().find(|(other, _)| *other == cell);
            let measure = own.map_or(base, |(_, value)| *value);
            (cell, [measure, measure, 2.5, 0.5])
        });
        let cells = HeadCells {
            patient_from_common: DAffine3::IDENTITY,
            cells: cells.collect(),
        };
        CellsFile::new(&made_with(), name, cells)
    }

    fn controls(count: usize) -> Vec<CellsFile> {
        (0..count)
            .map(|number| head(&format!("control {number}"), 1.0 + 0.1 * number as f32, &[]))
            .collect()
    }

    fn normals(heads: &[CellsFile]) -> Normals {
        Normals::of(&made_with(), heads.iter().map(|head| ("A 3 T", head))).0
    }

    #[test]
    fn a_control_is_never_scored_against_itself() {
        let mut all = controls(6);
        // Far below all others; if it counted among them, it would widen their deviation.
        all.push(head("odd", 0.0, &[]));
        let with = normals(&all);
        let without = normals(&all[..6]);
        let odd = &all[6];
        let [of_with, of_without] = [&with, &without].map(|found| found.deviations("A 3 T", odd));
        assert_eq!(of_with.len(), 400);
        for ((cell, [blur, _]), (other, [alone, _])) in of_with.iter().zip(&of_without) {
            assert_eq!(cell, other);
            assert!((blur - alone).abs() < 1e-6, "{blur} {alone}");
            assert!(*blur > 5.0, "{blur}");
        }
        // Another file with the same numbers counts against all of them.
        let other = head("other", 0.0, &[]);
        let deviations = with.deviations("A 3 T", &other);
        assert!(deviations[0].1[0] < of_with[0].1[0]);
    }

    #[test]
    fn mean_and_deviation_are_those_of_the_controls() {
        let found = normals(&controls(5));
        let cell = found.scanners["A 3 T"].cells[&20_000];
        assert_eq!(cell.controls, 5);
        assert!((cell.mean[0] - 1.2).abs() < 1e-6);
        // The sample deviation of 1.0, 1.1, … 1.4.
        assert!((cell.deviation[1] - 0.025_f64.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn the_cells_that_deviate_come_first_in_the_lists() {
        let found = normals(&controls(6));
        let blurred: Vec<(u32, f32)> = (20_040..20_043).map(|cell| (cell, -2.0)).collect();
        let ill = head("ill", 1.2, &blurred);
        let mark = |x: f64, score| FoundMark {
            position_in_patient: (cell_centre(20_041) + DVec3::X * x).to_array(),
            score,
            depth_mm: Some(10.0),
            side: case::PatientSide::Left,
            from_lesion_mm: None,
        };
        let blur = [mark(400.0, 2.0), mark(0.0, 1.9)];
        let heads = [("sub-1", "A 3 T", &ill, &blur[..])];
        let [own, thick, both] = found.lists(heads.into_iter());
        let first = own.heads["sub-1"][0];
        assert!(first.position_in_patient.distance(cell_centre(20_041)) < 0.1);
        assert!(
            thick.heads["sub-1"]
                .iter()
                .all(|mark| mark.score.abs() < 0.1)
        );
        let first = both.heads["sub-1"][0];
        assert!(first.score > 1.9 && first.position_in_patient.x < 300.0);
    }

    #[test]
    fn scanners_without_controls_and_other_files_are_refused() {
        let heads = controls(6);
        let found = normals(&heads);
        let path = Path::new("normals.json");
        let message = |scanner: &'static str, head: &CellsFile| {
            let checked = found.check(path, [("sub-9", scanner, head)].into_iter());
            checked.map_err(|error| error.to_string())
        };
        assert_eq!(message("A 3 T", &heads[0]), Ok(()));
        let error = message("B 1.5 T", &heads[0]).unwrap_err();
        assert!(
            error.contains("B 1.5 T: sub-9") && error.contains("A 3 T"),
            "{error}"
        );
        // Five with the head itself are too few.
        let few = normals(&heads[..5]);
        let error = few.check(path, [("sub-9", "A 3 T", &heads[0])].into_iter());
        assert!(error.is_err());
        let (nothing, left_out) =
            Normals::of(&made_with(), heads[..4].iter().map(|head| ("A 3 T", head)));
        assert_eq!(left_out, [("A 3 T".to_owned(), 4)]);
        let error = nothing.write(path, &left_out).unwrap_err().to_string();
        assert!(error.contains("at least 5 controls"), "{error}");

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("normals.json");
        found.write(&path, &[]).unwrap();
        assert_eq!(Normals::read(&path, &made_with()).unwrap(), found);
        let text = std::fs::read_to_string(&path).unwrap();
        for (from, to, words) in [
            ("{\"format\":1", "{\"format\":9", "has the format 9"),
            ("\"cell_mm\":4.0", "\"cell_mm\":5.0", "other cells"),
            ("\"network\":null", "\"network\":\"x\"", "another network"),
            ("{\"format\":1", "", "no file of normals"),
        ] {
            assert!(text.contains(from));
            std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
            let error = Normals::read(&path, &made_with()).unwrap_err().to_string();
            assert!(
                error.contains(words) && error.contains("--write-normals"),
                "{error}"
            );
        }
    }
}
