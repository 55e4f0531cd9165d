//! DICOM series written by hand: small, whole, and wrong in one way at a time.

/// How elements are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Syntax {
    Implicit,
    Explicit,
    BigEndian,
    Deflated,
    Rle,
}

impl Syntax {
    fn uid(self) -> &'static str {
        match self {
            Self::Implicit => "1.2.840.10008.1.2",
            Self::Explicit => "1.2.840.10008.1.2.1",
            Self::BigEndian => "1.2.840.10008.1.2.2",
            Self::Deflated => "1.2.840.10008.1.2.1.99",
            Self::Rle => "1.2.840.10008.1.2.5",
        }
    }
}

/// A data set under construction; elements must come in the order of their tags.
pub(crate) struct DataSet {
    pub(crate) syntax: Syntax,
    pub(crate) bytes: Vec<u8>,
}

impl DataSet {
    pub(crate) fn new(syntax: Syntax) -> Self {
        Self {
            syntax,
            bytes: Vec::new(),
        }
    }

    fn short(&self, number: u16) -> [u8; 2] {
        match self.syntax {
            Syntax::BigEndian => number.to_be_bytes(),
            _ => number.to_le_bytes(),
        }
    }

    fn long(&self, number: u32) -> [u8; 4] {
        match self.syntax {
            Syntax::BigEndian => number.to_be_bytes(),
            _ => number.to_le_bytes(),
        }
    }

    /// The head of an element, with any length at all.
    pub(crate) fn head(&mut self, [group, element]: [u16; 2], vr: &str, length: u32) {
        let tag = [self.short(group), self.short(element)].concat();
        self.bytes.extend(tag);
        let long = self.long(length);
        if self.syntax == Syntax::Implicit {
            self.bytes.extend(long);
        } else if matches!(vr, "OW" | "OB" | "SQ" | "UN" | "UT") {
            self.bytes.extend(vr.as_bytes());
            self.bytes.extend([0, 0]);
            self.bytes.extend(long);
        } else {
            self.bytes.extend(vr.as_bytes());
            let short = self.short(length as u16);
            self.bytes.extend(short);
        }
    }

    /// An item or a delimiter, which have no value representation.
    pub(crate) fn delimiter(&mut self, element: u16, length: u32) {
        let tag = [self.short(0xFFFE), self.short(element)].concat();
        let length = self.long(length);
        self.bytes.extend(tag);
        self.bytes.extend(length);
    }

    pub(crate) fn bytes(&mut self, tag: [u16; 2], vr: &str, value: &[u8]) {
        self.head(tag, vr, value.len() as u32);
        self.bytes.extend_from_slice(value);
    }

    pub(crate) fn text(&mut self, tag: [u16; 2], vr: &str, text: &str) {
        let mut value = text.as_bytes().to_vec();
        if value.len() % 2 == 1 {
            value.push(if vr == "UI" { 0 } else { b' ' });
        }
        self.bytes(tag, vr, &value);
    }

    pub(crate) fn number(&mut self, tag: [u16; 2], number: u16) {
        let value = self.short(number);
        self.bytes(tag, "US", &value);
    }

    pub(crate) fn samples(&self, samples: &[u16]) -> Vec<u8> {
        samples
            .iter()
            .flat_map(|&sample| self.short(sample))
            .collect()
    }

    pub(crate) fn file(self) -> Vec<u8> {
        let mut meta = DataSet::new(Syntax::Explicit);
        meta.text([2, 0x10], "UI", self.syntax.uid());
        let mut file = vec![0; 128];
        file.extend(b"DICM");
        file.extend(meta.bytes);
        if self.syntax == Syntax::Deflated {
            use std::io::Write as _;
            let packed = flate2::Compression::fast();
            let mut packed = flate2::write::DeflateEncoder::new(file, packed);
            packed.write_all(&self.bytes).unwrap();
            return packed.finish().unwrap();
        }
        file.extend(self.bytes);
        file
    }
}

/// One byte of each sample, packed as literal runs.
fn rle_segment(bytes: impl Iterator<Item = u8>) -> Vec<u8> {
    let bytes: Vec<u8> = bytes.collect();
    let mut packed = Vec::new();
    for run in bytes.chunks(128) {
        packed.push(run.len() as u8 - 1);
        packed.extend_from_slice(run);
    }
    if packed.len() % 2 == 1 {
        packed.push(0);
    }
    packed
}

/// A classic MR or CT slice. What a test does not change is that of a sound axial series.
#[derive(Debug, Clone)]
pub(crate) struct Slice {
    pub(crate) sop_class: &'static str,
    pub(crate) image_type: &'static str,
    pub(crate) modality: &'static str,
    pub(crate) description: &'static str,
    pub(crate) instance: i64,
    pub(crate) sop_uid: String,
    pub(crate) series_uid: String,
    pub(crate) series_number: i64,
    pub(crate) patient_id: &'static str,
    pub(crate) echo_ms: f64,
    pub(crate) acquisition: i64,
    pub(crate) position: [f64; 3],
    pub(crate) orientation: [f64; 6],
    /// Between rows, between columns.
    pub(crate) spacing: [f64; 2],
    pub(crate) columns: u16,
    pub(crate) samples: Vec<u16>,
    pub(crate) bits_stored: u16,
    pub(crate) signed: bool,
    pub(crate) photometric: &'static str,
    pub(crate) samples_per_pixel: u16,
    pub(crate) rescale: Option<[f64; 2]>,
}

const MR: &str = "1.2.840.10008.5.1.4.1.1.4";

impl Slice {
    /// Slice `number` of a series of 6 × 5 pixels, 2 mm apart; its samples tell place and slice.
    pub(crate) fn number(number: usize) -> Self {
        let samples = (0..30u16).map(|at| 100 * (number as u16 + 1) + at);
        Self {
            sop_class: MR,
            image_type: "ORIGINAL\\PRIMARY\\M",
            modality: "MR",
            description: "t1_mprage",
            instance: number as i64 + 1,
            sop_uid: format!("1.2.3.4.{}", number + 1),
            series_uid: "1.2.3.1".to_owned(),
            series_number: 4,
            patient_id: "P-77",
            echo_ms: 2.5,
            acquisition: 1,
            position: [-10.0, -20.0, 30.0 + 2.0 * number as f64],
            orientation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            spacing: [1.5, 1.25],
            columns: 6,
            samples: samples.collect(),
            bits_stored: 12,
            signed: false,
            photometric: "MONOCHROME2",
            samples_per_pixel: 1,
            rescale: None,
        }
    }

    pub(crate) fn data_set(&self, syntax: Syntax) -> DataSet {
        let mut set = DataSet::new(syntax);
        let list = |values: &[f64]| {
            let texts: Vec<String> = values.iter().map(ToString::to_string).collect();
            texts.join("\\")
        };
        set.text([8, 0x08], "CS", self.image_type);
        set.text([8, 0x16], "UI", self.sop_class);
        set.text([8, 0x18], "UI", &self.sop_uid);
        set.text([8, 0x60], "CS", self.modality);
        set.text([8, 0x103E], "LO", self.description);
        set.text([0x10, 0x10], "PN", "Somebody^Secret");
        set.text([0x10, 0x20], "LO", self.patient_id);
        set.text([0x18, 0x81], "DS", &self.echo_ms.to_string());
        set.text([0x20, 0x0D], "UI", "1.2.3");
        set.text([0x20, 0x0E], "UI", &self.series_uid);
        set.text([0x20, 0x11], "IS", &self.series_number.to_string());
        set.text([0x20, 0x12], "IS", &self.acquisition.to_string());
        set.text([0x20, 0x13], "IS", &self.instance.to_string());
        set.text([0x20, 0x32], "DS", &list(&self.position));
        set.text([0x20, 0x37], "DS", &list(&self.orientation));
        set.number([0x28, 2], self.samples_per_pixel);
        set.text([0x28, 4], "CS", self.photometric);
        set.number(
            [0x28, 0x10],
            (self.samples.len() / usize::from(self.columns)) as u16,
        );
        set.number([0x28, 0x11], self.columns);
        set.text([0x28, 0x30], "DS", &list(&self.spacing));
        set.number([0x28, 0x100], 16);
        set.number([0x28, 0x101], self.bits_stored);
        set.number([0x28, 0x102], self.bits_stored - 1);
        set.number([0x28, 0x103], self.signed.into());
        if let Some([slope, intercept]) = self.rescale {
            set.text([0x28, 0x1052], "DS", &intercept.to_string());
            set.text([0x28, 0x1053], "DS", &slope.to_string());
        }
        set
    }

    pub(crate) fn file(&self, syntax: Syntax) -> Vec<u8> {
        let mut set = self.data_set(syntax);
        if syntax != Syntax::Rle {
            let samples = set.samples(&self.samples);
            set.bytes([0x7FE0, 0x10], "OW", &samples);
            return set.file();
        }
        let high = rle_segment(self.samples.iter().map(|sample| (sample >> 8) as u8));
        let low = rle_segment(self.samples.iter().map(|&sample| sample as u8));
        let mut frame = [2u32, 64, 64 + high.len() as u32]
            .map(u32::to_le_bytes)
            .concat();
        frame.resize(64, 0);
        frame.extend([high, low].concat());
        set.head([0x7FE0, 0x10], "OB", u32::MAX);
        set.delimiter(0xE000, 0);
        set.delimiter(0xE000, frame.len() as u32);
        set.bytes.extend(frame);
        set.delimiter(0xE0DD, 0);
        set.file()
    }
}

/// A sound series of so many slices.
pub(crate) fn slices(count: usize) -> Vec<Slice> {
    (0..count).map(Slice::number).collect()
}

/// The files of a series, last slice first: what comes first says nothing.
pub(crate) fn files(slices: &[Slice], syntax: Syntax) -> Vec<Vec<u8>> {
    slices
        .iter()
        .rev()
        .map(|slice| slice.file(syntax))
        .collect()
}

/// The same slices as one Enhanced image.
pub(crate) fn enhanced(slices: &[Slice]) -> Vec<u8> {
    let first = &slices[0];
    let mut set = DataSet::new(Syntax::Explicit);
    set.text([8, 0x16], "UI", "1.2.840.10008.5.1.4.1.1.4.1");
    set.text([8, 0x18], "UI", &first.sop_uid);
    set.text([0x20, 0x0E], "UI", &first.series_uid);
    set.number([0x28, 2], 1);
    set.text([0x28, 4], "CS", "MONOCHROME2");
    set.text([0x28, 8], "IS", &slices.len().to_string());
    set.number([0x28, 0x10], 5);
    set.number([0x28, 0x11], 6);
    set.number([0x28, 0x100], 16);
    set.number([0x28, 0x101], 12);
    set.number([0x28, 0x102], 11);
    set.number([0x28, 0x103], 0);
    let list = |values: &[f64]| {
        let texts: Vec<String> = values.iter().map(ToString::to_string).collect();
        texts.join("\\")
    };
    let group = |tag: [u16; 2], inner: [u16; 2], text: &str| {
        let mut item = DataSet::new(Syntax::Explicit);
        item.text(inner, "DS", text);
        let mut sequence = DataSet::new(Syntax::Explicit);
        sequence.head(tag, "SQ", item.bytes.len() as u32 + 8);
        sequence.delimiter(0xE000, item.bytes.len() as u32);
        sequence.bytes.extend(item.bytes);
        sequence.bytes
    };
    set.head([0x5200, 0x9229], "SQ", u32::MAX);
    set.delimiter(0xE000, u32::MAX);
    set.bytes.extend(group(
        [0x20, 0x9116],
        [0x20, 0x37],
        &list(&first.orientation),
    ));
    set.bytes
        .extend(group([0x28, 0x9110], [0x28, 0x30], &list(&first.spacing)));
    set.delimiter(0xE00D, 0);
    set.delimiter(0xE0DD, 0);
    set.head([0x5200, 0x9230], "SQ", u32::MAX);
    for slice in slices {
        let position = group([0x20, 0x9113], [0x20, 0x32], &list(&slice.position));
        set.delimiter(0xE000, position.len() as u32);
        set.bytes.extend(position);
    }
    set.delimiter(0xE0DD, 0);
    let samples: Vec<u16> = slices
        .iter()
        .flat_map(|slice| slice.samples.clone())
        .collect();
    let samples = set.samples(&samples);
    set.bytes([0x7FE0, 0x10], "OW", &samples);
    set.file()
}
