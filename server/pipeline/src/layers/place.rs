//! The place of a layer in its case.

use analysis::{Doubt, Registration, Verdict, register};
use case::{
    CaseFacts, Failure, LayerParameters, MatrixOrigin, PlacementFacts, PlacementVerdict,
    QualityState, Transform,
};
use geometry::{Envelope, Volume};
use glam::DAffine3;
use imaging::dicom::Attributes;
use imaging::nifti;

use super::fit::fit;
use crate::affine::{affine_of, rows_of};
use crate::failure::from_imaging;
use crate::{Limits, attributes};

/// Grids whose corners lie closer than this are the same, in mm.
const SAME_MM: f64 = 0.05;

/// The case that a layer is placed in.
#[derive(Debug)]
pub struct LayerCase<'a> {
    pub facts: &'a CaseFacts,
    pub envelope: &'a Envelope,
    /// Its volume, cropped to the envelope.
    pub volume: &'a Volume,
    /// Its uploaded volume, of which the header is read.
    pub source: &'a [u8],
    /// The identifying attributes, if it comes from DICOM.
    pub dicom: Option<&'a [u8]>,
}

/// What the headers state about the patient spaces of a layer and its case.
pub(super) struct Space {
    is_same_frame: bool,
    are_both_in_scanner_space: bool,
}

impl Space {
    pub(super) fn new(
        case: &LayerCase<'_>,
        limits: &Limits,
        (layer, is_in_scanner_space): (Option<&Attributes>, bool),
    ) -> Result<Self, Failure> {
        let known = case.dicom.map(attributes).transpose()?;
        let frames = [known.as_ref(), layer].map(|known| known.and_then(frame_of_reference));
        let (is_same_frame, are_comparable) = match frames {
            [Some(case), Some(layer)] => (case == layer, false),
            _ => (false, true),
        };
        let is_case_in_scanner_space =
            nifti::is_in_scanner_space(case.source, limits).map_err(from_imaging)?;
        Ok(Self {
            is_same_frame,
            are_both_in_scanner_space: are_comparable
                && is_in_scanner_space
                && is_case_in_scanner_space,
        })
    }

    /// Why header and case share a space, if they state it.
    fn is_shared(&self, case: &LayerCase<'_>, layer: &Volume) -> bool {
        self.is_same_frame || self.are_both_in_scanner_space || is_same_grid(case, layer)
    }
}

fn frame_of_reference(dicom: &Attributes) -> Option<&str> {
    dicom.value("FrameOfReferenceUID")
}

/// Whether the layer has the voxels of the case's volume.
fn is_same_grid(case: &LayerCase<'_>, layer: &Volume) -> bool {
    let size = layer.grid().size();
    if size != case.facts.native_size {
        return false;
    }
    let [known, own] = [
        affine_of(&case.facts.native_patient_from_voxel),
        layer.grid().patient_from_voxel(),
    ];
    let [x, y, z] = size.map(|side| side as f64);
    [[0.0, 0.0, 0.0], [x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]]
        .map(glam::DVec3::from_array)
        .iter()
        .all(|&corner| {
            let [known, own] = [known, own].map(|affine| affine.transform_point3(corner));
            known.distance(own) < SAME_MM
        })
}

/// Why a layer that lies where its header places it must be checked by eye.
#[derive(Debug, Clone, Copy, thiserror::Error)]
enum PlaceDoubt {
    #[error("it lies where its header places it; it was not compared with the volume of the case")]
    NotCompared,
    #[error(
        "it lies where its header places it; its header does not state that this is the space of the case"
    )]
    SpaceNotStated,
    #[error(
        "it lies where its header places it; it shows too little of the head to be compared with the volume of the case"
    )]
    CoversTooLittle,
    #[error(
        "the intensities of the case along the surface differ nearly as much as along its mirror image, so that it does not follow the cortex of this \
         head: it is of another head, moved, or in another space than it states"
    )]
    NotAlongCortex,
    #[error(
        "the surface lies more than 3 mm from the junction of grey and white matter of this head in the median: it is no surface of its cortex, or its place is wrong"
    )]
    FarFromJunction,
    #[error(
        "its MGH file does not state its axes (its goodRASflag is 0), so FreeSurfer's default was used: they point left, down and forwards, and voxels \
         have 1 mm; check its place, its sides and its size"
    )]
    AxesAssumed,
}

impl PlaceDoubt {
    /// The stable name, for programs and translations.
    fn code(self) -> &'static str {
        match self {
            Self::NotCompared => "place-not-compared",
            Self::SpaceNotStated => "space-not-stated",
            Self::CoversTooLittle => "covers-too-little",
            Self::NotAlongCortex => "not-along-cortex",
            Self::FarFromJunction => "far-from-junction",
            Self::AxesAssumed => case::AXES_ASSUMED,
        }
    }
}

/// The place that the header states.
fn header(doubt: Option<PlaceDoubt>) -> PlacementFacts {
    PlacementFacts {
        case_from_layer: rows_of(DAffine3::IDENTITY),
        origin: MatrixOrigin::Header,
        verdict: PlacementVerdict::Unchecked,
        quality: match doubt {
            Some(_) => QualityState::Review,
            None => QualityState::Ok,
        },
        reason: doubt.map(|doubt| doubt.to_string()),
        reason_code: doubt.map(|doubt| doubt.code().to_owned()),
        nmi_before: None,
        nmi_after: None,
        overlap: None,
        residual_mm: None,
        fit: None,
    }
}

/// The place of a layer whose file does not state its axes, which is in doubt unless somebody chose it.
pub(super) fn with_assumed_axes(place: PlacementFacts) -> PlacementFacts {
    if place.origin == MatrixOrigin::ByHand {
        return place;
    }
    let doubt = header(Some(PlaceDoubt::AxesAssumed));
    PlacementFacts {
        quality: doubt.quality,
        reason: doubt.reason,
        reason_code: doubt.reason_code,
        ..place
    }
}

/// The place of a layer that was drawn from surfaces, given its file: where they lie, compared with the head.
///
/// # Errors
/// A [`Failure`] if they fit the head only if they are mirrored.
pub(super) fn place_of_surface(
    case: &LayerCase<'_>,
    volume: &[u8],
) -> Result<PlacementFacts, Failure> {
    let places = imaging::surface::places(volume).unwrap_or_default();
    let fit = fit(case.facts, case.envelope, case.volume, &places);
    if fit.is_mirrored() {
        return Err(Failure::unusable(
            "surface-mirrored",
            "the surface follows the cortex of the case only if it is mirrored: left and right seem to be swapped. Correct the file; nothing else puts its \
             sides right",
        ));
    }
    let doubt = match fit.follows_cortex() {
        None => Some(PlaceDoubt::CoversTooLittle),
        Some(false) => Some(PlaceDoubt::NotAlongCortex),
        Some(true) => fit.is_far().then_some(PlaceDoubt::FarFromJunction),
    };
    Ok(PlacementFacts {
        fit: Some(fit),
        ..header(doubt)
    })
}

/// Finds the place of a layer.
///
/// # Errors
/// A [`Failure`] if it is to be registered and does not fit.
pub(super) fn place(
    case: &LayerCase<'_>,
    layer: &Volume,
    parameters: &LayerParameters,
    space: &Space,
) -> Result<PlacementFacts, Failure> {
    let is_acquired = parameters.kind.is_acquired();
    match parameters.transform {
        Transform::Matrix(rows) => Ok(PlacementFacts {
            case_from_layer: rows,
            origin: MatrixOrigin::ByHand,
            ..header(None)
        }),
        Transform::None if is_acquired => Ok(header(Some(PlaceDoubt::NotCompared))),
        Transform::Auto | Transform::None if !is_acquired => {
            let is_shared = space.is_shared(case, layer);
            Ok(header((!is_shared).then_some(PlaceDoubt::SpaceNotStated)))
        }
        transform => {
            let found = register(case.volume, case.envelope, layer);
            let measured = |facts: PlacementFacts| PlacementFacts {
                nmi_before: Some(found.nmi_before),
                nmi_after: Some(found.nmi_after),
                overlap: Some(found.overlap),
                residual_mm: found.residual_mm,
                ..facts
            };
            let doubt = match found.verdict {
                Verdict::Unchanged => {
                    return Ok(measured(PlacementFacts {
                        verdict: PlacementVerdict::Unchanged,
                        ..header(None)
                    }));
                }
                Verdict::Registered => {
                    return Ok(measured(PlacementFacts {
                        case_from_layer: rows_of(found.case_from_layer),
                        origin: MatrixOrigin::Registered,
                        verdict: PlacementVerdict::Registered,
                        ..header(None)
                    }));
                }
                Verdict::Failed(doubt) => doubt,
            };
            // Too little to compare says nothing against the header.
            let is_silent = matches!(doubt, Doubt::Overlap | Doubt::NoContrast);
            if transform == Transform::Auto && is_silent && space.is_shared(case, layer) {
                return Ok(measured(header(Some(PlaceDoubt::CoversTooLittle))));
            }
            Err(not_registered(doubt, &found))
        }
    }
}

fn not_registered(doubt: Doubt, found: &Registration) -> Failure {
    let reason = match doubt {
        Doubt::NoContrast => "it has a single intensity in the head".to_owned(),
        Doubt::Overlap => format!("it covers only {:.0} % of the head", 100.0 * found.overlap),
        Doubt::Mirrored => {
            "it fits better when mirrored: left and right seem to be swapped".to_owned()
        }
        Doubt::Parts => match found.residual_mm {
            Some(residual_mm) => format!(
                "the parts of the head do not agree (they fit best {residual_mm:.1} mm away in the median): it is another head, \
                 or its header is wrong by more than the registration can correct"
            ),
            None => "the parts of the head do not agree: it is another head".to_owned(),
        },
    };
    let advice = match doubt {
        // No rigid transform mirrors, and its header would show the wrong side.
        Doubt::Mirrored => "Correct the file; nothing else puts its sides right",
        Doubt::NoContrast | Doubt::Overlap | Doubt::Parts => {
            "If it is the same head, send its transform as a matrix, or `none` for the place of its header"
        }
    };
    Failure::unusable(
        "layer-not-registered",
        format!("the layer cannot be placed: {reason}. {advice}"),
    )
}
