//! Folders in the Brain Imaging Data Structure (BIDS): the heads in one, and what is derived from each, in another.

mod derivatives;
mod folder;
mod head;
mod names;
mod places;
mod record;

pub use derivatives::{Derivatives, OutputError};
pub use folder::{Folder, FolderError, Found, HeadFiles, HeadName, Labels};
pub use head::{HeadError, NewHead, SurfaceFile, write_head};
pub use record::{HeadRecord, MadeWith};
