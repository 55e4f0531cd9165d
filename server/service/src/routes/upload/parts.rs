//! Reads the parts of an upload piece by piece, within limits of size and time, onto the disk of the store.

use std::time::{Duration, Instant};

use axum::extract::multipart::{Field, MultipartError};
use axum::http::StatusCode;
use bytes::Bytes;
use cases::dicom::flat_name;
use cases::ready::check_before_upload;
use futures_util::{Stream, StreamExt as _};
use imaging::surface::subject_files;
use storage::{Spooled, Store, StoreError};
use tempfile::TempDir;
use tokio::io::AsyncWriteExt as _;

use crate::state::Uploads;
use http::metrics::Metrics;
use http::problem::AppError;
use http::uploads::UploadLimits;

/// The greatest number of parts `dicom`; a series has a few hundred.
const MAX_DICOM_PARTS: usize = 20_000;

/// The number of bytes of a DICOM file to write at once.
const WRITE_BUFFER_BYTES: usize = 256 << 10;

/// An upload in progress.
#[derive(Debug, Clone, Copy)]
pub(in crate::routes) struct Incoming<'a> {
    store: &'a Store,
    metrics: &'a Metrics,
    limits: UploadLimits,
    end: Instant,
}

/// The reason why no further piece can be read.
pub(in crate::routes) trait PieceError: std::error::Error + 'static {
    /// The answer to whoever sent it, if it was sent fast enough.
    fn refusal(&self, limits: &UploadLimits) -> AppError;
}

impl PieceError for MultipartError {
    fn refusal(&self, limits: &UploadLimits) -> AppError {
        match self.status() {
            StatusCode::PAYLOAD_TOO_LARGE => too_large(limits),
            _ => {
                let detail = "the form cannot be read; was the upload cut off?";
                AppError::bad_request("form-unreadable", detail)
            }
        }
    }
}

impl PieceError for axum::Error {
    fn refusal(&self, _limits: &UploadLimits) -> AppError {
        let detail = "the body cannot be read; was the upload cut off?";
        AppError::bad_request("body-unreadable", detail)
    }
}

fn too_large(limits: &UploadLimits) -> AppError {
    AppError::too_large(limits.max_bytes)
}

fn stalled(detail: String) -> AppError {
    AppError::bad_request("upload-stalled", detail)
}

impl<'a> Incoming<'a> {
    /// One that begins now.
    ///
    /// # Errors
    /// [`cases::Error::Unavailable`] if the object store does not answer.
    pub(in crate::routes) async fn begin(
        store: &'a Store,
        uploads: &'a Uploads,
    ) -> Result<Self, AppError> {
        check_before_upload(store).await?;
        Ok(Self {
            store,
            metrics: &uploads.metrics,
            limits: uploads.limits,
            end: Instant::now() + uploads.limits.whole,
        })
    }

    /// Waits for the next piece, within the time limits.
    ///
    /// # Errors
    /// An error if it comes too late; [`PieceError::refusal`].
    pub(super) async fn in_time<T, E: PieceError>(
        &self,
        piece: impl Future<Output = Result<T, E>>,
    ) -> Result<T, AppError> {
        let left = self.end.saturating_duration_since(Instant::now());
        let wait = self.limits.idle.min(left);
        let piece = tokio::time::timeout(wait, piece).await;
        let piece = piece.map_err(|_elapsed| stalled(self.too_late(wait)))?;
        piece.map_err(|error| error.refusal(&self.limits))
    }

    fn too_late(&self, wait: Duration) -> String {
        let UploadLimits { idle, whole, .. } = self.limits;
        if wait < idle {
            format!("the upload took more than {} seconds", whole.as_secs())
        } else {
            format!("no data arrived for {} seconds", idle.as_secs())
        }
    }

    async fn next<E: PieceError>(
        &self,
        pieces: &mut (impl Stream<Item = Result<Bytes, E>> + Unpin),
    ) -> Result<Option<Bytes>, AppError> {
        self.in_time(async { pieces.next().await.transpose() })
            .await
    }

    /// Streams a file to the disk of the store.
    ///
    /// # Errors
    /// An error if it is too large, comes too late or cannot be read, or the disk's.
    pub(in crate::routes) async fn spool<E: PieceError>(
        &self,
        mut pieces: impl Stream<Item = Result<Bytes, E>> + Unpin,
    ) -> Result<Spooled, AppError> {
        let mut spool = self.store.spools().begin().await?;
        while let Some(bytes) = self.next(&mut pieces).await? {
            if spool.len() + bytes.len() as u64 > self.limits.max_bytes {
                return Err(too_large(&self.limits));
            }
            self.metrics.uploaded(bytes.len());
            spool.write(bytes).await.map_err(StoreError::from)?;
        }
        Ok(spool.finish().await.map_err(StoreError::from)?)
    }

    /// A short part, in memory; `None` if it is longer than `most` bytes.
    pub(super) async fn short(
        &self,
        mut field: Field<'_>,
        most: usize,
    ) -> Result<Option<Vec<u8>>, AppError> {
        let mut text = Vec::new();
        while let Some(bytes) = self.next(&mut field).await? {
            if text.len() + bytes.len() > most {
                return Ok(None);
            }
            text.extend_from_slice(&bytes);
        }
        Ok(Some(text))
    }
}

/// DICOM files, one after the other, under numbers for names; or the files of a subject, under their own.
#[derive(Default)]
pub(super) struct DicomParts {
    directory: Option<TempDir>,
    count: usize,
    bytes: u64,
}

impl DicomParts {
    /// Streams the next file to the disk of the store.
    pub(super) async fn add(
        &mut self,
        incoming: &Incoming<'_>,
        mut field: Field<'_>,
    ) -> Result<(), AppError> {
        if self.count == MAX_DICOM_PARTS {
            let detail = format!(
                "the form has more than {MAX_DICOM_PARTS} parts `dicom`; send them as a zip"
            );
            return Err(AppError::part_too_large(detail));
        }
        let directory = match &mut self.directory {
            Some(directory) => directory,
            empty => empty.insert(incoming.store.spools().directory().await?),
        };
        let of_subject = field.file_name().and_then(|sent| {
            let mut known = subject_files();
            known.find(|name| name == sent)
        });
        let name = of_subject.as_deref().map(flat_name);
        let path = directory
            .path()
            .join(name.unwrap_or_else(|| self.count.to_string()));
        if let Some(name) = of_subject
            && path.exists()
        {
            let detail = format!("the form has `{name}` twice; send the files of one subject");
            return Err(AppError::bad_request("form-unreadable", detail));
        }
        self.count += 1;
        let disk = |error| AppError::from(StoreError::Disk(error));
        let file = tokio::fs::File::create_new(path).await.map_err(disk)?;
        let mut file = tokio::io::BufWriter::with_capacity(WRITE_BUFFER_BYTES, file);
        while let Some(bytes) = incoming.next(&mut field).await? {
            self.bytes += bytes.len() as u64;
            let limit = incoming.limits.max_bytes;
            if self.bytes > limit {
                let detail =
                    format!("the parts `dicom` together exceed the limit of {limit} bytes");
                return Err(AppError::part_too_large(detail));
            }
            incoming.metrics.uploaded(bytes.len());
            file.write_all(&bytes).await.map_err(disk)?;
        }
        file.flush().await.map_err(disk)
    }

    /// The directory of the files; `None` if none came.
    pub(super) fn into_directory(self) -> Option<TempDir> {
        self.directory
    }
}
