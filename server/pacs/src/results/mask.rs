//! The brain mask and the envelope as segmentations.

use axum::body::Bytes;
use case::{Case, CaseFacts, CaseId, MaskMethod, ObjectKind};
use cases::{Cases, Error};
use geometry::{Grid, Mask};
use imaging::dicom::write::{self, Algorithm, Head, Property, Segment, WriteError};
use imaging::dicom::{Attributes, Instance};
use pipeline::codec::{decode_brain, decode_envelope};

use super::outline::{COMMENT, Outline};
use super::request::MaskPlan;

pub(super) fn outline(plan: MaskPlan, case: &Case) -> Outline {
    let shown = match plan {
        MaskPlan::Brain => "brain mask",
        MaskPlan::Envelope => "brain envelope",
    };
    let derivation = format!(
        "Mask of the brain, sampled at the centres of the voxels of the source. Closing radius of the envelope: {} mm. {}",
        case.parameters.closing_radius_mm, *COMMENT
    );
    Outline {
        derivation,
        ..Outline::new(write::SEGMENTATION, shown)
    }
}

pub(super) async fn load(cases: &Cases, id: &CaseId, plan: MaskPlan) -> Result<Mask, Error> {
    let turn = cases.queue.turn().await?;
    let loaded = match plan {
        MaskPlan::Brain => {
            let decode = |_: &CaseFacts, payloads: &[Bytes]| {
                Some(decode_brain(payloads.first()?)?.mask().clone())
            };
            cases.library.load(id, &[ObjectKind::Mask], decode).await?
        }
        MaskPlan::Envelope => {
            let decode = |_: &CaseFacts, payloads: &[Bytes]| {
                Some(decode_envelope(payloads.first()?)?.mask().clone())
            };
            cases
                .library
                .load(id, &[ObjectKind::Envelope], decode)
                .await?
        }
    };
    drop(turn);
    loaded.ok_or(Error::NoSuchCase)
}

pub(super) fn segmentation(
    head: &Head<'_>,
    mask: Mask,
    plan: MaskPlan,
    facts: &CaseFacts,
) -> Result<Vec<u8>, WriteError> {
    let native = native_grid(facts)?;
    let (content_label, label, description) = match plan {
        MaskPlan::Brain => ("BRAIN", "Brain", "Brain mask; research use only"),
        MaskPlan::Envelope => (
            "ENVELOPE",
            "Brain envelope",
            "Brain mask, closed over the sulci; research use only",
        ),
    };
    let about = write::About {
        content_label,
        description,
    };
    let segment = Segment {
        label: label.to_owned(),
        description: description.to_owned(),
        property: Property::Brain,
        mark: None,
        algorithm: match facts.quality.as_ref().map(|quality| quality.method) {
            Some(MaskMethod::Network) => Algorithm::Automatic("Isocortex, deepbet network"),
            Some(MaskMethod::TreePruning) => Algorithm::Automatic("Isocortex, tree pruning"),
            Some(MaskMethod::Volume) => Algorithm::Automatic("Isocortex, skull-stripped volume"),
            Some(MaskMethod::Supplied) | None => {
                Algorithm::Semiautomatic("Isocortex, from a supplied mask")
            }
        },
    };
    let slices = slices(head.source, facts);
    write::segmentation(head, &about, &[(segment, mask)], &native, &slices)
}

/// The grid of the source, in which a segmentation is.
pub(super) fn native_grid(facts: &CaseFacts) -> Result<Grid, WriteError> {
    cases::nifti::native_grid(facts).map_err(|_| WriteError::Size)
}

/// The image of each slice; `None` for an interpolated one.
pub(super) fn slices<'a>(source: &'a Attributes, facts: &CaseFacts) -> Vec<Option<&'a Instance>> {
    let [_, _, count] = facts.native_size;
    let interpolated = &source.interpolated_slices;
    if source.instances.len() + interpolated.len() != count {
        return vec![None; count];
    }
    let mut instances = source.instances.iter();
    let image = |number: usize| match interpolated.contains(&number) {
        true => None,
        false => instances.next(),
    };
    (1..=count).map(image).collect()
}
