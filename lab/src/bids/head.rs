//! One head of a trial: prepared as a case is, with the candidates of its map and the places of its truths. The result is a file, so
//! that an interrupted trial continues.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use analysis::{Doubt, Head, MidsagittalPlane, Registration, Verdict, depth_at, register};
use case::{CaseFacts, MapName, MaskMethod, Parameters, PatientSide, QualityState};
use geometry::{DepthField, Mask};
use glam::{DAffine3, DVec3};
use imaging::{Limits, nifti};
use pipeline::maps::{CaseMaps, compute_maps, mirror_plane, side_at};
use pipeline::{HeadLimits, Pipeline, Prepared, Source};
use serde::{Deserialize, Serialize};

use super::folder::{HeadFiles, name_of, stem_of};
use super::truth::{Lesion, Lesions, Rules};
use crate::BenchError;
use crate::files::{read, write};
use crate::study::{Ground, SEED as STUDY_SEED, seed_of};

/// The version of the files of results. It increases if their content changes.
const FORMAT: u32 = 1;

/// The number of random cortical places of a head.
pub(super) const PLACES: usize = 200;

/// The seed of all random choices.
pub(super) const SEED: u64 = STUDY_SEED;

/// What the result of a head depends on, except its files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct MadeWith {
    format: u32,
    version: String,
    map_format: u32,
    places: usize,
    seed: u64,
    /// The hash of the weights of the network; `None` if brains are extracted by tree pruning.
    network: Option<String>,
}

impl MadeWith {
    /// # Errors
    /// If the weights cannot be read.
    pub(super) fn network(weights: Option<&Path>) -> Result<Self, BenchError> {
        let network = weights.map(|path| Ok::<_, BenchError>(hash(&read(path)?)));
        Ok(Self {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            map_format: analysis::MAP_FORMAT,
            places: PLACES,
            seed: SEED,
            network: network.transpose()?,
        })
    }
}

/// The hash of some bytes, BLAKE3 in hexadecimal.
pub(super) fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// A file of a head, by its name, with its hash.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct FileHash {
    name: String,
    pub(super) blake3: String,
}

/// The stored result of a head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct HeadResult {
    made_with: MadeWith,
    pub(super) head: String,
    /// The volume, then the truths and the FLAIR that they were drawn on.
    pub(super) files: Vec<FileHash>,
    pub(super) outcome: Outcome,
}

/// Whether a head has maps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Outcome {
    Maps(Box<Found>),
    /// It is no usable head, or has no maps: the stable name and the sentence of the reason.
    NoMaps {
        code: String,
        sentence: String,
    },
}

/// What was found in a head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Found {
    /// The edges of a voxel.
    pub(super) voxel_mm: [f64; 3],
    pub(super) mask_method: MaskMethod,
    pub(super) mask_state: QualityState,
    pub(super) mask_reasons: Vec<String>,
    /// The normal of the plane between the hemispheres, towards the patient's left, and its distance from the origin.
    pub(super) plane: ([f64; 3], f64),
    /// Whether the maps count the cerebrum alone.
    pub(super) regions_state: QualityState,
    /// The candidates of the map `blur`, the highest first.
    pub(super) marks: Vec<FoundMark>,
    pub(super) truths: Vec<PlacedTruth>,
    pub(super) lesions: Vec<FoundLesion>,
    /// Random cortical places, LPS mm, for lesions moved by chance.
    pub(super) places: Vec<[f64; 3]>,
}

/// A candidate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct FoundMark {
    /// LPS mm.
    pub(super) position_in_patient: [f64; 3],
    pub(super) score: f32,
    pub(super) depth_mm: Option<f32>,
    pub(super) side: PatientSide,
    /// The distance from the border of the nearest lesion; 0 inside, `None` without a lesion.
    pub(super) from_lesion_mm: Option<f64>,
}

/// A truth and its place in the head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct PlacedTruth {
    /// The name of its file.
    pub(super) file: String,
    pub(super) place: TruthPlace,
    /// The transform from its patient space to that of the head, LPS mm: the columns of the axes, then the translation.
    head_from_truth: [f64; 12],
    /// The residual of the registration of the FLAIR.
    pub(super) residual_mm: Option<f64>,
}

/// How a truth was brought to the T1-weighted volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum TruthPlace {
    /// It was drawn on the T1-weighted volume.
    T1,
    /// It was drawn on the FLAIR, which was registered.
    FlairRegistered,
    /// It was drawn on the FLAIR, which fits where its header places it.
    FlairUnchanged,
    /// It was drawn on the FLAIR, whose registration cannot be trusted; it lies where its header places it.
    FlairDoubtful,
    /// It was drawn on a FLAIR that is missing; it lies where its header places it.
    FlairMissing,
}

impl TruthPlace {
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::T1 => "drawn on the T1",
            Self::FlairRegistered => "drawn on the FLAIR, registered",
            Self::FlairUnchanged => "drawn on the FLAIR, fits by its header",
            Self::FlairDoubtful => "drawn on the FLAIR, registration in doubt",
            Self::FlairMissing => "drawn on a FLAIR that is missing",
        }
    }
}

/// A lesion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct FoundLesion {
    pub(super) volume_ml: f64,
    /// LPS mm.
    pub(super) centre_in_patient: [f64; 3],
    /// The depth of its centre below the envelope, in mm; 0 outside.
    pub(super) depth_mm: f32,
    pub(super) side: PatientSide,
    /// The share of its voxels at which the map `blur` is defined.
    pub(super) defined_share: f64,
}

impl PlacedTruth {
    fn head_from_truth(&self) -> DAffine3 {
        DAffine3::from_cols_array(&self.head_from_truth)
    }
}

impl Found {
    pub(super) fn mirror_plane(&self) -> MidsagittalPlane {
        let (normal, offset_mm) = self.plane;
        MidsagittalPlane::new(DVec3::from_array(normal), offset_mm)
            .expect("the normal of a stored plane has a direction")
    }

    /// The lesions of the head, read from the truths again.
    pub(super) fn read_lesions(
        &self,
        files: &HeadFiles,
        rules: &Rules,
    ) -> Result<Lesions, BenchError> {
        let read = |truth: &PlacedTruth| {
            let path = files.truths.iter().find(|path| name_of(path) == truth.file);
            let path = path.ok_or_else(|| {
                BenchError::Usage(format!("the truth {} has disappeared", truth.file))
            })?;
            Ok((read_truth(path)?, truth.head_from_truth()))
        };
        let truths: Result<Vec<_>, BenchError> = self.truths.iter().map(read).collect();
        Ok(Lesions::of(&truths?, rules))
    }
}

fn read_truth(path: &Path) -> Result<Mask, BenchError> {
    Ok(nifti::read_mask(&read(path)?, &Limits::default())?)
}

/// The work on heads.
pub(super) struct Finder<'a> {
    pub(super) pipeline: &'a Pipeline,
    pub(super) made_with: &'a MadeWith,
    pub(super) results: &'a Path,
}

impl Finder<'_> {
    /// The file of results of a head.
    pub(super) fn path(&self, head: &str) -> PathBuf {
        self.results.join(format!("{head}.json"))
    }

    /// The result of a head, from its file or computed; and whether it was computed.
    ///
    /// # Errors
    /// If a file cannot be read or written, or the stored result was made otherwise or from other files.
    pub(super) fn find(
        &self,
        head: &HeadFiles,
        has_truths: bool,
    ) -> Result<(HeadResult, bool), BenchError> {
        let truths: &[PathBuf] = if has_truths { &head.truths } else { &[] };
        let t1 = &head.t1[0];
        let flair = truths
            .iter()
            .any(|truth| is_drawn_on_flair(truth, t1, &head.flair))
            .then(|| head.flair.first())
            .flatten();
        let mut files = Vec::new();
        for path in std::iter::once(t1).chain(truths).chain(flair) {
            files.push(FileHash {
                name: name_of(path),
                blake3: hash(&read(path)?),
            });
        }
        let path = self.path(&head.name);
        if let Some(stored) = self.stored(&path, &files)? {
            return Ok((stored, false));
        }
        let outcome = self.outcome(head, truths, flair)?;
        let result = HeadResult {
            made_with: self.made_with.clone(),
            head: head.name.clone(),
            files,
            outcome,
        };
        let bytes = serde_json::to_vec_pretty(&result).expect("numbers and names");
        write_whole(&path, &bytes)?;
        Ok((result, true))
    }

    fn stored(&self, path: &Path, files: &[FileHash]) -> Result<Option<HeadResult>, BenchError> {
        let Ok(bytes) = std::fs::read(path) else {
            return Ok(None);
        };
        let refused = |reason: &str| {
            let path = path.display();
            BenchError::Usage(format!(
                "{path} {reason}; remove it, or name another directory with --results"
            ))
        };
        let stored: HeadResult = serde_json::from_slice(&bytes)
            .map_err(|error| refused(&format!("is not a result of a trial: {error}")))?;
        if stored.made_with != *self.made_with {
            return Err(refused(
                "was made by another version, or with another network",
            ));
        }
        if stored.files != files {
            return Err(refused("was made from other files"));
        }
        Ok(Some(stored))
    }

    fn outcome(
        &self,
        head: &HeadFiles,
        truths: &[PathBuf],
        flair: Option<&PathBuf>,
    ) -> Result<Outcome, BenchError> {
        let no_maps = |code, sentence| Ok(Outcome::NoMaps { code, sentence });
        let bytes = read(&head.t1[0])?;
        let limits = Limits::default();
        let prepared = HeadLimits::default().check(&bytes, &limits).and_then(|_| {
            let source = Source {
                volume: bytes.into(),
                ..Source::default()
            };
            let parameters = Parameters::default();
            let never = AtomicBool::new(false);
            self.pipeline
                .prepare(&source, &parameters, &limits, &|_| {}, &never)
        });
        let prepared = match prepared {
            Ok(prepared) => prepared,
            Err(failure) if failure.kind == case::FailureKind::OutOfMemory => {
                return Err(BenchError::Usage(format!(
                    "{}: {failure}; use fewer --jobs",
                    head.name
                )));
            }
            Err(failure) => {
                return no_maps(failure.name, failure.detail);
            }
        };
        let volume = prepared.built.model.volume();
        let maps = match compute_maps(&prepared.facts, prepared.envelope(), volume) {
            Ok(maps) => maps,
            Err(reason) => {
                return no_maps(reason.code.into_owned(), reason.sentence.into_owned());
            }
        };
        let registered = match flair {
            Some(path) => {
                let flair = nifti::read_volume(&read(path)?, &limits)?;
                Some(register(volume, prepared.envelope(), &flair))
            }
            None => None,
        };
        let placed = |truth: &PathBuf| {
            let is_on_flair = is_drawn_on_flair(truth, &head.t1[0], &head.flair);
            placed(truth, is_on_flair, registered.as_ref())
        };
        let truths = truths.iter().map(placed).collect();
        let found = found(&head.name, &prepared, &maps, truths, |found| {
            found.read_lesions(head, &Rules::STANDARD)
        })?;
        Ok(Outcome::Maps(Box::new(found)))
    }
}

/// Writes a file whole: a run that is interrupted leaves none.
fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), BenchError> {
    let part = path.with_extension("json.part");
    write(&part, bytes)?;
    std::fs::rename(&part, path).map_err(|error| BenchError::unwritable(path, &error))
}

/// Whether a truth was drawn on the FLAIR: its name without `_roi` is that of a FLAIR, or it has the voxels of the FLAIR, and not those
/// of the T1-weighted volume.
fn is_drawn_on_flair(truth: &Path, t1: &Path, flair: &[PathBuf]) -> bool {
    let stem = stem_of(truth);
    if stem.contains("_FLAIR") {
        return true;
    }
    let Some(flair) = flair.first() else {
        return false;
    };
    if stem.contains("_T1w") {
        return false;
    }
    let grid = |path: &Path| nifti::read_grid(&read(path).ok()?, &Limits::default()).ok();
    let [truth, t1, flair] = [truth, t1, flair].map(grid);
    let is_same = |other: &Option<geometry::Grid>| match (&truth, other) {
        (Some(one), Some(other)) => {
            one.size() == other.size()
                && one
                    .patient_from_voxel()
                    .abs_diff_eq(other.patient_from_voxel(), 1e-3)
        }
        _ => false,
    };
    is_same(&flair) && !is_same(&t1)
}

fn placed(truth: &Path, is_on_flair: bool, registered: Option<&Registration>) -> PlacedTruth {
    let place = match registered.map(|found| found.verdict) {
        _ if !is_on_flair => TruthPlace::T1,
        None => TruthPlace::FlairMissing,
        Some(Verdict::Registered) => TruthPlace::FlairRegistered,
        Some(Verdict::Unchanged) => TruthPlace::FlairUnchanged,
        Some(Verdict::Failed(
            Doubt::NoContrast | Doubt::Overlap | Doubt::Mirrored | Doubt::Parts,
        )) => TruthPlace::FlairDoubtful,
    };
    let registered = registered.filter(|_| is_on_flair);
    PlacedTruth {
        file: name_of(truth),
        place,
        head_from_truth: registered
            .map_or(DAffine3::IDENTITY, |found| found.case_from_layer)
            .to_cols_array(),
        residual_mm: registered.and_then(|found| found.residual_mm),
    }
}

fn found(
    head: &str,
    prepared: &Prepared,
    maps: &CaseMaps,
    truths: Vec<PlacedTruth>,
    lesions: impl Fn(&Found) -> Result<Lesions, BenchError>,
) -> Result<Found, BenchError> {
    let facts: &CaseFacts = &prepared.facts;
    let plane = mirror_plane(facts);
    let depth = DepthField::new(&prepared.built.distance);
    let quality = facts.quality.as_ref().expect("a prepared head is rated");
    let ground = Ground::new(Head {
        volume: prepared.built.model.volume(),
        depth: &depth,
        plane: &plane,
    })?;
    let places = ground.places(PLACES, seed_of(head)).into_iter();
    let mut found = Found {
        voxel_mm: facts.native_spacing_mm,
        mask_method: quality.method,
        mask_state: quality.state,
        mask_reasons: quality.reason_codes.clone(),
        plane: (plane.normal().to_array(), plane.offset_mm()),
        regions_state: maps.regions.state,
        marks: Vec::new(),
        truths,
        lesions: Vec::new(),
        places: places
            .map(|place| place.position_in_patient.to_array())
            .collect(),
    };
    let lesions = lesions(&found)?.lesions;
    let facts_of = |lesion: &Lesion| {
        let centre = lesion.centre_in_head();
        let place = depth.grid().voxel_from_patient().transform_point3(centre);
        FoundLesion {
            volume_ml: lesion.volume_ml(),
            centre_in_patient: centre.to_array(),
            depth_mm: depth_at(&depth, place.as_vec3()).max(0.0),
            side: side_at(facts, centre),
            defined_share: defined_share(maps, lesion),
        }
    };
    found.lesions = lesions.iter().map(facts_of).collect();
    found.marks = maps
        .candidates
        .iter()
        .map(|candidate| {
            let position = DVec3::from_array(candidate.position_in_patient);
            let distances = lesions.iter().map(|lesion| lesion.distance_mm(position));
            FoundMark {
                position_in_patient: candidate.position_in_patient,
                score: candidate.score,
                depth_mm: candidate.depth_mm,
                side: candidate.side,
                from_lesion_mm: distances.reduce(f64::min),
            }
        })
        .collect();
    Ok(found)
}

/// The share of the voxels of a lesion at which the map `blur` is defined.
fn defined_share(maps: &CaseMaps, lesion: &Lesion) -> f64 {
    let map = maps.map(MapName::Blur);
    let grid = map.grid();
    let is_defined = |position: &DVec3| {
        let place = grid.voxel_from_patient().transform_point3(*position);
        grid.contains(place) && {
            let voxel = place
                .round()
                .to_array()
                .map(|along| along.max(0.0) as usize);
            let inside = [0, 1, 2].map(|axis| voxel[axis].min(grid.size()[axis] - 1));
            !map.value(grid.index(inside)).is_nan()
        }
    };
    let positions = lesion.positions_in_head();
    let defined = positions.iter().filter(|position| is_defined(position));
    defined.count() as f64 / positions.len().max(1) as f64
}
