//! Findings as a measurement report: places in the patient with what a reader wrote about them (PS3.16 TID 1500).

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use geometry::{flat_area_of, length_of};
use glam::DVec3;

use super::common::{Head, IMPLEMENTATION_CLASS_UID, WriteError, file};
use super::content::{coded, content, related, text};
use super::item::{Code, Item};
use super::key_object::{Listed, evidence_of};
use crate::dicom::code;
use crate::dicom::marks::{Mark, Side};

const CLASS: &str = uids::COMPREHENSIVE3_DSR_STORAGE;

/// How far a point may lie from the plane of a polygon, in mm: SCOORD3D polygons must be coplanar (PS3.3 C.18.9.1.2).
const COPLANAR_MM: f64 = 1e-3;

/// What a reader concludes.
#[derive(Debug, Clone)]
pub struct Conclusion {
    /// As people know the reader.
    pub reader: String,
    /// RFC 3339; `None` while it is open.
    pub signed_at: Option<String>,
    /// Empty if it has fixed words alone.
    pub text: String,
    /// The fields of the template and their words.
    pub stated: Vec<(&'static str, &'static str)>,
}

/// A Comprehensive 3D SR with a measurement group for each finding (PS3.3 A.35.13, PS3.16 TID 1500 and 1410), and what a reader
/// concludes as qualitative evaluations.
///
/// Coordinates have 32 bits. A polygon that is not plane is a closed polyline.
///
/// # Errors
/// If there is neither a finding nor a conclusion, and if the source has no study or no frame of reference.
pub fn measurement_report(
    head: &Head<'_>,
    marks: &[Mark],
    conclusion: Option<&Conclusion>,
) -> Result<Vec<u8>, WriteError> {
    let study = head.of_source("StudyInstanceUID");
    let study = study.ok_or(WriteError::NoStudy)?;
    let frame_of_reference = head.of_source("FrameOfReferenceUID");
    let frame_of_reference = frame_of_reference.ok_or(WriteError::NoFrameOfReference)?;
    if marks.is_empty() && conclusion.is_none() {
        return Err(WriteError::Empty);
    }
    let mut item = head.begin_document(CLASS, "SR")?;
    let mut scheme = Item::new();
    scheme
        .text(tags::CODING_SCHEME_DESIGNATOR, VR::SH, code::SCHEME)
        .text(tags::CODING_SCHEME_NAME, VR::ST, "Codes of Isocortex")
        .text(
            tags::CODING_SCHEME_RESPONSIBLE_ORGANIZATION,
            VR::ST,
            "Isocortex",
        );
    item.items(tags::CODING_SCHEME_IDENTIFICATION_SEQUENCE, [scheme])
        .text(tags::DEVICE_SERIAL_NUMBER, VR::LO, "0")
        .items(tags::REFERENCED_PERFORMED_PROCEDURE_STEP_SEQUENCE, [])
        .items(tags::PERFORMED_PROCEDURE_CODE_SEQUENCE, [])
        .text(tags::COMPLETION_FLAG, VR::CS, "PARTIAL")
        .text(
            tags::COMPLETION_FLAG_DESCRIPTION,
            VR::LO,
            &super::common::cut(head.comment, 64),
        )
        .text(tags::VERIFICATION_FLAG, VR::CS, "UNVERIFIED");
    if let Some(evidence) = evidence(head, study) {
        item.items(
            tags::CURRENT_REQUESTED_PROCEDURE_EVIDENCE_SEQUENCE,
            [evidence],
        );
    }
    let groups = marks.iter().map(|mark| group(mark, frame_of_reference));
    let measurements = (!marks.is_empty()).then(|| {
        let mut measurements = related("CONTAINS");
        measurements.container(code::IMAGING_MEASUREMENTS, None, groups);
        measurements
    });
    let language = coded("HAS CONCEPT MOD", code::LANGUAGE, code::ENGLISH);
    let observer = coded("HAS OBS CONTEXT", code::OBSERVER_TYPE, code::DEVICE);
    let mut device = content("HAS OBS CONTEXT", "UIDREF", code::DEVICE_OBSERVER_UID);
    device.text(tags::UID, VR::UI, IMPLEMENTATION_CLASS_UID);
    let procedure = coded("HAS CONCEPT MOD", code::PROCEDURE_REPORTED, code::MR);
    item.container(
        code::IMAGING_MEASUREMENT_REPORT,
        Some("1500"),
        [language, observer, device, procedure]
            .into_iter()
            .chain(measurements)
            .chain(conclusion.map(evaluations)),
    );
    file(item, CLASS, head.instance_uid)
}

/// The images of the source, each once; `None` if they are not known.
fn evidence(head: &Head<'_>, study: &str) -> Option<Item> {
    let series = head.of_source("SeriesInstanceUID")?;
    let listed: Vec<_> = head
        .images()
        .map(|image| Listed {
            series_uid: series.to_owned(),
            sop_class_uid: image.sop_class_uid.clone(),
            sop_instance_uid: image.sop_instance_uid.clone(),
        })
        .collect();
    (!listed.is_empty()).then(|| evidence_of(study, &listed))
}

/// The measurement group of a finding.
fn group(mark: &Mark, frame_of_reference: &str) -> Item {
    let mut uid = content("HAS OBS CONTEXT", "UIDREF", code::TRACKING_UID);
    uid.text(tags::UID, VR::UI, &mark.tracking_uid);
    let mut items = vec![
        text("HAS OBS CONTEXT", code::TRACKING_IDENTIFIER, &mark.id),
        uid,
        site("HAS CONCEPT MOD", code::BRAIN, mark.side.map(of_side)),
        region(mark, frame_of_reference),
        number(code::DEPTH, mark.depth_mm, code::MILLIMETRES),
        word(code::KIND, &mark.kind),
    ];
    let points = mark.points_in_patient.iter().copied();
    let points: Vec<_> = points.map(DVec3::from_array).collect();
    match &*mark.kind {
        "line" | "trajectory" | "acpc" => {
            items.push(number(code::LENGTH, length_of(&points), code::MILLIMETRES));
        }
        "polygon" => {
            let area = flat_area_of(&points);
            items.push(number(code::AREA, area, code::SQUARE_MILLIMETRES));
        }
        _ => {}
    }
    let written = [
        (code::GYRUS, mark.gyrus.as_ref()),
        (code::MNI152, mark.standard.mni152.as_ref()),
        (code::TALAIRACH, mark.standard.talairach.as_ref()),
        (code::AC_PC, mark.standard.ac_pc.as_ref()),
        (code::LABEL, Some(&mark.label)),
        (code::COMMENT, Some(&mark.note)),
        (code::COLOUR, Some(&mark.colour)),
        (code::MAP, mark.from_map.as_ref()),
        (code::AUTHOR, mark.author.as_ref()),
        (code::CASE, mark.case.as_ref()),
    ];
    for (name, value) in written {
        if let Some(value) = value.filter(|value| !value.is_empty()) {
            items.push(text("CONTAINS", name, value));
        }
    }
    if let Some(certainty) = &mark.certainty {
        items.push(word(code::CERTAINTY, certainty));
    }
    if mark.is_dismissed {
        items.push(word(code::STATE, code::DISMISSED));
    }
    let mut group = related("CONTAINS");
    group.container(code::MEASUREMENT_GROUP, Some("1410"), items);
    group
}

/// What a reader concludes about the head. Places and answers have the codes of the context groups 7153, 244 and 240 of PS3.16; signs of a dysplasia have
/// none there, and have ours.
fn evaluations(conclusion: &Conclusion) -> Item {
    let Conclusion {
        reader,
        signed_at,
        text: written,
        stated,
    } = conclusion;
    let word_of = |field: &str| {
        let mut stated = stated.iter();
        stated
            .find(|(name, _)| *name == field)
            .map(|(_, word)| *word)
    };
    let mut name = content("HAS OBS CONTEXT", "PNAME", code::PERSON_OBSERVER_NAME);
    name.text(tags::PERSON_NAME, VR::PN, &person_name(reader));
    let mut items = vec![
        coded("HAS OBS CONTEXT", code::OBSERVER_TYPE, code::PERSON),
        name,
    ];
    let lobe = word_of("lobe").map(|lobe| match lobe {
        "frontal" => code::FRONTAL_LOBE,
        "parietal" => code::PARIETAL_LOBE,
        "temporal" => code::TEMPORAL_LOBE,
        "occipital" => code::OCCIPITAL_LOBE,
        "insula" => code::INSULA,
        "cingulate" => code::CINGULATE_GYRUS,
        "cerebellum" => code::CEREBELLUM,
        _ => code::DEEP_NUCLEI,
    });
    let side = word_of("side").map(|side| match side {
        "left" => code::LEFT,
        "right" => code::RIGHT,
        _ => code::BILATERAL,
    });
    if lobe.or(side).is_some() {
        items.push(site("CONTAINS", lobe.unwrap_or(code::BRAIN), side));
    }
    for (name, field) in [
        (code::BLUR, "blur"),
        (code::THICKENING, "thickening"),
        (code::TRANSMANTLE, "transmantle"),
        (code::FLAIR, "flair"),
        (code::SULCAL_BOTTOM, "sulcal_bottom"),
    ] {
        let answer = word_of(field).map(|answer| match answer {
            "present" => code::PRESENT,
            "absent" => code::ABSENT,
            _ => code::UNDETERMINED,
        });
        items.extend(answer.map(|answer| coded("CONTAINS", name, answer)));
    }
    items.extend(word_of("certainty").map(|certainty| word(code::CERTAINTY, certainty)));
    let texts = [
        (code::GYRUS_OF_READER, word_of("gyrus")),
        (code::CONCLUSION, Some(&**written)),
        (code::SIGNED_AT, signed_at.as_deref()),
    ];
    for (name, value) in texts {
        let value = value.filter(|value| !value.is_empty());
        items.extend(value.map(|value| text("CONTAINS", name, value)));
    }
    let mut evaluations = related("CONTAINS");
    evaluations.container(code::QUALITATIVE_EVALUATIONS, None, items);
    evaluations
}

/// A name as a person's, whose parts `^` and `=` would divide: at most 64 characters.
fn person_name(name: &str) -> String {
    let plain = |letter| match letter {
        '^' | '=' | '\\' => ' ',
        letter => letter,
    };
    name.chars().map(plain).take(64).collect()
}

fn of_side(side: Side) -> Code<'static> {
    match side {
        Side::Left => code::LEFT,
        Side::Right => code::RIGHT,
    }
}

/// Where it is, and on which side if that is stated.
fn site(relation: &str, place: Code<'_>, side: Option<Code<'_>>) -> Item {
    let mut site = coded(relation, code::FINDING_SITE, place);
    if let Some(side) = side {
        let side = coded("HAS CONCEPT MOD", code::LATERALITY, side);
        site.items(tags::CONTENT_SEQUENCE, [side]);
    }
    site
}

/// Its points in the patient.
fn region(mark: &Mark, frame_of_reference: &str) -> Item {
    let mut points = mark.points_in_patient.clone();
    let graphic = match (&*mark.kind, points.len()) {
        (_, 1) => "POINT",
        ("polygon", _) => {
            points.extend(points.first().copied());
            if is_plane(&points) {
                "POLYGON"
            } else {
                "POLYLINE"
            }
        }
        _ => "POLYLINE",
    };
    let mut region = content("CONTAINS", "SCOORD3D", code::IMAGE_REGION);
    let numbers: Vec<f32> = points.concat().iter().map(|&mm| mm as f32).collect();
    region
        .text(tags::GRAPHIC_TYPE, VR::CS, graphic)
        .floats(tags::GRAPHIC_DATA, &numbers)
        .text(
            tags::REFERENCED_FRAME_OF_REFERENCE_UID,
            VR::UI,
            frame_of_reference,
        );
    region
}

/// Whether points lie in one plane.
fn is_plane(points: &[[f64; 3]]) -> bool {
    let from_first: Vec<DVec3> = points
        .iter()
        .map(|&point| DVec3::from_array(point) - DVec3::from_array(points[0]))
        .collect();
    let far = |a: &&DVec3, b: &&DVec3| a.length_squared().total_cmp(&b.length_squared());
    let Some(&along) = from_first.iter().max_by(far) else {
        return true;
    };
    let across: Vec<DVec3> = from_first.iter().map(|to| to.cross(along)).collect();
    let normal = across.iter().max_by(far).copied().unwrap_or_default();
    let normal = normal.normalize_or_zero();
    let mut off = from_first.iter().map(|to| to.dot(normal).abs());
    off.all(|mm| mm <= COPLANAR_MM)
}

fn number(name: Code<'_>, value: f64, unit: Code<'_>) -> Item {
    let mut measured = Item::new();
    measured
        .reals(tags::NUMERIC_VALUE, &[value])
        .codes(tags::MEASUREMENT_UNITS_CODE_SEQUENCE, &[unit]);
    let mut item = content("CONTAINS", "NUM", name);
    item.items(tags::MEASURED_VALUE_SEQUENCE, [measured]);
    item
}

/// A word of ours: its value is its meaning.
fn word(name: Code<'_>, value: &str) -> Item {
    let value = Code {
        value,
        scheme: code::SCHEME,
        meaning: value,
    };
    coded("CONTAINS", name, value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polygon_is_plane_or_not() {
        let square = [
            [0.0, 0.0, 1.0],
            [9.0, 0.0, 1.0],
            [9.0, 9.0, 1.0],
            [0.0, 9.0, 1.0],
        ];
        assert!(is_plane(&square));
        let mut bent = square;
        bent[2][2] = 1.01;
        assert!(!is_plane(&bent));
        assert!(is_plane(&bent[..3]));
        // Points on one line lie in a plane.
        assert!(is_plane(&[[0.0; 3], [1.0; 3], [2.0; 3], [3.0; 3]]));
    }
}
