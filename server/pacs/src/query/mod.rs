//! QIDO-RS (PS3.18 §10.6): the studies, series and instances that are here.

mod keys;
mod matching;

use axum::extract::rejection::QueryRejection;
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use case::ObjectKind;
use imaging::dicom::{attribute, element};
use serde_json::{Map, Value};
use storage::ObjectName;
use storage::arrivals::{AccessionNumber, SeriesQuery, Uid};
use utoipa::IntoParams;
use utoipa::openapi::path::{Parameter, ParameterIn};
use utoipa::openapi::schema::Type;

use self::keys::{CONTROLS, PageSize, SearchKeys};
use crate::address::{Named, SeriesPath, StudyPath};
use crate::described::query_key;
use crate::held::{HeldStudy, Values};
use crate::state::Pacs;
use crate::stow::{DICOM_JSON, refuse_other_answers};
use http_support::fresh::fresh_json;
use http_support::problem::AppError;

/// The most studies that a search looks at.
const MAX_STUDIES: usize = 2000;

/// The most results on a page of a search in all studies.
const MOST_EVERYWHERE: usize = 1000;

/// Studies that are listed at a time.
const BATCH: usize = 50;

/// What is returned of a study, a series and an instance (PS3.18 tables 10.6.3-3 to 10.6.3-5), as far as it is known.
const USUAL: [&[&str]; 3] = [
    &[
        "SpecificCharacterSet",
        "StudyDate",
        "StudyTime",
        "AccessionNumber",
        "InstanceAvailability",
        "ModalitiesInStudy",
        "ReferringPhysicianName",
        "RetrieveURL",
        "PatientName",
        "PatientID",
        "PatientBirthDate",
        "PatientSex",
        "StudyInstanceUID",
        "StudyID",
        "NumberOfStudyRelatedSeries",
        "NumberOfStudyRelatedInstances",
    ],
    &[
        "SpecificCharacterSet",
        "Modality",
        "InstanceAvailability",
        "SeriesDescription",
        "RetrieveURL",
        "StudyInstanceUID",
        "SeriesInstanceUID",
        "SeriesNumber",
        "NumberOfSeriesRelatedInstances",
    ],
    &[
        "SpecificCharacterSet",
        "SOPClassUID",
        "SOPInstanceUID",
        "InstanceAvailability",
        "RetrieveURL",
        "StudyInstanceUID",
        "SeriesInstanceUID",
        "InstanceNumber",
        "Rows",
        "Columns",
    ],
];

/// Attributes of a series that are not held, but are in each of its images: a search within a study reads them from one that is kept.
const OF_IMAGES: [&str; 3] = [
    "PerformedProcedureStepStartDate",
    "PerformedProcedureStepStartTime",
    "RequestAttributesSequence",
];

/// Attributes by which a search may select although a source lacks them. Other keys that nothing here has are ignored.
const SUPPORTED: [&str; 17] = [
    "StudyDate",
    "StudyTime",
    "AccessionNumber",
    "ModalitiesInStudy",
    "ReferringPhysicianName",
    "PatientName",
    "PatientID",
    "IssuerOfPatientID",
    "PatientBirthDate",
    "PatientSex",
    "StudyDescription",
    "StudyInstanceUID",
    "StudyID",
    "Modality",
    "SeriesInstanceUID",
    "SeriesNumber",
    "SeriesDescription",
];

/// As [`SUPPORTED`], of instances.
const SUPPORTED_OF_INSTANCES: [&str; 3] = ["SOPClassUID", "SOPInstanceUID", "InstanceNumber"];

/// What a search lists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Level {
    Study,
    Series,
    Instance,
}

/// The keys of a search, for its description. Any other attribute is accepted as well, by keyword or tag.
pub(crate) struct SearchParams;

impl IntoParams for SearchParams {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Parameter> {
        let controls = CONTROLS.map(|(name, kind, words)| query_key(name, kind, words));
        let matched = SUPPORTED.iter().chain(&SUPPORTED_OF_INSTANCES);
        let matched = matched.map(|&keyword| query_key(keyword, Type::String, MATCHED));
        controls.into_iter().chain(matched).collect()
    }
}

/// How an attribute is matched.
const MATCHED: &str =
    "Results that match: text with `*` and `?`, UIDs with commas, dates and times with ranges";

type Pairs = Result<Query<Vec<(String, String)>>, QueryRejection>;

/// Search for studies
///
/// The studies that cases were made of, newest case first (QIDO-RS, PS3.18 §10.6). Keys: attributes by keyword or tag, with
/// wildcards, lists of UIDs and ranges of dates; keys inside of sequences and private ones match everything. Without `limit`, a search for
/// studies or series has at most 100 results, one for instances 1000, and one within a study all of them.
#[utoipa::path(
    get, path = "/dicomweb/studies", tag = "pacs", operation_id = "search_studies",
    params(SearchParams),
    responses(
        (status = 200, description = "The studies", body = serde_json::Value, content_type = "application/dicom+json"),
        (status = 204, description = "None matches"),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
        (status = 406, description = "Only `application/dicom+json` is available"),
        (status = 413, description = "The search is too broad"),
    )
)]
pub(crate) async fn studies(
    State(pacs): State<Pacs>,
    keys: Pairs,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    let scope = Scope::everywhere(Level::Study);
    search(&pacs, scope, keys, &headers).await
}

/// Search for series
///
/// As `GET /dicomweb/studies`, in all studies.
#[utoipa::path(
    get, path = "/dicomweb/series", tag = "pacs", operation_id = "search_series",
    params(SearchParams),
    responses(
        (status = 200, description = "The series", body = serde_json::Value, content_type = "application/dicom+json"),
        (status = 204, description = "None matches"),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
        (status = 406, description = "Only `application/dicom+json` is available"),
        (status = 413, description = "The search is too broad"),
    )
)]
pub(crate) async fn all_series(
    State(pacs): State<Pacs>,
    keys: Pairs,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    let scope = Scope::everywhere(Level::Series);
    search(&pacs, scope, keys, &headers).await
}

/// Search for instances
///
/// As `GET /dicomweb/studies`, in all studies.
#[utoipa::path(
    get, path = "/dicomweb/instances", tag = "pacs", operation_id = "search_instances",
    params(SearchParams),
    responses(
        (status = 200, description = "The instances", body = serde_json::Value, content_type = "application/dicom+json"),
        (status = 204, description = "None matches"),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
        (status = 406, description = "Only `application/dicom+json` is available"),
        (status = 413, description = "The search is too broad"),
    )
)]
pub(crate) async fn all_instances(
    State(pacs): State<Pacs>,
    keys: Pairs,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    let scope = Scope::everywhere(Level::Instance);
    search(&pacs, scope, keys, &headers).await
}

/// Search for the series of a study
///
/// As `GET /dicomweb/studies`: the series that cases were made of, then the results that were sent.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/series", tag = "pacs", operation_id = "search_series_of_study",
    params(StudyPath, SearchParams),
    responses(
        (status = 200, description = "The series", body = serde_json::Value, content_type = "application/dicom+json"),
        (status = 204, description = "None matches"),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
        (status = 406, description = "Only `application/dicom+json` is available"),
        (status = 413, description = "The search is too broad"),
    )
)]
pub(crate) async fn series_of_study(
    State(pacs): State<Pacs>,
    Path(path): Path<StudyPath>,
    keys: Pairs,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    let scope = Scope::within(path.into(), Level::Series);
    search(&pacs, scope, keys, &headers).await
}

/// Search for the instances of a study
///
/// As `GET /dicomweb/studies`.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/instances", tag = "pacs", operation_id = "search_instances_of_study",
    params(StudyPath, SearchParams),
    responses(
        (status = 200, description = "The instances", body = serde_json::Value, content_type = "application/dicom+json"),
        (status = 204, description = "None matches"),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
        (status = 406, description = "Only `application/dicom+json` is available"),
        (status = 413, description = "The search is too broad"),
    )
)]
pub(crate) async fn instances_of_study(
    State(pacs): State<Pacs>,
    Path(path): Path<StudyPath>,
    keys: Pairs,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    let scope = Scope::within(path.into(), Level::Instance);
    search(&pacs, scope, keys, &headers).await
}

/// Search for the instances of a series
///
/// As `GET /dicomweb/studies`.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/series/{series}/instances", tag = "pacs", operation_id = "search_instances_of_series",
    params(SeriesPath, SearchParams),
    responses(
        (status = 200, description = "The instances", body = serde_json::Value, content_type = "application/dicom+json"),
        (status = 204, description = "None matches"),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
        (status = 406, description = "Only `application/dicom+json` is available"),
        (status = 413, description = "The search is too broad"),
    )
)]
pub(crate) async fn instances_of_series(
    State(pacs): State<Pacs>,
    Path(path): Path<SeriesPath>,
    keys: Pairs,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    let scope = Scope::within(path.into(), Level::Instance);
    search(&pacs, scope, keys, &headers).await
}

/// Where a search looks.
struct Scope {
    level: Level,
    study: Option<String>,
    series: Option<String>,
}

impl Scope {
    fn everywhere(level: Level) -> Self {
        Self {
            level,
            study: None,
            series: None,
        }
    }

    fn within(named: Named, level: Level) -> Self {
        Self {
            level,
            study: Some(named.study),
            series: named.series,
        }
    }

    /// How many results are on a page. What a study has is bounded, and half a series would be taken for all of it.
    fn page_size(&self) -> PageSize {
        let usual = match self.level {
            _ if self.study.is_some() => usize::MAX,
            Level::Study | Level::Series => 100,
            Level::Instance => MOST_EVERYWHERE,
        };
        PageSize {
            usual,
            most: usual.max(MOST_EVERYWHERE),
        }
    }

    /// Tags that are returned without being requested: those of the level, and of each level above that the address
    /// does not name.
    fn usual(&self) -> Vec<String> {
        let are_returned = [
            self.level == Level::Study || self.study.is_none(),
            self.level == Level::Series || self.level == Level::Instance && self.series.is_none(),
            self.level == Level::Instance,
        ];
        let levels = USUAL.iter().zip(are_returned);
        let keywords = levels
            .filter(|(_, is)| *is)
            .flat_map(|(level, _)| level.iter());
        keywords.filter_map(|keyword| tag(keyword)).collect()
    }

    fn supports(&self, wanted: &str) -> bool {
        let of_instances = SUPPORTED_OF_INSTANCES.iter();
        let of_instances = of_instances.filter(|_| self.level == Level::Instance);
        let mut supported = SUPPORTED.iter().chain(of_instances);
        let is_of_level = supported.any(|keyword| tag(keyword).as_deref() == Some(wanted));
        // A study has no series number.
        let is_of_series = |keyword: &str| tag(keyword).as_deref() == Some(wanted);
        let of_series = [
            "Modality",
            "SeriesInstanceUID",
            "SeriesNumber",
            "SeriesDescription",
        ];
        is_of_level && (self.level != Level::Study || !of_series.into_iter().any(is_of_series))
    }

    /// Adds the values of what is listed of a study, and of all above it.
    fn list(&self, study: &HeldStudy, records: &mut Vec<Record>) {
        if self.level == Level::Study {
            records.push(study.values.clone().into());
            return;
        }
        for series in &study.series {
            if self
                .series
                .as_deref()
                .is_some_and(|uid| uid != series.uid.as_str())
            {
                continue;
            }
            let mut of_series = study.values.clone();
            of_series.extend(&series.values);
            if self.level == Level::Series {
                let mut objects = series.instances.iter().filter_map(|each| each.object);
                records.push(Record {
                    values: of_series,
                    image: objects.find(|object| object.kind == ObjectKind::Instance),
                });
                continue;
            }
            for instance in &series.instances {
                let mut values = of_series.clone();
                values.extend(&instance.values);
                records.push(values.into());
            }
        }
    }
}

fn tag(keyword: &str) -> Option<String> {
    attribute(keyword).map(|known| known.name())
}

async fn search(
    pacs: &Pacs,
    scope: Scope,
    pairs: Pairs,
    headers: &HeaderMap,
) -> Result<Response, AppError> {
    let Query(pairs) = pairs.map_err(|_| {
        AppError::bad_request(
            "query-unreadable",
            "the query of the address cannot be read",
        )
    })?;
    let keys = SearchKeys::read(&pairs, scope.page_size())?;
    match &keys.accept {
        None => refuse_other_answers(headers)?,
        Some(accept) => {
            let accept = HeaderValue::from_str(accept).ok();
            let accept = accept.map(|accept| (header::ACCEPT, accept));
            refuse_other_answers(&accept.into_iter().collect())?;
        }
    }
    let found = find(pacs, &scope, &keys).await?;
    if found.records.is_empty() {
        let mut response = StatusCode::NO_CONTENT.into_response();
        warn(&mut response, &scope, &keys, false);
        return Ok(response);
    }
    let usual = scope.usual();
    let selected = |tag: &str| {
        keys.is_all_included
            || keys.included.contains(tag)
            || usual.iter().any(|known| known == tag)
    };
    let mut images = read_images(pacs, &scope, &found.records).await.into_iter();
    let mut body: Vec<Value> = Vec::with_capacity(found.records.len());
    for record in &found.records {
        let values = record.values.iter().filter(|(tag, ..)| selected(tag));
        let values = values.map(|(tag, vr, text)| (tag.to_owned(), element(vr, text)));
        let mut item: Map<_, _> = values.collect();
        let mut image = record.image.and_then(|_| images.next()).unwrap_or_default();
        for tag in OF_IMAGES.into_iter().filter_map(tag) {
            item.extend(image.get_mut(&tag).map(|value| (tag, value.take())));
        }
        body.push(item.into());
    }
    let mut response = fresh_json(StatusCode::OK, &body);
    let kind = HeaderValue::from_static(DICOM_JSON);
    response.headers_mut().insert(header::CONTENT_TYPE, kind);
    warn(&mut response, &scope, &keys, found.are_more);
    Ok(response)
}

/// States what a client may not expect (PS3.18 §8.3.4.4).
fn warn(response: &mut Response, scope: &Scope, keys: &SearchKeys, are_more: bool) {
    let is_ignored = |tag: &str| !scope.supports(tag);
    let warnings = [
        (
            keys.is_fuzzy,
            "299 isocortex \"fuzzy matching is not supported; only literal matching was performed\"",
        ),
        (
            keys.has_foreign
                || keys
                    .wanted
                    .iter()
                    .any(|(known, _)| is_ignored(&known.name())),
            "299 isocortex \"a key is not supported for matching and was ignored\"",
        ),
        (
            are_more,
            "299 isocortex \"there are additional results that can be requested\"",
        ),
    ];
    for (_, warning) in warnings.into_iter().filter(|(is, _)| *is) {
        let warning = HeaderValue::from_static(warning);
        response.headers_mut().append(header::WARNING, warning);
    }
}

/// What is listed.
struct Record {
    values: Values,
    /// An image of it, if it is a series whose images may be retrieved.
    image: Option<ObjectName>,
}

impl From<Values> for Record {
    fn from(values: Values) -> Self {
        let image = None;
        Self { values, image }
    }
}

/// The attributes of the image of each series of a study; none if they cannot be read now, because the rest is known all the same.
async fn read_images(pacs: &Pacs, scope: &Scope, records: &[Record]) -> Vec<Value> {
    let images: Vec<_> = records.iter().filter_map(|record| record.image).collect();
    if scope.study.is_none() || images.is_empty() {
        return Vec::new();
    }
    let read = pacs.cases().stored_metadata(&images).await;
    read.ok().flatten().unwrap_or_default()
}

/// A page of results.
struct Found {
    records: Vec<Record>,
    are_more: bool,
}

async fn find(pacs: &Pacs, scope: &Scope, keys: &SearchKeys) -> Result<Found, AppError> {
    let mut found = Found {
        records: Vec::new(),
        are_more: false,
    };
    let mut skip = keys.offset;
    let mut studies = Studies::begin(pacs, scope, keys).await?;
    while let Some(uid) = studies.next(pacs).await? {
        let mut records = Vec::new();
        for study in HeldStudy::load(pacs, &uid).await? {
            scope.list(&study, &mut records);
        }
        for record in records {
            if !keys.accept(&record.values, |tag| scope.supports(tag)) {
                continue;
            }
            if skip > 0 {
                skip -= 1;
            } else if found.records.len() == keys.limit {
                found.are_more = true;
                return Ok(found);
            } else {
                found.records.push(record);
            }
        }
    }
    Ok(found)
}

/// The studies that a search looks at, one after the other.
struct Studies {
    waiting: std::collections::VecDeque<Uid>,
    /// Where to go on; `None` if all are named by the search.
    offset: Option<usize>,
    seen: usize,
}

impl Studies {
    async fn begin(pacs: &Pacs, scope: &Scope, keys: &SearchKeys) -> Result<Self, AppError> {
        let named = match (&scope.study, keys.value("StudyInstanceUID")) {
            (Some(study), _) => Some(study.as_str()),
            (None, named) => named,
        };
        let number = keys.value("AccessionNumber");
        let number = number.filter(|number| !number.contains(['*', '?', '\\']));
        let waiting = match (named, number.and_then(AccessionNumber::parse)) {
            (Some(named), _) => {
                let mut uids: Vec<_> = named.split([',', '\\']).filter_map(Uid::parse).collect();
                uids.sort();
                uids.dedup();
                uids
            }
            (None, Some(number)) => {
                let query = SeriesQuery::AccessionNumber(number);
                let cases = pacs.cases().store().cases_of(&query).await?;
                let mut uids: Vec<_> = cases.into_iter().map(|case| case.uids.study).collect();
                let mut seen = std::collections::HashSet::new();
                uids.retain(|uid| seen.insert(uid.clone()));
                uids
            }
            (None, None) => {
                return Ok(Self {
                    waiting: Default::default(),
                    offset: Some(0),
                    seen: 0,
                });
            }
        };
        Ok(Self {
            waiting: waiting.into(),
            offset: None,
            seen: 0,
        })
    }

    async fn next(&mut self, pacs: &Pacs) -> Result<Option<Uid>, AppError> {
        if self.waiting.is_empty()
            && let Some(offset) = self.offset
        {
            let store = pacs.cases().store();
            self.waiting = store.studies(offset, BATCH).await?.into();
            self.offset = (self.waiting.len() == BATCH).then_some(offset + BATCH);
        }
        let next = self.waiting.pop_front();
        self.seen += usize::from(next.is_some());
        if self.seen > MAX_STUDIES {
            return Err(AppError::new(
                StatusCode::PAYLOAD_TOO_LARGE,
                "search-too-broad",
                format!(
                    "the search looks at more than {MAX_STUDIES} studies; name the study or its accession number, or lower `offset`"
                ),
            ));
        }
        Ok(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_study_has_is_listed_whole_unless_a_page_is_requested() {
        let named = |series: Option<&str>| Named {
            study: "1.2".to_owned(),
            series: series.map(str::to_owned),
            instance: None,
        };
        for named in [named(None), named(Some("1.2.3"))] {
            let size = Scope::within(named, Level::Instance).page_size();
            assert_eq!((size.usual, size.most), (usize::MAX, usize::MAX));
        }
        for (level, usual) in [(Level::Study, 100), (Level::Instance, 1000)] {
            let size = Scope::everywhere(level).page_size();
            assert_eq!((size.usual, size.most), (usual, 1000));
        }
    }
}
