use std::time::Duration;

/// What an upload may take.
#[derive(Debug, Clone, Copy)]
pub struct UploadLimits {
    /// The largest body, in bytes.
    pub max_bytes: u64,
    /// Uploads at a time.
    pub at_a_time: usize,
    /// Time within which the next bytes must come.
    pub idle: Duration,
    /// Time for a whole upload.
    pub whole: Duration,
}
