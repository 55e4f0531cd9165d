//! Checks that everything stored is present and intact.

use super::objects::Unreadable;
use super::{Cursor, ObjectName, REMOVALS_AT_ONCE, Store, StoreError};
use case::{Case, CaseId};

/// The number of cases to read at a time.
const CASES_AT_ONCE: usize = 100;

/// A problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Finding {
    /// An object of a case is missing.
    Missing(CaseId, ObjectName),
    /// An object of a case is damaged.
    Damaged(CaseId, ObjectName),
    /// An object that no case needs and no process is about to need.
    Unreferenced(ObjectName),
}

/// The numbers of checked cases and objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Inspected {
    /// Cases.
    pub cases: u64,
    /// Objects that cases need, each counted for each case.
    pub objects: u64,
    /// Bytes of their payloads, unpacked.
    pub bytes: u64,
}

impl Store {
    /// Reads every row and every object, and reports problems. It changes nothing, except that a case with damaged
    /// facts is queued again, as by any other reader.
    ///
    /// # Errors
    /// If the store cannot be reached, or the database itself is damaged.
    pub async fn inspect(
        &self,
        report: &mut (dyn FnMut(Finding) + Send),
    ) -> Result<Inspected, StoreError> {
        self.rows().inspect().await?;
        let mut inspected = Inspected::default();
        let mut after = None;
        while let Some(cases) = self.next_cases(&mut after).await? {
            for case in cases {
                self.inspect_case(&case.id, &mut inspected, report).await?;
            }
        }
        for some in self.objects().list().await?.chunks(REMOVALS_AT_ONCE) {
            let unneeded = self.rows().unneeded(some).await?;
            unneeded
                .into_iter()
                .map(Finding::Unreferenced)
                .for_each(&mut *report);
        }
        Ok(inspected)
    }

    /// The next cases of all; `None` at the end. Begin with the cursor `None`.
    pub(super) async fn next_cases(
        &self,
        walk: &mut Option<Option<Cursor>>,
    ) -> Result<Option<Vec<Case>>, StoreError> {
        let after = match walk {
            None => None,
            Some(Some(cursor)) => Some(cursor.clone()),
            Some(None) => return Ok(None),
        };
        let page = self.rows().cases(after.as_ref(), CASES_AT_ONCE).await?;
        *walk = Some(page.next);
        Ok(Some(page.cases))
    }

    async fn inspect_case(
        &self,
        id: &CaseId,
        inspected: &mut Inspected,
        report: &mut (dyn FnMut(Finding) + Send),
    ) -> Result<(), StoreError> {
        inspected.cases += 1;
        for name in self.rows().objects(id).await? {
            inspected.objects += 1;
            let finding = match self.objects().get(&name).await {
                Ok(payload) => {
                    inspected.bytes += payload.len() as u64;
                    continue;
                }
                Err(Unreadable::Missing) => Finding::Missing(*id, name),
                Err(Unreadable::Damaged(_)) => Finding::Damaged(*id, name),
                Err(Unreadable::Store(error)) => return Err(error),
            };
            // The case may have been deleted or rebuilt a moment ago.
            if self.rows().objects(id).await?.contains(&name) {
                report(finding);
            }
        }
        Ok(())
    }

    /// Removes unreferenced objects, after checking again that they are unreferenced.
    ///
    /// # Errors
    /// If the rows or the objects cannot be written.
    pub async fn remove_unreferenced(&self, names: &[ObjectName]) -> Result<(), StoreError> {
        for some in names.chunks(REMOVALS_AT_ONCE) {
            self.remove_unneeded(some).await?;
        }
        Ok(())
    }
}
