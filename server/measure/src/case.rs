//! A head, prepared with a clock beside every step.

use std::fmt;

use geometry::{
    BrainMask, DepthField, DistanceMap, EnvelopeMesh, Forest, MeshSize, PathTable, Paths,
    ShellIndex, Volume, distance_map, envelope, envelope_mesh, forest, path_table,
};
use render::gpu::{CaseKey, GpuCase};
use render::{BoundingSphere, Scene, Window};

use crate::head::Scan;
use crate::{Cost, Costs, Head, MeasureError, timed};

/// How much the field is smoothed for normals, in voxels, as the service does.
const NORMAL_SIGMA_VOXELS: f32 = 1.5;
/// Voxels of the volume kept around the working grid, as the service does.
const CROP_MARGIN_VOXELS: usize = 1;

/// A step of the preparation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// From the bytes of the files to volume and mask.
    Reading,
    /// The mask to the working grid.
    Mask,
    /// The envelope: the closing of the mask.
    Closing,
    /// The part of the volume around the envelope.
    Crop,
    /// The exact distance map.
    Distance,
    /// The regional maxima.
    Core,
    /// The optimal paths.
    Forest,
    /// The depth between voxel centres.
    Field,
    /// The envelope's mesh of 1,800 triangles.
    Mesh,
    /// The table of all its depths.
    Table,
    /// The voxels sorted by depth.
    Shell,
    /// The smoothed depth, for normals.
    Normals,
}

impl Step {
    /// All steps in their order.
    pub const ALL: [Self; 12] = [
        Self::Reading,
        Self::Mask,
        Self::Closing,
        Self::Crop,
        Self::Distance,
        Self::Core,
        Self::Forest,
        Self::Field,
        Self::Mesh,
        Self::Table,
        Self::Shell,
        Self::Normals,
    ];

    /// What voxel projection needs before its first picture (the setup of the paper's Table 3). The facets need every step (its Table 2).
    pub fn is_for_voxels(self) -> bool {
        !matches!(self, Self::Core | Self::Forest | Self::Mesh | Self::Table)
    }
}

impl fmt::Display for Step {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Reading => "reading both files",
            Self::Mask => "mask to the working grid",
            Self::Closing => "closing to the envelope",
            Self::Crop => "crop of the volume",
            Self::Distance => "exact distance map",
            Self::Core => "core",
            Self::Forest => "forest",
            Self::Field => "depth field",
            Self::Mesh => "envelope mesh",
            Self::Table => "table of paths",
            Self::Shell => "shell index",
            Self::Normals => "smoothed field, for normals",
        })
    }
}

/// What each step took.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepCosts([Cost; Step::ALL.len()]);

impl StepCosts {
    /// Of one step.
    pub fn of(&self, step: Step) -> Cost {
        self.0[step as usize]
    }

    /// Of all steps that `are` meant, one after the other.
    pub fn sum(&self, are: impl Fn(Step) -> bool) -> Cost {
        let zero = Cost {
            wall_s: 0.0,
            cpu_s: Some(0.0),
        };
        let meant = Step::ALL.into_iter().filter(|&step| are(step));
        meant.fold(zero, |sum, step| sum.and(self.of(step)))
    }

    fn time<T>(&mut self, step: Step, work: impl FnOnce() -> T) -> T {
        let (result, cost) = timed(work);
        self.0[step as usize] = cost;
        result
    }
}

/// The costs of one sum of steps over several preparations.
pub(crate) fn sums(runs: &[StepCosts], are: impl Fn(Step) -> bool) -> Costs {
    runs.iter().map(|costs| costs.sum(&are)).collect()
}

/// All that is asked of a prepared head.
#[derive(Debug)]
pub struct MeasuredCase {
    /// The volume around the envelope.
    pub volume: Volume,
    /// The distance map, with the envelope.
    pub distance: DistanceMap,
    /// The optimal paths.
    pub forest: Forest,
    /// The depth between voxel centres.
    pub field: DepthField,
    /// The same, smoothed.
    pub normals: DepthField,
    /// The voxels by depth.
    pub shell: ShellIndex,
    /// What the camera looks at.
    pub bounds: BoundingSphere,
    /// The default window of its pictures.
    pub window: Window,
    /// Voxels of the volume as it came.
    pub volume_voxels: usize,
    key: CaseKey,
}

impl MeasuredCase {
    /// Prepares a head and says what each step took.
    ///
    /// # Errors
    /// When a file is not sound or the head has no usable envelope.
    pub fn prepare(head: &Head, closing_radius_mm: f64) -> Result<(Self, StepCosts), MeasureError> {
        let mut costs = StepCosts::default();
        let (volume, mask) = costs.time(Step::Reading, || head.read())?;
        let case = Self::of_scan(&Scan { volume, mask }, closing_radius_mm, &mut costs)?;
        Ok((case, costs))
    }

    /// Prepares what was read.
    pub(crate) fn of_scan(
        scan: &Scan,
        closing_radius_mm: f64,
        costs: &mut StepCosts,
    ) -> Result<Self, MeasureError> {
        let grid = scan.volume.grid();
        let brain = costs.time(Step::Mask, || BrainMask::from_mask(&scan.mask, grid))?;
        let envelope = costs.time(Step::Closing, || envelope(&brain, closing_radius_mm))?;
        drop(brain);
        let volume = costs
            .time(Step::Crop, || {
                scan.volume.crop_to(envelope.grid(), CROP_MARGIN_VOXELS)
            })
            .ok_or(MeasureError::MaskOutsideVolume)?;
        let distance = costs.time(Step::Distance, || distance_map(&envelope));
        let core = costs.time(Step::Core, || geometry::core(&distance));
        let forest = costs.time(Step::Forest, || forest(&distance, &core));
        let field = costs.time(Step::Field, || DepthField::new(&distance));
        let mesh = costs.time(Step::Mesh, || envelope_mesh(&field, MeshSize::STANDARD))?;
        costs.time(Step::Table, || {
            path_table(&mesh, &distance, &field, Paths::Forest(&forest))
        });
        let shell = costs.time(Step::Shell, || ShellIndex::new(&distance));
        let normals = costs.time(Step::Normals, || field.smoothed(NORMAL_SIGMA_VOXELS));
        let [least, greatest] = volume.intensity_range();
        let [black, white] = volume
            .percentiles_inside(distance.envelope(), [0.02, 0.98])
            .unwrap_or([least, greatest]);
        Ok(Self {
            bounds: BoundingSphere::of_envelope(&shell),
            window: Window::between(black, white),
            volume_voxels: grid.voxel_count(),
            key: next_key(),
            volume,
            distance,
            forest,
            field,
            normals,
            shell,
        })
    }

    /// Voxels of the envelope.
    pub fn inside_voxels(&self) -> usize {
        self.shell.voxels().len()
    }

    /// The mesh of the envelope and the table of its vertices' paths along the forest.
    ///
    /// # Errors
    /// When the envelope is too small to be cut.
    pub fn table(&self, size: MeshSize) -> Result<(EnvelopeMesh, PathTable), MeasureError> {
        let mesh = envelope_mesh(&self.field, size)?;
        let table = self.table_of(&mesh);
        Ok((mesh, table))
    }

    /// The table of the paths of a mesh's vertices along the forest.
    pub fn table_of(&self, mesh: &EnvelopeMesh) -> PathTable {
        path_table(
            mesh,
            &self.distance,
            &self.field,
            Paths::Forest(&self.forest),
        )
    }
}

impl GpuCase for MeasuredCase {
    fn key(&self) -> CaseKey {
        self.key
    }

    fn scene(&self) -> Scene<'_> {
        Scene {
            volume: &self.volume,
            field: &self.field,
            normals: &self.normals,
            shell: &self.shell,
            bounds: self.bounds,
        }
    }
}

/// A key that no other case of this process has.
fn next_key() -> CaseKey {
    use std::sync::atomic::{AtomicU64, Ordering};
    static NEXT: AtomicU64 = AtomicU64::new(0);
    CaseKey(u128::from(NEXT.fetch_add(1, Ordering::Relaxed)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_of_a_preparation_is_timed() {
        let head = Head::phantom(4.0).unwrap();
        let (case, costs) = MeasuredCase::prepare(&head, 10.0).unwrap();
        assert!(Step::ALL.iter().all(|&step| costs.of(step).wall_s > 0.0));
        assert!(case.inside_voxels() > 10_000);
        let all = costs.sum(|_| true).wall_s;
        let voxels = costs.sum(Step::is_for_voxels).wall_s;
        assert!(voxels < all && voxels > costs.of(Step::Reading).wall_s);
    }

    #[test]
    fn steps_stand_in_their_own_order() {
        for (place, step) in Step::ALL.into_iter().enumerate() {
            assert_eq!(step as usize, place);
        }
    }
}
