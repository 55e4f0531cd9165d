//! Copies one store into another: a move between back ends, or a backup.

use std::collections::HashSet;

use crate::Unreadable;
use case::{CaseId, CaseState, Layer, ObjectKind};

use super::arrivals::{Arrival, ArrivalQuery, NewInstance, TransferQuery};
use super::results::SentResult;
use super::rows::Made;
use super::{ObjectName, Store, StoreError};

/// Rows to read at a time.
const ROWS_AT_ONCE: usize = 100;

/// Images of a series to pin at a time: copying them takes far less than a pin lasts.
const IMAGES_AT_ONCE: usize = 32;

/// The result of a copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Copied {
    /// Cases that were new to the target or were updated there.
    pub cases: u64,
    /// Objects written.
    pub objects: u64,
    /// Their bytes, as stored.
    pub bytes: u64,
    /// Intact objects that the target already had.
    pub kept: u64,
    /// Cases and layers that were not copied, because a source is missing or damaged; images and results that are
    /// missing or damaged.
    pub lost: u64,
    /// What came from a PACS, or goes to one.
    pub for_pacs: ForPacs,
}

/// The numbers of what came from a PACS, or goes to one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ForPacs {
    pub series: u64,
    pub images: u64,
    pub results: u64,
}

/// A step of a copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CopyStep {
    /// A case was copied.
    Case(CaseId),
    /// A case, or one of its layers, was not copied.
    LostCase(CaseId),
    /// An image from a PACS, or a result for one, was not copied.
    LostForPacs(ObjectName),
    /// A series with its images, or a result, was copied.
    ForPacs,
}

/// Receives each step with the result so far.
type Report<'r> = &'r mut (dyn FnMut(CopyStep, &Copied) + Send);

impl Store {
    /// Copies every case into another store. Intact objects that the target already has are kept, so an interrupted
    /// copy continues where it stopped, and a repeated copy adds what is new. Cases that only the target has stay
    /// there.
    ///
    /// A case that is not prepared yet is prepared there. Each object is verified against its digest when it is read,
    /// and read back after it is written.
    ///
    /// # Errors
    /// If a store cannot be reached.
    pub async fn copy_into(&self, other: &Self, report: Report<'_>) -> Result<Copied, StoreError> {
        let mut ids = Vec::new();
        let mut walk = None;
        while let Some(cases) = self.next_cases(&mut walk).await? {
            ids.extend(cases.into_iter().map(|case| case.id));
        }
        // What is made of images is judged by them.
        self.copy_images(other).await?;
        self.copy_withdrawn(other).await?;
        let mut copied = Copied::default();
        // A case comes before its versions.
        for id in ids.iter().rev() {
            let step = match self.copy_case(other, id, &mut copied).await? {
                true => CopyStep::Case(*id),
                false => CopyStep::LostCase(*id),
            };
            report(step, &copied);
        }
        Ok(copied)
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

    /// Copies every series that came from a PACS with its images, and every result, after the cases;
    /// adds to `copied`. Results that wait to be sent wait there too. Retrievals are not copied.
    ///
    /// # Errors
    /// If a store cannot be reached.
    pub async fn copy_for_pacs_into(
        &self,
        other: &Self,
        mut copied: Copied,
        report: Report<'_>,
    ) -> Result<Copied, StoreError> {
        let mut after = None;
        loop {
            let (page, next) = self
                .arrivals(&ArrivalQuery::default(), after.as_ref(), ROWS_AT_ONCE)
                .await?;
            for arrival in page {
                for lost in self.copy_series(other, &arrival, &mut copied).await? {
                    report(CopyStep::LostForPacs(lost), &copied);
                }
                report(CopyStep::ForPacs, &copied);
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
                let step = match self.copy_result(other, &result, &mut copied).await? {
                    true => CopyStep::ForPacs,
                    false => CopyStep::LostForPacs(result.object),
                };
                report(step, &copied);
            }
            match next {
                Some(next) => after = Some(next),
                None => break,
            }
        }
        // What came while the series were copied.
        self.copy_images(other).await?;
        self.copy_withdrawn(other).await?;
        Ok(copied)
    }

    /// Copies the images that are whole; returns the others.
    async fn copy_series(
        &self,
        other: &Self,
        arrival: &Arrival,
        copied: &mut Copied,
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
            let mut pinned = other.pin(names).await?;
            let mut whole = Vec::new();
            for (uid, name) in some {
                if self.copy_object(other, name, copied).await? {
                    whole.push(NewInstance {
                        uids: arrival.uids.clone(),
                        accession_number: arrival.accession_number.clone(),
                        sop_instance_uid: uid.clone(),
                        digest: name.digest,
                        label: arrival.label.clone(),
                        fingerprint: None,
                    });
                } else {
                    lost.push(*name);
                    pinned.names.retain(|pinned| pinned != name);
                }
            }
            let written = other.write_copied_arrival(arrival, &whole, &pinned).await?;
            other.abandon(&pinned).await;
            if !written {
                return Err(StoreError::Rows("a pin was lost".into()));
            }
            copied.for_pacs.images += whole.len() as u64;
        }
        copied.for_pacs.series += 1;
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
    ) -> Result<bool, StoreError> {
        // The layers that it shows may be gone.
        let made_of = self
            .made_of(&Made::result(&result.case, &result.id))
            .await?;
        let pinned = other.pin([result.object]).await?;
        let written = self.copy_object(other, &result.object, copied).await?
            && other.write_copied_result(result, &made_of, &pinned).await?;
        other.abandon(&pinned).await;
        if written {
            copied.for_pacs.results += 1;
        } else if self.result(&result.id).await?.is_some() {
            copied.lost += 1;
            return Ok(false);
        }
        // Otherwise it was deleted a moment ago.
        Ok(true)
    }

    /// Returns `false` if a source is lost.
    async fn copy_case(
        &self,
        other: &Self,
        id: &CaseId,
        copied: &mut Copied,
    ) -> Result<bool, StoreError> {
        let Some(case) = self.case(id).await? else {
            // The case was deleted meanwhile.
            return Ok(true);
        };
        let mut names = self.case_objects(id).await?;
        if case.state != CaseState::Ready {
            names.retain(is_of_upload);
        }
        let pinned = other.pin(names.iter().copied()).await?;
        for name in &names {
            let written = self.copy_object(other, name, copied).await?;
            // Derived objects are rebuilt on first use, and a manifest by `check-store --repair`.
            if !written && name.kind.is_source() {
                copied.lost += 1;
                other.abandon(&pinned).await;
                return Ok(false);
            }
        }
        if other.write_copied_case(&case, &pinned).await? {
            copied.cases += 1;
        }
        if let Some(series) = self.series_of(id).await?
            && other.series_of(id).await?.as_ref() != Some(&series)
        {
            other.index_series(&series).await?;
        }
        other
            .note_made_of(&Made::case(id), &self.made_of(&Made::case(id)).await?)
            .await?;
        let findings = self.findings(id).await?;
        if findings != other.findings(id).await? {
            other.write_copied_findings(id, &findings).await?;
        }
        other.abandon(&pinned).await;
        let mut is_whole = true;
        let layers = self.layers(id).await?;
        // An earlier copy may have what was deleted, corrected or rejected since.
        for former in other.layers(id).await? {
            if layers.iter().all(|layer| layer.id != former.id) {
                other.delete_layer(id, &former.id).await?;
            }
        }
        for layer in layers {
            is_whole &= self.copy_layer(other, layer, copied).await?;
        }
        Ok(is_whole)
    }

    /// Returns `false` if a source is lost.
    async fn copy_layer(
        &self,
        other: &Self,
        mut layer: Layer,
        copied: &mut Copied,
    ) -> Result<bool, StoreError> {
        let mut names = self.layer_objects(&layer.case, &layer.id).await?;
        if layer.state != CaseState::Ready {
            names.retain(is_of_upload);
        }
        let mut pinned = other.pin(names.iter().copied()).await?;
        for name in &names {
            if self.copy_object(other, name, copied).await? {
                continue;
            }
            if name.kind.is_source() {
                copied.lost += 1;
                other.abandon(&pinned).await;
                return Ok(false);
            }
            if name.kind == ObjectKind::Manifest {
                continue;
            }
            // It is made again from the source; its placement stays.
            layer.state = CaseState::Queued;
            pinned.names.retain(|pinned| pinned != name);
        }
        let series = self.series_of_layer(&layer.case, &layer.id).await?;
        other
            .write_copied_layer(&layer, series.as_ref(), &pinned)
            .await?;
        let made = Made::layer(&layer.case, &layer.id);
        let images = self.made_of(&made).await?;
        other.note_made_of(&made, &images).await?;
        other.abandon(&pinned).await;
        Ok(true)
    }

    /// `false` if it is missing or damaged here.
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
            Err(Unreadable::Store(error)) => return Err(error.into()),
            Err(_) => {}
        }
        let framed = match self.objects().get_framed(name).await {
            Ok(framed) => framed,
            Err(Unreadable::Store(error)) => return Err(error.into()),
            Err(_) => return Ok(false),
        };
        copied.objects += 1;
        copied.bytes += framed.len() as u64;
        other.objects().put_framed(name, framed).await?;
        match other.objects().get(name).await {
            Ok(_) => Ok(true),
            Err(Unreadable::Store(error)) => Err(error.into()),
            Err(fault) => Err(StoreError::Objects(Box::new(fault))),
        }
    }
}

/// Whether an object was there when its case or its layer was uploaded.
fn is_of_upload(name: &ObjectName) -> bool {
    name.kind.is_source() || name.kind == ObjectKind::Manifest
}
