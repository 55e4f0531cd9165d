//! WADO-RS (PS3.18 §10.4): the instances that are here, their attributes and their frames.

mod media;

use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::Response;
use cases::dicom::StoredFiles;
use futures_util::stream;
use imaging::dicom::element;
use serde_json::{Map, Value};

use self::media::{Accepted, DICOM, FRAME};
use crate::address::{FramesPath, InstancePath, Named, SeriesPath, StudyPath};
use crate::held::{HeldInstance, HeldSeries, HeldStudy, Values, files_of, not_kept};
use crate::state::Pacs;
use crate::stow::{DICOM_JSON, refuse_other_answers};
use http_support::fresh::fresh_json;
use http_support::problem::AppError;

/// The most frames of a request.
const MAX_FRAMES: usize = 64;

/// Retrieve a study
///
/// The instances of a study that are kept, as parts: results that were sent, and with `[pacs] keep_source` the images that its cases
/// were made of (WADO-RS, PS3.18 §10.4).
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}", tag = "pacs", operation_id = "retrieve_study",
    params(StudyPath),
    responses(
        (status = 200, description = "The files", body = Vec<u8>, content_type = "multipart/related; type=\"application/dicom\""),
        (status = 404, description = "It is not here, or its images are not kept"),
        (status = 406, description = "No accepted media type is available"),
        (status = 503, description = "Too much work is waiting"),
    )
)]
pub(crate) async fn study(
    State(pacs): State<Pacs>,
    Path(path): Path<StudyPath>,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    files(&pacs, path.into(), &headers).await
}

/// Retrieve a series
///
/// As `GET /dicomweb/studies/{study}`.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/series/{series}", tag = "pacs", operation_id = "retrieve_series",
    params(SeriesPath),
    responses(
        (status = 200, description = "The files", body = Vec<u8>, content_type = "multipart/related; type=\"application/dicom\""),
        (status = 404, description = "It is not here, or its images are not kept"),
    )
)]
pub(crate) async fn series(
    State(pacs): State<Pacs>,
    Path(path): Path<SeriesPath>,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    files(&pacs, path.into(), &headers).await
}

/// Retrieve an instance
///
/// As `GET /dicomweb/studies/{study}`; with `Accept: application/dicom` the file itself.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/series/{series}/instances/{instance}", tag = "pacs", operation_id = "retrieve_instance",
    params(InstancePath),
    responses(
        (status = 200, description = "The file", content(
            (Vec<u8> = "multipart/related; type=\"application/dicom\""), (Vec<u8> = "application/dicom"),
        )),
        (status = 404, description = "It is not here, or its images are not kept"),
    )
)]
pub(crate) async fn instance(
    State(pacs): State<Pacs>,
    Path(path): Path<InstancePath>,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    files(&pacs, path.into(), &headers).await
}

/// Retrieve the attributes of a study
///
/// The attributes of every instance as DICOM JSON, without private ones and binary values. Of images that are not kept: what is known of
/// them.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/metadata", tag = "pacs", operation_id = "retrieve_study_metadata",
    params(StudyPath),
    responses(
        (status = 200, description = "The attributes", body = serde_json::Value, content_type = "application/dicom+json"),
        (status = 404, description = "It is not here"),
        (status = 406, description = "Only `application/dicom+json` is available"),
    )
)]
pub(crate) async fn study_metadata(
    State(pacs): State<Pacs>,
    Path(path): Path<StudyPath>,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    metadata(&pacs, path.into(), &headers).await
}

/// Retrieve the attributes of a series
///
/// As `GET /dicomweb/studies/{study}/metadata`.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/series/{series}/metadata", tag = "pacs", operation_id = "retrieve_series_metadata",
    params(SeriesPath),
    responses(
        (status = 200, description = "The attributes", body = serde_json::Value, content_type = "application/dicom+json"),
        (status = 404, description = "It is not here"),
    )
)]
pub(crate) async fn series_metadata(
    State(pacs): State<Pacs>,
    Path(path): Path<SeriesPath>,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    metadata(&pacs, path.into(), &headers).await
}

/// Retrieve the attributes of an instance
///
/// As `GET /dicomweb/studies/{study}/metadata`.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/series/{series}/instances/{instance}/metadata", tag = "pacs", operation_id = "retrieve_instance_metadata",
    params(InstancePath),
    responses(
        (status = 200, description = "The attributes", body = serde_json::Value, content_type = "application/dicom+json"),
        (status = 404, description = "It is not here"),
    )
)]
pub(crate) async fn instance_metadata(
    State(pacs): State<Pacs>,
    Path(path): Path<InstancePath>,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    metadata(&pacs, path.into(), &headers).await
}

/// Retrieve frames
///
/// Uncompressed samples in little endian, as parts; one frame also as itself.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/series/{series}/instances/{instance}/frames/{frames}", tag = "pacs", operation_id = "retrieve_frames",
    params(FramesPath),
    responses(
        (status = 200, description = "The frames", content(
            (Vec<u8> = "multipart/related; type=\"application/octet-stream\""), (Vec<u8> = "application/octet-stream"),
        )),
        (status = 400, description = "`frames` is no list of numbers"),
        (status = 404, description = "It is not here, is not kept, or has no such frame"),
        (status = 406, description = "No accepted media type is available"),
    )
)]
pub(crate) async fn frames(
    State(pacs): State<Pacs>,
    Path(path): Path<FramesPath>,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    let (named, numbers) = path.parts();
    pixels(&pacs, named, &numbers, &headers).await
}

async fn files(pacs: &Pacs, named: Named, headers: &HeaderMap) -> Result<Response, AppError> {
    let accepted = Accepted::read(headers, DICOM, named.instance.is_some())?;
    let objects = files_of(&HeldStudy::named(pacs, &named).await?)?;
    let syntaxes = accepted.syntaxes;
    let files = pacs.cases().stored_files(&objects, syntaxes).await?;
    let files = files.ok_or_else(not_kept)?;
    if !accepted.is_multipart && files.count() == 1 {
        let (_, bytes) = files.file(0).await?;
        return Ok(response(DICOM, bytes.into()));
    }
    let boundary = boundary();
    let kind = format!("multipart/related; type=\"{DICOM}\"; boundary={boundary}");
    Ok(response(&kind, streamed(files, boundary)))
}

/// A boundary that is in no file but by a chance of 2⁻⁷⁴.
fn boundary() -> String {
    format!("isocortex-{}", uuid::Uuid::now_v7().simple())
}

fn part_head(boundary: &str, kind: &str) -> Bytes {
    format!("--{boundary}\r\nContent-Type: {kind}\r\n\r\n").into()
}

/// The files one after the other, with one of them in memory.
fn streamed(files: StoredFiles, boundary: String) -> Body {
    let parts = stream::unfold(
        (files, 0, boundary),
        |(files, number, boundary)| async move {
            if number > files.count() {
                return None;
            }
            let part = match number == files.count() {
                true => Ok(format!("--{boundary}--\r\n").into()),
                false => files.file(number).await.map(|(syntax, bytes)| {
                    let kind = format!("{DICOM}; transfer-syntax={syntax}");
                    let head = part_head(&boundary, &kind);
                    Bytes::from([&head[..], &bytes[..], b"\r\n"].concat())
                }),
            };
            Some((part, (files, number + 1, boundary)))
        },
    );
    Body::from_stream(parts)
}

async fn metadata(pacs: &Pacs, named: Named, headers: &HeaderMap) -> Result<Response, AppError> {
    refuse_other_answers(headers)?;
    let studies = HeldStudy::named(pacs, &named).await?;
    let series = studies.iter().flat_map(|study| &study.series);
    let instances = series.flat_map(|series| &series.instances);
    let objects: Vec<_> = instances.filter_map(|instance| instance.object).collect();
    let read = match objects.is_empty() {
        true => Vec::new(),
        false => pacs
            .cases()
            .stored_metadata(&objects)
            .await?
            .ok_or_else(not_kept)?,
    };
    let mut read = read.into_iter();
    let mut body: Vec<Value> = Vec::new();
    for study in &studies {
        for series in &study.series {
            for instance in &series.instances {
                let known = instance.object.and_then(|_| read.next());
                body.push(known.unwrap_or_else(|| what_is_known(&study.values, series, instance)));
            }
        }
    }
    let mut response = fresh_json(StatusCode::OK, &body);
    let kind = HeaderValue::from_static(DICOM_JSON);
    response.headers_mut().insert(header::CONTENT_TYPE, kind);
    Ok(response)
}

/// The attributes of an image that is not kept, without those of a search.
fn what_is_known(study: &Values, series: &HeldSeries, instance: &HeldInstance) -> Value {
    let mut values = study.clone();
    values.extend(&series.values);
    values.extend(&instance.values);
    let of_searches = [
        "00080056", "00080061", "00081190", "00201206", "00201208", "00201209",
    ];
    let values = values.iter().filter(|(tag, ..)| !of_searches.contains(tag));
    let values = values.map(|(tag, vr, text)| (tag.to_owned(), element(vr, text)));
    values.collect::<Map<_, _>>().into()
}

async fn pixels(
    pacs: &Pacs,
    named: Named,
    numbers: &str,
    headers: &HeaderMap,
) -> Result<Response, AppError> {
    let numbers = numbers_of(numbers)?;
    let accepted = Accepted::read(headers, FRAME, numbers.len() == 1)?;
    let object = files_of(&HeldStudy::named(pacs, &named).await?)?[0];
    let frames = pacs.cases().stored_frames(object, numbers).await?;
    let frames: Option<Vec<Bytes>> = frames.ok_or_else(not_kept)?.into_iter().collect();
    let frames = frames.ok_or_else(|| {
        AppError::not_found("no-such-frame", "the instance has no frame of this number")
    })?;
    if !accepted.is_multipart
        && let [frame] = &frames[..]
    {
        return Ok(response(FRAME, frame.clone().into()));
    }
    let boundary = boundary();
    let mut pieces = Vec::new();
    for frame in frames {
        pieces.extend([
            part_head(&boundary, FRAME),
            frame,
            Bytes::from_static(b"\r\n"),
        ]);
    }
    pieces.push(format!("--{boundary}--\r\n").into());
    let kind = format!("multipart/related; type=\"{FRAME}\"; boundary={boundary}");
    Ok(response(&kind, Body::from(pieces.concat())))
}

/// Numbers from 1 in a list, as numbers from 0.
fn numbers_of(text: &str) -> Result<Vec<usize>, AppError> {
    let numbers = text
        .split(',')
        .map(|number| number.trim().parse::<usize>().ok()?.checked_sub(1));
    let numbers: Option<Vec<_>> = numbers.take(MAX_FRAMES + 1).collect();
    let numbers = numbers.filter(|numbers| numbers.len() <= MAX_FRAMES);
    numbers.ok_or_else(|| {
        let detail =
            format!("the frames must be numbers from 1, with commas, at most {MAX_FRAMES}");
        AppError::bad_request("query-value-out-of-range", detail)
    })
}

fn response(kind: &str, body: Body) -> Response {
    let mut response = Response::new(body);
    let headers = response.headers_mut();
    if let Ok(kind) = HeaderValue::from_str(kind) {
        headers.insert(header::CONTENT_TYPE, kind);
    }
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}
