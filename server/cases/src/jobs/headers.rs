//! Doubts two cases that have the same voxels with other axes.

use case::{AXES_CORRECTED, CaseFacts, CaseId};
use storage::{Store, StoreError};

pub(super) const SENTENCE: &str = "another case has the same voxels with other axes, so that one of the two headers is wrong. The picture cannot tell \
                        left from right: ask whoever made the file which side is left, then delete both cases and upload the volume with the \
                        correct header";

/// How many cases with the same voxels are compared.
const MOST_COMPARED: usize = 100;

/// Whether a case contradicts a ready case with the same stored values in other places, or is a further version of a doubted one. One of the
/// headers exchanges or reverses axes, and a brain looks like its mirror image. The cases that it contradicts are put to review.
pub(super) async fn contradicts_header(
    store: &Store,
    id: &CaseId,
    facts: &CaseFacts,
) -> Result<bool, StoreError> {
    let Some(voxels) = &facts.voxels else {
        return Ok(false);
    };
    let same = store
        .cases_with_voxels(&voxels.values, MOST_COMPARED)
        .await?;
    let mut is_doubtful = false;
    for case in same.iter().filter(|case| case.id != *id) {
        let Some(other) = &case.facts else { continue };
        let is_doubted =
            (other.quality.as_ref()).is_some_and(|quality| quality.has_reason(AXES_CORRECTED));
        let lies_elsewhere =
            (other.voxels.as_ref()).is_some_and(|there| there.moments != voxels.moments);
        is_doubtful |= lies_elsewhere || is_doubted;
        if lies_elsewhere {
            store
                .put_to_review(&case.id, AXES_CORRECTED, SENTENCE)
                .await?;
        }
    }
    Ok(is_doubtful)
}
