//! Opens the case of a study that a viewer of the PACS names: OHIF (`StudyInstanceUIDs`), Stone (`study`, `series`) and
//! IID-style (`requestType=STUDY`, `studyUID` or `accessionNumber`).
//!
//! The page first removes the identifiers from the address and the history of the browser; it sends them in the body of a request.

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::StatusCode;
use axum::response::Response;
use case::series::{AccessionNumber, SeriesQuery, Uid};
use case::{CaseId, CaseState};
use cases::Patient;
use imaging::dicom::kind_of_series;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::error::ReasonView;
use crate::series::{Head, Matches, SeriesWithoutCase};
use crate::state::Pacs;
use crate::values::ArrivalState;
use http::fresh::fresh_json;
use http::problem::AppError;
use http::sent::json_body;

/// The query of a launch address.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct LaunchRequest {
    /// The query, such as `StudyInstanceUIDs=…`, `study=…&series=…` or `requestType=STUDY&studyUID=…`.
    query: String,
}

/// What there is of a study.
#[derive(Debug, Default, Serialize, ToSchema)]
pub(crate) struct LaunchView {
    /// `ready`, `preparing`, `receiving`, `failed`, `nothing`, `absent`; `choice` if the query fits several studies or
    /// patients, also if a series of another patient makes no case, so that the user must choose; or `mismatch` if there is such a study, but not of the patient, the issuer or the accession number of the query.
    state: &'static str,
    /// The case to open, if there is one and it is the only one or the preferred one.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    case: Option<CaseId>,
    /// All cases that the query fits, one of each series. The preferred one comes first: original before derived, without
    /// a contrast agent before with one, finer before coarser, then the earlier acquisition. If the user must choose, the series
    /// of other patients that make no case follow.
    candidates: Vec<CandidateView>,
    /// Keys of the query that are not known and had no effect.
    ignored: Vec<String>,
    /// Why there is no picture, if it failed or became nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<ReasonView>,
    /// The nodes from which the series can be fetched: `POST /v1/retrievals`. None if the request names no series.
    nodes: Vec<String>,
    /// The study and the series to fetch.
    #[serde(skip_serializing_if = "Option::is_none")]
    study: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    series: Option<String>,
}

/// A case that a query fits, or a series of another patient that makes none.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = LaunchCandidate)]
pub(crate) struct CandidateView {
    /// The case; absent if the series makes none, so that it cannot be opened.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    case: Option<CaseId>,
    /// `queued`, `preparing`, `ready` or `failed`; of a series that makes no case `receiving`, `nothing`, `rejected` or `layer`.
    state: &'static str,
    /// Why a series makes no case.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<ReasonView>,
    /// The date of the study, such as `20261101`.
    #[serde(skip_serializing_if = "Option::is_none")]
    study_date: Option<String>,
    /// When the series was acquired, in the zone of the scanner, such as `20261101093000`.
    #[serde(skip_serializing_if = "Option::is_none")]
    acquired: Option<String>,
    /// Number and kind of the series; its whole description if the page shows the patient.
    series: String,
    /// Whether it was computed from other images.
    is_derived: bool,
    /// Whether a contrast agent was given.
    has_contrast: bool,
    /// The sides of a voxel in mm, once they are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    voxel_mm: Option<[f64; 3]>,
    /// Name, id with its issuer, and date of birth, if the page shows the patient: `Müller, Änne · P-77 (HOSPITAL) · * 1967-03-12`.
    #[serde(skip_serializing_if = "Option::is_none")]
    patient: Option<String>,
}

/// Find the case of a study
///
/// The preferred case of the study, or the one of the series if one is named; otherwise how far it is. A query that
/// fits several studies or patients opens none: all of them are `candidates`. Values that are given together must
/// agree with the case: study, series, accession number, patient and issuer.
#[utoipa::path(
    post, path = "/v1/launch", tag = "pacs",
    request_body = LaunchRequest,
    responses(
        (status = 200, description = "What there is of the study", body = LaunchView),
        (status = 400, description = "The query names no study"),
    )
)]
pub(crate) async fn find_launched(
    State(pacs): State<Pacs>,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    let asked: LaunchRequest = json_body(body)?;
    let view = find(&pacs, &Asked::parse(&asked.query)?).await?;
    Ok(fresh_json(StatusCode::OK, &view))
}

fn unreadable(detail: &'static str) -> AppError {
    AppError::bad_request("launch-unreadable", detail)
}

/// The greatest number of studies that a query may name.
const MOST_STUDIES: usize = 16;

/// The greatest number of unknown keys that are repeated, and the greatest length of one.
const MOST_IGNORED: usize = 16;
const LONGEST_KEY: usize = 40;

const OF_STUDY: [&str; 4] = ["studyinstanceuids", "studyinstanceuid", "study", "studyuid"];
const OF_SERIES: [&str; 4] = [
    "seriesinstanceuids",
    "seriesinstanceuid",
    "series",
    "seriesuid",
];
const OF_ISSUER: [&str; 3] = ["issuer", "issuerofpatientid", "assigningauthority"];
const FURTHER: [&str; 3] = ["requesttype", "accessionnumber", "patientid"];

/// What a query names: one study, or several with a value or a key for each. Values are not repeated, because they
/// identify a patient.
#[derive(Debug, PartialEq)]
struct Asked {
    queries: Vec<SeriesQuery>,
    /// What the case must agree with.
    accession_number: Option<AccessionNumber>,
    patient_id: Option<String>,
    issuer: Option<String>,
    ignored: Vec<String>,
}

impl Asked {
    fn parse(query: &str) -> Result<Self, AppError> {
        let query = query.trim_start_matches('?');
        let parse = || form_urlencoded::parse(query.as_bytes());
        refuse_empty(parse())?;
        let pairs: Vec<(String, String)> = parse()
            .map(|(key, value)| (key.to_ascii_lowercase(), value.into_owned()))
            .collect();
        let all = |keys: &[&str]| -> Vec<String> {
            let found = pairs.iter().filter(|(key, _)| keys.contains(&key.as_str()));
            let values = found.flat_map(|(_, value)| value.split(','));
            let values = values.filter(|value| !value.is_empty());
            values.map(str::to_owned).collect()
        };
        let only = |keys: &[&str], detail| {
            let mut values = pairs.iter().filter(|(key, _)| keys.contains(&key.as_str()));
            let value = values.next().map(|(_, value)| value.trim().to_owned());
            match values.next() {
                Some(_) => Err(unreadable(detail)),
                None => Ok(value),
            }
        };
        if all(&["requesttype"])
            .iter()
            .any(|kind| !kind.eq_ignore_ascii_case("study"))
        {
            return Err(unreadable("`requestType` must be STUDY"));
        }
        let uid = |text: String| {
            let uid = Uid::parse(&text);
            uid.ok_or_else(|| {
                unreadable("a UID must be numbers with points between them, at most 64 characters")
            })
        };
        let series = all(&OF_SERIES);
        let studies = all(&OF_STUDY);
        if studies.len() > MOST_STUDIES || series.len() > MOST_STUDIES {
            return Err(unreadable(
                "the address names more than 16 studies or series",
            ));
        }
        let number = only(
            &["accessionnumber"],
            "the address has several values of `accessionNumber`",
        )?;
        let number = number.map(|text| {
            let number = AccessionNumber::parse(&text);
            number.ok_or_else(|| unreadable("`accessionNumber` must be 1 to 16 characters"))
        });
        let number = number.transpose()?;
        let series = series.into_iter().map(uid).collect::<Result<Vec<_>, _>>()?;
        let mut queries = Vec::new();
        for study in studies {
            let study = uid(study)?;
            let of_study = |series| SeriesQuery::Study(study.clone(), series);
            let named = match &series[..] {
                [] => vec![of_study(None)],
                named => named.iter().cloned().map(Some).map(of_study).collect(),
            };
            for query in named {
                if !queries.contains(&query) {
                    queries.push(query);
                }
            }
        }
        if queries.is_empty() {
            let detail = "the address names no study; use `StudyInstanceUIDs`, `study`, `studyUID` or `accessionNumber`";
            let number = number.clone().ok_or_else(|| unreadable(detail))?;
            queries.push(SeriesQuery::AccessionNumber(number));
        }
        let patient = only(
            &["patientid"],
            "the address has several values of `patientID`",
        )?;
        let (patient_id, authority) = patient.as_deref().map_or((None, None), patient_of);
        let issuer = only(&OF_ISSUER, "the address has several values of `issuer`")?;
        if let (Some(text), Some(_), Some(issuer)) = (&patient, &authority, &issuer)
            && !text
                .split(['^', '&'])
                .any(|part| part.trim() == issuer.trim())
        {
            let detail = "`patientID` and `issuer` name two different issuers";
            return Err(unreadable(detail));
        }
        Ok(Self {
            queries,
            accession_number: number,
            patient_id,
            issuer: issuer.or(authority),
            ignored: ignored(&pairs),
        })
    }

    /// Whether a head is of the patient and the order that the query names.
    fn agrees(&self, head: &Head) -> bool {
        let number = head.series.accession_number.as_ref();
        self.agrees_with(number, head.patient().as_ref())
    }

    fn agrees_with(&self, number: Option<&AccessionNumber>, patient: Option<&Patient>) -> bool {
        let wanted = self.accession_number.as_ref();
        wanted.is_none_or(|wanted| number == Some(wanted)) && self.names(patient)
    }

    /// Whether the query names this patient, or none.
    fn names(&self, patient: Option<&Patient>) -> bool {
        let (id, issuer) = (self.patient_id.as_deref(), self.issuer.as_deref());
        match patient {
            Some(patient) => patient.agrees(id, issuer),
            None => id.is_none() && issuer.is_none(),
        }
    }
}

/// Refuses a known key without a value: it was meant to narrow the search, and whoever filled in the address did not know the value.
fn refuse_empty(pairs: form_urlencoded::Parse<'_>) -> Result<(), AppError> {
    let known = [&OF_STUDY[..], &OF_SERIES, &OF_ISSUER, &FURTHER].concat();
    for (key, value) in pairs {
        let name = key.to_ascii_lowercase();
        if !known.contains(&&*name) {
            continue;
        }
        // The name of a known key identifies nobody, so it is repeated as it was written.
        let detail = if value.trim_matches([' ', ',', '\0']).is_empty() {
            format!("`{key}` has no value; state it, or omit the key")
        } else if name == "patientid" && patient_of(&value).0.is_none() {
            // An issuer without an id names nobody either.
            format!("`{key}` has no id before the first `^`; state the id, or omit the key")
        } else {
            continue;
        };
        return Err(AppError::bad_request("launch-unreadable", detail));
    }
    Ok(())
}

/// The id and the issuer of a patient, who may be given as in HL7: `ID^^^ISSUER` or `ID^^^ISSUER&OID&ISO`.
fn patient_of(text: &str) -> (Option<String>, Option<String>) {
    let mut parts = text.split('^');
    let some = |text: Option<&str>| {
        text.map(str::trim)
            .filter(|text| !text.is_empty())
            .map(str::to_owned)
    };
    let id = some(parts.next());
    let mut authority = parts.nth(2).unwrap_or_default().split('&');
    let namespace = some(authority.next());
    (id, namespace.or_else(|| some(authority.next())))
}

/// The unknown keys, as far as they look like keys.
fn ignored(pairs: &[(String, String)]) -> Vec<String> {
    let known = [&OF_STUDY[..], &OF_SERIES, &OF_ISSUER, &FURTHER].concat();
    let mut unknown: Vec<String> = Vec::new();
    for (key, _) in pairs {
        let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"_-.".contains(&byte);
        let is_key = key.len() <= LONGEST_KEY && key.bytes().all(is_plain);
        let key = if is_key { key.as_str() } else { "…" };
        if !known.contains(&key) && !unknown.iter().any(|other| other == key) {
            unknown.push(key.to_owned());
        }
    }
    unknown.truncate(MOST_IGNORED);
    unknown
}

async fn find(pacs: &Pacs, asked: &Asked) -> Result<LaunchView, AppError> {
    let mut matches = Matches::default();
    for query in &asked.queries {
        let found = pacs.arrivals().matches(query).await?;
        matches.heads.extend(found.heads);
        matches.without_case.extend(found.without_case);
    }
    let mut others = matches.without_case.iter();
    let is_known = !matches.heads.is_empty() || others.any(|other| other.patient.is_some());
    matches.heads.retain(|head| asked.agrees(head));
    let agrees = |other: &SeriesWithoutCase| {
        asked.agrees_with(other.accession_number.as_ref(), other.patient.as_ref())
    };
    matches.without_case.retain(agrees);
    let mut found = match matches.heads.first() {
        Some(_) => opened(&mut matches),
        None if is_known && matches.without_case.is_empty() => LaunchView {
            state: "mismatch",
            ..LaunchView::default()
        },
        None if !matches.without_case.is_empty() => without_case(&matches.without_case),
        None => coming(pacs, &asked.queries).await?,
    };
    let is_shown = pacs.options().shows_patient;
    let heads = matches.heads.iter().map(|head| candidate(head, is_shown));
    found.candidates = heads.collect();
    if found.state == "choice" {
        let others = matches.of_another();
        let others = others.map(|other| candidate_without_case(other, is_shown));
        found.candidates.extend(others);
    }
    found.ignored.clone_from(&asked.ignored);
    Ok(found)
}

/// The first head, unless there are some of another study or patient.
fn opened(matches: &mut Matches) -> LaunchView {
    let is_ambiguous = matches.is_ambiguous();
    let failed = |head: &Head| head.case.state == CaseState::Failed;
    if !is_ambiguous && !matches.heads.iter().all(failed) {
        matches.heads.retain(|head| !failed(head));
    }
    let Some(first) = matches.heads.first() else {
        return LaunchView::default();
    };
    LaunchView {
        state: match first.case.state {
            _ if is_ambiguous => "choice",
            CaseState::Ready => "ready",
            CaseState::Queued | CaseState::Preparing => "preparing",
            CaseState::Failed => "failed",
        },
        case: (!is_ambiguous).then_some(first.case.id),
        reason: first.case.failure.clone().map(Into::into),
        ..LaunchView::default()
    }
}

fn candidate(head: &Head, shows_patient: bool) -> CandidateView {
    let value = |keyword| head.value(keyword).map(str::to_owned);
    let names =
        ["SeriesDescription", "ProtocolName"].map(|name| head.value(name).unwrap_or_default());
    let description = match shows_patient {
        true => names[0].to_owned(),
        false => kind_of_series(&names.join(" ")),
    };
    let parts = [value("SeriesNumber"), value("Modality"), Some(description)];
    let parts = parts.into_iter().flatten().filter(|part| !part.is_empty());
    CandidateView {
        case: Some(head.case.id),
        state: head.case.state.name(),
        reason: None,
        study_date: value("StudyDate"),
        acquired: head.acquired(),
        series: parts.collect::<Vec<_>>().join(" · "),
        is_derived: head.is_derived(),
        has_contrast: head.has_contrast(),
        voxel_mm: head.voxel_mm(),
        patient: patient(head.patient(), shows_patient),
    }
}

fn candidate_without_case(other: &SeriesWithoutCase, shows_patient: bool) -> CandidateView {
    let label = other.label.as_deref().unwrap_or_default();
    CandidateView {
        case: None,
        state: other.word(),
        reason: other.reason.clone().map(Into::into),
        study_date: None,
        acquired: None,
        series: match shows_patient {
            true => label.to_owned(),
            false => kind_of_series(label),
        },
        is_derived: false,
        has_contrast: false,
        voxel_mm: None,
        patient: patient(other.patient.clone(), shows_patient),
    }
}

/// The patient in words, if the page shows patients.
fn patient(patient: Option<Patient>, is_shown: bool) -> Option<String> {
    let words = patient.filter(|_| is_shown)?.words();
    (!words.is_empty()).then_some(words)
}

/// How far series of which there is no case are.
fn without_case(others: &[SeriesWithoutCase]) -> LaunchView {
    let is_received = |other: &SeriesWithoutCase| other.state == ArrivalState::Receiving;
    let (state, reason) = match others.iter().any(is_received) {
        true => ("receiving", None),
        false => (
            "nothing",
            others.last().and_then(|other| other.reason.clone()),
        ),
    };
    LaunchView {
        state,
        reason: reason.map(Into::into),
        ..LaunchView::default()
    }
}

/// What there is of studies of which nothing is known but what was not kept or has moved away.
async fn coming(pacs: &Pacs, queries: &[SeriesQuery]) -> Result<LaunchView, AppError> {
    let mut found = LaunchView {
        state: "absent",
        ..LaunchView::default()
    };
    for query in queries {
        let arrivals = pacs.store().arrivals_of(query).await?;
        if arrivals
            .iter()
            .any(|arrival| arrival.state == ArrivalState::Receiving)
        {
            found.state = "receiving";
            return Ok(found);
        }
        // What was not kept says nothing about the images, and what was refused nothing about the series.
        let newest = arrivals
            .into_iter()
            .filter(|arrival| !arrival.is_all_refused())
            .max_by_key(|arrival| arrival.instances > 0);
        if let Some(arrival) = newest {
            found.state = "nothing";
            found.reason = arrival.reason.map(Into::into);
            return Ok(found);
        }
    }
    if let [SeriesQuery::Study(study, Some(series))] = queries {
        let nodes = pacs
            .options()
            .nodes
            .iter()
            .filter(|node| node.web().is_some());
        found.nodes = nodes.map(|node| node.name().to_owned()).collect();
        found.study = Some(study.as_str().to_owned());
        found.series = Some(series.as_str().to_owned());
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uid(text: &str) -> Uid {
        Uid::parse(text).unwrap()
    }

    #[test]
    fn addresses_of_other_viewers_are_understood() {
        let study = || SeriesQuery::Study(uid("1.2.3"), None);
        let series = || SeriesQuery::Study(uid("1.2.3"), Some(uid("1.2.3.4")));
        for (query, expected) in [
            ("?StudyInstanceUIDs=1.2.3", study()),
            (
                "StudyInstanceUIDs=1.2.3&SeriesInstanceUIDs=1.2.3.4",
                series(),
            ),
            (
                "StudyInstanceUIDs=1.2.3&SeriesInstanceUID=1.2.3.4",
                series(),
            ),
            ("study=1%2e2.3&series=1.2.3.4", series()),
            ("requestType=STUDY&studyUID=1.2.3", study()),
            (
                "requestType=STUDY&accessionNumber=A%207",
                SeriesQuery::AccessionNumber(AccessionNumber::parse("A 7").unwrap()),
            ),
        ] {
            assert_eq!(Asked::parse(query).unwrap().queries, [expected], "{query}");
        }
        let both = ["1.2.3.4", "1.2.3.5"]
            .map(|series| SeriesQuery::Study(uid("1.2.3"), Some(uid(series))));
        let named = Asked::parse("study=1.2.3&series=1.2.3.4,1.2.3.5,1.2.3.4").unwrap();
        assert_eq!(named.queries, both);
    }

    #[test]
    fn keys_are_decoded_and_one_without_a_value_is_refused_by_its_name() {
        let asked = Asked::parse("study=1.2&%70atient%49D=P7").unwrap();
        assert_eq!(
            (asked.patient_id.as_deref(), asked.ignored.len()),
            (Some("P7"), 0)
        );
        for (query, name) in [
            ("study=1.2&patientID=", "patientID"),
            ("study=1.2&PatientId", "PatientId"),
            ("study=1.2&patientID=%20", "patientID"),
            ("study=1.2&issuer=", "issuer"),
            ("study=1.2&accessionNumber=", "accessionNumber"),
            ("study=1.2&series=", "series"),
            ("study=,&accessionNumber=A1", "study"),
            ("requestType=&study=1.2", "requestType"),
            ("study=1.2&%70atientID=", "patientID"),
        ] {
            let refused = Asked::parse(query).unwrap_err().to_string();
            assert!(
                refused.contains(&format!("`{name}` has no value")),
                "{query}: {refused}"
            );
        }
        let refused = Asked::parse("study=1.2&patientID=^^^HOSP").unwrap_err();
        let refused = refused.to_string();
        assert!(refused.contains("`patientID` has no id") && !refused.contains("HOSP"));
        // What is not known has no effect, with or without a value.
        assert_eq!(
            Asked::parse("study=1.2&viewer=&flag").unwrap().ignored,
            ["viewer", "flag"]
        );
    }

    #[test]
    fn every_study_of_an_address_is_looked_up() {
        let expected = ["1.2.3", "1.2.9"].map(|study| SeriesQuery::Study(uid(study), None));
        for query in [
            "StudyInstanceUIDs=1.2.3,1.2.9&x=y",
            "StudyInstanceUIDs=1.2.3&StudyInstanceUIDs=1.2.9",
        ] {
            assert_eq!(Asked::parse(query).unwrap().queries, expected, "{query}");
        }
        let many = vec!["1.2"; MOST_STUDIES + 1].join(",");
        assert!(Asked::parse(&format!("StudyInstanceUIDs={many}")).is_err());
    }

    #[test]
    fn patient_and_issuer_are_read_as_they_are_or_as_in_hl7() {
        for (query, id, issuer) in [
            ("study=1.2", None, None),
            ("study=1.2&patientID=P%207", Some("P 7"), None),
            (
                "study=1.2&patientID=P7&issuer=HOSP",
                Some("P7"),
                Some("HOSP"),
            ),
            ("study=1.2&patientID=P7^^^HOSP", Some("P7"), Some("HOSP")),
            (
                "study=1.2&patientID=P7%5e%5e%5e%261.2.3%26ISO",
                Some("P7"),
                Some("1.2.3"),
            ),
            (
                "study=1.2&patientID=P7^^^A%261.2%26ISO&IssuerOfPatientID=1.2",
                Some("P7"),
                Some("1.2"),
            ),
        ] {
            let asked = Asked::parse(query).unwrap();
            let read = [asked.patient_id, asked.issuer];
            assert_eq!(
                read,
                [id, issuer].map(|text| text.map(str::to_owned)),
                "{query}"
            );
        }
        let two = "study=1.2&patientID=P7^^^A%261.2%26ISO&IssuerOfPatientID=B";
        let refused = Asked::parse(two).unwrap_err().to_string();
        assert!(refused.contains("two different issuers"), "{refused}");
    }

    #[test]
    fn unknown_keys_are_reported_and_what_is_no_key_is_not_repeated() {
        let asked =
            Asked::parse("StudyUID=1.2&requestType=study&x=1&X=2&patient name=3&viewerType=a");
        assert_eq!(asked.unwrap().ignored, ["x", "…", "viewertype"]);
    }

    #[test]
    fn what_names_no_study_is_refused_without_repeating_it() {
        for query in [
            "",
            "patientID=Smith",
            "requestType=PATIENT&patientID=Smith&studyUID=1.2",
            "study=Smith",
            "study=1.2&series=Smith",
            "study=%",
            "accessionNumber=%00",
            "study=1.2&patientID=Smith&patientID=Smyth",
            "study=1..2",
        ] {
            let error = Asked::parse(query).unwrap_err().to_string();
            assert!(!error.contains("Smith"), "{error}");
        }
    }
}
