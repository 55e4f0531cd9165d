//! Copies what the PACS has sent and rejected, and what is sent to it, into another store.

use std::collections::HashSet;

use case::series::Uid;
use storage::tables::made;
use storage::upkeep::{Copied, copy_objects};
use storage::{Made, ObjectName, Pinned, StoreError};

use super::PacsStore;
use crate::values::{Arrival, ArrivalQuery, NewInstance, SentResult, TransferQuery};

/// Rows to read at a time.
const ROWS_AT_ONCE: usize = 100;

/// Images of a series to pin at a time: copying them takes far less than a pin lasts.
const IMAGES_AT_ONCE: usize = 32;

/// How many series with how many images have come, and how many results there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CopyCounts {
    pub series: u64,
    pub images: u64,
    pub results: u64,
}

/// A step of a copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CopiedStep {
    /// A series with its images, or a result, was copied.
    Done,
    /// An image or a result was not copied.
    Lost(ObjectName),
}

/// Receives each step with the result so far.
type Report<'r> = &'r mut (dyn FnMut(CopiedStep, &CopyCounts) + Send);

impl PacsStore {
    /// Copies what was sent last and what is rejected, also of what is not kept any more: it says what is closed.
    ///
    /// # Errors
    /// If a store cannot be reached.
    pub async fn copy_images_into(&self, other: &Self) -> Result<(), StoreError> {
        self.copy_images(other).await?;
        self.copy_withdrawn(other).await
    }

    /// Copies what a PACS has sent last under each UID, also of what is not kept any more.
    async fn copy_images(&self, other: &Self) -> Result<(), StoreError> {
        let mut last = None;
        loop {
            let page = self.last_images(last.as_ref(), ROWS_AT_ONCE).await?;
            let Some(latest) = page.last() else {
                return Ok(());
            };
            last = Some(latest.clone());
            other.write_copied_images(&page).await?;
        }
    }

    /// Copies what was withdrawn, which must not come back.
    async fn copy_withdrawn(&self, other: &Self) -> Result<(), StoreError> {
        let mut last = None;
        loop {
            let page = self.withdrawn(last.as_ref(), ROWS_AT_ONCE).await?;
            let Some(latest) = page.last() else {
                return Ok(());
            };
            last = Some(latest.clone());
            other.write_copied_withdrawn(&page).await?;
        }
    }

    /// Copies every series with its images, and every result, after the cases; adds their objects to `copied`. Results that wait to be sent
    /// wait there too. Retrievals are not copied.
    ///
    /// # Errors
    /// If a store cannot be reached.
    pub async fn copy_series_into(
        &self,
        other: &Self,
        copied: &mut Copied,
        report: Report<'_>,
    ) -> Result<CopyCounts, StoreError> {
        let (mut of_pacs, mut after) = (CopyCounts::default(), None);
        loop {
            let (page, next) = self
                .arrivals(&ArrivalQuery::default(), after.as_ref(), ROWS_AT_ONCE)
                .await?;
            for arrival in page {
                for lost in self
                    .copy_series(other, &arrival, copied, &mut of_pacs)
                    .await?
                {
                    report(CopiedStep::Lost(lost), &of_pacs);
                }
                report(CopiedStep::Done, &of_pacs);
            }
            match next {
                Some(next) => after = Some(next),
                None => break,
            }
        }
        let (every, mut after) = (TransferQuery::default(), None);
        loop {
            let (page, next) = self.results(&every, after.as_ref(), ROWS_AT_ONCE).await?;
            for result in page {
                let step = match self
                    .copy_result(other, &result, copied, &mut of_pacs)
                    .await?
                {
                    true => CopiedStep::Done,
                    false => CopiedStep::Lost(result.what.object()),
                };
                report(step, &of_pacs);
            }
            match next {
                Some(next) => after = Some(next),
                None => break,
            }
        }
        // What came while the series were copied.
        self.copy_images_into(other).await?;
        Ok(of_pacs)
    }

    /// Copies the images that are whole; returns the others.
    async fn copy_series(
        &self,
        other: &Self,
        arrival: &Arrival,
        copied: &mut Copied,
        of_pacs: &mut CopyCounts,
    ) -> Result<Vec<ObjectName>, StoreError> {
        let images = self.images_of(&arrival.uids).await?;
        // An earlier copy may have what was corrected or rejected since.
        other.keep_images(arrival, &images).await?;
        let mut lost = Vec::new();
        // A series of which nothing is left has no chunk, but a reason.
        let chunks = images.len().div_ceil(IMAGES_AT_ONCE).max(1);
        for number in 0..chunks {
            let end = images.len().min((number + 1) * IMAGES_AT_ONCE);
            let some = &images[number * IMAGES_AT_ONCE..end];
            let names: HashSet<_> = some.iter().map(|(_, name)| *name).collect();
            let names: Vec<_> = names.into_iter().collect();
            let image = |(uid, name): &(Uid, ObjectName)| NewInstance {
                uids: arrival.uids.clone(),
                accession_number: arrival.accession_number.clone(),
                sop_instance_uid: uid.clone(),
                digest: name.digest,
                label: arrival.label.clone(),
                fingerprint: None,
            };
            let write = |mut pinned: Pinned, missing: Vec<ObjectName>| async move {
                pinned.names.retain(|name| !missing.contains(name));
                let whole = some.iter().filter(|(_, name)| !missing.contains(name));
                let whole: Vec<_> = whole.map(image).collect();
                match other.write_copied_arrival(arrival, &whole, &pinned).await? {
                    true => Ok((whole.len() as u64, missing)),
                    false => Err(StoreError::Rows("a pin was lost".into())),
                }
            };
            let (whole, missing) =
                copy_objects(&self.store, &other.store, &names, copied, write).await?;
            lost.extend(missing);
            of_pacs.images += whole;
        }
        of_pacs.series += 1;
        if !lost.is_empty() {
            // The series may have been deleted a moment ago.
            let images = self.images_of(&arrival.uids).await?;
            lost.retain(|lost| images.iter().any(|(_, name)| name == lost));
        }
        copied.lost += lost.len() as u64;
        Ok(lost)
    }

    /// Returns `false` if the result is missing or damaged, or its case was not copied.
    async fn copy_result(
        &self,
        other: &Self,
        result: &SentResult,
        copied: &mut Copied,
        of_pacs: &mut CopyCounts,
    ) -> Result<bool, StoreError> {
        // The layers that it shows may be gone.
        let made = Made::result(&result.what.case, &result.id);
        let made_of = &made::of(&mut self.store.connect().await?, &made).await?;
        let write = |pinned: Pinned, lost: Vec<ObjectName>| async move {
            Ok(lost.is_empty() && other.write_copied_result(result, made_of, &pinned).await?)
        };
        let written = copy_objects(
            &self.store,
            &other.store,
            &[result.what.object()],
            copied,
            write,
        )
        .await?;
        if written {
            of_pacs.results += 1;
        } else if self.result(&result.id).await?.is_some() {
            copied.lost += 1;
            return Ok(false);
        }
        // Otherwise it was deleted a moment ago.
        Ok(true)
    }
}
