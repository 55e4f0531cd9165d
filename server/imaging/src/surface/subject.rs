//! The folder of a subject, as FreeSurfer and FastSurfer lay it out: its head, its brain, and the layers that its surfaces become.
//!
//! Only the files that are named here are read, each at its place. What is missing is left out, but for the volume.
//!
//! Source: the layout of `$SUBJECTS_DIR` in FreeSurfer's wiki (ReconAllOutputFiles), and FastSurfer's documentation of its output files.

use std::collections::BTreeMap;

use geometry::{Grid, Mask};
use serde::{Deserialize, Serialize};

use super::{Drawing, Drawn, SurfaceError, SurfaceFiles, bare, draw};
use crate::nifti::{self, Values};
use crate::{ImagingError, Limits};

/// The volumes of a subject, the best one first: conformed and of even brightness, or as it was acquired.
const VOLUMES: [&str; 3] = ["mri/T1.mgz", "mri/orig.mgz", "mri/nu.mgz"];

/// The brain of the subject: FreeSurfer's, and FastSurfer's.
const MASKS: [&str; 2] = [BRAIN, "mri/mask.mgz"];
const BRAIN: &str = "mri/brainmask.mgz";

/// What voxels have in FreeSurfer's brain that were erased by hand (FreeSurfer's wiki, Edits); the others have their intensities.
const ERASED: f32 = 1.0;

/// The regions in voxels: FreeSurfer's, and FastSurfer's.
const REGIONS: [&str; 3] = [
    "mri/aparc+aseg.mgz",
    "mri/aparc.DKTatlas+aseg.mapped.mgz",
    "mri/aparc.DKTatlas+aseg.deep.mgz",
];

/// The regions of the cortex, of which the first that is there becomes a layer: FreeSurfer's, and FastSurfer's.
const ANNOTATIONS: [&str; 3] = ["aparc", "aparc.DKTatlas", "aparc.DKTatlas.mapped"];

/// The values that become maps, and their units.
const VALUES: [(&str, &str); 3] = [("thickness", "mm"), ("curv", "1/mm"), ("sulc", "")];

const HEMISPHERES: [&str; 2] = ["lh", "rh"];

/// The most layers that a subject has.
pub const MAX_SUBJECT_LAYERS: usize = 3 + VALUES.len();

/// Every file that may be read, so that it can be looked for.
pub fn subject_files() -> impl Iterator<Item = String> {
    let volumes = VOLUMES.iter().chain(&MASKS).chain(&REGIONS);
    let of_hemispheres = HEMISPHERES.into_iter().flat_map(|half| {
        let surfaces = ["white", "pial"].into_iter();
        let surfaces = surfaces.chain(VALUES.map(|(name, _)| name));
        let surfaces = surfaces.map(move |name| format!("surf/{half}.{name}"));
        surfaces.chain(ANNOTATIONS.map(|name| annotation_of(half, name)))
    });
    volumes.map(|&name| name.to_owned()).chain(of_hemispheres)
}

/// Whether a path ends as one that makes a folder the folder of a subject: that of its volume. The part before it is returned.
pub fn subject_folder(path: &str) -> Option<&str> {
    let mut folders = VOLUMES.iter().filter_map(|name| path.strip_suffix(name));
    folders.find(|folder| folder.is_empty() || folder.ends_with('/'))
}

fn annotation_of(half: &str, name: &str) -> String {
    format!("label/{half}.{name}.annot")
}

/// What is wrong with a file of a subject.
#[derive(Debug, thiserror::Error)]
#[error("{file}: {error}")]
pub struct SubjectError {
    /// Its path below the folder, which is one of [`subject_files`]; of what several files draw together, what they have in common.
    pub file: String,
    /// What is wrong.
    pub error: SurfaceError,
}

/// A layer of a subject.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SubjectLayer {
    /// The volume, as a file.
    #[serde(skip)]
    pub file: Vec<u8>,
    /// Its name.
    pub name: String,
    /// The unit of its values.
    pub unit: String,
    /// Whether its values are numbers of labels.
    pub are_labels: bool,
    /// The names of labels.
    pub names: BTreeMap<u32, String>,
    /// What was drawn; `None` of regions in voxels.
    pub drawn: Option<Drawn>,
}

/// What is read of the folder of a subject.
#[derive(Debug)]
pub struct Subject {
    /// The file of the volume.
    pub volume: Vec<u8>,
    /// The file of the brain, which is above 0 there.
    pub mask: Option<Vec<u8>>,
    /// What else belongs to the head.
    pub layers: Vec<SubjectLayer>,
}

/// The files of a subject, by their paths below its folder; `None` if one is not there.
pub type ReadFile<'a> = &'a mut dyn FnMut(&str) -> Result<Option<Vec<u8>>, SubjectError>;

/// Reads the folder of a subject; `None` if it has no volume.
///
/// # Errors
/// If a file cannot be read, is damaged, or does not belong to the others.
pub fn subject(read: ReadFile<'_>, limits: &Limits) -> Result<Option<Subject>, SubjectError> {
    let Some((name, volume)) = first(read, &VOLUMES)? else {
        return Ok(None);
    };
    let grid = nifti::read_grid(&volume, limits);
    let grid = grid.map_err(|error| of_file(name)(damaged("volume", error)))?;
    let mask = match first(read, &MASKS)? {
        Some((name @ BRAIN, brain)) => {
            let brain = without_erased(brain, limits);
            Some(brain.map_err(|error| of_file(name)(damaged("mask", error)))?)
        }
        mask => mask.map(|(_, mask)| mask),
    };
    let drawer = Drawer {
        t1: &volume,
        grid: &grid,
        limits,
    };
    let mut layers = Vec::new();
    let (mut surfaces, mut whites) = (Vec::new(), Vec::new());
    for kind in ["white", "pial"] {
        for half in HEMISPHERES {
            let name = format!("{half}.{kind}");
            let Some(surface) = read(&format!("surf/{name}"))? else {
                continue;
            };
            if kind == "white" {
                whites.push((half, surfaces.len()));
            }
            let files = SurfaceFiles {
                surface: &surface,
                values: None,
            };
            bare(files, Some(&grid), None, 1).map_err(of_file(&format!("surf/{name}")))?;
            surfaces.push((name, surface));
        }
    }
    let contours = surfaces.iter().map(|(_, surface)| SurfaceFiles {
        surface,
        values: None,
    });
    let contours: Vec<_> = contours.collect();
    if !contours.is_empty() {
        let mut contours = drawer.layer("white and pial", ("", true), &contours, "surf")?;
        let names = surfaces.iter().map(|(name, _)| name.clone());
        contours.names = (1..).zip(names).collect();
        layers.push(contours);
    }
    let mut on_white = |file: &dyn Fn(&str) -> String| {
        let mut found = Vec::new();
        for &(half, number) in &whites {
            let file = file(half);
            let Some(values) = read(&file)? else {
                continue;
            };
            let files = SurfaceFiles {
                surface: &surfaces[number].1,
                values: Some(&values),
            };
            super::read(files, Some(&grid), None, None).map_err(of_file(&file))?;
            found.push((number, values));
        }
        Ok::<_, SubjectError>(found)
    };
    let draw = |found: &[(usize, Vec<u8>)], name: &str, values: (&str, bool)| {
        let found = found.iter().map(|(number, values)| SurfaceFiles {
            surface: &surfaces[*number].1,
            values: Some(values),
        });
        let found: Vec<_> = found.collect();
        drawer.layer(name, values, &found, name)
    };
    for (name, unit) in VALUES {
        let found = on_white(&|half| format!("surf/{half}.{name}"))?;
        if !found.is_empty() {
            layers.push(draw(&found, name, (unit, false))?);
        }
    }
    let mut names = BTreeMap::new();
    for name in ANNOTATIONS {
        let found = on_white(&|half| annotation_of(half, name))?;
        if found.is_empty() {
            continue;
        }
        let drawn = draw(&found, name, ("", true))?;
        names = drawn.names.clone();
        layers.push(drawn);
        break;
    }
    if let Some((name, file)) = first(read, &REGIONS)? {
        check_labels(&file, limits).map_err(of_file(name))?;
        let name = name.trim_start_matches("mri/").trim_end_matches(".mgz");
        layers.push(SubjectLayer {
            file,
            name: name.to_owned(),
            unit: String::new(),
            are_labels: true,
            names: region_names(&names),
            drawn: None,
        });
    }
    Ok(Some(Subject {
        volume,
        mask,
        layers,
    }))
}

/// FreeSurfer's brain without what was erased by hand. A file of zeros and ones is a plain mask, and stays as it is.
fn without_erased(brain: Vec<u8>, limits: &Limits) -> Result<Vec<u8>, ImagingError> {
    let Values { grid, numbers, .. } = nifti::read_values(&brain, limits)?;
    let has_intensities = numbers.iter().any(|number| *number > ERASED);
    if !has_intensities || !numbers.contains(&ERASED) {
        return Ok(brain);
    }
    let kept = numbers.into_iter().map(|number| number > ERASED);
    nifti::write_mask(&Mask::new(grid, kept.collect())?)
}

fn of_file(file: &str) -> impl FnOnce(SurfaceError) -> SubjectError {
    let file = file.to_owned();
    |error| SubjectError { file, error }
}

fn damaged(part: &'static str, what: impl ToString) -> SurfaceError {
    let what = what.to_string();
    SurfaceError::Damaged { part, what }
}

/// Checks that a file has labels of voxels.
fn check_labels(file: &[u8], limits: &Limits) -> Result<(), SurfaceError> {
    let values = nifti::read_values(file, limits);
    let numbers = values.map_err(|error| damaged("labels", error))?.numbers;
    // Larger numbers are not exact in single precision.
    let is_label = |number: &f32| number.fract() == 0.0 && (0.0..16_777_216.0).contains(number);
    if !numbers.iter().all(is_label) {
        let what = "a voxel has a value that is not the number of a label";
        return Err(damaged("labels", what));
    }
    if numbers.iter().all(|&number| number == 0.0) {
        return Err(damaged("labels", "no voxel has a label"));
    }
    Ok(())
}

/// The first of some files that is there, and its name.
fn first<'a>(
    read: ReadFile<'_>,
    names: &[&'a str],
) -> Result<Option<(&'a str, Vec<u8>)>, SubjectError> {
    for &name in names {
        if let Some(file) = read(name)? {
            return Ok(Some((name, file)));
        }
    }
    Ok(None)
}

/// Draws surfaces into the voxels of the volume of a subject.
struct Drawer<'a> {
    t1: &'a [u8],
    grid: &'a Grid,
    limits: &'a Limits,
}

impl Drawer<'_> {
    /// A layer of surfaces, each perhaps with values. `file` is what an error names.
    fn layer(
        &self,
        name: &str,
        (unit, are_labels): (&str, bool),
        files: &[SurfaceFiles<'_>],
        file: &str,
    ) -> Result<SubjectLayer, SubjectError> {
        let affine = self.grid.patient_from_voxel();
        let row = |axis: usize| {
            let matrix = affine.matrix3;
            let [x, y, z] =
                [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|column| column[axis]);
            [x, y, z, affine.translation[axis]]
        };
        let drawing = Drawing {
            size: self.grid.size(),
            patient_from_voxel: [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
            space: None,
            column: None,
            are_labels: Some(are_labels),
        };
        let drawn = draw(files, Some(self.t1), &drawing, self.limits);
        let (nifti, drawn) = drawn.map_err(of_file(file))?;
        Ok(SubjectLayer {
            file: nifti,
            name: name.to_owned(),
            unit: unit.to_owned(),
            are_labels,
            names: drawn.names.clone(),
            drawn: Some(drawn),
        })
    }
}

/// The numbers of the regions of the cortex in voxels: those of the annotation, from these on, left and right.
const CORTEX_FROM: [(u32, &str); 2] = [(1000, "ctx-lh"), (2000, "ctx-rh")];

/// The names of regions in voxels: below the cortex those of FreeSurfer's table, in it those of an annotation.
fn region_names(of_cortex: &BTreeMap<u32, String>) -> BTreeMap<u32, String> {
    let below = BELOW_CORTEX.iter();
    let below = below.map(|&(number, name)| (number, name.to_owned()));
    let cortex = CORTEX_FROM.into_iter().flat_map(|(first, side)| {
        let names = of_cortex.iter();
        names.map(move |(number, name)| (first.saturating_add(*number), format!("{side}-{name}")))
    });
    below.chain(cortex).collect()
}

/// The numbers and names of structures in `aseg.mgz`, which FreeSurfer and FastSurfer share.
const BELOW_CORTEX: [(u32, &str); 45] = [
    (2, "Left-Cerebral-White-Matter"),
    (3, "Left-Cerebral-Cortex"),
    (4, "Left-Lateral-Ventricle"),
    (5, "Left-Inf-Lat-Vent"),
    (7, "Left-Cerebellum-White-Matter"),
    (8, "Left-Cerebellum-Cortex"),
    (10, "Left-Thalamus"),
    (11, "Left-Caudate"),
    (12, "Left-Putamen"),
    (13, "Left-Pallidum"),
    (14, "3rd-Ventricle"),
    (15, "4th-Ventricle"),
    (16, "Brain-Stem"),
    (17, "Left-Hippocampus"),
    (18, "Left-Amygdala"),
    (24, "CSF"),
    (26, "Left-Accumbens-area"),
    (28, "Left-VentralDC"),
    (30, "Left-vessel"),
    (31, "Left-choroid-plexus"),
    (41, "Right-Cerebral-White-Matter"),
    (42, "Right-Cerebral-Cortex"),
    (43, "Right-Lateral-Ventricle"),
    (44, "Right-Inf-Lat-Vent"),
    (46, "Right-Cerebellum-White-Matter"),
    (47, "Right-Cerebellum-Cortex"),
    (49, "Right-Thalamus"),
    (50, "Right-Caudate"),
    (51, "Right-Putamen"),
    (52, "Right-Pallidum"),
    (53, "Right-Hippocampus"),
    (54, "Right-Amygdala"),
    (58, "Right-Accumbens-area"),
    (60, "Right-VentralDC"),
    (62, "Right-vessel"),
    (63, "Right-choroid-plexus"),
    (77, "WM-hypointensities"),
    (80, "non-WM-hypointensities"),
    (85, "Optic-Chiasm"),
    (251, "CC_Posterior"),
    (252, "CC_Mid_Posterior"),
    (253, "CC_Central"),
    (254, "CC_Mid_Anterior"),
    (255, "CC_Anterior"),
    (72, "5th-Ventricle"),
];
