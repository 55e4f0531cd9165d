//! Display windows.

use crate::RenderError;
use crate::error::checked;

/// A display window: centre and width in units of intensity.
///
/// The function is DICOM PS3.3 C.11.2.1.2.1, `LINEAR`: intensities up to `centre − 0.5 − (width − 1)/2` are black,
/// intensities above `centre − 0.5 + (width − 1)/2` are white, and between them the brightness is linear. Intensities
/// and windows are real numbers here: the ramp is `width − 1` long, however small that is, and a step at width 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    centre: f64,
    width: f64,
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

    /// The intensities at which the ramp begins (black) and ends (white).
    pub fn ramp(self) -> [f64; 2] {
        let middle = self.centre - 0.5;
        let half = (self.width - 1.0) / 2.0;
        [middle - half, middle + half]
    }

    /// Brightness of an intensity, 0 to 1.
    pub fn apply(self, intensity: f64) -> f64 {
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
            };
        }
        WindowLine {
            black: ((black - intercept) / slope) as f32,
            factor: (255.0 * slope / (white - black).max(1e-9 * slope.abs())) as f32,
            offset: 0.0,
        }
    }
}

/// [`Window`] prepared for 16-bit volumes: `(stored − black) · factor + offset`, clamped, is the brightness, 0 to 255.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WindowLine {
    pub(crate) black: f32,
    pub(crate) factor: f32,
    pub(crate) offset: f32,
}

impl WindowLine {
    /// Brightness, 0.0 to 255.0, of a stored value.
    #[inline]
    pub(crate) fn brightness(self, stored: f32) -> f32 {
        ((stored - self.black) * self.factor + self.offset).clamp(0.0, 255.0)
    }
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
        for (slope, intercept) in [
            (1.0, 0.0),
            (0.25, -100.0),
            (-2.0, 4000.0),
            (3.5, 10.0),
            (0.0, 250.0),
        ] {
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
