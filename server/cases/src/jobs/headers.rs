//! Doubts two cases that have the same voxels with other axes.

use case::{CaseFacts, CaseId};
use storage::tables::cases;
use storage::{Store, StoreError};

/// How many cases with the same voxels are compared.
const MOST_COMPARED: usize = 100;

/// Whether a case contradicts a ready case with the same voxels. One of the headers exchanges or reverses axes, and a brain looks
/// like its mirror image. The cases that it contradicts are put to review; if one is deleted, the store withdraws the doubt about the
/// other.
pub(super) async fn contradicts_header(
    store: &Store,
    id: &CaseId,
    facts: &CaseFacts,
) -> Result<bool, StoreError> {
    let Some(voxels) = &facts.voxels else {
        return Ok(false);
    };
    let mut connection = store.connect().await?;
    let same = cases::with_voxels(&mut connection, &voxels.values, MOST_COMPARED).await?;
    drop(connection);
    let mut is_doubtful = false;
    for case in same.iter().filter(|case| case.id != *id) {
        let other = case.facts.as_ref().and_then(|facts| facts.voxels.as_ref());
        if other.is_some_and(|other| voxels.has_other_axes(other)) {
            is_doubtful = true;
            store.doubt_axes(&case.id).await?;
        }
    }
    Ok(is_doubtful)
}
