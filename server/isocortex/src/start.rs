//! Starts a server from a configuration.

use std::time::Duration;

use cases::{Cases, Library};
use service::state::{AppState, HttpOptions, UploadLimits};

use crate::config::{Config, ConfigError};

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

/// Opens the store for preparing cases only.
///
/// # Errors
/// If the configuration is invalid or the store cannot be opened.
pub async fn open_library(config: &Config) -> Result<Library, StartError> {
    config.check()?;
    Ok(cases::open_library(&config.cases()?).await?)
}
