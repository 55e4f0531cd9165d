//! From files to a volume and its attributes.

use std::collections::BTreeMap;

use dicom_core::Tag;
use geometry::{Grid, Rescale};
use serde::{Deserialize, Serialize};

use super::attributes::{kept, wanted};
use super::choose::{Purpose, Series, choose, group};
use super::deidentify::deidentified_file;
use super::fingerprint::{Fingerprint, Unfinished};
use super::header::{Frame, Image, NO_PIXELS, parse, read_image, stated_place};
use super::loss::lost;
use super::pixels::for_each_frame;
use super::scan::{Scanned, scan, scan_as_far_as_sound};
use super::series::token_of;
use super::stack::{FrameIndex, Stack, stack};
use super::{Attributes, DicomError, Instance, SeriesName, SeriesSummary, UnreadFile};
use crate::nifti::{Form, write_samples};
use crate::sniff::recognised;
use crate::{Format, Limits, sniff};

/// A source of files: a directory, an archive, memory.
pub trait Files {
    /// The number of files.
    fn count(&self) -> usize;

    /// All bytes of a file, by its number.
    ///
    /// # Errors
    /// If they cannot be read or are too many.
    fn read(&mut self, number: usize) -> Result<Vec<u8>, DicomError>;
}

impl Files for Vec<Vec<u8>> {
    fn count(&self) -> usize {
        self.len()
    }

    fn read(&mut self, number: usize) -> Result<Vec<u8>, DicomError> {
        Ok(self[number].clone())
    }
}

/// What the user can choose.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Options {
    /// The series to read.
    pub series: Option<SeriesName>,
    /// Whether to interpolate single missing slices.
    pub allow_gaps: bool,
    /// What the series is read for.
    pub purpose: Purpose,
    /// Whether the images are named as they are without the identity of the patient.
    pub deidentifies: bool,
    /// The form that places the voxels of NIfTI files, which are no series; `None` if the header decides.
    pub form: Option<Form>,
}

/// A series as a volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Converted {
    /// The volume as gzipped NIfTI-1, with the samples as stored in the files. The same series gives the same bytes,
    /// whatever the order of its files. It is not serialised.
    #[serde(skip)]
    pub nifti: Vec<u8>,
    /// The attributes to store with it.
    pub attributes: Attributes,
    /// The chosen series.
    pub series: SeriesSummary,
    /// Whether names or timing indicate that it is T1-weighted.
    pub is_t1: bool,
    /// The other series.
    pub others: Vec<SeriesSummary>,
    /// Number of files that are not MR, CT or PET images, or cannot be read.
    pub ignored_files: usize,
    /// The UIDs of the images of the series, each once, and what they state and show.
    pub images: Vec<(String, Fingerprint)>,
    /// The images among them that cannot be read, at most [`MOST_LISTED`].
    pub unread: Vec<UnreadFile>,
}

/// The most files that are listed one by one.
pub const MOST_LISTED: usize = 100;

/// Makes a volume of one of the series in `files`.
///
/// Intensities are the stored values with slope and intercept; if these differ between slices, the values are rescaled
/// to real numbers. MONOCHROME1, which requests an inverted display, does not change them.
///
/// # Errors
/// If no series matches, several are possible, or the slices do not make a volume: see [`DicomError`].
pub fn convert(
    files: &mut dyn Files,
    options: &Options,
    limits: &Limits,
) -> Result<Converted, DicomError> {
    let (images, unread, ignored_files) = read_images(files)?;
    let (mut series, others) = choose(group(images), options.series.as_ref(), options.purpose)?;
    check_unread(&series, &unread).map_err(|error| error.of_series(series.summary(), &others))?;
    series.drop_copies(|one, other| is_same(files, one, other))?;
    if series.is_pet() && options.purpose == Purpose::Case {
        return Err(DicomError::Unsupported {
            what: "a PET series as a case: upload the T1, and the PET as a layer of it",
        });
    }
    let (nifti, mut attributes, images) = read_series(files, &series, options, limits)
        .map_err(|error| error.of_series(series.summary(), &others))?;
    if options.purpose == Purpose::Layer {
        // No answer about a layer states them, and what is stored is part of its id.
        for instance in &mut attributes.instances {
            instance.number = None;
        }
    }
    Ok(Converted {
        nifti,
        attributes,
        series: series.summary(),
        is_t1: series.is_t1(),
        others,
        ignored_files,
        images,
        unread: unread.into_iter().take(MOST_LISTED).collect(),
    })
}

/// An image that cannot be read is no reason against another series, and one against its own.
fn check_unread(series: &Series, unread: &[UnreadFile]) -> Result<(), DicomError> {
    let token = Some(series.token());
    let own = unread.iter().filter(|file| file.series == token);
    let own: Vec<UnreadFile> = own.cloned().collect();
    if own.is_empty() {
        Ok(())
    } else {
        Err(DicomError::ImagesUnread { files: own })
    }
}

/// Whether two images of one instance show the same in the same place, however they are encoded.
fn is_same(files: &mut dyn Files, one: &Image, other: &Image) -> Result<bool, DicomError> {
    let (Ok(first), Ok(second)) = (&one.frames, &other.frames) else {
        return Ok(false);
    };
    if first != second || one.padding != other.padding {
        return Ok(false);
    }
    let mut digest = |image: &Image| {
        let bytes = files.read(image.file)?;
        let scanned = scan(&bytes, &[])?;
        let mut hasher = blake3::Hasher::new();
        let pixels = scanned.pixels().ok_or(NO_PIXELS)?;
        for_each_frame(image, &pixels, |_, _, values| {
            values.iter().for_each(|value| {
                hasher.update(&value.to_le_bytes());
            });
        })?;
        Ok::<_, DicomError>(hasher.finalize())
    };
    // Whatever cannot be decoded is found where the series is read.
    match (digest(one), digest(other)) {
        (Ok(first), Ok(second)) => Ok(first == second),
        _ => Ok(false),
    }
}

/// The fingerprint of each image, by its UID.
type Images = Vec<(String, Fingerprint)>;

/// The volume of a series, as packed NIfTI-1, whose it is, and its images.
fn read_series(
    files: &mut dyn Files,
    series: &Series,
    options: &Options,
    limits: &Limits,
) -> Result<(Vec<u8>, Attributes, Images), DicomError> {
    check_series(series)?;
    let stack = stack(series, options.allow_gaps)?;
    check_limits(&stack, limits)?;
    let grid = Grid::new(stack.size, stack.patient_from_voxel)?;
    let factor = series.unit().map_or(1.0, |(_, factor)| factor);
    let rescale = common_rescale(series, factor)?;
    let rescaled = rescale.is_none().then_some(factor);
    let zero = rescale.map_or(0.0, |Rescale { slope, intercept }| {
        (-intercept / slope).round()
    });
    let (mut samples, images) =
        read_samples(files, series, &stack, rescaled, zero, options.deidentifies)?;
    let interpolated_slices = fill_gaps(&mut samples, &stack, rescale.is_some());
    let unscaled = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };
    let attributes = Attributes {
        attributes: kept_attributes(files, series, &stack)?,
        instances: instances(series, &stack),
        interpolated_slices,
    };
    let nifti = write_samples(&grid, &samples, rescale.unwrap_or(unscaled))?;
    Ok((nifti, attributes, images))
}

/// The headers of all images, the images that cannot be read, and the number of all files that are no readable images.
fn read_images(files: &mut dyn Files) -> Result<(Vec<Image>, Vec<UnreadFile>, usize), DicomError> {
    let wanted = wanted();
    let (mut images, mut unread, mut dicom, mut first_other) = (Vec::new(), Vec::new(), 0, None);
    for number in 0..files.count() {
        let bytes = files.read(number)?;
        if sniff(&bytes) != Format::Dicom {
            first_other.get_or_insert_with(|| recognised(&bytes));
            continue;
        }
        dicom += 1;
        match image_of(number, &bytes, &wanted) {
            Ok(image) => images.extend(image),
            Err(file) => unread.extend(file),
        }
    }
    match (dicom, images.len(), unread.len()) {
        (0, ..) => Err(DicomError::NoDicom {
            files: files.count(),
            found: first_other.unwrap_or("an empty file"),
        }),
        (files, 0, 0) => Err(DicomError::NoImages { files }),
        (_, 0, _) => Err(DicomError::NoneReadable { files: unread }),
        (_, found, _) => Ok((images, unread, files.count() - found)),
    }
}

/// The image in a file; `None` if it is no MR, CT or PET image.
///
/// # Errors
/// What is known of a file that cannot be read; `None` if it is surely no such image.
fn image_of(
    number: usize,
    bytes: &[u8],
    wanted: &[Tag],
) -> Result<Option<Image>, Option<UnreadFile>> {
    let unread = |scanned: Option<&Scanned>, fault: &DicomError| {
        let (series_uid, instance) = match scanned {
            Some(scanned) => stated_place(scanned)?,
            None => (None, None),
        };
        Some(UnreadFile {
            file: number + 1,
            instance,
            series: series_uid.map(|uid| token_of(&uid)),
            reason: fault.to_string(),
        })
    };
    let scanned = scan_as_far_as_sound(bytes, wanted);
    let (scanned, fault) = scanned.map_err(|fault| unread(None, &fault))?;
    match fault {
        Some(fault) => Err(unread(Some(&scanned), &fault)),
        None => read_image(number, bytes, &scanned).map_err(|fault| unread(Some(&scanned), &fault)),
    }
}

fn check_series(series: &Series) -> Result<(), DicomError> {
    if series.images.iter().any(|image| image.mosaic) {
        return Err(DicomError::Mosaic);
    }
    let first = &series.images[0].owner;
    for (which, what) in ["Patient ID", "Study Instance UID"].into_iter().enumerate() {
        let strangers = series
            .images
            .iter()
            .filter(|image| image.owner[which] != first[which]);
        let instances: Vec<i64> = strangers.map(Image::first_instance).collect();
        if !instances.is_empty() {
            return Err(DicomError::Mixed {
                kind: "dicom-mixed-patients",
                what,
                instances,
            });
        }
    }
    Ok(())
}

fn check_limits(stack: &Stack, limits: &Limits) -> Result<(), DicomError> {
    let voxels: u64 = stack.size.iter().map(|&side| side as u64).product();
    let limit = limits.max_voxels.min(geometry::MAX_VOXELS) as u64;
    if voxels > limit {
        return Err(DicomError::TooManyVoxels { voxels, limit });
    }
    if 4 * voxels > limits.max_bytes {
        return Err(DicomError::TooManyBytes {
            limit: limits.max_bytes,
        });
    }
    Ok(())
}

/// Slope and intercept, times the factor, if all slices share them.
fn common_rescale(series: &Series, factor: f64) -> Result<Option<Rescale>, DicomError> {
    let frames = || {
        series
            .images
            .iter()
            .flat_map(|image| image.frames.iter().flatten())
    };
    let is_unusable = |frame: &Frame| {
        let [slope, intercept] = frame.slope_and_intercept().map(|number| number as f32);
        !slope.is_normal() || !intercept.is_finite()
    };
    if frames().any(is_unusable) {
        return Err(DicomError::Damaged {
            what: "a slice has a rescale slope that is zero or beyond single precision",
        });
    }
    let Some(first) = frames().next().map(Frame::slope_and_intercept) else {
        return Ok(None);
    };
    let mut all_same = true;
    for (which, element) in ["RescaleSlope", "RescaleIntercept"].into_iter().enumerate() {
        let differs = frames().any(|frame| frame.slope_and_intercept()[which] != first[which]);
        let without = frames().find(|frame| frame.rescale[which].is_none());
        if let Some(frame) = without
            && differs
        {
            return Err(DicomError::Value {
                element,
                value: "absent or blank, and other slices state it".to_owned(),
                instance: frame.instance,
            });
        }
        all_same &= !differs;
    }
    Ok(all_same.then_some(Rescale {
        slope: (factor * first[0]) as f32,
        intercept: (factor * first[1]) as f32,
    }))
}

/// All samples in the order of the stack, stored, or rescaled and multiplied by a factor, and the images. Single precision represents
/// 16 bits exactly. `zero` is the sample that represents 0.
fn read_samples(
    files: &mut dyn Files,
    series: &Series,
    stack: &Stack,
    rescaled: Option<f64>,
    zero: f32,
    deidentifies: bool,
) -> Result<(Vec<f32>, Images), DicomError> {
    let plane = stack.size[0] * stack.size[1];
    let mut samples = zeros(plane * stack.size[2])?;
    let mut is_padding = Vec::new();
    let mut images: BTreeMap<String, Fingerprint> = BTreeMap::new();
    for (number, image) in series.images.iter().enumerate() {
        let bytes = files.read(image.file)?;
        let scanned = scan(&bytes, &wanted())?;
        let (uid, mut print) = match deidentifies {
            true => without_identity(&bytes)?,
            false => {
                let print = Unfinished::of(&bytes, &scanned, image)?;
                (image.sop_instance_uid.clone(), print)
            }
        };
        let pixels = scanned.pixels().ok_or(NO_PIXELS)?;
        for_each_frame(image, &pixels, |frame, header, values| {
            print.add(values);
            let index = FrameIndex {
                image: number,
                frame,
            };
            let Some(place) = stack.slices.iter().position(|slice| *slice == Some(index)) else {
                return;
            };
            let [slope, intercept] = match rescaled {
                Some(factor) => header.slope_and_intercept().map(|number| factor * number),
                None => [1.0, 0.0],
            };
            let samples = &mut samples[place * plane..(place + 1) * plane];
            for (sample, &value) in samples.iter_mut().zip(values) {
                *sample = (slope * f64::from(value) + intercept) as f32;
            }
            if let Some([first, last]) = image.padding {
                is_padding.resize(plane * stack.size[2], false);
                let marks = &mut is_padding[place * plane..(place + 1) * plane];
                for (mark, value) in marks.iter_mut().zip(values) {
                    *mark = (first..=last).contains(value);
                }
            }
        })?;
        images.entry(uid).or_insert_with(|| print.finish());
    }
    replace_padding(&mut samples, &is_padding, zero);
    Ok((samples, images.into_iter().collect()))
}

/// The UID of an image without the identity of its patient, and what its header tells then.
fn without_identity(file: &[u8]) -> Result<(String, Unfinished), DicomError> {
    let without = deidentified_file(file)?;
    let scanned = scan(&without, &wanted())?;
    let image = read_image(0, &without, &scanned)?.ok_or(DicomError::NoImages { files: 1 })?;
    let print = Unfinished::of(&without, &scanned, &image)?;
    Ok((image.sop_instance_uid, print))
}

/// Padding is no image: outside the range of all other samples it would be the darkest or brightest thing in the volume. It becomes
/// `zero`, the sample that represents 0, or the least other sample, if there are samples below that.
fn replace_padding(samples: &mut [f32], is_padding: &[bool], zero: f32) {
    let marked = samples.iter().zip(is_padding);
    let others = marked.filter(|(_, is_padding)| !**is_padding);
    let [least, greatest] = others.fold(
        [f32::INFINITY, f32::NEG_INFINITY],
        |[low, high], (&sample, _)| [low.min(sample), high.max(sample)],
    );
    let background = zero.min(least);
    for (sample, &is_padding) in samples.iter_mut().zip(is_padding) {
        if is_padding && !(background..=greatest).contains(sample) {
            *sample = background;
        }
    }
}

fn zeros(count: usize) -> Result<Vec<f32>, DicomError> {
    let mut samples = Vec::new();
    samples
        .try_reserve_exact(count)
        .map_err(|_| DicomError::OutOfMemory {
            bytes: 4 * count as u64,
        })?;
    samples.resize(count, 0.0);
    Ok(samples)
}

/// Interpolates missing slices between their neighbours; returns their numbers, from 1.
fn fill_gaps(samples: &mut [f32], stack: &Stack, whole: bool) -> Vec<usize> {
    let plane = stack.size[0] * stack.size[1];
    let is_there = |place: &usize| stack.slices[*place].is_some();
    let missing: Vec<usize> = (0..stack.slices.len())
        .filter(|place| !is_there(place))
        .collect();
    for &place in &missing {
        let before = (0..place).rev().find(is_there).expect("the first is there");
        let mut later = place + 1..stack.slices.len();
        let after = later.find(is_there).expect("the last is there");
        let share = (place - before) as f32 / (after - before) as f32;
        for pixel in 0..plane {
            let [low, high] = [before, after].map(|place| samples[place * plane + pixel]);
            let value = low + (high - low) * share;
            samples[place * plane + pixel] = if whole { value.round() } else { value };
        }
    }
    missing.into_iter().map(|place| place + 1).collect()
}

/// The attributes of the first slice.
fn kept_attributes(
    files: &mut dyn Files,
    series: &Series,
    stack: &Stack,
) -> Result<Vec<(String, String)>, DicomError> {
    let Some(Some(first)) = stack.slices.first() else {
        return Ok(Vec::new());
    };
    let bytes = files.read(series.images[first.image].file)?;
    let scanned = scan(&bytes, &wanted())?;
    let object = parse(&scanned)?;
    let mut kept = kept(&object);
    for (keyword, _, _, value) in lost(&bytes, &scanned, &object)? {
        if !kept.iter().any(|(name, _)| name == keyword) {
            kept.push((keyword.to_owned(), value));
        }
    }
    Ok(kept)
}

fn instances(series: &Series, stack: &Stack) -> Vec<Instance> {
    let frames = stack.slices.iter().flatten();
    frames
        .map(|index| {
            let image = &series.images[index.image];
            let frames = image.frames.as_deref().unwrap_or_default();
            Instance {
                sop_class_uid: image.sop_class_uid.clone(),
                sop_instance_uid: image.sop_instance_uid.clone(),
                frame: (frames.len() > 1).then_some(index.frame + 1),
                number: frames.get(index.frame).map(|frame| frame.instance),
            }
        })
        .collect()
}
