//! The reader and the writers of NIfTI, by files built by hand, damaged files, another reader and real heads.

mod bad_input;
mod builder;
mod hostile;
mod masks;
mod oracle;
mod placement;
mod real_heads;
mod voxels;
mod writing;
