//! The upkeep of a store: what a clock, a metric or an operator asks of it, and no client.

mod adopt;
mod copy;
mod expiry;
mod inspect;

use case::Case;

pub use self::adopt::{adopt, manifest, restore_manifests, spool_object, unreferenced_of};
pub use self::copy::{Copied, CopyStep, copy_into, copy_objects};
pub use self::expiry::{Expired, Waiting, received_waits, remove_expired};
#[cfg(any(test, feature = "testing"))]
pub(crate) use self::inspect::all_objects_of;
pub use self::inspect::{
    Amount, Defect, Inspected, Unreferenced, inspect, remove_unreferenced, unreferenced,
};
pub use crate::rows::RowCounts;
#[cfg(test)]
pub(crate) use crate::sql::expiry::{Aged, Allowance};
pub use crate::sql::expiry::{Removal, expired};
pub use crate::sql::pins::forget_writers;
pub use crate::sql::upkeep::row_counts;
use crate::{CaseQuery, Cursor, Store, StoreError};

/// The number of cases to read at a time.
const CASES_AT_ONCE: usize = 100;

/// The next cases of all; `None` at the end. Begin with the cursor `None`.
async fn next_cases(
    store: &Store,
    walk: &mut Option<Option<Cursor>>,
) -> Result<Option<Vec<Case>>, StoreError> {
    let after = match walk {
        None => None,
        Some(Some(cursor)) => Some(cursor.clone()),
        Some(None) => return Ok(None),
    };
    let page = store
        .cases(&CaseQuery::default(), after.as_ref(), CASES_AT_ONCE)
        .await?;
    *walk = Some(page.next);
    Ok(Some(
        page.cases.into_iter().map(|listed| listed.case).collect(),
    ))
}
