//! The readings of cases.

use super::connection::{Connection, Row, read_time, unreadable};
use super::{cases, owners};
use crate::args;
use crate::readings::{ReadingState, StoredReading, WrittenReading};
use crate::rows::Relabel;
use crate::{Store, StoreError};
use case::CaseId;
use jiff::Timestamp;

impl Store {
    /// The versions of all readings of a case, by reader and version; none if there is no such case.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub async fn readings(&self, id: &CaseId) -> Result<Vec<ReadingState>, StoreError> {
        let rows = self
            .connect()
            .await?
            .fetch_all(
                "SELECT reader, version, changed_at, signed_at FROM readings WHERE case_id = $1 ORDER BY reader, version",
                args![id.to_string()],
            )
            .await?;
        rows.iter().map(read_state).collect()
    }

    /// A version of a reading.
    ///
    /// # Errors
    /// If the rows cannot be read, or the document is damaged.
    pub async fn reading(
        &self,
        id: &CaseId,
        reader: &str,
        version: u32,
    ) -> Result<Option<StoredReading>, StoreError> {
        let row = self
            .connect()
            .await?
            .fetch_optional(
                "SELECT reader, version, changed_at, signed_at, document, digest FROM readings
                 WHERE case_id = $1 AND reader = $2 AND version = $3",
                args![id.to_string(), reader.to_owned(), i64::from(version)],
            )
            .await?;
        row.map(|row| read(&row, id)).transpose()
    }

    /// Writes a reading if its last version is still the given one: changes one that is open, and begins the next after one that is
    /// signed. The age of the case counts from now.
    ///
    /// # Errors
    /// If the rows cannot be written, or the stored document is damaged.
    pub async fn write_reading(
        &self,
        id: &CaseId,
        reader: &str,
        known: Option<&StoredReading>,
        document: String,
    ) -> Result<WrittenReading, StoreError> {
        let version = match known.map(|known| &known.state) {
            None => 1,
            Some(signed) if signed.signed_at.is_some() => signed.version.saturating_add(1),
            Some(open) => open.version,
        };
        let write = |now| {
            Ok(StoredReading {
                state: ReadingState {
                    reader: reader.to_owned(),
                    version,
                    changed_at: time(now)?,
                    signed_at: None,
                },
                document,
            })
        };
        self.follow(id, reader, known, write).await
    }

    /// Signs the last version of a reading if it is still the given one.
    ///
    /// # Errors
    /// As [`Store::write_reading`].
    pub async fn sign_reading(
        &self,
        id: &CaseId,
        known: &StoredReading,
    ) -> Result<WrittenReading, StoreError> {
        let sign = |now| {
            let mut signed = known.clone();
            signed.state.signed_at = Some(time(now)?);
            Ok(signed)
        };
        self.follow(id, &known.state.reader, Some(known), sign)
            .await
    }

    /// Stores what follows the last version of a reading, if that is still the given one.
    async fn follow(
        &self,
        id: &CaseId,
        reader: &str,
        known: Option<&StoredReading>,
        next: impl FnOnce(i64) -> Result<StoredReading, StoreError>,
    ) -> Result<WrittenReading, StoreError> {
        let (mut transaction, now) = self.write().await?;
        let state = owners::came_again(&mut transaction, id, None, Relabel::None, now).await?;
        if state.is_none() {
            return Ok(WrittenReading::NoSuchCase);
        }
        if last(&mut transaction, id, reader).await?.as_ref() != known {
            return Ok(WrittenReading::Changed);
        }
        let written = next(now)?;
        let is_signed = |reading: &StoredReading| reading.state.signed_at.is_some();
        let needs_open = is_signed(&written) || known.is_some_and(is_signed);
        if needs_open && cases::closed(&mut transaction, id).await?.is_some() {
            return Ok(WrittenReading::Closed);
        }
        put(&mut transaction, id, &written).await?;
        transaction.commit().await?;
        self.signals().changed(id);
        Ok(WrittenReading::Done(written))
    }

    /// Changes what is stored without changing its digest, as a failing disk would.
    #[cfg(test)]
    pub(crate) async fn damage_readings(&self, id: &CaseId) {
        let mut connection = self.connect().await.unwrap();
        let damaged = connection.execute(
            "UPDATE readings SET document = '{}' WHERE case_id = $1",
            args![id.to_string()],
        );
        damaged.await.unwrap();
    }

    /// Gives a case a reading that it has in another store.
    pub(crate) async fn write_copied_reading(
        &self,
        id: &CaseId,
        reading: &StoredReading,
    ) -> Result<(), StoreError> {
        let (mut transaction, _) = self.write().await?;
        if transaction.has_case(&id.to_string()).await? {
            put(&mut transaction, id, reading).await?;
            transaction.commit().await?;
        }
        Ok(())
    }
}

async fn last(
    connection: &mut Connection,
    id: &CaseId,
    reader: &str,
) -> Result<Option<StoredReading>, StoreError> {
    let row = connection
        .fetch_optional(
            "SELECT reader, version, changed_at, signed_at, document, digest FROM readings
             WHERE case_id = $1 AND reader = $2 ORDER BY version DESC LIMIT 1",
            args![id.to_string(), reader.to_owned()],
        )
        .await?;
    row.map(|row| read(&row, id)).transpose()
}

/// Writes a version of a reading of a case that exists.
async fn put(
    connection: &mut Connection,
    id: &CaseId,
    StoredReading { state, document }: &StoredReading,
) -> Result<(), StoreError> {
    connection
        .execute(
            "INSERT INTO readings (case_id, reader, version, document, digest, changed_at, signed_at) VALUES ($1, $2, $3, $4, $5, $6, $7)
             ON CONFLICT (case_id, reader, version) DO UPDATE SET document = excluded.document, digest = excluded.digest,
                                                                  changed_at = excluded.changed_at, signed_at = excluded.signed_at
             WHERE readings.signed_at IS NULL",
            args![
                id.to_string(), state.reader.clone(), i64::from(state.version), document.clone(),
                owners::digest(document), state.changed_at.as_microsecond(),
                state.signed_at.map(Timestamp::as_microsecond),
            ],
        )
        .await?;
    Ok(())
}

fn read(row: &Row, id: &CaseId) -> Result<StoredReading, StoreError> {
    let document: String = row.get("document")?;
    let digest: String = row.get("digest")?;
    if owners::digest(&document) != digest {
        return Err(StoreError::DamagedReading(*id));
    }
    let state = read_state(row)?;
    Ok(StoredReading { state, document })
}

fn read_state(row: &Row) -> Result<ReadingState, StoreError> {
    let version: i64 = row.get("version")?;
    let signed_at: Option<i64> = row.get("signed_at")?;
    Ok(ReadingState {
        reader: row.get("reader")?,
        version: u32::try_from(version).map_err(|_| unreadable("a version"))?,
        changed_at: read_time(row, "changed_at")?,
        signed_at: signed_at.map(time).transpose()?,
    })
}

fn time(microseconds: i64) -> Result<Timestamp, StoreError> {
    Timestamp::from_microsecond(microseconds).map_err(|_| unreadable("a time"))
}
