//! The id of a store: a row and an object that say which rows and which objects belong together.
//!
//! The row is made first, the object after it, and only by whoever may make a store. From then on they are compared whenever the
//! store is opened, when somebody asks whether it is ready, before each job, and before an object is written or removed. A
//! database with the objects of another store, or with a folder that is not mounted, changes nothing.

use std::fmt;

use uuid::Uuid;

use crate::objects::Objects;
use crate::sql::Rows;
use crate::{Store, StoreError};

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

    fn id(&self) -> Option<StoreId> {
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

/// The id of rows and objects, or in what they differ.
///
/// # Errors
/// [`StoreError::Mismatch`], or if one of them cannot be read: what cannot be reached is not missing.
pub(crate) async fn compare(rows: &Rows, objects: &Objects) -> Result<StoreId, StoreError> {
    let found = Mismatch {
        rows: rows.store_id().await?,
        objects: objects.label().await?,
    };
    match found.rows {
        Some(id) if found.objects.id() == Some(id) => Ok(id),
        _ => Err(StoreError::Mismatch(found)),
    }
}

/// The same; gives an id to rows and objects that are new, or completes one that was half made.
///
/// # Errors
/// As [`compare`].
pub(crate) async fn compare_or_make(rows: &Rows, objects: &Objects) -> Result<StoreId, StoreError> {
    match compare(rows, objects).await {
        Err(StoreError::Mismatch(found))
            if found.objects == Label::Missing
                && rows.are_new().await?
                && objects.are_none().await? => {}
        // Another process may have made the pair between the two looks.
        Err(StoreError::Mismatch(_)) => return compare(rows, objects).await,
        compared => return compared,
    }
    let id = rows.make_store_id(StoreId::new()).await?;
    objects.create_label(&Label::Id(id)).await?;
    // Somebody else may have been faster.
    compare(rows, objects).await
}

impl Store {
    /// The id of the store, to which both its rows and its objects must belong.
    ///
    /// # Errors
    /// [`StoreError::Mismatch`], or if one of them cannot be reached.
    pub async fn id(&self) -> Result<StoreId, StoreError> {
        compare(self.rows(), self.objects()).await
    }
}

/// Gives the store another id, because it is a copy. After an interruption, the next call completes it.
///
/// # Errors
/// If rows and objects do not belong together, or cannot be written.
pub(crate) async fn change(rows: &Rows, objects: &Objects) -> Result<StoreId, StoreError> {
    let (from, to) = match compare(rows, objects).await {
        Ok(from) => (from, StoreId::new()),
        Err(StoreError::Mismatch(Mismatch {
            rows: Some(rows),
            objects: Label::Changing { from, to },
        })) if rows == from => (from, to),
        Err(error) => return Err(error),
    };
    objects.put_label(&Label::Changing { from, to }).await?;
    rows.change_store_id(to).await?;
    objects.put_label(&Label::Id(to)).await?;
    Ok(to)
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
