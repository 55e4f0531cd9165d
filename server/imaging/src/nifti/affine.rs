//! Converts sform, qform and units of a header to an affine in patient space, and back.
//!
//! NIfTI uses RAS coordinates (x grows to the patient's right, y to the front). Results are in LPS.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

use crate::ImagingError;

/// The greatest relative difference between the sizes of voxels in the sform and in `pixdim`.
const SIZE_TOLERANCE: f64 = 0.01;

/// The greatest shear of an sform that stands beside a qform: the cosine between two of its axes.
const SHEAR_TOLERANCE: f64 = 1e-3;

/// The longest and the shortest edge of a voxel of a head in mm, if the header states another unit than mm.
const EDGES_IN_OTHER_UNITS_MM: [f64; 2] = [0.02, 20.0];

/// By how much rounding may make the vector part of a quaternion longer than 1.
const QUATERNION_TOLERANCE: f64 = 1e-3;

/// The greatest deviation of the axes of a grid from orthonormal for which a qform is written.
const ORTHOGONAL_TOLERANCE: f64 = 1e-6;

/// One of the two forms by which a header may place its voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Form {
    /// The affine of `srow_x`, `srow_y` and `srow_z`.
    Sform,
    /// The rotation of the quaternion and the sizes of `pixdim`.
    Qform,
}

impl Form {
    /// The name of the form, as in the headers of the standard.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The form of a name; `None` for any other text.
    pub fn of_name(name: &str) -> Option<Self> {
        [Self::Sform, Self::Qform]
            .into_iter()
            .find(|form| form.name() == name)
    }
}

/// The entries of a header that define the positions of the voxels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Placement {
    /// `xyzt_units`; the lowest three bits are the unit of length.
    pub(crate) units: u8,
    /// Edge lengths in `[1..=3]`; the sign of `[0]` is the qform's handedness, `qfac`.
    pub(crate) pixdim: [f64; 8],
    pub(crate) qform_code: i32,
    pub(crate) sform_code: i32,
    /// `quatern_b`, `quatern_c` and `quatern_d`.
    pub(crate) quaternion: [f64; 3],
    pub(crate) qoffset: [f64; 3],
    /// `srow_x`, `srow_y` and `srow_z`.
    pub(crate) srow: [[f64; 4]; 3],
}

impl Placement {
    /// The affine from voxel indices to LPS millimetres: the sform, or the qform if there is no sform.
    ///
    /// # Errors
    /// If there is neither, if the two contradict each other about left, sizes or angles, or if the chosen one is unusable.
    pub(crate) fn patient_from_voxel(&self) -> Result<DAffine3, ImagingError> {
        let scale = self.millimetres_per_unit()?;
        if self.pixdim[1..4].iter().any(|edge| !edge.is_finite()) {
            return Err(unusable("pixdim", "an edge of a voxel is not finite"));
        }
        let ras_from_voxel = match (self.sform_code > 0, self.qform_code > 0) {
            (true, true) => {
                let sform = self.sform()?;
                if let Ok(qform) = self.qform() {
                    check_that_left_is_left(sform, qform)?;
                }
                self.check_agreement(sform)?;
                sform
            }
            (true, false) => {
                let sform = self.sform()?;
                self.check_agreement(sform)?;
                sform
            }
            (false, true) => self.qform()?,
            (false, false) => return Err(ImagingError::NiftiOrientationUnknown),
        };
        self.check_unit(ras_from_voxel, scale)?;
        Ok(DAffine3::from_scale(DVec3::splat(scale)) * lps_from_ras() * ras_from_voxel)
    }

    /// Whether the form that places the voxels has the code of the scanner's space.
    pub(crate) fn is_in_scanner_space(&self) -> bool {
        const SCANNER: i32 = 1;
        match self.sform_code {
            1.. => self.sform_code == SCANNER,
            _ => self.qform_code == SCANNER,
        }
    }

    /// The entries with one of the two forms alone; `pixdim` then has its sizes.
    ///
    /// # Errors
    /// If the header does not have the form, or it is unusable.
    pub(crate) fn keeping(&self, form: Form) -> Result<Self, ImagingError> {
        let mut kept = self.clone();
        let code = match form {
            Form::Sform => {
                kept.qform_code = 0;
                self.sform_code
            }
            Form::Qform => {
                kept.sform_code = 0;
                self.qform_code
            }
        };
        if code <= 0 {
            return Err(ImagingError::NiftiFormMissing { form: form.name() });
        }
        if form == Form::Sform {
            let axes = self.sform()?.matrix3;
            for axis in 0..3 {
                kept.pixdim[axis + 1] = axes.col(axis).length();
            }
        }
        kept.patient_from_voxel().map(|_| kept)
    }

    /// Checks that the sform has the sizes of `pixdim`, and right angles if there is a qform, which always has them.
    fn check_agreement(&self, sform: DAffine3) -> Result<(), ImagingError> {
        let sizes = [0, 1, 2].map(|axis| sform.matrix3.col(axis).length());
        let stated = [1, 2, 3].map(|axis| self.pixdim[axis]);
        let has_qform = self.qform_code > 0;
        // Zero states nothing.
        let differs = |(size, stated): (f64, f64)| {
            stated > 0.0 && (size - stated).abs() > SIZE_TOLERANCE * stated
        };
        let are_other_sizes = sizes.into_iter().zip(stated).any(differs);
        let shear = shear(sform.matrix3);
        if !(are_other_sizes || has_qform && shear > SHEAR_TOLERANCE) {
            return Ok(());
        }
        let scale = self.millimetres_per_unit()?;
        Err(ImagingError::NiftiFormsContradict {
            sform_mm: sizes.map(|size| size * scale),
            lean_degrees: shear.asin().to_degrees(),
            pixdim_mm: stated.map(|size| size * scale),
            has_qform,
        })
    }

    /// Metres or micrometres that make voxels of an impossible size are a mistake.
    fn check_unit(&self, ras_from_voxel: DAffine3, scale: f64) -> Result<(), ImagingError> {
        let axes = ras_from_voxel.matrix3;
        let [least, most] = EDGES_IN_OTHER_UNITS_MM;
        let edges = [0, 1, 2].map(|axis| axes.col(axis).length());
        let is_odd = |edge: &f64| !(least..=most).contains(&(edge * scale));
        match edges.into_iter().find(is_odd) {
            Some(edge) if scale != 1.0 => Err(ImagingError::NiftiUnitImplausible {
                unit: if scale > 1.0 { "metres" } else { "micrometres" },
                edge,
                edge_mm: edge * scale,
            }),
            _ => Ok(()),
        }
    }

    fn millimetres_per_unit(&self) -> Result<f64, ImagingError> {
        match self.units & 7 {
            0 | 2 => Ok(1.0),
            1 => Ok(1000.0),
            3 => Ok(0.001),
            code => Err(ImagingError::NiftiUnits { code }),
        }
    }

    fn sform(&self) -> Result<DAffine3, ImagingError> {
        let rows = self.srow.map(|[x, y, z, _]| DVec3::new(x, y, z));
        let affine = DAffine3 {
            matrix3: DMat3::from_cols_array_2d(&rows.map(|row| row.to_array())).transpose(),
            translation: DVec3::from_array(self.srow.map(|row| row[3])),
        };
        let has_qform = self.qform_code > 0 && self.qform().is_ok();
        check_affine("sform", affine).map_err(|error| match error {
            ImagingError::NiftiAffine { what, .. } if has_qform => {
                ImagingError::NiftiSformUnusable { what }
            }
            error => error,
        })
    }

    /// The rotation of a unit quaternion with three stored components, times the edges (`nifti1.h`, "method 2").
    fn qform(&self) -> Result<DAffine3, ImagingError> {
        let [x, y, z] = [1, 2, 3].map(|axis| self.pixdim[axis]);
        if [x, y, z].iter().any(|&edge| edge <= 0.0) {
            return Err(unusable("qform", "an edge of a voxel is not positive"));
        }
        if self.pixdim[0].is_nan() {
            return Err(unusable("qform", "its handedness is not a number"));
        }
        let handedness = if self.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
        let edges = DMat3::from_diagonal(DVec3::new(x, y, handedness * z));
        let affine = DAffine3 {
            matrix3: DMat3::from_quat(unit_quaternion(self.quaternion)?) * edges,
            translation: DVec3::from_array(self.qoffset),
        };
        check_affine("qform", affine)
    }

    /// The header entries for `patient_from_voxel` (LPS mm).
    ///
    /// The sform always contains it. If the axes are orthogonal, the qform does too; otherwise its code is 0.
    pub(crate) fn from_patient(patient_from_voxel: DAffine3) -> Self {
        let ras_from_voxel = lps_from_ras() * patient_from_voxel;
        let axes = ras_from_voxel.matrix3;
        let edges = [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::length);
        let qfac = axes.determinant().signum();
        let upright = DMat3::from_cols(
            axes.x_axis / edges[0],
            axes.y_axis / edges[1],
            axes.z_axis / edges[2] * qfac,
        );
        let excess = upright.transpose() * upright - DMat3::IDENTITY;
        let orthogonal = excess.abs_diff_eq(DMat3::ZERO, ORTHOGONAL_TOLERANCE);
        let quaternion = DQuat::from_mat3(&upright).normalize();
        let quaternion = if quaternion.w < 0.0 {
            -quaternion
        } else {
            quaternion
        };
        let offset = ras_from_voxel.translation;
        Self {
            units: 2,
            pixdim: [qfac, edges[0], edges[1], edges[2], 0.0, 0.0, 0.0, 0.0],
            qform_code: i32::from(orthogonal),
            sform_code: 1,
            quaternion: if orthogonal {
                quaternion.xyz().to_array()
            } else {
                [0.0; 3]
            },
            qoffset: if orthogonal {
                offset.to_array()
            } else {
                [0.0; 3]
            },
            srow: std::array::from_fn(|row| {
                let [x, y, z] = axes.row(row).to_array();
                [x, y, z, offset[row]]
            }),
        }
    }
}

/// The greatest cosine between two axes; 0 if all are perpendicular.
fn shear(axes: DMat3) -> f64 {
    let unit = [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::normalize);
    let cosine = |a: usize, b: usize| unit[a].dot(unit[b]).abs();
    cosine(0, 1).max(cosine(0, 2)).max(cosine(1, 2)).min(1.0)
}

/// Flips between RAS and LPS; its own inverse.
pub fn lps_from_ras() -> DAffine3 {
    DAffine3::from_scale(DVec3::new(-1.0, -1.0, 1.0))
}

/// The unit quaternion with the given vector part and a non-negative real part.
fn unit_quaternion(vector_part: [f64; 3]) -> Result<DQuat, ImagingError> {
    let [b, c, d] = vector_part;
    let squared = b * b + c * c + d * d;
    let too_long = squared > 1.0 + QUATERNION_TOLERANCE;
    if too_long || !squared.is_finite() {
        return Err(unusable("qform", "its quaternion is not of unit length"));
    }
    let a = f64::max(1.0 - squared, 0.0).sqrt();
    Ok(DQuat::from_xyzw(b, c, d, a).normalize())
}

/// Checks that an affine is finite and invertible.
fn check_affine(form: &'static str, affine: DAffine3) -> Result<DAffine3, ImagingError> {
    if !affine.is_finite() {
        return Err(unusable(form, "it is not finite"));
    }
    let axes = affine.matrix3;
    if axes.determinant() == 0.0 {
        return Err(unusable(form, "it maps all voxels to one plane"));
    }
    Ok(affine)
}

/// The sform and the qform may differ by a movement of the head, but left in one must not be right in the other.
fn check_that_left_is_left(sform: DAffine3, qform: DAffine3) -> Result<(), ImagingError> {
    let sform_from_qform = sform.matrix3 * qform.matrix3.inverse();
    if sform_from_qform.determinant() > 0.0 && sform_from_qform.x_axis.x > 0.0 {
        Ok(())
    } else {
        Err(ImagingError::NiftiLeftRight)
    }
}

fn unusable(form: &'static str, what: &'static str) -> ImagingError {
    ImagingError::NiftiAffine { form, what }
}
