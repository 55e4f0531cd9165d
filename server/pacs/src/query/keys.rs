//! The keys of a search.

use std::collections::BTreeSet;

use imaging::dicom::{Attribute, attribute};
use utoipa::openapi::schema::Type;

use super::matching::{EMPTY, is_moment, matches};
use crate::held::Values;
use http_support::problem::AppError;

/// The number of results on a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PageSize {
    /// If none is requested.
    pub(crate) usual: usize,
    /// At most; also if 0 is requested.
    pub(crate) most: usize,
}

/// The most keys of a search.
const MAX_KEYS: usize = 100;

/// The keys that are no attributes.
pub(crate) const CONTROLS: [(&str, Type, &str); 7] = [
    (
        "limit",
        Type::Integer,
        "The most results; 0 for as many as possible",
    ),
    ("offset", Type::Integer, "Results to leave out at the start"),
    (
        "includefield",
        Type::String,
        "Attributes to return as well, by keyword or tag with commas, or `all`",
    ),
    (
        "fuzzymatching",
        Type::Boolean,
        "Accepted, and answered with a warning: names are matched literally",
    ),
    (
        "emptyvaluematching",
        Type::Boolean,
        "Whether the value `\"\"` of a key matches what has no value",
    ),
    (
        "multiplevaluematching",
        Type::Boolean,
        "Accepted: a list of values, separated by backslashes, always matches each of them",
    ),
    (
        "accept",
        Type::String,
        "The accepted media types, instead of the header",
    ),
];

/// What a search asks.
#[derive(Debug, Default)]
pub(crate) struct SearchKeys {
    pub(crate) limit: usize,
    pub(crate) offset: usize,
    /// Values to match.
    pub(crate) wanted: Vec<(Attribute, String)>,
    /// Tags to return in addition to the usual ones.
    pub(crate) included: BTreeSet<String>,
    /// Whether to return everything that is known.
    pub(crate) is_all_included: bool,
    /// Whether fuzzy matching is requested, which is not supported.
    pub(crate) is_fuzzy: bool,
    /// Whether [`EMPTY`] matches what has no value.
    matches_empty: bool,
    /// Whether there is a key that nothing here has: a private attribute, or one inside of a sequence.
    pub(crate) has_foreign: bool,
    /// The media types that the query accepts instead of the header.
    pub(crate) accept: Option<String>,
}

impl SearchKeys {
    /// Reads the keys of a query.
    pub(crate) fn read(pairs: &[(String, String)], size: PageSize) -> Result<Self, AppError> {
        let mut keys = Self {
            limit: size.usual,
            ..Self::default()
        };
        if pairs.len() > MAX_KEYS {
            let detail = format!("the query has more than {MAX_KEYS} keys");
            return Err(AppError::bad_request("query-value-out-of-range", detail));
        }
        for (name, value) in pairs {
            match name.to_ascii_lowercase().as_str() {
                "limit" => {
                    keys.limit = match count(name, value)? {
                        0 => size.most,
                        number => number.min(size.most),
                    };
                }
                "offset" => keys.offset = count(name, value)?,
                "includefield" => keys.include(value)?,
                "fuzzymatching" => keys.is_fuzzy = truth("fuzzymatching", value)?,
                "emptyvaluematching" => keys.matches_empty = truth("emptyvaluematching", value)?,
                // Lists of values are always matched.
                "multiplevaluematching" => _ = truth("multiplevaluematching", value)?,
                // A `+` of an address is a space.
                "accept" => keys.accept = Some(value.replace(" json", "+json")),
                _ => keys.want(name, value)?,
            }
        }
        Ok(keys)
    }

    fn include(&mut self, value: &str) -> Result<(), AppError> {
        for name in value.split(',').map(str::trim) {
            if name.eq_ignore_ascii_case("all") {
                self.is_all_included = true;
                continue;
            }
            // Of a path into a sequence, the sequence counts.
            let first = name.split('.').next().unwrap_or_default();
            match attribute(first) {
                Some(known) => _ = self.included.insert(known.name()),
                None if is_private(first) => {}
                None => {
                    let rule = "a list of attributes by keyword or tag, or `all`";
                    return Err(AppError::wrong_value("includefield", rule));
                }
            }
        }
        Ok(())
    }

    fn want(&mut self, name: &str, value: &str) -> Result<(), AppError> {
        // What the client wrote may be patient data, so it is not repeated.
        let unknown = || {
            AppError::bad_request(
                "query-unreadable",
                format!(
                    "a key of the query is neither an attribute of DICOM, by keyword or tag, nor one of {}",
                    CONTROLS.map(|(name, ..)| format!("`{name}`")).join(", ")
                ),
            )
        };
        let mut path = name.split('.');
        let first = path.next().unwrap_or_default();
        let within: Vec<_> = path.collect();
        if !within.is_empty() || is_private(first) {
            let mut parts = std::iter::once(&first).chain(&within);
            if !parts.all(|part| attribute(part).is_some() || is_private(part)) {
                return Err(unknown());
            }
            self.has_foreign = true;
            return Ok(());
        }
        let known = attribute(first).ok_or_else(unknown)?;
        let is_empty = self.matches_empty && value == EMPTY;
        if !is_empty && !is_moment(known.vr, value) {
            let rule = match known.vr {
                "DA" => "a date as YYYYMMDD, or a range of dates as YYYYMMDD-YYYYMMDD",
                _ => "a time as HHMMSS, or a range of times as HHMMSS-HHMMSS",
            };
            return Err(AppError::wrong_value(known.keyword, rule));
        }
        self.included.insert(known.name());
        self.wanted.push((known, value.to_owned()));
        Ok(())
    }

    /// The values of a key, if it is given.
    pub(crate) fn value(&self, keyword: &str) -> Option<&str> {
        let found = self
            .wanted
            .iter()
            .find(|(known, _)| known.keyword == keyword);
        found
            .map(|(_, value)| value.trim())
            .filter(|value| !value.is_empty())
    }

    /// Whether values match all keys that are supported.
    pub(crate) fn accept(&self, values: &Values, is_supported: impl Fn(&str) -> bool) -> bool {
        self.wanted.iter().all(|(known, wanted)| {
            let tag = known.name();
            let held = values.text(&tag);
            if !is_supported(&tag) {
                return true;
            }
            if self.matches_empty && wanted == EMPTY {
                return held.is_none_or(|held| held.trim().is_empty());
            }
            matches(known.vr, wanted, held)
        })
    }
}

fn count(name: &str, value: &str) -> Result<usize, AppError> {
    let number = value
        .parse()
        .ok()
        .filter(|&number: &usize| number <= i32::MAX as usize);
    let name = name.to_ascii_lowercase();
    number.ok_or_else(|| AppError::wrong_value(&name, "a whole number of at least 0"))
}

fn truth(name: &str, value: &str) -> Result<bool, AppError> {
    let truth = value.parse();
    truth.map_err(|_| AppError::wrong_value(name, "true or false"))
}

/// Whether a text is the tag of a private attribute, which is never known.
fn is_private(text: &str) -> bool {
    let is_tag = text.len() == 8 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    let group = text
        .get(..4)
        .and_then(|group| u16::from_str_radix(group, 16).ok());
    is_tag && group.is_some_and(|group| group % 2 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(pairs: &[(&str, &str)]) -> Result<SearchKeys, AppError> {
        let pairs: Vec<_> = pairs
            .iter()
            .map(|&(name, value)| (name.to_owned(), value.to_owned()))
            .collect();
        SearchKeys::read(&pairs, SIZE)
    }

    const SIZE: PageSize = PageSize {
        usual: 100,
        most: 1000,
    };

    #[test]
    fn keys_are_named_by_keyword_or_tag() {
        let keys = read(&[
            ("limit", "5000"),
            ("offset", "3"),
            ("00100020", "P-7"),
            ("PatientName", "*"),
            ("includefield", "00081030,SeriesDescription,00091001"),
        ])
        .unwrap();
        assert_eq!((keys.limit, keys.offset), (1000, 3));
        assert_eq!(keys.value("PatientID"), Some("P-7"));
        let included: Vec<_> = keys.included.iter().map(String::as_str).collect();
        assert_eq!(included, ["00081030", "0008103E", "00100010", "00100020"]);
        assert!(read(&[("includefield", "all")]).unwrap().is_all_included);
        assert_eq!(read(&[("limit", "0")]).unwrap().limit, 1000);
        assert_eq!(read(&[]).unwrap().limit, 100);
    }

    #[test]
    fn keys_of_sequences_and_private_ones_are_accepted_and_match_everything() {
        for name in [
            "00400275.00400009",
            "RequestAttributesSequence.ScheduledProcedureStepID",
            "00091001",
        ] {
            let keys = read(&[(name, "x")]).unwrap();
            assert!(keys.has_foreign && keys.accept(&Values::default(), |_| true));
        }
    }

    #[test]
    fn an_empty_value_is_matched_on_request() {
        let (mut with, without) = (Values::default(), Values::default());
        with.put("StudyID", "7");
        with.put("StudyDate", "20261101");
        let empty = ("emptyvaluematching", "true");
        for key in ["StudyID", "StudyDate"] {
            let keys = read(&[empty, (key, EMPTY)]).unwrap();
            assert!(!keys.accept(&with, |_| true) && keys.accept(&without, |_| true));
        }
        let keys = read(&[("StudyID", EMPTY)]).unwrap();
        assert!(!keys.accept(&without, |_| true));
    }

    #[test]
    fn what_a_query_accepts_may_have_lost_its_plus() {
        let keys = read(&[("accept", "application/dicom json")]).unwrap();
        assert_eq!(keys.accept.as_deref(), Some("application/dicom+json"));
    }

    #[test]
    fn what_is_no_key_is_refused_and_not_repeated() {
        for (name, value) in [
            ("limit", "-1"),
            ("Somebody.PatientID", "Secret"),
            ("StudyDate", "Secret"),
            ("emptyvaluematching", "Secret"),
            ("offset", "x"),
            ("fuzzymatching", "perhaps"),
            ("includefield", "Somebody"),
            ("Somebody", "Secret"),
        ] {
            let refused = read(&[(name, value)]).unwrap_err().to_string();
            assert!(!refused.contains("Somebody") && !refused.contains("Secret"));
        }
    }
}
