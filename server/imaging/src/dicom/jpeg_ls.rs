//! JPEG-LS of one component, lossless and near-lossless.
//!
//! Each sample is predicted from its left, upper and diagonal neighbours. The error has a Golomb code with a parameter
//! that is learned for each of 365 contexts. Flat stretches are coded as runs. Time and memory depend only on the
//! number of samples.
//!
//! Not supported: restart intervals, mapping tables and point transforms, which DICOM writers do not use.
//!
//! Source: ITU-T Recommendation T.87 (1998), annexes A and C.

#[cfg(test)]
mod near_lossless;

const CUT_OFF: &str = "its JPEG-LS image is truncated";
const DAMAGED: &str = "its JPEG-LS image is damaged";

/// Decodes one frame into unsigned samples.
pub(super) fn decode(packed: &[u8], [columns, rows]: [usize; 2]) -> Result<Vec<u16>, &'static str> {
    let header = read_header(packed)?;
    if header.size != [columns, rows] {
        return Err("the size of its JPEG-LS image differs from the header");
    }
    Scan::new(&header, &packed[header.scan..]).decode()
}

/// The header: everything before the coded samples.
#[derive(Debug)]
struct Header {
    bits: u32,
    size: [usize; 2],
    near: i32,
    presets: Presets,
    /// The start of the coded samples.
    scan: usize,
}

/// Coding parameters; 0 means the default (C.2.4.1.1).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Presets {
    max_value: i32,
    thresholds: [i32; 3],
    reset: i32,
}

/// Reads the marker segments (T.81 annex B, T.87 annex C) up to the scan.
fn read_header(packed: &[u8]) -> Result<Header, &'static str> {
    if !packed.starts_with(&[0xFF, 0xD8]) {
        return Err("its JPEG-LS image has no start marker");
    }
    let (mut at, mut frame, mut presets) = (2, None, Presets::default());
    loop {
        let &[0xFF, marker] = packed.get(at..at + 2).ok_or(CUT_OFF)? else {
            return Err(DAMAGED);
        };
        if marker == 0xFF {
            at += 1;
            continue;
        }
        let length = packed.get(at + 2..at + 4).ok_or(CUT_OFF)?;
        let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
        let end = at + 2 + length;
        let segment = packed.get(at + 4..end).ok_or(CUT_OFF)?;
        match marker {
            0xF7 => frame = Some(read_frame(segment)?),
            0xF8 => presets = read_presets(segment)?,
            0xDA => {
                let (bits, size) = frame.ok_or(DAMAGED)?;
                let near = read_scan(segment)?;
                return Ok(Header {
                    bits,
                    size,
                    near,
                    presets,
                    scan: end,
                });
            }
            0xDD if segment.iter().any(|&byte| byte != 0) => {
                return Err("its JPEG-LS image has restart intervals, which are not supported");
            }
            // Comments and application data.
            0xDD | 0xE0..=0xEF | 0xFE => {}
            _ => return Err(DAMAGED),
        }
        at = end;
    }
}

fn read_frame(segment: &[u8]) -> Result<(u32, [usize; 2]), &'static str> {
    let &[bits, top, bottom, left, right, 1, _, 0x11, _] = segment else {
        return Err("its JPEG-LS image does not have exactly one grey component");
    };
    let size = [[left, right], [top, bottom]].map(|side| u16::from_be_bytes(side).into());
    if !(2..=16).contains(&bits) {
        return Err(DAMAGED);
    }
    Ok((bits.into(), size))
}

fn read_presets(segment: &[u8]) -> Result<Presets, &'static str> {
    let &[1, ref numbers @ ..] = segment else {
        return Err("its JPEG-LS image has a mapping table, which is not supported");
    };
    let [max_value, t1, t2, t3, reset] = <[u8; 10]>::try_from(numbers)
        .map(|bytes| [0, 2, 4, 6, 8].map(|at| u16::from_be_bytes([bytes[at], bytes[at + 1]])))
        .map_err(|_| DAMAGED)?
        .map(i32::from);
    Ok(Presets {
        max_value,
        thresholds: [t1, t2, t3],
        reset,
    })
}

fn read_scan(segment: &[u8]) -> Result<i32, &'static str> {
    match *segment {
        [1, _, 0, near, 0, 0] => Ok(near.into()),
        [1, ..] => {
            Err("its JPEG-LS image has a mapping table or point transform, which is not supported")
        }
        _ => Err("its JPEG-LS image does not have exactly one grey component"),
    }
}

/// The bits of the scan. After a byte of ones comes a stuffed bit, which is skipped.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Unread bits; the next one is the highest.
    buffer: u64,
    count: u32,
    after_ones: bool,
}

impl Bits<'_> {
    fn fill(&mut self) {
        while self.count <= 48 {
            let Some(&byte) = self.bytes.get(self.at) else {
                return;
            };
            if self.after_ones && byte & 0x80 != 0 {
                // A marker: the scan ends here.
                return;
            }
            let width = if self.after_ones { 7 } else { 8 };
            self.buffer |= u64::from(byte) << (64 - width - self.count);
            self.count += width;
            self.after_ones = byte == 0xFF;
            self.at += 1;
        }
    }

    fn take(&mut self, width: u32) -> Result<i32, &'static str> {
        if width == 0 {
            return Ok(0);
        }
        if self.count < width {
            self.fill();
            if self.count < width {
                return Err(CUT_OFF);
            }
        }
        let value = (self.buffer >> (64 - width)) as i32;
        self.buffer <<= width;
        self.count -= width;
        Ok(value)
    }

    /// Counts zeros up to the next one bit, which is consumed as well; at most `limit` zeros.
    fn zeros(&mut self, limit: u32) -> Result<u32, &'static str> {
        let mut zeros = 0;
        loop {
            if self.count == 0 {
                self.fill();
            }
            if self.count == 0 {
                return Err(CUT_OFF);
            }
            let run = self.buffer.leading_zeros().min(self.count);
            zeros += run;
            if zeros > limit {
                return Err(DAMAGED);
            }
            self.buffer = self.buffer.checked_shl(run).unwrap_or(0);
            self.count -= run;
            if self.count > 0 {
                self.buffer <<= 1;
                self.count -= 1;
                return Ok(zeros);
            }
        }
    }
}

/// The statistics of a context (A.2.1).
#[derive(Debug, Clone, Copy)]
struct Context {
    /// Sum of the absolute errors.
    a: i32,
    /// Sum of the errors, kept within one of zero per sample.
    b: i32,
    /// The bias correction of the prediction.
    c: i32,
    /// Number of samples so far.
    n: i32,
}

/// The statistics of one of the two contexts that end runs; `nn` counts negative errors.
#[derive(Debug, Clone, Copy)]
struct RunContext {
    a: i32,
    n: i32,
    nn: i32,
}

/// Lengths of run segments, as powers of two (A.7.1.1).
const RUN_ORDERS: [u32; 32] = [
    0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 9, 10, 11, 12, 13,
    14, 15,
];

/// The decoder of one component.
struct Scan<'a> {
    bits: Bits<'a>,
    size: [usize; 2],
    near: i32,
    max_value: i32,
    range: i32,
    /// Number of bits of a mapped error that is written uncoded.
    wide: u32,
    limit: u32,
    thresholds: [i32; 3],
    reset: i32,
    contexts: Vec<Context>,
    run_contexts: [RunContext; 2],
    run_index: usize,
}

impl<'a> Scan<'a> {
    fn new(header: &Header, bytes: &'a [u8]) -> Self {
        let max_value = match header.presets.max_value {
            0 => (1 << header.bits) - 1,
            stated => stated.min((1 << header.bits) - 1),
        };
        let near = header.near.min(max_value / 2);
        let range = (max_value + 2 * near) / (2 * near + 1) + 1;
        let width = |values: i32| (values - 1).max(1).ilog2() + 1;
        let bits_per_sample = width(max_value + 1).max(2);
        let first = Context {
            a: ((range + 32) / 64).max(2),
            b: 0,
            c: 0,
            n: 1,
        };
        let first_run = RunContext {
            a: first.a,
            n: 1,
            nn: 0,
        };
        Self {
            bits: Bits {
                bytes,
                at: 0,
                buffer: 0,
                count: 0,
                after_ones: false,
            },
            size: header.size,
            near,
            max_value,
            range,
            wide: width(range),
            limit: 2 * (bits_per_sample + bits_per_sample.max(8)),
            thresholds: thresholds(max_value, near, header.presets.thresholds),
            reset: match header.presets.reset {
                0 => 64,
                stated => stated.max(3),
            },
            contexts: vec![first; 365],
            run_contexts: [first_run; 2],
            run_index: 0,
        }
    }

    /// All samples, row by row.
    fn decode(mut self) -> Result<Vec<u16>, &'static str> {
        let [columns, rows] = self.size;
        let mut samples = Vec::new();
        samples
            .try_reserve_exact(columns * rows)
            .map_err(|_| "there is not enough memory for its JPEG-LS image")?;
        // A row with one more neighbour on each side.
        let mut above = vec![0; columns + 2];
        let mut row = vec![0; columns + 2];
        for _ in 0..rows {
            // The left neighbour of a row is the first sample of the row above; the right one repeats the last sample.
            above[columns + 1] = above[columns];
            row[0] = above[1];
            self.row(&above, &mut row)?;
            samples.extend(row[1..=columns].iter().map(|&sample| sample as u16));
            std::mem::swap(&mut above, &mut row);
        }
        Ok(samples)
    }

    fn row(&mut self, above: &[i32], row: &mut [i32]) -> Result<(), &'static str> {
        let columns = self.size[0];
        let mut at = 1;
        while at <= columns {
            let (left, up) = (row[at - 1], above[at]);
            let (up_left, up_right) = (above[at - 1], above[at + 1]);
            let gradients = [up_right - up, up - up_left, up_left - left];
            if gradients.iter().all(|step| step.abs() <= self.near) {
                at = self.run(above, row, at)?;
            } else {
                row[at] = self.regular(gradients, [left, up, up_left])?;
                at += 1;
            }
        }
        Ok(())
    }

    /// A sample in regular mode, because its neighbours differ (A.3 to A.6).
    fn regular(
        &mut self,
        gradients: [i32; 3],
        [left, up, up_left]: [i32; 3],
    ) -> Result<i32, &'static str> {
        let [first, second, third] = gradients.map(|gradient| self.quantise(gradient));
        let signed = 81 * first + 9 * second + third;
        let sign = if signed < 0 { -1 } else { 1 };
        let index = (sign * signed) as usize;
        let context = self.contexts[index];
        let predicted = if up_left >= left.max(up) {
            left.min(up)
        } else if up_left <= left.min(up) {
            left.max(up)
        } else {
            left + up - up_left
        };
        let predicted = (predicted + sign * context.c).clamp(0, self.max_value);
        let order = golomb_order(context.n, context.a);
        let mapped = self.golomb(order, self.limit)?;
        let flipped = self.near == 0 && order == 0 && 2 * context.b <= -context.n;
        let error = match (flipped, mapped % 2 == 1) {
            (true, true) => (mapped - 1) / 2,
            (true, false) => -(mapped / 2) - 1,
            (false, true) => -((mapped + 1) / 2),
            (false, false) => mapped / 2,
        };
        self.learn(index, error);
        Ok(self.reconstruct(predicted, sign * error))
    }

    fn quantise(&self, gradient: i32) -> i32 {
        let [t1, t2, t3] = self.thresholds;
        let size = gradient.abs();
        let level = if size <= self.near {
            0
        } else if size < t1 {
            1
        } else if size < t2 {
            2
        } else if size < t3 {
            3
        } else {
            4
        };
        level * gradient.signum()
    }

    /// A mapped error: a limited Golomb code (A.5.3).
    fn golomb(&mut self, order: u32, limit: u32) -> Result<i32, &'static str> {
        let escape = limit.saturating_sub(self.wide + 1);
        let zeros = self.bits.zeros(escape)?;
        let mapped = if zeros < escape {
            (i64::from(zeros) << order) + i64::from(self.bits.take(order)?)
        } else {
            i64::from(self.bits.take(self.wide)?) + 1
        };
        // Errors are reduced modulo the range, so none is greater.
        if mapped > 2 * i64::from(self.range) {
            return Err(DAMAGED);
        }
        Ok(mapped as i32)
    }

    /// Updates a context (A.6).
    fn learn(&mut self, index: usize, error: i32) {
        let context = &mut self.contexts[index];
        context.a = context.a.saturating_add(error.abs());
        context.b += error * (2 * self.near + 1);
        if context.n == self.reset {
            context.a >>= 1;
            context.b >>= 1;
            context.n >>= 1;
        }
        context.n += 1;
        if context.b <= -context.n {
            context.b = (context.b + context.n).max(1 - context.n);
            context.c = (context.c - 1).max(-128);
        } else if context.b > 0 {
            context.b = (context.b - context.n).min(0);
            context.c = (context.c + 1).min(127);
        }
    }

    /// The sample from a prediction and its error, which is in steps and modulo the range.
    fn reconstruct(&self, predicted: i32, error: i32) -> i32 {
        let step = 2 * self.near + 1;
        let span = self.range * step;
        let mut sample = predicted + error * step;
        if sample < -self.near {
            sample += span;
        } else if sample > self.max_value + self.near {
            sample -= span;
        }
        sample.clamp(0, self.max_value)
    }

    /// A run of one value, and the sample that ends it (A.7). Returns the position after it.
    fn run(
        &mut self,
        above: &[i32],
        row: &mut [i32],
        mut at: usize,
    ) -> Result<usize, &'static str> {
        let end = self.size[0] + 1;
        let value = row[at - 1];
        while self.bits.take(1)? == 1 {
            let length = 1usize << RUN_ORDERS[self.run_index];
            let filled = length.min(end - at);
            row[at..at + filled].fill(value);
            at += filled;
            if filled == length {
                self.run_index = (self.run_index + 1).min(31);
            }
            if at == end {
                return Ok(at);
            }
        }
        let length = self.bits.take(RUN_ORDERS[self.run_index])? as usize;
        if length >= end - at {
            return Err(DAMAGED);
        }
        row[at..at + length].fill(value);
        at += length;
        row[at] = self.run_end(value, above[at])?;
        self.run_index = self.run_index.saturating_sub(1);
        Ok(at + 1)
    }

    /// The sample that ends a run (A.7.2).
    fn run_end(&mut self, left: i32, up: i32) -> Result<i32, &'static str> {
        let same = (left - up).abs() <= self.near;
        let kind = usize::from(same);
        let context = self.run_contexts[kind];
        let weight = context.a + if same { context.n >> 1 } else { 0 };
        let order = golomb_order(context.n, weight);
        let limit = self.limit - RUN_ORDERS[self.run_index] - 1;
        let mapped = self.golomb(order, limit)?;
        let counted = mapped + kind as i32;
        let odd = counted % 2 == 1;
        let size = (counted + 1) / 2;
        let negative = (order != 0 || 2 * context.nn >= context.n) == odd;
        let error = if negative { -size } else { size };
        let context = &mut self.run_contexts[kind];
        context.nn += i32::from(error < 0);
        context.a = context.a.saturating_add((mapped + 1 - kind as i32) >> 1);
        if context.n == self.reset {
            context.a >>= 1;
            context.n >>= 1;
            context.nn >>= 1;
        }
        context.n += 1;
        let (predicted, sign) = match (same, left > up) {
            (true, _) => (left, 1),
            (false, true) => (up, -1),
            (false, false) => (up, 1),
        };
        Ok(self.reconstruct(predicted, sign * error))
    }
}

/// The smallest order with a step of at least the mean error (A.5.1).
fn golomb_order(n: i32, a: i32) -> u32 {
    let mut order = 0;
    while i64::from(n) << order < i64::from(a) {
        order += 1;
    }
    order
}

/// The default thresholds of the gradients (C.2.4.1.1.1), for those that the stream does not state.
fn thresholds(max_value: i32, near: i32, stated: [i32; 3]) -> [i32; 3] {
    let by_default = |low: i32, high: i32, weight: i32| {
        if max_value >= 128 {
            let factor = (max_value.min(4095) + 128) / 256;
            factor * (high - low) + low + weight * near
        } else {
            low.max(high / (256 / (max_value + 1)) + weight * near)
        }
    };
    let defaults = [
        by_default(2, 3, 3),
        by_default(3, 7, 5),
        by_default(4, 21, 7),
    ];
    let mut least = near + 1;
    [0, 1, 2].map(|place| {
        let value = match stated[place] {
            0 => defaults[place],
            stated => stated,
        };
        if (least..=max_value).contains(&value) {
            least = value;
        }
        least
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_are_those_of_the_standard() {
        // Table C.3 of T.87 for 8 bits, lossless; the formulas for 12 and 16 bits.
        assert_eq!(thresholds(255, 0, [0; 3]), [3, 7, 21]);
        assert_eq!(thresholds(4095, 0, [0; 3]), [18, 67, 276]);
        assert_eq!(thresholds(65535, 0, [0; 3]), [18, 67, 276]);
        assert_eq!(thresholds(255, 3, [0; 3]), [12, 22, 42]);
        assert_eq!(thresholds(255, 0, [9, 9, 30]), [9, 9, 30]);
    }

    /// The worked example of T.87, annex H.3.
    const EXAMPLE: [u8; 57] = [
        0xFF, 0xD8, 0xFF, 0xF7, 0x00, 0x0B, 0x08, 0x00, 0x04, 0x00, 0x04, 0x01, 0x01, 0x11, 0x00,
        0xFF, 0xDA, 0x00, 0x08, 0x01, 0x01, 0x00, 0x00, 0x00, 0x00, 0xC0, 0x00, 0x00, 0x6C, 0x80,
        0x20, 0x8E, 0x01, 0xC0, 0x00, 0x00, 0x57, 0x40, 0x00, 0x00, 0x6E, 0xE6, 0x00, 0x00, 0x01,
        0xBC, 0x18, 0x00, 0x00, 0x05, 0xD8, 0x00, 0x00, 0x91, 0x60, 0xFF, 0xD9,
    ];

    #[test]
    fn the_example_of_the_standard_is_decoded() {
        let samples = decode(&EXAMPLE, [4, 4]).unwrap();
        assert_eq!(
            samples,
            [
                0, 0, 90, 74, 68, 50, 43, 205, 64, 145, 145, 145, 100, 145, 145, 145
            ]
        );
    }

    #[test]
    fn whatever_is_cut_off_or_flipped_ends_in_an_answer() {
        let packed = EXAMPLE;
        for length in 0..packed.len() {
            let _ = decode(&packed[..length], [4, 4]);
        }
        for at in 0..packed.len() {
            for bit in 0..8 {
                let mut damaged = packed;
                damaged[at] ^= 1 << bit;
                let _ = decode(&damaged, [4, 4]);
            }
        }
    }
}
