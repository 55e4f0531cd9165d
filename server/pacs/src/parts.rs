//! The DICOM files in a body, spooled one after the other within limits of size and time.

use std::pin::Pin;
use std::time::Instant;

use axum::body::HttpBody;
use axum::http::StatusCode;
use bytes::Bytes;
use cases::dicom::MAX_FILE_BYTES;
use futures_util::future::poll_fn;
use storage::{ObjectError, Spooled, Store, StoreError};

use crate::multipart::{MultipartError, Parser, Piece};
use http::negotiate::MediaType;
use http::problem::AppError;
use http::uploads::UploadLimits;

/// Why no further part can be read.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PartsError {
    #[error(transparent)]
    Multipart(#[from] MultipartError),
    #[error("the upload was too slow; send it again over a faster connection")]
    Stalled,
    #[error("the body cannot be read; was it cut off?")]
    Unreadable,
    #[error("the body is larger than the limit of {0} bytes; send fewer images at a time")]
    TooLarge(u64),
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl From<ObjectError> for PartsError {
    fn from(error: ObjectError) -> Self {
        Self::Store(error.into())
    }
}

impl From<PartsError> for AppError {
    fn from(error: PartsError) -> Self {
        let detail = error.to_string();
        match error {
            PartsError::Store(error) => error.into(),
            PartsError::Stalled => Self::bad_request("upload-stalled", detail),
            PartsError::TooLarge(_) => {
                Self::new(StatusCode::PAYLOAD_TOO_LARGE, "body-too-large", detail)
            }
            PartsError::Multipart(_) | PartsError::Unreadable => {
                Self::bad_request("body-unreadable", detail)
            }
        }
    }
}

/// Whether the media type of a part is that of a DICOM file, or missing.
pub(crate) fn is_dicom(kind: Option<&str>) -> bool {
    let is = |kind: MediaType| kind.essence == "application/dicom";
    kind.is_none_or(|kind| MediaType::parse(kind).is_some_and(is))
}

/// The parts of a body.
pub(crate) struct Parts<B> {
    body: B,
    parser: Parser,
    limits: UploadLimits,
    end: Instant,
    bytes: u64,
}

impl<B: HttpBody<Data = Bytes> + Unpin> Parts<B> {
    pub(crate) fn new(body: B, boundary: &str, limits: UploadLimits) -> Self {
        Self {
            body,
            parser: Parser::new(boundary),
            end: Instant::now() + limits.whole,
            limits,
            bytes: 0,
        }
    }

    /// The media type of the next part; `None` at the end.
    pub(crate) async fn next(&mut self) -> Result<Option<Option<String>>, PartsError> {
        match self.piece().await? {
            Piece::Part(kind) => Ok(Some(kind)),
            _ => Ok(None),
        }
    }

    /// The file in the part; `None` if it is too large.
    pub(crate) async fn spool(&mut self, store: &Store) -> Result<Option<Spooled>, PartsError> {
        let mut spool = Some(store.spools().begin().await?);
        while let Piece::Data(bytes) = self.piece().await? {
            let Some(file) = &mut spool else { continue };
            if file.len() + bytes.len() as u64 > MAX_FILE_BYTES {
                spool = None;
                continue;
            }
            file.write(bytes).await?;
        }
        match spool {
            Some(spool) => Ok(Some(spool.finish().await?)),
            None => Ok(None),
        }
    }

    /// Passes over the part.
    pub(crate) async fn skip(&mut self) -> Result<(), PartsError> {
        while let Piece::Data(_) = self.piece().await? {}
        Ok(())
    }

    async fn piece(&mut self) -> Result<Piece, PartsError> {
        loop {
            if let Some(piece) = self.parser.next_piece()? {
                return Ok(piece);
            }
            let left = self.end.saturating_duration_since(Instant::now());
            let frame = poll_fn(|context| Pin::new(&mut self.body).poll_frame(context));
            let frame = tokio::time::timeout(self.limits.idle.min(left), frame).await;
            let Some(frame) = frame.map_err(|_elapsed| PartsError::Stalled)? else {
                self.parser.end()?;
                continue;
            };
            let frame = frame.map_err(|_| PartsError::Unreadable)?;
            if let Ok(bytes) = frame.into_data() {
                self.bytes += bytes.len() as u64;
                if self.bytes > self.limits.max_bytes {
                    return Err(PartsError::TooLarge(self.limits.max_bytes));
                }
                self.parser.push(&bytes);
            }
        }
    }
}
