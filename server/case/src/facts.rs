//! The facts about a case.

use std::collections::BTreeSet;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::images::Closed;
use crate::{CaseId, CaseState, Failure, Parameters, Progress, Quality, Stage};

/// A DICOM window: the intensities from `center - width / 2` to `center + width / 2` span the grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WindowFacts {
    /// Window centre, in intensities.
    pub center: f32,
    /// Window width, in intensities; above 0.
    pub width: f32,
}

/// A sphere in the patient.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = SphereView))]
pub struct SphereFacts {
    /// Its centre, LPS mm.
    pub center_in_patient: [f64; 3],
    /// Its radius.
    pub radius_mm: f64,
}

/// A plane in the patient: the points `p` with `normal · p = offset_mm`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = PlaneView))]
pub struct PlaneFacts {
    /// The unit normal, towards the patient's left, LPS.
    pub normal: [f64; 3],
    /// Its distance from the origin of patient space, along the normal.
    pub offset_mm: f64,
    /// The correlation of the intensities in the head with those at their mirror images, 0 to 1.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
    pub correlation: f64,
    /// Whether the correlation is below 0.5: the plane may be wrong.
    pub doubtful: bool,
}

/// A face of the volume that cuts the brain, or a plane within it beyond which it is constant: the points `p` (LPS mm) with
/// `normal · p = offset_mm`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CutFacts {
    /// The side of the patient: `left`, `right`, `posterior`, `anterior`, `superior` or `inferior`.
    pub face: String,
    /// Its unit normal, LPS, which points to the brain.
    pub normal: [f64; 3],
    /// Its distance from the origin along the normal, in mm.
    pub offset_mm: f64,
}

/// What tells acquired voxels from others, whatever the header states about their axes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct VoxelFacts {
    /// BLAKE3 of the histogram of the stored values, in 64 hexadecimal digits: the same for any order of the voxels.
    pub values: String,
    /// Digests of the sums of the planes across the axes nearest to right, anterior and superior, in their order and in reverse:
    /// the same if the voxels are stored in another order, and exchanged with each other if one of two headers exchanges or
    /// reverses axes.
    pub profiles: [[u64; 2]; 3],
    /// How many voxels were not finite numbers, and became 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub not_finite: u64,
    /// How many voxels lay so far beyond all others that they became the end of the range.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub clipped: u64,
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde passes a reference"
)]
pub(crate) fn is_zero(count: &u64) -> bool {
    *count == 0
}

impl VoxelFacts {
    /// Whether one of two headers exchanges or reverses axes of the same voxels. Voxels that lie elsewhere for another reason, such
    /// as a shift, are not the same picture.
    pub fn has_other_axes(&self, other: &Self) -> bool {
        let in_any_order = |facts: &Self| {
            let mut profiles = facts.profiles;
            profiles.iter_mut().for_each(|both| both.sort_unstable());
            profiles.sort_unstable();
            profiles
        };
        self.values == other.values
            && self.profiles != other.profiles
            && in_any_order(self) == in_any_order(other)
    }
}

/// The facts about a case that is ready.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseFacts {
    /// Size of the working grid along L, P and S, in voxels.
    pub grid_size: [usize; 3],
    /// Edge of a voxel of the working grid, in mm.
    pub spacing_mm: f64,
    /// Rows of the affine from voxels of the working grid to LPS mm.
    pub patient_from_voxel: [[f64; 4]; 4],
    /// Size of the acquired volume in voxels.
    pub native_size: [usize; 3],
    /// Edges of a voxel of the acquired volume, in mm.
    pub native_spacing_mm: [f64; 3],
    /// Rows of the affine from voxels of the acquired volume to LPS mm.
    pub native_patient_from_voxel: [[f64; 4]; 4],
    /// The acquired voxels; `None` for a case prepared by a version that did not tell them apart.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voxels: Option<VoxelFacts>,
    /// The sphere around the envelope that zoom 1 fits into a picture.
    pub envelope_sphere: SphereFacts,
    /// The plane between the hemispheres.
    pub midsagittal: PlaneFacts,
    /// The faces of the volume that cut the brain, and planes within it beyond which it is constant. They are not dura: a voxel
    /// nearer to one than its depth has an unknown depth.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cuts: Vec<CutFacts>,
    /// The version of the preparation: 3 handles cuts at faces of the volume and planes within it beyond which it is constant.
    pub pipeline: u32,
    /// Depth of the deepest voxel, in mm.
    pub max_depth_mm: f32,
    /// Volume enclosed by the envelope, in ml.
    pub envelope_ml: f64,
    /// Least intensity of the stored volume.
    pub intensity_min: f32,
    /// Greatest intensity of the stored volume.
    pub intensity_max: f32,
    /// The default window: 2nd to 98th percentile inside the envelope.
    pub window: WindowFacts,
    /// The quality of the mask; every stored case has it.
    pub quality: Option<Quality>,
    /// Facts about the DICOM files, if the volume comes from DICOM.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dicom: Option<DicomFacts>,
    /// Wall-clock time of each stage of the preparation, in ms.
    pub timings: Vec<(Stage, f64)>,
}

/// Facts about the DICOM files of a volume that may be shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DicomFacts {
    /// Numbers of the missing slices that were interpolated, from 1.
    pub interpolated_slices: Vec<usize>,
    /// The scanner's name of the sequence and its times in ms; `None` if the files name none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sequence: Option<String>,
    /// The number of the series; `None` if the files state none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub series_number: Option<i64>,
    /// The numbers of the images that are the slices; empty if the files do not number them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub images: Vec<ImageRun>,
}

/// Neighbouring slices of a volume. The numbers of their images are evenly spaced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ImageRun {
    /// The number of the first slice, from 1.
    pub slice: usize,
    /// The number of slices.
    pub count: usize,
    /// The number of the first slice's image.
    pub number: i64,
    /// What the number grows by from one slice to the next; negative if the images count the other way.
    pub step: i64,
}

impl ImageRun {
    /// Joins slices with the numbers of their images, in the order of the slices. The result is empty if two images have the
    /// same number.
    pub fn join(numbered: &[(usize, i32)]) -> Vec<Self> {
        let numbers: BTreeSet<i32> = numbered.iter().map(|&(_, number)| number).collect();
        if numbers.len() < numbered.len() {
            return Vec::new();
        }
        let mut runs: Vec<Self> = Vec::new();
        for &(slice, number) in numbered {
            let number = i64::from(number);
            match runs.last_mut() {
                Some(run) if run.accepts(slice, number) => {
                    run.step = (number - run.number) / run.count as i64;
                    run.count += 1;
                }
                _ => runs.push(Self {
                    slice,
                    count: 1,
                    number,
                    step: 0,
                }),
            }
        }
        runs
    }

    /// Whether a slice continues the run. The second slice defines its step.
    fn accepts(&self, slice: usize, number: i64) -> bool {
        let is_next = slice == self.slice + self.count;
        is_next && (self.count == 1 || number - self.number == self.step * self.count as i64)
    }
}

/// A case, as stored in its row.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case {
    pub id: CaseId,
    /// The parameters of the upload, including the label.
    pub parameters: Parameters,
    pub state: CaseState,
    /// Its progress, during the preparation.
    pub progress: Option<Progress>,
    /// The failure, if it has failed.
    pub failure: Option<Failure>,
    /// The facts, if it is ready.
    pub facts: Option<CaseFacts>,
    /// The case it is a version of, with another mask or other parameters.
    pub previous: Option<CaseId>,
    /// Its own versions, oldest first.
    pub next: Vec<CaseId>,
    /// The time of the first upload.
    pub created_at: Timestamp,
    /// The time of the latest upload of the same input. Its age counts from then.
    pub uploaded_at: Timestamp,
    /// Why it is closed, if it is.
    pub closed: Option<Closed>,
    /// Whether it is never removed because of its age.
    pub kept: bool,
    /// Whether it is in the trash: lists leave it out, and its address shows it.
    pub trashed: bool,
    /// When it will be removed because of its age; `None` if never. A store sets this, not its rows.
    pub expires_at: Option<Timestamp>,
}

/// What to change about a case.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = CasePatch))]
#[serde(deny_unknown_fields)]
pub struct CaseChange {
    /// Whether to keep it, whatever its age.
    pub kept: Option<bool>,
    /// Another label: at most 200 characters, without control characters.
    pub name: Option<String>,
    /// Whether to put it into the trash, or to take it out.
    pub trashed: Option<bool>,
}

impl Case {
    /// What no two cases have in common, for people: the label, the day of the upload (UTC) and the first digits of the id.
    ///
    /// The label is what a user gave, never an identity out of DICOM.
    pub fn identity(&self) -> String {
        self.identity_with(|day| format!("added {day}"))
    }

    /// The same in another language: `added` says of a day, as `2026-03-01`, that the case was added then.
    pub fn identity_with(&self, added: impl Fn(&str) -> String) -> String {
        let id = self.id.to_string();
        let day = added(&self.created_at.strftime("%Y-%m-%d").to_string());
        let parts = [self.parameters.name.as_deref(), Some(&day), Some(&id[..8])];
        parts.into_iter().flatten().collect::<Vec<_>>().join(" · ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_images_are_joined_while_they_are_evenly_spaced() {
        let run = |slice, count, number, step| ImageRun {
            slice,
            count,
            number,
            step,
        };
        let joined = |numbers: &[(usize, i32)]| ImageRun::join(numbers);
        assert_eq!(joined(&[(1, 5), (2, 4), (3, 3)]), [run(1, 3, 5, -1)]);
        assert_eq!(
            joined(&[(1, 1), (2, 3), (4, 5), (5, 2), (6, 4)]),
            [run(1, 2, 1, 2), run(4, 2, 5, -3), run(6, 1, 4, 0)],
            "an interpolated slice belongs to none"
        );
        assert_eq!(
            joined(&[(1, 0), (2, 0), (3, 0)]),
            [],
            "images without numbers"
        );
        assert_eq!(joined(&[]), []);
        let far = joined(&[(1, i32::MIN), (2, i32::MAX), (3, 0)]);
        assert_eq!(
            far,
            [run(1, 2, i32::MIN.into(), u32::MAX.into()), run(3, 1, 0, 0)]
        );
    }

    #[test]
    fn a_case_is_told_by_label_day_and_the_first_digits_of_its_id() {
        let case = Case {
            id: CaseId::parse("0123456789abcdef0123456789abcdef").unwrap(),
            parameters: Parameters {
                name: Some("A head".to_owned()),
                ..Parameters::default()
            },
            state: CaseState::Queued,
            progress: None,
            failure: None,
            facts: None,
            previous: None,
            next: Vec::new(),
            created_at: "2026-03-01T23:59:59Z".parse().unwrap(),
            uploaded_at: "2026-03-02T00:00:00Z".parse().unwrap(),
            closed: None,
            kept: false,
            trashed: false,
            expires_at: None,
        };
        assert_eq!(case.identity(), "A head · added 2026-03-01 · 01234567");
        let parameters = Parameters::default();
        let unnamed = Case { parameters, ..case };
        assert_eq!(unnamed.identity(), "added 2026-03-01 · 01234567");
    }
}
