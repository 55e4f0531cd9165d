//! Slices in space: sorted along their normal and evenly spaced, or rejected with the numbers of the slices at fault.

use glam::{DAffine3, DMat3, DVec3};

use super::DicomError;
use super::choose::{FEWEST_SLICES, Series};
use super::header::{DIFFERENCES, Frame, Image, PixelFormat};

/// The greatest difference of directions within a volume, in each component of a unit vector: about 0.06°.
const DIRECTION_TOLERANCE: f64 = 1e-3;

/// The greatest relative difference of pixel spacings within a volume.
const SPACING_TOLERANCE: f64 = 1e-3;

/// Slices that are closer than this have the same position.
const SAME_PLACE_MM: f64 = 0.01;

/// The greatest deviation of a distance between slices from the median: a share of it, and some millimetres for
/// rounding in texts.
const STEP_TOLERANCE: [f64; 2] = [0.02, 0.005];

/// The greatest distance of a slice from its evenly spaced position, as a share of the slice distance.
const DRIFT_TOLERANCE: f64 = 0.1;

/// The greatest angle by which the stack may lean.
const TILT_TOLERANCE_DEGREES: f64 = 0.5;

/// The greatest distance of a slice from the line through the first and the last.
const SHIFT_TOLERANCE_MM: f64 = 0.1;

/// The limits for interpolation: missing slices in a row, the distance of their neighbours, and the share of missing
/// slices.
const MOST_MISSING_IN_A_ROW: usize = 2;
const WIDEST_GAP_MM: f64 = 6.0;
const LARGEST_SHARE_MISSING: f64 = 0.1;

/// A frame: the number of its image, and its number in the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FrameIndex {
    pub(super) image: usize,
    pub(super) frame: usize,
}

/// Slices in the order of their position along the normal.
#[derive(Debug)]
pub(super) struct Stack {
    /// Columns, rows and slices, including missing slices.
    pub(super) size: [usize; 3],
    pub(super) patient_from_voxel: DAffine3,
    /// The frame of each slice; `None` for a missing slice, if gaps are allowed.
    pub(super) slices: Vec<Option<FrameIndex>>,
}

/// A frame with a position.
#[derive(Clone, Copy)]
struct Slice<'a> {
    index: FrameIndex,
    frame: &'a Frame,
    format: &'a PixelFormat,
    position: DVec3,
    axes: [DVec3; 2],
    spacing_mm: [f64; 2],
    /// Along the normal.
    height_mm: f64,
}

impl Slice<'_> {
    fn instance(&self) -> i64 {
        self.frame.instance
    }
}

/// Puts the slices of a series in order.
pub(super) fn stack(series: &Series, allow_gaps: bool) -> Result<Stack, DicomError> {
    let mut slices = placed(&series.images)?;
    check_shared(&slices)?;
    let normal = slices[0].axes[0].cross(slices[0].axes[1]);
    for slice in &mut slices {
        slice.height_mm = slice.position.dot(normal);
    }
    slices.sort_by(|a, b| a.height_mm.total_cmp(&b.height_mm));
    check_doubled(&slices)?;
    if slices.len() < FEWEST_SLICES {
        return Err(DicomError::TooFewSlices {
            slices: slices.len(),
        });
    }
    let rounding_mm = rounding_mm(&slices);
    check_lean(&slices, normal, rounding_mm)?;
    let places = places(&slices, allow_gaps, rounding_mm)?;
    Ok(assemble(&slices, &places))
}

/// Every frame with its position; the error lists frames without one.
fn placed(images: &[Image]) -> Result<Vec<Slice<'_>>, DicomError> {
    let mut slices = Vec::new();
    let (mut unplaced, mut fault) = (Vec::new(), None);
    for (image, of_image) in images.iter().enumerate() {
        let format = of_image.format.as_ref().map_err(Clone::clone)?;
        let frames = of_image.frames.as_ref().map_err(Clone::clone)?;
        for (frame, of_frame) in frames.iter().enumerate() {
            match (of_frame.position, of_frame.axes, of_frame.spacing_mm) {
                (Some(position), Some(axes), Some(spacing_mm)) => slices.push(Slice {
                    index: FrameIndex { image, frame },
                    frame: of_frame,
                    format,
                    position,
                    axes,
                    spacing_mm,
                    height_mm: 0.0,
                }),
                _ => {
                    unplaced.push(of_frame.instance);
                    fault = fault.or(of_frame.fault);
                }
            }
        }
    }
    if unplaced.is_empty() && !slices.is_empty() {
        return Ok(slices);
    }
    unplaced.sort_unstable();
    Err(DicomError::NotPlaced {
        what: fault.unwrap_or("there are no slices"),
        instances: unplaced,
    })
}

/// All slices must share size, spacing and orientation.
fn check_shared(slices: &[Slice]) -> Result<(), DicomError> {
    let near = |a: f64, b: f64| (a - b).abs() <= SPACING_TOLERANCE * a.abs();
    same(slices, "dicom-mixed-sizes", "size", |a, b| {
        [a.format.columns, a.format.rows] == [b.format.columns, b.format.rows]
    })?;
    same(slices, "dicom-mixed-orientations", "orientation", |a, b| {
        (0..2).all(|axis| {
            let difference = (a.axes[axis] - b.axes[axis]).abs();
            difference.max_element() <= DIRECTION_TOLERANCE
        })
    })?;
    same(slices, "dicom-mixed-spacings", "pixel spacing", |a, b| {
        (0..2).all(|axis| near(a.spacing_mm[axis], b.spacing_mm[axis]))
    })
}

/// Checks that all slices agree; the error lists those that disagree with the majority.
fn same(
    slices: &[Slice],
    kind: &'static str,
    what: &'static str,
    agree: impl Fn(&Slice, &Slice) -> bool,
) -> Result<(), DicomError> {
    let agrees =
        |model: &Slice| -> Vec<bool> { slices.iter().map(|slice| agree(model, slice)).collect() };
    let with_first = agrees(&slices[0]);
    let Some(other) = with_first.iter().position(|&agrees| !agrees) else {
        return Ok(());
    };
    let with_other = agrees(&slices[other]);
    let count = |agreeing: &[bool]| agreeing.iter().filter(|&&agrees| agrees).count();
    let majority = if count(&with_other) > count(&with_first) {
        with_other
    } else {
        with_first
    };
    let odd = slices.iter().zip(&majority).filter(|&(_, &agrees)| !agrees);
    let mut instances: Vec<i64> = odd.map(|(slice, _)| slice.instance()).collect();
    instances.sort_unstable();
    Err(DicomError::Mixed {
        kind,
        what,
        instances,
    })
}

/// Slices with the same position: several acquisitions, or single surplus slices.
fn check_doubled(slices: &[Slice]) -> Result<(), DicomError> {
    let together = |a: &Slice, b: &Slice| b.height_mm - a.height_mm < SAME_PLACE_MM;
    let groups: Vec<&[Slice]> = slices.chunk_by(together).collect();
    let crowded: Vec<&&[Slice]> = groups.iter().filter(|group| group.len() > 1).collect();
    if crowded.is_empty() {
        return Ok(());
    }
    if 2 * crowded.len() > groups.len() {
        return Err(DicomError::SeveralAcquisitions {
            acquisitions: groups.iter().map(|group| group.len()).max().unwrap_or(0),
            slices: groups.len(),
            difference: difference(crowded[0]),
        });
    }
    let mut instances = Vec::new();
    for group in crowded {
        let mut numbers: Vec<i64> = group.iter().map(Slice::instance).collect();
        numbers.sort_unstable();
        instances.extend(&numbers[1..]);
    }
    instances.sort_unstable();
    Err(DicomError::SlicesDoubled { instances })
}

fn difference(group: &[Slice]) -> &'static str {
    let differs = |&which: &usize| {
        let value = |slice: &Slice| slice.frame.acquisition[which];
        group.iter().any(|slice| value(slice) != value(&group[0]))
    };
    let which = (0..DIFFERENCES.len()).find(differs);
    which.map_or("nothing that their headers state", |which| {
        DIFFERENCES[which]
    })
}

/// How far the rounding of oblique positions to one decimal may move two slices against each other: half a decimal in each of
/// three directions, for both. Zero if they have more decimals, or if the slices differ along one axis alone, whose rounding
/// does not bend the stack.
fn rounding_mm(slices: &[Slice]) -> f64 {
    const DECIMAL_MM: f64 = 0.1;
    let is_rounded = |coordinate: f64| {
        let decimals = coordinate / DECIMAL_MM;
        (decimals - decimals.round()).abs() < 1e-6
    };
    let coordinates = |slice: &Slice| slice.position.to_array();
    let first = coordinates(&slices[0]);
    let moves = |&axis: &usize| {
        let has_moved =
            |slice: &Slice| (coordinates(slice)[axis] - first[axis]).abs() > DECIMAL_MM / 2.0;
        slices.iter().any(has_moved)
    };
    let is_oblique = (0..3).filter(moves).count() > 1;
    let are_rounded = slices
        .iter()
        .all(|slice| coordinates(slice).into_iter().all(is_rounded));
    match is_oblique && are_rounded {
        true => DECIMAL_MM * 3f64.sqrt(),
        false => 0.0,
    }
}

/// The stack must be upright, except for rounding.
fn check_lean(slices: &[Slice], normal: DVec3, rounding_mm: f64) -> Result<(), DicomError> {
    let (first, last) = (&slices[0], &slices[slices.len() - 1]);
    let across = |offset: DVec3| offset - normal * offset.dot(normal);
    let whole = last.position - first.position;
    let degrees = across(whole).length().atan2(whole.dot(normal)).to_degrees();
    if degrees > TILT_TOLERANCE_DEGREES {
        check_jump(slices, across(whole).length(), across)?;
        return Err(DicomError::GantryTilt {
            degrees,
            slices: slices.len(),
        });
    }
    for (number, slice) in slices.iter().enumerate() {
        let offset = slice.position - first.position;
        let share = offset.dot(normal) / whole.dot(normal);
        let shift_mm = across(offset - whole * share).length();
        if shift_mm > SHIFT_TOLERANCE_MM + rounding_mm {
            return Err(DicomError::SliceShifted {
                slice: number + 1,
                shift_mm,
            });
        }
    }
    Ok(())
}

/// A stack whose slices are all in line but for one step does not lean.
fn check_jump(
    slices: &[Slice],
    whole_mm: f64,
    across: impl Fn(DVec3) -> DVec3,
) -> Result<(), DicomError> {
    let sideways = |pair: &[Slice]| across(pair[1].position - pair[0].position).length();
    let steps = slices.windows(2).map(sideways).enumerate();
    match steps.max_by(|(_, one), (_, other)| one.total_cmp(other)) {
        Some((before, shift_mm)) if shift_mm > whole_mm / 2.0 && slices.len() > FEWEST_SLICES => {
            Err(DicomError::SliceShifted {
                slice: before + 2,
                shift_mm,
            })
        }
        _ => Ok(()),
    }
}

/// The number of each slice, from 0, counting missing slices.
fn places(slices: &[Slice], allow_gaps: bool, rounding_mm: f64) -> Result<Vec<usize>, DicomError> {
    let steps: Vec<f64> = slices
        .windows(2)
        .map(|pair| pair[1].height_mm - pair[0].height_mm)
        .collect();
    let mut sorted = steps.clone();
    sorted.sort_by(f64::total_cmp);
    let usual_mm = sorted[(sorted.len() - 1) / 2];
    let [share, rounding] = STEP_TOLERANCE;
    let mut places = vec![0];
    for (before, &found_mm) in steps.iter().enumerate() {
        let slots = (found_mm / usual_mm).round().max(1.0);
        let off_mm = (found_mm - slots * usual_mm).abs();
        // A gap of thousands of slices does not belong to one volume.
        if off_mm > share * usual_mm * slots + rounding + rounding_mm || slots > 1e4 {
            return Err(DicomError::SlicesUneven {
                usual_mm,
                found_mm,
                after: before + 1,
            });
        }
        places.push(places[before] + slots as usize);
    }
    check_missing(&places, usual_mm, allow_gaps)?;
    check_drift(slices, &places, rounding_mm)?;
    Ok(places)
}

/// Small differences must not add up.
fn check_drift(slices: &[Slice], places: &[usize], rounding_mm: f64) -> Result<(), DicomError> {
    let last = slices.len() - 1;
    let first_mm = slices[0].height_mm;
    let mean_mm = (slices[last].height_mm - first_mm) / places[last] as f64;
    let off =
        |index: usize| (slices[index].height_mm - first_mm - places[index] as f64 * mean_mm).abs();
    match (1..last).find(|&index| off(index) > DRIFT_TOLERANCE * mean_mm + rounding_mm) {
        None => Ok(()),
        Some(index) => Err(DicomError::SlicesUneven {
            usual_mm: mean_mm,
            found_mm: slices[index].height_mm - slices[index - 1].height_mm,
            after: index,
        }),
    }
}

fn check_missing(places: &[usize], usual_mm: f64, allow_gaps: bool) -> Result<(), DicomError> {
    let gaps = || places.windows(2).filter(|pair| pair[1] - pair[0] > 1);
    let missing: Vec<usize> = gaps()
        .flat_map(|pair| pair[0] + 2..pair[1] + 1)
        .take(1 << 16)
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    let narrow = |pair: &[usize]| {
        let slots = pair[1] - pair[0];
        slots <= MOST_MISSING_IN_A_ROW + 1 && slots as f64 * usual_mm <= WIDEST_GAP_MM
    };
    let total = places[places.len() - 1] + 1;
    let few = missing.len() as f64 <= LARGEST_SHARE_MISSING * total as f64;
    let honest = few && gaps().all(narrow);
    if honest && allow_gaps {
        return Ok(());
    }
    Err(DicomError::SlicesMissing {
        missing,
        hint: if honest {
            "export the series again, or set `allow_gaps` to interpolate the missing slices"
        } else {
            "export the series again; the gaps are too wide or too many to interpolate"
        },
    })
}

fn assemble(slices: &[Slice], places: &[usize]) -> Stack {
    let (first, last) = (&slices[0], &slices[slices.len() - 1]);
    let count = places[places.len() - 1] + 1;
    let step = (last.position - first.position) / (count - 1) as f64;
    let [row, column] = [0, 1].map(|axis| first.axes[axis] * first.spacing_mm[axis]);
    let mut ordered = vec![None; count];
    for (slice, &place) in slices.iter().zip(places) {
        ordered[place] = Some(slice.index);
    }
    Stack {
        size: [first.format.columns, first.format.rows, count],
        patient_from_voxel: DAffine3 {
            matrix3: DMat3::from_cols(row, column, step),
            translation: first.position,
        },
        slices: ordered,
    }
}
