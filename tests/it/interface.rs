//! What a ready case answers: meshes, textures, pictures.

use axum::http::StatusCode;

use crate::head::plain_head;
use crate::server::{Answer, Server};

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(u32_at(bytes, at))
}

#[tokio::test]
async fn a_mesh_has_the_vertices_and_triangles_that_it_promises() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    for (query, vertices) in [("", 902), ("contours=7&points=11", 79), ("paths=flow", 902)] {
        let mesh = server.get(&format!("{case}/mesh?depth_mm=8&{query}")).await;
        assert_eq!(mesh.positions().len(), vertices, "{query}");
    }
    let triangles = server
        .get(&format!("{case}/mesh/triangles?contours=7&points=11"))
        .await;
    assert_eq!(triangles.body.len(), 12 * 2 * 7 * 11);
    let numbers = (0..triangles.body.len())
        .step_by(4)
        .map(|at| u32_at(&triangles.body, at));
    assert_eq!(numbers.max(), Some(78));
}

#[tokio::test]
async fn a_deeper_mesh_lies_within_a_shallower_one() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let mut widest = f32::INFINITY;
    for depth in [0, 5, 10, 20, 40] {
        let mesh = server
            .get(&format!("{case}/mesh?depth_mm={depth}"))
            .await
            .positions();
        let lefts = mesh.iter().map(|position| position[0]);
        let width = lefts.clone().fold(f32::MIN, f32::max) - lefts.fold(f32::MAX, f32::min);
        assert!(width < widest, "{depth} mm: {width} mm wide");
        widest = width;
    }
}

#[tokio::test]
async fn every_format_holds_the_same_mesh() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let address = format!("{case}/mesh?depth_mm=8");
    let positions = server.get(&address).await.body;
    let of = async |media_type: &str| {
        let answer = server.get_with(&address, &[("accept", media_type)]).await;
        assert_eq!(answer.header("content-type"), media_type);
        answer.body
    };
    let glb = of("model/gltf-binary").await;
    assert_eq!(u32_at(&glb, 8) as usize, glb.len());
    let binary = 20 + u32_at(&glb, 12) as usize + 8;
    assert_eq!(glb[binary..binary + positions.len()], positions);
    let stl = of("model/stl").await;
    assert_eq!(u32_at(&stl, 80), 1800);
    assert_eq!(stl.len(), 84 + 50 * 1800);
    let ply = of("application/ply").await;
    let start = ply
        .windows(11)
        .position(|window| window == b"end_header\n")
        .unwrap()
        + 11;
    assert_eq!(ply[start..start + positions.len()], positions);
    let obj = of("model/obj").await;
    let text = std::str::from_utf8(&obj).unwrap();
    let first = text.lines().find(|line| line.starts_with("v ")).unwrap();
    let first: Vec<f32> = first[2..].split(' ').map(|x| x.parse().unwrap()).collect();
    assert_eq!(first, [0, 4, 8].map(|at| f32_at(&positions, at)));
    assert_eq!(
        text.lines().filter(|line| line.starts_with("f ")).count(),
        1800
    );
}

/// Shrinks a mesh by the table of its paths, as a client would: following the wire README alone.
fn shrunk_by_client(file: &[u8], depth_mm: f32) -> Vec<[f32; 3]> {
    assert_eq!(&file[..4], b"ISOP");
    let [vertices, rows, pieces] = [16, 20, 24].map(|at| u32_at(file, at) as usize);
    let origin = [28, 32, 36].map(|at| f32_at(file, at));
    let (step_mm, row_mm) = (f32_at(file, 40), f32_at(file, 44));
    let first_piece = |row: usize| u32_at(file, 56 + 4 * row) as usize;
    let pieces_at = 60 + 4 * rows;
    let planes_at = pieces_at + 24 * pieces;
    let stored = |at: usize| u16::from_le_bytes([file[at], file[at + 1]]);
    let sum = |axis: usize, row: usize, vertex: usize| {
        (0..=row).fold(0u16, |sum, row| {
            sum.wrapping_add(stored(
                planes_at + 2 * ((axis * rows + row) * vertices + vertex),
            ))
        })
    };
    let row = ((depth_mm / row_mm) as usize).min(rows - 2);
    let mix = |near: u16, far: u16, share: f32| {
        f32::from(near) + (f32::from(far) - f32::from(near)) * share
    };
    let at_vertex = |vertex: usize| {
        let share = (depth_mm - row as f32 * row_mm) / row_mm;
        let mut position =
            [0, 1, 2].map(|axis| mix(sum(axis, row, vertex), sum(axis, row + 1, vertex), share));
        for piece in first_piece(row)..first_piece(row + 1) {
            let at = pieces_at + 24 * piece;
            let [start, end] = [4, 8].map(|offset| f32_at(file, at + offset));
            if u32_at(file, at) as usize == vertex && depth_mm > start && depth_mm <= end {
                let share = (depth_mm - start) / (end - start);
                position = [0, 1, 2].map(|axis| {
                    mix(
                        stored(at + 12 + 2 * axis),
                        stored(at + 18 + 2 * axis),
                        share,
                    )
                });
            }
        }
        [0, 1, 2].map(|axis| origin[axis] + step_mm * position[axis])
    };
    (0..vertices).map(at_vertex).collect()
}

#[tokio::test]
async fn the_table_of_paths_gives_the_mesh_at_any_depth() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let table = server
        .get(&format!("{case}/mesh/paths?contours=9&points=8"))
        .await
        .body;
    for depth in [0.0, 3.3, 12.25, 31.9] {
        let address = format!("{case}/mesh?depth_mm={depth}&contours=9&points=8");
        let mesh = server.get(&address).await.positions();
        let own = shrunk_by_client(&table, depth);
        for (own, mesh) in own.iter().zip(&mesh) {
            assert!(
                (0..3).all(|axis| (own[axis] - mesh[axis]).abs() < 1e-3),
                "{own:?} {mesh:?}"
            );
        }
    }
}

#[tokio::test]
async fn textures_say_how_to_read_them() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let facts = server.get(&case).await.json();
    for (route, format, greatest) in [
        ("volume", "u16", facts["intensity"]["max"].as_f64().unwrap()),
        ("distance", "i16", facts["max_depth_mm"].as_f64().unwrap()),
    ] {
        let texture = server.get(&format!("{case}/{route}")).await;
        let size = texture.header("x-isocortex-size").split(',');
        let voxels: usize = size.map(|side| side.parse::<usize>().unwrap()).product();
        assert_eq!(texture.body.len(), 2 * voxels, "{route}");
        assert_eq!(texture.header("x-isocortex-format"), format);
        assert_eq!(
            texture
                .header("x-isocortex-patient-from-voxel")
                .split(',')
                .count(),
            12
        );
        let [scale, offset] = ["scale", "offset"].map(|name| {
            texture
                .header(&format!("x-isocortex-{name}"))
                .parse::<f64>()
                .unwrap()
        });
        let stored = texture.body.chunks_exact(2).map(|pair| {
            let pair = [pair[0], pair[1]];
            if format == "u16" {
                f64::from(u16::from_le_bytes(pair))
            } else {
                f64::from(i16::from_le_bytes(pair))
            }
        });
        let read = stored
            .map(|value| scale * value + offset)
            .fold(f64::MIN, f64::max);
        assert!(
            (read - greatest).abs() < 0.02 * greatest,
            "{route}: {read} and {greatest}"
        );
    }
}

#[tokio::test]
async fn slices_and_the_whole_volume_show_what_lies_beyond_the_envelope() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let facts = server.get(&case).await.json();
    let cropped = server.get(&format!("{case}/volume")).await;
    let whole = server.get(&format!("{case}/volume?extent=whole")).await;
    let size = numbers(&whole, "x-isocortex-size");
    let acquired = facts["volume"]["size"].as_array().unwrap();
    let acquired: Vec<_> = acquired.iter().map(|side| side.as_f64().unwrap()).collect();
    assert_eq!(size, acquired);
    assert!(whole.body.len() > cropped.body.len());
    let quick = format!("{case}/volume?extent=whole&bits=8");
    assert_eq!(2 * server.get(&quick).await.body.len(), whole.body.len());
    // Up to the first and the last column of the volume there is air, which is white here; beyond them, nothing.
    let origin = numbers(&whole, "x-isocortex-patient-from-voxel");
    for (column, shows) in [(0.0, true), (size[0] - 1.0, true), (size[0], false)] {
        let position_mm = origin[3] + column * origin[0];
        let query = format!("position_mm={position_mm}&colormap=inverted&width=64&height=64");
        let slice = server.get(&format!("{case}/slices/sagittal?{query}")).await;
        let lit = slice.grey().pixels().filter(|pixel| pixel.0[0] > 0).count();
        assert_eq!(lit > 100, shows, "{position_mm} mm: {lit} pixels");
    }
}

/// A header's numbers.
fn numbers(answer: &Answer, name: &str) -> Vec<f64> {
    let parts = answer.header(name).split(',').map(str::parse);
    parts.collect::<Result<_, _>>().unwrap()
}

#[tokio::test]
async fn the_volume_in_eight_bits_is_that_of_sixteen_within_half_a_step() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let facts = server.get(&case).await.json();
    let whole = server.get(&format!("{case}/volume")).await;
    let quick = server.get(&format!("{case}/volume?bits=8")).await;
    assert_eq!(quick.header("x-isocortex-format"), "u8");
    for name in ["x-isocortex-size", "x-isocortex-patient-from-voxel"] {
        assert_eq!(quick.header(name), whole.header(name));
    }
    assert_eq!(2 * quick.body.len(), whole.body.len());
    let value = |answer: &Answer, stored: f64| {
        let [scale, offset] =
            ["scale", "offset"].map(|name| numbers(answer, &format!("x-isocortex-{name}"))[0]);
        scale * stored + offset
    };
    let window = &facts["intensity"]["window"];
    let [center, width] = ["center", "width"].map(|name| window[name].as_f64().unwrap());
    let ends = [0.0, 255.0].map(|stored| value(&quick, stored));
    let range = |name: &str| facts["intensity"][name].as_f64().unwrap();
    let wanted = [
        (center - width / 2.0).max(range("min")),
        (center + width / 2.0).min(range("max")),
    ];
    // Scale and offset are in single precision.
    let slack = 1e-4 * width;
    assert!(
        ends[0] <= wanted[0] + slack && ends[1] >= wanted[1] - slack,
        "{ends:?} do not hold {wanted:?}"
    );
    let half_a_step = 0.501 * (ends[1] - ends[0]) / 255.0;
    for (pair, &stored) in whole.body.chunks_exact(2).zip(&quick.body) {
        let acquired = value(&whole, f64::from(u16::from_le_bytes([pair[0], pair[1]])));
        let off = value(&quick, f64::from(stored)) - acquired.clamp(ends[0], ends[1]);
        assert!(off.abs() <= half_a_step, "{acquired} is off by {off}");
    }
}

#[tokio::test]
async fn coarse_depths_are_depths_of_the_whole_map() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let whole = server.get(&format!("{case}/distance")).await;
    let coarse = server.get(&format!("{case}/distance?step=4")).await;
    let size = |answer: &Answer| -> Vec<usize> {
        numbers(answer, "x-isocortex-size")
            .into_iter()
            .map(|side| side as usize)
            .collect()
    };
    let ([nx, ny, nz], [cx, cy, cz]) = (
        <[usize; 3]>::try_from(size(&whole)).unwrap(),
        <[usize; 3]>::try_from(size(&coarse)).unwrap(),
    );
    assert_eq!([cx, cy, cz], [nx, ny, nz].map(|side| side.div_ceil(4)));
    let depth =
        |answer: &Answer, index: usize| [answer.body[2 * index], answer.body[2 * index + 1]];
    for index in 0..cx * cy * cz {
        let [x, y, z] = [index % cx, index / cx % cy, index / (cx * cy)].map(|place| 4 * place);
        assert_eq!(depth(&coarse, index), depth(&whole, x + nx * (y + ny * z)));
    }
    let [fine, wide] =
        [&whole, &coarse].map(|answer| numbers(answer, "x-isocortex-patient-from-voxel"));
    for (place, (fine, wide)) in fine.into_iter().zip(wide).enumerate() {
        let factor = if place % 4 == 3 { 1.0 } else { 4.0 };
        assert_eq!(factor * fine, wide);
    }
}

#[tokio::test]
async fn pictures_show_the_brain_and_name_their_renderer() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    for view in [
        "left",
        "right",
        "anterior",
        "posterior",
        "superior",
        "inferior",
    ] {
        let answer = server
            .get(&format!(
                "{case}/render?depth_mm=8&view={view}&width=96&height=64"
            ))
            .await;
        assert_eq!(answer.header("x-isocortex-renderer"), "trace");
        assert_eq!(answer.header("content-type"), "image/png");
        let picture = answer.grey();
        assert_eq!(picture.dimensions(), (96, 64));
        let lit = picture.pixels().filter(|pixel| pixel.0[0] > 20).count();
        assert!(lit > 250, "{view}: {lit} pixels");
    }
    for plane in ["axial", "coronal", "sagittal"] {
        let answer = server
            .get(&format!(
                "{case}/slices/{plane}?depth_mm=5,10&width=64&height=64"
            ))
            .await;
        let lit = answer
            .grey()
            .pixels()
            .filter(|pixel| pixel.0[0] > 20)
            .count();
        assert!(lit > 400, "{plane}: {lit} pixels");
    }
    let none = server.get(&format!("{case}/slices/diagonal")).await;
    assert_eq!(none.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn the_service_says_what_it_is_and_counts() {
    let server = Server::start().await;
    assert_eq!(server.get("/readyz").await.json()["status"], "ok");
    assert_eq!(server.get("/version").await.json()["name"], "isocortex");
    server.upload(&[("volume", &plain_head().bytes())]).await;
    let metrics = server.get("/metrics").await;
    let text = String::from_utf8(metrics.body.to_vec()).unwrap();
    assert!(
        text.contains(
            "isocortex_http_requests_total{method=\"POST\",route=\"/v1/cases\",status=\"202\"} 1"
        ),
        "{text}"
    );
    assert!(text.ends_with("# EOF\n"));
}
