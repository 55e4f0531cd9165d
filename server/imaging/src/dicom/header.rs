//! The headers of images as plain numbers.

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use dicom_transfer_syntax_registry::entries;
use glam::DVec3;

use super::DicomError;
use super::characters::{decode_texts, hide, needs_decoding};
use super::error::{damaged, unsupported};
use super::numbers::{integer, items, real, stated_integer, stated_real, stated_reals, text};
use super::pet::Pet;
use super::scan::Scanned;
use super::syntax::{Encoding, Packing};
use crate::sniff::recognised;
use crate::{Format, sniff};

pub(super) const NO_PIXELS: DicomError = damaged("an image has no pixels");

/// The greatest number of frames in an image.
const MAX_FRAMES: usize = 1 << 16;

/// The greatest deviation of the axes of an image from orthonormal.
const AXES_TOLERANCE: f64 = 1e-3;

/// An image with one or more frames.
#[derive(Debug, Clone)]
pub(super) struct Image {
    /// Its number among the files.
    pub(super) file: usize,
    /// The digest of the whole file, which identifies a file that was sent twice.
    pub(super) file_digest: blake3::Hash,
    pub(super) sop_class_uid: String,
    pub(super) sop_instance_uid: String,
    pub(super) series_uid: String,
    /// Patient and study, which all images of a series must share.
    pub(super) owner: [String; 2],
    pub(super) series_number: Option<i64>,
    pub(super) modality: Modality,
    pub(super) hints: Hints,
    /// Units and dose, if it is a PET.
    pub(super) pet: Option<Pet>,
    /// An error here matters only if the series is chosen.
    pub(super) format: Result<PixelFormat, DicomError>,
    /// Stored values from the first to the second are padding, and no image.
    pub(super) padding: Option<[i32; 2]>,
    pub(super) packing: Packing,
    pub(super) mosaic: bool,
    pub(super) frames: Result<Vec<Frame>, DicomError>,
}

impl Image {
    /// The instance number of its first frame.
    pub(super) fn first_instance(&self) -> i64 {
        let frames = self.frames.as_deref().unwrap_or_default();
        frames.first().map_or(0, |frame| frame.instance)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Modality {
    Mr,
    Ct,
    Pt,
}

impl Modality {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Mr => "MR",
            Self::Ct => "CT",
            Self::Pt => "PT",
        }
    }
}

/// Hints whether this is a T1-weighted head.
#[derive(Debug, Clone, Default)]
pub(super) struct Hints {
    /// The acquisition was three-dimensional.
    pub(super) is_3d: bool,
    /// A localizer, or an image that was computed from others.
    pub(super) is_secondary: bool,
    /// Names from the scanner or its user, in lower case.
    pub(super) names: String,
    pub(super) repetition_ms: Option<f64>,
    pub(super) echo_ms: Option<f64>,
    pub(super) inversion_ms: Option<f64>,
}

/// How the pixels of all frames are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct PixelFormat {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) bits_allocated: u32,
    pub(super) bits_stored: u32,
    pub(super) high_bit: u32,
    pub(super) signed: bool,
    pub(super) big_endian: bool,
}

/// One slice of an image.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Frame {
    /// Its instance number, or its number among the frames.
    pub(super) instance: i64,
    /// Centre of the first pixel, in LPS mm.
    pub(super) position: Option<DVec3>,
    /// Directions along a row and down a column.
    pub(super) axes: Option<[DVec3; 2]>,
    /// Distances between columns and between rows, in mm.
    pub(super) spacing_mm: Option<[f64; 2]>,
    /// What is missing or wrong, if one of the three is `None`.
    pub(super) fault: Option<&'static str>,
    /// Slope and intercept, if they are stated with a value.
    pub(super) rescale: [Option<f64>; 2],
    /// What distinguishes repeated acquisitions, in the order of [`DIFFERENCES`].
    pub(super) acquisition: [Option<i64>; 7],
}

impl Frame {
    /// Slope and intercept; one that is not stated is 1 or 0.
    pub(super) fn slope_and_intercept(&self) -> [f64; 2] {
        let [slope, intercept] = self.rescale;
        [slope.unwrap_or(1.0), intercept.unwrap_or(0.0)]
    }
}

/// What distinguishes repeated acquisitions.
pub(super) const DIFFERENCES: [&str; 7] = [
    "echo time",
    "acquisition number",
    "time",
    "diffusion weighting",
    "image type",
    "complex image component, such as magnitude and phase",
    "velocity encoding",
];

/// The classes of MR and CT images, classic, Enhanced and legacy-converted (PS3.4 B.5).
pub const IMAGE_CLASSES: [&str; 6] = [
    "1.2.840.10008.5.1.4.1.1.4",
    "1.2.840.10008.5.1.4.1.1.4.1",
    "1.2.840.10008.5.1.4.1.1.4.4",
    "1.2.840.10008.5.1.4.1.1.2",
    "1.2.840.10008.5.1.4.1.1.2.1",
    "1.2.840.10008.5.1.4.1.1.2.2",
];

/// MR, CT and PET, classic, Enhanced and legacy-converted (PS3.4 B.5).
fn modality_of(sop_class_uid: &str) -> Option<Modality> {
    match sop_class_uid.strip_prefix("1.2.840.10008.5.1.4.1.1.")? {
        "4" | "4.1" | "4.4" => Some(Modality::Mr),
        "2" | "2.1" | "2.2" => Some(Modality::Ct),
        "128" | "128.1" | "130" => Some(Modality::Pt),
        _ => None,
    }
}

/// The part of a data set that the scan kept, with its texts decoded.
pub(super) fn parse(scanned: &Scanned) -> Result<InMemDicomObject, DicomError> {
    let sets = &scanned.character_sets;
    let mut terms = sets.iter().map(|range| &scanned.header[range.clone()]);
    if !terms.any(needs_decoding) {
        return read(scanned, &scanned.header);
    }
    let mut header = scanned.header.clone();
    for range in sets {
        hide(&mut header[range.clone()]);
    }
    let mut object = read(scanned, &header)?;
    decode_texts(&mut object, "");
    Ok(object)
}

fn read(scanned: &Scanned, header: &[u8]) -> Result<InMemDicomObject, DicomError> {
    let syntax = match scanned.syntax.encoding {
        Encoding::ImplicitLittle => entries::IMPLICIT_VR_LITTLE_ENDIAN.erased(),
        Encoding::ExplicitLittle => entries::EXPLICIT_VR_LITTLE_ENDIAN.erased(),
        Encoding::ExplicitBig => entries::EXPLICIT_VR_BIG_ENDIAN.erased(),
    };
    InMemDicomObject::read_dataset_with_ts(header, &syntax)
        .map_err(|_| damaged("its header cannot be parsed"))
}

/// Refuses a file that is not DICOM.
pub(super) fn refuse_other(file: &[u8]) -> Result<(), DicomError> {
    match sniff(file) {
        Format::Dicom => Ok(()),
        _ => Err(DicomError::NoDicom {
            files: 1,
            found: recognised(file),
        }),
    }
}

/// The image in a file; `None` if it is not an MR, CT or PET image.
pub(super) fn read_image(
    file: usize,
    bytes: &[u8],
    scanned: &Scanned,
) -> Result<Option<Image>, DicomError> {
    let object = parse(scanned)?;
    let sop_class_uid = text(&object, tags::SOP_CLASS_UID).unwrap_or_default();
    let Some(modality) = modality_of(&sop_class_uid) else {
        return Ok(None);
    };
    if scanned.pixels().is_none() && !scanned.has_real_pixels {
        return Err(NO_PIXELS);
    }
    let series_uid = text(&object, tags::SERIES_INSTANCE_UID).unwrap_or_default();
    let instance = instance_number(&object);
    let format = match scanned.has_real_pixels {
        true => Err(unsupported("an image of real numbers")),
        false => pixel_format(&object, scanned.syntax.encoding, instance),
    };
    let is_signed = format.as_ref().is_ok_and(|format| format.signed);
    let padding = padding(&object, is_signed, instance);
    let (padding, frames) = match (padding, frames(&object)) {
        (Ok(padding), frames) => (padding, frames),
        (Err(error), frames) => (None, frames.and(Err(error))),
    };
    Ok(Some(Image {
        file,
        file_digest: blake3::hash(bytes),
        sop_class_uid,
        sop_instance_uid: text(&object, tags::SOP_INSTANCE_UID).unwrap_or_default(),
        series_uid,
        owner: [tags::PATIENT_ID, tags::STUDY_INSTANCE_UID]
            .map(|tag| text(&object, tag).unwrap_or_default()),
        series_number: integer(&object, tags::SERIES_NUMBER),
        modality,
        hints: hints(&object),
        pet: (modality == Modality::Pt).then(|| Pet::read(&object)),
        format,
        padding,
        packing: scanned.syntax.packing,
        mosaic: image_type(&object).split('\\').any(|word| word == "MOSAIC"),
        frames,
    }))
}

fn instance_number(object: &InMemDicomObject) -> i64 {
    integer(object, tags::INSTANCE_NUMBER).unwrap_or(0)
}

/// What a damaged file still states about itself: the UID of its series and its instance number. `None` if it is no MR, CT or PET
/// image.
pub(super) fn stated_place(scanned: &Scanned) -> Option<(Option<String>, Option<i64>)> {
    let object = parse(scanned).unwrap_or_else(|_| InMemDicomObject::new_empty());
    match text(&object, tags::SOP_CLASS_UID) {
        Some(class) if modality_of(&class).is_none() => None,
        _ => Some((
            text(&object, tags::SERIES_INSTANCE_UID),
            integer(&object, tags::INSTANCE_NUMBER),
        )),
    }
}

/// The stored values that are padding: Pixel Padding Value, up to Pixel Padding Range Limit (PS3.3 C.7.5.1.1.2).
fn padding(
    object: &InMemDicomObject,
    is_signed: bool,
    instance: i64,
) -> Result<Option<[i32; 2]>, DicomError> {
    let value = |tag| {
        let number = stated_integer(object, tag, instance)?;
        // Either representation may have been read as the other.
        let bits = number.map(|number| number as u16);
        Ok::<_, DicomError>(bits.map(|bits| match is_signed {
            true => i32::from(bits as i16),
            false => i32::from(bits),
        }))
    };
    let Some(one) = value(tags::PIXEL_PADDING_VALUE)? else {
        return Ok(None);
    };
    let other = value(tags::PIXEL_PADDING_RANGE_LIMIT)?.unwrap_or(one);
    Ok(Some([one.min(other), one.max(other)]))
}

fn image_type(object: &InMemDicomObject) -> String {
    text(object, tags::IMAGE_TYPE)
        .unwrap_or_default()
        .to_ascii_uppercase()
}

fn hints(object: &InMemDicomObject) -> Hints {
    let names = [
        tags::SERIES_DESCRIPTION,
        tags::PROTOCOL_NAME,
        tags::SEQUENCE_NAME,
    ];
    let names = names.map(|tag| text(object, tag).unwrap_or_default());
    let types = image_type(object);
    let secondary = ["LOCALIZER", "PROJECTION IMAGE", "MIP", "MINIP", "SCOUT"];
    Hints {
        is_3d: text(object, tags::MR_ACQUISITION_TYPE).as_deref() == Some("3D"),
        is_secondary: types
            .split('\\')
            .any(|word| secondary.contains(&word.trim())),
        // A protocol for epilepsy is not echo-planar.
        names: format!("{} {types}", names.join(" "))
            .to_lowercase()
            .replace("epilep", ""),
        repetition_ms: real(object, tags::REPETITION_TIME),
        echo_ms: real(object, tags::ECHO_TIME),
        inversion_ms: real(object, tags::INVERSION_TIME),
    }
}

fn pixel_format(
    object: &InMemDicomObject,
    encoding: Encoding,
    instance: i64,
) -> Result<PixelFormat, DicomError> {
    let number = |tag| {
        let number = stated_integer(object, tag, instance)?;
        Ok::<_, DicomError>(number.and_then(|number| u32::try_from(number).ok()))
    };
    let needed =
        |tag| number(tag)?.ok_or(damaged("an image does not state how its pixels are stored"));
    if number(tags::SAMPLES_PER_PIXEL)?.unwrap_or(1) != 1 {
        return Err(unsupported("an image in colour"));
    }
    let photometric = text(object, tags::PHOTOMETRIC_INTERPRETATION).unwrap_or_default();
    if !matches!(photometric.as_str(), "" | "MONOCHROME1" | "MONOCHROME2") {
        return Err(unsupported("an image in colour"));
    }
    if object.get(tags::MODALITY_LUT_SEQUENCE).is_some() {
        return Err(unsupported("an image with a modality look-up table"));
    }
    let bits_allocated = needed(tags::BITS_ALLOCATED)?;
    let bits_stored = number(tags::BITS_STORED)?.unwrap_or(bits_allocated);
    let format = PixelFormat {
        rows: needed(tags::ROWS)? as usize,
        columns: needed(tags::COLUMNS)? as usize,
        bits_allocated,
        bits_stored,
        high_bit: number(tags::HIGH_BIT)?.unwrap_or(bits_stored.saturating_sub(1)),
        signed: is_signed(object, bits_allocated, instance)?,
        big_endian: encoding == Encoding::ExplicitBig,
    };
    check_format(&format)?;
    Ok(format)
}

/// Pixels of more than 8 bits must state whether they are signed (PS3.3 C.7.6.3, type 1): the two readings differ by the whole range.
fn is_signed(
    object: &InMemDicomObject,
    bits_allocated: u32,
    instance: i64,
) -> Result<bool, DicomError> {
    match stated_integer(object, tags::PIXEL_REPRESENTATION, instance)? {
        Some(1) => Ok(true),
        Some(0) => Ok(false),
        _ if bits_allocated <= 8 => Ok(false),
        stated => Err(DicomError::Value {
            element: "PixelRepresentation",
            value: stated.map_or_else(
                || "absent or blank".to_owned(),
                |number| format!("{number}, neither 0 nor 1"),
            ),
            instance,
        }),
    }
}

fn check_format(format: &PixelFormat) -> Result<(), DicomError> {
    if !matches!(format.bits_allocated, 8 | 16) {
        return Err(unsupported("an image with pixels of neither 8 nor 16 bits"));
    }
    let bits = 1..=format.bits_allocated;
    let high = format.bits_stored.saturating_sub(1)..format.bits_allocated;
    if !bits.contains(&format.bits_stored) || !high.contains(&format.high_bit) {
        return Err(damaged(
            "an image has no bits stored, or more than are allocated",
        ));
    }
    let sides = 1..=u16::MAX.into();
    if !sides.contains(&format.rows) || !sides.contains(&format.columns) {
        return Err(NO_PIXELS);
    }
    Ok(())
}

/// The frames of an image; a classic image has one.
fn frames(object: &InMemDicomObject) -> Result<Vec<Frame>, DicomError> {
    let per_frame = object
        .get(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE)
        .and_then(|sequence| sequence.items());
    let stated =
        stated_integer(object, tags::NUMBER_OF_FRAMES, instance_number(object))?.unwrap_or(1);
    let Some(per_frame) = per_frame else {
        return if stated == 1 {
            Ok(vec![classic_frame(object)?])
        } else {
            Err(unsupported(
                "a multi-frame image without per-frame functional groups",
            ))
        };
    };
    if per_frame.len() as i64 != stated || per_frame.len() > MAX_FRAMES {
        return Err(damaged(
            "the number of frames differs from the number of frame descriptions",
        ));
    }
    let shared = items(object, tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE).first();
    let numbered = per_frame.iter().enumerate();
    numbered
        .map(|(index, groups)| grouped_frame(object, shared, groups, index))
        .collect()
}

fn vector(values: &[f64]) -> Option<DVec3> {
    let values: [f64; 3] = values.try_into().ok()?;
    Some(DVec3::from_array(values))
}

/// Where a frame lies, and what is missing or wrong about that.
struct Place {
    position: Option<DVec3>,
    axes: Option<[DVec3; 2]>,
    spacing_mm: Option<[f64; 2]>,
    fault: Option<&'static str>,
}

/// Position, orientation and spacing, each from its own group.
fn placed(
    position: Option<&InMemDicomObject>,
    orientation: Option<&InMemDicomObject>,
    measures: Option<&InMemDicomObject>,
    instance: i64,
) -> Result<Place, DicomError> {
    let reals = |group: Option<&InMemDicomObject>, tag| match group {
        Some(group) => stated_reals(group, tag, instance),
        None => Ok(None),
    };
    let position = reals(position, tags::IMAGE_POSITION_PATIENT)?;
    let orientation = reals(orientation, tags::IMAGE_ORIENTATION_PATIENT)?;
    let spacing = reals(measures, tags::PIXEL_SPACING)?;
    let are_stated = [position.is_some(), orientation.is_some(), spacing.is_some()];
    let axes = orientation.and_then(|cosines| {
        let [row, column] = [cosines.get(..3)?, cosines.get(3..)?].map(vector);
        orthonormal(row?, column?)
    });
    let spacing = spacing.and_then(|spacing| match spacing[..] {
        // The distance between rows comes first (PS3.3 §10.7.1.3).
        [rows, columns] if rows > 0.0 && columns > 0.0 => Some([columns, rows]),
        _ => None,
    });
    let position = position.as_deref().and_then(vector);
    let faults = [
        (
            position.is_none(),
            "some slices lack Image Position (Patient)",
            "Image Position (Patient) of some slices is not three numbers",
        ),
        (
            axes.is_none(),
            "some slices lack Image Orientation (Patient)",
            "Image Orientation (Patient) of some slices is not two perpendicular directions of length 1, to three decimals",
        ),
        (
            spacing.is_none(),
            "some slices lack Pixel Spacing",
            "Pixel Spacing of some slices is not two positive numbers",
        ),
    ];
    let mut wrong = faults.into_iter().zip(are_stated);
    let fault = wrong.find(|((is_wrong, ..), _)| *is_wrong);
    Ok(Place {
        position,
        axes,
        spacing_mm: spacing,
        fault: fault.map(|((_, lacking, wrong), is_stated)| match is_stated {
            true => wrong,
            false => lacking,
        }),
    })
}

/// Both directions, normalised, if they are orthonormal within the tolerance.
fn orthonormal(row: DVec3, column: DVec3) -> Option<[DVec3; 2]> {
    let lengths = [row.length(), column.length()];
    let sound = lengths
        .iter()
        .all(|length| (length - 1.0).abs() < AXES_TOLERANCE)
        && row.dot(column).abs() < AXES_TOLERANCE;
    sound.then(|| [row / lengths[0], column / lengths[1]])
}

/// Rounded to thousandths, for comparison.
fn thousandths(value: f64) -> i64 {
    (value * 1000.0).round() as i64
}

/// The first 8 bytes of a text's BLAKE3 digest, for comparison.
fn hash_of(text: &str) -> i64 {
    let mut bytes = [0; 8];
    bytes.copy_from_slice(&blake3::hash(text.as_bytes()).as_bytes()[..8]);
    i64::from_le_bytes(bytes)
}

fn classic_frame(object: &InMemDicomObject) -> Result<Frame, DicomError> {
    let instance = instance_number(object);
    let Place {
        position,
        axes,
        spacing_mm,
        fault,
    } = placed(Some(object), Some(object), Some(object), instance)?;
    Ok(Frame {
        instance,
        position,
        axes,
        spacing_mm,
        fault,
        rescale: rescale(object, instance)?,
        acquisition: [
            real(object, tags::ECHO_TIME).map(thousandths),
            integer(object, tags::ACQUISITION_NUMBER),
            integer(object, tags::TEMPORAL_POSITION_IDENTIFIER),
            real(object, tags::DIFFUSION_B_VALUE).map(thousandths),
            Some(hash_of(&image_type(object))),
            None,
            None,
        ],
    })
}

fn rescale(object: &InMemDicomObject, instance: i64) -> Result<[Option<f64>; 2], DicomError> {
    let number = |tag| stated_real(object, tag, instance);
    Ok([
        number(tags::RESCALE_SLOPE)?,
        number(tags::RESCALE_INTERCEPT)?,
    ])
}

/// A frame of an Enhanced image: its own functional groups, then the shared ones.
fn grouped_frame(
    object: &InMemDicomObject,
    shared: Option<&InMemDicomObject>,
    own: &InMemDicomObject,
    index: usize,
) -> Result<Frame, DicomError> {
    let instance = index as i64 + 1;
    let group = |tag: Tag| {
        let source = [Some(own), shared].into_iter().flatten();
        source
            .filter_map(|groups| groups.get(tag)?.items()?.first())
            .next()
    };
    let Place {
        position,
        axes,
        spacing_mm,
        fault,
    } = placed(
        group(tags::PLANE_POSITION_SEQUENCE),
        group(tags::PLANE_ORIENTATION_SEQUENCE),
        group(tags::PIXEL_MEASURES_SEQUENCE),
        instance,
    )?;
    let content = group(tags::FRAME_CONTENT_SEQUENCE);
    let echo = group(tags::MR_ECHO_SEQUENCE);
    let kind = group(tags::MR_IMAGE_FRAME_TYPE_SEQUENCE);
    let hashed = |group: Option<&InMemDicomObject>, tag| {
        Some(hash_of(&text(group?, tag)?.to_ascii_uppercase()))
    };
    let scaled = group(tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE).unwrap_or(object);
    Ok(Frame {
        instance,
        position,
        axes,
        spacing_mm,
        fault,
        rescale: rescale(scaled, instance)?,
        acquisition: [
            echo.and_then(|group| real(group, tags::EFFECTIVE_ECHO_TIME))
                .map(thousandths),
            None,
            content.and_then(|group| integer(group, tags::TEMPORAL_POSITION_INDEX)),
            None,
            hashed(kind, tags::FRAME_TYPE),
            hashed(kind, tags::COMPLEX_IMAGE_COMPONENT),
            hashed(
                group(tags::MR_VELOCITY_ENCODING_SEQUENCE),
                tags::VELOCITY_ENCODING_DIRECTION,
            ),
        ],
    })
}
