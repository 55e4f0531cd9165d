//! Builds the model of a closed brain, step by step.

use crate::{
    ContourPlanes, DeformableModel, DepthField, DepthMaps, DistanceMap, Envelope, Forest,
    GeometryError, Paths, ShellIndex, Volume, core, distance_map, envelope_mesh_across, forest,
    path_table,
};

/// A closed brain.
#[derive(Debug, Clone, PartialEq)]
pub enum ClosedBrain {
    /// Its envelope alone.
    Envelope(Envelope),
    /// The envelope of a hemisphere closed on its own, whose meshes have coronal contours.
    Hemisphere(Envelope),
    /// Its envelope and the depth below it, which the extraction of a brain computes anyway.
    Measured(DistanceMap),
}

impl ClosedBrain {
    /// The envelope.
    pub fn envelope(&self) -> &Envelope {
        match self {
            Self::Envelope(envelope) | Self::Hemisphere(envelope) => envelope,
            Self::Measured(distance) => distance.envelope(),
        }
    }

    fn contour_planes(&self) -> ContourPlanes {
        match self {
            Self::Hemisphere(_) => ContourPlanes::Coronal,
            Self::Envelope(_) | Self::Measured(_) => ContourPlanes::Sagittal,
        }
    }

    fn into_distance(self) -> DistanceMap {
        match self {
            Self::Envelope(envelope) | Self::Hemisphere(envelope) => distance_map(&envelope),
            Self::Measured(distance) => distance,
        }
    }
}

/// A step of [`DeformableModel::build`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BuildStep {
    /// The exact distance map, unless it is known already.
    Distance,
    /// The regional maxima of the depth.
    Core,
    /// The optimal paths.
    Forest,
    /// The depth between voxel centres.
    Field,
    /// The envelope's mesh of 1,800 triangles.
    Mesh,
    /// The table of all its depths.
    Table,
    /// The voxels sorted by depth, and the sphere around them.
    Shell,
}

impl BuildStep {
    /// All steps in their order.
    pub const ALL: [Self; 7] = [
        Self::Distance,
        Self::Core,
        Self::Forest,
        Self::Field,
        Self::Mesh,
        Self::Table,
        Self::Shell,
    ];
}

/// A model, with the maps it was made from. They are stored, and used for the paths of other meshes.
#[derive(Debug, Clone, PartialEq)]
pub struct BuiltModel {
    /// The model.
    pub model: DeformableModel,
    /// The distance map, with the envelope.
    pub distance: DistanceMap,
    /// The optimal-path forest.
    pub forest: Forest,
}

impl DeformableModel {
    /// Builds the model of a closed brain. `volume` is the result of [`DeformableModel::crop`].
    ///
    /// `observe` is called before each step. If it returns an error, the step does not begin.
    ///
    /// # Errors
    /// If the envelope is too small for the default mesh; and the errors of `observe`.
    pub fn build<E: From<GeometryError>>(
        volume: Volume,
        closed: ClosedBrain,
        mut observe: impl FnMut(BuildStep) -> Result<(), E>,
    ) -> Result<BuiltModel, E> {
        observe(BuildStep::Distance)?;
        let across = closed.contour_planes();
        let distance = closed.into_distance();
        observe(BuildStep::Core)?;
        let core = core(&distance);
        observe(BuildStep::Forest)?;
        let forest = forest(&distance, &core);
        observe(BuildStep::Field)?;
        let field = DepthField::new(&distance);
        observe(BuildStep::Mesh)?;
        let mesh = envelope_mesh_across(&field, Self::DEFAULT_MESH, across)?;
        observe(BuildStep::Table)?;
        let default_paths = path_table(&mesh, &distance, &field, Paths::Forest(&forest));
        observe(BuildStep::Shell)?;
        let depth = DepthMaps::from_parts(field, ShellIndex::new(&distance));
        Ok(BuiltModel {
            model: Self::new(volume, depth, default_paths).with_contours(across),
            distance,
            forest,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MeshSize, envelope, envelope_mesh, phantom};

    fn closed() -> (Volume, Envelope) {
        let head = phantom::head(4.0);
        let brain = crate::BrainMask::from_mask(&head.brain, head.volume.grid()).unwrap();
        let envelope = envelope(&brain, 10.0).unwrap();
        let volume = DeformableModel::crop(&head.volume, &envelope).unwrap();
        (volume, envelope)
    }

    fn build(volume: Volume, closed: ClosedBrain) -> BuiltModel {
        DeformableModel::build(volume, closed, |_| Ok::<_, GeometryError>(())).unwrap()
    }

    #[test]
    fn a_model_holds_what_each_step_gives() {
        let (volume, envelope) = closed();
        let built = build(volume.clone(), ClosedBrain::Envelope(envelope.clone()));
        let distance = distance_map(&envelope);
        assert!(built.distance == distance);
        assert!(built.forest == forest(&distance, &core(&distance)));
        let field = DepthField::new(&distance);
        let mesh = envelope_mesh(&field, MeshSize::STANDARD).unwrap();
        let table = path_table(&mesh, &distance, &field, Paths::Forest(&built.forest));
        let model = &built.model;
        assert!(**model.default_paths() == table);
        assert!(*model.normals() == field.smoothed(1.5));
        assert!(*model.field() == field);
        assert!(*model.shell() == ShellIndex::new(&distance));
        assert!(*model.volume() == volume);
    }

    #[test]
    fn a_model_from_stored_parts_is_the_one_that_was_built() {
        let (volume, envelope) = closed();
        let built = build(volume, ClosedBrain::Envelope(envelope)).model;
        let depth = DepthMaps::new(&distance_map(&closed().1));
        let (volume, paths) = built.clone().into_stored();
        assert!(DeformableModel::new(volume, depth, (*paths).clone()) == built);
    }

    #[test]
    fn a_depth_that_was_measured_before_is_taken_as_it_is() {
        let (volume, envelope) = closed();
        let measured = ClosedBrain::Measured(distance_map(&envelope));
        let again = build(volume.clone(), measured);
        assert!(again == build(volume, ClosedBrain::Envelope(envelope)));
    }

    #[test]
    fn each_step_is_announced_and_none_is_begun_after_a_refusal() {
        let (volume, envelope) = closed();
        let mut seen = Vec::new();
        let observe = |step| {
            seen.push(step);
            let error = GeometryError::EmptyMask;
            if step == BuildStep::Forest {
                Err(error)
            } else {
                Ok(())
            }
        };
        let closed = ClosedBrain::Envelope(envelope);
        let refused = DeformableModel::build(volume.clone(), closed.clone(), observe);
        assert_eq!(refused, Err(GeometryError::EmptyMask));
        assert_eq!(seen, BuildStep::ALL[..3]);
        let mut seen = Vec::new();
        let observe = |step| {
            seen.push(step);
            Ok::<_, GeometryError>(())
        };
        DeformableModel::build(volume, closed, observe).unwrap();
        assert_eq!(seen, BuildStep::ALL);
    }

    #[test]
    fn other_meshes_walk_through_the_maps_of_the_model() {
        let (volume, envelope) = closed();
        let built = build(volume, ClosedBrain::Envelope(envelope));
        let size = MeshSize::new(12, 16).unwrap();
        for paths in [Paths::Forest(&built.forest), Paths::Flow] {
            let table = built
                .model
                .path_table(size, &built.distance, paths)
                .unwrap();
            let once = built
                .model
                .shrink_once(size, &built.distance, paths, 7.0)
                .unwrap();
            let shrunk = table.shrink(7.0);
            let pairs = shrunk
                .positions_in_patient
                .iter()
                .zip(&once.positions_in_patient);
            for (a, b) in pairs {
                let apart = glam::Vec3::from(*a).distance(glam::Vec3::from(*b));
                assert!(apart < 0.2, "{apart} mm");
            }
        }
    }
}
