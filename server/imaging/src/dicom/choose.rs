//! Groups files by series and chooses the series to read.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::DicomError;
use super::header::{Hints, Image, Modality};
use super::pet;
use super::series::{SeriesSummary, token_of};

/// The fewest slices of a volume.
pub(super) const FEWEST_SLICES: usize = 3;

/// A three-dimensional acquisition of a head has at least this many slices.
const SLICES_OF_A_HEAD: usize = 60;

/// What a series is read for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Purpose {
    /// The volume of a case: a T1 is preferred.
    #[default]
    Case,
    /// A further volume of the same head, of any kind.
    Layer,
}

/// Names a series: by its instance UID, its number, or its token.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SeriesName(String);

impl SeriesName {
    /// The longest name, which is the length of a UID.
    pub const MAX_LENGTH: usize = 64;

    /// A name of hexadecimal digits, points and hyphens; `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let allowed = |c: char| c.is_ascii_hexdigit() || c == '.' || c == '-';
        let fits = (1..=Self::MAX_LENGTH).contains(&text.len());
        (fits && text.chars().all(allowed)).then(|| Self(text.to_owned()))
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    fn names(&self, series: &Series) -> bool {
        self.0 == series.uid || self.numbers(series) || token_of(&series.uid) == self.0
    }

    /// Whether it is the number of a series.
    fn numbers(&self, series: &Series) -> bool {
        let number = series.images[0].series_number;
        number.is_some_and(|number| number.to_string() == self.0)
    }
}

/// The images of one series.
#[derive(Debug)]
pub(super) struct Series {
    uid: String,
    pub(super) images: Vec<Image>,
}

impl Series {
    pub(super) fn summary(&self) -> SeriesSummary {
        let first = &self.images[0];
        let [columns, rows] = match &first.format {
            Ok(format) => [format.columns, format.rows],
            Err(_) => [0, 0],
        };
        SeriesSummary {
            number: first.series_number,
            modality: first.modality.name().to_owned(),
            name: self.name().to_owned(),
            unit: self.unit().map(|(unit, _)| unit.to_owned()),
            size: [columns, rows, self.slices()],
            is_volume: self.could_be_a_volume(),
            token: self.token(),
        }
    }

    /// Eight hexadecimal digits that name it.
    pub(super) fn token(&self) -> String {
        token_of(&self.uid)
    }

    /// Drops images that were sent a second time in another encoding: `is_same` tells so of two with the same UID.
    ///
    /// # Errors
    /// Those of `is_same`.
    pub(super) fn drop_copies(
        &mut self,
        mut is_same: impl FnMut(&Image, &Image) -> Result<bool, DicomError>,
    ) -> Result<(), DicomError> {
        let mut kept: Vec<Image> = Vec::new();
        // Images with the same UID are neighbours.
        for image in std::mem::take(&mut self.images) {
            let uid = &image.sop_instance_uid;
            let mut earlier = kept
                .iter()
                .rev()
                .take_while(|one| one.sop_instance_uid == *uid);
            let is_copy = !uid.is_empty()
                && earlier.try_fold(false, |found, one| {
                    Ok::<_, DicomError>(found || is_same(one, &image)?)
                })?;
            if !is_copy {
                kept.push(image);
            }
        }
        self.images = kept;
        Ok(())
    }

    /// Whether it is an MR series whose names or timing indicate a T1-weighted image.
    pub(super) fn is_t1(&self) -> bool {
        let first = &self.images[0];
        first.modality == Modality::Mr && is_t1(&first.hints)
    }

    /// The unit of the values, if the header states it, and the factor that they must be multiplied by.
    pub(super) fn unit(&self) -> Option<(&'static str, f64)> {
        match self.images[0].modality {
            Modality::Mr => None,
            Modality::Ct => Some(("HU", 1.0)),
            Modality::Pt => {
                let headers: Option<Vec<_>> =
                    self.images.iter().map(|image| image.pet.as_ref()).collect();
                pet::unit_of(&headers?)
            }
        }
    }

    /// The kind of the sequence, as far as its header tells.
    fn name(&self) -> &'static str {
        let first = &self.images[0];
        match first.modality {
            Modality::Ct => "CT",
            Modality::Pt => "PET",
            Modality::Mr => kind_of(&first.hints),
        }
    }

    pub(super) fn is_pet(&self) -> bool {
        self.images[0].modality == Modality::Pt
    }

    fn slices(&self) -> usize {
        let frames = |image: &Image| image.frames.as_ref().map_or(1, Vec::len);
        self.images.iter().map(frames).sum()
    }

    fn could_be_a_volume(&self) -> bool {
        // What cannot be read may be the very series that is meant.
        let is_sound = |error: Option<&DicomError>| match error {
            None | Some(DicomError::Value { .. }) => true,
            Some(_) => false,
        };
        let usable = |image: &Image| {
            is_sound(image.format.as_ref().err())
                && is_sound(image.frames.as_ref().err())
                && !image.mosaic
        };
        self.slices() >= FEWEST_SLICES
            && self.images.iter().all(usable)
            && !self.images[0].hints.is_secondary
    }

    /// Whether the header states a three-dimensional acquisition, or there are enough slices for one.
    fn is_3d(&self) -> bool {
        self.images[0].hints.is_3d || self.slices() >= SLICES_OF_A_HEAD
    }
}

/// Groups images by series, in the order of their numbers. A file that was sent twice counts once.
pub(super) fn group(images: Vec<Image>) -> Vec<Series> {
    let mut by_uid: BTreeMap<String, Vec<Image>> = BTreeMap::new();
    for image in images {
        by_uid
            .entry(image.series_uid.clone())
            .or_default()
            .push(image);
    }
    let series = |(uid, mut images): (String, Vec<Image>)| {
        let name = |image: &Image| {
            (
                image.sop_instance_uid.clone(),
                *image.file_digest.as_bytes(),
            )
        };
        images.sort_by_cached_key(name);
        images.dedup_by_key(|image| name(image));
        Series { uid, images }
    };
    let mut all: Vec<Series> = by_uid.into_iter().map(series).collect();
    all.sort_by_key(|series| series.images[0].series_number);
    all
}

/// The series with the given name, or the one chosen without a name, and the others.
///
/// Without a name this is, for a case, the only three-dimensional T1-like series that is no PET; if none is T1-like,
/// the only three-dimensional series; if there is none either, the only series. For a layer it is the only series.
pub(super) fn choose(
    mut all: Vec<Series>,
    name: Option<&SeriesName>,
    purpose: Purpose,
) -> Result<(Series, Vec<SeriesSummary>), DicomError> {
    let summaries = |all: &[Series]| all.iter().map(Series::summary).collect();
    let chosen = match name {
        Some(name) => {
            let named: Vec<usize> = indices(&all, |series| name.names(series));
            match named[..] {
                [only] => only,
                [first, ..]
                    if all.iter().any(|series| name.numbers(series))
                        && are_scattered(&all, &named) =>
                {
                    // From the last on, so that the first stays where it is.
                    for &other in named[1..].iter().rev() {
                        let joined = all.remove(other).images;
                        all[first].images.extend(joined);
                    }
                    all[first]
                        .images
                        .sort_by(|a, b| a.sop_instance_uid.cmp(&b.sop_instance_uid));
                    first
                }
                _ => {
                    return Err(DicomError::NoSuchSeries {
                        found: summaries(&all),
                    });
                }
            }
        }
        None if all.len() == 1 => 0,
        None => meant(&all, purpose)?,
    };
    let chosen = all.remove(chosen);
    Ok((chosen, summaries(&all)))
}

/// Whether some series could be the slices of one: each has one image, of the same size and number.
fn are_scattered(all: &[Series], those: &[usize]) -> bool {
    let kind = |&index: &usize| {
        let series = &all[index];
        let image = &series.images[0];
        let size = image.format.as_ref().ok()?;
        let is_single = series.slices() == 1;
        is_single.then_some((
            image.series_number?,
            size.columns,
            size.rows,
            image.modality,
        ))
    };
    let Some(first) = those.first().and_then(kind) else {
        return false;
    };
    those.len() >= FEWEST_SLICES && those.iter().all(|index| kind(index) == Some(first))
}

fn indices(all: &[Series], holds: impl Fn(&Series) -> bool) -> Vec<usize> {
    (0..all.len()).filter(|&index| holds(&all[index])).collect()
}

fn meant(all: &[Series], purpose: Purpose) -> Result<usize, DicomError> {
    let volumes = indices(all, Series::could_be_a_volume);
    if volumes.is_empty() {
        let every: Vec<usize> = (0..all.len()).collect();
        if let (true, Some(number)) = (are_scattered(all, &every), all[0].images[0].series_number) {
            return Err(DicomError::SeriesScattered {
                series: all.len(),
                number,
            });
        }
        return Err(DicomError::NoVolume {
            found: all.iter().map(Series::summary).collect(),
        });
    }
    let narrowed = |among: &[usize], holds: &dyn Fn(&Series) -> bool| -> Vec<usize> {
        let kept = among.iter().copied().filter(|&index| holds(&all[index]));
        kept.collect()
    };
    let mut candidates = volumes;
    let of_case: [&dyn Fn(&Series) -> bool; 3] =
        [&|series| !series.is_pet(), &Series::is_3d, &Series::is_t1];
    let preferences = match purpose {
        Purpose::Case => &of_case[..],
        Purpose::Layer => &[],
    };
    for &prefers in preferences {
        let preferred = narrowed(&candidates, prefers);
        if !preferred.is_empty() {
            candidates = preferred;
        }
    }
    match candidates[..] {
        [only] => Ok(only),
        _ => Err(DicomError::SeveralSeries {
            candidates: candidates
                .iter()
                .map(|&index| all[index].summary())
                .collect(),
        }),
    }
}

/// Parts of the names that scanners give to sequences, besides the words above.
const SEQUENCE_PARTS: [&str; 14] = [
    "fl3d", "fl2d", "tse", "fse", "se2d", "se3d", "gre", "spc", "tir", "qst", "ep2d", "mr3d", "3d",
    "2d",
];

/// How many letters a scanner's name of a sequence may have besides its known parts, as in `*tfl3d1_16ns`.
const FURTHER_LETTERS: usize = 3;

/// The scanner's name at the beginning of Sequence Name, such as `*tfl3d1`. Other words may be typed, and name somebody.
pub fn sequence_name(text: &str) -> Option<&str> {
    let mut words = text.split(|letter: char| letter.is_whitespace() || letter == '\\');
    let word = words.find(|word| !word.is_empty())?;
    let parts = T1_WORDS.iter().chain(&OTHER_WORDS).chain(&SEQUENCE_PARTS);
    let mut rest = word.to_lowercase();
    for part in parts {
        rest = rest.replace(part, "");
    }
    let further = rest.chars().filter(|letter| letter.is_alphabetic()).count();
    let is_known = rest.len() < word.len() && further <= FURTHER_LETTERS;
    (is_known && word.is_ascii() && word.len() <= 16).then_some(word)
}

/// The least echo time of a T2-weighted image, in ms.
const T2_ECHO_MS: f64 = 60.0;

/// Words of the names of T1-weighted series.
pub(super) const T1_WORDS: [&str; 12] = [
    "t1", "mprage", "mp-rage", "mp2rage", "spgr", "bravo", "tfl", "tfe", "vibe", "flash", "ffe",
    "ir-fspgr",
];

/// Words of the names of other series.
pub(super) const OTHER_WORDS: [&str; 22] = [
    "t2",
    "flair",
    "dwi",
    "dti",
    "diff",
    "adc",
    "swi",
    "swan",
    "tof",
    "angio",
    "mra",
    "phase",
    "field",
    "asl",
    "perf",
    "bold",
    "epi",
    "localizer",
    "scout",
    "pd_",
    "ciss",
    "mip",
];

/// Whether names or timing indicate a T1-weighted image.
fn is_t1(hints: &Hints) -> bool {
    let named = |words: &[&str]| words.iter().any(|word| hints.names.contains(word));
    if named(&OTHER_WORDS) {
        return false;
    }
    let short = |time: Option<f64>, limit| time.is_some_and(|time| time > 0.0 && time < limit);
    let inverted = hints
        .inversion_ms
        .is_some_and(|time| (300.0..1400.0).contains(&time));
    let timed = short(hints.echo_ms, 12.0) && (short(hints.repetition_ms, 60.0) || inverted);
    named(&T1_WORDS) || timed
}

/// Whether its times suppress fluid in a T2-weighted image.
fn is_flair_timed(hints: &Hints) -> bool {
    let inverted = hints
        .inversion_ms
        .is_some_and(|time| (1500.0..3500.0).contains(&time));
    inverted && hints.echo_ms.is_some_and(|time| time >= T2_ECHO_MS)
}

/// Whether its times give a T2-weighted image, whose fluid is bright.
fn is_t2_timed(hints: &Hints) -> bool {
    let is_inverted = hints.inversion_ms.is_some_and(|time| time > 0.0);
    let at_least = |time: Option<f64>, least| time.is_some_and(|time| time >= least);
    !is_inverted && at_least(hints.echo_ms, T2_ECHO_MS) && at_least(hints.repetition_ms, 2000.0)
}

/// Whether its times give a T1-weighted image although it is called a FLAIR.
fn is_t1_flair(hints: &Hints) -> bool {
    let below = |time: Option<f64>, limit| time.is_some_and(|time| time > 0.0 && time < limit);
    below(hints.echo_ms, 40.0) && below(hints.inversion_ms, 1400.0)
}

/// The kind of an MR sequence, from the names that the scanner and its user gave it, and from its times.
fn kind_of(hints: &Hints) -> &'static str {
    const KINDS: [(&str, &[&str]); 8] = [
        ("FLAIR", &["flair", "dark-fluid", "dark_fluid", "darkfluid"]),
        ("DWI", &["dwi", "dti", "diff", "adc"]),
        ("SWI", &["swi", "swan"]),
        ("TOF", &["tof", "angio", "mra"]),
        ("ASL", &["asl", "perf"]),
        ("EPI", &["bold", "ep2d", "epi_"]),
        ("T2", &["t2", "ciss"]),
        ("PD", &["pd_"]),
    ];
    let named = |words: &[&str]| words.iter().any(|word| hints.names.contains(word));
    let found = KINDS.iter().find(|(_, words)| named(words));
    match found {
        Some(("FLAIR", _)) if is_t1_flair(hints) => "T1",
        Some(("T2", _)) if is_flair_timed(hints) => "FLAIR",
        Some((kind, _)) => kind,
        None if is_t1(hints) => "T1",
        None if is_flair_timed(hints) => "FLAIR",
        None if is_t2_timed(hints) => "T2",
        None => "MR",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hints(names: &str, times: [f64; 3]) -> Hints {
        let [repetition_ms, echo_ms, inversion_ms] = times.map(Some);
        Hints {
            names: names.to_owned(),
            repetition_ms,
            echo_ms,
            inversion_ms,
            ..Hints::default()
        }
    }

    #[test]
    fn a_t1_is_recognised_by_its_name_or_its_timing() {
        assert!(is_t1(&hints("t1_mprage_sag", [2300.0, 2.98, 900.0])));
        assert!(is_t1(&hints("series 5", [2300.0, 2.98, 900.0])));
        assert!(is_t1(&hints("ax 3d", [8.0, 3.0, 0.0])));
        assert!(!is_t1(&hints("t2_space_flair", [5000.0, 390.0, 1800.0])));
        assert!(!is_t1(&hints("ax", [3000.0, 90.0, 0.0])));
        assert!(!is_t1(&hints("tof_3d", [22.0, 3.4, 0.0])));
    }

    #[test]
    fn a_sequence_is_called_by_its_kind() {
        let kind = |names| kind_of(&hints(names, [0.0; 3]));
        assert_eq!(kind("t2_space_flair sag"), "FLAIR");
        assert_eq!(kind("ax t2 tse"), "T2");
        assert_eq!(kind("t1_mprage"), "T1");
        assert_eq!(kind("ep2d_diff_mddw"), "DWI");
        assert_eq!(kind("series"), "MR");
        assert_eq!(kind("t2_tirm_tra_dark-fluid"), "FLAIR");
    }

    #[test]
    fn times_tell_what_a_name_does_not() {
        let kind = |names, times| kind_of(&hints(names, times));
        assert_eq!(kind("t2_tirm_tra", [9000.0, 81.0, 2500.0]), "FLAIR");
        assert_eq!(kind("t2_stir", [4000.0, 70.0, 160.0]), "T2");
        assert_eq!(kind("sag 3d", [5000.0, 390.0, 1800.0]), "FLAIR");
        assert_eq!(kind("ax", [4500.0, 98.0, 0.0]), "T2");
        assert_eq!(kind("t1 flair", [2000.0, 9.0, 860.0]), "T1");
        assert_eq!(kind("flair", [9000.0, 120.0, 2500.0]), "FLAIR");
    }

    #[test]
    fn a_name_is_hexadecimal_digits_points_and_hyphens() {
        assert!(SeriesName::parse("1.2.840.113619.2").is_some());
        assert!(SeriesName::parse("3").is_some());
        assert!(SeriesName::parse("").is_none());
        assert!(SeriesName::parse("../../x").is_none());
        assert!(SeriesName::parse(&"1".repeat(65)).is_none());
    }
}
