//! Pages of lists, and searches for cases.

use std::fmt;

use jiff::Timestamp;

use case::series::{AccessionNumber, PatientDigest, Uid};
use case::{Case, CaseState, QualityState};
use strum::{EnumString, IntoStaticStr};

/// Which cases to list, and how: those that fulfil each condition that is given; without one, all.
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
    /// A part of the label or of the name of an author of findings, whether in upper or lower case, or the beginning of the id.
    pub text: Option<String>,
    pub status: Option<Status>,
    /// The rating of the mask; of ready cases alone.
    pub mask: Option<QualityState>,
    /// A part of the name of a layer, whether in upper or lower case.
    pub layer: Option<String>,
    /// A part of the name of an author of findings, whether in upper or lower case.
    pub reader: Option<String>,
    pub has: Option<Has>,
    /// Whether they are in the trash.
    pub trashed: Option<bool>,
    pub order: Order,
    /// The number of cases to pass over. Then they are counted, too.
    pub skip: Option<usize>,
}

/// What is to be done with a case, as far as its rows tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumString, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Status {
    /// It is being prepared, or waits for that.
    Preparing,
    Failed,
    /// It is ready, and nobody has written anything about it.
    New,
    /// There are findings, places that were dismissed, or a reading that is not signed.
    Begun,
    /// Readers have signed, and no reading is open.
    Signed,
}

impl Status {
    /// The name in JSON.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The status with a name; `None` if there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// What a case has at least one of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumString, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Has {
    /// Places of its maps that stand out.
    Places,
    /// Findings that were not dismissed.
    Findings,
    Layers,
}

impl Has {
    /// The name in JSON.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// What has a name; `None` if nothing has.
    pub fn from_name(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// The order of a list of cases. Those that are alike are listed newest first.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, EnumString, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Order {
    #[default]
    Newest,
    Oldest,
    /// By the label, numbers by their value; cases without one last.
    Label,
    /// Those with the most places that stand out first.
    Places,
    /// Those with the most findings first.
    Findings,
}

impl Order {
    /// The name in JSON.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The order with a name; `None` if there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// A case in a list.
#[derive(Debug, Clone)]
pub struct Listed {
    pub case: Case,
    pub status: Status,
    /// How many places of its maps stand out; `None` if that is not known.
    pub places: Option<u32>,
    /// The number of findings, without places that were dismissed.
    pub findings: u32,
    /// The authors of the findings, as they are written there.
    pub readers: Vec<String>,
    /// The names of its layers, in their order.
    pub layers: Vec<String>,
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
    /// In the order that was asked for.
    pub cases: Vec<Listed>,
    /// The start of the next page, newest first; `None` on the last one, and in another order.
    pub next: Option<Cursor>,
    /// How many cases fulfil the conditions, if some were to be passed over.
    pub total: Option<u64>,
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
