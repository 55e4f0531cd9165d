//! Pictures of the cases of a study or a series, in DICOMweb's own terms (PS3.18 §8.3.5).

pub(crate) mod media;
mod query;

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::body::Body;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::Response;
use case::series::{SeriesQuery, Uid};
use case::{CaseFacts, CaseId, CaseState, SurfaceName};
use cases::pictures::{PictureSeries, SeriesPicture};
use cases::{Cases, Error};
use serde::Deserialize;
use serde_json::{Value, json};

use self::media::{Answer, Kind, accepted};
use self::query::{RenderedParams, RenderedQuery, Shown};
use crate::series::SEVERAL_PATIENTS;
use crate::state::Pacs;
use http::problem::AppError;

type Keys = Result<Query<Vec<(String, String)>>, QueryRejection>;

/// A study, or a series of it. The texts may be anything.
#[derive(Debug, Deserialize)]
pub(crate) struct Named {
    study: String,
    series: Option<String>,
}

/// Volume rendering of a study
///
/// A picture of the case that a link to the study opens (PS3.18, Supplement 228). JPEG by default, PNG on request, several pictures as
/// `multipart/related`. Keys of the standard: `orientation`, `viewpointposition`, `viewpointlookat`, `viewpointup`, `window`, `viewport`,
/// `quality`, `annotation`, `swivelrange`, `animationstepsize`, `animationrate`, `renderingmethod`, `renderedvolumetricmetadata`. Our own:
/// `depth_mm`, `surface`, `renderer`, `colormap`, `slab_mm`, `ambient`, `layer`, `overlay`, `overlay_window`, `overlay_colormap`,
/// `overlay_threshold`, `overlay_opacity`.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/rendered3D", tag = "pacs", operation_id = "render_study",
    params(("study" = String, Path, description = "The Study Instance UID"), RenderedParams),
    responses(
        (status = 200, description = "The picture, several pictures, or the values of the view (`renderedvolumetricmetadata=yes`)", content(
            (Vec<u8> = "image/jpeg"), (Vec<u8> = "image/png"), (Vec<u8> = "multipart/related"), (serde_json::Value = "application/dicom+json"),
        )),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
        (status = 404, description = "There is no case of this study"),
        (status = 406, description = "No accepted media type is available"),
        (status = 409, description = "The case is not ready, or the study has images of several patients (`several-patients`)"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub(crate) async fn of_study(
    State(pacs): State<Pacs>,
    Path(named): Path<Named>,
    keys: Keys,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    render(&pacs, named, keys, &headers).await
}

/// Volume rendering of a series
///
/// As `GET /dicomweb/studies/{study}/rendered3D`.
#[utoipa::path(
    get, path = "/dicomweb/studies/{study}/series/{series}/rendered3D", tag = "pacs", operation_id = "render_series",
    params(
        ("study" = String, Path, description = "The Study Instance UID"),
        ("series" = String, Path, description = "The Series Instance UID"),
        RenderedParams,
    ),
    responses(
        (status = 200, description = "The picture", content((Vec<u8> = "image/jpeg"), (Vec<u8> = "image/png"))),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
        (status = 404, description = "There is no case of this series"),
        (status = 406, description = "No accepted media type is available"),
        (status = 409, description = "The case is not ready"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub(crate) async fn of_series(
    State(pacs): State<Pacs>,
    Path(named): Path<Named>,
    keys: Keys,
    headers: HeaderMap,
) -> Result<Response, AppError> {
    render(&pacs, named, keys, &headers).await
}

/// The keys of a query, each once.
fn read_keys(keys: Keys) -> Result<BTreeMap<String, String>, AppError> {
    let unreadable = || {
        AppError::bad_request(
            "query-unreadable",
            "the query cannot be read; each key may be given once",
        )
    };
    let Query(pairs) = keys.map_err(|_| unreadable())?;
    let count = pairs.len();
    let keys = BTreeMap::from_iter(pairs);
    match keys.len() < count {
        true => Err(unreadable()),
        false => Ok(keys),
    }
}

async fn render(
    pacs: &Pacs,
    named: Named,
    keys: Keys,
    headers: &HeaderMap,
) -> Result<Response, AppError> {
    let keys = read_keys(keys)?;
    let asked = RenderedQuery::read(&keys)?;
    let cases = pacs.cases();
    let id = held_case(pacs, &named).await?;
    let surface = asked.surface()?;
    let facts = match surface.is_whole() {
        true => cases.ready(&id).await?,
        // It is framed by its own sphere.
        false => Arc::new(cases.surface(&id, surface).await?.facts().clone()),
    };
    let shown = asked.shown(&facts)?;
    if asked.is_metadata() {
        let body = json!([metadata(&shown, surface, &facts)]).to_string();
        return Ok(response("application/dicom+json", body.into()));
    }
    let answer = accepted(asked.accept(), headers, shown.pictures.len() > 1)?;
    let series = PictureSeries::of(cases, &id, shown.pictures).await?;
    let pictures = draw(cases, series, answer.kind, shown.quality).await?;
    Ok(answered(&answer, pictures))
}

/// The preferred case of a study or a series, as a link opens it.
async fn held_case(pacs: &Pacs, named: &Named) -> Result<CaseId, AppError> {
    let missing = || {
        let detail = "there is no case of this study or series";
        AppError::not_found("no-such-study", detail)
    };
    let uid = |text: &str| Uid::parse(text).ok_or_else(missing);
    let series = named.series.as_deref().map(uid);
    let query = SeriesQuery::Study(uid(&named.study)?, series.transpose()?);
    let matches = pacs.arrivals().matches(&query).await?;
    if matches.is_ambiguous() {
        let detail = "there are cases of several patients; request a picture of the right one by its id, which `POST /v1/cases/search` lists with its patient";
        return Err(AppError::new(
            StatusCode::CONFLICT,
            SEVERAL_PATIENTS,
            detail,
        ));
    }
    let case = matches.heads.into_iter().next().ok_or_else(missing)?.case;
    match (case.state, case.failure) {
        (CaseState::Ready, _) => Ok(case.id),
        (CaseState::Failed, Some(failure)) => Err(Error::from(failure).into()),
        (state, _) => Err(Error::NotReady { state }.into()),
    }
}

async fn draw(
    cases: &Cases,
    series: PictureSeries,
    kind: Kind,
    quality: u8,
) -> Result<Vec<Vec<u8>>, Error> {
    let add = move |pictures: &mut Vec<Vec<u8>>, picture: SeriesPicture| {
        pictures.push(match kind {
            Kind::Png => picture.encoded()?.png,
            Kind::Jpeg => render::encode_jpeg(&picture.into_frame(), quality)?,
        });
        Ok(())
    };
    series.draw_each(cases, Vec::new(), add).await
}

fn answered(answer: &Answer, pictures: Vec<Vec<u8>>) -> Response {
    let kind = answer.kind.name();
    if !answer.is_multipart {
        let only = pictures.into_iter().next().unwrap_or_default();
        return response(kind, only.into());
    }
    // Pictures are binary, so the boundary is long enough to be in none of them by chance.
    let digest = pictures
        .iter()
        .fold(blake3::Hasher::new(), |mut hasher, picture| {
            hasher.update(picture);
            hasher
        });
    let boundary = digest.finalize().to_hex();
    let mut body = Vec::new();
    for picture in pictures {
        let head = format!("--{boundary}\r\nContent-Type: {kind}\r\n\r\n");
        body.extend(head.bytes());
        body.extend(picture);
        body.extend(b"\r\n");
    }
    body.extend(format!("--{boundary}--\r\n").bytes());
    let multipart = format!("multipart/related; type=\"{kind}\"; boundary={boundary}");
    response(&multipart, body.into())
}

fn response(kind: &str, body: Body) -> Response {
    let mut response = Response::new(body);
    *response.status_mut() = StatusCode::OK;
    let headers = response.headers_mut();
    if let Ok(kind) = HeaderValue::from_str(kind) {
        headers.insert(header::CONTENT_TYPE, kind);
    }
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

/// The view in DICOM's terms (PS3.3 C.11.26, C.11.2), for requests with an explicit viewpoint.
fn metadata(shown: &Shown, surface: SurfaceName, facts: &CaseFacts) -> Value {
    let numbers = |values: &[f64]| json!({"vr": "FD", "Value": values});
    let text = |vr: &str, value: &str| json!({"vr": vr, "Value": [value]});
    let decimals = |value: f64| json!({"vr": "DS", "Value": [value]});
    let asked = &shown.pictures[0].asked;
    let viewpoint = &shown.viewpoint;
    let mut item = json!({
        "00280010": {"vr": "US", "Value": [asked.height]},
        "00280011": {"vr": "US", "Value": [asked.width]},
        "00281050": decimals(shown.window.centre),
        "00281051": decimals(shown.window.width),
        "00281056": text("CS", shown.window.function.dicom_name()),
        "00701602": text("CS", "ORTHOGRAPHIC"),
        "00701603": numbers(&viewpoint.position),
        "00701604": numbers(&viewpoint.look_at),
        "00701605": numbers(&viewpoint.up),
        "0070120D": text("CS", "VOLUME_RENDERED"),
        "00720510": text("CS", "3D_RENDERING"),
        "00082111": text("ST", &format!(
            "Isosurface {} mm below the envelope of the {}. {}",
            asked.depth_mm.min(facts.max_depth_mm),
            surface.words().unwrap_or("brain"),
            render::RESEARCH_USE_NOTICE
        )),
    });
    if let Some(swivel) = &shown.swivel {
        item["00701A03"] = numbers(&[swivel.rate]);
        item["00701A05"] = numbers(&[swivel.step_degrees]);
        item["00701A06"] = numbers(&[swivel.range_degrees]);
    }
    item
}
