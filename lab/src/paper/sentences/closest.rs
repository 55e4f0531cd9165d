//! "We want to find, for each vertex, the closest point in the discrete 3D Euclidean distance map with distance ≥ D"
//! (section 3.2).

use geometry::{MeshSize, Paths, envelope_mesh};
use glam::Vec3;
use rayon::prelude::*;

use super::DEPTHS_MM;
use crate::{BenchError, PreparedHead, Summary, Table, column};

/// The thickness of the shell that contains every closest voxel, in voxels: a neighbour is at most √3 shallower.
const SHELL_VOXELS: f32 = 2.0;

/// How far our vertices move, and how far they end from the closest voxel, along the forest and along the gradient.
pub(super) fn table(head: &PreparedHead) -> Result<Table, BenchError> {
    let columns = [
        column("depth_mm", "depth, mm"),
        column("closest_mm", "to the closest voxel, mm"),
        column("forest_mm", "to our point, forest"),
        column("forest_apart_mm", "apart: mean"),
        column("forest_apart_p95_mm", "95 %"),
        column("flow_mm", "to our point, gradient"),
        column("flow_apart_mm", "apart: mean"),
        column("flow_apart_p95_mm", "95 %"),
    ];
    let size = MeshSize::STANDARD;
    let title = format!(
        "The closest point at a depth, from the vertices of {} triangles; means",
        size.triangle_count()
    );
    let mut table = Table::new("closest", title, &columns);
    let field = head.model().field();
    let spacing_mm = field.spacing_mm();
    let starts = envelope_mesh(field, size)?.positions_in_voxel;
    let [forest, flow] = [Paths::Forest(&head.forest), Paths::Flow]
        .map(|paths| head.model().path_table(size, &head.distance, paths));
    let [forest, flow] = [forest?, flow?];
    let voxel_from_patient = field.grid().voxel_from_patient();
    for depth_mm in DEPTHS_MM.into_iter().skip(1) {
        let depth_mm = depth_mm.min(0.7 * head.distance.max_depth_mm());
        let shell = head.model().shell();
        let shell = shell.shell(depth_mm, SHELL_VOXELS * spacing_mm);
        let voxels: Vec<Vec3> = shell
            .iter()
            .map(|voxel| Vec3::from_array(voxel.position().map(|place| place as f32)))
            .collect();
        let closest: Vec<Vec3> = starts
            .par_iter()
            .map(|&start| nearest(&voxels, start))
            .collect();
        let mean_mm = |distances: &mut dyn Iterator<Item = f32>| {
            Summary::of(distances.map(|voxels| f64::from(voxels * spacing_mm)))
        };
        let to_closest = mean_mm(&mut starts.iter().zip(&closest).map(|(a, b)| a.distance(*b)));
        let mut row = vec![
            f64::from(depth_mm).into(),
            to_closest.map(|summary| summary.mean).into(),
        ];
        for paths in [&forest, &flow] {
            let shrunk = paths.shrink(depth_mm).positions_in_patient;
            let ours: Vec<Vec3> = shrunk
                .into_iter()
                .map(|at| {
                    let at = Vec3::from_array(at).as_dvec3();
                    voxel_from_patient.transform_point3(at).as_vec3()
                })
                .collect();
            let moved = mean_mm(&mut starts.iter().zip(&ours).map(|(a, b)| a.distance(*b)));
            let apart = mean_mm(&mut closest.iter().zip(&ours).map(|(a, b)| a.distance(*b)));
            row.push(moved.map(|summary| summary.mean).into());
            row.push(apart.map(|summary| summary.mean).into());
            row.push(apart.map(|summary| summary.p95).into());
        }
        table.push(row);
    }
    table.note("The closest voxel of the distance map that is at least as deep, found by comparison with every voxel of the shell.");
    Ok(table)
}

/// The point nearest to `start`; there is at least one, because no depth exceeds the greatest one.
fn nearest(points: &[Vec3], start: Vec3) -> Vec3 {
    let nearer = |a: &&Vec3, b: &&Vec3| {
        a.distance_squared(start)
            .total_cmp(&b.distance_squared(start))
    };
    points.iter().min_by(nearer).copied().unwrap_or(start)
}
