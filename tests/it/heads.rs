//! Tests of the whole geometry on real heads: the exactness of the meshes, and independence of the order of axes.
//!
//! The heads are not part of the project; without them, these tests report it and pass.

use std::path::{Path, PathBuf};

use analysis::{MidsagittalPlane, midsagittal_plane};
use geometry::{
    BrainMask, DepthField, DistanceMap, EnvelopeMesh, Forest, Grid, Mask, MeshSize, Paths, Volume,
    core, distance_map, envelope, envelope_mesh, forest, path_table,
};
use glam::{DAffine3, DQuat, DVec3, Vec3};

/// The folder of real heads, from the variable `ISOCORTEX_TEST_DATA`; reports if there is none.
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

/// A head whose patient has moved.
fn moved((volume, mask): (&Volume, &Mask), how: DAffine3) -> (Volume, Mask) {
    let grid = |grid: &Grid| {
        Grid::new(grid.size(), how * grid.patient_from_voxel()).expect("a grid as good as before")
    };
    let voxels = volume.voxels().to_vec();
    let volume = Volume::new(grid(volume.grid()), voxels, volume.rescale());
    let mask = Mask::new(grid(mask.grid()), mask.voxels().to_vec());
    (
        volume.expect("as many values"),
        mask.expect("as many values"),
    )
}

/// The plane of a head, with the centre of its volume.
fn plane_of((volume, mask): &(Volume, Mask)) -> (MidsagittalPlane, DVec3) {
    let grid = volume.grid();
    let brain = BrainMask::from_mask(mask, grid).expect("a brain");
    let envelope = envelope(&brain, 10.0).expect("a radius within range");
    let middle = DVec3::from_array(grid.size().map(|side| (side - 1) as f64 / 2.0));
    let centre = grid.patient_from_voxel().transform_point3(middle);
    let begin = std::time::Instant::now();
    let plane = midsagittal_plane(&envelope, volume);
    println!("{:.1} ms", begin.elapsed().as_secs_f64() * 1000.0);
    (plane, centre)
}

#[test]
fn the_plane_between_the_hemispheres_of_a_real_head_turns_with_the_head() {
    let Some(data) = data() else { return };
    for (folder, volume, mask) in [
        ("colin27", "ch2.nii.gz", "ch2bet.nii.gz"),
        ("csi1", "t1.nii.gz", "mask_brain.nii.gz"),
    ] {
        let read = |name: &str| std::fs::read(data.join(folder).join(name)).expect("a file");
        let volume = imaging::nifti::read_volume(&read(volume), &imaging::Limits::default());
        let mask = read_mask(&data.join(folder).join(mask));
        let head = (volume.expect("a sound file"), mask);
        let (plane, centre) = plane_of(&head);
        let [x, y, z] = plane.normal().to_array();
        let tilts = [y.atan2(x), z.atan2(x)].map(f64::to_degrees);
        println!("{folder}: {tilts:.2?} deg, {plane:?}, centre {centre:.1}");
        assert!(
            tilts.iter().all(|tilt| tilt.abs() < 6.0),
            "{folder}: {plane:?}"
        );
        for (yaw, roll) in [(12.0_f64, -7.0_f64), (-5.0, 16.0)] {
            let turn = DQuat::from_rotation_y(roll.to_radians())
                * DQuat::from_rotation_z(yaw.to_radians());
            let how = DAffine3::from_rotation_translation(turn, DVec3::new(6.0, -4.0, 3.0));
            let (found, moved_centre) = plane_of(&moved((&head.0, &head.1), how));
            let apart_deg = found
                .normal()
                .angle_between(turn * plane.normal())
                .to_degrees();
            let before_mm = plane.normal().dot(centre) - plane.offset_mm();
            let after_mm = found.normal().dot(moved_centre) - found.offset_mm();
            println!(
                "{folder}: {apart_deg:.3} deg, {:.3} mm apart",
                after_mm - before_mm
            );
            assert!(apart_deg < 0.5, "{folder}: {apart_deg} deg");
            assert!(
                (after_mm - before_mm).abs() < 0.5,
                "{folder}: {before_mm}, {after_mm}"
            );
        }
    }
}
