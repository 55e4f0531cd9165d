//! A mask as Segmentation, on the slices of its source.

use std::ops::Range;

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use geometry::{Grid, Mask, as_position};
use glam::DVec3;

use super::common::{Head, WriteError, cut, each_once, file, reference, source_image};
use super::item::Item;
use super::uid::uid_of;
use crate::dicom::code;
use crate::dicom::marks::{SEGMENT_CREATOR, SEGMENT_MARK};
use crate::dicom::{Instance, Mark};

const CLASS: &str = uids::SEGMENTATION_STORAGE;

/// The most characters of the label of a segment.
const MAX_LABEL: usize = 64;

/// Who found a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Algorithm<'a> {
    /// A program, by its name.
    Automatic(&'a str),
    /// A program, from a mask that somebody supplied.
    Semiautomatic(&'a str),
    /// A person.
    Manual,
}

/// What a segment shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Property {
    /// The brain.
    Brain,
    /// A region that somebody has selected, whatever it is.
    SelectedRegion,
}

/// What a segmentation is about.
#[derive(Debug, Clone, Copy)]
pub struct About<'a> {
    /// Its name for programs: at most 16 capitals, digits and underscores.
    pub content_label: &'a str,
    /// What it is; at most 64 characters.
    pub description: &'a str,
}

/// What a mask is.
#[derive(Debug, Clone)]
pub struct Segment<'a> {
    /// Its name for people, of which 64 characters are written.
    pub label: String,
    /// What it is; at most 64 characters.
    pub description: String,
    /// Who found it.
    pub algorithm: Algorithm<'a>,
    /// What it shows.
    pub property: Property,
    /// What a reader has marked there, which [`marks`](crate::dicom::marks) reads back.
    pub mark: Option<Mark>,
}

/// A binary Segmentation with a frame for each slice of `native` in which a mask has a voxel, segment after segment.
///
/// A voxel of `native` belongs to a segment if its centre lies in a voxel of the mask. `slices` names the image of each
/// slice, in the order of the third axis of `native`; `None` if a slice has none.
///
/// # Errors
/// If the source has no study or no frame of reference, or the masks have no voxel in `native`.
pub fn segmentation(
    head: &Head<'_>,
    about: &About<'_>,
    segments: &[(Segment<'_>, Mask)],
    native: &Grid,
    slices: &[Option<&Instance>],
) -> Result<Vec<u8>, WriteError> {
    let frame_of_reference = head.of_source("FrameOfReferenceUID");
    let frame_of_reference = frame_of_reference.ok_or(WriteError::NoFrameOfReference)?;
    let [columns, rows, _] = native.size();
    let sides = [rows, columns].map(u16::try_from);
    let [Ok(rows), Ok(columns)] = sides else {
        return Err(WriteError::Size);
    };
    let found = frames(segments.iter().map(|(_, mask)| mask), native);
    if found.slices.is_empty() {
        return Err(WriteError::Empty);
    }
    let mut item = head.begin(CLASS, "SEG")?;
    item.text(tags::IMAGE_TYPE, VR::CS, r"DERIVED\PRIMARY")
        .text(tags::FRAME_OF_REFERENCE_UID, VR::UI, frame_of_reference)
        .text(
            tags::POSITION_REFERENCE_INDICATOR,
            VR::LO,
            head.of_source("PositionReferenceIndicator").unwrap_or(""),
        )
        .text(tags::DEVICE_SERIAL_NUMBER, VR::LO, "0")
        .text(tags::SEGMENTATION_TYPE, VR::CS, "BINARY")
        .text(tags::CONTENT_LABEL, VR::CS, about.content_label)
        .text(tags::CONTENT_DESCRIPTION, VR::LO, about.description)
        .text(tags::CONTENT_CREATOR_NAME, VR::PN, "")
        .codes(tags::DERIVATION_CODE_SEQUENCE, &[code::SEGMENTATION])
        .shorts(tags::SAMPLES_PER_PIXEL, &[1])
        .text(tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME2")
        .text(
            tags::NUMBER_OF_FRAMES,
            VR::IS,
            &found.slices.len().to_string(),
        )
        .shorts(tags::ROWS, &[rows])
        .shorts(tags::COLUMNS, &[columns])
        .shorts(tags::BITS_ALLOCATED, &[1])
        .shorts(tags::BITS_STORED, &[1])
        .shorts(tags::HIGH_BIT, &[0])
        .shorts(tags::PIXEL_REPRESENTATION, &[0])
        .items(
            tags::SEGMENT_SEQUENCE,
            (1..)
                .zip(segments)
                .map(|(number, (segment, _))| described(number, segment)),
        );
    put_dimensions(&mut item, head);
    put_series(&mut item, head, slices, &found);
    item.items(
        tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE,
        [shared_groups(native)],
    );
    // Frames at the same place have the same index of place.
    let mut places: Vec<_> = found.slices.iter().map(|&(_, slice)| slice).collect();
    places.sort_unstable();
    places.dedup();
    let of_frames = found.slices.iter().map(|&(segment, slice)| {
        let instance = slices.get(slice).copied().flatten();
        let place = places.partition_point(|&other| other < slice) as u32 + 1;
        frame_groups(native, slice, [segment, place], instance)
    });
    item.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, of_frames);
    item.bytes(tags::PIXEL_DATA, found.bits);
    file(item, CLASS, head.instance_uid)
}

/// The slices that have a voxel of a mask, and their voxels.
#[derive(Default)]
struct Frames {
    /// The number of the segment, from 1, and of the slice.
    slices: Vec<(u32, usize)>,
    /// One bit for each pixel, frame after frame without gaps, the first one lowest; an even number of bytes.
    bits: Vec<u8>,
}

fn frames<'m>(masks: impl Iterator<Item = &'m Mask>, native: &Grid) -> Frames {
    let mut found = Frames::default();
    for (segment, mask) in (1..).zip(masks) {
        found.add(segment, mask, native);
    }
    if found.bits.len() % 2 == 1 {
        found.bits.push(0);
    }
    found
}

impl Frames {
    fn add(&mut self, segment: u32, mask: &Mask, native: &Grid) {
        let [columns, rows, _] = native.size();
        let mask_from_native = mask.grid().voxel_from_patient() * native.patient_from_voxel();
        let is_inside = |voxel: [usize; 3]| {
            mask.contains(mask_from_native.transform_point3(as_position(voxel)))
        };
        let per_slice = columns * rows;
        let [x, y, z] = ranges(mask, native);
        for slice in z {
            let first = self.slices.len() * per_slice;
            let kept = self.bits.len();
            self.bits.resize((first + per_slice).div_ceil(8), 0);
            let mut is_empty = true;
            for row in y.clone() {
                for column in x.clone() {
                    if is_inside([column, row, slice]) {
                        let bit = first + row * columns + column;
                        self.bits[bit / 8] |= 1 << (bit % 8);
                        is_empty = false;
                    }
                }
            }
            match is_empty {
                true => self.bits.truncate(kept),
                false => self.slices.push((segment, slice)),
            }
        }
    }
}

/// Ranges of columns, rows and slices outside of which the mask has no voxel.
fn ranges(mask: &Mask, native: &Grid) -> [Range<usize>; 3] {
    let Some([least, most]) = mask.bounds() else {
        return [0..0, 0..0, 0..0];
    };
    let native_from_mask = native.voxel_from_patient() * mask.grid().patient_from_voxel();
    let mut ends = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for corner in 0..8 {
        // One voxel more on each side.
        let at = [0, 1, 2].map(|axis| match corner >> axis & 1 {
            0 => least[axis] as f64 - 1.0,
            _ => most[axis] as f64 + 1.0,
        });
        let at = native_from_mask.transform_point3(DVec3::from_array(at));
        for axis in 0..3 {
            ends[0][axis] = ends[0][axis].min(at[axis]);
            ends[1][axis] = ends[1][axis].max(at[axis]);
        }
    }
    let size = native.size();
    [0, 1, 2].map(|axis| {
        let begin = ends[0][axis].floor().max(0.0) as usize;
        let end = ends[1][axis].ceil().max(0.0) as usize + 1;
        begin.min(size[axis])..end.min(size[axis])
    })
}

fn described(number: u16, segment: &Segment<'_>) -> Item {
    let (kind, name) = match segment.algorithm {
        Algorithm::Automatic(name) => ("AUTOMATIC", Some(name)),
        Algorithm::Semiautomatic(name) => ("SEMIAUTOMATIC", Some(name)),
        Algorithm::Manual => ("MANUAL", None),
    };
    let (category, property) = match segment.property {
        Property::Brain => (code::ANATOMICAL_STRUCTURE, code::BRAIN),
        Property::SelectedRegion => (code::SPATIAL_CONCEPT, code::SELECTED_REGION),
    };
    // A backslash would separate two values.
    let label = segment.label.replace('\\', "/");
    let mut item = Item::new();
    item.shorts(tags::SEGMENT_NUMBER, &[number])
        .text(tags::SEGMENT_LABEL, VR::LO, &cut(&label, MAX_LABEL))
        .text(tags::SEGMENT_DESCRIPTION, VR::ST, &segment.description)
        .text(tags::SEGMENT_ALGORITHM_TYPE, VR::CS, kind)
        .codes(tags::SEGMENTED_PROPERTY_CATEGORY_CODE_SEQUENCE, &[category])
        .codes(tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE, &[property]);
    if let Some(name) = name {
        item.text(tags::SEGMENT_ALGORITHM_NAME, VR::LO, name);
    }
    let json = segment.mark.as_ref().map(serde_json::to_string);
    if let Some(Ok(json)) = json {
        let (creator, program) = SEGMENT_CREATOR;
        item.text(creator, VR::LO, program)
            .text(SEGMENT_MARK, VR::UT, &json);
    }
    item
}

/// The frames are indexed by segment and position.
fn put_dimensions(item: &mut Item, head: &Head<'_>) {
    let organization = uid_of(&blake3::hash(head.instance_uid.as_bytes()));
    let mut named = Item::new();
    named.text(tags::DIMENSION_ORGANIZATION_UID, VR::UI, &organization);
    let dimension = |index, group, label| {
        let mut dimension = named.clone();
        dimension
            .pointer(tags::DIMENSION_INDEX_POINTER, index)
            .pointer(tags::FUNCTIONAL_GROUP_POINTER, group)
            .text(tags::DIMENSION_DESCRIPTION_LABEL, VR::LO, label);
        dimension
    };
    let dimensions = [
        dimension(
            tags::REFERENCED_SEGMENT_NUMBER,
            tags::SEGMENT_IDENTIFICATION_SEQUENCE,
            "Segment Number",
        ),
        dimension(
            tags::IMAGE_POSITION_PATIENT,
            tags::PLANE_POSITION_SEQUENCE,
            "Image Position Patient",
        ),
    ];
    item.items(tags::DIMENSION_INDEX_SEQUENCE, dimensions);
    item.items(tags::DIMENSION_ORGANIZATION_SEQUENCE, [named]);
}

/// The images to which the frames refer, each once (Common Instance Reference).
fn put_series(item: &mut Item, head: &Head<'_>, slices: &[Option<&Instance>], found: &Frames) {
    let used = found.slices.iter();
    let used = used.filter_map(|&(_, slice)| slices.get(slice).copied().flatten());
    let references: Vec<_> = each_once(used).map(reference).collect();
    let series = head.of_source("SeriesInstanceUID");
    if let Some(series) = series.filter(|_| !references.is_empty()) {
        let mut referenced = Item::new();
        referenced
            .text(tags::SERIES_INSTANCE_UID, VR::UI, series)
            .items(tags::REFERENCED_INSTANCE_SEQUENCE, references);
        item.items(tags::REFERENCED_SERIES_SEQUENCE, [referenced]);
    }
}

/// The geometry of all frames.
fn shared_groups(native: &Grid) -> Item {
    let [x, y, z] = native.spacing_mm();
    let axes = native.patient_from_voxel().matrix3;
    let (row, column) = (axes.x_axis.normalize(), axes.y_axis.normalize());
    let mut measures = Item::new();
    measures
        .reals(tags::SLICE_THICKNESS, &[z])
        .reals(tags::SPACING_BETWEEN_SLICES, &[z])
        .reals(tags::PIXEL_SPACING, &[y, x]);
    let mut orientation = Item::new();
    let cosines = [row.to_array(), column.to_array()].concat();
    orientation.reals(tags::IMAGE_ORIENTATION_PATIENT, &cosines);
    let mut groups = Item::new();
    groups
        .items(tags::PIXEL_MEASURES_SEQUENCE, [measures])
        .items(tags::PLANE_ORIENTATION_SEQUENCE, [orientation]);
    groups
}

/// The segment and the place of a frame, each from 1, and the image that it lies on.
fn frame_groups(
    native: &Grid,
    slice: usize,
    [segment, place]: [u32; 2],
    instance: Option<&Instance>,
) -> Item {
    let position = native
        .patient_from_voxel()
        .transform_point3(DVec3::new(0.0, 0.0, slice as f64));
    let mut content = Item::new();
    content.longs(tags::DIMENSION_INDEX_VALUES, &[segment, place]);
    let mut position_item = Item::new();
    position_item.reals(tags::IMAGE_POSITION_PATIENT, &position.to_array());
    let mut identity = Item::new();
    identity.shorts(tags::REFERENCED_SEGMENT_NUMBER, &[segment as u16]);
    let mut groups = Item::new();
    groups
        .items(tags::FRAME_CONTENT_SEQUENCE, [content])
        .items(tags::PLANE_POSITION_SEQUENCE, [position_item])
        .items(tags::SEGMENT_IDENTIFICATION_SEQUENCE, [identity]);
    if let Some(instance) = instance {
        let mut source = source_image(instance, instance.frame);
        source.text(tags::SPATIAL_LOCATIONS_PRESERVED, VR::CS, "YES");
        let mut derivation = Item::new();
        derivation
            .items(tags::SOURCE_IMAGE_SEQUENCE, [source])
            .codes(tags::DERIVATION_CODE_SEQUENCE, &[code::SEGMENTATION]);
        groups.items(tags::DERIVATION_IMAGE_SEQUENCE, [derivation]);
    }
    groups
}
