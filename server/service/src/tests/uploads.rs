//! Uploads that cannot be used: each has a clear answer, leaves nothing behind, and the server goes on serving.

use std::io::{Read as _, Write as _};

use axum::body::Body;
use axum::http::Method;
use bytes::Bytes;
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use futures_util::{StreamExt as _, stream};

use super::server::{FORM, MAX_UPLOAD_BYTES, Part, Server, form, head};

/// Where the voxels of a file begin.
const VOX_OFFSET: usize = 352;

/// An unpacked NIfTI-1 file that can be spoilt.
#[derive(Clone)]
struct File(Vec<u8>);

impl File {
    fn of(packed: &[u8]) -> Self {
        let mut bytes = Vec::new();
        GzDecoder::new(packed).read_to_end(&mut bytes).unwrap();
        Self(bytes)
    }

    fn volume() -> Self {
        Self::of(&head().0)
    }

    fn mask() -> Self {
        Self::of(&head().1)
    }

    fn with(mut self, offset: usize, bytes: &[u8]) -> Self {
        self.0[offset..offset + bytes.len()].copy_from_slice(bytes);
        self
    }

    /// With sides of so many voxels, and zeros for voxels as far as `length`.
    fn promising(self, side: i16, length: usize) -> Self {
        let sides = [42, 44, 46].into_iter();
        let mut file = sides.fold(self, |file, at| file.with(at, &side.to_le_bytes()));
        file.0.truncate(VOX_OFFSET);
        file.0.resize(length, 0);
        file
    }

    /// With every byte of its voxels this one.
    fn filled(mut self, byte: u8) -> Self {
        self.0[VOX_OFFSET..].fill(byte);
        self
    }

    /// Moved to the patient's left, in mm.
    fn moved(self, mm: f32) -> Self {
        let moved = |file: Self, at: usize| {
            let place: [u8; 4] = file.0[at..at + 4].try_into().unwrap();
            let place = f32::from_le_bytes(place) + mm;
            file.with(at, &place.to_le_bytes())
        };
        moved(moved(self, 268), 292)
    }

    fn packed(&self) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(&self.0).unwrap();
        encoder.finish().unwrap()
    }
}

#[tokio::test]
async fn volumes_that_cannot_be_read() {
    let packed = &head().0;
    let mut damaged = packed.to_vec();
    let end = damaged.len() - 6;
    damaged[end] ^= 1;
    let volume = File::volume;
    let header = |at: usize, bytes: &[u8]| volume().with(at, bytes).packed();
    let cases: Vec<(&str, Vec<u8>, u16, &str)> = vec![
        ("no bytes", Vec::new(), 415, "not-nifti"),
        ("a text", b"not a volume at all".to_vec(), 415, "not-nifti"),
        (
            "half a gzip",
            packed[..packed.len() / 2].to_vec(),
            422,
            "gzip-truncated",
        ),
        ("a wrong checksum", damaged, 422, "gzip-corrupt"),
        (
            "gigabytes in a gzip",
            volume().promising(600, 32 << 20).packed(),
            413,
            "too-many-voxels",
        ),
        (
            "a thousand million voxels",
            volume().promising(1000, 16 << 20).packed(),
            413,
            "too-many-voxels",
        ),
        (
            "a side of 0",
            header(42, &0i16.to_le_bytes()),
            422,
            "nifti-dimension",
        ),
        (
            "a side below 0",
            header(42, &(-5i16).to_le_bytes()),
            422,
            "nifti-dimension",
        ),
        (
            "an affine that is no number",
            header(284, &f32::NAN.to_le_bytes()),
            422,
            "nifti-affine",
        ),
        (
            "forms that contradict each other",
            header(80, &9f32.to_le_bytes()),
            422,
            "nifti-forms-contradict",
        ),
        (
            "intensities beyond every window",
            header(112, &1e33f32.to_le_bytes()),
            422,
            "intensity-range",
        ),
        (
            "one intensity",
            volume().filled(7).packed(),
            422,
            "volume-constant",
        ),
    ];
    let server = Server::start().await;
    for (what, bytes, status, kind) in cases {
        let parts: [Part<'_>; 2] = [("volume", &bytes), ("mask", &head().1)];
        let answer = server.upload(&parts).await;
        assert_eq!(answer.refusal(), (status, kind.to_owned()), "{what}");
        server.is_empty_and_well().await;
    }
}

/// A name, the mask and the parameters of an upload, and the status and the kind of the refusal.
type UnusableMask<'a> = (&'a str, Vec<u8>, &'a [u8], u16, &'a str);

#[tokio::test]
async fn masks_that_cannot_be_used() {
    let volume = &head().0;
    let mask = File::mask;
    let cases: Vec<UnusableMask<'_>> = vec![
        (
            "an empty mask",
            mask().filled(0).packed(),
            b"{}",
            422,
            "mask-empty",
        ),
        (
            "that of another head",
            mask().moved(500.0).packed(),
            b"{}",
            422,
            "mask-outside-volume",
        ),
        ("no mask at all", b"x".to_vec(), b"{}", 415, "not-nifti"),
        (
            "a mask and another source of it",
            head().1.to_vec(),
            br#"{"mask": "pruning"}"#,
            422,
            "mask-twice",
        ),
    ];
    let server = Server::start().await;
    for (what, bytes, parameters, status, kind) in cases {
        let parts: [Part<'_>; 3] = [
            ("parameters", parameters),
            ("volume", volume),
            ("mask", &bytes),
        ];
        let answer = server.upload(&parts).await;
        assert_eq!(answer.refusal(), (status, kind.to_owned()), "{what}");
        server.is_empty_and_well().await;
    }
    for (parameters, status, kind) in [
        (&br#"{"mask": "volume"}"#[..], 422, "mask-missing"),
        (br#"{"mask": "network"}"#, 501, "network-missing"),
    ] {
        let answer = server
            .upload(&[("volume", volume), ("parameters", parameters)])
            .await;
        assert_eq!(answer.refusal(), (status, kind.to_owned()));
        server.is_empty_and_well().await;
    }
}

#[tokio::test]
async fn forms_that_are_not_right() {
    let volume: &[u8] = &head().0;
    let dicom: &[u8] = b"anything";
    let too_many_bytes = vec![b' '; 65 << 10];
    let radius: &[u8] = br#"{"closing_radius_mm": 51}"#;
    let name: &[u8] = br#"{"name": "a\u0007"}"#;
    let series: &[u8] = br#"{"series": 2}"#;
    let cases: Vec<(&str, Vec<Part<'_>>, u16, &str)> = vec![
        ("nothing", vec![], 400, "volume-missing"),
        (
            "a mask alone",
            vec![("mask", volume)],
            400,
            "volume-missing",
        ),
        (
            "two volumes",
            vec![("volume", volume), ("volume", volume)],
            400,
            "part-twice",
        ),
        (
            "a volume of either kind",
            vec![("volume", volume), ("dicom", dicom)],
            400,
            "volume-twice",
        ),
        (
            "a part of another name",
            vec![("volume", volume), ("surname", b"x")],
            400,
            "unknown-part",
        ),
        (
            "parameters without end",
            vec![("volume", volume), ("parameters", &too_many_bytes)],
            413,
            "body-too-large",
        ),
        (
            "parameters that are no object",
            vec![("volume", volume), ("parameters", b"[7.5]")],
            400,
            "parameters-unreadable",
        ),
        (
            "a parameter that is unknown",
            vec![
                ("volume", volume),
                ("parameters", br#"{"closing_radius": 3}"#),
            ],
            400,
            "parameters-unreadable",
        ),
        (
            "a radius that is too large",
            vec![("volume", volume), ("parameters", radius)],
            422,
            "closing-radius-out-of-range",
        ),
        (
            "a name that is no text",
            vec![("volume", volume), ("parameters", name)],
            422,
            "name-not-text",
        ),
        (
            "a series of a NIfTI file",
            vec![("volume", volume), ("parameters", series)],
            400,
            "parameters-unreadable",
        ),
        (
            "DICOM files of which their reader dies",
            vec![("dicom", dicom)],
            422,
            "dicom-reader-died",
        ),
    ];
    let server = Server::start().await;
    for (what, parts, status, kind) in cases {
        let answer = server.upload(&parts).await;
        assert_eq!(answer.refusal(), (status, kind.to_owned()), "{what}");
        assert!(!answer.json()["detail"].to_string().contains("surname"));
        server.is_empty_and_well().await;
    }
}

#[tokio::test]
async fn bodies_that_are_not_right() {
    let server = Server::start().await;
    let whole = form(&[("volume", &head().0)]);
    let half = Bytes::copy_from_slice(&whole[..whole.len() / 2]);
    let cut = || Err(std::io::Error::other("the connection was cut"));
    let start = |length: usize| {
        let start = Bytes::copy_from_slice(&whole[..length]);
        stream::iter([Ok::<_, std::io::Error>(start)])
    };
    let zeros = stream::repeat_with(|| Ok(Bytes::from_static(&[0; 65_536])));
    let cases = [
        (
            "half a form",
            Body::from(half.clone()),
            400,
            "form-unreadable",
        ),
        (
            "a connection that is cut",
            Body::from_stream(stream::iter([Ok(half), cut()])),
            400,
            "form-unreadable",
        ),
        (
            "more than the limit",
            Body::from_stream(start(200).chain(zeros)),
            413,
            "body-too-large",
        ),
        (
            "nothing more for a second",
            Body::from_stream(start(5000).chain(stream::pending())),
            400,
            "upload-stalled",
        ),
    ];
    for (what, body, status, kind) in cases {
        let answer = server.post_form(body).await;
        assert_eq!(answer.refusal(), (status, kind.to_owned()), "{what}");
        server.is_empty_and_well().await;
    }
}

/// Names and values of headers.
type Headers<'a> = Vec<(&'a str, &'a str)>;

#[tokio::test]
async fn what_is_refused_before_the_body_is_read() {
    let server = Server::start().await;
    let too_long = (MAX_UPLOAD_BYTES + (2 << 20)).to_string();
    let cases: [(&str, Headers<'_>, u16, &str); 4] = [
        ("no type", vec![], 415, "unsupported-media-type"),
        (
            "JSON",
            vec![("content-type", "application/json")],
            415,
            "unsupported-media-type",
        ),
        (
            "a form without a boundary",
            vec![("content-type", "multipart/form-data")],
            415,
            "unsupported-media-type",
        ),
        (
            "a length beyond the limit",
            vec![("content-type", FORM), ("content-length", &too_long)],
            413,
            "body-too-large",
        ),
    ];
    for (what, headers, status, kind) in cases {
        // Had the body been read, this would never end.
        let never = Body::from_stream(stream::pending::<Result<Bytes, std::io::Error>>());
        let answer = server.ask(Method::POST, "/v1/cases", &headers, never).await;
        assert_eq!(answer.refusal(), (status, kind.to_owned()), "{what}");
    }
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn the_queue_and_the_uploads_have_an_end() {
    let server = Server::start().await;
    let (volume, mask) = head();
    let upload = async |radius: &str| {
        let parameters = format!("{{\"closing_radius_mm\": {radius}}}");
        let parts: [Part<'_>; 3] = [
            ("volume", volume),
            ("mask", mask),
            ("parameters", parameters.as_bytes()),
        ];
        server.upload(&parts).await
    };
    assert_eq!(upload("8").await.status, 202);
    let known = upload("8").await;
    assert_eq!((known.status, known.header("retry-after")), (200, ""));
    assert_eq!(upload("9").await.status, 202);
    let refused = upload("10").await;
    assert_eq!(refused.refusal(), (503, "busy".to_owned()));
    // From the pace of the queue.
    let wait: u64 = refused.header("retry-after").parse().unwrap();
    assert!((1..=60).contains(&wait), "{wait}");
    // One upload at a time has room; the others are told at once.
    let never = Body::from_stream(stream::pending::<Result<Bytes, std::io::Error>>());
    let mut stalled = Box::pin(server.post_form(never));
    assert!(futures_util::poll!(&mut stalled).is_pending());
    assert_eq!(upload("8").await.refusal(), (503, "busy".to_owned()));
    drop(stalled);
    assert_eq!(upload("8").await.status, 200);
}
