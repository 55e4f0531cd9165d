//! The settings of the application: sections of a configuration, each with its defaults. The keys of the file are the names of the fields.

use std::net::SocketAddr;
use std::path::PathBuf;

use pipeline::HeadLimits;
use pipeline::atlas::AtlasChoice;
use serde::{Deserialize, Serialize};

/// The limit for unpacked DICOM files, relative to the limit for an upload.
const DICOM_UNPACKING: u64 = 4;

/// The number of CPU cores.
pub(crate) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// `[limits]`: limits on uploads, preparations and queues.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// The largest accepted upload, in bytes.
    pub max_upload_bytes: u64,
    /// The largest accepted volume, in voxels.
    pub max_voxels: usize,
    /// The shortest side of a volume, in mm; infants and specimens may need less.
    pub min_field_mm: f64,
    /// Memory for all processes together that read files and prepare cases, in bytes; by default enough for all workers and two series.
    pub child_bytes: Option<u64>,
    /// Cases that may wait to be prepared.
    pub max_queued_cases: usize,
    /// Pictures, meshes and checks of uploads that may wait; no key.
    #[serde(skip)]
    pub max_queued_renders: usize,
    /// Whether to compute the maps of the junction of grey and white matter.
    pub maps: MapsUse,
}

/// Whether to compute maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MapsUse {
    /// Once for each case, after it is ready.
    #[default]
    On,
    /// Never.
    Off,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_upload_bytes: 1 << 30,
            max_voxels: 64 << 20,
            min_field_mm: HeadLimits::default().field_mm[0],
            child_bytes: None,
            max_queued_cases: 256,
            max_queued_renders: 64,
            maps: MapsUse::default(),
        }
    }
}

impl Limits {
    /// The limits on volumes.
    pub fn volumes(&self) -> imaging::Limits {
        imaging::Limits {
            max_voxels: self.max_voxels,
            ..imaging::Limits::default()
        }
    }

    /// The limit for the unpacked DICOM files of an upload, in bytes.
    pub fn max_dicom_bytes(&self) -> u64 {
        self.max_upload_bytes.saturating_mul(DICOM_UNPACKING)
    }
}

/// `[prepare]`: preparation of cases.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Prepare {
    /// Cases prepared at a time; with 0 `isocortex serve` leaves them to `isocortex work`.
    pub workers: usize,
    /// The address on which `isocortex work` answers `/healthz`, `/readyz` and `/metrics`; by default none.
    pub listen: Option<SocketAddr>,
    /// Time for a preparation, in seconds; then the case fails.
    pub max_secs: u64,
    /// CPU time of all threads for a preparation in a process of its own, in seconds; then the case fails.
    pub max_cpu_secs: u64,
    /// The file with the weights for brain extraction; by default the one beside the program, if there is one.
    pub network: Option<PathBuf>,
    /// The folder of the atlas that names gyri, or its file with labels, or `none`; by default that of Debian's package
    /// `mricron-data`, if it is installed.
    pub atlas: AtlasChoice,
}

impl Default for Prepare {
    fn default() -> Self {
        Self {
            workers: 1,
            listen: None,
            max_secs: 900,
            max_cpu_secs: 120,
            network: None,
            atlas: AtlasChoice::default(),
        }
    }
}

/// `[render]`: pictures, and what is kept for them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Render {
    /// Pictures, meshes and checks of uploads that are computed at a time.
    pub threads: usize,
    /// Whether a GPU may draw.
    pub gpu: GpuUse,
    /// GPU memory for cases, in bytes; no key.
    #[serde(skip)]
    pub gpu_case_bytes: u64,
    /// Memory for what is kept of cases, in bytes.
    pub cache_bytes: u64,
}

/// Whether a GPU may draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GpuUse {
    /// If there is a hardware GPU.
    #[default]
    Auto,
    /// Also with a software driver, which is slower than the CPU renderers.
    Always,
    /// Never: no driver is loaded.
    Off,
}

impl Default for Render {
    fn default() -> Self {
        Self {
            threads: cores(),
            gpu: GpuUse::default(),
            gpu_case_bytes: 1 << 30,
            cache_bytes: 960 << 20,
        }
    }
}

impl Render {
    /// The usual ones, on the CPU alone.
    pub fn on_cpu() -> Self {
        Self {
            gpu: GpuUse::Off,
            ..Self::default()
        }
    }
}
