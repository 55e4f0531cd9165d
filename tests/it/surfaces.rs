//! Surfaces of parts of the brain: each hemisphere and the cerebrum, closed on their own.

use analysis::testing::brain::{self, BrainPhantom};
use axum::http::StatusCode;
use cases::settings::GpuUse;
use cases::settings::MapsUse;
use geometry::{Rescale, Volume};
use glam::DVec3;

use crate::interface::{MeshFile, gifti_arrays};
use crate::server::{Answer, Server};
use crate::until::until;

/// A bright ball beside the falx, on the patient's left: along the axes of the phantom, in mm.
const BALL: DVec3 = DVec3::new(6.0, 55.0, 30.0);
const BALL_MM: f64 = 4.0;
const BALL_INTENSITY: u16 = 3000;

/// Black up to white matter, so that only the ball is bright.
pub(crate) const BALL_WINDOW: &str = "window=2200,1000&ambient=1";

/// A phantom with a ball on its left, as files: volume and mask; mirrored on request.
pub(crate) fn head(is_mirrored: bool) -> [Vec<u8>; 2] {
    let phantom = BrainPhantom::PLAIN;
    let grid = brain::grid();
    let (volume, mask) = phantom.head(&grid);
    let mut voxels = volume.voxels().to_vec();
    let centre = phantom.placed.transform_point3(BALL);
    let middle = grid.voxel_from_patient().transform_point3(centre);
    // Voxels of 1 mm.
    let around = middle.to_array().map(|place| {
        let [low, high] = [place - BALL_MM, place + BALL_MM].map(|end| end.round() as usize);
        low..=high
    });
    for z in around[2].clone() {
        for y in around[1].clone() {
            for x in around[0].clone() {
                let voxel = [x, y, z].map(|along| along as f64);
                if middle.distance(voxel.into()) < BALL_MM {
                    voxels[grid.index([x, y, z])] = BALL_INTENSITY;
                }
            }
        }
    }
    let mut mask = mask.voxels().to_vec();
    if is_mirrored {
        for row in voxels.chunks_exact_mut(grid.size()[0]) {
            row.reverse();
        }
        for row in mask.chunks_exact_mut(grid.size()[0]) {
            row.reverse();
        }
    }
    let rescale = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };
    let volume = Volume::new(grid.clone(), voxels, rescale).unwrap();
    let mask = geometry::Mask::new(grid, mask).unwrap();
    [
        imaging::nifti::write_volume(&volume).unwrap(),
        imaging::nifti::write_mask(&mask).unwrap(),
    ]
}

pub(crate) async fn case_of(server: &Server, [volume, mask]: [Vec<u8>; 2]) -> String {
    let parts = [("volume", &volume[..]), ("mask", &mask[..])];
    server.prepared(&parts).await
}

/// How many objects the surfaces of parts have in the store of a server.
fn stored(server: &Server) -> usize {
    let files = server.stored_files().into_iter();
    let is_of_surfaces =
        |file: &std::path::PathBuf| file.components().any(|part| part.as_os_str() == "surfaces");
    files.filter(is_of_surfaces).count()
}

fn bright_count(answer: &Answer) -> usize {
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    let picture = answer.grey();
    picture.pixels().filter(|pixel| pixel[0] > 200).count()
}

#[tokio::test]
async fn a_ball_on_the_left_lies_on_the_left_surface_alone_and_the_mirrored_head_shows_the_mirrored_picture()
 {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let case = case_of(&server, head(false)).await;
    for renderer in ["trace", "splat", "mesh"] {
        let render = async |surface: &str, view: &str| {
            let address = format!(
                "{case}/render?depth_mm=5&surface={surface}&view={view}&renderer={renderer}&{BALL_WINDOW}"
            );
            bright_count(&server.get(&address).await)
        };
        let left = render("left", "mesial-left").await;
        assert!(left > 100, "{renderer}: {left}");
        assert_eq!(render("right", "mesial-right").await, 0, "{renderer}");
        assert_eq!(render("left", "left").await, 0, "{renderer}");
    }
    // Nothing of the ball is near the surface of the whole brain.
    let whole = format!("{case}/render?depth_mm=5&view=right&{BALL_WINDOW}");
    assert_eq!(bright_count(&server.get(&whole).await), 0);

    let mirrored = case_of(&server, head(true)).await;
    for (one, other) in [
        (
            "surface=left&view=mesial-left",
            "surface=right&view=mesial-right",
        ),
        ("surface=right&view=right", "surface=left&view=left"),
    ] {
        let seen = async |case: &str, keys: &str| {
            server
                .get(&format!("{case}/render?depth_mm=8&{keys}"))
                .await
                .grey()
        };
        let (one, other) = (seen(&case, one).await, seen(&mirrored, other).await);
        let other = image::imageops::flip_horizontal(&other);
        let pairs = one.pixels().zip(other.pixels());
        let differing = pairs
            .filter(|(one, other)| one[0].abs_diff(other[0]) > 12)
            .count();
        assert!(one.pixels().filter(|pixel| pixel[0] > 0).count() > 20_000);
        assert!(differing < 2_500, "{differing}");
    }
}

#[tokio::test]
async fn a_surface_is_made_when_it_is_first_asked_for_kept_and_told_apart_from_the_whole_brain() {
    let server = Server::start_with(|config| {
        config.render.gpu = GpuUse::Off;
        config.limits.maps = MapsUse::Off;
    })
    .await;
    let case = case_of(&server, head(false)).await;
    let whole = server.get(&format!("{case}/render?depth_mm=8")).await;
    let said = server
        .get(&format!("{case}/render?depth_mm=8&surface=whole"))
        .await;
    assert!(whole.body == said.body);
    assert_eq!(stored(&server), 0, "nobody has asked for a part yet");

    let address = format!("{case}/render?depth_mm=8&surface=left&view=mesial-left&annotate=true");
    let left = server.get(&address).await;
    assert_eq!(left.status, StatusCode::OK, "{left:?}");
    assert_eq!(stored(&server), 1);
    assert_eq!(left.header("x-isocortex-device"), "cpu");
    let tag = left.header("etag").to_owned();
    let unchanged = server.get_with(&address, &[("if-none-match", &tag)]).await;
    assert_eq!(unchanged.status, StatusCode::NOT_MODIFIED);

    let deepest = async |surface: &str| {
        let answer = server
            .get(&format!("{case}/render?depth_mm=200&surface={surface}"))
            .await;
        assert_eq!(answer.header("x-isocortex-depth-clamped"), "true");
        answer
            .header("x-isocortex-depth-mm")
            .parse::<f32>()
            .unwrap()
    };
    let (of_half, of_whole) = (deepest("left").await, deepest("whole").await);
    assert!(of_half < of_whole - 5.0, "{of_half} {of_whole}");

    for (surface, is_on_side) in [
        ("left", (|x| x > -2.0) as fn(f32) -> bool),
        ("right", |x| x < 2.0),
    ] {
        let address = format!("{case}/render?depth_mm=6&surface={surface}&view=superior");
        let accept = [("accept", "application/octet-stream")];
        let answer = server.get_with(&address, &accept).await;
        let positions = answer.positions().into_iter();
        let shown: Vec<_> = positions.filter(|position| !position[0].is_nan()).collect();
        assert!(shown.len() > 5_000, "{}", shown.len());
        assert!(
            shown.iter().all(|position| is_on_side(position[0])),
            "{surface}"
        );
    }
    // Without the cerebellum, the lowest point lies higher.
    let lowest = async |surface: &str| {
        let address = format!("{case}/render?depth_mm=2&surface={surface}&view=posterior");
        let accept = [("accept", "application/octet-stream")];
        let answer = server.get_with(&address, &accept).await;
        let heights = answer.positions().into_iter().map(|position| position[2]);
        heights
            .filter(|height| !height.is_nan())
            .fold(f32::INFINITY, f32::min)
    };
    assert!(lowest("cerebrum").await > lowest("whole").await + 15.0);

    let server = server.restart().await;
    assert!(server.get(&address).await.body == left.body);
    assert_eq!(stored(&server), 1);
}

#[tokio::test]
async fn a_side_that_a_surface_lacks_and_a_head_without_parts_are_refused_with_a_reason() {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let case = server.plain_case().await;
    for keys in [
        "view=mesial-left",
        "surface=whole&view=mesial-left",
        "surface=right&view=mesial-left",
        "surface=cerebrum&view=mesial-right",
    ] {
        let answer = server.get(&format!("{case}/render?{keys}")).await;
        assert_eq!(answer.status, StatusCode::BAD_REQUEST, "{keys}");
        assert_eq!(answer.problem(), "query-value-out-of-range");
        let problem = answer.json();
        assert_eq!(problem["parameter"], "view");
        assert!(
            problem["detail"]
                .as_str()
                .unwrap()
                .contains("needs `surface=")
        );
    }
    // Its voxels are too large.
    for _ in 0..2 {
        let answer = server.get(&format!("{case}/render?surface=left")).await;
        assert_eq!(answer.status, StatusCode::CONFLICT);
        assert_eq!(answer.problem(), "no-surfaces");
        assert_eq!(answer.json()["reason"], "coarse-voxels");
        let detail = answer.json()["detail"].as_str().unwrap().to_owned();
        assert!(
            detail.starts_with("only the whole brain has a surface: "),
            "{detail}"
        );
        assert!(detail.contains("4.00 mm"), "{detail}");
    }
    let whole = server.get(&format!("{case}/render?surface=whole")).await;
    assert_eq!(whole.status, StatusCode::OK);
}

#[tokio::test]
async fn a_mask_of_one_side_is_doubted_and_has_no_hemispheres() {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let [volume, mask] = head(false);
    let mask = imaging::nifti::read_mask(&mask, &imaging::Limits::default()).unwrap();
    let place = |index: usize| {
        let voxel = mask.grid().voxel(index).map(|along| along as f64);
        mask.grid()
            .patient_from_voxel()
            .transform_point3(voxel.into())
    };
    let left = mask.voxels().iter().enumerate();
    let left = left.map(|(index, is_brain)| *is_brain && place(index).x > 0.0);
    let left = geometry::Mask::new(mask.grid().clone(), left.collect()).unwrap();
    let left = imaging::nifti::write_mask(&left).unwrap();
    let case = case_of(&server, [volume, left]).await;
    let facts = server.get(&case).await.json();
    assert_eq!(facts["quality"]["state"], "review");
    let codes = facts["quality"]["reason_codes"].as_array().unwrap();
    assert!(codes.contains(&"mask-volume".into()), "{codes:?}");
    // A picture of what there is says so.
    for keys in ["depth_mm=8", "projection=map"] {
        let picture = server.get(&format!("{case}/render?{keys}")).await;
        assert_eq!(picture.status, StatusCode::OK, "{keys}");
        assert_eq!(picture.header("x-isocortex-quality"), "review", "{keys}");
    }
    // A hemisphere would be the whole mask, and its inner side the cut.
    for keys in [
        "surface=left",
        "surface=right",
        "surface=cerebrum",
        "surface=left&view=mesial-left",
        "projection=map&sides=both",
    ] {
        let answer = server.get(&format!("{case}/render?{keys}")).await;
        assert_eq!(answer.status, StatusCode::CONFLICT, "{keys}");
        assert_eq!(answer.problem(), "no-surfaces", "{keys}");
        assert_eq!(answer.json()["reason"], "one-hemisphere", "{keys}");
    }
}

#[tokio::test]
async fn the_parts_of_a_head_are_stored_with_its_maps_and_are_those_that_are_made_on_request() {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let case = case_of(&server, head(false)).await;
    let is_ready = async || {
        let layer = server.get(&format!("{case}/layers/blur")).await.json();
        (layer["state"] == "ready").then_some(())
    };
    until("the maps are made", is_ready).await;
    assert_eq!(stored(&server), 1);
    let address = format!("{case}/render?depth_mm=8&surface=left&view=mesial-left");
    let with_maps = server.get(&address).await;
    assert_eq!(with_maps.status, StatusCode::OK);
    assert_eq!(stored(&server), 1);

    let without = Server::start_with(|config| {
        config.render.gpu = GpuUse::Off;
        config.limits.maps = MapsUse::Off;
    })
    .await;
    let case = case_of(&without, head(false)).await;
    let address = format!("{case}/render?depth_mm=8&surface=left&view=mesial-left");
    assert!(without.get(&address).await.body == with_maps.body);
}

#[tokio::test]
async fn meshes_textures_facts_slices_and_profiles_are_of_the_surface_that_is_asked_for() {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let case = case_of(&server, head(false)).await;
    let raw = [("accept", "application/octet-stream")];
    let is_on_side = |x: f32, surface: &str| if surface == "left" { x > -2.0 } else { x < 2.0 };
    for surface in ["left", "right"] {
        let mesh = format!("{case}/mesh?depth_mm=6&paths=flow&surface={surface}");
        let mesh = server.get_with(&mesh, &raw).await;
        let positions = mesh.positions().into_iter();
        let known: Vec<_> = positions.filter(|place| !place[0].is_nan()).collect();
        let unknown: usize = mesh.header("x-isocortex-unknown-vertices").parse().unwrap();
        assert_eq!(known.len() + unknown, 902);
        assert!(unknown > 0 && known.len() > 600, "{unknown}");
        assert!(known.iter().all(|place| is_on_side(place[0], surface)));
        assert!(mesh.header("cache-control").contains("no-cache"));

        // A file has no triangle where the depth is unknown.
        let is_known: Vec<bool> = (mesh.positions().iter())
            .map(|place| !place[0].is_nan())
            .collect();
        let triangles = server.get(&format!("{case}/mesh/triangles")).await.body;
        let corner = |bytes: &[u8]| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        let kept = triangles
            .chunks_exact(12)
            .filter(|triangle| {
                let mut corners = triangle.chunks_exact(4).map(corner);
                corners.all(|vertex| is_known[vertex as usize])
            })
            .count();
        let address = format!("{case}/mesh?depth_mm=6&paths=flow&surface={surface}");
        let stl = server
            .get_with(&address, &[("accept", "model/stl")])
            .await
            .body;
        assert_eq!(corner(&stl[80..]) as usize, kept);
        assert!(kept < triangles.len() / 12, "{kept}");
        let obj = server
            .get_with(&address, &[("accept", "model/obj")])
            .await
            .body;
        let text = String::from_utf8(obj.to_vec()).unwrap();
        assert_eq!(
            text.lines().filter(|line| line.starts_with("f ")).count(),
            kept
        );
        assert_eq!(
            text.lines().filter(|line| line.starts_with("v ")).count(),
            902
        );

        // GIFTI is in RAS, and names the half.
        let gifti = server.get(&format!("{address}&format=gifti")).await;
        let [(points, positions), (_, triangles)] = &gifti_arrays(&gifti.body)[..] else {
            panic!("a mesh has two arrays");
        };
        let rights = positions.iter().step_by(3).zip(&is_known);
        let rights = rights.filter(|(_, is_known)| **is_known);
        let rights: Vec<_> = rights.map(|(&bits, _)| f32::from_bits(bits)).collect();
        assert!(rights.iter().all(|right| is_on_side(-right, surface)));
        let middle = rights.iter().sum::<f32>() / rights.len() as f32;
        let (name, is_there) = match surface {
            "left" => ("CortexLeft", middle < -10.0),
            _ => ("CortexRight", middle > 10.0),
        };
        assert!(is_there, "{middle}");
        assert!(points.contains(&format!("<Value>{name}</Value>")));
        assert_eq!(triangles.len(), 3 * kept);
        let name = format!("attachment; filename=\"{surface}-6mm.surf.gii\"");
        assert_eq!(gifti.header("content-disposition"), name);

        // FreeSurfer knows the half by the name of the file.
        let triangles = server.get(&format!("{address}&format=freesurfer")).await;
        let name = match surface {
            "left" => "attachment; filename=\"lh.6mm\"",
            _ => "attachment; filename=\"rh.6mm\"",
        };
        assert_eq!(triangles.header("content-disposition"), name);

        // A solid is closed along the fence, and states how much of it is not the depth.
        let address = format!("{case}/mesh?depth_mm=6&solid=true&surface={surface}");
        let solid = server.get(&address).await;
        assert_eq!(solid.header("content-type"), "model/gltf-binary");
        let unknown: usize = solid
            .header("x-isocortex-unknown-vertices")
            .parse()
            .unwrap();
        let solid = MeshFile::read("model/gltf-binary", &solid.body);
        assert!(solid.is_closed());
        let count = solid.corners.len();
        assert!(
            (count / 50..count / 3).contains(&unknown),
            "{unknown} of {count}"
        );
        assert!(
            solid
                .corners
                .iter()
                .all(|place| is_on_side(place[0], surface))
        );

        let distance = server
            .get(&format!("{case}/distance?surface={surface}"))
            .await;
        assert_eq!(distance.header("x-isocortex-format"), "i16");
        let values = distance.body.chunks_exact(2);
        let values = values.map(|pair| i16::from_le_bytes([pair[0], pair[1]]));
        let (mut fenced, mut inside) = (0u32, 0u32);
        for value in values.filter(|value| *value >= 0) {
            inside += 1;
            fenced += u32::from(value & 1 == 1);
        }
        assert!(
            inside > 100_000 && fenced > 1_000 && fenced < inside / 2,
            "{fenced} {inside}"
        );
        let coarse = server
            .get(&format!("{case}/distance?step=4&surface={surface}"))
            .await;
        assert!(coarse.body.len() < distance.body.len() / 40);

        let facts = server
            .get(&format!("{case}?surface={surface}"))
            .await
            .json();
        assert_eq!(facts["surface"], surface);
        let centre = facts["envelope_sphere"]["center_in_patient"][0]
            .as_f64()
            .unwrap();
        assert!(
            centre.abs() > 20.0 && is_on_side(centre as f32, surface),
            "{centre}"
        );
        let table = server
            .get(&format!("{case}/mesh/paths?surface={surface}"))
            .await;
        let deepest = f32::from_le_bytes(*table.body[48..].first_chunk().unwrap());
        let said = facts["max_depth_mm"].as_f64().unwrap();
        assert!((f64::from(deepest) - said).abs() < 0.01, "{deepest} {said}");
    }
    let whole = server.get(&case).await.json();
    assert!(whole.get("surface").is_none());
    assert_eq!(
        whole["id"],
        server.get(&format!("{case}?surface=cerebrum")).await.json()["id"]
    );

    // A slice is framed as that of the whole brain, and the contour follows the falx.
    let slice = async |keys: &str| {
        let address = format!("{case}/slices/coronal?depth_mm=4&{keys}");
        image::load_from_memory(&server.get(&address).await.body)
            .unwrap()
            .to_rgb8()
    };
    let (plain, left, right) = (
        slice("").await,
        slice("surface=left").await,
        slice("surface=right").await,
    );
    let lined = |picture: &image::RgbImage, columns: std::ops::Range<u32>| {
        let pixels = picture
            .enumerate_pixels()
            .filter(|(x, ..)| columns.contains(x));
        pixels
            .filter(|(.., pixel)| pixel[0] > pixel[2].saturating_add(60))
            .count()
    };
    // The patient's left is at the right.
    assert!(lined(&left, 270..512) > 300 && lined(&left, 0..240) == 0);
    assert!(lined(&right, 0..240) > 300 && lined(&right, 270..512) == 0);
    assert!(lined(&plain, 0..240) > 150 && lined(&plain, 270..512) > 150);

    let beside_falx = DVec3::new(8.0, 4.0, 52.0);
    let place = BrainPhantom::PLAIN.placed.transform_point3(beside_falx);
    let profile = async |keys: &str| {
        let [x, y, z] = place.to_array();
        let address = format!("{case}/profile?position={x},{y},{z}{keys}");
        let ask = async || {
            let answer = server.get(&address).await;
            (answer.status == StatusCode::OK).then(|| answer.json())
        };
        until("the maps are made", ask).await
    };
    let depth_of = |answer: &serde_json::Value| answer["point"]["depth_mm"].as_f64().unwrap();
    let of_half = profile("&surface=left").await;
    let of_whole = profile("").await;
    assert!(
        (depth_of(&of_half["own"]) - 7.5).abs() < 2.0,
        "{}",
        depth_of(&of_half["own"])
    );
    assert!(depth_of(&of_whole["own"]) > 15.0);
    assert!((depth_of(&of_half["mirrored"]) - 7.5).abs() < 2.5);
    let [x, y, z] = place.to_array();
    let other = format!("{case}/profile?position={x},{y},{z}&surface=right");
    assert_eq!(server.get(&other).await.status, StatusCode::BAD_REQUEST);
}
