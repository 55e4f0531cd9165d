//! What a crate needs that has tables of its own in the database of the store: it answers what the store must know of them ([`Tables`]),
//! and its statements run in the transactions of the store ([`Store::write`](crate::Store::write)).

pub use crate::pinned::Writing;
pub use crate::rows::Referred;
pub use crate::sql::connection::{
    Column, Connection, Migrations, Row, Tables, Value, containing, microseconds, new_id,
    read_time, unreadable,
};
pub use crate::sql::jobs::read_state;
pub use crate::sql::made::{as_it_is_known, read_closed, read_fingerprint, read_uid};
pub use crate::sql::series::{read_accession_number, read_case, read_uids};

/// Statements about cases.
pub mod cases {
    pub use crate::sql::cases::{closed, with_voxels};
}

/// Statements about the series that cases were made of.
pub mod series {
    pub use crate::sql::series::{cases_of, index, of_case};
}

/// Statements about jobs.
pub mod jobs {
    pub use crate::sql::jobs::{
        became, cancel, enqueue, finish, latest, latest_of_key, one, page, remove, write_copied,
    };
}

/// Statements about the images that something was made of.
pub mod made {
    pub use crate::sql::made::{forget, make, of};
}

/// Statements about layers.
pub mod layers {
    pub use crate::sql::layers::{of_case, of_series};
}

/// Statements about the pins of objects, which a transaction turns into references, or leaves on what it no longer needs.
pub mod pins {
    pub use crate::sql::pins::{abandon, consume, hold};
}
