//! The id of a store, and what its objects say of it.

use std::fmt;

use uuid::Uuid;

/// The id of a store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoreId(Uuid);

impl StoreId {
    /// An id that no other store has.
    pub(crate) fn new() -> Self {
        Self(Uuid::now_v7())
    }

    pub(crate) fn parse(text: &str) -> Option<Self> {
        Uuid::try_parse(text).ok().map(Self)
    }
}

impl fmt::Display for StoreId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(formatter)
    }
}

/// What the object says: a line with the id, and while the id is changed, a second line with the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Label {
    /// There is no such object.
    Missing,
    Damaged,
    Id(StoreId),
    Changing {
        from: StoreId,
        to: StoreId,
    },
}

impl Label {
    pub(crate) fn parse(bytes: &[u8]) -> Self {
        let ids: Option<Vec<_>> = str::from_utf8(bytes)
            .ok()
            .and_then(|text| text.lines().map(StoreId::parse).collect());
        match ids.as_deref() {
            Some(&[id]) => Self::Id(id),
            Some(&[to, from]) => Self::Changing { from, to },
            _ => Self::Damaged,
        }
    }

    /// The bytes of the object.
    pub(crate) fn text(&self) -> String {
        match self {
            Self::Missing | Self::Damaged => String::new(),
            Self::Id(id) => format!("{id}\n"),
            Self::Changing { from, to } => format!("{to}\n{from}\n"),
        }
    }

    pub(crate) fn id(&self) -> Option<StoreId> {
        match *self {
            Self::Missing | Self::Damaged => None,
            Self::Id(id) | Self::Changing { to: id, .. } => Some(id),
        }
    }
}

/// Rows and objects that do not belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mismatch {
    /// The id in the rows.
    pub(crate) rows: Option<StoreId>,
    /// The id beside the objects.
    pub(crate) objects: Label,
}

impl fmt::Display for Mismatch {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = match self.rows {
            Some(id) => format!("the database belongs to the store {id}"),
            None => "the database belongs to no store".to_owned(),
        };
        let (objects, remedy) = match (self.rows, self.objects) {
            (_, Label::Missing) => (
                "the objects have no `store-id`".to_owned(),
                "is their folder mounted, and is their address right (`storage.objects`)? If `isocortex init-store` was interrupted, run it again",
            ),
            (_, Label::Damaged) => (
                "the `store-id` of the objects is damaged".to_owned(),
                "if these are the objects of this database, replace it by a file with the id of the database",
            ),
            (Some(rows), Label::Changing { from, to }) if rows == from => (
                format!("the objects to the store {to}"),
                "the change of its id was interrupted: run `isocortex new-store-id` again",
            ),
            (_, Label::Id(id) | Label::Changing { to: id, .. }) => (
                format!("the objects to the store {id}"),
                "correct the address of the database or that of the objects",
            ),
        };
        write!(formatter, "{rows}, {objects}; {remedy}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_id_is_damaged_and_names_come_back() {
        let [one, other] = [(); 2].map(|()| StoreId::new());
        let changing = Label::Changing {
            from: one,
            to: other,
        };
        for label in [Label::Id(one), changing] {
            assert_eq!(Label::parse(label.text().as_bytes()), label);
        }
        let text = Label::Id(one).text();
        for damaged in [
            "",
            "\n",
            &text[1..],
            &text.replace('-', "_"),
            &format!("{text}{text}{text}"),
            "nonsense",
        ] {
            assert_eq!(
                Label::parse(damaged.as_bytes()),
                Label::Damaged,
                "{damaged}"
            );
        }
        assert_eq!(Label::parse(&[0xff; 37]), Label::Damaged);
    }

    #[test]
    fn a_mismatch_names_both_ids_and_what_to_do() {
        let [one, other] = [(); 2].map(|()| StoreId::new());
        let words = |rows, objects| Mismatch { rows, objects }.to_string();
        let differ = words(Some(one), Label::Id(other));
        for part in [&one.to_string(), &other.to_string(), "correct the address"] {
            assert!(differ.contains(part), "{differ}");
        }
        let away = words(Some(one), Label::Missing);
        assert!(
            away.contains(&one.to_string()) && away.contains("mounted"),
            "{away}"
        );
        let half = words(
            Some(one),
            Label::Changing {
                from: one,
                to: other,
            },
        );
        assert!(half.contains("new-store-id"), "{half}");
    }
}
