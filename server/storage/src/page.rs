//! Pages of lists, and searches for cases.

use std::fmt;

use jiff::Timestamp;

use case::series::{AccessionNumber, PatientDigest, Uid};
use case::{Case, CaseState};

/// Which cases to list: those that fulfil each condition that is given; without one, all.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CaseQuery {
    /// A part of the label, whether in upper or lower case.
    pub label: Option<String>,
    pub state: Option<CaseState>,
    /// They came at this time or later.
    pub since: Option<Timestamp>,
    /// They came before this time.
    pub until: Option<Timestamp>,
    pub study: Option<Uid>,
    pub series: Option<Uid>,
    pub accession_number: Option<AccessionNumber>,
    pub patient: Option<PatientDigest>,
}

/// The place in a list after an item, given by its time and id.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cursor {
    /// Microseconds since 1970.
    pub at: i64,
    /// The id of the item.
    pub id: String,
}

impl Cursor {
    /// The place before which a list goes on, newest first: that of a cursor, or after the newest item.
    pub fn place(after: Option<&Self>) -> (i64, &str) {
        after.map_or((i64::MAX, ""), |cursor| (cursor.at, &cursor.id))
    }

    /// A page of at most `limit` items of which one more was read, and its end if there is more.
    pub fn page<T>(
        mut items: Vec<T>,
        limit: usize,
        place: impl Fn(&T) -> (Timestamp, String),
    ) -> (Vec<T>, Option<Self>) {
        let has_more = items.len() > limit;
        items.truncate(limit);
        let last = items.last().filter(|_| has_more).map(place);
        let next = last.map(|(at, id)| Self {
            at: at.as_microsecond(),
            id,
        });
        (items, next)
    }

    /// Parses the output of `Display`; `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let (at, id) = text.split_once('-')?;
        is_id(id).then_some(Self {
            at: at.parse().ok()?,
            id: id.to_owned(),
        })
    }
}

impl fmt::Display for Cursor {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}-{}", self.at, self.id)
    }
}

/// Whether a text can be the id of a row that has no meaning, such as a job.
pub fn is_id(text: &str) -> bool {
    let allowed = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
    text.len() == 32 && text.bytes().all(allowed)
}

/// A page of the list of cases.
#[derive(Debug, Clone)]
pub struct Page {
    /// Newest first.
    pub cases: Vec<Case>,
    /// The start of the next page; `None` on the last one.
    pub next: Option<Cursor>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_is_read_back_as_it_was_written() {
        let cursor = Cursor {
            at: 17,
            id: "0123456789abcdef0123456789abcdef".to_owned(),
        };
        assert_eq!(Cursor::parse(&cursor.to_string()), Some(cursor));
        for text in [
            "",
            "-",
            "1-2",
            "x-0123456789abcdef0123456789abcdef",
            "99999999999999999999-0123456789abcdef0123456789abcdef",
        ] {
            assert_eq!(Cursor::parse(text), None, "{text}");
        }
    }
}
