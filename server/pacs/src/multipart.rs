//! Reads `multipart/related` (RFC 2387, RFC 2046 §5.1) piece by piece, with at most one piece in memory.
//!
//! What real software sends is accepted: quoted and bare parameters, boundaries of up to 200 characters, lines that end
//! in LF alone, parts with and without a length. A length that a part states is not used.
//!
//! multer, which reads our forms, holds everything that has arrived until a header ends, and refuses such lines.

use bytes::{Buf as _, Bytes, BytesMut};
use http::negotiate::MediaType;
use memchr::memmem::Finder;

/// The longest boundary. RFC 2046 allows 70 characters; 73 occur.
const MAX_BOUNDARY_LENGTH: usize = 200;

/// The most bytes before the first part, and of the header of a part.
const MAX_HEADER_BYTES: usize = 16 << 10;

/// The most white space after a boundary.
const MAX_PADDING: usize = 64;

/// Why a body cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MultipartError {
    /// It ends before its last boundary.
    #[error("the body ends before its last boundary; was it cut off?")]
    Truncated,
    /// There is no boundary at its beginning.
    #[error("the body does not begin with its boundary")]
    NoBoundary,
    /// The header of a part is too long.
    #[error("the header of a part is longer than {MAX_HEADER_BYTES} bytes")]
    HeaderTooLong,
    /// The header of a part is not one.
    #[error("the header of a part cannot be read")]
    BadHeader,
}

/// The boundary of a body that is `multipart/related` and has parts of this kind; `None` for any other body.
pub fn boundary_of<'a>(body: &'a MediaType, kind: &str) -> Option<&'a str> {
    let of_kind = body
        .parameter("type")
        .is_none_or(|named| named.eq_ignore_ascii_case(kind));
    let boundary = body.parameter("boundary")?;
    let printable = |byte: u8| (b' '..=b'~').contains(&byte);
    let is_sound = (1..=MAX_BOUNDARY_LENGTH).contains(&boundary.len())
        && boundary.bytes().all(printable)
        && !boundary.ends_with(' ');
    (body.essence == "multipart/related" && of_kind && is_sound).then_some(boundary)
}

/// What comes next in a body.
#[derive(Debug, Clone, PartialEq)]
pub enum Piece {
    /// A part begins; its media type, if it states one.
    Part(Option<String>),
    /// The next bytes of the part.
    Data(Bytes),
    /// The part is complete.
    EndOfPart,
    /// There are no more parts. What follows is ignored.
    End,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Preamble,
    Header,
    Data,
    Done,
}

/// Takes a body apart. Push bytes, and take pieces until there is none.
#[derive(Debug)]
pub struct Parser {
    state: State,
    buffer: BytesMut,
    /// Two hyphens and the boundary.
    delimiter: Finder<'static>,
    /// The same after an end of line, as it is written in this body: before the first boundary, LF; then as there.
    line_delimiter: Finder<'static>,
    /// Before this place in the buffer there is no delimiter.
    searched: usize,
    /// Bytes at the start of the buffer that belong to the header.
    not_data: usize,
}

/// What a boundary says.
enum Boundary {
    /// Another part follows; so many bytes belong to the boundary, and its line ends in CR LF or in LF.
    Next(usize, bool),
    /// There is no further part.
    Last,
    /// It is not the boundary, but begins like it.
    Other,
    /// Too little has come to tell.
    Unknown,
}

impl Parser {
    /// A parser of a body with this boundary.
    pub fn new(boundary: &str) -> Self {
        let delimiter = format!("--{boundary}");
        // The first boundary may stand at the very beginning.
        Self {
            state: State::Preamble,
            buffer: BytesMut::from(&b"\n"[..]),
            line_delimiter: Finder::new(&format!("\n{delimiter}")).into_owned(),
            delimiter: Finder::new(&delimiter).into_owned(),
            searched: 0,
            not_data: 0,
        }
    }

    /// Adds the next bytes of the body.
    pub fn push(&mut self, bytes: &[u8]) {
        if self.state != State::Done {
            self.buffer.extend_from_slice(bytes);
        }
    }

    /// The next piece; `None` if more bytes are needed.
    ///
    /// # Errors
    /// If what has come cannot be the beginning of such a body.
    pub fn next_piece(&mut self) -> Result<Option<Piece>, MultipartError> {
        match self.state {
            State::Preamble => self.preamble(),
            State::Header => self.header(),
            State::Data => self.data(),
            State::Done => Ok(Some(Piece::End)),
        }
    }

    /// Whether the body may end here.
    ///
    /// # Errors
    /// If it may not.
    pub fn end(&self) -> Result<(), MultipartError> {
        match self.state {
            State::Done => Ok(()),
            _ => Err(MultipartError::Truncated),
        }
    }

    fn preamble(&mut self) -> Result<Option<Piece>, MultipartError> {
        loop {
            let found = self.find();
            if found.unwrap_or(self.buffer.len()) > MAX_HEADER_BYTES {
                return Err(MultipartError::NoBoundary);
            }
            let Some(at) = found else { return Ok(None) };
            match self.boundary(at) {
                Boundary::Unknown => return Ok(None),
                Boundary::Other => self.searched = at + 1,
                Boundary::Last => return Ok(Some(self.finish())),
                Boundary::Next(length, with_cr) => {
                    if with_cr {
                        let delimiter = [&b"\r\n"[..], self.delimiter.needle()].concat();
                        self.line_delimiter = Finder::new(&delimiter).into_owned();
                    }
                    self.begin_header(at + length);
                    return self.header();
                }
            }
        }
    }

    /// The place of the next delimiter.
    fn find(&mut self) -> Option<usize> {
        let found = self.line_delimiter.find(&self.buffer[self.searched..]);
        if let Some(at) = found {
            return Some(self.searched + at);
        }
        let needle = self.line_delimiter.needle().len();
        self.searched = self
            .searched
            .max(self.buffer.len().saturating_sub(needle - 1));
        None
    }

    /// What the delimiter at a place says.
    fn boundary(&self, at: usize) -> Boundary {
        let start = at + self.line_delimiter.needle().len();
        let rest = &self.buffer[start..];
        if rest.starts_with(b"--") {
            return Boundary::Last;
        }
        let padding = rest
            .iter()
            .take_while(|&&byte| byte == b' ' || byte == b'\t')
            .count();
        let length = self.line_delimiter.needle().len() + padding;
        match rest[padding..] {
            _ if padding > MAX_PADDING => Boundary::Other,
            [b'\n', ..] => Boundary::Next(length + 1, false),
            [b'\r', b'\n', ..] => Boundary::Next(length + 2, true),
            [] | [b'\r'] => Boundary::Unknown,
            [b'-'] if padding == 0 => Boundary::Unknown,
            _ => Boundary::Other,
        }
    }

    fn finish(&mut self) -> Piece {
        self.state = State::Done;
        self.buffer = BytesMut::new();
        Piece::End
    }

    fn begin_header(&mut self, at: usize) {
        drop(self.buffer.split_to(at));
        self.searched = 0;
        self.state = State::Header;
    }

    fn header(&mut self) -> Result<Option<Piece>, MultipartError> {
        let length = header_length(&self.buffer);
        if length.unwrap_or(self.buffer.len()) > MAX_HEADER_BYTES {
            return Err(MultipartError::HeaderTooLong);
        }
        let Some(length) = length else {
            return Ok(None);
        };
        let kind = content_type(&self.buffer[..length])?;
        // The end of the header may be the beginning of a boundary, if the part is empty.
        self.not_data = 1 + usize::from(self.buffer[..length].ends_with(b"\r\n"));
        drop(self.buffer.split_to(length - self.not_data));
        self.searched = 0;
        self.state = State::Data;
        Ok(Some(Piece::Part(kind)))
    }

    fn data(&mut self) -> Result<Option<Piece>, MultipartError> {
        loop {
            let Some(at) = self.find() else {
                return Ok(self.take(self.searched));
            };
            let boundary = self.boundary(at);
            if matches!(boundary, Boundary::Other) {
                self.searched = at + 1;
                continue;
            }
            if let Some(data) = self.take(at) {
                return Ok(Some(data));
            }
            match boundary {
                Boundary::Next(length, _) => self.begin_header(at + length),
                Boundary::Last => drop(self.finish()),
                Boundary::Other | Boundary::Unknown => return Ok(None),
            }
            return Ok(Some(Piece::EndOfPart));
        }
    }

    /// The data before a place in the buffer, if there is any.
    fn take(&mut self, end: usize) -> Option<Piece> {
        if end <= self.not_data {
            return None;
        }
        let mut data = self.buffer.split_to(end).freeze();
        data.advance(std::mem::take(&mut self.not_data));
        self.searched = self.searched.saturating_sub(end);
        Some(Piece::Data(data))
    }
}

/// The length of a header with its empty last line.
fn header_length(bytes: &[u8]) -> Option<usize> {
    let mut start = 0;
    while let Some(length) = memchr::memchr(b'\n', &bytes[start..]) {
        let line = &bytes[start..start + length];
        start += length + 1;
        if line.is_empty() || line == b"\r" {
            return Some(start);
        }
    }
    None
}

/// The value of `Content-Type` in a header.
fn content_type(header: &[u8]) -> Result<Option<String>, MultipartError> {
    let text = std::str::from_utf8(header).map_err(|_| MultipartError::BadHeader)?;
    let mut kind = None;
    for line in text.lines().filter(|line| !line.is_empty()) {
        // A line that begins with white space continues the one before.
        if line.starts_with([' ', '\t']) {
            continue;
        }
        let (name, value) = line.split_once(':').ok_or(MultipartError::BadHeader)?;
        if name.trim().eq_ignore_ascii_case("content-type") {
            kind = Some(value.trim().to_owned());
        }
    }
    Ok(kind)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The media type and the bytes of a part.
    type Part = (Option<String>, Vec<u8>);

    /// The parts of a body that comes in pieces of a length.
    fn parts_of(boundary: &str, body: &[u8], length: usize) -> Result<Vec<Part>, MultipartError> {
        let mut parser = Parser::new(boundary);
        let (mut parts, mut part) = (Vec::new(), None);
        for bytes in body.chunks(length.max(1)) {
            parser.push(bytes);
            while let Some(piece) = parser.next_piece()? {
                match piece {
                    Piece::Part(kind) => part = Some((kind, Vec::new())),
                    Piece::Data(bytes) => {
                        let (_, data) = part.as_mut().expect("data belongs to a part");
                        assert!(!bytes.is_empty());
                        data.extend(bytes);
                    }
                    Piece::EndOfPart => parts.extend(part.take()),
                    Piece::End => break,
                }
            }
            assert!(parser.buffer.len() <= length + MAX_HEADER_BYTES + MAX_BOUNDARY_LENGTH);
        }
        parser.end()?;
        assert!(part.is_none(), "every part ends");
        Ok(parts)
    }

    fn contents(boundary: &str, body: &str, length: usize) -> Vec<String> {
        let parts = parts_of(boundary, body.as_bytes(), length).unwrap();
        let text = |(_, data)| String::from_utf8(data).unwrap();
        parts.into_iter().map(text).collect()
    }

    #[test]
    fn parts_are_the_same_however_they_come() {
        let kind = "Content-Type: application/dicom\r\n";
        for (body, expected) in [
            (
                format!("--b\r\n{kind}\r\none\r\n--b\r\n{kind}\r\ntwo\r\n--b--\r\n"),
                vec!["one", "two"],
            ),
            (format!("\r\n--b\r\n{kind}\r\none\r\n--b--"), vec!["one"]),
            (
                format!("a preamble\r\n--b \t\r\n{kind}\r\none\r\n--b--an epilogue\r\n--b"),
                vec!["one"],
            ),
            (
                "--b\nContent-Type: x\n\none\r\n--b\n\n\n--b--".to_owned(),
                vec!["one\r", ""],
            ),
            (
                format!("--b\r\n{kind}Content-Length: 999999999999\r\n\r\none\r\n--b--"),
                vec!["one"],
            ),
            ("--b\r\n\r\n\r\n--b\r\n\r\n--b--".to_owned(), vec!["", ""]),
            (
                "--b\r\n\r\n--bc\r\n--bcd\r\n--b-\r\n--b\rx\n--b\r\n--b--".to_owned(),
                vec!["--bc\r\n--bcd\r\n--b-\r\n--b\rx\n--b"],
            ),
            ("--b--".to_owned(), vec![]),
        ] {
            for length in [1, 2, 3, 7, 1000] {
                assert_eq!(
                    contents("b", &body, length),
                    expected,
                    "{body:?} by {length}"
                );
            }
        }
    }

    #[test]
    fn what_is_no_such_body_is_refused() {
        let long = format!("--b\r\nX: {}\r\n\r\n", "x".repeat(MAX_HEADER_BYTES));
        let endless = format!("--b\r\n{}", "X: y\r\n".repeat(MAX_HEADER_BYTES));
        let preamble = "x".repeat(MAX_HEADER_BYTES + 10);
        for (body, error) in [
            ("", MultipartError::Truncated),
            ("--b", MultipartError::Truncated),
            ("--b\r\nX: y\r\n", MultipartError::Truncated),
            ("--b\r\n\r\none\r\n--", MultipartError::Truncated),
            ("--b\r\nnot a header\r\n\r\n", MultipartError::BadHeader),
            (&long, MultipartError::HeaderTooLong),
            (&endless, MultipartError::HeaderTooLong),
            (&preamble, MultipartError::NoBoundary),
        ] {
            for length in [1, 5, 100_000] {
                let parts = parts_of("b", body.as_bytes(), length);
                assert_eq!(parts, Err(error), "{body:.40}");
            }
        }
    }

    #[test]
    fn parameters_are_quoted_or_bare() {
        let dicom = "application/dicom";
        let long = "x".repeat(MAX_BOUNDARY_LENGTH);
        for (text, boundary) in [
            (
                "multipart/related; type=\"application/dicom\"; boundary=abc".to_owned(),
                Some("abc"),
            ),
            (
                "Multipart/Related;boundary=\"a b;c\\\"d\" ; type=application/dicom".to_owned(),
                Some("a b;c\"d"),
            ),
            (format!("multipart/related; boundary={long}"), Some(&*long)),
            (format!("multipart/related; boundary={long}x"), None),
            (
                "multipart/related; type=\"application/dicom+json\"; boundary=abc".to_owned(),
                None,
            ),
            ("multipart/form-data; boundary=abc".to_owned(), None),
            ("multipart/related; boundary=".to_owned(), None),
            ("multipart/related".to_owned(), None),
            ("multipart/related; boundary=\"abc".to_owned(), None),
        ] {
            let kind = MediaType::parse(&text);
            let found = kind.as_ref().and_then(|kind| boundary_of(kind, dicom));
            assert_eq!(found, boundary, "{text}");
        }
    }

    proptest! {
        #[test]
        fn whatever_is_sent_comes_out_as_it_was(
            parts in prop::collection::vec(prop::collection::vec(prop::sample::select(&b"\r\n-b\0x"[..]), 0..60), 0..5),
            length in 1_usize..50,
        ) {
            let boundary = "bb";
            let has_boundary = |part: &Vec<u8>| {
                let framed = [b"\r\n", &part[..], b"\r\n"].concat();
                memchr::memmem::find(&framed, b"\r\n--bb").is_some()
            };
            prop_assume!(!parts.iter().any(has_boundary));
            let mut body = Vec::new();
            for part in &parts {
                body.extend(b"--bb\r\nContent-Type: application/dicom\r\n\r\n");
                body.extend(part);
                body.extend(b"\r\n");
            }
            body.extend(b"--bb--");
            let found = parts_of(boundary, &body, length).unwrap();
            let found: Vec<_> = found.into_iter().map(|(_, data)| data).collect();
            prop_assert_eq!(found, parts);
        }

        #[test]
        fn nothing_that_is_changed_on_the_way_is_a_panic(
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
            cut in any::<prop::sample::Index>(),
            length in 1_usize..80,
        ) {
            let mut body = Vec::new();
            for part in ["one", "\r\n--", "three"] {
                body.extend(format!("--bb\r\nContent-Type: application/dicom\r\nContent-Length: 3\r\n\r\n{part}\r\n").bytes());
            }
            body.extend(b"--bb--");
            for (at, byte) in changes {
                let at = at.index(body.len());
                body[at] = byte;
            }
            body.truncate(cut.index(body.len()) + 1);
            let _ = parts_of("bb", &body, length);
        }
    }
}
