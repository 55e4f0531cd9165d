//! What readers have marked, as a measurement report or a segmentation states it.

use dicom_core::Tag;
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use serde::{Deserialize, Serialize};

use super::DicomError;
use super::code;
use super::error::damaged;
use super::header::{parse, refuse_other};
use super::numbers::{items, text};
use super::scan::scan;

/// The most findings and points that are read.
const MAX_MARKS: usize = 1_000;
const MAX_POINTS: usize = 20_001;

/// What a segment is of, in private attributes of its item: a [`Mark`] as JSON.
pub(super) const SEGMENT_CREATOR: (Tag, &str) = (Tag(0x0063, 0x0010), "ISOCORTEX");
pub(super) const SEGMENT_MARK: Tag = Tag(0x0063, 0x1001);

/// What tells patients apart.
const OF_PATIENT: [(Tag, &str); 5] = [
    (tags::PATIENT_NAME, "PatientName"),
    (tags::PATIENT_ID, "PatientID"),
    (tags::ISSUER_OF_PATIENT_ID, "IssuerOfPatientID"),
    (tags::PATIENT_BIRTH_DATE, "PatientBirthDate"),
    (tags::PATIENT_SEX, "PatientSex"),
];

const WANTED: [Tag; 26] = [
    tags::SPECIFIC_CHARACTER_SET,
    tags::SOP_CLASS_UID,
    tags::PATIENT_NAME,
    tags::PATIENT_SEX,
    tags::PATIENT_ID,
    tags::ISSUER_OF_PATIENT_ID,
    tags::PATIENT_BIRTH_DATE,
    tags::STUDY_INSTANCE_UID,
    tags::CODE_VALUE,
    tags::CODING_SCHEME_DESIGNATOR,
    tags::RELATIONSHIP_TYPE,
    tags::VALUE_TYPE,
    tags::CONCEPT_NAME_CODE_SEQUENCE,
    tags::CONCEPT_CODE_SEQUENCE,
    tags::TEXT_VALUE,
    tags::UID,
    tags::MEASURED_VALUE_SEQUENCE,
    tags::NUMERIC_VALUE,
    tags::CONTENT_SEQUENCE,
    tags::GRAPHIC_DATA,
    tags::GRAPHIC_TYPE,
    tags::REFERENCED_FRAME_OF_REFERENCE_UID,
    tags::FRAME_OF_REFERENCE_UID,
    tags::SEGMENT_SEQUENCE,
    SEGMENT_CREATOR.0,
    SEGMENT_MARK,
];

/// A side of the patient.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// The left.
    Left,
    /// The right.
    Right,
}

/// Something that a reader has marked. The words of its members are not checked here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mark {
    /// Its id among the findings of its case.
    pub id: String,
    /// Its UID wherever it is written down.
    pub tracking_uid: String,
    /// `point`, `line`, `polygon`, `trajectory` or `acpc`.
    pub kind: String,
    /// LPS mm.
    pub points_in_patient: Vec<[f64; 3]>,
    /// The depth below the envelope.
    pub depth_mm: f64,
    /// Its side; `None` in the middle.
    pub side: Option<Side>,
    /// About which gyrus it is in.
    #[serde(default)]
    pub gyrus: Option<String>,
    /// Where it is in other heads, in words; it is written and never read.
    #[serde(default)]
    pub standard: StandardText,
    /// A line of text.
    pub label: String,
    /// Text.
    pub note: String,
    /// `definite`, `probable`, `possible` or `unlikely`.
    pub certainty: Option<String>,
    /// `#` and six hexadecimal digits.
    pub colour: String,
    /// The name of a map.
    pub from_map: Option<String>,
    /// Whether it was found to be normal.
    pub is_dismissed: bool,
    /// Who wrote it.
    pub author: Option<String>,
    /// The case in whose images it was marked.
    #[serde(default)]
    pub case: Option<String>,
}

/// A position in other heads, in words; absent where nothing is known.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StandardText {
    /// In MNI 152, with how far it may be off.
    pub mni152: Option<String>,
    /// In Talairach space, with how far it may be off.
    pub talairach: Option<String>,
    /// In the axes of both commissures.
    pub ac_pc: Option<String>,
}

/// The findings of a measurement report or a segmentation that this program wrote. The patient must not reach a log, an error or an address.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkedPatient {
    /// What is stated of the patient, by keyword.
    pub patient: Vec<(String, String)>,
    /// The frame of reference of the points.
    pub frame_of_reference: String,
    /// In the order of the file.
    pub marks: Vec<Mark>,
    /// Whether findings that were dismissed would be among them: a segmentation has none.
    pub has_dismissed: bool,
}

/// Reads a measurement report or a segmentation of findings of this program.
///
/// # Errors
/// If it is not DICOM, is damaged, or is another object.
pub fn marks(file: &[u8]) -> Result<MarkedPatient, DicomError> {
    refuse_other(file)?;
    let mut wanted = WANTED;
    wanted.sort_unstable();
    let report = parse(&scan(file, &wanted)?)?;
    let class = text(&report, tags::SOP_CLASS_UID);
    let each: Vec<_> = match class.as_deref() {
        Some(uids::COMPREHENSIVE3_DSR_STORAGE)
            if is_named(&report, code::IMAGING_MEASUREMENT_REPORT) =>
        {
            let measurements = item_named(&report, code::IMAGING_MEASUREMENTS);
            let measurements = content(measurements.ok_or_else(not_ours)?).iter();
            let groups = measurements.filter(|item| is_named(item, code::MEASUREMENT_GROUP));
            groups.map(mark).collect()
        }
        Some(uids::SEGMENTATION_STORAGE) => {
            let frame_of_reference = text(&report, tags::FRAME_OF_REFERENCE_UID);
            let frame_of_reference = frame_of_reference.ok_or_else(not_ours)?;
            let segments = items(&report, tags::SEGMENT_SEQUENCE).iter();
            let marks =
                segments.map(|segment| Some((of_segment(segment)?, frame_of_reference.clone())));
            marks.collect()
        }
        _ => return Err(not_ours()),
    };
    let mut found = MarkedPatient {
        patient: OF_PATIENT
            .iter()
            .filter_map(|&(tag, keyword)| Some((keyword.to_owned(), text(&report, tag)?)))
            .collect(),
        frame_of_reference: String::new(),
        marks: Vec::new(),
        has_dismissed: class.as_deref() != Some(uids::SEGMENTATION_STORAGE),
    };
    let mut points = 0;
    for each in each {
        let (mark, frame_of_reference) = each.ok_or_else(not_ours)?;
        points += mark.points_in_patient.len();
        let is_first = found.marks.is_empty();
        if found.marks.len() == MAX_MARKS || points > MAX_POINTS {
            return Err(damaged("it has more than 1,000 findings or 20,000 points"));
        }
        if !is_first && frame_of_reference != found.frame_of_reference {
            return Err(damaged("its findings lie in several frames of reference"));
        }
        found.frame_of_reference = frame_of_reference;
        found.marks.push(mark);
    }
    Ok(found)
}

fn not_ours() -> DicomError {
    damaged("it is neither a measurement report nor a segmentation with findings of this program")
}

/// The finding that a segment is of; `None` if it is not of this program.
fn of_segment(segment: &InMemDicomObject) -> Option<Mark> {
    let (creator, name) = SEGMENT_CREATOR;
    if text(segment, creator)? != name {
        return None;
    }
    let json = segment.get(SEGMENT_MARK)?.to_str().ok()?;
    serde_json::from_str(json.trim_end_matches(['\0', ' '])).ok()
}

/// A finding and its frame of reference; `None` if something is missing.
fn mark(group: &InMemDicomObject) -> Option<(Mark, String)> {
    let text_of = |name| {
        let value = item_named(group, name)?.get(tags::TEXT_VALUE)?;
        // A note has lines.
        Some(
            value
                .to_str()
                .ok()?
                .trim_end_matches(['\0', ' '])
                .to_owned(),
        )
    };
    let word_of = |name| {
        let item = item_named(group, name)?;
        let value = items(item, tags::CONCEPT_CODE_SEQUENCE).first()?;
        text(value, tags::CODE_VALUE)
    };
    let region = item_named(group, code::IMAGE_REGION)?;
    let kind = word_of(code::KIND)?;
    let numbers = region.element(tags::GRAPHIC_DATA).ok()?;
    let numbers = numbers.to_multi_float64().ok()?;
    let (points, []) = numbers.as_chunks::<3>() else {
        return None;
    };
    let mut points = points.to_vec();
    // A polygon is closed.
    if kind == "polygon" && points.len() > 1 && points.first() == points.last() {
        points.pop();
    }
    let depth = item_named(group, code::DEPTH)?;
    let depth = items(depth, tags::MEASURED_VALUE_SEQUENCE).first()?;
    let mark = Mark {
        id: text_of(code::TRACKING_IDENTIFIER)?,
        tracking_uid: text(item_named(group, code::TRACKING_UID)?, tags::UID)?,
        kind,
        points_in_patient: points,
        depth_mm: text(depth, tags::NUMERIC_VALUE)?.parse().ok()?,
        side: side(group),
        gyrus: text_of(code::GYRUS),
        standard: StandardText::default(),
        label: text_of(code::LABEL).unwrap_or_default(),
        note: text_of(code::COMMENT).unwrap_or_default(),
        certainty: word_of(code::CERTAINTY),
        colour: text_of(code::COLOUR)?,
        from_map: text_of(code::MAP),
        is_dismissed: word_of(code::STATE).as_deref() == Some(code::DISMISSED),
        author: text_of(code::AUTHOR),
        case: text_of(code::CASE),
    };
    let frame_of_reference = text(region, tags::REFERENCED_FRAME_OF_REFERENCE_UID)?;
    Some((mark, frame_of_reference))
}

fn side(group: &InMemDicomObject) -> Option<Side> {
    let laterality = item_named(item_named(group, code::FINDING_SITE)?, code::LATERALITY)?;
    let value = items(laterality, tags::CONCEPT_CODE_SEQUENCE).first()?;
    let value = text(value, tags::CODE_VALUE)?;
    [(code::LEFT, Side::Left), (code::RIGHT, Side::Right)]
        .into_iter()
        .find_map(|(code, side)| (code.value == value).then_some(side))
}

fn content(object: &InMemDicomObject) -> &[InMemDicomObject] {
    items(object, tags::CONTENT_SEQUENCE)
}

fn item_named(object: &InMemDicomObject, name: code::Code) -> Option<&InMemDicomObject> {
    content(object).iter().find(|item| is_named(item, name))
}

fn is_named(object: &InMemDicomObject, name: code::Code) -> bool {
    let found = items(object, tags::CONCEPT_NAME_CODE_SEQUENCE).first();
    found.is_some_and(|found| {
        let is = |tag, value| text(found, tag).as_deref() == Some(value);
        is(tags::CODE_VALUE, name.value) && is(tags::CODING_SCHEME_DESIGNATOR, name.scheme)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dicom::Attributes;
    use crate::dicom::write::{
        About, Algorithm, Conclusion, Head, Property, Segment, WriteError, measurement_report,
        segmentation,
    };
    use geometry::{Grid, Mask};
    use glam::DVec3;

    fn source() -> Attributes {
        let texts = [
            ("StudyInstanceUID", "1.2"),
            ("FrameOfReferenceUID", "1.3"),
            ("PatientID", "P-1"),
            ("PatientBirthDate", "19670312"),
        ];
        Attributes {
            attributes: texts
                .map(|(name, text)| (name.to_owned(), text.to_owned()))
                .to_vec(),
            ..Attributes::default()
        }
    }

    fn head(source: &Attributes) -> Head<'_> {
        Head {
            source,
            series_uid: "2.25.1",
            instance_uid: "2.25.2",
            series_number: 9700,
            series_description: "findings",
            derivation: "",
            comment: "research use only",
            version: "1",
            date: "20261124",
            time: "101112",
            offset: None,
            is_annotated: false,
            is_recognizable: None,
        }
    }

    fn written(source: &Attributes, marks: &[Mark]) -> Result<Vec<u8>, WriteError> {
        measurement_report(&head(source), marks, None)
    }

    /// Segments, of findings if they have any.
    fn segments(source: &Attributes, marks: &[Option<Mark>]) -> Vec<u8> {
        let grid = Grid::aligned([4, 4, 4], [1.0; 3], DVec3::ZERO).unwrap();
        let each = marks.iter().map(|mark| {
            let segment = Segment {
                label: "a".to_owned(),
                description: "b".to_owned(),
                algorithm: Algorithm::Manual,
                property: Property::SelectedRegion,
                mark: mark.clone(),
            };
            (segment, Mask::new(grid.clone(), vec![true; 64]).unwrap())
        });
        let about = About {
            content_label: "FINDINGS",
            description: "c",
        };
        let each: Vec<_> = each.collect();
        segmentation(&head(source), &about, &each, &grid, &[None; 4]).unwrap()
    }

    /// Id, issuer and date of birth; empty if they are not stated.
    fn patient(read: &MarkedPatient) -> [&str; 3] {
        ["PatientID", "IssuerOfPatientID", "PatientBirthDate"].map(|keyword| {
            let mut patient = read.patient.iter();
            let found = patient.find(|(name, _)| name == keyword);
            found.map_or("", |(_, value)| value.trim())
        })
    }

    #[test]
    fn segments_are_read_as_they_were_written_and_foreign_ones_are_refused() {
        let all = [
            mark("point", &[[0.0, 0.1, 1.0 / 3.0]]),
            mark("line", &[[0.0, 0.0, 1.0], [9.0, 0.0, 2.5]]),
        ];
        let read = marks(&segments(&source(), &all.clone().map(Some))).unwrap();
        assert_eq!(read.marks, all);
        assert_eq!(read.frame_of_reference, "1.3");
        // Viewers place the frames by the functional groups.
        let written = segments(&source(), &all.clone().map(Some));
        let object = dicom_object::from_reader(&written[..]).unwrap();
        let groups = [
            tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE,
            tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE,
        ];
        let groups = groups.map(|tag| object.get(tag)?.items().map(<[_]>::len));
        assert_eq!(groups, [Some(1), Some(8)]);
        assert_eq!(patient(&read), ["P-1", "", "19670312"]);
        for foreign in [
            segments(&source(), &[None]),
            segments(&source(), &[Some(all[0].clone()), None]),
        ] {
            assert!(marks(&foreign).is_err());
        }
    }

    fn mark(kind: &str, points: &[[f64; 3]]) -> Mark {
        Mark {
            id: "a-1".to_owned(),
            tracking_uid: "2.25.3".to_owned(),
            kind: kind.to_owned(),
            points_in_patient: points.to_vec(),
            depth_mm: 12.75,
            side: Some(Side::Right),
            gyrus: Some("insula".to_owned()),
            standard: StandardText::default(),
            label: "ü \\ <b>".to_owned(),
            note: "one\ntwo".to_owned(),
            certainty: Some("unlikely".to_owned()),
            colour: "#0a0b0c".to_owned(),
            from_map: Some("blur".to_owned()),
            is_dismissed: true,
            author: Some("somebody".to_owned()),
            case: Some("0123".to_owned()),
        }
    }

    #[test]
    fn what_a_reader_concludes_stands_beside_the_findings_in_codes() {
        let source = source();
        let conclusion = Conclusion {
            reader: "ana^silva".to_owned(),
            signed_at: Some("2026-11-28T10:20:30Z".to_owned()),
            text: "Blurred gyrus.\nElse nothing.".to_owned(),
            stated: vec![
                ("side", "left"),
                ("lobe", "temporal"),
                ("gyrus", "insula"),
                ("blur", "present"),
                ("flair", "absent"),
                ("certainty", "probable"),
            ],
        };
        let all = [mark("point", &[[0.0, 0.0, 1.0]])];
        let written = measurement_report(&head(&source), &all, Some(&conclusion)).unwrap();
        assert_eq!(marks(&written).unwrap().marks, all);
        let report = dicom_object::from_reader(&written[..]).unwrap();
        let evaluations = item_named(&report, code::QUALITATIVE_EVALUATIONS).unwrap();
        let coded = |item: &InMemDicomObject, name| {
            let item = item_named(item, name)?;
            let value = items(item, tags::CONCEPT_CODE_SEQUENCE).first()?;
            text(value, tags::CODE_VALUE)
        };
        let site = item_named(evaluations, code::FINDING_SITE).unwrap();
        for (item, name, value) in [
            (evaluations, code::FINDING_SITE, Some("78277001")),
            (site, code::LATERALITY, Some("7771000")),
            (evaluations, code::BLUR, Some("52101004")),
            (evaluations, code::FLAIR, Some("272519000")),
            (evaluations, code::THICKENING, None),
            (evaluations, code::CERTAINTY, Some("probable")),
            (evaluations, code::OBSERVER_TYPE, Some("121006")),
        ] {
            assert_eq!(coded(item, name).as_deref(), value, "{}", name.meaning);
        }
        let said = |name, tag| {
            let value = item_named(evaluations, name)?.get(tag)?.to_str().ok()?;
            Some(value.trim_end_matches(['\0', ' ']).to_owned())
        };
        for (name, tag, value) in [
            (code::CONCLUSION, tags::TEXT_VALUE, &*conclusion.text),
            (code::GYRUS_OF_READER, tags::TEXT_VALUE, "insula"),
            (code::PERSON_OBSERVER_NAME, tags::PERSON_NAME, "ana silva"),
        ] {
            assert_eq!(said(name, tag).as_deref(), Some(value));
        }
        // A conclusion needs no finding.
        let alone = measurement_report(&head(&source), &[], Some(&conclusion)).unwrap();
        let alone = dicom_object::from_reader(&alone[..]).unwrap();
        assert!(item_named(&alone, code::IMAGING_MEASUREMENTS).is_none());
        assert!(item_named(&alone, code::QUALITATIVE_EVALUATIONS).is_some());
    }

    #[test]
    fn a_report_is_read_as_it_was_written() {
        let bent = [
            [0.0, 0.0, 1.0],
            [9.0, 0.0, 2.5],
            [9.0, 9.0, 1.0],
            [0.0, 9.0, 2.5],
        ];
        let bare = Mark {
            side: None,
            gyrus: None,
            standard: StandardText::default(),
            label: String::new(),
            note: String::new(),
            certainty: None,
            from_map: None,
            is_dismissed: false,
            author: None,
            case: None,
            ..mark("trajectory", &bent[..2])
        };
        let all = [
            mark("point", &bent[..1]),
            mark("polygon", &bent),
            mark("line", &bent),
            bare,
        ];
        let read = marks(&written(&source(), &all).unwrap()).unwrap();
        assert_eq!(read.marks, all);
        assert_eq!(read.frame_of_reference, "1.3");
        assert_eq!(patient(&read), ["P-1", "", "19670312"]);
    }

    #[test]
    fn what_cannot_be_placed_is_not_written_and_what_is_damaged_is_not_read() {
        let mut elsewhere = source();
        elsewhere
            .attributes
            .retain(|(name, _)| name != "FrameOfReferenceUID");
        let one = [mark("point", &[[1.0; 3]])];
        assert_eq!(
            written(&elsewhere, &one),
            Err(WriteError::NoFrameOfReference)
        );
        assert_eq!(written(&source(), &[]), Err(WriteError::Empty));
        let file = written(&source(), &one).unwrap();
        for end in (0..file.len()).step_by(7) {
            assert!(marks(&file[..end]).is_err(), "{end}");
        }
        for at in (132..file.len()).step_by(3) {
            let mut flipped = file.clone();
            flipped[at] ^= 0x41;
            let _ = marks(&flipped);
        }
    }
}
