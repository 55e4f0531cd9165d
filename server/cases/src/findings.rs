//! The findings of a case: what readers have marked and written.

use std::collections::{HashMap, HashSet};

use bytes::Bytes;
use case::findings::{Finding, FindingRefused, check};
use case::{CaseFacts, CaseId, MapName};
use geometry::Grid;
use glam::{DAffine3, DVec3};
use imaging::dicom::{Mark, MarkedPatient};
use jiff::Timestamp;
use pipeline::ac_pc::AcPc;
use pipeline::findings::voxels_of;
use pipeline::maps::side_at;
use storage::tables::made;
use storage::{FindingsVersion, Made, Replaced, StoreError, StoredFindings};

use crate::gyri::PlaceNames;
use crate::nifti::native_grid;
use crate::patient::Patient;
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

/// The reason why findings, or a reading, were not replaced.
#[derive(Debug)]
pub enum NotReplaced<Current = Findings> {
    /// Somebody else has changed them: as they are now.
    Changed(Current),
    /// One of them is wrong, or the conclusion of a reading is.
    Refused(FindingRefused),
    /// They are of another patient, of another frame of reference, or of images that lay elsewhere: a sentence.
    Elsewhere(&'static str),
    /// The case does not count any more: a sentence.
    Closed(&'static str),
    Other(Error),
}

impl<Current> From<Error> for NotReplaced<Current> {
    fn from(error: Error) -> Self {
        Self::Other(error)
    }
}

impl<Current> From<StoreError> for NotReplaced<Current> {
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
        self.complete(id, &facts, &before.list, &mut list)
            .await
            .map_err(NotReplaced::Refused)?;
        let document = serde_json::to_string(&list).map_err(StoreError::from)?;
        let replaced = self.store().replace_findings(id, before.version, document);
        match replaced.await? {
            Replaced::Done(StoredFindings { version, .. }) => Ok(Findings { list, version }),
            Replaced::Changed => Err(NotReplaced::Changed(self.findings(id).await?)),
            Replaced::NoSuchCase => Err(Error::NoSuchCase.into()),
        }
    }

    /// Checks the findings that a client sends, and adds sides, names and times; those that have not changed since `before` keep theirs.
    pub(crate) async fn complete(
        &self,
        id: &CaseId,
        facts: &CaseFacts,
        before: &[Finding],
        list: &mut [Finding],
    ) -> Result<(), FindingRefused> {
        let space = Space::of(facts);
        check(list, &|point| space.contains(point))?;
        // A finding is kept without a name rather than not at all.
        let gyri = match list.is_empty() {
            true => None,
            false => self.gyri(id).await.ok().flatten(),
        };
        let names = PlaceNames {
            gyri: gyri.as_deref(),
            ac_pc: AcPc::of(list, &facts.midsagittal),
        };
        let now = Timestamp::now().to_string();
        let old: HashMap<&str, &Finding> = before.iter().map(|f| (&*f.id, f)).collect();
        for finding in list {
            let old = old.get(&*finding.id);
            let unchanged = old.filter(|old| old.says_the_same_as(finding));
            let created_at = old.and_then(|old| old.created_at.clone());
            finding.created_at = created_at.or_else(|| Some(now.clone()));
            let changed_at = unchanged.and_then(|old| old.changed_at.clone());
            finding.changed_at = changed_at.or_else(|| Some(now.clone()));
            let middle = DVec3::from_array(finding.middle_in_patient());
            finding.side = Some(side_at(facts, middle));
            names.name(finding);
        }
        Ok(())
    }
}

impl Cases {
    /// Adds the findings of another case, in any state, to those of a ready case that counts, if these are still of one of the versions that
    /// the client knows. Positions stay as they are: whether both heads lie in one place is for the reader to see, so what is added
    /// is unconfirmed. A finding whose id is there is not added again.
    ///
    /// # Errors
    /// As [`Cases::replace_findings`]; [`NotReplaced::Closed`]; [`NotReplaced::Elsewhere`] if one of them lies outside the volume.
    pub async fn take_over_findings(
        &self,
        id: &CaseId,
        known: &[&str],
        other: &CaseId,
    ) -> Result<Findings, NotReplaced> {
        let facts = self.ready(id).await?;
        self.check_open(id).await?;
        let before = self.findings(id).await?;
        let version = before.version.to_string();
        if !known.contains(&&*version) {
            return Err(NotReplaced::Changed(before));
        }
        let ids: HashSet<_> = before.list.iter().map(|finding| &*finding.id).collect();
        let mut new = self.findings(other).await?.list;
        new.retain(|finding| !ids.contains(&*finding.id));
        for finding in &mut new {
            finding.is_unconfirmed = true;
        }
        let space = Space::of(&facts);
        let mut points = new.iter().flat_map(|one| &one.points_in_patient);
        if !points.all(|point| space.contains(point)) {
            return Err(NotReplaced::Elsewhere(
                "a finding of the other case lies outside the volume of this case, so that the two heads do not lie in one place; mark the findings again",
            ));
        }
        let list = [before.list, new].concat();
        self.replace_findings(id, &[&version], list).await
    }

    /// Refuses a case of which nothing new is made.
    pub(crate) async fn check_open<Current>(
        &self,
        id: &CaseId,
    ) -> Result<(), NotReplaced<Current>> {
        match self.case(id).await?.closed {
            Some(why) => Err(NotReplaced::Closed(why.sentence())),
            None => Ok(()),
        }
    }
}

impl Cases {
    /// The findings of a ready case that are neither dismissed nor unconfirmed, as labels on the grid of the acquired volume, as `.nii.gz`.
    ///
    /// A label is the number that page and report give its finding: from 1, without dismissed ones and the commissures. Where two overlap, the later one is seen.
    ///
    /// # Errors
    /// As [`Cases::ready`]; [`Error::Busy`] if too much work waits.
    pub async fn finding_labels(&self, id: &CaseId) -> Result<Vec<u8>, Error> {
        let list = self.findings(id).await?.list;
        let FindingLabels {
            grid,
            labels,
            findings,
        } = self.findings_in_voxels(id, list).await?;
        let write = move || {
            let names = findings.iter().map(|(number, one)| (*number, name_of(one)));
            let names: Vec<_> = names.collect();
            imaging::nifti::write_labels(&grid, &labels, &names).map_err(|_| Error::Internal)
        };
        self.queue.run(write).await?
    }

    /// Findings of a ready case that are neither dismissed nor unconfirmed, as labels on the grid of the acquired volume.
    ///
    /// # Errors
    /// As [`Cases::finding_labels`].
    pub async fn findings_in_voxels(
        &self,
        id: &CaseId,
        list: Vec<Finding>,
    ) -> Result<FindingLabels, Error> {
        let facts = self.ready(id).await?;
        let draw = move || {
            let grid = native_grid(&facts)?;
            let mut labels = vec![0; grid.voxel_count()];
            let numbered = list.into_iter().filter(Finding::is_numbered);
            let findings = (1..).zip(numbered).filter(|(_, finding)| finding.is_kept());
            let findings: Vec<_> = findings.collect();
            for (number, finding) in &findings {
                paint(&mut labels, &grid, *number, finding);
            }
            Ok(FindingLabels {
                grid,
                labels,
                findings,
            })
        };
        self.queue.run(draw).await?
    }

    /// The findings of a DICOM measurement report or a segmentation that this program wrote about the patient of a case. A segmentation has no
    /// dismissed findings, and neither has unconfirmed ones: those of the case stay.
    ///
    /// # Errors
    /// [`NotReplaced::Elsewhere`] if it is about another patient or place, also if its images were corrected or rejected since, or its case is not here; a failure that states what is wrong with the file.
    pub async fn findings_of_dicom(
        &self,
        id: &CaseId,
        file: Bytes,
    ) -> Result<Vec<Finding>, NotReplaced> {
        let source = self.store().source_dicom(id).await?;
        let source = source.ok_or(NotReplaced::Elsewhere(
            "the case was not created from DICOM, so its patient is not known; send the findings as JSON",
        ))?;
        let source = pipeline::attributes(&source).map_err(Error::from)?;
        let file = self.store().spools().of(file).await?;
        let MarkedPatient {
            patient,
            frame_of_reference,
            marks,
            has_dismissed,
        } = self.headers.read_marks(&file).await?;
        let known = Patient::of(|keyword| source.value(keyword));
        let stated = Patient::of(|keyword| {
            let mut stated = patient.iter();
            let found = stated.find(|(name, _)| name == keyword)?;
            Some(found.1.as_str())
        });
        if !known.is_stated() || known != stated {
            return Err(NotReplaced::Elsewhere(
                "the file is about another patient than the case",
            ));
        }
        let own_frame = source.value("FrameOfReferenceUID").map_or("", str::trim);
        if !marks.is_empty() && frame_of_reference != own_frame {
            return Err(NotReplaced::Elsewhere(
                "the findings of the file lie in another frame of reference than the case",
            ));
        }
        let mut named: Vec<_> = marks
            .iter()
            .filter_map(|mark| mark.case.as_deref())
            .collect();
        named.dedup();
        for marked_in in named.into_iter().filter_map(CaseId::parse) {
            if marked_in == *id {
                continue;
            }
            let Some(other) = self.store().case(&marked_in).await? else {
                return Err(NotReplaced::Elsewhere(
                    "the case in which the findings of the file were marked is not here, so it is not known whether its images lie where those \
                     of this case lie; mark them again",
                ));
            };
            if other.closed.is_some() || self.differ(id, &marked_in).await? {
                return Err(NotReplaced::Elsewhere(
                    "the findings of the file were marked in images that the PACS has corrected or rejected since, or that differ from those of \
                     this case, so that left and right may be exchanged; mark them again, or take them over from that case",
                ));
            }
        }
        let numbered = marks.into_iter().enumerate();
        let findings = numbered.map(|(number, mark)| of_mark(mark, number));
        let mut findings: Vec<_> = findings
            .collect::<Result<_, _>>()
            .map_err(NotReplaced::Refused)?;
        // A segmentation has what is kept alone; a report has the commissures and what is dismissed, too.
        let is_in_no_file = |one: &Finding| {
            let is_in_report = one.is_dismissed || one.states_axes();
            one.is_unconfirmed || (is_in_report && !has_dismissed)
        };
        let here = self.findings(id).await?.list.into_iter();
        let kept = here
            .filter(|one| is_in_no_file(one) && findings.iter().all(|other| other.id != one.id));
        let kept: Vec<_> = kept.collect();
        findings.extend(kept);
        Ok(findings)
    }
}

impl Cases {
    /// Whether two cases were made of different images with the same UID.
    async fn differ(&self, one: &CaseId, other: &CaseId) -> Result<bool, StoreError> {
        let mut connection = self.store().connect().await?;
        let images = made::of(&mut connection, &Made::case(one)).await?;
        let others = made::of(&mut connection, &Made::case(other)).await?;
        let others: HashMap<_, _> = others.iter().map(|image| (&image.uid, image)).collect();
        Ok(images.iter().any(|image| {
            let other = others.get(&image.uid);
            other.is_some_and(|other| !other.fingerprint.is_same(&image.fingerprint))
        }))
    }
}

/// Findings as labels of voxels.
#[derive(Debug, Clone)]
pub struct FindingLabels {
    /// That of the acquired volume.
    pub grid: Grid,
    /// The number of a finding for each voxel, or 0.
    pub labels: Vec<u16>,
    /// The findings with the numbers that page and report give them.
    pub findings: Vec<(u16, Finding)>,
}

/// The name of a label: what the reader called it, or its id.
pub fn name_of(finding: &Finding) -> &str {
    match &*finding.label {
        "" => &finding.id,
        label => label,
    }
}

fn paint(labels: &mut [u16], grid: &Grid, number: u16, finding: &Finding) {
    let Some(mask) = voxels_of(finding, grid) else {
        return;
    };
    // A block of the grid has the same voxels, shifted.
    let first = grid.first_of(mask.grid()).map(|index| index as usize);
    for (index, _) in mask.voxels().iter().enumerate().filter(|(_, is)| **is) {
        let voxel = mask.grid().voxel(index);
        labels[grid.index([0, 1, 2].map(|axis| first[axis] + voxel[axis]))] = number;
    }
}

/// The finding that a file states.
fn of_mark(mark: Mark, number: usize) -> Result<Finding, FindingRefused> {
    let unknown = |member: &str| FindingRefused {
        path: format!("findings[{number}].{member}"),
        detail: "is a word that this version does not know".to_owned(),
    };
    let word = |text: &str| serde_json::Value::String(text.to_owned());
    let kind = serde_json::from_value(word(&mark.kind)).map_err(|_| unknown("kind"))?;
    let certainty = mark.certainty.as_deref().map(word);
    let certainty = certainty.map(serde_json::from_value).transpose();
    let from_map = mark.from_map.as_deref().map(|name| {
        let known = MapName::from_name(name);
        known.ok_or_else(|| unknown("from_map"))
    });
    Ok(Finding {
        id: mark.id,
        kind,
        points_in_patient: mark.points_in_patient,
        depth_mm: mark.depth_mm,
        label: mark.label,
        note: mark.note,
        certainty: certainty.map_err(|_| unknown("certainty"))?,
        colour: mark.colour,
        from_map: from_map.transpose()?,
        is_dismissed: mark.is_dismissed,
        is_unconfirmed: false,
        author: mark.author,
        side: None,
        gyrus: None,
        standard: None,
        created_at: None,
        changed_at: None,
    })
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
}
