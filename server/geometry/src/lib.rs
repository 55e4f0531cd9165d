#![doc = include_str!("../README.md")]
#![warn(missing_docs)]

mod beyond_cuts;
mod border_field;
mod bounding_sphere;
mod build;
mod contour;
mod core_voxels;
mod cut;
mod deepest_first;
mod depth_field;
mod distance_map;
mod envelope;
mod envelope_mesh;
mod error;
mod fenced;
mod flood;
mod forest;
mod grid;
mod inner_cuts;
mod mask;
mod measures;
mod model;
mod morphology;
mod nearest_core;
mod offset;
mod outline;
mod paths;
pub mod phantom;
mod runs;
mod segment;
mod shell;
mod solid;
mod transform;
mod volume;
mod walk;

pub use border_field::BorderField;
pub use bounding_sphere::BoundingSphere;
pub use build::{BuildStep, BuiltModel, ClosedBrain};
pub use core_voxels::{Core, core};
pub use cut::{BrainCuts, Cut};
pub use depth_field::DepthField;
pub use distance_map::{DistanceMap, distance_map};
pub use envelope::{Envelope, check_closing, cut_envelope, envelope};
pub use envelope_mesh::{
    ContourPlanes, EnvelopeMesh, MeshSize, envelope_mesh, envelope_mesh_across,
};
pub use error::GeometryError;
pub use fenced::Fenced;
pub use flood::{face_neighbours, flood};
pub use forest::{Forest, forest};
pub use grid::{AXIS_ORDERS, Grid, MAX_VOXELS, MAX_WORKING_SIZE, block_of};
pub use mask::{BrainMask, Mask};
pub use measures::Face;
pub use model::{DeformableModel, DepthMaps};
pub use offset::offset;
pub use outline::{flat_area_of, length_of};
pub use paths::{PathTable, Piece, ShrunkMesh, path_table, shrink_once};
pub use shell::{ShellIndex, ShellVoxel};
pub use solid::{Solid, solid};
pub use volume::{Rescale, Volume};
pub use walk::Paths;
