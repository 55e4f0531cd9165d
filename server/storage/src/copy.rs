//! From one store into another: a move between back ends, or a backup.

use super::objects::Unreadable;
use super::{ObjectName, Store, StoreError};
use case::{CaseId, CaseState};

/// What was copied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Copied {
    /// Cases that were new to the other store, or are as they are here now.
    pub cases: u64,
    /// Objects that were written.
    pub objects: u64,
    /// Bytes of them, as stored.
    pub bytes: u64,
    /// Objects that were there already, and whole.
    pub kept: u64,
    /// Cases that were left out, since an object that nothing can replace is missing or damaged here.
    pub lost: u64,
}

impl Store {
    /// Copies every case into another store; what is there already is read, and kept if it is whole. So a copy that was interrupted
    /// goes on where it was, and one that is made again brings what is new. What is in the other store alone stays there.
    ///
    /// A case that is still to be prepared is prepared there. Each object is checked against its digest when it is read here, and
    /// read back there. `report` is told of each case, with what was copied so far; of those that were left out, `false`.
    ///
    /// # Errors
    /// When a store cannot be reached.
    pub async fn copy_into(
        &self,
        other: &Self,
        report: &mut (dyn FnMut(&CaseId, bool, &Copied) + Send),
    ) -> Result<Copied, StoreError> {
        let mut ids = Vec::new();
        let mut walk = None;
        while let Some(cases) = self.next_cases(&mut walk).await? {
            ids.extend(cases.into_iter().map(|case| case.id));
        }
        let mut copied = Copied::default();
        // A case comes before its versions.
        for id in ids.iter().rev() {
            let is_whole = self.copy_case(other, id, &mut copied).await?;
            report(id, is_whole, &copied);
        }
        Ok(copied)
    }

    /// `false` where a source is lost.
    async fn copy_case(
        &self,
        other: &Self,
        id: &CaseId,
        copied: &mut Copied,
    ) -> Result<bool, StoreError> {
        let Some(case) = self.rows().case(id).await? else {
            // It was deleted meanwhile.
            return Ok(true);
        };
        let mut names = self.rows().objects(id).await?;
        if case.state != CaseState::Ready {
            names.retain(|name| name.kind.is_source());
        }
        let pinned = other.pin(names.iter().copied()).await?;
        for name in &names {
            let written = self.copy_object(other, name, copied).await?;
            // What is derived is made again at its first use.
            if !written && name.kind.is_source() {
                copied.lost += 1;
                other.abandon(&pinned).await;
                return Ok(false);
            }
        }
        if other.rows().adopt(&case, &pinned).await? {
            copied.cases += 1;
        }
        other.abandon(&pinned).await;
        Ok(true)
    }

    /// `false` where it is missing or damaged here.
    async fn copy_object(
        &self,
        other: &Self,
        name: &ObjectName,
        copied: &mut Copied,
    ) -> Result<bool, StoreError> {
        match other.objects().get(name).await {
            Ok(_) => {
                copied.kept += 1;
                return Ok(true);
            }
            Err(Unreadable::Store(error)) => return Err(error),
            Err(_) => {}
        }
        let framed = match self.objects().get_framed(name).await {
            Ok(framed) => framed,
            Err(Unreadable::Store(error)) => return Err(error),
            Err(_) => return Ok(false),
        };
        copied.objects += 1;
        copied.bytes += framed.len() as u64;
        other.objects().put_framed(name, framed).await?;
        match other.objects().get(name).await {
            Ok(_) => Ok(true),
            Err(Unreadable::Store(error)) => Err(error),
            Err(fault) => Err(StoreError::Objects(Box::new(fault))),
        }
    }
}
