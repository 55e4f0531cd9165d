//! Opens the case of a study that a viewer of the PACS names: OHIF (`StudyInstanceUIDs`), Stone (`study`, `series`) and
//! IID-style (`requestType=STUDY`, `studyUID` or `accessionNumber`).
//!
//! The page removes the identifiers from the address and the history of the browser before it does anything else, and
//! sends them in the body of a request, with the token in a header.

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::Response;
use case::{CaseId, CaseState};
use serde::{Deserialize, Serialize};
use storage::arrivals::{AccessionNumber, ArrivalState, SeriesQuery, Uid};
use utoipa::ToSchema;

use crate::error::{PacsError, ReasonView};
use crate::retrievals::read_json;
use crate::state::{Pacs, fresh_json};

/// The page, which holds no data.
pub(crate) async fn page() -> Response {
    document(
        include_str!("launch/launch.html"),
        "text/html; charset=utf-8",
    )
}

pub(crate) async fn script() -> Response {
    let kind = "text/javascript; charset=utf-8";
    document(include_str!("launch/launch.js"), kind)
}

pub(crate) async fn style() -> Response {
    document(include_str!("launch/launch.css"), "text/css; charset=utf-8")
}

/// A document of this program.
pub(crate) fn document(text: &'static str, kind: &'static str) -> Response {
    let mut response = Response::new(Body::from(text));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    response
}

/// The query of a launch address.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct LaunchRequest {
    /// The query, such as `StudyInstanceUIDs=…`, `study=…&series=…` or `requestType=STUDY&studyUID=…`.
    query: String,
}

/// What there is of a study.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct LaunchView {
    /// `ready`, `preparing`, `receiving`, `failed`, `nothing` or `absent`.
    state: &'static str,
    /// The case, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    case: Option<CaseId>,
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

/// Find the case of a study
///
/// The newest ready case of the study, or of the series if one is named; otherwise how far it is. Of several studies
/// the first that is ready, or else the first that is known.
#[utoipa::path(
    post, path = "/v1/launch", tag = "pacs",
    request_body = LaunchRequest,
    responses(
        (status = 200, description = "What there is of the study", body = LaunchView),
        (status = 400, description = "The query names no study"),
    )
)]
pub(crate) async fn find_launched(State(pacs): State<Pacs>, request: Request) -> Response {
    let found = async {
        let asked: LaunchRequest = read_json(request, "`query`").await?;
        let view = find_any(&pacs, &parse(&asked.query)?).await?;
        Ok::<_, PacsError>(fresh_json(StatusCode::OK, &view))
    };
    let found = found.await;
    pacs.answer(found)
}

fn unreadable(detail: &'static str) -> PacsError {
    PacsError::bad_request("launch-unreadable", detail)
}

/// The greatest number of studies that a query may name.
const MOST_STUDIES: usize = 16;

/// What a query names: one study, or several with a value or a key for each. Values are not repeated, because they
/// identify a patient.
fn parse(query: &str) -> Result<Vec<SeriesQuery>, PacsError> {
    let pairs: Vec<(String, String)> = query
        .trim_start_matches('?')
        .split('&')
        .filter_map(|pair| pair.split_once('='))
        .map(|(key, value)| (key.to_ascii_lowercase(), decoded(value)))
        .collect();
    let all = |keys: &[&str]| -> Vec<String> {
        let found = pairs.iter().filter(|(key, _)| keys.contains(&key.as_str()));
        let values = found.flat_map(|(_, value)| value.split(','));
        let values = values.filter(|value| !value.is_empty());
        values.map(str::to_owned).collect()
    };
    let named = |keys: &[&str]| all(keys).into_iter().next();
    if named(&["requesttype"]).is_some_and(|kind| !kind.eq_ignore_ascii_case("study")) {
        return Err(unreadable("`requestType` must be STUDY"));
    }
    let uid = |text: String| {
        let uid = Uid::parse(&text);
        uid.ok_or_else(|| unreadable("a UID must be digits and points, at most 64"))
    };
    let series = named(&[
        "seriesinstanceuids",
        "seriesinstanceuid",
        "series",
        "seriesuid",
    ]);
    let series = series.map(uid).transpose()?;
    let studies = all(&["studyinstanceuids", "studyinstanceuid", "study", "studyuid"]);
    if studies.len() > MOST_STUDIES {
        return Err(unreadable("the address names more than 16 studies"));
    }
    if !studies.is_empty() {
        let of_study = |text| Ok(SeriesQuery::Study(uid(text)?, series.clone()));
        return studies.into_iter().map(of_study).collect();
    }
    let number = named(&["accessionnumber"]);
    match number.as_deref().and_then(AccessionNumber::parse) {
        Some(number) => Ok(vec![SeriesQuery::AccessionNumber(number)]),
        None => Err(unreadable(
            "the address names no study; use `StudyInstanceUIDs`, `study`, `studyUID` or `accessionNumber`",
        )),
    }
}

/// A value of a query without its percent signs.
fn decoded(value: &str) -> String {
    let mut bytes = Vec::with_capacity(value.len());
    let mut rest = value.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let hex = after.get(..2).filter(|_| byte == b'%');
        let hex = hex.and_then(|digits| std::str::from_utf8(digits).ok());
        let number = hex.and_then(|digits| u8::from_str_radix(digits, 16).ok());
        (bytes, rest) = match number {
            Some(number) => ([bytes, vec![number]].concat(), &after[2..]),
            None => {
                bytes.push(if byte == b'+' { b' ' } else { byte });
                (bytes, after)
            }
        };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// What there is of the first study that is ready, or else of the first that is known at all.
async fn find_any(pacs: &Pacs, queries: &[SeriesQuery]) -> Result<LaunchView, PacsError> {
    let mut best: Option<LaunchView> = None;
    for query in queries {
        let found = find(pacs, query).await?;
        if found.state == "ready" {
            return Ok(found);
        }
        if best.as_ref().is_none_or(|best| best.state == "absent") {
            best = Some(found);
        }
    }
    best.ok_or_else(|| unreadable("the address names no study"))
}

async fn find(pacs: &Pacs, query: &SeriesQuery) -> Result<LaunchView, PacsError> {
    let store = pacs.cases().store();
    let mut found = LaunchView {
        state: "absent",
        case: None,
        reason: None,
        nodes: Vec::new(),
        study: None,
        series: None,
    };
    for series in store.cases_of(query).await? {
        let Some(case) = store.case(&series.case).await? else {
            continue;
        };
        let state = match case.state {
            CaseState::Ready => "ready",
            CaseState::Queued | CaseState::Preparing => "preparing",
            CaseState::Failed => "failed",
        };
        // The newest one that is ready, or else the newest one.
        if found.case.is_none() || state == "ready" {
            found.state = state;
            found.case = Some(case.id);
            found.reason = case.failure.map(Into::into);
        }
        if state == "ready" {
            return Ok(found);
        }
    }
    if found.case.is_some() {
        return Ok(found);
    }
    let arrivals = store.arrivals_of(query).await?;
    let is_coming = |state| arrivals.iter().any(|arrival| arrival.state == state);
    if is_coming(ArrivalState::Receiving) {
        found.state = "receiving";
        return Ok(found);
    }
    if let Some(arrival) = arrivals.into_iter().next_back() {
        found.state = "nothing";
        found.reason = arrival.reason.map(Into::into);
        return Ok(found);
    }
    if let SeriesQuery::Study(study, Some(series)) = query {
        found.nodes = pacs
            .nodes()
            .iter()
            .filter(|node| node.web().is_some())
            .map(|node| node.name().to_owned())
            .collect();
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
            assert_eq!(parse(query).unwrap(), [expected], "{query}");
        }
    }

    #[test]
    fn every_study_of_an_address_is_looked_up() {
        let expected = ["1.2.3", "1.2.9"].map(|study| SeriesQuery::Study(uid(study), None));
        for query in [
            "StudyInstanceUIDs=1.2.3,1.2.9&x=y",
            "StudyInstanceUIDs=1.2.3&StudyInstanceUIDs=1.2.9",
        ] {
            assert_eq!(parse(query).unwrap(), expected, "{query}");
        }
        let many = vec!["1.2"; MOST_STUDIES + 1].join(",");
        assert!(parse(&format!("StudyInstanceUIDs={many}")).is_err());
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
        ] {
            let error = parse(query).unwrap_err().to_string();
            assert!(!error.contains("Smith"), "{error}");
        }
    }
}
