//! STOW-RS (PS3.18 §10.5): images come as the parts of a request.

use access::audited::StoredImages;
use access::scopes::Scope;
use access::tokens::Holder;
use axum::body::{Body, HttpBody as _};
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use case::series::{SeriesUids, Uid};
use cases::Error;
use cases::ready::check_before_upload;
use serde_json::{Value, json};
use storage::Spooled;

use crate::identity::{InstanceIdentity, series_of};
use crate::multipart::boundary_of;
use crate::parts::{Parts, PartsError, is_dicom};
use crate::refusal::{Refusal, Refusals, Status, error_comment};
use crate::state::Pacs;
use crate::values::{ArrivalSource, Reception};
use http::fresh::fresh_json;
use http::negotiate::{MediaType, media_type};
use http::problem::AppError;

const DICOM: &str = "application/dicom";
const DICOM_JSON: &str = "application/dicom+json";

/// The most images in a request.
const MAX_INSTANCES: usize = 20_000;

/// Images that are made durable together.
const BATCH: usize = 64;

const NOT_DICOM: Refusal = Refusal::new(
    Status::CannotUnderstand,
    "the part has another media type than application/dicom",
);

const TOO_LARGE: Refusal =
    Refusal::new(Status::OutOfResources, "it is larger than an image may be");

const ANOTHER_STUDY: Refusal = Refusal::new(
    Status::DataSetDoesNotMatch,
    "it belongs to another study than the one in the address",
);

/// What is said of an object that is acknowledged and not kept.
const IGNORED: &str = "it is not an MR or CT image, and nothing of it is kept";

/// What is said of a rejection note.
const NOTED: &str = "the images that it names are rejected; it is not kept itself";

/// Store images
///
/// Images are durable when they are acknowledged. Once nothing has come for a series for a while, it becomes a case, or
/// nothing, for a reason that `GET /v1/arrivals` states. An image that is there already is no error. Objects other than MR and
/// CT images are accepted and not kept, unless the configuration says otherwise. A rejection note needs a token with the scope
/// `dicom-reject` too; otherwise it alone is refused, with the Failure Reason (0008,1197) 0124.
#[utoipa::path(
    post, path = "/dicomweb/studies", tag = "pacs",
    request_body(content = Vec<u8>, content_type = "multipart/related; type=\"application/dicom\""),
    responses(
        (status = 200, description = "All images are stored: `ReferencedSOPSequence` (0008,1199) lists them", content_type = "application/dicom+json"),
        (status = 202, description = "Some are stored; `FailedSOPSequence` (0008,1198) and `OtherFailuresSequence` (0008,119A) list the others with their reasons. Or all are, and one with a `WarningReason` (0008,1196) of B000 took the place of an image with the same UID and other contents", content_type = "application/dicom+json"),
        (status = 400, description = "The body cannot be read"),
        (status = 406, description = "Only `application/dicom+json` is available"),
        (status = 409, description = "None is stored", content_type = "application/dicom+json"),
        (status = 413, description = "The body is too large"),
        (status = 415, description = "The body is not `multipart/related` of DICOM files"),
        (status = 503, description = "Too many requests with images at a time"),
        (status = 507, description = "The disk of the store is full or failed"),
    )
)]
pub(crate) async fn store_study(
    State(pacs): State<Pacs>,
    request: Request,
) -> Result<Response, AppError> {
    store(&pacs, None, request).await
}

/// Store images of a study
///
/// As `POST /dicomweb/studies`; images of other studies are not stored.
#[utoipa::path(
    post, path = "/dicomweb/studies/{study}", tag = "pacs",
    params(("study" = String, Path, description = "The Study Instance UID")),
    request_body(content = Vec<u8>, content_type = "multipart/related; type=\"application/dicom\""),
    responses(
        (status = 200, description = "All images are stored", content_type = "application/dicom+json"),
        (status = 202, description = "Some are stored", content_type = "application/dicom+json"),
        (status = 400, description = "The body cannot be read"),
        (status = 404, description = "The address has no UID"),
        (status = 406, description = "Only `application/dicom+json` is available"),
        (status = 409, description = "None is stored", content_type = "application/dicom+json"),
        (status = 413, description = "The body is too large"),
        (status = 415, description = "The body is not `multipart/related` of DICOM files"),
        (status = 503, description = "Too many requests with images at a time"),
        (status = 507, description = "The disk of the store is full or failed"),
    )
)]
pub(crate) async fn store_in_study(
    State(pacs): State<Pacs>,
    Path(study): Path<String>,
    request: Request,
) -> Result<Response, AppError> {
    match Uid::parse(&study) {
        Some(study) => store(&pacs, Some(study), request).await,
        None => Err(AppError::not_found(
            "not-a-uid",
            "the address has no Study Instance UID: digits and points, at most 64",
        )),
    }
}

async fn store(pacs: &Pacs, study: Option<Uid>, request: Request) -> Result<Response, AppError> {
    let boundary = boundary(request.headers())?;
    media_type(request.headers(), &[DICOM_JSON, "application/json"])?;
    let limits = &pacs.options().uploads;
    if let Some(length) = request.body().size_hint().upper()
        && length > limits.max_bytes
    {
        return Err(PartsError::TooLarge(limits.max_bytes).into());
    }
    let _room = pacs.room(&request)?;
    check_before_upload(pacs.cases().store()).await?;
    let holder = request.extensions().get::<Holder>().cloned();
    let mut images = Images {
        pacs,
        holder: holder.ok_or(Error::Internal)?,
        study,
        batch: Vec::new(),
        report: Report::default(),
        refused: Vec::new(),
        refusals: Refusals::of(ArrivalSource::Stow),
        stored: StoredImages::default(),
    };
    let parts = Parts::new(request.into_body(), &boundary, *limits);
    let received = images.receive(parts).await;
    images.count_refused().await;
    let mut response = match received {
        Ok(()) => std::mem::take(&mut images.report).answer(),
        Err(error) => error.into_response(),
    };
    // What was stored before an error is stored.
    response.extensions_mut().insert(images.stored);
    Ok(response)
}

fn boundary(headers: &HeaderMap) -> Result<String, AppError> {
    let kind = headers.get(header::CONTENT_TYPE);
    let kind = kind.and_then(|kind| MediaType::parse(kind.to_str().ok()?));
    let boundary = kind.as_ref().and_then(|kind| boundary_of(kind, DICOM));
    boundary.map(str::to_owned).ok_or_else(|| {
        AppError::new(
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
            "unsupported-media-type",
            "send the images as multipart/related; type=\"application/dicom\"; boundary=…",
        )
    })
}

/// The images of a request.
struct Images<'a> {
    pacs: &'a Pacs,
    holder: Holder,
    study: Option<Uid>,
    /// Read, and not durable yet.
    batch: Vec<(InstanceIdentity, Spooled)>,
    report: Report,
    /// Refused, and not counted in the arrivals of their series yet.
    refused: Vec<(SeriesUids, Refusal)>,
    refusals: Refusals,
    /// For the audit record.
    stored: StoredImages,
}

impl Images<'_> {
    /// Reads all parts, and makes those durable that may be.
    async fn receive(&mut self, mut parts: Parts<Body>) -> Result<(), AppError> {
        while let Some(kind) = parts.next().await? {
            if self.report.count() == MAX_INSTANCES {
                let detail = format!("the request has more than {MAX_INSTANCES} parts; send fewer");
                return Err(AppError::new(
                    StatusCode::PAYLOAD_TOO_LARGE,
                    "too-many-files",
                    detail,
                ));
            }
            if !is_dicom(kind.as_deref()) {
                parts.skip().await?;
                self.unknown(&NOT_DICOM);
                continue;
            }
            match parts.spool(self.pacs.cases().store()).await? {
                Some(file) => self.add(file).await?,
                None => self.unknown(&TOO_LARGE),
            }
        }
        self.finish().await
    }

    async fn add(&mut self, file: Spooled) -> Result<(), AppError> {
        let identity = match InstanceIdentity::read(self.pacs.cases(), &file).await {
            Ok(identity) => identity,
            Err(Error::Failure(why)) => {
                let uids = series_of(self.pacs.cases(), &file, &why).await;
                let refusal = Error::Failure(why).into();
                self.unknown(&refusal);
                if let Some(uids) = uids {
                    self.note_refused(uids, refusal).await;
                }
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        if self
            .study
            .as_ref()
            .is_some_and(|study| *study != identity.uids.study)
        {
            self.failed(&identity, &ANOTHER_STUDY);
            self.note_refused(identity.uids, ANOTHER_STUDY).await;
            return Ok(());
        }
        if !identity.is_image {
            return self.add_other(identity).await;
        }
        self.batch.push((identity, file));
        if self.batch.len() == BATCH {
            self.flush().await?;
        }
        Ok(())
    }

    /// Takes an object that is no image, of which nothing is kept.
    async fn add_other(&mut self, identity: InstanceIdentity) -> Result<(), AppError> {
        // What came before a note came before it.
        self.flush().await?;
        let arrivals = self.pacs.arrivals();
        let source = ArrivalSource::Stow;
        let by = &self.holder.name;
        let reference = identity.clone();
        let may_reject = self.holder.scopes.contains(&Scope::DicomReject);
        let noted = arrivals.note(identity, (source, by), may_reject).await?;
        match noted {
            Ok(status) => self.report.ignored(&reference, status),
            Err(refusal) => self.failed(&reference, &refusal),
        }
        Ok(())
    }

    async fn flush(&mut self) -> Result<(), AppError> {
        let batch = std::mem::take(&mut self.batch);
        if batch.is_empty() {
            return Ok(());
        }
        let identities: Vec<_> = batch.iter().map(|(identity, _)| identity.clone()).collect();
        let source = ArrivalSource::Stow;
        let receptions = self.pacs.arrivals().receive(batch, source).await?;
        for (identity, reception) in identities.iter().zip(receptions) {
            if reception != Reception::Refused {
                let study = identity.uids.study.as_str().to_owned();
                *self.stored.0.entry(study).or_default() += 1;
            }
            match reception.status() {
                Ok(status) => self.report.stored(identity, status),
                Err(refusal) => self.failed(identity, &refusal),
            }
        }
        Ok(())
    }

    /// Notes a refusal, for the arrival of its series.
    async fn note_refused(&mut self, uids: SeriesUids, refusal: Refusal) {
        self.refused.push((uids, refusal));
        if self.refused.len() == BATCH {
            self.count_refused().await;
        }
    }

    async fn count_refused(&mut self) {
        let refused = std::mem::take(&mut self.refused);
        self.pacs
            .arrivals()
            .refuse(refused, ArrivalSource::Stow)
            .await;
    }

    fn failed(&mut self, identity: &InstanceIdentity, refusal: &Refusal) {
        let item = self.refused(reference(identity), refusal);
        self.report.failed.push(item);
    }

    /// An image without a known instance UID.
    fn unknown(&mut self, refusal: &Refusal) {
        let item = self.refused(json!({}), refusal);
        self.report.others.push(item);
    }

    /// Counts a refusal, and completes its item of the report.
    fn refused(&mut self, mut item: Value, refusal: &Refusal) -> Value {
        self.pacs.arrivals().refused(ArrivalSource::Stow);
        self.refusals.add(refusal);
        item["00081197"] = element("US", refusal.status as u16);
        item["00000902"] = element("LO", error_comment(&refusal.why));
        item
    }

    async fn finish(&mut self) -> Result<(), AppError> {
        self.flush().await?;
        if self.report.count() == 0 {
            return Err(AppError::bad_request(
                "no-images",
                "the request has no parts; send each DICOM file as a part",
            ));
        }
        let Report {
            stored,
            failed,
            others,
            ignored,
            ..
        } = &self.report;
        tracing::info!(
            images = stored.len().saturating_sub(*ignored),
            ignored,
            failed = failed.len() + others.len(),
            "images were stored by STOW-RS"
        );
        Ok(())
    }
}

/// What became of each image of a request.
#[derive(Debug, Default)]
struct Report {
    stored: Vec<Value>,
    failed: Vec<Value>,
    others: Vec<Value>,
    has_warnings: bool,
    /// How many of `stored` are acknowledged and not kept.
    ignored: usize,
}

fn element(vr: &str, value: impl Into<Value>) -> Value {
    let value: Value = value.into();
    json!({ "vr": vr, "Value": [value] })
}

/// The class and the instance of an image.
fn reference(identity: &InstanceIdentity) -> Value {
    json!({
        "00081150": element("UI", identity.sop_class_uid.as_str()),
        "00081155": element("UI", identity.sop_instance_uid.as_str()),
    })
}

impl Report {
    fn count(&self) -> usize {
        self.stored.len() + self.failed.len() + self.others.len()
    }

    /// An image, with a warning reason (PS3.18 table I.2-1) if it took the place of another one.
    fn stored(&mut self, identity: &InstanceIdentity, status: Status) {
        let mut item = reference(identity);
        if status == Status::Corrected {
            item["00081196"] = element("US", status as u16);
            self.has_warnings = true;
        }
        // Nothing can be retrieved from here.
        item["00081190"] = json!({ "vr": "UR" });
        self.stored.push(item);
    }

    /// An object of which nothing is kept, as if it were stored.
    fn ignored(&mut self, identity: &InstanceIdentity, status: Status) {
        self.ignored += 1;
        self.stored(identity, status);
        if let Some(item) = self.stored.last_mut() {
            let said = identity.rejection.as_ref().map_or(IGNORED, |_| NOTED);
            item["00000902"] = element("LO", error_comment(said));
        }
    }

    fn answer(self) -> Response {
        let status = match (self.stored.len(), self.failed.len() + self.others.len()) {
            (0, _) => StatusCode::CONFLICT,
            (_, 0) if !self.has_warnings => StatusCode::OK,
            _ => StatusCode::ACCEPTED,
        };
        let mut body = json!({ "00081190": { "vr": "UR" } });
        let sequences = [
            ("00081199", self.stored),
            ("00081198", self.failed),
            ("0008119A", self.others),
        ];
        for (tag, items) in sequences {
            if !items.is_empty() {
                body[tag] = json!({ "vr": "SQ", "Value": items });
            }
        }
        let mut response = fresh_json(status, &body);
        let kind = HeaderValue::from_static(DICOM_JSON);
        response.headers_mut().insert(header::CONTENT_TYPE, kind);
        response
    }
}
