//! The short form of `fuzz/`: the corpora, and a fixed number of changes of their files.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use case::Parameters;
use geometry::{MeshSize, Paths};
use isocortex_tests::fuzzed::{TARGETS, mutations};
use pipeline::codec::{encode_brain, encode_envelope, encode_forest, encode_paths, encode_volume};
use pipeline::{Limits, Pipeline, Source};

use crate::head::{mask_of, plain_head};
use crate::nifti::{Data, Nifti, gzip};
use crate::series_builder::{Syntax, enhanced, files, slices};
use crate::surface_layers::{annotation, curv};

fn corpora() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus")
}

#[test]
fn whatever_strangers_send_is_read_without_a_panic() {
    for (name, target, changes) in TARGETS {
        let folder = std::fs::read_dir(corpora().join(name)).unwrap();
        let mut seeds: Vec<_> = folder.map(|file| file.unwrap().path()).collect();
        seeds.sort();
        assert!(!seeds.is_empty(), "{name}");
        target(&[]);
        for seed in seeds {
            let file = std::fs::read(&seed).unwrap();
            assert!(file.len() <= 64 << 10, "{} is not small", seed.display());
            target(&file);
            for (number, changed) in mutations(&file, changes).enumerate() {
                let survived = std::panic::catch_unwind(|| target(&changed)).is_ok();
                assert!(
                    survived,
                    "change {number} of {}: {changed:02x?}",
                    seed.display()
                );
            }
        }
    }
}

/// Every third voxel of the plain head along each axis.
fn small_head() -> Nifti {
    let head = plain_head();
    let Data::I16(voxels) = &head.data else {
        panic!("heads are made of i16");
    };
    let side = head.size[0] as usize;
    let coarse = (0..side).step_by(3);
    let mut few = Vec::new();
    for z in coarse.clone() {
        for y in coarse.clone() {
            few.extend(coarse.clone().map(|x| voxels[(z * side + y) * side + x]));
        }
    }
    let ras_from_voxel = head
        .ras_from_voxel
        .map(|[x, y, z, t]| [3.0 * x, 3.0 * y, 3.0 * z, t]);
    Nifti {
        size: [coarse.len() as i16; 3],
        ras_from_voxel,
        data: Data::I16(few),
        ..head
    }
}

/// A PDU of a kind with a body.
fn pdu(kind: u8, body: &[u8]) -> Vec<u8> {
    let length = (body.len() as u32).to_be_bytes();
    [&[kind, 0][..], &length, body].concat()
}

/// An item of a PDU.
fn item(kind: u8, body: &[u8]) -> Vec<u8> {
    let length = (body.len() as u16).to_be_bytes();
    [&[kind, 0][..], &length, body].concat()
}

/// A request for an association that offers MR images.
fn association() -> Vec<u8> {
    let syntax = item(0x30, b"1.2.840.10008.5.1.4.1.1.4");
    let transfer = item(0x40, b"1.2.840.10008.1.2.1");
    let context = item(0x20, &[&[1, 0, 0, 0][..], &syntax, &transfer].concat());
    let user = [item(0x51, &16_384_u32.to_be_bytes()), item(0x52, b"1.2.3")].concat();
    let titles = format!("{:16}{:16}", "ISOCORTEX", "STORESCU");
    let body = [
        &[0, 1, 0, 0][..],
        titles.as_bytes(),
        &[0; 32],
        &item(0x10, b"1.2.840.10008.3.1.1.1"),
        &context,
        &item(0x50, &user),
    ];
    pdu(1, &body.concat())
}

/// A C-STORE request as a command.
fn command() -> Vec<u8> {
    let mut set = Vec::new();
    let uid = b"1.2.840.10008.5.1.4.1.1.4\0";
    for (element, value) in [
        (0x0002_u16, &uid[..]),
        (0x0100, &[1, 0]),
        (0x0110, &[7, 0]),
        (0x0700, &[0, 0]),
        (0x0800, &[1, 0]),
        (0x1000, b"1.2.3\0"),
    ] {
        set.extend([0, 0]);
        set.extend(element.to_le_bytes());
        set.extend((value.len() as u32).to_le_bytes());
        set.extend(value);
    }
    set
}

#[test]
#[ignore = "it writes the files of the corpora, after a format or a test head has changed"]
fn the_corpora_are_written() {
    let write = |target: &str, name: &str, bytes: &[u8]| {
        let folder = corpora().join(target);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(name), bytes).unwrap();
    };
    let head = small_head();
    write("nifti", "plain.nii", &head.bytes());
    write("nifti", "packed.nii.gz", &gzip(&head.bytes()));
    let values = curv(&[0.5, f32::NAN, -1.0]);
    write("surface", "lh.curv", &values);
    write("surface", "lh.annot", &annotation(3));
    let overlay = [1_i32, 3, 1, 1, 1, 3, 0].map(i32::to_be_bytes);
    let rest = [&[0; 256][..], &values[values.len() - 12..]].concat();
    let overlay = [overlay.as_flattened(), &rest].concat();
    write("surface", "lh.overlay.mgh", &overlay);
    write("surface", "lh.overlay.mgz", &gzip(&overlay));
    let array = |intent: &str, kind: &str, numbers: &str| {
        format!(
            "<DataArray Intent=\"NIFTI_INTENT_{intent}\" DataType=\"NIFTI_TYPE_{kind}\" ArrayIndexingOrder=\"RowMajorOrder\" Dimensionality=\"2\" \
             Dim0=\"3\" Dim1=\"{}\" Encoding=\"ASCII\" Endian=\"LittleEndian\"><Data>{numbers}</Data></DataArray>",
            numbers.split(' ').count() / 3
        )
    };
    let gifti = [
        "<?xml version=\"1.0\"?><GIFTI Version=\"1.0\" NumberOfDataArrays=\"3\"><LabelTable><Label Key=\"1\">a &amp; b</Label></LabelTable>",
        &array("POINTSET", "FLOAT32", "0 0 0 1 0 0 0 1 0"),
        &array("TRIANGLE", "INT32", "0 1 2 2 1 0 0 2 1"),
        &array("LABEL", "INT32", "1 0 1"),
        "</GIFTI>",
    ];
    write("surface", "lh.labels.gii", gifti.concat().as_bytes());
    let series = slices(4);
    let file = |syntax| files(&series, syntax).swap_remove(0);
    write("dicom", "implicit.dcm", &file(Syntax::Implicit));
    write("dicom", "explicit.dcm", &file(Syntax::Explicit));
    write("dicom", "enhanced.dcm", &enhanced(&series));
    let part = "Content-Type: application/dicom\r\n\r\n";
    let body = format!(
        "multipart/related; type=\"application/dicom\"; boundary=\"b 1\"\n--b 1\r\n{part}one\r\n--b 1\r\n{part}two\r\n\r\n--b 1--\r\n"
    );
    write("multipart", "two", body.as_bytes());
    write("pdu", "association", &association());
    write("pdu", "command", &command());
    let data = [&(6 + 10_u32).to_be_bytes()[..], &[1, 3], &command()[..10]].concat();
    write("pdu", "data", &pdu(4, &data));
    write("pdu", "release", &pdu(5, &[0; 4]));
    let source = Source {
        volume: head.bytes().into(),
        mask: Some(mask_of(&head).bytes().into()),
        ..Source::default()
    };
    let prepared = Pipeline::default().prepare(
        &source,
        &Parameters::default(),
        &Limits::default(),
        &|_| (),
        &AtomicBool::new(false),
    );
    let prepared = prepared.unwrap();
    let (built, envelope) = (&prepared.built, prepared.envelope());
    let paths = Paths::Forest(&built.forest);
    let size = MeshSize::new(8, 8).unwrap();
    let paths = built.model.path_table(size, &built.distance, paths);
    write("decoders", "mask", &encode_brain(&prepared.brain));
    write("decoders", "envelope", &encode_envelope(envelope));
    write(
        "decoders",
        "forest",
        &encode_forest(&built.forest, envelope),
    );
    write("decoders", "paths", &encode_paths(&paths.unwrap()));
    write("decoders", "volume", &encode_volume(&prepared.native));
    for (name, text) in [
        (
            "picture",
            "depth_mm=8.5&view=left&width=512&height=512&window_center=300&window_width=600&zoom=1.5&renderer=trace&overlay=blur&overlay_window=2.5,6",
        ),
        (
            "slice",
            "plane=axial&position=1,-2.5,3e1&layer=t1&width=256",
        ),
        ("report", "format=pdf&language=pt-BR&view=superior"),
    ] {
        write("query", name, text.as_bytes());
    }
}
