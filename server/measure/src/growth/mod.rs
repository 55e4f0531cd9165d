//! How every step grows with what it works on.

mod pixels;
mod threads;
mod triangles;
mod volumes;

use std::sync::Arc;

use render::FrameSize;

use crate::paper::Telling;
use crate::{Head, MeasureError, MeasuredCase, Painter, PowerLaw, Table, readable};

/// The largest of each kind that is looked at, and how often each is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// Voxels along a side of the largest volume.
    pub volume_side: usize,
    /// Triangles of the finest mesh.
    pub triangles: usize,
    /// Pixels along a side of the largest picture.
    pub picture_side: u32,
    /// How often each is measured; the least counts.
    pub repeat: usize,
}

impl Extent {
    /// 512³ voxels, 500,000 triangles and 2048² pixels.
    pub fn full() -> Self {
        Self {
            volume_side: 512,
            triangles: 500_000,
            picture_side: 2048,
            repeat: 3,
        }
    }
}

/// What is measured, and on what.
#[derive(Debug)]
pub struct Growth<'a> {
    /// The head.
    pub head: &'a Head,
    /// The head, prepared.
    pub case: &'a Arc<MeasuredCase>,
    /// Radius of its closing.
    pub closing_radius_mm: f64,
    /// Who draws.
    pub painters: &'a [Painter],
    /// How far it goes.
    pub extent: Extent,
    /// Depth of the pictures, in mm.
    pub depth_mm: f32,
    /// Is told what is measured next.
    pub tell: &'a dyn Telling,
}

impl Growth<'_> {
    /// By volume, by triangles, by pixels and by threads: each as a table with the exponents that fit.
    ///
    /// # Errors
    /// When something cannot be prepared or drawn.
    pub fn tables(&self) -> Result<Vec<Table>, MeasureError> {
        Ok(vec![
            triangles::table(self)?,
            pixels::table(self)?,
            threads::table(self)?,
            volumes::table(self)?,
        ])
    }

    fn frame(&self, side: u32) -> Result<FrameSize, MeasureError> {
        Ok(FrameSize::new(side, side)?)
    }
}

/// Adds a sentence with the fitted exponents of some columns, and names those that grow faster than in proportion.
///
/// Fixed costs make the exponent of small things small, so it is also given for the two largest alone.
pub fn note_exponents(table: &mut Table, size: &str, keys: &[&'static str]) {
    let mut laws = Vec::new();
    let mut steep = Vec::new();
    for &key in keys {
        let pairs = table.pairs(size, key);
        let last = pairs.len().saturating_sub(2);
        let Some(law) = PowerLaw::fit(&pairs) else {
            continue;
        };
        let end = PowerLaw::fit(&pairs[last..]).unwrap_or(law);
        let name = table
            .columns
            .iter()
            .find(|column| column.key == key)
            .map_or(key, |column| column.head);
        laws.push(format!(
            "{name} {} (at the end {})",
            readable(law.exponent),
            readable(end.exponent)
        ));
        if law.exponent.max(end.exponent) > STEEP {
            steep.push(name);
        }
    }
    table.note(format!("Grows as {size} to the: {}.", laws.join("; ")));
    if steep.is_empty() {
        table.note("Nothing here grows faster than in proportion.");
    } else {
        table.note(format!("FASTER than in proportion: {}.", steep.join(", ")));
    }
}

/// An exponent above this is more than noise and caches make of proportion.
const STEEP: f64 = 1.1;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Cell, column};

    fn table(exponent: f64) -> Table {
        let columns = [
            column("voxels", "voxels"),
            column("closing_ms", "closing, ms"),
        ];
        let mut table = Table::new("growth", "Growth", &columns);
        for voxels in [1000.0_f64, 8000.0, 64_000.0] {
            table.push([Cell::from(voxels), voxels.powf(exponent).into()]);
        }
        table
    }

    #[test]
    fn proportion_is_not_steep() {
        let mut table = table(1.0);
        note_exponents(&mut table, "voxels", &["closing_ms"]);
        assert!(table.notes[0].contains("closing, ms 1.00 (at the end 1.00)"));
        assert!(table.notes[1].starts_with("Nothing"));
    }

    #[test]
    fn what_is_steep_is_named() {
        let mut table = table(1.5);
        note_exponents(&mut table, "voxels", &["closing_ms"]);
        assert_eq!(table.notes[1], "FASTER than in proportion: closing, ms.");
    }
}
