//! Lines and facets over each other, with hidden ones removed.

use geometry::MeshSize;
use glam::{DVec2, DVec3};
use render::{Frame, FrameSize, PixelFormat, Projection};

/// Samples along each side of a pixel; their mean smooths the lines.
const SAMPLES: usize = 3;
/// The width of a line, in samples.
const PEN: usize = 2;
/// How far a line may lie behind a facet and still be visible, in mm.
const BEHIND_MM: f64 = 1.5;
/// The level of a facet seen edge-on, and of one seen face-on.
const FACET: [f64; 2] = [20.0, 100.0];
/// The level of a line.
pub(super) const LINE: u8 = 255;

/// A picture to draw on, with the height of what was drawn at each sample.
pub(super) struct Drawing {
    projection: Projection,
    levels: Vec<u8>,
    heights_mm: Vec<f64>,
}

/// The edges of a mesh that are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Edges {
    /// Only those along the contours, and their points.
    Contours,
    /// All of them.
    All,
}

impl Drawing {
    /// A black picture.
    pub(super) fn new(projection: Projection) -> Self {
        let count = projection.size().pixel_count() * SAMPLES * SAMPLES;
        Self {
            projection,
            levels: vec![0; count],
            heights_mm: vec![f64::NEG_INFINITY; count],
        }
    }

    /// A grey picture to draw over; every line is visible.
    pub(super) fn over(projection: Projection, level_at: impl Fn(DVec3) -> u8) -> Self {
        let mut drawing = Self::new(projection);
        let patient_from_frame = projection.patient_from_frame();
        let width = drawing.width();
        for (index, level) in drawing.levels.iter_mut().enumerate() {
            let sample = DVec2::new((index % width) as f64, (index / width) as f64);
            let in_frame = (sample + 0.5) / SAMPLES as f64;
            *level = level_at(patient_from_frame.transform_point3(in_frame.extend(0.0)));
        }
        drawing
    }

    fn width(&self) -> usize {
        self.projection.size().width() as usize * SAMPLES
    }

    /// The samples of a position: x and y in samples, z in mm towards the viewer.
    fn sampled(&self, position_in_patient: DVec3) -> DVec3 {
        let frame = self.projection.frame_from_patient();
        let at = frame.transform_point3(position_in_patient);
        DVec3::new(at.x * SAMPLES as f64, at.y * SAMPLES as f64, at.z)
    }

    /// Draws a mesh: facets that face the viewer, then their edges, in front of what lies behind.
    pub(super) fn mesh(&mut self, size: MeshSize, positions_in_patient: &[DVec3], edges: Edges) {
        let towards_viewer = self.projection.towards_viewer_in_patient();
        let facing = |facet: &[u32; 3]| {
            let [a, b, c] = facet.map(|corner| positions_in_patient[corner as usize]);
            (b - a).cross(c - a).normalize_or_zero().dot(towards_viewer)
        };
        let facets = size.triangles();
        let in_front: Vec<&[u32; 3]> = facets.iter().filter(|facet| facing(facet) > 0.0).collect();
        let samples: Vec<DVec3> = positions_in_patient
            .iter()
            .map(|&position| self.sampled(position))
            .collect();
        for facet in &in_front {
            let [dark, bright] = FACET;
            let level = dark + (bright - dark) * facing(facet);
            self.fill(facet.map(|corner| samples[corner as usize]), level as u8);
        }
        let contour = |corner: u32| corner as usize / size.points_per_contour();
        for &&[a, b, c] in &in_front {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                if edges == Edges::All || contour(from) == contour(to) {
                    self.line([from, to].map(|end| samples[end as usize]), LINE);
                }
                if edges == Edges::Contours {
                    self.dot(samples[from as usize], 2 * PEN);
                }
            }
        }
    }

    /// Fills a facet where nothing is in front of it.
    fn fill(&mut self, [a, b, c]: [DVec3; 3], level: u8) {
        let area = (b - a).truncate().perp_dot((c - a).truncate());
        if area == 0.0 {
            return;
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let width = self.width();
        let height = self.levels.len() / width;
        let range = |low: f64, high: f64, end: usize| {
            (low - 0.5).ceil().max(0.0) as usize..((high + 0.5).floor().max(0.0) as usize).min(end)
        };
        for y in range(low.y, high.y, height) {
            for x in range(low.x, high.x, width) {
                let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - a.truncate();
                let u = at.perp_dot((c - a).truncate()) / area;
                let v = (b - a).truncate().perp_dot(at) / area;
                let z = a.z + u * (b.z - a.z) + v * (c.z - a.z);
                let index = y * width + x;
                if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && z > self.heights_mm[index] {
                    (self.levels[index], self.heights_mm[index]) = (level, z);
                }
            }
        }
    }

    /// A line between two sampled places.
    fn line(&mut self, [from, to]: [DVec3; 2], level: u8) {
        let across = (to - from).truncate().abs().max_element();
        let steps = across.ceil().max(1.0);
        for step in 0..=steps as usize {
            self.mark(from.lerp(to, step as f64 / steps), PEN, level);
        }
    }

    /// A line between two positions of the patient.
    pub(super) fn line_between(&mut self, ends_in_patient: [DVec3; 2], level: u8) {
        let ends = ends_in_patient.map(|end| self.sampled(end));
        self.line(ends, level);
    }

    fn dot(&mut self, at: DVec3, side: usize) {
        self.mark(at, side, LINE);
    }

    /// A square of `side` samples around a place, where nothing is in front of it.
    fn mark(&mut self, at: DVec3, side: usize, level: u8) {
        let width = self.width();
        let height = self.levels.len() / width;
        let corner = at.truncate() - side as f64 / 2.0 + 0.5;
        for y in 0..side {
            for x in 0..side {
                let (x, y) = (corner.x + x as f64, corner.y + y as f64);
                if x < 0.0 || y < 0.0 || x >= width as f64 || y >= height as f64 {
                    continue;
                }
                let index = y as usize * width + x as usize;
                if at.z + BEHIND_MM >= self.heights_mm[index] {
                    self.levels[index] = level;
                }
            }
        }
    }

    /// The picture: the mean of the samples of each pixel.
    pub(super) fn frame(&self) -> Frame {
        let size: FrameSize = self.projection.size();
        let width = self.width();
        let mean = |pixel: usize| {
            let [x, y] = [pixel % size.width() as usize, pixel / size.width() as usize];
            let first = y * SAMPLES * width + x * SAMPLES;
            let rows = (0..SAMPLES).map(|row| &self.levels[first + row * width..][..SAMPLES]);
            let sum: usize = rows.flatten().map(|&level| usize::from(level)).sum();
            (sum / (SAMPLES * SAMPLES)) as u8
        };
        let levels = (0..size.pixel_count()).map(mean).collect();
        Frame::new(size, PixelFormat::Grey8, levels)
    }
}
