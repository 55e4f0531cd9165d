//! Pictures of stored instances (PS3.18 §10.4.1.1.3): the results that we made, and images that are kept, as they are and
//! without a case.

use serde_json::Value;

use http_support::problem::AppError;

/// How the samples of a frame are stored (PS3.3 C.7.6.3), as far as pictures need it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pixels {
    width: u32,
    height: u32,
    samples: Samples,
    /// Centre and width, if the object states them.
    window: Option<[f64; 2]>,
    /// Slope and intercept, by which values of the window are made from samples.
    rescale: [f64; 2],
    is_inverted: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Samples {
    /// One bit each, the first pixel in the lowest bit.
    Bits,
    Unsigned8,
    Unsigned16,
    Signed16,
    /// Red, green and blue, a byte each, pixel by pixel.
    Rgb,
}

/// The first value of an attribute, as a number.
fn number(metadata: &Value, tag: &str) -> Option<f64> {
    match &metadata[tag]["Value"][0] {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => text.trim().parse().ok(),
        _ => None,
    }
}

impl Pixels {
    /// Reads them from the attributes of an instance; `None` if it has no pixels that a picture can be made of.
    pub(crate) fn read(metadata: &Value) -> Option<Self> {
        let whole = |tag| number(metadata, tag).map(|number| number as u32);
        let interpretation = metadata["00280004"]["Value"][0]
            .as_str()
            .unwrap_or_default();
        let is_signed = whole("00280103") == Some(1);
        let samples = match (whole("00280002")?, whole("00280100")?, is_signed) {
            (1, 1, _) => Samples::Bits,
            (1, 8, false) => Samples::Unsigned8,
            (1, 16, false) => Samples::Unsigned16,
            (1, 16, true) => Samples::Signed16,
            (3, 8, false) if interpretation == "RGB" => Samples::Rgb,
            _ => return None,
        };
        let window = number(metadata, "00281050").zip(number(metadata, "00281051"));
        let rescale = number(metadata, "00281053").zip(number(metadata, "00281052"));
        Some(Self {
            width: whole("00280011")?,
            height: whole("00280010")?,
            samples,
            window: window.map(|(centre, width)| [centre, width]),
            rescale: rescale.map_or([1.0, 0.0], |(slope, intercept)| [slope, intercept]),
            is_inverted: interpretation == "MONOCHROME1",
        })
    }

    /// A picture of a frame, made smaller until both sides are at most `most`.
    ///
    /// # Errors
    /// If the frame is too short, or the picture too large.
    pub(crate) fn picture(
        &self,
        frame: &[u8],
        most: Option<u32>,
    ) -> Result<render::Frame, AppError> {
        let unreadable =
            || AppError::not_found("no-such-frame", "the frame is damaged or cannot be drawn");
        let (width, height) = (self.width as usize, self.height as usize);
        let count = width.checked_mul(height).ok_or_else(unreadable)?;
        let channels = if self.samples == Samples::Rgb { 3 } else { 1 };
        let grey = match self.samples {
            Samples::Rgb => frame.get(..3 * count).ok_or_else(unreadable)?.to_vec(),
            _ => self.grey(&self.values(frame, count).ok_or_else(unreadable)?),
        };
        let longest = self.width.max(self.height).max(1);
        let smaller = most.filter(|&most| longest > most);
        let [to_width, to_height] = match smaller {
            None => [self.width, self.height],
            Some(most) => [self.width, self.height]
                .map(|side| (u64::from(side) * u64::from(most) / u64::from(longest)).max(1) as u32),
        };
        let bytes = match smaller {
            None => grey,
            Some(_) => averaged(
                &grey,
                [width, height],
                [to_width as usize, to_height as usize],
                channels,
            ),
        };
        let size = render::FrameSize::new(to_width, to_height).map_err(|_| unreadable())?;
        let format = match channels {
            3 => render::PixelFormat::Rgb8,
            _ => render::PixelFormat::Grey8,
        };
        Ok(render::Frame::new(size, format, bytes))
    }

    /// The samples as numbers.
    fn values(&self, frame: &[u8], count: usize) -> Option<Vec<f64>> {
        let pairs = |read: fn([u8; 2]) -> f64| {
            let pairs = frame.get(..2 * count)?.as_chunks::<2>().0;
            Some(pairs.iter().map(|&pair| read(pair)).collect())
        };
        match self.samples {
            Samples::Bits => {
                let bit = |at: usize| {
                    let byte = frame.get(at / 8)?;
                    Some(f64::from(byte >> (at % 8) & 1))
                };
                (0..count).map(bit).collect()
            }
            Samples::Unsigned8 => {
                let bytes = frame.get(..count)?;
                Some(bytes.iter().map(|&byte| byte.into()).collect())
            }
            Samples::Unsigned16 => pairs(|pair| u16::from_le_bytes(pair).into()),
            Samples::Signed16 => pairs(|pair| i16::from_le_bytes(pair).into()),
            Samples::Rgb => None,
        }
    }

    /// Brightness by the window of the object, or from the least value to the greatest.
    fn grey(&self, values: &[f64]) -> Vec<u8> {
        let [slope, intercept] = self.rescale;
        let rescaled = values.iter().map(|value| value * slope + intercept);
        let [least, greatest] = match self.window {
            // PS3.3 C.11.2.1.2.1
            Some([centre, width]) if width > 1.0 => [
                centre - 0.5 - (width - 1.0) / 2.0,
                centre - 0.5 + (width - 1.0) / 2.0,
            ],
            _ => rescaled
                .clone()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |range, value| {
                    [range[0].min(value), range[1].max(value)]
                }),
        };
        let span = (greatest - least).max(f64::MIN_POSITIVE);
        rescaled
            .map(|value| {
                let level = ((value - least) / span).clamp(0.0, 1.0);
                let level = if self.is_inverted { 1.0 - level } else { level };
                (level * 255.0).round() as u8
            })
            .collect()
    }
}

/// Each pixel of the smaller picture is the mean of those that it covers.
fn averaged(
    bytes: &[u8],
    [width, height]: [usize; 2],
    [to_width, to_height]: [usize; 2],
    channels: usize,
) -> Vec<u8> {
    let covered = |to: usize, side: usize, to_side: usize| {
        let from = to * side / to_side;
        from..((to + 1) * side / to_side).max(from + 1)
    };
    let mut smaller = Vec::with_capacity(to_width * to_height * channels);
    for y in 0..to_height {
        for x in 0..to_width {
            let (rows, columns) = (covered(y, height, to_height), covered(x, width, to_width));
            let count = (rows.len() * columns.len()) as u64;
            for channel in 0..channels {
                let sum: u64 = rows
                    .clone()
                    .flat_map(|row| columns.clone().map(move |column| row * width + column))
                    .map(|pixel| u64::from(bytes[pixel * channels + channel]))
                    .sum();
                smaller.push((sum / count) as u8);
            }
        }
    }
    smaller
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn metadata(samples: u32, bits: u32, interpretation: &str) -> Value {
        json!({
            "00280002": {"vr": "US", "Value": [samples]},
            "00280004": {"vr": "CS", "Value": [interpretation]},
            "00280010": {"vr": "US", "Value": [2]},
            "00280011": {"vr": "US", "Value": [4]},
            "00280100": {"vr": "US", "Value": [bits]},
            "00280103": {"vr": "US", "Value": [0]},
        })
    }

    #[test]
    fn colours_stay_as_they_are_and_bits_become_black_and_white() {
        let rgb: Vec<u8> = (0..24).collect();
        let pixels = Pixels::read(&metadata(3, 8, "RGB")).unwrap();
        assert_eq!(pixels.picture(&rgb, None).unwrap().bytes(), rgb);
        assert!(pixels.picture(&rgb[1..], None).is_err());
        let pixels = Pixels::read(&metadata(1, 1, "MONOCHROME2")).unwrap();
        let picture = pixels.picture(&[0b1000_0001], None).unwrap();
        assert_eq!(picture.bytes(), [255, 0, 0, 0, 0, 0, 0, 255]);
        assert_eq!(Pixels::read(&metadata(3, 8, "YBR_FULL_422")), None);
        assert_eq!(Pixels::read(&json!({})), None);
    }

    #[test]
    fn the_window_of_the_object_counts_and_otherwise_its_range() {
        let frame: Vec<u8> = [0_u16, 10, 20, 30, 40, 50, 60, 70]
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        let mut windowed = metadata(1, 16, "MONOCHROME2");
        let grey = Pixels::read(&windowed)
            .unwrap()
            .picture(&frame, None)
            .unwrap();
        assert_eq!((grey.bytes()[0], grey.bytes()[7]), (0, 255));
        windowed["00281050"] = json!({"vr": "DS", "Value": [20.5]});
        windowed["00281051"] = json!({"vr": "DS", "Value": [21]});
        let grey = Pixels::read(&windowed)
            .unwrap()
            .picture(&frame, None)
            .unwrap();
        assert_eq!(grey.bytes()[..4], [0, 0, 128, 255]);
        windowed["00280004"]["Value"][0] = "MONOCHROME1".into();
        let inverted = Pixels::read(&windowed)
            .unwrap()
            .picture(&frame, None)
            .unwrap();
        assert_eq!(inverted.bytes()[..2], [255, 255]);
    }

    #[test]
    fn a_thumbnail_is_a_mean() {
        let pixels = Pixels::read(&metadata(1, 8, "MONOCHROME2")).unwrap();
        let frame = [0, 0, 255, 255, 0, 0, 255, 255];
        let picture = pixels.picture(&frame, Some(2)).unwrap();
        assert_eq!((picture.size().width(), picture.size().height()), (2, 1));
        assert_eq!(picture.bytes(), [0, 255]);
    }
}
