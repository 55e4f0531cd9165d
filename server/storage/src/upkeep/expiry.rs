//! The removal of cases, and of what a PACS has sent, because of their age, and what it waits for if a clock is wrong.
//!
//! A clock that is 400 days ahead makes all of them too old at once. So a process removes nothing by itself in its first hour;
//! nobody does after the time has jumped past the last one that the rows have seen, until a person says that it is right; and in a
//! day, not many more cases go than came on one.

use std::time::Duration;

use case::CaseId;

use crate::sql::expiry::{Aged, Allowance, Removal, expired as too_old};
use crate::{REMOVALS_AT_ONCE, Store, StoreError};

/// How long a process removes nothing by itself.
const FIRST_HOUR: Duration = Duration::from_secs(3600);

/// Why cases, or series of a PACS, that are too old stay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waiting {
    /// The process has not run for an hour.
    FirstHour,
    /// The clock has jumped, or nobody has noted the time for as long.
    Clock,
    /// As many as may go in a day have gone.
    Day,
}

impl Waiting {
    /// The reason, as a sentence.
    pub fn sentence(self) -> &'static str {
        match self {
            Self::FirstHour => "a process removes nothing in its first hour",
            Self::Clock => {
                "the clock of the database has jumped, or no server or worker ran for some days; correct the clock, or, if it is right, run `isocortex remove-expired --yes` once"
            }
            Self::Day => {
                "as many cases as may go in a day have gone; `isocortex remove-expired --yes` removes all"
            }
        }
    }
}

/// What became of the cases that are too old.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Expired {
    pub removed: usize,
    /// Why others stay.
    pub waiting: Option<Waiting>,
}

/// Removes the cases whose age is [`Options::keep`](crate::Options::keep) or more, as [`Store::delete`] does, as far as they need not wait. A case that
/// is kept or uploaded again meanwhile stays, and so does one for which `may_go` resolves to `false`.
///
/// # Errors
/// If the rows or the objects cannot be written; what was not removed is found the next time.
pub async fn remove_expired<MayGo>(
    store: &Store,
    removal: Removal,
    may_go: impl Fn(CaseId) -> MayGo + Send + Sync,
) -> Result<Expired, StoreError>
where
    MayGo: Future<Output = bool> + Send,
{
    let keep = store.options().keep;
    // The time is noted by those who remove nothing, too.
    let age = keep.unwrap_or_default();
    let (allowance, waiting) = allowed(store, Aged::Cases, age, removal).await?;
    let Some(keep) = keep else {
        return Ok(Expired::default());
    };
    let mut expired = Expired::default();
    if waiting.is_some() {
        let is_any = !too_old(store, keep, 1).await?.is_empty();
        expired.waiting = waiting.filter(|_| is_any);
        return Ok(expired);
    }
    loop {
        let old = too_old(store, keep, REMOVALS_AT_ONCE).await?;
        let removed_before = expired.removed;
        for id in &old {
            // Before anybody notes that the case goes.
            if !store.has_room_today(allowance).await? {
                expired.waiting = Some(Waiting::Day);
                break;
            }
            if !may_go(*id).await {
                continue;
            }
            match store.delete_expired(id, keep, allowance).await? {
                Some(true) => {
                    store.inner.is_deleted(id);
                    expired.removed += 1;
                }
                Some(false) => {}
                None => {
                    expired.waiting = Some(Waiting::Day);
                    break;
                }
            }
        }
        if expired.removed > removed_before {
            store.collect().await?;
        }
        let is_end = old.len() < REMOVALS_AT_ONCE || expired.removed == removed_before;
        if is_end || expired.waiting.is_some() {
            return Ok(expired);
        }
    }
}

/// Why nothing that a PACS has sent may go now because it is older than `keep`, by the rules for cases, but for the limit of a day; `None` if
/// it may.
///
/// # Errors
/// If the rows or the objects cannot be reached.
pub async fn received_waits(
    store: &Store,
    keep: Duration,
    removal: Removal,
) -> Result<Option<Waiting>, StoreError> {
    let (_, waiting) = allowed(store, Aged::Received, keep, removal).await?;
    Ok(waiting)
}

/// How many may go, and why none may. The time is noted in the first hour, too.
async fn allowed(
    store: &Store,
    what: Aged,
    keep: Duration,
    removal: Removal,
) -> Result<(Allowance, Option<Waiting>), StoreError> {
    store.id().await?;
    let allowance = store.allow_removals(what, keep, removal).await?;
    let is_first_hour = removal == Removal::Automatic && store.uptime() < FIRST_HOUR;
    let waiting = match allowance {
        Allowance::None => Some(Waiting::Clock),
        _ => is_first_hour.then_some(Waiting::FirstHour),
    };
    Ok((allowance, waiting))
}
