//! The heads of a study: of each series one version for each of its patients, in the order in which a link to the study prefers them.

use case::{Case, CaseState};
use storage::StoreError;
use storage::arrivals::{CaseSeries, SeriesQuery, SeriesUids};

use super::Patient;
use crate::application::Cases;

/// Values of Contrast/Bolus Agent that state that there was none.
const NO_AGENT: [&str; 4] = ["", "NO", "NONE", "N"];

/// A series that became a case.
#[derive(Debug, Clone)]
pub struct Head {
    pub case: Case,
    /// Its series and study.
    pub series: CaseSeries,
    /// The attributes of the source by keyword, which are patient data; none if they are damaged.
    pub attributes: Vec<(String, String)>,
}

impl Head {
    /// The value of an attribute, unless it is empty.
    pub fn value(&self, keyword: &str) -> Option<&str> {
        let mut attributes = self.attributes.iter();
        let found = attributes.find(|(name, value)| name == keyword && !value.is_empty());
        found.map(|(_, value)| value.as_str())
    }

    /// The patient; `None` if the attributes are damaged.
    pub fn patient(&self) -> Option<Patient> {
        let is_known = !self.attributes.is_empty();
        is_known.then(|| Patient::of(|keyword| self.value(keyword)))
    }

    /// Whether it was computed from other images.
    pub fn is_derived(&self) -> bool {
        let kind = self
            .value("ImageType")
            .and_then(|text| text.split('\\').next());
        kind.is_some_and(|kind| kind.trim().eq_ignore_ascii_case("DERIVED"))
    }

    /// Whether a contrast agent was given.
    pub fn has_contrast(&self) -> bool {
        let agent = self.value("ContrastBolusAgent").unwrap_or_default();
        !NO_AGENT.contains(&&*agent.trim().to_ascii_uppercase())
    }

    /// The sides of a voxel in mm, which are known when the case is ready.
    pub fn voxel_mm(&self) -> Option<[f64; 3]> {
        self.case
            .facts
            .as_ref()
            .map(|facts| facts.native_spacing_mm)
    }

    /// When it was acquired, as far as the source states it: digits that sort by time.
    pub fn acquired(&self) -> Option<String> {
        let joined = |day, time| {
            let time = self.value(time).unwrap_or_default();
            Some(format!("{}{time}", self.value(day)?))
        };
        let moment = self.value("AcquisitionDateTime").map(str::to_owned);
        moment
            .or_else(|| joined("AcquisitionDate", "AcquisitionTime"))
            .or_else(|| joined("SeriesDate", "SeriesTime"))
    }

    /// Sorts heads as a link prefers them: original before derived, without a contrast agent before with one, finer
    /// before coarser, then the earlier acquisition. When they came does not count, so that the same link opens the same
    /// head. A case whose voxels are not known yet may turn out to be the finest, and a failed one comes last.
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
        let is_failed = self.case.state == CaseState::Failed;
        (
            is_failed,
            self.is_derived(),
            self.has_contrast(),
            volume,
            last,
        )
    }
}

/// The version of each series and patient that counts. They come newest first, and within a state, the newest stays first.
/// If a correction is still prepared, or failed, the picture from before it is not shown in its place. Neither is an upload shown in the
/// place of what a PACS has sent, unless that failed. A damaged source states no patient, so it is a version of nothing else.
fn one_of_each_series(mut versions: Vec<Head>) -> Vec<Head> {
    let is_failed = |head: &Head| head.case.state == CaseState::Failed;
    let is_ready = |head: &Head| head.case.state == CaseState::Ready;
    versions.retain(|head| head.series.superseded.is_none());
    versions.sort_by_key(|head| (is_failed(head), !head.series.is_received, !is_ready(head)));
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

impl Cases {
    /// The heads that a query finds, the preferred one first, those that failed last. Of each series and patient this is the
    /// newest version that is ready, or else the newest that has not failed; what a PACS has sent comes before an upload. Superseded versions
    /// do not count, even if nothing else is left.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn heads(&self, query: &SeriesQuery) -> Result<Vec<Head>, StoreError> {
        let mut versions = Vec::new();
        let all = self.store().cases_of(query).await?;
        for series in all.into_iter().filter(|series| series.superseded.is_none()) {
            let Some(case) = self.store().case(&series.case).await? else {
                continue;
            };
            let stored = self.attributes_of(&case.id).await?;
            let attributes = stored.map(|stored| stored.attributes).unwrap_or_default();
            versions.push(Head {
                case,
                series,
                attributes,
            });
        }
        let mut heads = one_of_each_series(versions);
        heads.sort_by_cached_key(Head::rank);
        Ok(heads)
    }
}

#[cfg(test)]
mod tests {
    use case::arrivals::Superseded;
    use case::{CaseId, Parameters};
    use storage::arrivals::Uid;
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
                superseded: None,
                kept: false,
                expires_at: None,
            },
            series: CaseSeries {
                case: id,
                uids: SeriesUids {
                    study: uid("1.2"),
                    series: uid(series),
                },
                accession_number: None,
                patient: None,
                superseded: None,
                is_received: true,
            },
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
    fn a_correction_that_is_still_prepared_comes_before_the_version_that_it_replaces() {
        use CaseState::{Failed, Preparing, Queued, Ready};
        let version = |number: u8, state, superseded| {
            let mut head = head("1.1", 1.0, &[]);
            head.case.id = CaseId::parse(&format!("{number:032}")).unwrap();
            head.case.state = state;
            head.series.case = head.case.id;
            head.series.superseded = superseded;
            head
        };
        let counts = |newest_first: &[(u8, CaseState, Option<Superseded>)]| {
            let versions = newest_first.iter();
            let versions = versions.map(|&(number, state, why)| version(number, state, why));
            let [head] = &one_of_each_series(versions.collect())[..] else {
                panic!("one series has one version that counts");
            };
            (head.case.id)
                .to_string()
                .trim_start_matches('0')
                .parse::<u8>()
                .unwrap()
        };
        let replaced = Some(Superseded::NewerVersion);
        for state in [Queued, Preparing, Ready, Failed] {
            let versions = [(2, state, None), (1, Ready, replaced)];
            assert_eq!(counts(&versions), 2, "{state:?}");
        }
        // The correction was taken back.
        assert_eq!(counts(&[(2, Ready, replaced), (1, Preparing, None)]), 1);
        // A version with another mask replaces nothing: what can be seen comes first, then the newest.
        assert_eq!(counts(&[(2, Preparing, None), (1, Ready, None)]), 1);
        assert_eq!(counts(&[(2, Ready, None), (1, Ready, None)]), 2);
        assert_eq!(counts(&[(2, Failed, None), (1, Preparing, None)]), 1);
        // The correction was deleted: what it replaced does not come back.
        let left = vec![version(1, Ready, replaced)];
        assert!(one_of_each_series(left).is_empty());
    }

    #[test]
    fn an_upload_takes_the_place_of_no_image_from_a_pacs_and_no_patient_that_of_another() {
        let of = |patient, is_received, state| {
            let mut head = head("1.1", 1.0, &[("PatientID", patient)]);
            head.series.is_received = is_received;
            head.case.state = state;
            head
        };
        let counts = |newest_first: Vec<Head>| -> Vec<(String, bool)> {
            let heads = one_of_each_series(newest_first).into_iter();
            let patient = |head: &Head| head.value("PatientID").unwrap_or_default().to_owned();
            heads
                .map(|head| (patient(&head), head.series.is_received))
                .collect()
        };
        use CaseState::{Failed, Preparing, Ready};
        let received = |patient: &str| (patient.to_owned(), true);
        let uploaded = |patient: &str| (patient.to_owned(), false);
        for state in [Preparing, Ready] {
            let one = counts(vec![of("A", false, Ready), of("A", true, state)]);
            assert_eq!(one, [received("A")], "{state:?}");
        }
        let failed = counts(vec![of("A", false, Ready), of("A", true, Failed)]);
        assert_eq!(failed, [uploaded("A")]);
        let two = counts(vec![of("B", false, Ready), of("A", true, Ready)]);
        assert_eq!(two, [received("A"), uploaded("B")]);
    }
}
