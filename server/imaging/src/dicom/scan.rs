//! A walk over the structure of a file, before any of it is parsed.
//!
//! Every length is compared with the remaining bytes, and nesting is limited. The result is a new header: only the
//! wanted elements, with sequences of undefined length, so that the parser never sees private sequences.

use std::borrow::Cow;
use std::io::Read;
use std::ops::Range;

use dicom_core::dictionary::{DataDictionary as _, DataDictionaryEntry as _};
use dicom_core::{Tag, VR};
use dicom_dictionary_std::{StandardDataDictionary, tags};
use flate2::read::DeflateDecoder;

use super::DicomError;
use super::error::damaged;
use super::sequences::SEQUENCES;
use super::syntax::{Encoding, Syntax};
use crate::sniff::dicom_start;

/// The deepest nesting of sequences.
const MAX_DEPTH: usize = 24;

/// The largest header that is passed to the parser: the per-frame groups of some thousand frames take a few megabytes.
const MAX_HEADER_BYTES: usize = 64 << 20;

/// The largest data set that a deflated file may hold.
const MAX_INFLATED_BYTES: u64 = 512 << 20;

/// The deepest sequence that is read in another encoding if its items have another one than the data set. Each level may double
/// the time.
const MAX_OTHER_DEPTH: usize = 1;

const ITEM: Tag = Tag(0xFFFE, 0xE000);
const ITEM_END: Tag = Tag(0xFFFE, 0xE00D);
const SEQUENCE_END: Tag = Tag(0xFFFE, 0xE0DD);
const UNDEFINED: u32 = u32::MAX;

/// A file with a sound structure.
pub(crate) struct Scanned<'a> {
    pub(crate) syntax: Syntax,
    /// The data set, inflated if it was deflated.
    dataset: Cow<'a, [u8]>,
    /// The wanted elements before the pixels, in the data set's encoding.
    pub(crate) header: Vec<u8>,
    /// Where the values of Specific Character Set lie in the header, of the data set and of items.
    pub(crate) character_sets: Vec<Range<usize>>,
    pixels: Option<PixelRanges>,
    /// Whether the pixels are real numbers, which are not read.
    pub(crate) has_real_pixels: bool,
}

/// The byte ranges of the pixels in the data set.
#[derive(Debug, Clone, PartialEq, Eq)]
enum PixelRanges {
    Native(Range<usize>),
    /// The basic offset table, then the fragments.
    Encapsulated(Vec<Range<usize>>),
}

/// The bytes of a file's pixels.
#[derive(Debug)]
pub(crate) enum PixelBytes<'a> {
    Native(&'a [u8]),
    Encapsulated {
        offsets: &'a [u8],
        fragments: Vec<&'a [u8]>,
    },
}

impl Scanned<'_> {
    pub(crate) fn pixels(&self) -> Option<PixelBytes<'_>> {
        Some(match self.pixels.as_ref()? {
            PixelRanges::Native(range) => PixelBytes::Native(&self.dataset[range.clone()]),
            PixelRanges::Encapsulated(ranges) => {
                let mut items = ranges.iter().map(|range| &self.dataset[range.clone()]);
                PixelBytes::Encapsulated {
                    offsets: items.next().unwrap_or_default(),
                    fragments: items.collect(),
                }
            }
        })
    }
}

/// Walks over a file up to its pixels and keeps the elements with a tag in `wanted`, which must be sorted.
///
/// # Errors
/// If a length exceeds the file or its sequence, or sequences are nested too deeply.
pub(crate) fn scan<'a>(file: &'a [u8], wanted: &[Tag]) -> Result<Scanned<'a>, DicomError> {
    match scan_as_far_as_sound(file, wanted)? {
        (scanned, None) => Ok(scanned),
        (_, Some(fault)) => Err(fault),
    }
}

/// As [`scan`]; of a damaged data set, what comes before the damage, and what the damage is.
///
/// # Errors
/// If the file meta information is damaged.
pub(crate) fn scan_as_far_as_sound<'a>(
    file: &'a [u8],
    wanted: &[Tag],
) -> Result<(Scanned<'a>, Option<DicomError>), DicomError> {
    let Meta { syntax, start, .. } = read_meta(file)?;
    let rest = &file[start..];
    let dataset = if syntax.deflated {
        Cow::Owned(inflate(rest)?)
    } else {
        Cow::Borrowed(rest)
    };
    let mut walk = Walk {
        bytes: &dataset,
        encoding: syntax.encoding,
        written: syntax.encoding,
        wanted,
        header: Vec::new(),
        character_sets: Vec::new(),
        has_real_pixels: false,
        sound: (0, 0),
    };
    let (pixels, fault) = match walk.data_set() {
        Ok(pixels) => (pixels, None),
        Err(fault) => {
            let (header, character_sets) = walk.sound;
            walk.header.truncate(header);
            walk.character_sets.truncate(character_sets);
            (None, Some(fault))
        }
    };
    let has_real_pixels = walk.has_real_pixels;
    let (header, character_sets) = (walk.header, walk.character_sets);
    let scanned = Scanned {
        syntax,
        dataset,
        header,
        character_sets,
        pixels,
        has_real_pixels,
    };
    Ok((scanned, fault))
}

/// The transfer syntax that a file states; `None` if it is a bare data set without file meta information.
///
/// # Errors
/// If the file meta information is damaged.
pub(crate) fn stated_syntax(file: &[u8]) -> Result<Option<String>, DicomError> {
    let meta = read_meta(file)?;
    let is_file = dicom_start(file) > Some(0);
    let stated = meta.stated.filter(|_| is_file);
    Ok(stated.and_then(|uid| {
        let text = std::str::from_utf8(uid).ok()?;
        Some(text.trim_end_matches(['\0', ' ']).to_owned())
    }))
}

/// What comes before a data set.
struct Meta<'a> {
    syntax: Syntax,
    /// The UID of the transfer syntax.
    stated: Option<&'a [u8]>,
    /// The start of the data set.
    start: usize,
}

/// Skips the preamble and the file meta information.
fn read_meta(file: &[u8]) -> Result<Meta<'_>, DicomError> {
    let start = dicom_start(file).unwrap_or(0);
    let explicit = meta_elements(file, start, Encoding::ExplicitLittle);
    // Some writers state nothing but implicit elements.
    let (stated, at) = explicit
        .or_else(|fault| meta_elements(file, start, Encoding::ImplicitLittle).map_err(|_| fault))?;
    let dataset = &file[at..];
    let syntax = match stated {
        Some(uid) => {
            let syntax = Syntax::from_uid(uid);
            let encoding = match syntax.deflated {
                true => syntax.encoding,
                false => found(dataset, syntax.encoding),
            };
            Syntax { encoding, ..syntax }
        }
        None => Syntax::native(guess(dataset)),
    };
    Ok(Meta {
        syntax,
        stated,
        start: at,
    })
}

/// The UID of the transfer syntax, and the end of the file meta information.
fn meta_elements(
    file: &[u8],
    start: usize,
    encoding: Encoding,
) -> Result<(Option<&[u8]>, usize), DicomError> {
    let (mut stated, mut at) = (None, start);
    let reader = Elements {
        bytes: file,
        encoding,
    };
    while file.get(at..at + 2) == Some(&[2, 0]) {
        let element = reader.element(at, file.len())?;
        let value = element.value_range(file.len())?;
        if element.tag == tags::TRANSFER_SYNTAX_UID {
            stated = Some(&file[value.clone()]);
        }
        at = value.end;
    }
    Ok((stated, at))
}

/// The encoding of a data set: the stated one, unless its first element shows that it is the other little-endian one.
fn found(dataset: &[u8], stated: Encoding) -> Encoding {
    let Some(&[_, _, _, _, first, second, ..]) = dataset.first_chunk::<8>() else {
        return stated;
    };
    let has_vr = VR::from_binary([first, second]).is_some();
    match (stated, has_vr) {
        (Encoding::ExplicitLittle, false) => Encoding::ImplicitLittle,
        (Encoding::ImplicitLittle, true) => Encoding::ExplicitLittle,
        _ => stated,
    }
}

/// The encoding of a data set without file meta information, from its first element.
fn guess(dataset: &[u8]) -> Encoding {
    let explicit = dataset
        .get(4..6)
        .is_some_and(|vr| vr.iter().all(u8::is_ascii_uppercase));
    match (explicit, dataset) {
        (false, _) => Encoding::ImplicitLittle,
        (true, [0, group, ..]) if *group > 0 => Encoding::ExplicitBig,
        _ => Encoding::ExplicitLittle,
    }
}

fn inflate(packed: &[u8]) -> Result<Vec<u8>, DicomError> {
    let mut bytes = Vec::new();
    let mut stream = DeflateDecoder::new(packed).take(MAX_INFLATED_BYTES + 1);
    stream
        .read_to_end(&mut bytes)
        .map_err(|_| damaged("its deflated data set cannot be inflated"))?;
    if bytes.len() as u64 > MAX_INFLATED_BYTES {
        return Err(DicomError::TooManyBytes {
            limit: MAX_INFLATED_BYTES,
        });
    }
    Ok(bytes)
}

/// Tag, value representation and length of an element.
#[derive(Debug, Clone, Copy)]
struct Element {
    tag: Tag,
    /// `None` if the encoding does not state it.
    vr: Option<[u8; 2]>,
    /// `None` if it is undefined.
    length: Option<usize>,
    /// The start of its value.
    value: usize,
}

impl Element {
    /// The range of the value, which must have a length and end at `end` or before.
    fn value_range(&self, end: usize) -> Result<Range<usize>, DicomError> {
        let length = self
            .length
            .ok_or(damaged("an element that is not a sequence has no length"))?;
        match self.value.checked_add(length) {
            Some(last) if last <= end => Ok(self.value..last),
            _ => Err(damaged("an element is longer than the rest of the file")),
        }
    }

    fn is_sequence(&self) -> bool {
        self.vr == Some(*b"SQ") || self.length.is_none()
    }
}

/// Reads elements up to their values.
#[derive(Clone, Copy)]
struct Elements<'a> {
    bytes: &'a [u8],
    encoding: Encoding,
}

impl Elements<'_> {
    fn number<const N: usize>(self, at: usize, end: usize) -> Result<u32, DicomError> {
        let bytes = (at + N <= end).then(|| &self.bytes[at..at + N]);
        let bytes = bytes.ok_or(damaged("it ends within an element"))?;
        let fold = |number: u32, &byte: &u8| number << 8 | u32::from(byte);
        Ok(match self.encoding {
            Encoding::ExplicitBig => bytes.iter().fold(0, fold),
            _ => bytes.iter().rev().fold(0, fold),
        })
    }

    fn element(self, at: usize, end: usize) -> Result<Element, DicomError> {
        let tag = Tag(
            self.number::<2>(at, end)? as u16,
            self.number::<2>(at + 2, end)? as u16,
        );
        let delimiter = tag.0 == ITEM.0;
        if delimiter || self.encoding == Encoding::ImplicitLittle {
            let length = self.number::<4>(at + 4, end)?;
            return Ok(Element {
                tag,
                vr: None,
                length: defined(length),
                value: at + 8,
            });
        }
        if at + 6 > end {
            return Err(damaged("it ends within an element"));
        }
        let vr = [self.bytes[at + 4], self.bytes[at + 5]];
        if !vr.iter().all(u8::is_ascii_uppercase) {
            return self.private(tag, at, end);
        }
        let (length, value) = if is_long(vr) {
            (self.number::<4>(at + 8, end)?, at + 12)
        } else {
            (self.number::<2>(at + 6, end)?, at + 8)
        };
        Ok(Element {
            tag,
            vr: Some(vr),
            length: if is_long(vr) {
                defined(length)
            } else {
                Some(length as usize)
            },
            value,
        })
    }
}

impl Elements<'_> {
    /// A private element without a value representation: its length is where what follows it is an element.
    fn private(self, tag: Tag, at: usize, end: usize) -> Result<Element, DicomError> {
        let fault = damaged("an element has no value representation");
        if tag.0.is_multiple_of(2) || self.encoding != Encoding::ExplicitLittle {
            return Err(fault);
        }
        let lengths = [
            (self.number::<2>(at + 6, end), at + 8),
            (self.number::<4>(at + 8, end), at + 12),
            (self.number::<4>(at + 4, end), at + 8),
        ];
        let follows = |next: usize| {
            let half = |at| self.number::<2>(at, end).map(|half| half as u16);
            let (Ok(group), Ok(element)) = (half(next), half(next + 2)) else {
                return next == end;
            };
            let has_vr = self.bytes[next + 4..end.min(next + 6)]
                .iter()
                .all(u8::is_ascii_uppercase);
            let is_later = Tag(group, element) > tag && (has_vr || group == tag.0);
            group == ITEM.0 || is_later
        };
        let mut fitting = lengths.into_iter().filter_map(|(length, value)| {
            let length = length.ok()? as usize;
            let next = value.checked_add(length).filter(|&next| next <= end)?;
            follows(next).then_some(Element {
                tag,
                vr: Some(*b"UN"),
                length: Some(length),
                value,
            })
        });
        fitting.next().ok_or(fault)
    }
}

fn defined(length: u32) -> Option<usize> {
    (length != UNDEFINED).then_some(length as usize)
}

/// Whether the length takes four bytes (PS3.5 §7.1.2).
fn is_long(vr: [u8; 2]) -> bool {
    matches!(
        &vr,
        b"OB"
            | b"OD"
            | b"OF"
            | b"OL"
            | b"OV"
            | b"OW"
            | b"SQ"
            | b"SV"
            | b"UC"
            | b"UN"
            | b"UR"
            | b"UT"
            | b"UV"
    )
}

/// The value representation of an element; that of the dictionary, if the file does not know it.
fn known_vr(element: &Element) -> Option<[u8; 2]> {
    match element.vr {
        None | Some([b'U', b'N']) => StandardDataDictionary
            .by_tag(element.tag)
            .map(|entry| entry.vr().relaxed().to_bytes())
            .or(element.vr),
        vr => vr,
    }
}

struct Walk<'a> {
    bytes: &'a [u8],
    /// The encoding of what is read.
    encoding: Encoding,
    /// The encoding of the data set and of the header.
    written: Encoding,
    /// The tags of the elements that are kept, sorted.
    wanted: &'a [Tag],
    header: Vec<u8>,
    character_sets: Vec<Range<usize>>,
    has_real_pixels: bool,
    /// Lengths of the header and of the character sets after the last whole element of the data set.
    sound: (usize, usize),
}

impl Walk<'_> {
    fn elements(&self, encoding: Encoding) -> Elements<'_> {
        Elements {
            bytes: self.bytes,
            encoding,
        }
    }

    /// Walks up to the pixels, or to the end.
    fn data_set(&mut self) -> Result<Option<PixelRanges>, DicomError> {
        let (mut at, end) = (0, self.bytes.len());
        while at < end {
            // Some writers pad their files with zeros.
            if self.bytes[at..].iter().take(8).all(|&byte| byte == 0) {
                break;
            }
            let element = self.elements(self.encoding).element(at, end)?;
            match element.tag {
                tags::PIXEL_DATA => return self.pixels(&element).map(Some),
                tags::FLOAT_PIXEL_DATA | tags::DOUBLE_FLOAT_PIXEL_DATA => {
                    self.has_real_pixels = true;
                    return Ok(None);
                }
                _ => {}
            }
            let keep = self.wanted.binary_search(&element.tag).is_ok();
            at = self.element(at, end, keep, 0)?;
            self.sound = (self.header.len(), self.character_sets.len());
        }
        Ok(None)
    }

    /// Walks over one element and, if `keep` is set, writes it to the header. Returns the end of the element.
    fn element(
        &mut self,
        at: usize,
        end: usize,
        keep: bool,
        depth: usize,
    ) -> Result<usize, DicomError> {
        let element = self.elements(self.encoding).element(at, end)?;
        if element.tag.0 == ITEM.0 {
            return Err(damaged("there is a delimiter in place of an element"));
        }
        if self.header.len() > MAX_HEADER_BYTES {
            return Err(damaged("its header is too large"));
        }
        // The value would be in the other byte order.
        let is_big = self.written == Encoding::ExplicitBig;
        let vr = match is_big {
            true => element.vr,
            false => known_vr(&element),
        };
        let is_sequence = element.is_sequence() || self.is_known_sequence(&element);
        let is_unread_sequence = !is_sequence && element.vr.is_some() && vr == Some(*b"SQ");
        let keep = keep && !is_unread_sequence;
        match (is_sequence, keep) {
            (false, true) => {
                let range = element.value_range(end)?;
                self.write_element(at, &element, vr, &range);
                if element.tag == tags::SPECIFIC_CHARACTER_SET {
                    let end = self.header.len();
                    self.character_sets.push(end - range.len()..end);
                }
                Ok(range.end)
            }
            // An unwanted element with a length is skipped.
            (_, false) if element.length.is_some() => Ok(element.value_range(end)?.end),
            (_, keep) => self.sequence(&element, end, keep, depth),
        }
    }

    /// Whether the element is a wanted sequence, although its encoding does not state it.
    fn is_known_sequence(&self, element: &Element) -> bool {
        matches!(element.vr, None | Some([b'U', b'N'])) && SEQUENCES.contains(&element.tag)
    }

    /// Copies an element, or writes it again if it has another encoding than the header or no value representation in it.
    fn write_element(
        &mut self,
        at: usize,
        element: &Element,
        vr: Option<[u8; 2]>,
        value: &Range<usize>,
    ) {
        if self.encoding == self.written && vr == element.vr {
            self.header.extend_from_slice(&self.bytes[at..value.end]);
            return;
        }
        self.write_tag(element.tag);
        let length = value.len() as u32;
        match vr.filter(|_| self.written != Encoding::ImplicitLittle) {
            Some(vr) if is_long(vr) || value.len() > usize::from(u16::MAX) => {
                let vr = if is_long(vr) { vr } else { *b"UN" };
                self.header.extend_from_slice(&vr);
                self.header.extend_from_slice(&[0; 2]);
                self.header.extend_from_slice(&length.to_le_bytes());
            }
            Some(vr) => {
                self.header.extend_from_slice(&vr);
                self.header
                    .extend_from_slice(&(length as u16).to_le_bytes());
            }
            None => self.header.extend_from_slice(&length.to_le_bytes()),
        }
        self.header.extend_from_slice(&self.bytes[value.clone()]);
    }

    fn sequence(
        &mut self,
        head: &Element,
        end: usize,
        keep: bool,
        depth: usize,
    ) -> Result<usize, DicomError> {
        if depth >= MAX_DEPTH {
            return Err(damaged("its sequences are nested too deeply"));
        }
        // A sequence of unknown representation has implicit encoding (PS3.5 §6.2.2), if its writer knew that.
        let encoding = self.encoding;
        let is_big = self.written == Encoding::ExplicitBig;
        let keep = keep && !(is_big && head.vr == Some(*b"UN"));
        if head.vr == Some(*b"UN") {
            self.encoding = Encoding::ImplicitLittle;
        }
        if keep {
            self.write_sequence_head(head);
        }
        let begun = (self.header.len(), self.character_sets.len());
        let mut ended = self.items(head, end, keep, depth);
        if let (Err(_), false, ..=MAX_OTHER_DEPTH) = (&ended, is_big, depth) {
            self.header.truncate(begun.0);
            self.character_sets.truncate(begun.1);
            self.encoding = match self.encoding {
                Encoding::ImplicitLittle => Encoding::ExplicitLittle,
                _ => Encoding::ImplicitLittle,
            };
            ended = self.items(head, end, keep, depth).or(ended);
        }
        self.encoding = encoding;
        if keep {
            self.write_delimiter(SEQUENCE_END, 0);
        }
        ended
    }

    fn items(
        &mut self,
        head: &Element,
        end: usize,
        keep: bool,
        depth: usize,
    ) -> Result<usize, DicomError> {
        self.contents(head, end, SEQUENCE_END, |walk, at, end| {
            let item = walk.elements(walk.encoding).element(at, end)?;
            if item.tag != ITEM {
                return Err(damaged("a sequence contains something other than items"));
            }
            if keep {
                walk.write_delimiter(ITEM, UNDEFINED);
            }
            let at = walk.item(&item, end, keep, depth)?;
            if keep {
                walk.write_delimiter(ITEM_END, 0);
            }
            Ok(at)
        })
    }

    fn item(
        &mut self,
        item: &Element,
        end: usize,
        keep: bool,
        depth: usize,
    ) -> Result<usize, DicomError> {
        if let (false, Some(_)) = (keep, item.length) {
            return Ok(item.value_range(end)?.end);
        }
        self.contents(item, end, ITEM_END, |walk, at, end| {
            let element = walk.elements(walk.encoding).element(at, end)?;
            let keep = keep && walk.wanted.binary_search(&element.tag).is_ok();
            walk.element(at, end, keep, depth + 1)
        })
    }

    /// Walks over the contents of a sequence or an item: up to its end if it has a length, otherwise up to its
    /// delimiter.
    ///
    /// `each` walks over the element at the first offset, within contents that end at the second, and returns the end
    /// of the element. Returns the end of the contents.
    fn contents(
        &mut self,
        head: &Element,
        end: usize,
        delimiter: Tag,
        mut each: impl FnMut(&mut Self, usize, usize) -> Result<usize, DicomError>,
    ) -> Result<usize, DicomError> {
        let is_delimited = head.length.is_none();
        let end = match is_delimited {
            true => end,
            false => head.value_range(end)?.end,
        };
        let mut at = head.value;
        while at < end {
            if is_delimited {
                let element = self.elements(self.encoding).element(at, end)?;
                if element.tag == delimiter {
                    return Ok(element.value);
                }
            }
            at = each(self, at, end)?;
        }
        if is_delimited {
            return Err(damaged("a sequence or an item has no end"));
        }
        Ok(end)
    }

    fn pixels(&self, head: &Element) -> Result<PixelRanges, DicomError> {
        let end = self.bytes.len();
        if head.length.is_some() {
            let range = head.value_range(end);
            let range = range.map_err(|_| damaged("its pixel data is truncated"))?;
            return Ok(PixelRanges::Native(range));
        }
        let mut fragments = Vec::new();
        let mut at = head.value;
        // The pixels are complete even if the last delimiter is missing.
        while at < end {
            let item = self.elements(self.encoding).element(at, end)?;
            match item.tag {
                ITEM => {}
                SEQUENCE_END => break,
                _ => {
                    return Err(damaged(
                        "its compressed pixel data contains something other than items",
                    ));
                }
            }
            let range = item.value_range(end);
            let range = range.map_err(|_| damaged("its compressed pixel data is truncated"))?;
            at = range.end;
            fragments.push(range);
        }
        Ok(PixelRanges::Encapsulated(fragments))
    }

    fn write_sequence_head(&mut self, head: &Element) {
        self.write_tag(head.tag);
        if self.written != Encoding::ImplicitLittle {
            self.header.extend_from_slice(b"SQ\0\0");
        }
        self.header.extend_from_slice(&UNDEFINED.to_le_bytes());
    }

    fn write_delimiter(&mut self, tag: Tag, length: u32) {
        self.write_tag(tag);
        self.header.extend_from_slice(&length.to_le_bytes());
    }

    fn write_tag(&mut self, tag: Tag) {
        for half in [tag.0, tag.1] {
            self.header.extend_from_slice(&match self.written {
                Encoding::ExplicitBig => half.to_be_bytes(),
                _ => half.to_le_bytes(),
            });
        }
    }
}
