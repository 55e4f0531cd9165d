//! The findings of cases.

use super::connection::{Connection, Row};
use super::owners;
use crate::args;
use crate::findings::{FindingsVersion, NONE, Replaced, StoredFindings};
use crate::rows::Relabel;
use crate::{Store, StoreError};
use case::CaseId;

impl Store {
    /// The findings of a case; the empty document if there are none, or no such case.
    ///
    /// # Errors
    /// If the rows cannot be read, or the document is damaged.
    pub async fn findings(&self, id: &CaseId) -> Result<StoredFindings, StoreError> {
        one(&mut self.connect().await?, id).await
    }

    /// Replaces the findings of a case if they are still of the given version. The age of the case counts from now.
    ///
    /// # Errors
    /// If the rows cannot be written, or the stored document is damaged.
    pub async fn replace_findings(
        &self,
        id: &CaseId,
        version: FindingsVersion,
        document: String,
    ) -> Result<Replaced, StoreError> {
        let new = StoredFindings::new(document);
        let (mut transaction, now) = self.write().await?;
        let state = owners::came_again(&mut transaction, id, None, Relabel::None, now).await?;
        if state.is_none() {
            return Ok(Replaced::NoSuchCase);
        }
        if one(&mut transaction, id).await?.version != version {
            return Ok(Replaced::Changed);
        }
        put(&mut transaction, id, &new, now).await?;
        transaction.commit().await?;
        self.signals().changed(id);
        Ok(Replaced::Done(new))
    }

    /// Changes what is stored without changing its digest, as a failing disk would.
    #[cfg(test)]
    pub(crate) async fn damage_findings(&self, id: &CaseId) {
        let mut connection = self.connect().await.unwrap();
        let damaged = connection.execute(
            "UPDATE findings SET document = '[0]' WHERE case_id = $1",
            args![id.to_string()],
        );
        damaged.await.unwrap();
    }

    /// Gives a case the findings that it has in another store.
    pub(crate) async fn write_copied_findings(
        &self,
        id: &CaseId,
        findings: &StoredFindings,
    ) -> Result<(), StoreError> {
        let (mut transaction, now) = self.write().await?;
        if transaction.has_case(&id.to_string()).await? {
            put(&mut transaction, id, findings, now).await?;
            transaction.commit().await?;
        }
        Ok(())
    }
}

async fn one(connection: &mut Connection, id: &CaseId) -> Result<StoredFindings, StoreError> {
    let row = connection
        .fetch_optional(
            "SELECT document, digest FROM findings WHERE case_id = $1",
            args![id.to_string()],
        )
        .await?;
    match row {
        Some(row) => read(&row, id),
        None => Ok(StoredFindings::new(NONE.to_owned())),
    }
}

fn read(row: &Row, id: &CaseId) -> Result<StoredFindings, StoreError> {
    let stored = StoredFindings::new(row.get("document")?);
    let digest: String = row.get("digest")?;
    if stored.version.digest().to_string() != digest {
        return Err(StoreError::DamagedFindings(*id));
    }
    Ok(stored)
}

/// Writes the findings of a case that exists.
async fn put(
    connection: &mut Connection,
    id: &CaseId,
    findings: &StoredFindings,
    now: i64,
) -> Result<(), StoreError> {
    let (kept, readers) = findings.summary()?;
    connection
        .execute(
            "INSERT INTO findings (case_id, document, digest, changed_at, kept, readers) VALUES ($1, $2, $3, $4, $5, $6)
             ON CONFLICT (case_id) DO UPDATE SET document = excluded.document, digest = excluded.digest,
                                                 changed_at = excluded.changed_at, kept = excluded.kept,
                                                 readers = excluded.readers",
            args![
                id.to_string(), findings.document.clone(), findings.version.digest().to_string(),
                now, kept, readers,
            ],
        )
        .await?;
    Ok(())
}

/// Gives a new version of a case a copy of its findings; from then on, each has its own.
pub(super) async fn inherit(
    connection: &mut Connection,
    case: &CaseId,
    previous: &CaseId,
) -> Result<(), StoreError> {
    connection
        .execute(
            "INSERT INTO findings (case_id, document, digest, changed_at, kept, readers)
             SELECT $1, document, digest, changed_at, kept, readers FROM findings WHERE case_id = $2",
            args![case.to_string(), previous.to_string()],
        )
        .await?;
    Ok(())
}
