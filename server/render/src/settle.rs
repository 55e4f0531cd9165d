//! Moves the mesh onto the isosurface of the other renderers.

use std::borrow::Cow;

use geometry::ShrunkMesh;
use glam::Vec3;
use rayon::prelude::*;

use crate::Scene;
use crate::isosurface::Isosurface;

/// How often a vertex is moved. Each move reduces its distance to a third or less.
const MOVES: usize = 4;

/// The farthest that a vertex moves at once, in voxels.
const FARTHEST: f32 = 1.0;

/// The mesh to draw.
///
/// From a depth of five voxels on, the mesh is unchanged. Nearer to the envelope, its voxels would be visible, so the
/// other renderers draw an isosurface without these terraces, up to a voxel away; the vertices move there along the
/// gradient.
pub(crate) fn settled<'a>(mesh: &'a ShrunkMesh, scene: &Scene<'_>) -> Cow<'a, ShrunkMesh> {
    let isosurface = Isosurface::new(scene.field, scene.normals, f64::from(mesh.depth_mm));
    if !isosurface.is_smoothed() {
        return Cow::Borrowed(mesh);
    }
    let grid = scene.field.grid();
    let settle = |position: &[f32; 3]| {
        let position = Vec3::from(*position).as_dvec3();
        let mut place = grid
            .voxel_from_patient()
            .transform_point3(position)
            .as_vec3();
        for _ in 0..MOVES {
            let below = isosurface.below(place.to_array());
            let inward = Vec3::from(isosurface.inward(place.to_array()));
            place -= inward * below.clamp(-FARTHEST, FARTHEST);
        }
        let position = grid.patient_from_voxel().transform_point3(place.as_dvec3());
        position.as_vec3().to_array()
    };
    Cow::Owned(ShrunkMesh {
        depth_mm: mesh.depth_mm,
        positions_in_patient: mesh.positions_in_patient.par_iter().map(settle).collect(),
    })
}

#[cfg(test)]
mod tests {
    use geometry::{MeshSize, Paths, phantom};

    use super::*;

    #[test]
    fn vertices_near_the_envelope_are_on_the_surface_without_terraces_and_deep_ones_stay() {
        let envelope = geometry::envelope(&phantom::ball(20.0), 2.0).unwrap();
        let built = phantom::model(phantom::head(4.0).volume, envelope);
        let (model, scene) = (&built.model, Scene::from(&built.model));
        let size = MeshSize::new(20, 30).unwrap();
        let table = model.path_table(size, &built.distance, Paths::Flow);
        let table = table.unwrap();
        for depth_mm in [0.0, 1.7, 3.6] {
            let shrunk = table.shrink(depth_mm);
            let isosurface = Isosurface::new(scene.field, scene.normals, f64::from(depth_mm));
            let off = |position: &[f32; 3]| {
                let place = model
                    .field()
                    .grid()
                    .voxel_from_patient()
                    .transform_point3(Vec3::from(*position).as_dvec3());
                isosurface.below(place.as_vec3().to_array()).abs()
            };
            let settled = &settled(&shrunk, &scene).positions_in_patient;
            let most = settled.iter().map(off).fold(0.0, f32::max);
            assert!(most < 0.02, "{depth_mm} mm: {most} voxels off");
            for (before, after) in shrunk.positions_in_patient.iter().zip(settled.iter()) {
                let moved = Vec3::from(*before).distance(Vec3::from(*after));
                assert!(moved < 1.5, "{moved} voxels");
            }
        }
        let deep = table.shrink(6.0);
        assert_eq!(*settled(&deep, &scene), deep);
    }
}
