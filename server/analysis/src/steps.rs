//! The steps of the maps, which experiments repeat with other parameters.

pub use crate::block::{Block, DEEP_FROM_MM, Zone, depth_at};
pub use crate::candidates::Scores;
pub use crate::convolve::{Kernel, smooth};
pub use crate::maps::{Comparison, Measures, compare, tissue_of};
pub use crate::normals::{
    CELL_MM, CELLS, CellMeasures, HeadCells, cell_at, cell_centre, head_cells,
};
pub use crate::regions::{phantom as regions_phantom, regions};
pub use crate::sharpness::Sharpness;
pub use crate::slant::slope;
