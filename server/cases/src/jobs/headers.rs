//! Doubts a case if another case has the same voxels with other axes.

use case::{CaseFacts, CaseId};
use storage::{Store, StoreError};

/// The code of the doubt.
const CODE: &str = "axes-corrected";

const SENTENCE: &str = "another case has the same voxels with other axes, so that one of the two headers is wrong. The picture cannot tell \
                        left from right: ask whoever made the file which side is left, then delete both cases and upload the volume with the \
                        correct header";

/// How many cases with the same voxels are compared.
const MOST_COMPARED: usize = 100;

/// Puts a case to review if another ready case has the same stored values in other places: one of the two headers exchanges or
/// reverses axes, and a brain looks like its mirror image. A further version of a doubted case is doubted too.
pub(super) async fn doubt_header(
    store: &Store,
    id: &CaseId,
    facts: &mut CaseFacts,
) -> Result<(), StoreError> {
    let (Some(voxels), Some(quality)) = (&facts.voxels, &mut facts.quality) else {
        return Ok(());
    };
    let same = store
        .cases_with_voxels((id.project(), &voxels.values), MOST_COMPARED)
        .await?;
    let is_doubted = |other: &CaseFacts| {
        let doubts = other.quality.as_ref().map(|quality| &quality.reason_codes);
        doubts.is_some_and(|codes| codes.iter().any(|code| code == CODE))
    };
    let others = same.iter().filter(|case| case.id != *id);
    let contradicts =
        others
            .filter_map(|case| case.facts.as_ref())
            .any(|other| match &other.voxels {
                Some(there) if there.moments == voxels.moments => is_doubted(other),
                there => there.is_some(),
            });
    if contradicts {
        quality.put_to_review(CODE, SENTENCE);
    }
    Ok(())
}
