//! Objects: immutable files, named by their contents, in a directory or a bucket; and uploads in progress, which become
//! objects of a directory without another copy.

mod error;
mod frame;
mod link;
mod name;
mod private;
mod s3;
mod spool;
mod store;
#[cfg(test)]
mod tests;

pub(crate) use self::error::BUCKET;
pub use self::error::ObjectError;
pub use self::frame::{Framed, frame};
pub use self::name::ObjectName;
pub use self::private::{keep_private, open_to_others};
pub use self::spool::{Spool, Spooled};
pub(crate) use self::store::Objects;
pub use self::store::Unreadable;
