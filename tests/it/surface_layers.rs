//! Values on surfaces as layers: out and in again, placed by their files, compared with the cortex of the head.

use std::path::Path;

use axum::body::Body;
use axum::http::{Method, Request};
use glam::DVec3;
use imaging::surface::{Space, SurfaceFiles, ValuedSurface};
use serde_json::{Value, json};

use crate::dicom::reader;
use crate::heads::data;
use crate::server::{Answer, Part, Server, form, form_type};
use crate::until::until;

async fn add(server: &Server, case: &str, parts: &[Part<'_>], parameters: Value) -> Answer {
    let parameters = parameters.to_string();
    let parts = [parts, &[("parameters", parameters.as_bytes())]].concat();
    let request = Request::builder()
        .method(Method::POST)
        .uri(format!("{case}/layers"))
        .header("content-type", form_type());
    server
        .send(request.body(Body::from(form(&parts))).unwrap())
        .await
}

/// A server that reads surfaces in processes of this program.
async fn server() -> Server {
    Server::start_with(|config| config.dicom_program = reader()).await
}

/// Adds a layer and waits for it: what is known of it.
async fn added(server: &Server, case: &str, parts: &[Part<'_>], parameters: Value) -> Value {
    let answer = add(server, case, parts, parameters).await;
    assert_eq!(answer.status, 202, "{answer:?}");
    let address = answer.header("location").to_owned();
    until("a layer is ready", async || {
        let layer = server.get(&address).await.json();
        assert_ne!(layer["state"], "failed", "{layer}");
        (layer["state"] == "ready").then_some(layer)
    })
    .await
}

/// The values of a layer by its voxels, and where they lie, LPS mm.
async fn values(server: &Server, case: &str, layer: &Value) -> Vec<(DVec3, f32)> {
    let id = layer["id"].as_str().unwrap();
    let file = server.get(&format!("{case}/layers/{id}/nifti")).await;
    assert_eq!(file.status, 200, "{file:?}");
    let read = imaging::nifti::read_values(&file.body, &imaging::Limits::default()).unwrap();
    let place = |index: usize| {
        let voxel = read.grid.voxel(index).map(|along| along as f64);
        read.grid
            .patient_from_voxel()
            .transform_point3(voxel.into())
    };
    let numbers = read.numbers.iter().enumerate();
    let defined = numbers.filter(|(_, number)| !number.is_nan());
    defined
        .map(|(index, &number)| (place(index), number))
        .collect()
}

#[tokio::test]
async fn what_goes_out_comes_in_again_for_gifti_and_for_freesurfer() {
    let server = server().await;
    let case = server.plain_case().await;
    let mesh = format!("{case}/mesh?depth_mm=8&contours=60&points=60");
    let get = async |more: &str| server.get(&format!("{mesh}&{more}")).await.body;
    let surface = get("format=gifti").await;
    let shape = get("format=gifti&values=intensity").await;
    let triangles = get("format=freesurfer").await;
    let curv = get("format=freesurfer&values=intensity").await;
    let gifti = [("surface", &surface[..]), ("values", &shape[..])];
    let gifti = added(&server, &case, &gifti, json!({"name": "GIFTI"})).await;
    assert_eq!(gifti["kind"], "map");
    assert_eq!(gifti["surface"]["vertices"], 3602);
    assert!(
        gifti["surface"]["thickness_mm"].as_f64().unwrap() > 4.0,
        "{gifti}"
    );
    let own = values(&server, &case, &gifti).await;
    assert!(own.len() > 1000);
    // The values are intensities of the head near the vertices, on their side: no mirror image of the head is the head.
    let vertices = server.get(&mesh).await.positions();
    for (place, value) in own.iter().step_by(97) {
        let near = vertices.iter().filter(|vertex| !vertex[0].is_nan());
        let near = near.map(|vertex| glam::Vec3::from(*vertex).as_dvec3().distance(*place));
        let near = near.fold(f64::INFINITY, f64::min);
        assert!(near < 15.0, "{near} mm from {place}");
        assert!((-1.0..=1001.0).contains(value), "{value}");
    }

    // From FreeSurfer's files the voxels are the same, to the last bit, and so it is the same layer.
    let files = [("surface", &triangles[..]), ("values", &curv[..])];
    let again = add(&server, &case, &files, json!({"name": "FreeSurfer"})).await;
    assert_eq!(again.status, 200, "{again:?}");
    assert!(
        again
            .header("location")
            .ends_with(gifti["id"].as_str().unwrap())
    );

    // The surface itself is a label, and an annotation has labels with names.
    let bare = added(&server, &case, &files[..1], json!({"name": "contour"})).await;
    assert_eq!(bare["kind"], "labels");
    let label = &bare["labels"][0];
    assert_eq!(
        [&label["value"], &label["name"]],
        [&json!(1), &json!("surface 1")]
    );
    assert!(label["voxels"].as_u64().unwrap() as usize >= own.len());
    let annotation = annotation(3602);
    let files = [files[0], ("values", &annotation)];
    let labels = added(&server, &case, &files, json!({"name": "annotation"})).await;
    assert_eq!(labels["kind"], "labels");
    let label = |number: usize| {
        let label = &labels["labels"][number];
        (label["value"].as_u64().unwrap(), label["name"].clone())
    };
    assert_eq!(label(0), (1, json!("front")));
    assert_eq!(label(1), (7, json!("back")));

    // Two surfaces, as both hemispheres would be. The head has no folds so deep, so that nothing tells the sides.
    let mesh = mesh.replace("depth_mm=8", "depth_mm=24");
    let get = async |more: &str| server.get(&format!("{mesh}&{more}")).await.body;
    let other = get("format=gifti").await;
    let other_shape = get("format=gifti&values=intensity").await;
    let both = [
        ("surface", &surface[..]),
        ("values", &shape[..]),
        ("surface", &other[..]),
        ("values", &other_shape[..]),
    ];
    let both = added(&server, &case, &both, json!({"name": "both"})).await;
    assert_eq!(both["surface"]["vertices"], 2 * 3602);
    let both = values(&server, &case, &both).await;
    assert!(both.len() > own.len() * 5 / 4);
    let deep = [("surface", &other[..]), ("values", &other_shape[..])];
    let deep = added(&server, &case, &deep, json!({"name": "deep"})).await;
    assert_eq!(deep["quality"], "review", "{deep}");

    // A picture shows it in colours.
    let picture = format!("{case}/render?depth_mm=8&view=left&width=200&height=200");
    let plain = server.get(&picture).await.body;
    let shown = server.get(&format!("{picture}&overlay=GIFTI")).await;
    assert_eq!(shown.status, 200, "{shown:?}");
    assert_ne!(shown.body, plain);

    let footer = triangles
        .windows(9)
        .position(|nine| nine == b"valid = 1")
        .unwrap()
        - 12;
    let bare = &triangles[..footer];
    for (parts, parameters, status, kind) in [
        (
            vec![("surface", bare), ("values", &curv)],
            json!({}),
            422,
            "surface-space-unknown",
        ),
        (
            vec![("surface", &triangles[..])],
            json!({"kind": "map"}),
            422,
            "values-missing",
        ),
        (vec![("values", &curv[..])], json!({}), 400, "surface-parts"),
        (
            vec![("surface", &surface), ("values", &shape), ("volume", &curv)],
            json!({}),
            400,
            "volume-twice",
        ),
        (
            vec![("surface", &surface), ("values", &surface)],
            json!({}),
            422,
            "values-missing",
        ),
        (
            vec![("surface", &curv), ("values", &shape)],
            json!({}),
            415,
            "surface-not-recognised",
        ),
        (
            vec![("surface", &surface), ("values", &shape)],
            json!({"kind": "mr"}),
            422,
            "surface-parameters",
        ),
        (
            vec![("surface", &surface), ("values", &shape)],
            json!({"transform": "none"}),
            422,
            "surface-parameters",
        ),
        (
            vec![("surface", &surface), ("values", &shape)],
            json!({"series": 3}),
            400,
            "parameters-unreadable",
        ),
        (
            vec![("surface", &surface), ("values", &shape)],
            json!({"affine": "sform"}),
            400,
            "parameters-unreadable",
        ),
        // What can be told without the files is told first.
        (
            vec![("surface", &curv), ("values", &shape)],
            json!({"name": " x "}),
            422,
            "name-unusable",
        ),
        (
            vec![("surface", &curv), ("values", &shape)],
            json!({"unit": "a unit that is longer than any"}),
            422,
            "unit-unusable",
        ),
        (
            vec![("surface", &surface), ("values", &shape)],
            json!({"column": 2}),
            422,
            "values-column",
        ),
        (
            vec![("volume", &curv[..])],
            json!({"space": "scanner"}),
            400,
            "parameters-unreadable",
        ),
    ] {
        let refused = add(&server, &case, &parts, parameters).await;
        assert_eq!(
            (refused.status.as_u16(), &*refused.problem()),
            (status, kind),
            "{refused:?}"
        );
    }
}

/// An annotation: the first half of the vertices is `front`, the other half `back`.
pub(crate) fn annotation(vertices: usize) -> Vec<u8> {
    let mut file = Vec::new();
    let mut put = |numbers: &[i32]| file.extend(numbers.iter().flat_map(|n| n.to_be_bytes()));
    put(&[vertices as i32]);
    for vertex in 0..vertices {
        let is_front = vertex < vertices / 2;
        put(&[
            vertex as i32,
            if is_front { 0x0a_14_1e } else { 0x01_02_03 },
        ]);
    }
    put(&[1, -2, 8, 0, 2]);
    for (number, name, color) in [(7, "back\0\0\0", [3, 2, 1]), (1, "front\0\0", [30, 20, 10])] {
        let name = name.as_bytes();
        file.extend(
            [number, name.len() as i32]
                .iter()
                .flat_map(|n: &i32| n.to_be_bytes()),
        );
        file.extend(name);
        file.extend(color.iter().chain(&[0]).flat_map(|n: &i32| n.to_be_bytes()));
    }
    file
}

/// A surface of the real head, its values the heights of its vertices.
fn surface_of(folder: &Path, name: &str) -> (Vec<u8>, ValuedSurface) {
    let file = std::fs::read(folder.join(name)).unwrap();
    // Any values: only how many there are is not known yet.
    let count = |file: &[u8]| {
        let files = SurfaceFiles {
            surface: file,
            values: Some(&curv(&[0.0])),
        };
        let refused = imaging::surface::read(files, None, Some(Space::Scanner), None);
        match refused.unwrap_err() {
            imaging::surface::SurfaceError::OfAnother { vertices, .. } => vertices,
            error => panic!("{error}"),
        }
    };
    let values = curv(&vec![0.0; count(&file)]);
    let files = SurfaceFiles {
        surface: &file,
        values: Some(&values),
    };
    let mut read = imaging::surface::read(files, None, Some(Space::Scanner), None).unwrap();
    read.values = read
        .positions_in_patient
        .iter()
        .map(|place| place.z as f32)
        .collect();
    (file, read)
}

pub(crate) fn curv(values: &[f32]) -> Vec<u8> {
    let counts = [values.len() as i32, 0, 1].map(i32::to_be_bytes);
    let values = values.iter().flat_map(|value| value.to_be_bytes());
    [
        &[0xff; 3],
        counts.as_flattened(),
        &values.collect::<Vec<_>>(),
    ]
    .concat()
}

/// A surface as FreeSurfer writes it, with the footer of a conformed volume that has its centre at `c_ras`.
fn freesurfer(surface: &ValuedSurface, c_ras: DVec3, moved: impl Fn(DVec3) -> DVec3) -> Vec<u8> {
    let mut file = b"\xff\xff\xfewritten by a test\n\n".to_vec();
    let counts = [surface.positions_in_patient.len(), surface.triangles.len()];
    file.extend(
        counts
            .iter()
            .flat_map(|&count| (count as i32).to_be_bytes()),
    );
    for &place in &surface.positions_in_patient {
        let place = moved(place);
        let tkregister = DVec3::new(-place.x, -place.y, place.z) - c_ras;
        file.extend(
            tkregister
                .as_vec3()
                .to_array()
                .iter()
                .flat_map(|x| x.to_be_bytes()),
        );
    }
    let numbers = surface.triangles.as_flattened().iter();
    file.extend(numbers.flat_map(|number| number.to_be_bytes()));
    file.extend([0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 20]);
    file.extend(
        format!(
            "valid = 1  # volume info valid\nfilename = T1.mgz\nvolume = 256 256 256\nvoxelsize = 1 1 1\nxras   = -1 0 0\n\
             yras   = 0 0 -1\nzras   = 0 1 0\ncras   = {} {} {}\n",
            c_ras.x, c_ras.y, c_ras.z
        )
        .bytes(),
    );
    file
}

#[tokio::test]
async fn surfaces_of_a_real_head_follow_its_cortex_and_those_that_do_not_are_reviewed_or_refused() {
    let Some(folder) = data().map(|folder| folder.join("pycortex-s1")) else {
        return;
    };
    let file = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let server = server().await;
    let (volume, mask) = (file("t1.nii.gz"), file("mask_brain.nii.gz"));
    let case = server
        .prepared(&[("volume", &volume), ("mask", &mask)])
        .await;
    for name in ["wm", "pia"] {
        let [left, right] =
            ["lh", "rh"].map(|half| surface_of(&folder, &format!("{name}_{half}.gii")));
        let [left_values, right_values] = [&left, &right].map(|(_, read)| curv(&read.values));
        let parts = [
            ("surface", &left.0[..]),
            ("values", &left_values[..]),
            ("surface", &right.0[..]),
            ("values", &right_values[..]),
        ];
        let unstated = add(&server, &case, &parts, json!({})).await;
        assert_eq!(unstated.problem(), "surface-space-unknown");
        let own = json!({"name": name, "space": "scanner"});
        let own = added(&server, &case, &parts, own).await;
        assert_eq!(own["quality"], "ok", "{own}");
        let [median, p95] = ["junction_median_mm", "junction_p95_mm"]
            .map(|name| own["fit"][name].as_f64().unwrap());
        eprintln!("{name}: {median} mm from the junction in the median, 95 % within {p95} mm");
        assert!(median < if name == "wm" { 1.0 } else { 3.0 }, "{own}");
        // The values are heights: each voxel has that of a place within the sheet.
        let own = values(&server, &case, &own).await;
        let is_near = |(place, value): &&(DVec3, f32)| (place.z - f64::from(*value)).abs() < 1.05;
        assert_eq!(own.iter().filter(is_near).count(), own.len());
        assert!(own.len() > 300_000, "{}", own.len());

        let c_ras = DVec3::new(4.5, -20.25, 12.0);
        let triangles = freesurfer(&left.1, c_ras, |place| place);
        let parts = [("surface", &triangles[..]), ("values", &left_values[..])];
        let by_footer = added(
            &server,
            &case,
            &parts,
            json!({"name": format!("{name} by footer")}),
        )
        .await;
        assert_eq!(by_footer["quality"], "ok", "{by_footer}");
        let by_footer = values(&server, &case, &by_footer).await;
        let is_left = |(place, _): &&(DVec3, f32)| place.x > 0.0;
        assert!(by_footer.iter().filter(is_left).count() * 100 > by_footer.len() * 95);

        let mirrored = freesurfer(&left.1, c_ras, |place| {
            DVec3::new(-place.x, place.y, place.z)
        });
        let parts = [("surface", &mirrored[..]), ("values", &left_values[..])];
        let name = format!("{name} mirrored");
        let mirrored = add(&server, &case, &parts, json!({"name": name})).await;
        let address = mirrored.header("location").to_owned();
        let mirrored = until("a layer fails", async || {
            let layer = server.get(&address).await.json();
            assert_ne!(layer["state"], "ready", "{layer}");
            (layer["state"] == "failed").then_some(layer)
        });
        let error = mirrored.await["error"]["type"].to_string();
        assert!(error.contains("surface-mirrored"), "{error}");
        let moved = freesurfer(&left.1, c_ras, |place| place + DVec3::new(0.0, 5.0, 0.0));
        let parts = [("surface", &moved[..]), ("values", &left_values[..])];
        let moved = added(
            &server,
            &case,
            &parts,
            json!({"name": format!("{name} moved")}),
        )
        .await;
        assert_eq!(moved["quality"], "review", "{moved}");
        assert_eq!(moved["reason_code"], "not-along-cortex");
    }
}
