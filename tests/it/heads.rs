//! Real heads through the whole of the geometry: how exact the meshes are, and that axes do not matter.
//!
//! The heads are not part of the project; without them these tests say so and pass.

use std::path::{Path, PathBuf};

use geometry::{
    BrainMask, DepthField, DistanceMap, EnvelopeMesh, Forest, Mask, MeshSize, Paths, core,
    distance_map, envelope, envelope_mesh, forest, path_table,
};
use glam::Vec3;

/// The folder of test data: `ISOCORTEX_TEST_DATA`, or `shared/data` beside the checkout.
pub(crate) fn data() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("ISOCORTEX_TEST_DATA").map_or(beside, PathBuf::from);
    if !folder.is_dir() {
        eprintln!("SKIPPED: no real heads; set ISOCORTEX_TEST_DATA to their folder");
        return None;
    }
    Some(folder)
}

fn read_mask(path: &Path) -> Mask {
    let bytes = std::fs::read(path).expect("a file of the test data");
    imaging::nifti::read_mask(&bytes, &imaging::Limits::default()).expect("a sound file")
}

struct Head {
    distance: DistanceMap,
    field: DepthField,
    forest: Forest,
}

fn head(mask: &Mask) -> Head {
    let brain = BrainMask::from_mask(mask, mask.grid()).expect("a brain");
    let distance = distance_map(&envelope(&brain, 10.0).expect("a radius within range"));
    let field = DepthField::new(&distance);
    let forest = forest(&distance, &core(&distance));
    Head {
        distance,
        field,
        forest,
    }
}

/// How far points of the facets are from the isosurface, in mm: their mean and 95th percentile.
fn facet_errors(head: &Head, mesh: &EnvelopeMesh, depth_mm: f32) -> [f32; 2] {
    let table = path_table(
        mesh,
        &head.distance,
        &head.field,
        Paths::Forest(&head.forest),
    );
    let voxel_from_patient = head.distance.grid().voxel_from_patient();
    let in_voxel = |position: &[f32; 3]| {
        voxel_from_patient
            .transform_point3(Vec3::from_array(*position).as_dvec3())
            .as_vec3()
    };
    let positions: Vec<Vec3> = table
        .shrink(depth_mm)
        .positions_in_patient
        .iter()
        .map(in_voxel)
        .collect();
    let mut errors = Vec::new();
    for triangle in mesh.size.triangles() {
        let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
        for (u, v) in [(1.0 / 3.0, 1.0 / 3.0), (0.6, 0.2), (0.2, 0.6), (0.2, 0.2)] {
            let point = a + (b - a) * u + (c - a) * v;
            errors.push((head.field.depth_mm(point) - depth_mm).abs());
        }
    }
    errors.sort_by(f32::total_cmp);
    let mean = errors.iter().sum::<f32>() / errors.len() as f32;
    [mean, errors[errors.len() * 95 / 100]]
}

#[test]
fn the_facets_of_colin27_keep_to_the_isosurface() {
    let Some(data) = data() else { return };
    let head = head(&read_mask(&data.join("colin27/ch2bet.nii.gz")));
    for (contours, points, most) in [(30, 30, [0.6, 1.8]), (80, 50, [0.29, 0.92])] {
        let size = MeshSize::new(contours, points).expect("a size within range");
        let mesh = envelope_mesh(&head.field, size).expect("a mesh");
        let [mean, high] = facet_errors(&head, &mesh, 10.0);
        eprintln!("{contours} × {points} at 10 mm: mean {mean:.2} mm, 95 % within {high:.2} mm");
        assert!(mean <= most[0] && high <= most[1], "{mean} {high}");
    }
}

#[test]
fn the_strips_of_colin27_do_not_twist() {
    let Some(data) = data() else { return };
    let head = head(&read_mask(&data.join("colin27/ch2bet.nii.gz")));
    let size = MeshSize::new(60, 40).expect("a size within range");
    let mesh = envelope_mesh(&head.field, size).expect("a mesh");
    let at = |contour: usize, point: usize| mesh.positions_in_voxel[contour * 40 + point % 40];
    for contour in 0..59 {
        let mismatch = |turn: usize| -> f32 {
            let pairs = (0..40).map(|point| (at(contour, point), at(contour + 1, point + turn)));
            pairs.map(|(a, b)| a.distance_squared(b)).sum()
        };
        let best = (0..40).min_by(|&a, &b| mismatch(a).total_cmp(&mismatch(b)));
        assert_eq!(
            best,
            Some(0),
            "between contours {contour} and {}",
            contour + 1
        );
    }
}

#[test]
fn one_brain_in_all_48_orders_of_axes_gives_one_mesh() {
    let Some(data) = data() else { return };
    let folder = std::fs::read_dir(data.join("orient48")).expect("the folder of orders");
    let mut paths: Vec<PathBuf> = folder
        .map(|entry| entry.expect("an entry").path())
        .collect();
    paths.sort();
    assert_eq!(paths.len(), 48);
    let size = MeshSize::new(12, 16).expect("a size within range");
    let shrunk = |path: &PathBuf| {
        let head = head(&read_mask(path));
        let mesh = envelope_mesh(&head.field, size).expect("a mesh");
        let table = path_table(
            &mesh,
            &head.distance,
            &head.field,
            Paths::Forest(&head.forest),
        );
        table.shrink(9.0).positions_in_patient
    };
    let first = shrunk(&paths[0]);
    for path in &paths[1..] {
        for (position, expected) in shrunk(path).iter().zip(&first) {
            let apart = Vec3::from_array(*position).distance(Vec3::from_array(*expected));
            assert!(apart < 1e-2, "{}: {apart} mm", path.display());
        }
    }
}
