//! Left is left, whatever way a volume was stored.

use geometry::{Grid, Mask, Volume};
use glam::{DAffine3, DMat3, DVec3};
use serde_json::json;

use crate::head::{SPACING_MM, head, orientations};
use crate::masks::version;
use crate::server::Server;

/// The cases of the marked head in every orientation.
async fn cases(server: &Server) -> Vec<(&'static str, String)> {
    let mut cases = Vec::new();
    for orientation in orientations() {
        let volume = head(orientation).bytes();
        let case = server.prepared(&[("volume", &volume)]).await;
        cases.push((orientation.name, case));
    }
    cases
}

type Positions = Vec<[f32; 3]>;

fn distance([a, b]: [[f32; 3]; 2]) -> f32 {
    let squares = (0..3).map(|axis| (a[axis] - b[axis]).powi(2));
    squares.sum::<f32>().sqrt()
}

/// How far the vertex of `mesh` is that is farthest from every vertex of `other`.
fn farthest(mesh: &Positions, other: &Positions) -> f32 {
    let mut sorted = other.clone();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let nearest = |&a: &[f32; 3]| {
        let (before, after) = sorted.split_at(sorted.partition_point(|b| b[0] < a[0]));
        let mut least = f32::INFINITY;
        for side in [
            &mut before.iter().rev() as &mut dyn Iterator<Item = &[f32; 3]>,
            &mut after.iter(),
        ] {
            for &b in side {
                // All that follow are farther away along the first axis alone.
                if (b[0] - a[0]).abs() >= least {
                    break;
                }
                least = least.min(distance([a, b]));
            }
        }
        least
    };
    mesh.iter().map(nearest).fold(0.0, f32::max)
}

#[tokio::test]
async fn orientations_along_the_axes_give_the_same_vertices() {
    let server = Server::start().await;
    let cases = cases(&server).await;
    for depth in [0, 8] {
        let mesh = async |case: &str| {
            let address = format!("{case}/mesh?depth_mm={depth}");
            server.get(&address).await.positions()
        };
        let expected = mesh(&cases[0].1).await;
        for (name, case) in &cases[1..3] {
            for (a, b) in mesh(case).await.iter().zip(&expected) {
                assert!(
                    distance([*a, *b]) < 0.05,
                    "{name} at {depth} mm: {a:?} {b:?}"
                );
            }
        }
    }
}

#[tokio::test]
async fn an_oblique_acquisition_gives_the_same_surface_and_not_its_mirror_image() {
    let server = Server::start().await;
    let cases = cases(&server).await;
    for depth in [0, 8] {
        let mesh = async |case: &str, size: &str| {
            let address = format!("{case}/mesh?depth_mm={depth}&{size}");
            server.get(&address).await.positions()
        };
        // The one is so fine that every point of its surface is near a vertex.
        let expected = mesh(&cases[0].1, "contours=300&points=100").await;
        let mut oblique = mesh(&cases[3].1, "contours=30&points=30").await;
        // At the far left and right voxels make a flat face, over which triangles reach without a vertex.
        oblique.retain(|position| position[0].abs() < 40.0);
        assert!(oblique.len() > 400);
        // Its voxels are others and its mask was resampled: each side may be off by a voxel's diagonal.
        let apart = farthest(&oblique, &expected);
        assert!(apart < 2.0 * SPACING_MM, "{depth} mm: {apart} mm apart");
        let mirrored: Positions = oblique.iter().map(|&[x, y, z]| [-x, y, z]).collect();
        let apart = farthest(&mirrored, &expected);
        assert!(
            apart > 4.0 * SPACING_MM,
            "{depth} mm: {apart} mm from the mirror image"
        );
    }
}

#[tokio::test]
async fn a_mark_at_the_patients_right_shows_from_the_right_alone() {
    let server = Server::start().await;
    for (name, case) in cases(&server).await {
        let marked = async |view: &str| {
            let query = format!("view={view}&width=128&height=128&window=700,100&ambient=1");
            let picture = server.get(&format!("{case}/render?{query}")).await.grey();
            picture.pixels().filter(|pixel| pixel.0[0] > 200).count()
        };
        let (right, left) = (marked("right").await, marked("left").await);
        assert!(
            right > 1000 && left == 0,
            "{name}: {right} pixels from the right, {left} from the left"
        );
    }
}

#[tokio::test]
async fn pictures_and_slices_have_the_right_side_where_they_should() {
    let server = Server::start().await;
    for (name, case) in cases(&server).await {
        // Facing the patient, and on axial and coronal slices, the patient's right is at the left of the picture.
        for address in [
            "render?view=anterior&ambient=1&",
            "slices/axial?",
            "slices/coronal?",
        ] {
            let query = format!("{case}/{address}width=128&height=128&window=700,100");
            let picture = server.get(&query).await.grey();
            let columns = picture
                .enumerate_pixels()
                .filter(|(_, _, pixel)| pixel.0[0] > 200);
            let (left, right): (Vec<u32>, Vec<u32>) =
                columns.map(|(x, ..)| x).partition(|&x| x < 64);
            assert!(
                left.len() > 100 && right.is_empty(),
                "{name}, {address}: {} and {}",
                left.len(),
                right.len()
            );
        }
    }
}

#[tokio::test]
async fn orientations_along_the_axes_give_the_same_plane_between_the_hemispheres() {
    let server = Server::start().await;
    let mut planes = Vec::new();
    for (_, case) in &cases(&server).await[..3] {
        let plane = server.get(case).await.json()["midsagittal"].take();
        let number = |value: &serde_json::Value| value.as_f64().expect("a number");
        let normal = plane["normal"].as_array().expect("three numbers");
        let normal: Vec<f64> = normal.iter().map(number).collect();
        planes.push((normal, number(&plane["offset_mm"])));
    }
    let (first, offset_mm) = &planes[0];
    assert!(first[0] > 0.8, "to the patient's left: {first:?}");
    assert!((first.iter().map(|part| part * part).sum::<f64>() - 1.0).abs() < 1e-9);
    for (normal, other_mm) in &planes[1..] {
        let cosine: f64 = normal.iter().zip(first).map(|(a, b)| a * b).sum();
        assert!(cosine > 0.99999, "{normal:?} {first:?}");
        assert!((other_mm - offset_mm).abs() < 0.1, "{other_mm} {offset_mm}");
    }
}

#[tokio::test]
async fn the_same_voxels_with_another_header_are_put_to_review() {
    let server = Server::start().await;
    let stored = geometry::phantom::head(4.0);
    let with_header = |reversed: DVec3| {
        let grid = stored.volume.grid();
        let axes = DMat3::from_diagonal(DVec3::ONE - 2.0 * reversed);
        let header = DAffine3::from_mat3(axes) * grid.patient_from_voxel();
        let grid = Grid::new(grid.size(), header).unwrap();
        let (voxels, rescale) = (stored.volume.voxels().to_vec(), stored.volume.rescale());
        let volume = Volume::new(grid.clone(), voxels, rescale).unwrap();
        let brain = Mask::new(grid, stored.brain.voxels().to_vec()).unwrap();
        [
            imaging::nifti::write_volume(&volume).unwrap(),
            imaging::nifti::write_mask(&brain).unwrap(),
        ]
    };
    let codes = async |reversed: DVec3| {
        let [volume, mask] = with_header(reversed);
        let case = server
            .prepared(&[("volume", &volume), ("mask", &mask)])
            .await;
        let quality = server.get(&case).await.json()["quality"].clone();
        assert_eq!(quality["state"] == "ok", quality["reasons"] == json!([]));
        (case, quality["reason_codes"].clone())
    };
    let (first, expected) = codes(DVec3::ZERO).await;
    assert!(!expected.to_string().contains("axes-corrected"));
    // Mirrored, and turned: the picture cannot tell either from the first.
    let mut others = Vec::new();
    for reversed in [DVec3::X, DVec3::new(1.0, 1.0, 0.0)] {
        let (other, codes) = codes(reversed).await;
        others.push(other);
        assert!(codes.to_string().contains("axes-corrected"), "{codes}");
    }
    // The first case may be the wrong one as well: it has the doubt once, and no other.
    let doubted = server.get(&first).await.json()["quality"].clone();
    let before = expected.as_array().cloned().unwrap_or_default();
    let codes = [before, vec![json!("axes-corrected")]].concat();
    assert_eq!(doubted["reason_codes"], json!(codes));
    assert_ne!(doubted["state"], "ok");
    // Another mask does not settle it.
    let mask = server.get(&format!("{first}/mask")).await.body;
    let (_, version) = version(&server, &first, "?closing_radius_mm=7", &mask).await;
    assert!(version["quality"].to_string().contains("axes-corrected"));
    // The doubt goes with the last case that contradicts it.
    for (number, other) in others.iter().enumerate() {
        let still = server.get(&first).await.json()["quality"].to_string();
        assert!(still.contains("axes-corrected"), "{number}: {still}");
        let deleted = server.method(axum::http::Method::DELETE, other).await;
        assert_eq!(deleted.status, 204, "{deleted:?}");
    }
    let quality = server.get(&first).await.json()["quality"].clone();
    assert!(!quality.to_string().contains("axes-corrected"), "{quality}");
    assert_eq!(quality["state"] == "ok", quality["reasons"] == json!([]));
}
