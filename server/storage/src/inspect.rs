//! Whether everything that is stored is there and as it was written.

use super::objects::Unreadable;
use super::{Cursor, ObjectName, REMOVALS_AT_ONCE, Store, StoreError};
use case::{Case, CaseId};

/// How many cases are asked for at a time.
const CASES_AT_ONCE: usize = 100;

/// Something that is not as it should be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Finding {
    /// A case needs an object that is not there.
    Missing(CaseId, ObjectName),
    /// A case needs an object whose bytes are not those that were written.
    Damaged(CaseId, ObjectName),
    /// An object that no case needs and nobody is about to need.
    Unreferenced(ObjectName),
}

/// What was looked at.
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
    /// Reads every row and every object, and reports what is not as it should be. Changes nothing, but that a case whose facts are
    /// damaged is queued again, as by any other reader.
    ///
    /// # Errors
    /// When the store cannot be reached, or the database itself is damaged.
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

    /// The next cases of a walk through all of them; `None` at its end. It begins at a cursor of `None`.
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
            // The case may have been deleted, or made again, a moment ago.
            if self.rows().objects(id).await?.contains(&name) {
                report(finding);
            }
        }
        Ok(())
    }

    /// Removes objects that nobody needs, after looking again that nobody does.
    ///
    /// # Errors
    /// When the rows or the objects cannot be written.
    pub async fn remove_unreferenced(&self, names: &[ObjectName]) -> Result<(), StoreError> {
        for some in names.chunks(REMOVALS_AT_ONCE) {
            self.remove_unneeded(some).await?;
        }
        Ok(())
    }
}
