//! What can be wrong with a file.

use geometry::GeometryError;

/// Why a file was refused, or could not be written.
///
/// Messages carry numbers of the header and names of the standard, never texts of the file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ImagingError {
    /// Neither a NIfTI-1 nor a NIfTI-2 header, packed or not.
    #[error("this is not a NIfTI file: it does not begin with a header of 348 or 540 bytes")]
    NotNifti,
    /// An Analyze 7.5 header, which does not say which side is left.
    #[error(
        "this is an Analyze 7.5 image, which does not say which side of the head is left; convert the original images to NIfTI"
    )]
    Analyze,
    /// The header of a pair of files, `.hdr` and `.img`.
    #[error(
        "this is the header of a .hdr/.img pair without its voxels; save it as a single .nii file"
    )]
    NiftiHeaderOnly,
    /// A header of the right size without NIfTI's magic word, or the reverse.
    #[error("the NIfTI header is damaged: {what}")]
    NiftiHeader {
        /// What is wrong with it.
        what: &'static str,
    },
    /// The file ends early.
    #[error("the NIfTI file is truncated: {found} of its {expected} bytes are there")]
    NiftiTruncated {
        /// Bytes that header and voxels take.
        expected: u64,
        /// Bytes, unpacked, that there are.
        found: u64,
    },
    /// Bytes follow the last voxel.
    #[error("the NIfTI file goes on after the {expected} bytes that its header describes")]
    NiftiTrailingData {
        /// Bytes that header and voxels take.
        expected: u64,
    },
    /// A packed header promises more than so short a gzip stream can hold.
    #[error("the header promises {promised} bytes, more than {packed} bytes of gzip can hold")]
    NiftiPromise {
        /// Bytes that header and voxels take.
        promised: u64,
        /// Bytes of the gzip stream.
        packed: u64,
    },
    /// A size in the header is not that of an image.
    #[error("dim[{axis}] of the NIfTI header is {value}; it must be {range}")]
    NiftiDimension {
        /// Which entry of `dim`; 0 is the number of dimensions.
        axis: usize,
        /// What it holds.
        value: i64,
        /// What it may hold, in words.
        range: &'static str,
    },
    /// An image of fewer than three dimensions.
    #[error(
        "the image is two-dimensional ({}×{}×{} voxels); a volume is needed", .size[0], .size[1], .size[2]
    )]
    NiftiNotAVolume {
        /// Voxels along x, y and z.
        size: [usize; 3],
    },
    /// More than one volume.
    #[error("the file holds {count} volumes; supply one of them")]
    NiftiSeveralVolumes {
        /// How many there are.
        count: u64,
    },
    /// A data type that is not of integers or real numbers, or that is not known.
    #[error(
        "voxels of NIfTI data type {code} ({name}) cannot be read; integers and real numbers of up to 64 bits can"
    )]
    NiftiDataType {
        /// The code in the header.
        code: i16,
        /// Its name in the standard.
        name: &'static str,
    },
    /// `bitpix` is not the size of `datatype`.
    #[error(
        "the NIfTI header contradicts itself: {bitpix} bits per voxel of type {name}, which has {expected}"
    )]
    NiftiBitpix {
        /// Bits per voxel that the header states.
        bitpix: i16,
        /// Name of the data type.
        name: &'static str,
        /// Bits per voxel of that type.
        expected: i16,
    },
    /// The voxels do not start behind the header.
    #[error(
        "vox_offset of the NIfTI header is {value}; it must be a whole number from {least} to {most}"
    )]
    NiftiVoxOffset {
        /// What the header holds.
        value: f64,
        /// Where voxels can start at the earliest.
        least: u64,
        /// Where they may start at the latest.
        most: u64,
    },
    /// An unknown unit of length.
    #[error(
        "the NIfTI header gives lengths in the unknown unit {code}; metres, millimetres and micrometres can be read"
    )]
    NiftiUnits {
        /// The code of the unit.
        code: u8,
    },
    /// Neither an sform nor a qform.
    #[error(
        "the NIfTI header does not say which side of the head is left: it has neither a qform nor an sform"
    )]
    NiftiOrientationUnknown,
    /// Sform and qform put left on opposite sides.
    #[error(
        "sform and qform of the NIfTI header contradict each other about which side of the head is left"
    )]
    NiftiLeftRight,
    /// The affine from voxels to the patient is not one.
    #[error("the {form} of the NIfTI header is unusable: {what}")]
    NiftiAffine {
        /// `sform`, `qform` or `pixdim`.
        form: &'static str,
        /// What is wrong with it.
        what: &'static str,
    },
    /// Slope or intercept is not a number.
    #[error(
        "the NIfTI header scales intensities by {slope} and adds {intercept}, which is no scaling"
    )]
    NiftiScaling {
        /// `scl_slope`.
        slope: f64,
        /// `scl_inter`.
        intercept: f64,
    },
    /// Intensities beyond single precision.
    #[error("intensities from {min:e} to {max:e} do not fit in single precision")]
    NiftiIntensityRange {
        /// Least intensity.
        min: f64,
        /// Greatest intensity.
        max: f64,
    },
    /// Voxels that are not a number, or infinite.
    #[error("{count} of {voxels} voxels are not finite numbers")]
    NiftiNonFinite {
        /// How many.
        count: u64,
        /// Out of how many.
        voxels: u64,
    },
    /// The gzip stream ends early.
    #[error("the gzip file is truncated")]
    GzipTruncated,
    /// The gzip stream is damaged, or its checksum is wrong.
    #[error("the gzip file is damaged: its data or its checksum is wrong")]
    GzipCorrupt,
    /// More voxels than accepted.
    #[error("the image has {voxels} voxels, more than the limit of {limit}")]
    TooManyVoxels {
        /// How many there are (at most `u64::MAX` is said).
        voxels: u64,
        /// How many are accepted.
        limit: u64,
    },
    /// More bytes than accepted.
    #[error("the image takes {bytes} bytes unpacked, more than the limit of {limit}")]
    TooManyBytes {
        /// Bytes of all voxels.
        bytes: u64,
        /// How many are accepted.
        limit: u64,
    },
    /// The machine has no memory left.
    #[error("there is no memory left for {bytes} bytes of the image")]
    OutOfMemory {
        /// How many bytes were asked for.
        bytes: u64,
    },
    /// Too long a side to be written as NIfTI-1.
    #[error("a side of {side} voxels cannot be written as NIfTI-1, whose longest is 32767")]
    SideTooLong {
        /// Its voxels.
        side: usize,
    },
    /// A volume that NIfTI cannot express.
    #[error(
        "a volume whose intensities are scaled by {slope} and {intercept} cannot be written as NIfTI"
    )]
    Unwritable {
        /// Intensity per stored unit.
        slope: f32,
        /// Intensity of the stored value 0.
        intercept: f32,
    },
    /// What was read is no valid grid.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

impl ImagingError {
    /// A stable name of the error, in kebab-case, for programs to act on.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::NotNifti => "not-nifti",
            Self::Analyze => "analyze-unsupported",
            Self::NiftiHeaderOnly => "nifti-header-only",
            Self::NiftiHeader { .. } => "nifti-header",
            Self::NiftiTruncated { .. } => "nifti-truncated",
            Self::NiftiTrailingData { .. } => "nifti-trailing-data",
            Self::NiftiPromise { .. } => "nifti-promise",
            Self::NiftiDimension { .. } => "nifti-dimension",
            Self::NiftiNotAVolume { .. } => "nifti-not-a-volume",
            Self::NiftiSeveralVolumes { .. } => "nifti-several-volumes",
            Self::NiftiDataType { .. } => "nifti-data-type",
            Self::NiftiBitpix { .. } => "nifti-bitpix",
            Self::NiftiVoxOffset { .. } => "nifti-vox-offset",
            Self::NiftiUnits { .. } => "nifti-units",
            Self::NiftiOrientationUnknown => "nifti-orientation-unknown",
            Self::NiftiLeftRight => "nifti-left-right",
            Self::NiftiAffine { .. } => "nifti-affine",
            Self::NiftiScaling { .. } => "nifti-scaling",
            Self::NiftiIntensityRange { .. } => "nifti-intensity-range",
            Self::NiftiNonFinite { .. } => "nifti-non-finite",
            Self::GzipTruncated => "gzip-truncated",
            Self::GzipCorrupt => "gzip-corrupt",
            Self::TooManyVoxels { .. } => "too-many-voxels",
            Self::TooManyBytes { .. } => "too-many-bytes",
            Self::OutOfMemory { .. } => "out-of-memory",
            Self::SideTooLong { .. } => "side-too-long",
            Self::Unwritable { .. } => "unwritable",
            Self::Geometry(_) => "geometry",
        }
    }

    /// Whether the file is refused for its size alone: another server, or another limit, might take it.
    pub fn is_too_large(&self) -> bool {
        matches!(self, Self::TooManyVoxels { .. } | Self::TooManyBytes { .. })
    }
}
