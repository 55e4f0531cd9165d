//! What readers have marked, as a measurement report or as segments.

use case::findings::Finding;
use case::{CaseFacts, CaseId, PatientSide, StandardPosition};
use cases::Cases;
use cases::readings::KeptReading;
use http::problem::AppError;
use imaging::dicom::write::{
    self, Algorithm, Conclusion, Head, Property, Segment, WriteError, uid_of,
};
use imaging::dicom::{Attributes, Mark, Side, StandardText};
use jiff::Timestamp;
use pipeline::findings::voxels_of;
use render::SHORT_NOTICE;

use super::mask::{native_grid, slices};
use super::moment::value;
use super::outline::{COMMENT, Outline, hash_of, refuse};
use super::request::FindingsPlan;

/// The findings of a result: all that are confirmed for a report, and of these those to look at for segments.
pub(super) async fn read(
    cases: &Cases,
    id: &CaseId,
    plan: FindingsPlan,
    reading: Option<&(KeptReading, String)>,
) -> Result<Vec<Finding>, AppError> {
    let mut list = match reading {
        Some((kept, _)) => kept.reading.findings.clone(),
        None => cases.findings(id).await?.list,
    };
    list.retain(|finding| !finding.is_unconfirmed);
    if plan == FindingsPlan::Segments {
        list.retain(Finding::is_kept);
    }
    let is_concluded = reading.is_some_and(|(kept, _)| kept.reading.is_concluded());
    if list.is_empty() && !is_concluded {
        return Err(refuse(
            "no-findings",
            "the case has no findings, or only dismissed or unconfirmed ones; mark or confirm something first",
        ));
    }
    Ok(list)
}

pub(super) fn outline(
    plan: FindingsPlan,
    findings: &[Finding],
    reading: Option<&(KeptReading, String)>,
) -> Outline {
    let (class, shown) = match plan {
        FindingsPlan::Report => (write::MEASUREMENT_REPORT, "findings"),
        FindingsPlan::Segments => (write::SEGMENTATION, "findings as segments"),
    };
    Outline {
        made_by: match reading {
            // It names what it has and whether it is signed.
            Some((kept, _)) => kept.tag.to_string(),
            None => serde_json::to_string(findings).unwrap_or_default(),
        },
        made_at: last_change(findings).max(reading.and_then(|(kept, _)| kept.signed_at)),
        derivation: format!(
            "Places that a reader has marked, with a brush of 3 mm. {}",
            *COMMENT
        ),
        ..Outline::new(class, shown)
    }
}

/// When one of the findings was last changed.
pub(super) fn last_change(findings: &[Finding]) -> Option<Timestamp> {
    let times = findings
        .iter()
        .filter_map(|finding| finding.changed_at.as_deref());
    times.filter_map(|time| time.parse().ok()).max()
}

/// A finding of a case as a report states it.
fn mark(id: &CaseId, source: &Attributes, finding: &Finding) -> Mark {
    let parts = [
        "isocortex finding",
        value(source, "FrameOfReferenceUID").unwrap_or_default(),
        &finding.id,
        finding.created_at.as_deref().unwrap_or_default(),
    ];
    Mark {
        id: finding.id.clone(),
        // The same in each report about it, whatever changes about it.
        tracking_uid: uid_of(&hash_of(&parts)),
        kind: finding.kind.name().to_owned(),
        points_in_patient: finding.points_in_patient.clone(),
        depth_mm: finding.depth_mm,
        side: match finding.side {
            Some(PatientSide::Left) => Some(Side::Left),
            Some(PatientSide::Right) => Some(Side::Right),
            Some(PatientSide::Middle | PatientSide::Unknown) | None => None,
        },
        gyrus: finding.gyrus.map(|gyrus| gyrus.name().to_owned()),
        standard: standard(finding),
        label: finding.label.clone(),
        note: finding.note.clone(),
        certainty: finding
            .certainty
            .map(|certainty| certainty.name().to_owned()),
        colour: finding.colour.clone(),
        from_map: finding.from_map.map(|map| map.name().to_owned()),
        is_dismissed: finding.is_dismissed,
        author: finding.author.clone(),
        case: Some(id.to_string()),
    }
}

/// Where a finding is in other heads, in words.
fn standard(finding: &Finding) -> StandardText {
    let StandardPosition { atlas, ac_pc } = finding.standard.unwrap_or_default();
    let about = |[x, y, z]: [i32; 3], error_mm| format!("{x} {y} {z} (± {error_mm} mm)");
    StandardText {
        mni152: atlas.map(|atlas| about(atlas.mni152, atlas.error_mm)),
        talairach: atlas.map(|atlas| about(atlas.talairach, atlas.error_mm)),
        ac_pc: ac_pc.map(|[x, y, z]| format!("{x} {y} {z}")),
    }
}

/// What a reader concludes, as a report states it.
pub(super) fn conclusion((kept, reader): (KeptReading, String)) -> Conclusion {
    Conclusion {
        reader,
        signed_at: kept.signed_at.map(|at| at.to_string()),
        stated: kept.reading.template.stated().collect(),
        text: kept.reading.conclusion,
    }
}

/// Findings of a case as a measurement report, with what a reader concludes.
pub(super) fn report(
    head: &Head<'_>,
    id: &CaseId,
    findings: &[Finding],
    conclusion: Option<&Conclusion>,
) -> Result<Vec<u8>, WriteError> {
    let marks: Vec<_> = findings
        .iter()
        .map(|each| mark(id, head.source, each))
        .collect();
    write::measurement_report(head, &marks, conclusion)
}

/// Findings of a case as segments.
pub(super) fn segments(
    head: &Head<'_>,
    id: &CaseId,
    findings: &[Finding],
    facts: &CaseFacts,
) -> Result<Vec<u8>, WriteError> {
    let native = native_grid(facts)?;
    let segment = |finding: &Finding| {
        let label = match &*finding.label {
            "" => &finding.id,
            label => label,
        };
        let segment = Segment {
            label: label.to_owned(),
            description: format!("Marked by a reader; {SHORT_NOTICE}"),
            algorithm: Algorithm::Manual,
            property: Property::SelectedRegion,
            mark: Some(mark(id, head.source, finding)),
        };
        Some((segment, voxels_of(finding, &native)?))
    };
    let found: Vec<_> = findings.iter().filter_map(segment).collect();
    let about = write::About {
        content_label: "FINDINGS",
        description: "Findings of a reader; research use only",
    };
    write::segmentation(head, &about, &found, &native, &slices(head.source, facts))
}
