//! A head, prepared with a timer around every step.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use geometry::{
    BrainMask, BuiltModel, ClosedBrain, DeformableModel, DistanceMap, EnvelopeMesh, Forest,
    MeshSize, PathTable, Paths, envelope, envelope_mesh, path_table,
};
use render::gpu::{CaseKey, KeyedModel};
use render::{KeyedLayers, RenderJob, RenderRequest, Scene, SizedMesh, Window};

use crate::steps::{Step, StepClock, StepCosts};
use crate::{BenchError, Head};

/// A prepared head.
#[derive(Debug)]
pub struct PreparedHead {
    /// Its model.
    pub case: KeyedModel,
    /// The distance map, with the envelope.
    pub distance: DistanceMap,
    /// The optimal paths.
    pub forest: Forest,
    /// The default window for its pictures.
    pub window: Window,
    /// The size of the original volume in voxels.
    pub volume_voxels: usize,
}

impl PreparedHead {
    /// Prepares a head with the same constructor as the server, and returns the cost of each step.
    ///
    /// # Errors
    /// If a file cannot be read or the head has no usable envelope.
    pub fn prepare(head: &Head, closing_radius_mm: f64) -> Result<(Self, StepCosts), BenchError> {
        let mut clock = StepClock::default();
        clock.begin(Step::Reading);
        let (native, mask) = head.read()?;
        clock.begin(Step::Mask);
        let brain = BrainMask::from_mask(&mask, native.grid())?;
        drop(mask);
        clock.begin(Step::Closing);
        let envelope = envelope(&brain, closing_radius_mm)?;
        drop(brain);
        clock.begin(Step::Crop);
        let volume = DeformableModel::crop(&native, &envelope);
        let volume = volume.ok_or(BenchError::MaskOutsideVolume)?;
        let volume_voxels = native.grid().voxel_count();
        drop(native);
        let observe = |step| {
            clock.begin(Step::Build(step));
            Ok::<_, BenchError>(())
        };
        let built = DeformableModel::build(volume, ClosedBrain::Envelope(envelope), observe)?;
        clock.begin(Step::Facts);
        let window = pipeline::facts(&built, built.model.volume()).window;
        let [black, white] = [-0.5, 0.5].map(|half| window.center + half * window.width);
        clock.begin(Step::Normals);
        built.model.normals();
        let costs = clock.finish();
        let BuiltModel {
            model,
            distance,
            forest,
        } = built;
        let prepared = Self {
            case: KeyedModel {
                key: next_key(),
                model: Arc::new(model),
            },
            distance,
            forest,
            window: Window::between(black, white),
            volume_voxels,
        };
        Ok((prepared, costs))
    }

    /// Its model.
    pub fn model(&self) -> &DeformableModel {
        &self.case.model
    }

    /// The input of a renderer.
    pub fn scene(&self) -> Scene<'_> {
        self.case.scene()
    }

    /// A picture of it.
    pub fn job(&self, request: RenderRequest, mesh: Option<SizedMesh>) -> RenderJob {
        RenderJob {
            case: self.case.clone(),
            request,
            mesh,
            layers: KeyedLayers::default(),
        }
    }

    /// Number of voxels of the envelope.
    pub fn inside_voxels(&self) -> usize {
        self.model().shell().voxels().len()
    }

    /// The mesh of the envelope and the table of the forest paths of its vertices.
    ///
    /// # Errors
    /// If the envelope is too small.
    pub fn table(&self, size: MeshSize) -> Result<(EnvelopeMesh, PathTable), BenchError> {
        let mesh = envelope_mesh(self.model().field(), size)?;
        let table = self.table_of(&mesh);
        Ok((mesh, table))
    }

    /// The table of the forest paths of the vertices of a mesh.
    pub fn table_of(&self, mesh: &EnvelopeMesh) -> PathTable {
        let paths = Paths::Forest(&self.forest);
        path_table(mesh, &self.distance, self.model().field(), paths)
    }
}

/// A unique key for each head of this process.
pub(crate) fn next_key() -> CaseKey {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    CaseKey(u128::from(NEXT.fetch_add(1, Ordering::Relaxed)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_of_a_preparation_is_timed() {
        let head = Head::phantom(4.0).unwrap();
        let (case, costs) = PreparedHead::prepare(&head, 10.0).unwrap();
        assert!(Step::ALL.iter().all(|&step| costs.of(step).wall_s > 0.0));
        assert!(case.inside_voxels() > 10_000);
        let all = costs.sum(|_| true).wall_s;
        let meshes = costs.sum(Step::is_for_meshes).wall_s;
        let voxels = costs.sum(Step::is_for_voxels).wall_s;
        assert!(voxels < meshes && meshes < all, "{voxels} {meshes} {all}");
        assert!(voxels > costs.of(Step::Reading).wall_s);
    }
}
