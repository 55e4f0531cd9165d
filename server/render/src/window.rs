use crate::RenderError;
use crate::error::checked;

/// How a window maps intensities to brightness.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum WindowFunction {
    /// A ramp from black to white.
    #[default]
    Linear,
    /// A curve that approaches black and white.
    Sigmoid,
}

/// A display window: centre and width in units of intensity.
///
/// The function is DICOM PS3.3 C.11.2.1.2.1, `LINEAR`: intensities up to `centre − 0.5 − (width − 1)/2` are black,
/// intensities above `centre − 0.5 + (width − 1)/2` are white, and between them the brightness is linear. Intensities
/// and windows are real numbers here: the ramp is `width − 1` long, however small that is, and a step at width 1.
///
/// Or it is C.11.2.1.3.1, `SIGMOID`: the brightness is `1 / (1 + exp(−4 (x − centre) / width))`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    centre: f64,
    width: f64,
    function: WindowFunction,
}

/// A description of the accepted widths.
const WIDTHS: &str = "within 1 to 1e9: as DICOM has it (LINEAR), the ramp from black to white is width - 1 long, and its middle is \
                      centre - 0.5";

impl Window {
    /// A window of `centre` and `width`.
    ///
    /// # Errors
    /// If `centre` is not within ±1e9, or `width` not in 1..=1e9.
    pub fn new(centre: f64, width: f64) -> Result<Self, RenderError> {
        Ok(Self {
            centre: checked("window centre", centre, -1e9..=1e9, "within -1e9 to 1e9")?,
            width: checked("window width", width, 1.0..=1e9, WIDTHS)?,
            function: WindowFunction::Linear,
        })
    }

    /// The same with the function `SIGMOID`.
    ///
    /// # Errors
    /// If `centre` is not within ±1e9, or `width` not in 1e-9..=1e9.
    pub fn sigmoid(centre: f64, width: f64) -> Result<Self, RenderError> {
        Ok(Self {
            centre: checked("window centre", centre, -1e9..=1e9, "within -1e9 to 1e9")?,
            width: checked("window width", width, 1e-9..=1e9, "within 1e-9 to 1e9")?,
            function: WindowFunction::Sigmoid,
        })
    }

    /// The window whose ramp runs exactly from `black` to `white`.
    ///
    /// With the 2nd and 98th percentiles inside the envelope, this is the default window. Bounds that are equal,
    /// crossed or not finite give a step at the first of them.
    pub fn between(black: f32, white: f32) -> Self {
        let black = if black.is_finite() {
            f64::from(black)
        } else {
            0.0
        };
        let length = f64::from(white) - black;
        let length = if length.is_finite() {
            length.clamp(0.0, 1e9)
        } else {
            0.0
        };
        Self {
            centre: black + length / 2.0 + 0.5,
            width: length + 1.0,
            function: WindowFunction::Linear,
        }
    }

    /// The centre, in intensity.
    pub fn centre(self) -> f64 {
        self.centre
    }

    /// The width, in intensity.
    pub fn width(self) -> f64 {
        self.width
    }

    /// The function.
    pub fn function(self) -> WindowFunction {
        self.function
    }

    /// The intensities at which the ramp begins (black) and ends (white); of a sigmoid, its tangent at the centre.
    pub fn ramp(self) -> [f64; 2] {
        if self.function == WindowFunction::Sigmoid {
            let half = self.width / 2.0;
            return [self.centre - half, self.centre + half];
        }
        let middle = self.centre - 0.5;
        let half = (self.width - 1.0) / 2.0;
        [middle - half, middle + half]
    }

    /// Brightness of an intensity, 0 to 1.
    pub fn apply(self, intensity: f64) -> f64 {
        if self.function == WindowFunction::Sigmoid {
            let x = 4.0 * (intensity - self.centre) / self.width;
            return 1.0 / (1.0 + (-x).exp());
        }
        let [black, white] = self.ramp();
        if intensity <= black {
            0.0
        } else if intensity > white {
            1.0
        } else {
            ((intensity - (self.centre - 0.5)) / (self.width - 1.0) + 0.5).clamp(0.0, 1.0)
        }
    }

    /// The window for the stored values of a volume: what is done for every pixel.
    ///
    /// With a slope of 0, all values have the brightness of the intercept; a step is a very steep ramp that begins at
    /// the same place.
    pub(crate) fn line(self, rescale: geometry::Rescale) -> WindowLine {
        let [black, white] = self.ramp();
        let [slope, intercept] = [rescale.slope, rescale.intercept].map(f64::from);
        if slope == 0.0 {
            return WindowLine {
                black: 0.0,
                factor: 0.0,
                offset: (255.0 * self.apply(intercept)) as f32,
                is_sigmoid: false,
            };
        }
        if self.function == WindowFunction::Sigmoid {
            return WindowLine {
                black: ((self.centre - intercept) / slope) as f32,
                factor: (4.0 * slope / self.width) as f32,
                offset: 0.0,
                is_sigmoid: true,
            };
        }
        WindowLine {
            black: ((black - intercept) / slope) as f32,
            factor: (255.0 * slope / (white - black).max(1e-9 * slope.abs())) as f32,
            offset: 0.0,
            is_sigmoid: false,
        }
    }
}

/// [`Window`] prepared for 16-bit volumes: `x = (stored − black) · factor + offset`, clamped, is the brightness, 0 to 255,
/// or, for a sigmoid, `255 / (1 + exp(−x))`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WindowLine {
    pub(crate) black: f32,
    pub(crate) factor: f32,
    pub(crate) offset: f32,
    pub(crate) is_sigmoid: bool,
}

impl WindowLine {
    /// Brightness, 0.0 to 255.0, of a stored value.
    #[inline]
    pub(crate) fn brightness(self, stored: f32) -> f32 {
        let x = (stored - self.black) * self.factor + self.offset;
        match self.is_sigmoid {
            false => x.clamp(0.0, 255.0),
            true => 255.0 / (1.0 + exp(-x)),
        }
    }
}

/// The exponential function within ±40, and its values there beyond.
///
/// It consists of additions and multiplications alone, because that of a system may differ in the last bit, and a
/// picture is the same on every machine.
#[inline]
fn exp(x: f32) -> f32 {
    let x = x.clamp(-40.0, 40.0);
    let power = (x * std::f32::consts::LOG2_E).round();
    let rest = x - power * std::f32::consts::LN_2;
    let series = (1..=7)
        .rev()
        .fold(1.0, |series, number| 1.0 + series * rest / number as f32);
    series * f32::from_bits(((power as i32 + 127) as u32) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pseudo code of DICOM PS3.3 C.11.2.1.2.1 with an output of 0 to 1.
    fn standard(x: f64, c: f64, w: f64) -> f64 {
        if x <= c - 0.5 - (w - 1.0) / 2.0 {
            0.0
        } else if x > c - 0.5 + (w - 1.0) / 2.0 {
            1.0
        } else {
            (x - (c - 0.5)) / (w - 1.0) + 0.5
        }
    }

    #[test]
    fn intensities_are_shown_as_the_standard_says() {
        for (centre, width) in [
            (2048.0, 4096.0),
            (2048.0, 1.0),
            (0.0, 100.0),
            (0.0, 1.0),
            (50.5, 2.0),
        ] {
            let window = Window::new(centre, width).unwrap();
            for step in -5000..5000 {
                let x = f64::from(step);
                assert_eq!(
                    window.apply(x),
                    standard(x, centre, width),
                    "{x} in {window:?}"
                );
            }
        }
    }

    #[test]
    fn the_default_window_runs_from_the_lower_to_the_upper_percentile() {
        for (black, white) in [(20.0, 220.0), (0.125, 0.25), (-3.0, 4.0)] {
            let window = Window::between(black, white);
            assert_eq!(window.ramp(), [f64::from(black), f64::from(white)]);
            assert_eq!(window.width(), f64::from(white - black) + 1.0);
            assert_eq!(window.centre(), f64::from(white + black) / 2.0 + 0.5);
        }
    }

    #[test]
    fn a_constant_volume_gets_a_step() {
        let window = Window::between(7.0, 7.0);
        assert_eq!((window.apply(7.0), window.apply(7.1)), (0.0, 1.0));
        assert_eq!(Window::between(f32::NAN, 1.0), Window::between(0.0, 1.0));
    }

    #[test]
    fn stored_values_are_shown_as_their_intensities() {
        let window = Window::new(300.0, 401.0).unwrap();
        let sigmoid = Window::sigmoid(300.0, 401.0).unwrap();
        let rescales = [
            (1.0, 0.0),
            (0.25, -100.0),
            (-2.0, 4000.0),
            (3.5, 10.0),
            (0.0, 250.0),
        ];
        let all = rescales.map(|rescale| [(window, rescale), (sigmoid, rescale)]);
        for (window, (slope, intercept)) in all.into_iter().flatten() {
            let rescale = geometry::Rescale { slope, intercept };
            let line = window.line(rescale);
            for stored in (0..=65535_u16).step_by(7) {
                let intensity = f64::from(slope) * f64::from(stored) + f64::from(intercept);
                let expected = 255.0 * window.apply(intensity);
                let found = f64::from(line.brightness(f32::from(stored)));
                assert!(
                    (found - expected).abs() < 0.01,
                    "{stored}: {found} for {expected}"
                );
            }
        }
    }

    #[test]
    fn a_sigmoid_is_that_of_the_standard() {
        // PS3.3 C.11.2.1.3.1 with an output of 0 to 1.
        let standard = |x: f64, c: f64, w: f64| 1.0 / (1.0 + (-4.0 * (x - c) / w).exp());
        for (centre, width) in [(300.0, 400.0), (0.5, 0.25), (-1000.0, 1.0)] {
            let window = Window::sigmoid(centre, width).unwrap();
            assert_eq!(window.apply(centre), 0.5);
            for step in -200..=200 {
                let x = centre + f64::from(step) / 50.0 * width;
                let expected = standard(x, centre, width);
                assert_eq!(window.apply(x), expected);
                let rescale = geometry::Rescale {
                    slope: 1.0,
                    intercept: 0.0,
                };
                let x = f64::from(x as f32);
                let found = f64::from(window.line(rescale).brightness(x as f32));
                let expected = 255.0 * standard(x, centre, width);
                let error = (found - expected).abs();
                assert!(error < 0.01, "{x}: {found} for {expected}");
            }
        }
        assert!(Window::sigmoid(0.0, 0.0).is_err());
    }

    #[test]
    fn the_exponential_function_is_exact_to_a_millionth() {
        for step in -4000..=4000_i16 {
            let x = f32::from(step) / 100.0;
            let expected = f64::from(x).exp();
            let error = (f64::from(exp(x)) / expected - 1.0).abs();
            assert!(error < 4e-6, "{x}: {error}");
        }
        for x in [f32::MAX, f32::INFINITY, -f32::INFINITY] {
            assert!(exp(x).is_finite());
        }
    }

    #[test]
    fn impossible_windows_are_refused() {
        for (centre, width) in [
            (0.0, 0.5),
            (0.0, 0.0),
            (f64::NAN, 10.0),
            (0.0, f64::INFINITY),
        ] {
            assert!(Window::new(centre, width).is_err());
        }
    }
}
