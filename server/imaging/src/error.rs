//! What can be wrong with a file.

use geometry::GeometryError;

/// What to do about a header that a program wrote wrongly.
const SAVE_AGAIN: &str = "save the file again with nibabel, dcm2niix or fslmaths";

/// Why a file was rejected or could not be written.
///
/// Messages contain numbers from the header and names from the standard, never texts from the file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ImagingError {
    /// Neither a NIfTI-1 nor a NIfTI-2 header, gzipped or not.
    #[error(
        "this is {found}, and not a NIfTI file; send a NIfTI or MGH volume (.nii, .nii.gz, .mgh or .mgz), DICOM files, or a zip of DICOM files"
    )]
    NotNifti {
        /// What it is instead, as far as its first bytes tell.
        found: &'static str,
    },
    /// An Analyze 7.5 header, which does not state which side is left.
    #[error(
        "this is an Analyze 7.5 image, which does not state which side of the head is left; convert the original images to NIfTI"
    )]
    Analyze,
    /// The header of a pair of files, `.hdr` and `.img`.
    #[error(
        "this is the header of a .hdr/.img pair without its voxels; save it as a single .nii file"
    )]
    NiftiHeaderOnly,
    /// A header of the right size without the magic word of NIfTI, or the reverse.
    #[error("the NIfTI header is damaged: {what}; {SAVE_AGAIN}")]
    NiftiHeader {
        /// What is wrong with it.
        what: &'static str,
    },
    /// The file ends early.
    #[error("the file is truncated: it has {found} of {expected} bytes")]
    NiftiTruncated {
        /// Bytes of header and voxels.
        expected: u64,
        /// Bytes of the unpacked file.
        found: u64,
    },
    /// Bytes follow the last voxel.
    #[error(
        "the file is longer by at least a slice than the {expected} bytes that its header describes; {SAVE_AGAIN}"
    )]
    NiftiTrailingData {
        /// Bytes of header and voxels.
        expected: u64,
    },
    /// The header describes more bytes than the gzip stream can contain.
    #[error("the header describes {promised} bytes, more than {packed} bytes of gzip can contain")]
    NiftiPromise {
        /// Bytes of header and voxels.
        promised: u64,
        /// Bytes of the gzip stream.
        packed: u64,
    },
    /// An impossible size in the header.
    #[error("dim[{axis}] of the header is {value}; it must be {range}; {SAVE_AGAIN}")]
    NiftiDimension {
        /// The index in `dim`; 0 is the number of dimensions.
        axis: usize,
        /// Its value.
        value: i64,
        /// The accepted values, in words.
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
    #[error("the file contains {count} volumes; send a single one")]
    NiftiSeveralVolumes {
        /// Number of volumes.
        count: u64,
    },
    /// An unsupported or unknown data type.
    #[error(
        "NIfTI data type {code} ({name}) is not supported; use integers or floating-point numbers of up to 64 bits"
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
    /// The voxels do not start after the header.
    #[error(
        "vox_offset of the NIfTI header is {value}; it must be 0 or a whole number from {least} to {most}; {SAVE_AGAIN}"
    )]
    NiftiVoxOffset {
        /// The value in the header.
        value: f64,
        /// The smallest possible value.
        least: u64,
        /// The greatest accepted value.
        most: u64,
    },
    /// An unknown unit of length.
    #[error(
        "the NIfTI header has the unknown unit of length {code}; use metres, millimetres or micrometres"
    )]
    NiftiUnits {
        /// The code of the unit.
        code: u8,
    },
    /// A unit of length that makes voxels of an impossible size.
    #[error(
        "an edge of a voxel is {} mm, because the NIfTI header states {} {unit} (xyzt_units); if it is {} mm, set the unit to millimetres",
        short(*edge_mm), short(*edge), short(*edge)
    )]
    NiftiUnitImplausible {
        /// The unit.
        unit: &'static str,
        /// The edge in that unit.
        edge: f64,
        /// The edge in mm.
        edge_mm: f64,
    },
    /// The sform, and `pixdim` with the qform, state other sizes or angles.
    #[error(
        "the header contradicts itself: by its sform a voxel measures {} mm{}, by its pixdim{} {} mm with right angles; \
         find out which is true, and send it as `affine`: {}",
        product(*sform_mm), lean(*lean_degrees), if *has_qform { " and qform" } else { "" }, product(*pixdim_mm),
        if *has_qform { "`sform` or `qform`" } else { "`sform`, or correct the header" }
    )]
    NiftiFormsContradict {
        /// The sizes of a voxel by the sform, in mm.
        sform_mm: [f64; 3],
        /// How far the axes of the sform are from right angles.
        lean_degrees: f64,
        /// The sizes of a voxel by `pixdim`, in mm.
        pixdim_mm: [f64; 3],
        /// Whether there is a qform.
        has_qform: bool,
    },
    /// An unusable sform beside a sound qform.
    #[error(
        "the sform of the NIfTI header is unusable: {what}; send `affine` as `qform`, or set sform_code to 0, to use its qform"
    )]
    NiftiSformUnusable {
        /// What is wrong with it.
        what: &'static str,
    },
    /// The form that was asked for is not there.
    #[error("`affine` is `{form}`, but the header has no {form} (its code is 0); omit `affine`")]
    NiftiFormMissing {
        /// `sform` or `qform`.
        form: &'static str,
    },
    /// Neither an sform nor a qform.
    #[error(
        "the NIfTI header does not state which side of the head is left: it has neither a qform nor an sform"
    )]
    NiftiOrientationUnknown,
    /// The sform and the qform place left on opposite sides.
    #[error(
        "the sform and the qform of the NIfTI header disagree about which side of the head is left"
    )]
    NiftiLeftRight,
    /// The affine from voxels to the patient is not invertible.
    #[error("the {form} of the header is unusable: {what}")]
    NiftiAffine {
        /// `sform`, `qform` or `pixdim`.
        form: &'static str,
        /// What is wrong with it.
        what: &'static str,
    },
    /// Slope or intercept is not a number.
    #[error(
        "the NIfTI header has the scaling slope {slope} and intercept {intercept}; both must be finite"
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
    /// An MGH data type that is not read.
    #[error(
        "MGH data type {code} is not supported; use 0 (uchar), 1 (int), 3 (float), 4 (short) or 10 (ushort)"
    )]
    MghDataType {
        /// The code in the header.
        code: i32,
    },
    /// The gzip stream ends early.
    #[error("the gzip file is truncated; send a complete copy")]
    GzipTruncated,
    /// The gzip stream is damaged, or its checksum is wrong.
    #[error("the gzip file is damaged: its data or its checksum is wrong")]
    GzipCorrupt,
    /// More voxels than the limit.
    #[error("the image has {voxels} voxels, more than the limit of {limit}")]
    TooManyVoxels {
        /// Number of voxels, saturated at `u64::MAX`.
        voxels: u64,
        /// The limit.
        limit: u64,
    },
    /// More bytes than the limit.
    #[error("the image takes {bytes} bytes unpacked, more than the limit of {limit}")]
    TooManyBytes {
        /// Bytes of all voxels.
        bytes: u64,
        /// The limit.
        limit: u64,
    },
    /// Memory is short.
    #[error("there is not enough memory for {bytes} bytes of the image")]
    OutOfMemory {
        /// Number of bytes requested.
        bytes: u64,
    },
    /// A side is too long for NIfTI-1.
    #[error("a side of {side} voxels cannot be written as NIfTI-1; the limit is 32767")]
    SideTooLong {
        /// Number of voxels along it.
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
    /// The header has no valid grid.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

/// A number with at most four decimals.
fn short(number: f64) -> f64 {
    (number * 1e4).round() / 1e4
}

fn product(numbers: [f64; 3]) -> String {
    numbers.map(|number| short(number).to_string()).join(" × ")
}

fn lean(degrees: f64) -> String {
    match degrees {
        0.05.. => format!(" and its axes lean by {degrees:.1}°"),
        _ => String::new(),
    }
}

impl ImagingError {
    /// A stable name of the error, in kebab-case, for programs to act on.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::NotNifti { .. } => "not-nifti",
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
            Self::NiftiUnitImplausible { .. } => "nifti-units",
            Self::NiftiFormsContradict { .. } => "nifti-forms-contradict",
            Self::NiftiSformUnusable { .. } => "nifti-affine",
            Self::NiftiFormMissing { .. } => "nifti-form-missing",
            Self::NiftiOrientationUnknown => "nifti-orientation-unknown",
            Self::NiftiLeftRight => "nifti-left-right",
            Self::NiftiAffine { .. } => "nifti-affine",
            Self::NiftiScaling { .. } => "nifti-scaling",
            Self::NiftiIntensityRange { .. } => "nifti-intensity-range",
            Self::MghDataType { .. } => "nifti-data-type",
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

    /// Whether the file is rejected because of its size alone; with a higher limit it might be accepted.
    pub fn is_too_large(&self) -> bool {
        matches!(self, Self::TooManyVoxels { .. } | Self::TooManyBytes { .. })
    }
}
