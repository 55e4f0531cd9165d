//! What reads the bytes of strangers, one function for each kind of bytes: whatever they are, it returns, without a panic.
//!
//! `fuzz/` runs them under libFuzzer; [`mutations`] changes the files of its corpora on any compiler.

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};

use cases::pictures::{PictureRequest, SliceQuery};
use http::negotiate::MediaType;
use http::sent::from_query;
use imaging::dicom::{Options, attributes, convert, fingerprint, identify, marks};
use imaging::surface::{Space, SurfaceFiles};
use imaging::{Limits, sniff};
use pacs::multipart::{Parser, Piece, boundary_of};
use pipeline::codec;
use report::ReportQuery;

/// The limits of files.
const LIMITS: Limits = Limits {
    max_voxels: 1 << 18,
    max_bytes: 1 << 20,
};

/// A function that reads bytes.
pub type Target = fn(&[u8]);

/// All of them, with the names of their corpora, and how many changes of each file are tried with every run of the tests. An
/// envelope of a few bytes may have the greatest grid, which takes a while to unpack.
pub const TARGETS: [(&str, Target, usize); 7] = [
    ("nifti", nifti, 400),
    ("surface", surface, 400),
    ("dicom", dicom, 200),
    ("multipart", multipart, 400),
    ("pdu", pdu, 400),
    ("decoders", decoders, 10),
    ("query", query, 400),
];

/// A file of NIfTI.
pub fn nifti(bytes: &[u8]) {
    let _ = sniff(bytes);
    let _ = imaging::nifti::read_volume(bytes, &LIMITS);
    let _ = imaging::nifti::read_mask(bytes, &LIMITS);
}

/// A surface, or the values of one.
pub fn surface(bytes: &[u8]) {
    let read = |surface, values| {
        let files = SurfaceFiles { surface, values };
        let _ = imaging::surface::read(files, None, Some(Space::Scanner), None);
    };
    read(bytes, None);
    read(ONE_TRIANGLE, Some(bytes));
    let _ = imaging::surface::places(bytes);
}

/// A surface of FreeSurfer of one triangle.
const ONE_TRIANGLE: &[u8] = b"\xff\xff\xfea test\n\n\0\0\0\x03\0\0\0\x01\
    \0\0\0\0\0\0\0\0\0\0\0\0\x3f\x80\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x3f\x80\0\0\0\0\0\0\
    \0\0\0\0\0\0\0\x01\0\0\0\x02";

/// A file of DICOM.
pub fn dicom(bytes: &[u8]) {
    let _ = identify(bytes);
    let _ = marks(bytes);
    let _ = attributes(bytes);
    // Decoders of compressed pixels may panic: they run in a child process.
    tolerate(|| {
        let _ = convert(&mut vec![bytes.to_vec()], &Options::default(), &LIMITS);
        let _ = fingerprint(bytes);
    });
}

/// A body of several parts. The first line is the type of the body.
pub fn multipart(bytes: &[u8]) {
    let end = bytes.iter().position(|&byte| byte == b'\n');
    let (head, body) = bytes.split_at(end.map_or(0, |end| end + 1));
    let kind = MediaType::parse(String::from_utf8_lossy(head).trim());
    let boundary = kind
        .as_ref()
        .and_then(|kind| boundary_of(kind, "application/dicom"));
    let mut parser = Parser::new(boundary.unwrap_or("b"));
    for piece in body.chunks(body.len() / 3 + 1) {
        parser.push(piece);
        loop {
            match parser.next_piece() {
                Err(_) | Ok(Some(Piece::End)) => return,
                Ok(None) => break,
                Ok(Some(_)) => {}
            }
        }
    }
    let _ = parser.end();
}

/// A PDU, or a command.
pub fn pdu(bytes: &[u8]) {
    // The reader of PDUs may panic, and is caught.
    quietly(|| _ = pacs::dimse::is_understood(bytes));
}

/// A derived object of a case.
pub fn decoders(bytes: &[u8]) {
    let _ = codec::decode_brain(bytes);
    let _ = codec::decode_paths(bytes);
    let _ = codec::decode_volume(bytes);
    let _ = codec::decode_maps(bytes);
    let _ = codec::decode_surfaces(bytes);
    if let Some(envelope) = codec::decode_envelope(bytes) {
        let _ = codec::decode_forest(bytes, &envelope);
    }
}

/// The keys of an address.
pub fn query(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    if let Ok(keys) = from_query::<PictureRequest>(&text) {
        let _ = keys.checked();
    }
    if let Ok(keys) = from_query::<SliceQuery>(&text) {
        let _ = keys.checked();
    }
    let _ = from_query::<ReportQuery>(&text);
}

/// Runs what may panic where it runs otherwise.
fn tolerate(work: impl FnOnce()) {
    quietly(|| _ = catch_unwind(AssertUnwindSafe(work)));
}

/// Runs what catches its panics: libFuzzer would end at a caught one too.
fn quietly(work: impl FnOnce()) {
    let hook = take_hook();
    set_hook(Box::new(|_| ()));
    let ended = catch_unwind(AssertUnwindSafe(work));
    set_hook(hook);
    if let Err(panic) = ended {
        std::panic::resume_unwind(panic);
    }
}

/// So many changes of a file, always the same ones: bits, numbers, lengths and repetitions, up to eight at once.
pub fn mutations(file: &[u8], count: usize) -> impl Iterator<Item = Vec<u8>> {
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    (0..count).map(move |_| {
        let mut bytes = file.to_vec();
        for _ in 0..=random.below(8) {
            change(&mut bytes, &mut random);
        }
        bytes
    })
}

/// Numbers at which lengths and signs go wrong.
const EDGES: [u32; 8] = [0, 1, 0x7f, 0xff, 0x7fff, 0xffff, 0x7fff_ffff, 0xffff_ffff];

fn change(bytes: &mut Vec<u8>, random: &mut Random) {
    if bytes.is_empty() {
        bytes.push(random.below(256) as u8);
        return;
    }
    let at = random.below(bytes.len());
    let length = 1 + random.below(16.min(bytes.len() - at));
    match random.below(6) {
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes[at] = random.below(256) as u8,
        2 => {
            let edge = EDGES[random.below(EDGES.len())];
            let edge = match random.below(2) {
                0 => edge.to_le_bytes(),
                _ => edge.to_be_bytes(),
            };
            let length = 4.min(bytes.len() - at);
            bytes[at..at + length].copy_from_slice(&edge[..length]);
        }
        3 => bytes.truncate(at),
        4 => {
            let some = bytes[at..at + length].to_vec();
            let to = random.below(bytes.len());
            bytes.splice(to..to, some);
        }
        _ => _ = bytes.drain(at..at + length),
    }
}

/// Xorshift: what matters is that it is the same everywhere.
struct Random(u64);

impl Random {
    /// A number below `limit`, which is not 0.
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit as u64) as usize
    }
}
