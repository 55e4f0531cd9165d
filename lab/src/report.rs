//! All measurements of one run.

use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::{Machine, PreparedHead, Table};

/// The measured head.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HeadFacts {
    /// Its name.
    pub name: String,
    /// Number of voxels of the volume.
    pub volume_voxels: usize,
    /// Size of the working grid in voxels.
    pub working_size: [usize; 3],
    /// Edge of a voxel of the working grid, in mm.
    pub spacing_mm: f64,
    /// Number of voxels of the envelope.
    pub envelope_voxels: usize,
    /// Depth of the deepest voxel, in mm.
    pub max_depth_mm: f32,
    /// Radius of the closing, in mm.
    pub closing_radius_mm: f64,
}

impl HeadFacts {
    /// The facts about a prepared head.
    pub fn of(name: &str, case: &PreparedHead, closing_radius_mm: f64) -> Self {
        let grid = case.distance.grid();
        Self {
            name: name.to_owned(),
            volume_voxels: case.volume_voxels,
            working_size: grid.size(),
            spacing_mm: grid.spacing_mm()[0],
            envelope_voxels: case.inside_voxels(),
            max_depth_mm: case.distance.max_depth_mm(),
            closing_radius_mm,
        }
    }

    fn line(&self) -> String {
        let share = 100.0 * self.envelope_voxels as f64 / self.volume_voxels as f64;
        format!(
            "{}: {:.2} million voxels, {:.2} million ({share:.1} %) inside the envelope, closed by {} mm, {:.1} mm deep",
            self.name,
            self.volume_voxels as f64 / 1e6,
            self.envelope_voxels as f64 / 1e6,
            self.closing_radius_mm,
            self.max_depth_mm,
        )
    }
}

/// All measurements of one run, with their circumstances.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// The machine and the program.
    pub machine: Machine,
    /// The graphics device and its driver, or the reason why there is none.
    pub graphics: String,
    /// The head.
    pub head: HeadFacts,
    /// The measurements.
    pub tables: Vec<Table>,
}

impl Report {
    /// The report for a terminal.
    pub fn text(&self) -> String {
        let mut text = format!(
            "Machine:  {}\nGraphics: {}\nHead:     {}\n",
            self.machine.line(),
            self.graphics,
            self.head.line()
        );
        for table in &self.tables {
            text.push('\n');
            text.push_str(&table.text());
        }
        text
    }

    /// Machine, graphics, head, and the tables by name, as JSON.
    pub fn json(&self) -> Value {
        let tables = self.tables.iter();
        let tables: Map<String, Value> = tables
            .map(|table| (table.name.to_owned(), table.json()))
            .collect();
        json!({
            "format": "isocortex-bench 1",
            "machine": self.machine,
            "graphics": self.graphics,
            "head": self.head,
            "tables": tables,
        })
    }
}
