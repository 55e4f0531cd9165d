//! The folder of a FreeSurfer subject: one upload, or one command, makes a case with its layers.

use std::io::Write as _;
use std::path::Path;

use axum::body::Body;
use axum::http::{Request, header};
use serde_json::Value;
use zip::write::{SimpleFileOptions, ZipWriter};

use crate::command_line::{done, run};
use crate::dicom::reader;
use crate::head::{mask_of, plain_head};
use crate::nifti::{Data, Nifti};
use crate::server::Server;
use crate::surface_layers::{annotation, curv};
use crate::until::until;

/// A volume as MGH of 16 bits.
fn mgh(nifti: &Nifti) -> Vec<u8> {
    let voxels: Vec<i16> = match &nifti.data {
        Data::I16(voxels) => voxels.clone(),
        Data::U8(voxels) => voxels.iter().map(|&voxel| voxel.into()).collect(),
    };
    let [x, y, z] = nifti.size.map(i32::from);
    let mut file: Vec<u8> = [1, x, y, z, 1, 4, 0]
        .iter()
        .flat_map(|n: &i32| n.to_be_bytes())
        .collect();
    file.extend([0, 1]);
    let column = |column: usize| nifti.ras_from_voxel.map(|row| row[column]);
    let edge = |axis: usize| {
        column(axis)
            .iter()
            .map(|along| along * along)
            .sum::<f32>()
            .sqrt()
    };
    let edges = [0, 1, 2].map(edge);
    let mut middle = column(3);
    for (axis, side) in nifti.size.into_iter().enumerate() {
        for (along, step) in middle.iter_mut().zip(column(axis)) {
            *along += step * f32::from(side) / 2.0;
        }
    }
    let axes = [0, 1, 2].map(|axis| column(axis).map(|along| along / edges[axis]));
    let numbers = [&edges[..], axes.as_flattened(), &middle].concat();
    file.extend(numbers.iter().flat_map(|number| number.to_be_bytes()));
    file.resize(284, 0);
    file.extend(voxels.iter().flat_map(|voxel| voxel.to_be_bytes()));
    file
}

/// The files of a subject with one hemisphere, whose white surface is a cut of the head.
async fn subject(server: &Server) -> Vec<(String, Vec<u8>)> {
    let case = server.plain_case().await;
    let mesh = |depth_mm: u32| {
        format!("{case}/mesh?depth_mm={depth_mm}&contours=60&points=60&format=freesurfer")
    };
    let head = plain_head();
    let Data::I16(voxels) = &head.data else {
        panic!("heads are made of i16");
    };
    let regions = voxels
        .iter()
        .enumerate()
        .map(|(index, &voxel)| match (voxel, index % 2) {
            (0, _) => 0,
            (_, 0) => 10,
            _ => 1001,
        });
    let regions = Nifti {
        data: Data::I16(regions.collect()),
        ..head.clone()
    };
    let heights: Vec<f32> = (0..3602_u16).map(f32::from).collect();
    [
        ("mri/T1.mgz", mgh(&head)),
        ("mri/brainmask.mgz", mgh(&mask_of(&head))),
        ("mri/aparc+aseg.mgz", mgh(&regions)),
        ("surf/lh.white", server.get(&mesh(8)).await.body.to_vec()),
        ("surf/lh.pial", server.get(&mesh(4)).await.body.to_vec()),
        ("surf/lh.thickness", curv(&heights)),
        ("label/lh.aparc.annot", annotation(3602)),
        ("scripts/recon-all.log", b"nothing that is read".to_vec()),
    ]
    .map(|(name, file)| (name.to_owned(), file))
    .to_vec()
}

fn zipped(folder: &str, files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut archive = ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, file) in files {
        let path = format!("{folder}{name}");
        archive
            .start_file(path, SimpleFileOptions::default())
            .unwrap();
        archive.write_all(file).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// The layers of a case that were added to it, once all are ready.
async fn layers(server: &Server, case: &str) -> Vec<Value> {
    until("the layers are ready", async || {
        let layers = server.get(&format!("{case}/layers")).await.json();
        let layers: Vec<Value> = layers["layers"].as_array().unwrap().clone();
        let added = layers
            .into_iter()
            .filter(|layer| !layer["created_at"].is_null());
        let added: Vec<Value> = added.collect();
        assert!(
            added.iter().all(|layer| layer["state"] != "failed"),
            "{added:?}"
        );
        added
            .iter()
            .all(|layer| layer["state"] == "ready")
            .then_some(added)
    })
    .await
}

#[tokio::test]
async fn a_zip_of_a_subject_becomes_a_case_with_its_brain_and_its_layers() {
    let server = Server::start_with(|config| config.dicom_program = reader()).await;
    let files = subject(&server).await;
    let archive = zipped("Smith Anna/", &files);
    let made = server.upload(&[("volume", &archive)]).await;
    assert_eq!(made.status, 202, "{made:?}");
    let case = made.header("location").to_owned();
    let ready = server.until_ready(&case).await;
    assert_eq!(ready["quality"]["method"], "supplied", "{ready}");
    let found = layers(&server, &case).await;
    let layer = |name: &str| found.iter().find(|layer| layer["name"] == name).unwrap();
    let names: Vec<_> = found
        .iter()
        .map(|layer| layer["name"].as_str().unwrap())
        .collect();
    assert_eq!(
        names,
        ["white and pial", "surface thickness", "aparc", "aparc+aseg"]
    );
    let labels = |name: &str| {
        let labels = layer(name)["labels"].as_array().unwrap().iter();
        let label = |label: &Value| {
            (
                label["value"].as_u64().unwrap(),
                label["name"].as_str().unwrap().to_owned(),
            )
        };
        labels.map(label).collect::<Vec<_>>()
    };
    let named = |labels: &[(u64, &str)]| {
        labels
            .iter()
            .map(|&(value, name)| (value, name.to_owned()))
            .collect::<Vec<_>>()
    };
    assert_eq!(
        labels("white and pial"),
        named(&[(1, "lh.white"), (2, "lh.pial")])
    );
    assert_eq!(labels("aparc"), named(&[(1, "front"), (7, "back")]));
    assert_eq!(
        labels("aparc+aseg"),
        named(&[(10, "Left-Thalamus"), (1001, "ctx-lh-front")])
    );
    assert_eq!(layer("surface thickness")["unit"], "mm");
    assert_eq!(layer("surface thickness")["kind"], "map");
    assert!(
        layer("surface thickness")["fit"]["spread"].is_number(),
        "{found:?}"
    );

    // The same again, at another place in the archive: nothing is added.
    let again = server.upload(&[("volume", &zipped("", &files))]).await;
    assert_eq!(again.status, 200, "{again:?}");
    assert_eq!(again.header("location"), case);
    assert_eq!(layers(&server, &case).await.len(), found.len());
    // A mask that is sent counts more, and makes another case.
    let mask = mask_of(&plain_head()).bytes();
    let other = server
        .upload(&[("volume", &archive), ("mask", &mask)])
        .await;
    assert_eq!(other.status, 202, "{other:?}");
    assert_ne!(other.header("location"), case);

    // FreeSurfer links some files to others beside them; a link that leads elsewhere is left out.
    let archive = std::io::Cursor::new(zipped("", &files[..3]));
    let mut archive = ZipWriter::new_append(archive).unwrap();
    let options = SimpleFileOptions::default();
    archive.start_file("surf/lh.pial.T1", options).unwrap();
    archive.write_all(&files[4].1).unwrap();
    archive
        .add_symlink("surf/lh.pial", "lh.pial.T1", options)
        .unwrap();
    archive
        .add_symlink("surf/rh.pial", "../../../etc/passwd", options)
        .unwrap();
    archive
        .add_symlink("surf/lh.white", "lh.white", options)
        .unwrap();
    let linked = archive.finish().unwrap().into_inner();
    let mask = [
        ("volume", &linked[..]),
        ("parameters", &br#"{"closing_radius_mm": 9}"#[..]),
    ];
    let linked = server.upload(&mask).await;
    assert_eq!(linked.status, 202, "{linked:?}");
    let case = linked.header("location").to_owned();
    server.until_ready(&case).await;
    let found = layers(&server, &case).await;
    let names: Vec<_> = found
        .iter()
        .map(|layer| layer["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["white and pial", "aparc+aseg"]);
    assert_eq!(found[0]["labels"][0]["name"], "lh.pial");
}

#[tokio::test]
async fn what_is_wrong_with_a_subject_is_said_of_its_file() {
    let server = Server::start_with(|config| config.dicom_program = reader()).await;
    let files = subject(&server).await;
    let with = |name: &str, file: Vec<u8>| {
        let mut changed = files.clone();
        changed
            .iter_mut()
            .find(|(known, _)| known == name)
            .unwrap()
            .1 = file;
        zipped("s/", &changed)
    };
    let [t1, white] = [&files[0].1, &files[3].1];
    let mut lies = t1.clone();
    lies[4..8].copy_from_slice(&i32::MAX.to_be_bytes());
    let mut beyond = white.clone();
    let faces = beyond.windows(2).position(|two| two == b"\n\n").unwrap() + 10 + 12 * 3602;
    beyond[faces..faces + 4].copy_from_slice(&3602_i32.to_be_bytes());
    let two = [zipped("one/", &files), zipped("two/", &files)];
    let two = {
        let mut both = ZipWriter::new_append(std::io::Cursor::new(two[0].clone())).unwrap();
        both.start_file("two/mri/T1.mgz", SimpleFileOptions::default())
            .unwrap();
        both.write_all(t1).unwrap();
        both.finish().unwrap().into_inner()
    };
    for (archive, status, kind, words) in [
        (
            with("mri/T1.mgz", t1[..200].to_vec()),
            422,
            "surface-damaged",
            "mri/T1.mgz",
        ),
        (
            with("mri/T1.mgz", t1[..5000].to_vec()),
            422,
            "nifti-truncated",
            "",
        ),
        (
            with("mri/T1.mgz", lies),
            422,
            "surface-damaged",
            "mri/T1.mgz",
        ),
        (
            with("mri/T1.mgz", b"text".to_vec()),
            422,
            "surface-damaged",
            "mri/T1.mgz",
        ),
        (
            with("surf/lh.white", white[..9000].to_vec()),
            422,
            "surface-damaged",
            "surf/lh.white",
        ),
        (
            with("surf/lh.white", beyond),
            422,
            "surface-damaged",
            "does not have",
        ),
        (
            with("surf/lh.thickness", curv(&[1.0; 7])),
            422,
            "values-of-another-surface",
            "surf/lh.thickness",
        ),
        (
            with("label/lh.aparc.annot", annotation(7)),
            422,
            "values-of-another-surface",
            "label/lh.aparc.annot",
        ),
        (
            with("mri/aparc+aseg.mgz", t1[..5000].to_vec()),
            422,
            "surface-damaged",
            "mri/aparc+aseg.mgz",
        ),
        (two, 422, "surface-damaged", "2 subjects"),
        (zipped("", &files[1..]), 415, "dicom-none", ""),
    ] {
        let refused = server.upload(&[("volume", &archive)]).await;
        assert_eq!(
            (refused.status.as_u16(), &*refused.problem()),
            (status, kind),
            "{refused:?}"
        );
        let detail = refused.json()["detail"].as_str().unwrap().to_owned();
        assert!(detail.contains(words), "{detail}");
        assert!(!detail.contains("s/mri"), "{detail}");
    }
}

#[tokio::test]
async fn a_form_with_the_files_of_two_subjects_is_refused() {
    let server = Server::start().await;
    let part = "--x\r\nContent-Disposition: form-data; name=\"dicom\"; filename=\"mri/T1.mgz\"\r\n\r\nvoxels\r\n";
    let request = Request::post("/v1/cases")
        .header(header::CONTENT_TYPE, "multipart/form-data; boundary=x")
        .body(Body::from(format!("{part}{part}--x--\r\n")))
        .unwrap();
    let refused = server.send(request).await;
    assert_eq!(
        (refused.status.as_u16(), &*refused.problem()),
        (400, "form-unreadable"),
        "{refused:?}"
    );
    let detail = refused.json()["detail"].as_str().unwrap().to_owned();
    assert!(detail.contains("`mri/T1.mgz` twice"), "{detail}");
}

#[tokio::test]
async fn the_command_prepares_the_folder_of_a_subject() {
    let server = Server::start().await;
    let files = subject(&server).await;
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("one");
    for (name, file) in &files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, file).unwrap();
    }
    // FreeSurfer links some files to others beside them; what a link takes from elsewhere is left out.
    let surf = folder.join("surf");
    let link = |to: &Path, name: &str| std::os::unix::fs::symlink(to, surf.join(name)).unwrap();
    std::fs::rename(surf.join("lh.pial"), surf.join("lh.pial.T1")).unwrap();
    link(Path::new("lh.pial.T1"), "lh.pial");
    std::fs::write(home.path().join("outside"), &files[3].1).unwrap();
    link(&home.path().join("outside"), "rh.white");
    link(Path::new("/dev/zero"), "rh.pial");
    let data = home.path().join("store");
    let [folder, data] = [&folder, &data].map(|path| path.to_str().unwrap());
    let written = done(&["prepare", folder, "--data", data]);
    let placed: Vec<_> = written
        .lines()
        .filter_map(|line| line.strip_prefix("layer "))
        .collect();
    for name in ["white and pial", "surface thickness", "aparc", "aparc+aseg"] {
        let line = format!("{name}: placed by its header");
        assert!(placed.contains(&&*line), "{written}");
    }
    assert_eq!(placed.len(), 4, "{written}");

    std::fs::write(Path::new(folder).join("surf/lh.white"), &files[3].1[..500]).unwrap();
    let (status, written) = run(&["prepare", folder, "--data", data]);
    assert_ne!(status, Some(0));
    assert!(
        written.contains("surf/lh.white: the surface cannot be read"),
        "{written}"
    );
}
