//! Tables of participants and of marks, as tab- or comma-separated text.

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::BenchError;
use crate::files::read;

/// The column of a table that names the participant; without it, the first column does.
const ID_COLUMNS: [&str; 4] = ["participant_id", "participant", "subject", "id"];

/// A table with a line of column names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Table {
    path: PathBuf,
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
}

/// A column and its value: `group=fcd`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Choice {
    /// The name of the column.
    pub column: String,
    /// The value, in any case.
    pub value: String,
}

impl Choice {
    /// Parses `COLUMN=VALUE`.
    ///
    /// # Errors
    /// A sentence if the text has no such form.
    pub fn parse(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((column, value)) if !column.trim().is_empty() && !value.trim().is_empty() => {
                Ok(Self {
                    column: column.trim().to_owned(),
                    value: value.trim().to_owned(),
                })
            }
            _ => Err("write COLUMN=VALUE, such as group=fcd".to_owned()),
        }
    }

    /// Whether a row has this value.
    pub(super) fn holds(&self, row: &Row<'_>) -> bool {
        row.get(&self.column)
            .is_some_and(|value| value.eq_ignore_ascii_case(&self.value))
    }
}

impl std::fmt::Display for Choice {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}={}", self.column, self.value)
    }
}

/// A row of a table.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row<'a> {
    columns: &'a [String],
    cells: &'a [String],
}

impl<'a> Row<'a> {
    /// The value in a column; `None` if there is no such column, or the value is empty or `n/a`.
    pub(super) fn get(&self, column: &str) -> Option<&'a str> {
        let place = self
            .columns
            .iter()
            .position(|name| name.eq_ignore_ascii_case(column))?;
        let value = self.cells.get(place)?.trim();
        let is_known = !value.is_empty() && !value.eq_ignore_ascii_case("n/a");
        is_known.then_some(value)
    }

    /// The participant.
    pub(super) fn id(&self) -> &'a str {
        let named = ID_COLUMNS.iter().find_map(|column| self.get(column));
        named.unwrap_or_else(|| self.cells.first().map_or("", |cell| cell.trim()))
    }

    /// The age in years: the number in the first column whose name begins with `age`.
    pub(super) fn age_years(&self) -> Option<f64> {
        let is_age = |name: &&String| {
            let name = name.to_ascii_lowercase();
            name == "age" || name.starts_with("age_") || name.starts_with("age ")
        };
        let column = self.columns.iter().find(is_age)?;
        self.get(column)?.parse().ok()
    }
}

impl Table {
    /// # Errors
    /// If the file cannot be read, is not UTF-8 or has no row.
    pub(super) fn read(path: &Path) -> Result<Self, BenchError> {
        let unusable =
            |reason: &str| BenchError::Usage(format!("{} is unusable: {reason}", path.display()));
        let text = String::from_utf8(read(path)?).map_err(|_| unusable("it is not UTF-8"))?;
        let mut lines = split(&text).into_iter();
        let columns = lines.next().ok_or_else(|| unusable("it is empty"))?;
        Ok(Self {
            path: path.to_owned(),
            columns: columns.iter().map(|name| name.trim().to_owned()).collect(),
            rows: lines.collect(),
        })
    }

    pub(super) fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.rows.iter().map(|cells| Row {
            columns: &self.columns,
            cells,
        })
    }

    /// The row of a head.
    pub(super) fn row(&self, head: &str) -> Option<Row<'_>> {
        self.rows().find(|row| is_same_head(row.id(), head))
    }

    /// Checks that the table has a column.
    ///
    /// # Errors
    /// If it has none; the message lists the columns.
    pub(super) fn check_column(&self, column: &str) -> Result<(), BenchError> {
        let mut names = self.columns.iter();
        if names.any(|name| name.eq_ignore_ascii_case(column)) {
            return Ok(());
        }
        Err(BenchError::Usage(format!(
            "{} has no column {column:?}; it has {}",
            self.path.display(),
            self.columns.join(", ")
        )))
    }
}

/// Whether two names mean the same head: `sub-07`, `07` and `7` do.
pub(super) fn is_same_head(one: &str, other: &str) -> bool {
    let bare = |name: &str| {
        let name = name.trim();
        let name = name.strip_prefix("sub-").unwrap_or(name);
        match name.parse::<u64>() {
            Ok(number) => number.to_string(),
            Err(_) => name.to_owned(),
        }
    };
    bare(one) == bare(other)
}

/// The rows of a text. It is tab-separated if its first line has a tab; otherwise it is comma-separated, with quotes as in RFC 4180.
fn split(text: &str) -> Vec<Vec<String>> {
    let text = text.trim_start_matches('\u{feff}');
    let first = text.lines().next().unwrap_or_default();
    if first.contains('\t') {
        let rows = text.lines().filter(|line| !line.trim().is_empty());
        return rows
            .map(|line| line.split('\t').map(str::to_owned).collect())
            .collect();
    }
    let mut rows = Vec::new();
    let (mut row, mut cell, mut is_quoted) = (Vec::new(), String::new(), false);
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if is_quoted && letters.peek() == Some(&'"') => {
                cell.push('"');
                letters.next();
            }
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => row.push(std::mem::take(&mut cell)),
            '\r' if !is_quoted => {}
            '\n' if !is_quoted => {
                row.push(std::mem::take(&mut cell));
                rows.push(std::mem::take(&mut row));
            }
            letter => cell.push(letter),
        }
    }
    if !cell.is_empty() || !row.is_empty() {
        row.push(cell);
        rows.push(row);
    }
    rows.retain(|row| row.iter().any(|cell| !cell.trim().is_empty()));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Table {
        let mut rows = split(text).into_iter();
        Table {
            path: "participants.tsv".into(),
            columns: rows.next().unwrap(),
            rows: rows.collect(),
        }
    }

    #[test]
    fn both_kinds_of_tables_are_read() {
        let tabs = table("participant_id\tgroup\tage_scan\nsub-01\tFCD\t12.5\nsub-02\thc\tn/a\n");
        let commas = table("\u{feff}group,ID,note\r\nfcd,1,\"one, \"\"two\"\"\nthree\"\r\n");
        let choice = Choice::parse("group=fcd").unwrap();
        let one = tabs.row("sub-01").unwrap();
        assert!(choice.holds(&one) && one.age_years() == Some(12.5));
        let two = tabs.row("2").unwrap();
        assert!(!choice.holds(&two) && two.age_years().is_none());
        let row = commas.row("sub-001").unwrap();
        assert_eq!(row.get("note"), Some("one, \"two\"\nthree"));
        assert!(choice.holds(&row) && tabs.row("sub-3").is_none());
    }

    #[test]
    fn a_choice_is_a_column_and_a_value() {
        assert!(Choice::parse("group").is_err() && Choice::parse("=x").is_err());
        let missing = table("participant_id\tgroup\n").check_column("split");
        assert!(missing.unwrap_err().to_string().contains("group"));
    }
}
