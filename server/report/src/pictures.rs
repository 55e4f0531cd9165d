//! The pictures of a report, with what is drawn over them.

use case::{MapName, SurfaceName};
use render::SlicePlane;

/// What is judged lies free: so far from the place a tick begins, in mm; and its length, in pixels.
const FREE_MM: f64 = 5.0;
const TICK: f64 = 9.0;

/// The height of a letter in a picture, as a part of its side.
const LETTER_SIZE: f64 = 0.07;

/// The length of the bar of a picture with a mark, in mm, and its name.
const BAR_MM: f64 = 10.0;
pub(crate) const BAR: &str = "10 mm";

/// The depths of the overview, in mm.
pub const DEPTHS_MM: [f32; 4] = [6.0, 10.0, 15.0, 20.0];

/// A picture, with marks in its pixels.
#[derive(Debug, Clone)]
pub struct Shot {
    pub png: Vec<u8>,
    pub side: u32,
    pub pixels_per_mm: f64,
    /// The place, in pixels from the top left of the picture as it is shown.
    pub mark: Option<[f64; 2]>,
    /// The outline of what was marked, likewise.
    pub outline: Vec<[f64; 2]>,
    pub is_closed: bool,
    /// Whether it is shown flipped, left to right.
    pub is_flipped: bool,
    /// The patient's directions at the left, right, upper and lower edge of the picture as it is shown.
    pub directions: [String; 4],
    pub shows: Shows,
}

/// A line over a picture, in its pixels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PolyLine {
    pub(crate) points: Vec<[f64; 2]>,
    pub(crate) is_closed: bool,
}

impl Shot {
    /// What is drawn over it: a cross of short ticks that leaves the place free, and the outline of what was marked.
    pub(crate) fn lines(&self) -> Vec<PolyLine> {
        let free = FREE_MM * self.pixels_per_mm;
        let tick = |[x, y]: [f64; 2], [dx, dy]: [f64; 2]| PolyLine {
            points: [free, free + TICK]
                .map(|far| [x + dx * far, y + dy * far])
                .to_vec(),
            is_closed: false,
        };
        let directions = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
        let ticks = self.mark.map(|at| directions.map(|to| tick(at, to)));
        let outline = (!self.outline.is_empty()).then(|| PolyLine {
            points: self.outline.clone(),
            is_closed: self.is_closed,
        });
        ticks.into_iter().flatten().chain(outline).collect()
    }

    /// The ends of its bar, if it has a mark.
    pub(crate) fn bar(&self) -> Option<[[f64; 2]; 2]> {
        self.mark.map(|_| {
            let margin = self.letter_size() * 0.6;
            let y = f64::from(self.side) - margin;
            [[margin, y], [margin + BAR_MM * self.pixels_per_mm, y]]
        })
    }

    /// Where the name of its bar begins, and the height of the letters.
    pub(crate) fn bar_name(&self) -> Option<([f64; 2], f64)> {
        let size = self.letter_size();
        (self.bar()).map(|[[x, y], _]| ([x, y - 0.3 * size], 0.75 * size))
    }

    /// The height of a letter in it, in its pixels: letters are as large on paper in a small picture as in a large one.
    pub(crate) fn letter_size(&self) -> f64 {
        f64::from(self.side) * LETTER_SIZE
    }

    /// The middles of its letters, in the order of [`Shot::directions`].
    pub(crate) fn letter_places(&self) -> [[f64; 2]; 4] {
        let (size, end) = (self.letter_size(), f64::from(self.side));
        let middle = end / 2.0;
        // No letter is cut off at the edge.
        let aside = |letters: &str| size * (0.4 + 0.4 * letters.chars().count() as f64);
        let [left, right, ..] = &self.directions;
        [
            [aside(left), middle],
            [end - aside(right), middle],
            [middle, 0.75 * size],
            [middle, end - 0.75 * size],
        ]
    }
}

/// What a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shows {
    Anatomy,
    Layer,
    Map(MapName),
}

/// The pictures of a finding.
#[derive(Debug)]
pub struct FindingPictures {
    /// The surface of the cut: of a half if that is seen on its inner side.
    pub surface: SurfaceName,
    /// Below that surface.
    pub depth_mm: f32,
    /// The cut as it faces the viewer, each time the own side and then the other side, flipped.
    pub cuts: Vec<[Shot; 2]>,
    /// Slices through it and through the mirrored place, each time one plane: the standard ones, and the one across the sulcus.
    pub slices: Vec<[(Through, Vec<Shot>); 2]>,
}

/// The plane of a slice.
#[derive(Debug, Clone, PartialEq)]
pub enum Through {
    /// Across an axis of the patient, with its coordinate.
    Standard(SlicePlane, f64),
    /// Across the sulcus.
    Sulcus {
        angles: String,
        /// LPS mm.
        position: [f64; 3],
    },
}

/// The six views at each depth, as one row a depth.
#[derive(Debug)]
pub struct Overview {
    pub anatomy: Vec<Vec<Shot>>,
    /// Empty without maps.
    pub map: Vec<Vec<Shot>>,
}
