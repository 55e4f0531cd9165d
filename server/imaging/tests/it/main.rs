//! The reader and the writers of NIfTI and the reader of DICOM, by files built by hand, damaged files, other readers and real heads.

mod bad_input;
mod builder;
mod characters;
mod dicom;
mod hostile;
mod masks;
mod mgh;
mod oracle;
mod pet;
mod placement;
mod real_heads;
mod real_series;
mod series_builder;
mod surfaces;
mod variations;
mod voxels;
mod writing;
