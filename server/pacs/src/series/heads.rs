//! The heads of a study: of each series one version for each of its patients, in the order in which a link to the study prefers them.

use std::cmp::Reverse;

use case::series::{CaseSeries, SeriesQuery, SeriesUids};
use case::{Case, CaseState};
use cases::Patient;
use storage::StoreError;
use storage::tables::series::cases_of;

use super::Arrivals;

/// Values of Contrast/Bolus Agent that state that there was none.
const NO_AGENT: [&str; 4] = ["", "NO", "NONE", "N"];

/// A series that became a case.
#[derive(Debug, Clone)]
pub(crate) struct Head {
    pub(crate) case: Case,
    /// Its series and study.
    pub(crate) series: CaseSeries,
    /// How many slices it was made of.
    pub(crate) images: usize,
    /// The attributes of the source by keyword, which are patient data; none if they are damaged.
    pub(crate) attributes: Vec<(String, String)>,
}

impl Head {
    /// The value of an attribute, unless it is empty.
    pub(crate) fn value(&self, keyword: &str) -> Option<&str> {
        let mut attributes = self.attributes.iter();
        let found = attributes.find(|(name, value)| name == keyword && !value.is_empty());
        found.map(|(_, value)| value.as_str())
    }

    /// The patient; `None` if the attributes are damaged.
    pub(crate) fn patient(&self) -> Option<Patient> {
        let is_known = !self.attributes.is_empty();
        is_known.then(|| Patient::of(|keyword| self.value(keyword)))
    }

    /// Whether it was computed from other images.
    pub(crate) fn is_derived(&self) -> bool {
        let kind = self
            .value("ImageType")
            .and_then(|text| text.split('\\').next());
        kind.is_some_and(|kind| kind.trim().eq_ignore_ascii_case("DERIVED"))
    }

    /// Whether a contrast agent was given.
    pub(crate) fn has_contrast(&self) -> bool {
        let agent = self.value("ContrastBolusAgent").unwrap_or_default();
        !NO_AGENT.contains(&&*agent.trim().to_ascii_uppercase())
    }

    /// The sides of a voxel in mm, which are known when the case is ready.
    pub(crate) fn voxel_mm(&self) -> Option<[f64; 3]> {
        self.case
            .facts
            .as_ref()
            .map(|facts| facts.native_spacing_mm)
    }

    /// When it was acquired, as far as the source states it: digits that sort by time.
    pub(crate) fn acquired(&self) -> Option<String> {
        let joined = |day, time| {
            let time = self.value(time).unwrap_or_default();
            Some(format!("{}{time}", self.value(day)?))
        };
        let moment = self.value("AcquisitionDateTime").map(str::to_owned);
        moment
            .or_else(|| joined("AcquisitionDate", "AcquisitionTime"))
            .or_else(|| joined("SeriesDate", "SeriesTime"))
    }

    /// Whether it is opened only if there is nothing else: it failed, or somebody put it into the trash.
    fn is_set_aside(&self) -> bool {
        self.case.state == CaseState::Failed || self.case.trashed
    }

    /// The order in which a link prefers heads: original images before derived ones, images without a contrast agent before
    /// images with one, smaller voxels before larger ones, and then the earlier acquisition. The time of arrival does not count,
    /// so that a link always opens the same head. A case with unknown voxels counts as the finest. A case that failed or
    /// is in the trash comes last.
    fn rank(&self) -> impl Ord + use<> {
        let volume_mm3: f64 = self.voxel_mm().map_or(0.0, |sides| sides.iter().product());
        // Voxels of one protocol differ by rounding errors.
        let volume = (volume_mm3 * 1000.0).round() as u64;
        let acquired = self.acquired();
        let number = self
            .value("SeriesNumber")
            .and_then(|text| text.parse::<i64>().ok());
        let last = (
            acquired.is_none(),
            acquired,
            number,
            self.series.uids.clone(),
        );
        (
            self.is_set_aside(),
            self.is_derived(),
            self.has_contrast(),
            volume,
            last,
        )
    }
}

/// The version of each series and patient that counts: the one with most images, then the newest, and what failed or is in the trash last. They come
/// newest first; of the same images, what can be seen is preferred. A damaged source states no patient, so it is a version of nothing else.
fn one_of_each_series(mut versions: Vec<Head>) -> Vec<Head> {
    let is_ready = |head: &Head| head.case.state == CaseState::Ready;
    versions.sort_by_key(|head| (head.is_set_aside(), Reverse(head.images), !is_ready(head)));
    let mut seen: Vec<(SeriesUids, Option<Patient>)> = Vec::new();
    versions.retain(|head| {
        let version_of = (head.series.uids.clone(), head.patient());
        let is_first = !seen.contains(&version_of);
        if is_first {
            seen.push(version_of);
        }
        is_first
    });
    versions
}

impl Arrivals {
    /// The heads that a query finds, the preferred one first, what failed or is in the trash last. Of each series and patient this is the open case with
    /// most images, then the newest. Closed ones do not count, even if nothing else is left.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub(crate) async fn heads(&self, query: &SeriesQuery) -> Result<Vec<Head>, StoreError> {
        let mut versions = Vec::new();
        let all = cases_of(&mut self.cases.store().connect().await?, query).await?;
        for (case, series) in all {
            let case = self.cases.store().case(&case).await?;
            let Some(case) = case.filter(|case| case.closed.is_none()) else {
                continue;
            };
            let stored = self
                .cases
                .attributes_of(&case.id)
                .await?
                .unwrap_or_default();
            versions.push(Head {
                case,
                series,
                images: stored.instances.len(),
                attributes: stored.attributes,
            });
        }
        let mut heads = one_of_each_series(versions);
        heads.sort_by_cached_key(Head::rank);
        Ok(heads)
    }
}

#[cfg(test)]
mod tests {
    use case::series::Uid;
    use case::{CaseId, Parameters};
    use storage::testing::facts;

    use super::*;

    fn head(series: &str, voxel_mm: f64, attributes: &[(&str, &str)]) -> Head {
        let id = CaseId::parse(&"0".repeat(32)).unwrap();
        let uid = |text: &str| Uid::parse(text).unwrap();
        let mut facts = facts();
        facts.native_spacing_mm = [voxel_mm; 3];
        let time = jiff::Timestamp::UNIX_EPOCH;
        Head {
            case: Case {
                id,
                parameters: Parameters::default(),
                state: CaseState::Ready,
                progress: None,
                failure: None,
                facts: (voxel_mm > 0.0).then_some(facts),
                previous: None,
                next: Vec::new(),
                created_at: time,
                uploaded_at: time,
                closed: None,
                kept: false,
                trashed: false,
                expires_at: None,
            },
            series: CaseSeries {
                uids: SeriesUids {
                    study: uid("1.2"),
                    series: uid(series),
                },
                accession_number: None,
                patient: None,
            },
            images: 10,
            attributes: attributes
                .iter()
                .map(|&(name, value)| (name.to_owned(), value.to_owned()))
                .collect(),
        }
    }

    #[test]
    fn original_fine_images_without_contrast_come_first_then_the_earlier_acquisition() {
        let derived = ("ImageType", "DERIVED\\SECONDARY\\MPR");
        let original = ("ImageType", "ORIGINAL\\PRIMARY");
        let [first, second] = ["20260101", "20260102"].map(|day| ("AcquisitionDate", day));
        let mut heads = [
            head("1.1", 1.0, &[derived, first]),
            head("1.2", 1.0, &[original, ("ContrastBolusAgent", "Gadovist")]),
            head("1.3", 1.0, &[second, ("AcquisitionTime", "101112")]),
            head("1.4", 1.0, &[second, ("AcquisitionTime", "091112")]),
            head("1.5", 1.0, &[]),
            head(
                "1.6",
                1.0000001,
                &[
                    ("ContrastBolusAgent", "none"),
                    ("AcquisitionDateTime", "20260101"),
                ],
            ),
            head("1.7", 0.8, &[second, ("AcquisitionTime", "235959")]),
        ];
        heads.sort_by_cached_key(Head::rank);
        let names = heads
            .each_ref()
            .map(|head| head.series.uids.series.as_str());
        assert_eq!(names, ["1.7", "1.6", "1.4", "1.3", "1.5", "1.2", "1.1"]);
        // A case that is still prepared may turn out to be the finest.
        heads[3].case.facts = None;
        heads.sort_by_cached_key(Head::rank);
        assert_eq!(heads[0].series.uids.series.as_str(), "1.3");
    }

    #[test]
    fn the_version_with_most_images_counts_then_the_newest_that_can_be_seen() {
        use CaseState::{Failed, Preparing, Ready};
        let version = |number: u8, state, images| {
            let mut head = head("1.1", 1.0, &[("PatientID", "A")]);
            head.case.id = CaseId::parse(&format!("{number:032}")).unwrap();
            head.case.state = state;
            head.images = images;
            head
        };
        let counts = |newest_first: &[(u8, CaseState, usize)]| {
            let versions = newest_first.iter();
            let versions = versions.map(|&(number, state, images)| version(number, state, images));
            let [head] = &one_of_each_series(versions.collect())[..] else {
                panic!("one series has one version that counts");
            };
            let id = head.case.id.to_string();
            id.trim_start_matches('0').parse::<u8>().unwrap()
        };
        assert_eq!(counts(&[(2, Preparing, 12), (1, Ready, 10)]), 2);
        assert_eq!(counts(&[(2, Ready, 10), (1, Ready, 12)]), 1);
        assert_eq!(counts(&[(2, Ready, 10), (1, Ready, 10)]), 2);
        // Another mask of the same images.
        assert_eq!(counts(&[(2, Preparing, 10), (1, Ready, 10)]), 1);
        assert_eq!(counts(&[(2, Failed, 12), (1, Preparing, 10)]), 1);
        let mut in_trash = version(2, Ready, 12);
        in_trash.case.trashed = true;
        let [head] = &one_of_each_series(vec![in_trash, version(1, Preparing, 10)])[..] else {
            panic!("one series has one version that counts");
        };
        assert!(!head.case.trashed);
        let mut of_another = version(2, Ready, 10);
        of_another.attributes[0].1 = "B".to_owned();
        let both = one_of_each_series(vec![of_another, version(1, Ready, 10)]);
        assert_eq!(both.len(), 2);
    }
}
