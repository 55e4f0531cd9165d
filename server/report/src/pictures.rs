//! The pictures of a report, with what is drawn over them.

use case::MapName;
use render::{NamedView, SlicePlane};

/// Where a tick begins and ends, in pixels from the place.
const TICK: [f64; 2] = [7.0, 16.0];

/// The height of a letter in a picture, as a part of its side.
const LETTER_SIZE: f64 = 0.07;

/// The depths of the overview, in mm.
pub const DEPTHS_MM: [f32; 4] = [6.0, 10.0, 15.0, 20.0];

/// A picture, with marks in its pixels.
#[derive(Debug, Clone)]
pub struct Shot {
    pub png: Vec<u8>,
    pub side: u32,
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
        let tick = |[x, y]: [f64; 2], [dx, dy]: [f64; 2]| PolyLine {
            points: TICK.map(|far| [x + dx * far, y + dy * far]).to_vec(),
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

    /// The height of a letter in it, in its pixels: letters are as large on paper in a small picture as in a large one.
    pub(crate) fn letter_size(&self) -> f64 {
        f64::from(self.side) * LETTER_SIZE
    }

    /// The middles of its letters, in the order of [`Shot::directions`].
    pub(crate) fn letter_places(&self) -> [[f64; 2]; 4] {
        let end = f64::from(self.side);
        let (margin, middle) = (self.letter_size() * 0.75, end / 2.0);
        [
            [margin, middle],
            [end - margin, middle],
            [middle, margin],
            [middle, end - margin],
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
    pub view: NamedView,
    /// The cut, each time the own side and then the other side, flipped.
    pub cuts: Vec<[Shot; 2]>,
    /// Slices through it, each time one plane: the standard ones, and the one across the sulcus.
    pub slices: Vec<(Through, Vec<Shot>)>,
}

/// The plane of a slice.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Through {
    Standard(SlicePlane),
    /// Across the sulcus, with its angles.
    Sulcus(String),
}

/// The six views at each depth, as one row a depth.
#[derive(Debug)]
pub struct Overview {
    pub anatomy: Vec<Vec<Shot>>,
    /// Empty without maps.
    pub map: Vec<Vec<Shot>>,
}
