//! The readings of a case: what named readers conclude, each on their own until they have signed.

use case::CaseId;
use case::findings::FindingRefused;
use case::readings::Reading;
use jiff::Timestamp;
use storage::{FindingsVersion, ReadingState, StoreError, StoredReading, WrittenReading};

use crate::findings::NotReplaced;
use crate::{Cases, Error};

/// A version of the reading of a reader.
#[derive(Debug, Clone)]
pub struct KeptReading {
    /// The name by which the reader signs in.
    pub reader: String,
    /// From 1; a correction of a signed one is the next.
    pub version: u32,
    /// `None` while it is open.
    pub signed_at: Option<Timestamp>,
    pub reading: Reading,
    /// Names what is stored, of whom, and whether it is signed.
    pub tag: FindingsVersion,
    /// `None` before anything is.
    stored: Option<StoredReading>,
}

impl KeptReading {
    /// The reading that somebody has not begun.
    fn unbegun(reader: &str) -> Self {
        Self {
            reader: reader.to_owned(),
            version: 1,
            signed_at: None,
            reading: Reading::default(),
            tag: FindingsVersion::of(reader),
            stored: None,
        }
    }

    fn read(stored: StoredReading) -> Result<Self, Error> {
        let StoredReading { state, document } = &stored;
        let signed_at = state.signed_at;
        let signed_us = signed_at.map(jiff::Timestamp::as_microsecond);
        let named = format!(
            "{} {} {signed_us:?} {document}",
            state.reader, state.version
        );
        Ok(Self {
            reader: state.reader.clone(),
            version: state.version,
            signed_at,
            reading: serde_json::from_str(document).map_err(StoreError::from)?,
            tag: FindingsVersion::of(&named),
            stored: Some(stored),
        })
    }
}

/// Whether somebody has signed a version of their own reading: they see those of others then.
pub fn has_signed(readings: &[ReadingState], reader: Option<&str>) -> bool {
    let mut own = readings.iter().filter(|one| Some(&*one.reader) == reader);
    own.any(|one| one.signed_at.is_some())
}

impl Cases {
    /// Who has read a case in any state, by reader and version.
    ///
    /// # Errors
    /// [`Error::NoSuchCase`], or an error of the store.
    pub async fn readings(&self, id: &CaseId) -> Result<Vec<ReadingState>, Error> {
        self.case(id).await?;
        Ok(self.store().readings(id).await?)
    }

    /// The last version of the reading of whoever asks; an empty one if it is not begun.
    ///
    /// # Errors
    /// As [`Cases::readings`].
    pub async fn own_reading(&self, id: &CaseId, reader: &str) -> Result<KeptReading, Error> {
        let readings = self.readings(id).await?;
        match readings.iter().rfind(|one| one.reader == reader) {
            Some(last) => self.version(id, last).await,
            None => Ok(KeptReading::unbegun(reader)),
        }
    }

    /// A version of a reading, or the last one that counts: a correction in which nothing is concluded leaves the signed one in its place. Those of others
    /// are shown once they are signed, to somebody who has signed their own.
    ///
    /// # Errors
    /// [`Error::ReadingHidden`], [`Error::NoSuchReading`], or as [`Cases::readings`].
    pub async fn reading(
        &self,
        id: &CaseId,
        asker: Option<&str>,
        reader: &str,
        version: Option<u32>,
    ) -> Result<KeptReading, Error> {
        let readings = self.readings(id).await?;
        let is_own = asker == Some(reader);
        if !is_own && !has_signed(&readings, asker) {
            return Err(Error::ReadingHidden);
        }
        let is_asked = |one: &&ReadingState| {
            one.reader == reader
                && version.is_none_or(|version| version == one.version)
                && (is_own || one.signed_at.is_some())
        };
        let mut asked = readings.iter().filter(is_asked);
        let last = asked.next_back().ok_or(Error::NoSuchReading)?;
        let reading = self.version(id, last).await?;
        let counts = reading.signed_at.is_some() || reading.reading.is_concluded();
        match asked.next_back() {
            Some(signed) if !counts => self.version(id, signed).await,
            _ => Ok(reading),
        }
    }

    async fn version(&self, id: &CaseId, state: &ReadingState) -> Result<KeptReading, Error> {
        let stored = self
            .store()
            .reading(id, &state.reader, state.version)
            .await?;
        KeptReading::read(stored.ok_or(Error::NoSuchReading)?)
    }

    /// Keeps the reading of somebody of a ready case, if it is still of one of the versions that the client knows; returns it with what the server
    /// adds to its findings. It is durable then. After a signed version, this is the next, unless the case is closed.
    ///
    /// # Errors
    /// As [`Cases::ready`], and [`NotReplaced`].
    pub async fn keep_reading(
        &self,
        id: &CaseId,
        reader: &str,
        known: &[&str],
        mut reading: Reading,
    ) -> Result<KeptReading, NotReplaced<KeptReading>> {
        let facts = self.ready(id).await?;
        let before = self.own_reading(id, reader).await?;
        if !known.contains(&&*before.tag.to_string()) {
            return Err(NotReplaced::Changed(before));
        }
        reading.check_conclusion().map_err(NotReplaced::Refused)?;
        if reading.conclusion.trim().is_empty() {
            reading.conclusion.clear();
        }
        // What is taken from the findings of the case keeps its times.
        let joint = self.findings(id).await?.list;
        let older = [joint, before.reading.findings].concat();
        self.complete(id, &facts, &older, &mut reading.findings)
            .await
            .map_err(NotReplaced::Refused)?;
        let document = serde_json::to_string(&reading).map_err(StoreError::from)?;
        let stored = before.stored.as_ref();
        let written = self.store().write_reading(id, reader, stored, document);
        self.written(id, reader, written.await?).await
    }

    /// Signs the reading of somebody of a case that counts, if it is still of one of the versions that the client knows. Nobody
    /// changes this version then.
    ///
    /// # Errors
    /// [`NotReplaced`]: `Closed`, `Refused` if nothing is concluded, or [`Error::ReadingSigned`].
    pub async fn sign_reading(
        &self,
        id: &CaseId,
        reader: &str,
        known: &[&str],
    ) -> Result<KeptReading, NotReplaced<KeptReading>> {
        self.check_open(id).await?;
        let before = self.own_reading(id, reader).await?;
        if !known.contains(&&*before.tag.to_string()) {
            return Err(NotReplaced::Changed(before));
        }
        if before.signed_at.is_some() {
            return Err(Error::ReadingSigned.into());
        }
        let is_concluded = before.reading.is_concluded();
        let Some(stored) = before.stored.filter(|_| is_concluded) else {
            return Err(NotReplaced::Refused(FindingRefused {
                path: "conclusion".to_owned(),
                detail: "must not be empty when it is signed, unless the template states something"
                    .to_owned(),
            }));
        };
        let written = self.store().sign_reading(id, &stored).await?;
        self.written(id, reader, written).await
    }

    async fn written(
        &self,
        id: &CaseId,
        reader: &str,
        written: WrittenReading,
    ) -> Result<KeptReading, NotReplaced<KeptReading>> {
        match written {
            WrittenReading::Done(stored) => Ok(KeptReading::read(stored)?),
            WrittenReading::Changed => {
                Err(NotReplaced::Changed(self.own_reading(id, reader).await?))
            }
            WrittenReading::Closed => {
                self.check_open(id).await?;
                Err(NotReplaced::Changed(self.own_reading(id, reader).await?))
            }
            WrittenReading::NoSuchCase => Err(Error::NoSuchCase.into()),
        }
    }
}
