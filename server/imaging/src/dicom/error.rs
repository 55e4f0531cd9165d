//! What can be wrong with DICOM files.

use geometry::GeometryError;

use super::{SeriesSummary, UnreadFile};
use crate::ImagingError;

/// Why some DICOM files do not make a volume.
///
/// Messages count slices from 1, in their order along the normal. They contain numbers from the headers and terms of
/// the standard, never texts from a file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DicomError {
    /// No file is DICOM.
    #[error("none of {files} files is DICOM; the first is {found}")]
    NoDicom {
        /// Number of files.
        files: usize,
        /// What the first file is, as far as its first bytes tell.
        found: &'static str,
    },
    /// There are DICOM files, but no MR, CT or PET images.
    #[error("none of the {files} DICOM files is an MR, CT or PET image")]
    NoImages {
        /// Number of DICOM files.
        files: usize,
    },
    /// No image can be read.
    #[error("none of the images can be read: {}", unread(files))]
    NoneReadable {
        /// The files.
        files: Vec<UnreadFile>,
    },
    /// Images of the series cannot be read.
    #[error(
        "{} of the series cannot be read: {}", count(files.len(), "image"), unread(files)
    )]
    ImagesUnread {
        /// Their files.
        files: Vec<UnreadFile>,
    },
    /// An element that the voxels depend on is there, and cannot be read.
    #[error(
        "{element} of the image with instance number {instance} cannot be read: it is {value}; correct the files or export them again"
    )]
    Value {
        /// Its keyword (PS3.6).
        element: &'static str,
        /// Its value, if it is a misspelt number; otherwise what it is.
        value: String,
        /// The instance number, or the number of the frame.
        instance: i64,
    },
    /// Each slice has a series of its own.
    #[error(
        "{series} series of one slice each have the number {number} and the same size, as if each slice had got a Series Instance UID \
         of its own; set `series` to {number} to read them as one series"
    )]
    SeriesScattered {
        /// How many there are.
        series: usize,
        /// Their number.
        number: i64,
    },
    /// A file cannot be read.
    #[error("a file cannot be read: {what}")]
    Unreadable {
        /// What is wrong, without names.
        what: String,
    },
    /// More files than allowed.
    #[error("there are more files than the limit of {limit}")]
    TooManyFiles {
        /// The limit.
        limit: usize,
    },
    /// More bytes than allowed.
    #[error("the unpacked files exceed the limit of {limit} bytes")]
    TooManyBytes {
        /// The limit.
        limit: u64,
    },
    /// More voxels than allowed.
    #[error("the series has {voxels} voxels; the limit is {limit}")]
    TooManyVoxels {
        /// Voxels of the series.
        voxels: u64,
        /// The limit.
        limit: u64,
    },
    /// Several series are possible.
    #[error(
        "{} series are possible; select one of them with `series`: {}",
        .candidates.len(), list(.candidates)
    )]
    SeveralSeries {
        /// The possible series.
        candidates: Vec<SeriesSummary>,
    },
    /// No series makes a volume.
    #[error("no series is a volume of at least 3 slices; found: {}", list(.found))]
    NoVolume {
        /// All series.
        found: Vec<SeriesSummary>,
    },
    /// No series has the given name, or several have it.
    #[error("series not found, or ambiguous; available: {}", list(.found))]
    NoSuchSeries {
        /// All series.
        found: Vec<SeriesSummary>,
    },
    /// The selected series makes no volume.
    #[error("{series}: {reason}{}", other_series(others))]
    OfSeries {
        /// The selected series.
        series: Box<SeriesSummary>,
        /// All other series.
        others: Vec<SeriesSummary>,
        /// Why it makes no volume.
        reason: Box<DicomError>,
    },
    /// The slices of a Siemens mosaic are tiles of one image.
    #[error("Siemens mosaic series (tiled time series) are not supported")]
    Mosaic,
    /// Too few slices for a volume.
    #[error("the series has {slices} slices; a volume needs at least 3")]
    TooFewSlices {
        /// Number of slices.
        slices: usize,
    },
    /// Slices are missing.
    #[error(
        "{} {} missing ({}); {hint}",
        count(missing.len(), "slice"), if missing.len() == 1 { "is" } else { "are" }, numbers(missing)
    )]
    SlicesMissing {
        /// Their numbers in the whole volume, from 1.
        missing: Vec<usize>,
        /// What the user can do.
        hint: &'static str,
    },
    /// Several slices have the same position.
    #[error(
        "{} {} the same position as another slice: {}",
        count(instances.len(), "slice"),
        if instances.len() == 1 { "has" } else { "have" },
        instance_numbers(instances)
    )]
    SlicesDoubled {
        /// Instance numbers, or frame numbers, of the surplus slices.
        instances: Vec<i64>,
    },
    /// The distances between slices differ.
    #[error(
        "the slices are unevenly spaced: most are {usual_mm:.3} mm apart, but slices {} and {} are {found_mm:.3} mm apart",
        .after, .after + 1
    )]
    SlicesUneven {
        /// The median distance.
        usual_mm: f64,
        /// A distance that differs.
        found_mm: f64,
        /// Number of the slice before that distance.
        after: usize,
    },
    /// The slices are sheared.
    #[error(
        "the slices are sheared: the stack leans by {degrees:.1}° from slice 1 to {slices}, as with a tilted gantry"
    )]
    GantryTilt {
        /// Angle between the stack and the normal of its slices.
        degrees: f64,
        /// Number of slices.
        slices: usize,
    },
    /// A slice is shifted.
    #[error("slice {slice} is {shift_mm:.2} mm beside the line of its neighbours")]
    SliceShifted {
        /// Its number.
        slice: usize,
        /// Its distance from that line.
        shift_mm: f64,
    },
    /// Several acquisitions share one series.
    #[error("{}", several(*acquisitions, *slices, difference))]
    SeveralAcquisitions {
        /// Number of acquisitions.
        acquisitions: usize,
        /// Slices in each.
        slices: usize,
        /// What they differ in.
        difference: &'static str,
    },
    /// The slices differ in a property that all slices of a volume must share.
    #[error("the slices differ in {what}: {}", instance_numbers(instances))]
    Mixed {
        /// Last part of the problem's type.
        kind: &'static str,
        /// That property.
        what: &'static str,
        /// Instance numbers of the slices that differ from the majority.
        instances: Vec<i64>,
    },
    /// A slice has no position.
    #[error("{}: {}", what, instance_numbers(instances))]
    NotPlaced {
        /// What is missing or unusable.
        what: &'static str,
        /// Instance numbers of the slices.
        instances: Vec<i64>,
    },
    /// A part of the standard that is not supported.
    #[error("{what} cannot be read; convert the series with another program, such as dcm2niix")]
    Unsupported {
        /// That part.
        what: &'static str,
    },
    /// The structure of a file is damaged.
    #[error("a DICOM file is damaged: {what}")]
    Damaged {
        /// What is wrong with it.
        what: &'static str,
    },
    /// The pixels of a slice cannot be decoded.
    #[error("the pixels of the slice with instance number {instance} cannot be decoded: {what}")]
    Pixels {
        /// Its instance number, or the number of its frame.
        instance: i64,
        /// What is wrong with them.
        what: &'static str,
    },
    /// Memory is short.
    #[error("there is not enough memory for {bytes} bytes")]
    OutOfMemory {
        /// Number of bytes requested.
        bytes: u64,
    },
    /// The volume has no valid grid.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The volume cannot be written.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}

/// The structure of a file is damaged.
pub(super) const fn damaged(what: &'static str) -> DicomError {
    DicomError::Damaged { what }
}

/// A part of the standard is not supported.
pub(super) const fn unsupported(what: &'static str) -> DicomError {
    DicomError::Unsupported { what }
}

impl DicomError {
    /// A stable name in kebab case.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::NoDicom { .. } => "dicom-none",
            Self::NoImages { .. } => "dicom-no-images",
            Self::NoneReadable { .. } | Self::ImagesUnread { .. } => "dicom-damaged",
            Self::Value { .. } => "dicom-value",
            Self::SeriesScattered { .. } => "dicom-series-scattered",
            Self::Unreadable { .. } => "dicom-unreadable",
            Self::TooManyFiles { .. } => "too-many-files",
            Self::TooManyBytes { .. } => "too-many-bytes",
            Self::TooManyVoxels { .. } => "too-many-voxels",
            Self::SeveralSeries { .. } => "dicom-several-series",
            Self::NoVolume { .. } => "dicom-no-volume",
            Self::NoSuchSeries { .. } => "dicom-series-unknown",
            Self::OfSeries { reason, .. } => reason.kind(),
            Self::Mosaic => "dicom-mosaic",
            Self::TooFewSlices { .. } => "dicom-too-few-slices",
            Self::SlicesMissing { .. } => "dicom-slices-missing",
            Self::SlicesDoubled { .. } => "dicom-slices-doubled",
            Self::SlicesUneven { .. } => "dicom-slices-uneven",
            Self::GantryTilt { .. } => "dicom-gantry-tilt",
            Self::SliceShifted { .. } => "dicom-slice-shifted",
            Self::SeveralAcquisitions { .. } => "dicom-several-acquisitions",
            Self::Mixed { kind, .. } => kind,
            Self::NotPlaced { .. } => "dicom-not-placed",
            Self::Unsupported { .. } => "dicom-unsupported",
            Self::Damaged { .. } => "dicom-damaged",
            Self::Pixels { .. } => "dicom-pixels",
            Self::OutOfMemory { .. } => "out-of-memory",
            Self::Geometry(_) => "geometry",
            Self::Imaging(error) => error.kind(),
        }
    }

    /// The same error with the name of the series. Errors that the series does not cause stay as they are.
    pub(super) fn of_series(self, series: SeriesSummary, others: &[SeriesSummary]) -> Self {
        if self.is_too_large() || matches!(self, Self::OutOfMemory { .. } | Self::Unreadable { .. })
        {
            return self;
        }
        Self::OfSeries {
            series: Box::new(series),
            others: others.to_vec(),
            reason: Box::new(self),
        }
    }

    /// Whether the files are refused because of their size alone.
    pub fn is_too_large(&self) -> bool {
        matches!(
            self,
            Self::TooManyFiles { .. } | Self::TooManyBytes { .. } | Self::TooManyVoxels { .. }
        )
    }
}

/// The most numbers that an error lists.
const LISTED: usize = 8;

fn several(acquisitions: usize, slices: usize, difference: &str) -> String {
    match slices {
        1 => {
            format!("all {acquisitions} slices have the same position, and differ in {difference}")
        }
        _ => format!(
            "the series holds {acquisitions} acquisitions of {slices} slices each, which differ in {difference}; export one of them separately"
        ),
    }
}

/// Files with their reasons.
fn unread(files: &[UnreadFile]) -> String {
    let mut listed: Vec<String> = files.iter().take(3).map(ToString::to_string).collect();
    if files.len() > 3 {
        listed.push(format!("and {} more", files.len() - 3));
    }
    listed.join("; ")
}

fn list(series: &[SeriesSummary]) -> String {
    let mut listed: Vec<String> = series
        .iter()
        .take(LISTED)
        .map(ToString::to_string)
        .collect();
    if series.len() > LISTED {
        listed.push(format!("and {} more", series.len() - LISTED));
    }
    listed.join("; ")
}

fn other_series(others: &[SeriesSummary]) -> String {
    match others {
        [] => String::new(),
        others => format!("; the files also hold {}", list(others)),
    }
}

fn count(number: usize, noun: &str) -> String {
    let plural = if number == 1 { "" } else { "s" };
    format!("{number} {noun}{plural}")
}

/// Numbers, with runs as ranges: `number 3`, `numbers 3, 5–9`.
fn numbers(sorted: &[usize]) -> String {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for &number in sorted {
        match runs.last_mut() {
            Some(run) if run[1] + 1 == number => run[1] = number,
            _ => runs.push([number; 2]),
        }
    }
    let more = runs.len().saturating_sub(LISTED);
    let mut listed: Vec<String> = runs
        .iter()
        .take(LISTED)
        .map(|&[first, last]| match last - first {
            0 => first.to_string(),
            _ => format!("{first}–{last}"),
        })
        .collect();
    if more > 0 {
        listed.push("…".to_owned());
    }
    let noun = if sorted.len() == 1 {
        "number"
    } else {
        "numbers"
    };
    format!("{noun} {}", listed.join(", "))
}

fn instance_numbers(instances: &[i64]) -> String {
    let listed: Vec<String> = instances
        .iter()
        .take(LISTED)
        .map(ToString::to_string)
        .collect();
    let more = instances.len().saturating_sub(LISTED);
    let more = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    let plural = if instances.len() == 1 { "" } else { "s" };
    format!("instance number{plural} {}{more}", listed.join(", "))
}
