//! The patient attributes of a case, which have their own address.

use axum::extract::State;
use cases::Cases;
use std::collections::BTreeMap;

use axum::http::StatusCode;
use axum::response::Response;
use imaging::dicom::Instance;
use serde::Serialize;
use utoipa::ToSchema;

use crate::routes::asked::CasePath;
use http::fresh::fresh_json;
use http::problem::AppError;
use http::query::{ApiQuery, NoQuery};

/// Attributes of the DICOM files of a volume. This is patient data.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct DicomView {
    /// Values by keyword, of the first slice, such as `PatientID`, `StudyInstanceUID` and `SeriesInstanceUID`.
    attributes: BTreeMap<String, String>,
    /// The images, slice by slice along the normal.
    instances: Vec<InstanceView>,
}

/// The image of a slice.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = DicomInstance)]
pub struct InstanceView {
    /// The SOP class of the image.
    sop_class_uid: String,
    /// The SOP instance of the image.
    sop_instance_uid: String,
    /// The number of its frame, from 1, if the image has several.
    #[serde(skip_serializing_if = "Option::is_none")]
    frame: Option<usize>,
}

impl From<Instance> for InstanceView {
    fn from(instance: Instance) -> Self {
        Self {
            sop_class_uid: instance.sop_class_uid,
            sop_instance_uid: instance.sop_instance_uid,
            frame: instance.frame,
        }
    }
}

/// Patient identity
///
/// The identifying attributes of the DICOM files of the volume, which are stored apart from the pixels. They are
/// patient data: no other answer contains them, and no cache may store them.
#[utoipa::path(
    get, path = "/v1/cases/{id}/dicom", tag = "cases",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "The attributes", body = DicomView),
        (status = 404, description = "No such case, or it was not created from DICOM"),
    )
)]
pub async fn get_dicom(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    cases.case(&id).await?;
    let stored = cases.store().source_dicom(&id).await?;
    let stored = stored.ok_or_else(not_dicom)?;
    let attributes = pipeline::attributes(&stored)?;
    let view = DicomView {
        attributes: attributes.attributes.into_iter().collect(),
        instances: attributes.instances.into_iter().map(Into::into).collect(),
    };
    Ok(fresh_json(StatusCode::OK, &view))
}

fn not_dicom() -> AppError {
    AppError::not_found(
        "not-dicom",
        "this case was not created from DICOM; it has no patient attributes",
    )
}
