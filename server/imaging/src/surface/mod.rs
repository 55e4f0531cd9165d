//! Surfaces of the cortex and values of their vertices: FreeSurfer's binary triangles, `curv`, MGH overlays and annotations, and GIFTI 1.0.
//!
//! Every count is compared with the bytes that are there before memory is allocated. No entity is expanded, and no other file is opened.
//! Coordinates are those of scanner space only if the file states it, or states the volume of its `tkregister` space; nothing is guessed.
//!
//! Source: FreeSurfer's `MRISwrite` and `mghRASToVoxel` conventions as its wiki describes them (FileFormats, CoordinateSystems); GIFTI Surface
//! Data Format 1.0 (<https://www.nitrc.org/projects/gifti>).

mod freesurfer;
mod gifti;
mod sheet;
mod subject;

use std::collections::BTreeMap;

use geometry::Grid;
use glam::{DAffine3, DMat3, DMat4, DVec3};
use serde::{Deserialize, Serialize};

use crate::{ImagingError, Limits, nifti};

pub use sheet::{HALF_THICKNESS_MM, Sheet, sheet};
pub use subject::{
    MAX_SUBJECT_LAYERS, ReadFile, Subject, SubjectError, SubjectLayer, subject, subject_files,
    subject_folder,
};

/// The most vertices of a surface. A hemisphere has 150,000 at 1 mm.
pub const MAX_VERTICES: usize = 1_000_000;

/// The most triangles of a surface.
pub const MAX_TRIANGLES: usize = 2 * MAX_VERTICES;

/// What is wrong with a surface or its values.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
pub enum SurfaceError {
    #[error(
        "the {part} is neither GIFTI nor a file of FreeSurfer: send a binary triangle surface; as values a `curv` file of the new kind, an overlay in an MGH \
         file or an annotation; or GIFTI, not gzipped"
    )]
    NotRecognised { part: &'static str },
    #[error("the {part} cannot be read: {what}")]
    Damaged { part: &'static str, what: String },
    #[error("the {part} has {what}, which is not supported; convert it, for example with nibabel")]
    Unsupported { part: &'static str, what: String },
    #[error("there are {count} {what}; at most {most} are accepted")]
    TooMany {
        what: &'static str,
        count: u64,
        most: u64,
    },
    #[error(
        "the values are of {values} vertices, and the surface has {vertices}; they do not belong together"
    )]
    OfAnother { values: usize, vertices: usize },
    #[error("the values have {count} columns; state which with `column`, from 1")]
    ManyColumns { count: usize },
    #[error(
        "the values have {count} columns, and `column` is {column}; columns are numbered from 1"
    )]
    NoSuchColumn { count: usize, column: usize },
    #[error(
        "the surface has no values; send them as the part `values`, or omit `kind` to draw the surface itself"
    )]
    NoValues,
    #[error(
        "the label {number} has different names in the files of the hemispheres; send them as two layers"
    )]
    NamesDiffer { number: u32 },
    #[error(
        "the place of the surface in the scanner is not known: its coordinates are `tkregister` RAS, and it has no footer with a valid volume geometry; \
         send the T1 of its subject (mri/T1.mgz or mri/orig.mgz) as the part `t1`"
    )]
    NoVolume,
    #[error(
        "the GIFTI file does not state that its coordinates are those of the scanner (NIFTI_XFORM_SCANNER_ANAT); state with `space` what they are: \
         `scanner`, or `tkregister` with the T1 of its subject as the part `t1`"
    )]
    SpaceNotStated,
    #[error(
        "the triangles of the surface are too large or too many to be drawn into voxels; send one with smaller triangles"
    )]
    TooLarge,
    #[error(
        "nothing of the surface lies in the volume of the case; is it of another head, or is its space another one than it states?"
    )]
    Outside,
}

impl SurfaceError {
    /// The stable name.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::NotRecognised { .. } => "surface-not-recognised",
            Self::Damaged { .. } => "surface-damaged",
            Self::Unsupported { .. } => "surface-unsupported",
            Self::TooMany { .. } | Self::TooLarge => "surface-too-large",
            Self::OfAnother { .. } => "values-of-another-surface",
            Self::NamesDiffer { .. } => "labels-differ",
            Self::ManyColumns { .. } | Self::NoSuchColumn { .. } => "values-column",
            Self::NoValues => "values-missing",
            Self::NoVolume | Self::SpaceNotStated => "surface-space-unknown",
            Self::Outside => "layer-outside-head",
        }
    }

    /// Whether a limit is exceeded.
    pub fn is_too_large(&self) -> bool {
        matches!(self, Self::TooMany { .. } | Self::TooLarge)
    }
}

/// What a client states about the coordinates of a file that does not state it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Space {
    /// They are scanner RAS mm.
    Scanner,
    /// They are `tkregister` RAS mm.
    Tkregister,
}

/// What a file states about its coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
enum StatedSpace {
    /// How they become scanner RAS.
    Scanner(DAffine3),
    /// `tkregister` RAS, perhaps with the way to scanner RAS.
    Tkregister(Option<DAffine3>),
    Nothing,
}

/// A surface as a file has it.
#[derive(Debug)]
struct Surface {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    space: StatedSpace,
}

/// The values of a file, column by column.
#[derive(Debug, Default)]
struct Columns {
    columns: Vec<Vec<f32>>,
    /// The names of labels.
    names: BTreeMap<u32, String>,
    /// Whether the file states that they are labels.
    are_labels: bool,
}

/// A surface in the patient, with a value for each vertex.
#[derive(Debug)]
pub struct ValuedSurface {
    /// LPS mm.
    pub positions_in_patient: Vec<DVec3>,
    /// Numbers of vertices.
    pub triangles: Vec<[u32; 3]>,
    /// NaN where there is none.
    pub values: Vec<f32>,
    /// The names of labels that the file of the values states.
    pub names: BTreeMap<u32, String>,
    /// Whether that file states that they are labels.
    pub are_labels: bool,
}

/// How surfaces are drawn into voxels.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawing {
    /// The size of the grid.
    pub size: [usize; 3],
    /// The rows of its affine, LPS mm.
    pub patient_from_voxel: [[f64; 4]; 4],
    /// What the client states about coordinates.
    pub space: Option<Space>,
    /// Which column of the values, from 1.
    pub column: Option<usize>,
    /// Whether the values are numbers of labels; if it is not stated, the files decide, and a surface without values is a label itself.
    pub are_labels: Option<bool>,
}

/// What was drawn.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawn {
    /// Of all surfaces together.
    pub vertices: u32,
    /// Of all surfaces together.
    pub triangles: u32,
    /// How thick the sheet of voxels is.
    pub thickness_mm: f32,
    /// Whether the values are numbers of labels.
    pub are_labels: bool,
    /// The names of labels.
    pub names: BTreeMap<u32, String>,
}

/// The most vertices whose places are kept.
const MAX_PLACES: usize = 10_000;

/// The first line of the comment with the places of vertices. Each further line has one, and an empty line begins the next surface.
const PLACES: &str = "places on surfaces, LPS mm\n";

/// The places of some vertices of each surface that a volume was drawn from, LPS mm; `None` if it does not have them.
pub fn places(volume: &[u8]) -> Option<Vec<Vec<DVec3>>> {
    let comment = nifti::comment_of(volume)?;
    let place = |line: &str| {
        let along: Result<Vec<f64>, _> = line.split(' ').map(str::parse).collect();
        let place: [f64; 3] = along.ok()?.try_into().ok()?;
        Some(DVec3::from_array(place)).filter(|place| place.is_finite())
    };
    let surfaces = comment.strip_prefix(PLACES)?.split("\n\n");
    surfaces
        .map(|lines| lines.lines().map(place).collect())
        .collect()
}

/// Reads surfaces with their values and draws them into a volume, which is returned as `.nii.gz` in single precision, NaN away from them, with
/// the [`places`] of some vertices. `t1` is the file of the volume that `tkregister` coordinates belong to. Surfaces of which
/// none has values have their numbers as values, from 1.
///
/// # Errors
/// As [`read`] and [`sheet`]; if a label has two names.
pub fn draw(
    files: &[SurfaceFiles<'_>],
    t1: Option<&[u8]>,
    drawing: &Drawing,
    limits: &Limits,
) -> Result<(Vec<u8>, Drawn), SurfaceError> {
    let unusable = |part| {
        move |error: ImagingError| SurfaceError::Damaged {
            part,
            what: error.to_string(),
        }
    };
    let t1 = t1.map(|t1| nifti::read_grid(t1, limits)).transpose();
    let t1 = t1.map_err(unusable("T1"))?;
    let rows = drawing.patient_from_voxel.as_flattened();
    let affine = DMat4::from_cols_slice(rows).transpose();
    let grid = Grid::new(drawing.size, DAffine3::from_mat4(affine));
    let grid = grid.map_err(|error| unusable("case")(error.into()))?;
    let may_be_bare = files.iter().all(|files| files.values.is_none())
        && drawing.are_labels != Some(false)
        && drawing.column.is_none();
    let read = |(number, &files): (u32, &SurfaceFiles<'_>)| {
        let (t1, space) = (t1.as_ref(), drawing.space);
        match read(files, t1, space, drawing.column) {
            Err(SurfaceError::NoValues) if may_be_bare => {
                bare(files, t1, space, number).map(|surface| (true, surface))
            }
            read => read.map(|surface| (false, surface)),
        }
    };
    let surfaces = (1..).zip(files).map(read).collect::<Result<Vec<_>, _>>()?;
    let (are_bare, surfaces): (Vec<_>, Vec<_>) = surfaces.into_iter().unzip();
    // Beside values that were given, the number of a surface would be taken for one.
    if are_bare.contains(&true) && are_bare.contains(&false) {
        return Err(SurfaceError::NoValues);
    }
    let state_labels = surfaces.iter().all(|surface| surface.are_labels);
    let are_labels = drawing.are_labels.unwrap_or(state_labels);
    let mut names = BTreeMap::new();
    for (&number, name) in surfaces.iter().flat_map(|surface| &surface.names) {
        let known = names.insert(number, name.clone());
        if are_labels && known.is_some_and(|known| known != *name) {
            return Err(SurfaceError::NamesDiffer { number });
        }
    }
    let sheet = sheet(&surfaces, &grid, are_labels)?;
    let count = |of: fn(&ValuedSurface) -> usize| surfaces.iter().map(of).sum::<usize>() as u32;
    let vertices = count(|surface| surface.positions_in_patient.len());
    let every = (vertices as usize).div_ceil(MAX_PLACES).max(1);
    let line = |place: &DVec3| format!("{:.2} {:.2} {:.2}", place.x, place.y, place.z);
    let lines = surfaces.iter().map(|surface| {
        let places = surface.positions_in_patient.iter().step_by(every);
        places.map(line).collect::<Vec<_>>().join("\n")
    });
    let comment = format!("{PLACES}{}", lines.collect::<Vec<_>>().join("\n\n"));
    let drawn = Drawn {
        vertices,
        triangles: count(|surface| surface.triangles.len()),
        thickness_mm: sheet.thickness_mm as f32,
        are_labels,
        names,
    };
    let nifti = nifti::write_commented(&grid, &sheet.numbers, &comment);
    let nifti = nifti.map_err(unusable("case"))?;
    Ok((nifti, drawn))
}

/// The files of a surface.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceFiles<'a> {
    /// FreeSurfer's triangles, or GIFTI.
    pub surface: &'a [u8],
    /// FreeSurfer's `curv`, an overlay in an MGH file, an annotation, or GIFTI; `None` if the surface is GIFTI that has values, too, or has none.
    pub values: Option<&'a [u8]>,
}

/// Reads a surface and its values. `t1` is the grid of the volume that `tkregister` space belongs to, if the surface has no footer; `space` what
/// the client states about coordinates; `column` which of several values, from 1.
///
/// # Errors
/// If a file is damaged, unsupported, or too large, if both do not belong together, or if the place in the scanner is not known.
pub fn read(
    files: SurfaceFiles<'_>,
    t1: Option<&Grid>,
    space: Option<Space>,
    column: Option<usize>,
) -> Result<ValuedSurface, SurfaceError> {
    let (surface, own) = surface(files.surface)?;
    let columns = match files.values {
        None => own,
        Some(bytes) if bytes.starts_with(&freesurfer::VALUES_MAGIC) => Columns {
            columns: vec![freesurfer::values(bytes)?],
            ..Columns::default()
        },
        Some(bytes) if gifti::looks_like(bytes) => gifti::values(bytes)?,
        Some(bytes) if freesurfer::looks_like_mgh(bytes) => freesurfer::overlay(bytes)?,
        Some(bytes) if freesurfer::looks_like_annotation(bytes) => freesurfer::annotation(bytes)?,
        Some(_) => return Err(SurfaceError::NotRecognised { part: "values" }),
    };
    let Columns {
        mut columns,
        names,
        are_labels,
    } = columns;
    let count = columns.len();
    let values = match (count, column) {
        (0, _) => return Err(SurfaceError::NoValues),
        (1, None) => columns.remove(0),
        (_, None) => return Err(SurfaceError::ManyColumns { count }),
        (_, Some(column)) if (1..=count).contains(&column) => columns.swap_remove(column - 1),
        (_, Some(column)) => return Err(SurfaceError::NoSuchColumn { count, column }),
    };
    let vertices = surface.positions.len();
    if values.len() != vertices {
        let values = values.len();
        return Err(SurfaceError::OfAnother { values, vertices });
    }
    Ok(ValuedSurface {
        positions_in_patient: in_patient(&surface, t1, space)?,
        triangles: surface.triangles,
        values,
        names,
        are_labels,
    })
}

/// A surface without values, which is the label of a number.
fn bare(
    files: SurfaceFiles<'_>,
    t1: Option<&Grid>,
    space: Option<Space>,
    number: u32,
) -> Result<ValuedSurface, SurfaceError> {
    let (surface, _none) = surface(files.surface)?;
    Ok(ValuedSurface {
        positions_in_patient: in_patient(&surface, t1, space)?,
        values: vec![number as f32; surface.positions.len()],
        triangles: surface.triangles,
        names: BTreeMap::from([(number, format!("surface {number}"))]),
        are_labels: true,
    })
}

/// A surface, and the values that are in the same file.
fn surface(bytes: &[u8]) -> Result<(Surface, Columns), SurfaceError> {
    if bytes.starts_with(&freesurfer::TRIANGLES_MAGIC) {
        Ok((freesurfer::surface(bytes)?, Columns::default()))
    } else if gifti::looks_like(bytes) {
        gifti::surface(bytes)
    } else {
        Err(SurfaceError::NotRecognised { part: "surface" })
    }
}

/// The vertices of a surface, LPS mm.
fn in_patient(
    surface: &Surface,
    t1: Option<&Grid>,
    space: Option<Space>,
) -> Result<Vec<DVec3>, SurfaceError> {
    let scanner = scanner_of(surface.space, t1, space)?;
    let in_patient = |position: &[f32; 3]| {
        let position = DVec3::from_array(position.map(f64::from));
        let scanner = scanner.transform_point3(position);
        DVec3::new(-scanner.x, -scanner.y, scanner.z)
    };
    let places: Vec<_> = surface.positions.iter().map(in_patient).collect();
    if !places
        .iter()
        .all(|place| place.to_array().iter().all(is_near))
    {
        return Err(SurfaceError::Damaged {
            part: "surface",
            what: "its matrix puts a vertex further than 100 m away".to_owned(),
        });
    }
    Ok(places)
}

/// Whether a coordinate in mm may be of a head. Comparisons with NaN fail.
fn is_near(along: &f64) -> bool {
    along.abs() < 1e5
}

/// How coordinates become scanner RAS. What the client states counts more than what the file does, for files are wrong about it.
fn scanner_of(
    stated: StatedSpace,
    t1: Option<&Grid>,
    space: Option<Space>,
) -> Result<DAffine3, SurfaceError> {
    let of_t1 = t1.map(scanner_from_tkregister_of);
    match (space, stated) {
        (Some(Space::Scanner), _) => Ok(DAffine3::IDENTITY),
        (Some(Space::Tkregister), StatedSpace::Tkregister(footer)) => {
            footer.or(of_t1).ok_or(SurfaceError::NoVolume)
        }
        (Some(Space::Tkregister), _) => of_t1.ok_or(SurfaceError::NoVolume),
        (None, StatedSpace::Tkregister(footer)) => footer.or(of_t1).ok_or(SurfaceError::NoVolume),
        (None, StatedSpace::Scanner(affine)) => Ok(affine),
        (None, StatedSpace::Nothing) => Err(SurfaceError::SpaceNotStated),
    }
}

/// From `tkregister` RAS to scanner RAS, given the directions of the voxel axes in scanner RAS and `c_ras`.
fn scanner_from_tkregister(directions: DMat3, centre: DVec3) -> DAffine3 {
    let axes = DMat3::from_cols(-directions.x_axis, directions.z_axis, -directions.y_axis);
    DAffine3::from_mat3_translation(axes, centre)
}

fn scanner_from_tkregister_of(t1: &Grid) -> DAffine3 {
    let ras = |lps: DVec3| DVec3::new(-lps.x, -lps.y, lps.z);
    let affine = t1.patient_from_voxel();
    let [x, y, z] = [0, 1, 2].map(|axis| ras(affine.matrix3.col(axis)).normalize());
    let middle = DVec3::from_array(t1.size().map(|side| side as f64 / 2.0));
    scanner_from_tkregister(
        DMat3::from_cols(x, y, z),
        ras(affine.transform_point3(middle)),
    )
}

/// Checks the counts of a surface, before memory is allocated for it.
fn check_counts(vertices: u64, triangles: u64) -> Result<(), SurfaceError> {
    for (what, count, most) in [
        ("vertices", vertices, MAX_VERTICES as u64),
        ("triangles", triangles, MAX_TRIANGLES as u64),
    ] {
        if count > most {
            return Err(SurfaceError::TooMany { what, count, most });
        }
    }
    Ok(())
}

/// Checks what is read of a surface.
fn checked(surface: Surface) -> Result<Surface, SurfaceError> {
    let damaged = |what: &str| {
        Err(SurfaceError::Damaged {
            part: "surface",
            what: what.to_owned(),
        })
    };
    if surface.triangles.is_empty() {
        return damaged("it has no triangles");
    }
    let vertices = surface.positions.len() as u64;
    let numbers = surface.triangles.as_flattened();
    if numbers.iter().any(|&number| u64::from(number) >= vertices) {
        return damaged("a triangle names a vertex that it does not have");
    }
    let places = surface.positions.as_flattened();
    if !places.iter().all(|&along| is_near(&along.into())) {
        return damaged("a coordinate is not a number, or further than 100 m away");
    }
    Ok(surface)
}
