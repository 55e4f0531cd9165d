//! The findings of a case: what readers have marked and written.

use std::collections::HashMap;

use case::findings::{Finding, FindingRefused, check};
use case::{CaseFacts, CaseId};
use glam::{DAffine3, DVec3};
use jiff::Timestamp;
use pipeline::maps::{mirror_plane, side_at};
use storage::{FindingsVersion, Replaced, StoreError, StoredFindings};

use crate::{Cases, Error};

/// The findings of a case.
#[derive(Debug, Clone)]
pub struct Findings {
    /// In the order of the client that wrote them last.
    pub list: Vec<Finding>,
    /// Names this version of the list.
    pub version: FindingsVersion,
}

impl Findings {
    fn read(stored: &StoredFindings) -> Result<Self, Error> {
        let list = serde_json::from_str(&stored.document);
        Ok(Self {
            list: list.map_err(StoreError::from)?,
            version: stored.version,
        })
    }
}

/// The reason why findings were not replaced.
#[derive(Debug)]
pub enum NotReplaced {
    /// Somebody else has changed them: as they are now.
    Changed(Findings),
    /// One of them is wrong.
    Refused(FindingRefused),
    /// Another error.
    Other(Error),
}

impl From<Error> for NotReplaced {
    fn from(error: Error) -> Self {
        Self::Other(error)
    }
}

impl From<StoreError> for NotReplaced {
    fn from(error: StoreError) -> Self {
        Self::Other(error.into())
    }
}

impl Cases {
    /// The findings of a case in any state.
    ///
    /// # Errors
    /// [`Error::NoSuchCase`], or an error of the store.
    pub async fn findings(&self, id: &CaseId) -> Result<Findings, Error> {
        self.case(id).await?;
        Findings::read(&self.store().findings(id).await?)
    }

    /// Replaces the findings of a ready case, if they are still of one of the versions that the client knows; returns
    /// them with what the server adds. They are durable then.
    ///
    /// # Errors
    /// As [`Cases::ready`], and [`NotReplaced`].
    pub async fn replace_findings(
        &self,
        id: &CaseId,
        known: &[&str],
        mut list: Vec<Finding>,
    ) -> Result<Findings, NotReplaced> {
        let facts = self.ready(id).await?;
        let before = self.findings(id).await?;
        if !known.contains(&&*before.version.to_string()) {
            return Err(NotReplaced::Changed(before));
        }
        let space = Space::of(&facts);
        check(&list, &|point| space.contains(point)).map_err(NotReplaced::Refused)?;
        let now = Timestamp::now().to_string();
        let old: HashMap<&str, &Finding> = before.list.iter().map(|f| (&*f.id, f)).collect();
        for finding in &mut list {
            let old = old.get(&*finding.id);
            let unchanged = old.filter(|old| old.says_the_same_as(finding));
            let created_at = old.and_then(|old| old.created_at.clone());
            finding.created_at = created_at.or_else(|| Some(now.clone()));
            let changed_at = unchanged.and_then(|old| old.changed_at.clone());
            finding.changed_at = changed_at.or_else(|| Some(now.clone()));
            finding.side = Some(side_at(space.left_mm(&finding.middle_in_patient())));
        }
        let document = serde_json::to_string(&list).map_err(StoreError::from)?;
        let replaced = self.store().replace_findings(id, before.version, document);
        match replaced.await? {
            Replaced::Done(StoredFindings { version, .. }) => Ok(Findings { list, version }),
            Replaced::Changed => Err(NotReplaced::Changed(self.findings(id).await?)),
            Replaced::NoSuchCase => Err(Error::NoSuchCase.into()),
        }
    }
}

/// Where the findings of a case may lie.
struct Space<'f> {
    facts: &'f CaseFacts,
    voxel_from_patient: DAffine3,
}

impl<'f> Space<'f> {
    fn of(facts: &'f CaseFacts) -> Self {
        let patient_from_voxel = pipeline::affine_of(&facts.native_patient_from_voxel);
        Self {
            facts,
            voxel_from_patient: patient_from_voxel.inverse(),
        }
    }

    /// Whether a point lies in the volume as it was acquired: no further than a voxel from the nearest centre of one.
    fn contains(&self, point: &[f64; 3]) -> bool {
        let voxel = self
            .voxel_from_patient
            .transform_point3(DVec3::from_array(*point));
        let sizes = self.facts.native_size.into_iter();
        (sizes.zip(voxel.to_array())).all(|(size, at)| (-1.0..=size as f64).contains(&at))
    }

    /// How far a point lies to the patient's left of the midsagittal plane.
    fn left_mm(&self, point: &[f64; 3]) -> f64 {
        let plane = mirror_plane(self.facts);
        plane.normal().dot(DVec3::from_array(*point)) - plane.offset_mm()
    }
}
