//! What the removal of old cases, and of what a PACS has sent, knows of the clock, and how many cases went on which day.

use std::time::Duration;

use case::CaseId;

use super::connection::{Connection, Row, microseconds, unreadable};
use super::series::read_case;
use crate::args;
use crate::{Store, StoreError};

/// Microseconds of a day.
const DAY: i64 = 86_400_000_000;

/// The longest jump of the time that is believed, if what goes is kept for less than twice as long.
const LEAST_JUMP: Duration = Duration::from_secs(7 * 86_400);

/// How many cases may go in a day, however few came on any.
const LEAST_A_DAY: u64 = 10;

/// What goes because of its age. Cases and what a PACS has sent are kept for different times, so each has a last time of its own that was
/// believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Aged {
    Cases,
    /// What a PACS has sent.
    Received,
}

/// Who asks for the removal of what is too old.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Removal {
    /// A server or a worker, by itself.
    Automatic,
    /// A person.
    Asked,
    /// A person who says that the clock is right, and that all of it may go.
    Confirmed,
}

/// How many cases may go, or whether what a PACS has sent may.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Allowance {
    /// So many on this day, by whatever process.
    ADay(u64),
    All,
    /// None, because the clock has jumped.
    None,
}

impl Allowance {
    /// That of a day, if this is the most that came on one.
    pub(crate) fn of_busiest_day(cases: i64) -> Self {
        let cases = u64::try_from(cases).unwrap_or(0);
        Self::ADay(cases.saturating_mul(2).max(LEAST_A_DAY))
    }

    /// Whether so many may go in a day.
    pub(crate) fn covers(self, cases: i64) -> bool {
        match self {
            Self::All => true,
            Self::ADay(most) => u64::try_from(cases).is_ok_and(|cases| cases <= most),
            Self::None => false,
        }
    }
}

/// The longest jump of the time that is believed.
pub(crate) fn believed_jump(keep: Duration) -> Duration {
    LEAST_JUMP.max(keep / 2)
}

impl Store {
    /// How many may go, and notes the time as seen, unless it has jumped and nobody says that it is right.
    pub(crate) async fn allow_removals(
        &self,
        what: Aged,
        keep: Duration,
        removal: Removal,
    ) -> Result<Allowance, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let seen = last_time(&mut transaction, what).await?.unwrap_or(now);
        let has_jumped = now.saturating_sub(seen) > microseconds(believed_jump(keep));
        let allowance = match removal {
            Removal::Confirmed => Allowance::All,
            _ if has_jumped => Allowance::None,
            _ if what == Aged::Received => Allowance::All,
            _ => Allowance::of_busiest_day(busiest_day(&mut transaction).await?),
        };
        // That of the latest row is noted, too: a clock that is wrong may write a later one.
        let believed = match allowance {
            Allowance::None => seen,
            _ => now,
        };
        let note = match (removal, what) {
            // It is said of the clock.
            (Removal::Confirmed, _) => "UPDATE expiry SET seen_at = $1, received_seen_at = $1",
            (_, Aged::Cases) => "UPDATE expiry SET seen_at = $1",
            (_, Aged::Received) => "UPDATE expiry SET received_seen_at = $1",
        };
        transaction.execute(note, args![believed]).await?;
        transaction.commit().await?;
        Ok(allowance)
    }

    /// Whether one more case may go on this day.
    pub(crate) async fn has_room_today(&self, allowance: Allowance) -> Result<bool, StoreError> {
        let mut connection = self.connect().await?;
        let today = connection.now().await? / DAY;
        let row = connection
            .fetch_one(
                "SELECT CASE WHEN day = $1 THEN removed ELSE 0 END AS gone FROM expiry",
                args![today],
            )
            .await?;
        Ok(allowance.covers(row.get::<i64>("gone")? + 1))
    }

    /// As [`Store::delete_rows`], if the case is still [`expired`]; returns whether it was. `None`, and nothing has changed,
    /// if as many have gone on this day as may.
    pub(crate) async fn delete_expired(
        &self,
        id: &CaseId,
        age: Duration,
        allowance: Allowance,
    ) -> Result<Option<bool>, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let before = now.saturating_sub(microseconds(age));
        if !is_expired(&mut transaction, id, before).await? {
            return Ok(Some(false));
        }
        let gone = count_removal(&mut transaction, now / DAY).await?;
        if !allowance.covers(gone) {
            return Ok(None);
        }
        self.delete_in(transaction, id.into(), now).await.map(Some)
    }
}

/// What [`expired`] finds. Further conditions may follow.
macro_rules! from_expired {
    ($rest:literal) => {
        concat!(
            "FROM cases WHERE created_at <= $1 AND COALESCE(uploaded_at, created_at) <= $1
             AND NOT kept AND state IN ('ready', 'failed') ",
            $rest
        )
    };
}

/// At most `limit` cases that are ready or failed, not kept, and were last uploaded at least `age` ago; oldest first.
///
/// # Errors
/// If the rows cannot be read.
pub async fn expired(
    store: &Store,
    age: Duration,
    limit: usize,
) -> Result<Vec<CaseId>, StoreError> {
    let mut connection = store.connect().await?;
    let before = connection.now().await?.saturating_sub(microseconds(age));
    let rows = connection
        .fetch_all(
            concat!(
                "SELECT id ",
                from_expired!("ORDER BY created_at, id LIMIT $2")
            ),
            args![before, i64::try_from(limit).unwrap_or(i64::MAX)],
        )
        .await?;
    let read = |row: &Row| read_case(row, "id")?.ok_or_else(|| unreadable("a case"));
    rows.iter().map(read).collect()
}

/// How many there are of [`expired`].
pub(super) async fn count_expired(
    connection: &mut Connection,
    before: i64,
) -> Result<u64, StoreError> {
    let sql = concat!("SELECT count(*) AS count ", from_expired!(""));
    let row = connection.fetch_one(sql, args![before]).await?;
    Ok(row.get::<i64>("count")?.unsigned_abs())
}

/// Whether a case is one of [`expired`].
async fn is_expired(
    connection: &mut Connection,
    id: &CaseId,
    before: i64,
) -> Result<bool, StoreError> {
    let sql = concat!(
        "SELECT EXISTS (SELECT 1 ",
        from_expired!("AND id = $2"),
        ") AS expired"
    );
    let row = connection
        .fetch_one(sql, args![before, id.to_string()])
        .await?;
    row.get("expired")
}

/// The last time that was believed; before the first one, that of the latest row.
async fn last_time(connection: &mut Connection, what: Aged) -> Result<Option<i64>, StoreError> {
    let sql = match what {
        Aged::Cases => "SELECT seen_at FROM expiry",
        Aged::Received => "SELECT received_seen_at AS seen_at FROM expiry",
    };
    let row = connection.fetch_one(sql, args![]).await?;
    match row.get("seen_at")? {
        Some(seen) => Ok(Some(seen)),
        None => newest_row(connection).await,
    }
}

/// The most cases of one day among those that are there.
async fn busiest_day(connection: &mut Connection) -> Result<i64, StoreError> {
    let row = connection
        .fetch_one(
            "SELECT COALESCE(max(cases), 0) AS busiest FROM
               (SELECT count(*) AS cases FROM cases GROUP BY COALESCE(uploaded_at, created_at) / $1) AS days",
            args![DAY],
        )
        .await?;
    row.get("busiest")
}

/// Counts a case that goes on a day; how many have gone then, with it.
async fn count_removal(connection: &mut Connection, day: i64) -> Result<i64, StoreError> {
    let row = connection
        .fetch_one(
            "UPDATE expiry SET removed = CASE WHEN day = $1 THEN removed + 1 ELSE 1 END, day = $1 RETURNING removed",
            args![day],
        )
        .await?;
    row.get("removed")
}

/// When the latest case, layer, finding or reading was written; `None` if there is none.
pub(crate) async fn newest_row(connection: &mut Connection) -> Result<Option<i64>, StoreError> {
    let row = connection
        .fetch_one(
            "SELECT max(at) AS newest FROM
               (SELECT max(COALESCE(uploaded_at, created_at)) AS at FROM cases
                UNION ALL SELECT max(created_at) FROM layers
                UNION ALL SELECT max(changed_at) FROM findings
                UNION ALL SELECT max(coalesce(signed_at, changed_at)) FROM readings) AS times",
            args![],
        )
        .await?;
    row.get("newest")
}
