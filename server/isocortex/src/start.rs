//! Starts a server from a configuration.

use std::time::Duration;

use axum::Router;
use axum::response::IntoResponse as _;
use cases::{Cases, Library};
use http_support::problem::AppError;
use pacs::{Pacs, Problems};
use service::app::{Beside, app_beside};
use service::state::{AppState, HttpOptions, UploadLimits};

use crate::config::{Config, ConfigError, DICOM_UNPACKING};

/// Why a server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The configuration is invalid.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The application cannot start.
    #[error(transparent)]
    Cases(#[from] cases::StartError),
}

/// Opens the store for serving. Cases are prepared only after workers are started on the library.
///
/// # Errors
/// If the configuration is invalid or the store cannot be opened.
pub async fn open(config: &Config) -> Result<AppState, StartError> {
    config.check()?;
    let options = HttpOptions {
        access: config.access()?,
        uploads: UploadLimits {
            max_bytes: config.limits.max_upload_bytes,
            at_a_time: config.http.max_uploads,
            idle: Duration::from_secs(config.http.upload_idle_secs),
            whole: Duration::from_secs(config.http.upload_timeout_secs),
        },
        body_cache_bytes: config.http.body_cache_bytes,
        answer_timeout: Duration::from_secs(config.http.answer_timeout_secs),
    };
    let cases = Cases::open(config.cases()?).await?;
    Ok(AppState::new(cases, options))
}

/// What images from a PACS go to, on the application that is served.
///
/// # Errors
/// If a node in the configuration cannot be used.
pub fn pacs(config: &Config, cases: &Cases) -> Result<Pacs, ConfigError> {
    let options = pacs::Options {
        uploads: pacs::UploadLimits {
            max_bytes: config
                .limits
                .max_upload_bytes
                .saturating_mul(DICOM_UNPACKING),
            at_a_time: config.http.max_uploads,
            idle: Duration::from_secs(config.http.upload_idle_secs),
            whole: Duration::from_secs(config.http.upload_timeout_secs),
        },
        nodes: config.pacs.nodes()?,
        serves_source: config.pacs.keep_source,
        shows_patient: config.shows_patient()?,
        problems: Problems {
            of_cases: |error| AppError::from(error).into_response(),
            other: |status, kind, detail| {
                let error = AppError::Beside {
                    status,
                    kind,
                    detail,
                };
                error.into_response()
            },
        },
    };
    Ok(Pacs::new(cases.clone(), options))
}

/// Everything that is served over HTTP.
pub fn router(state: &AppState, pacs: &Pacs) -> Router {
    let (guarded, description) = pacs::guarded_routes(pacs);
    let beside = Beside {
        guarded,
        description,
    };
    app_beside(state.clone(), beside)
}

/// Opens the store for preparing cases only.
///
/// # Errors
/// If the configuration is invalid or the store cannot be opened.
pub async fn open_library(config: &Config) -> Result<Library, StartError> {
    config.check()?;
    Ok(cases::open_library(&config.cases()?).await?)
}
