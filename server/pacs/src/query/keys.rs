//! The keys of a search.

use std::collections::BTreeSet;

use imaging::dicom::{Attribute, attribute};

use super::matching::matches;
use crate::error::PacsError;
use crate::held::Values;

/// The number of results on a page, if none is requested.
const USUAL_LIMIT: usize = 100;

/// The largest number of results on a page.
const MAX_LIMIT: usize = 1000;

/// The most keys of a search.
const MAX_KEYS: usize = 100;

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
}

fn refuse(detail: String) -> PacsError {
    PacsError::bad_request("query-value-out-of-range", detail)
}

impl SearchKeys {
    /// Reads the keys of a query.
    pub(crate) fn read(pairs: &[(String, String)]) -> Result<Self, PacsError> {
        let mut keys = Self {
            limit: USUAL_LIMIT,
            ..Self::default()
        };
        if pairs.len() > MAX_KEYS {
            return Err(refuse(format!("the query has more than {MAX_KEYS} keys")));
        }
        for (name, value) in pairs {
            match name.to_ascii_lowercase().as_str() {
                "limit" => keys.limit = count(name, value)?.min(MAX_LIMIT),
                "offset" => keys.offset = count(name, value)?,
                "includefield" => keys.include(value)?,
                "fuzzymatching" => {
                    keys.is_fuzzy = value
                        .parse()
                        .map_err(|_| refuse("`fuzzymatching` must be true or false".to_owned()))?;
                }
                _ => keys.want(name, value)?,
            }
        }
        if keys.limit == 0 {
            return Err(refuse("`limit` must be at least 1".to_owned()));
        }
        Ok(keys)
    }

    fn include(&mut self, value: &str) -> Result<(), PacsError> {
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
                    return Err(refuse(
                        "`includefield` must name attributes by keyword or tag, or be `all`"
                            .to_owned(),
                    ));
                }
            }
        }
        Ok(())
    }

    fn want(&mut self, name: &str, value: &str) -> Result<(), PacsError> {
        // What the client wrote may be patient data, so it is not repeated.
        let unknown = || {
            PacsError::bad_request(
                "query-unreadable",
                "a key of the query is neither an attribute of DICOM, by keyword or tag, nor `limit`, `offset`, `includefield` or `fuzzymatching`",
            )
        };
        let known = attribute(name).ok_or_else(unknown)?;
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
            !is_supported(&tag) || matches(known.vr, wanted, values.text(&tag))
        })
    }
}

fn count(name: &str, value: &str) -> Result<usize, PacsError> {
    let number = value
        .parse()
        .ok()
        .filter(|&number: &usize| number <= i32::MAX as usize);
    number.ok_or_else(|| refuse(format!("`{name}` must be a whole number of at least 0")))
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

    fn read(pairs: &[(&str, &str)]) -> Result<SearchKeys, PacsError> {
        let pairs: Vec<_> = pairs
            .iter()
            .map(|&(name, value)| (name.to_owned(), value.to_owned()))
            .collect();
        SearchKeys::read(&pairs)
    }

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
        assert_eq!((keys.limit, keys.offset), (MAX_LIMIT, 3));
        assert_eq!(keys.value("PatientID"), Some("P-7"));
        let included: Vec<_> = keys.included.iter().map(String::as_str).collect();
        assert_eq!(included, ["00081030", "0008103E", "00100010", "00100020"]);
        assert!(read(&[("includefield", "all")]).unwrap().is_all_included);
    }

    #[test]
    fn what_is_no_key_is_refused_and_not_repeated() {
        for (name, value) in [
            ("limit", "0"),
            ("limit", "-1"),
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
