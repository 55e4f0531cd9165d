//! Tables of measurements, for a terminal and as JSON.

use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, ContentArrangement};
use serde_json::{Map, Value, json};

/// The number of digits on a terminal. JSON has all digits.
const DIGITS: i32 = 3;

/// A table of measurements.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Its key in JSON, and the name of its plots.
    pub name: &'static str,
    /// Its title.
    pub title: String,
    /// Its columns.
    pub columns: Vec<Column>,
    /// Its rows, with a cell for each column.
    pub rows: Vec<Vec<Cell>>,
    /// Notes for readers.
    pub notes: Vec<String>,
}

/// A column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// The key in JSON, with its unit: `setup_s`.
    pub key: &'static str,
    /// The heading on a terminal, with its unit.
    pub head: &'static str,
}

/// A column with a key and a heading.
pub const fn column(key: &'static str, head: &'static str) -> Column {
    Column { key, head }
}

/// A cell.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A name.
    Text(String),
    /// An integer.
    Count(u64),
    /// A measurement.
    Number(f64),
    /// Nothing.
    Nothing,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Self {
        Self::Count(count as u64)
    }
}

impl From<u64> for Cell {
    fn from(count: u64) -> Self {
        Self::Count(count)
    }
}

impl From<f64> for Cell {
    fn from(number: f64) -> Self {
        if number.is_finite() {
            Self::Number(number)
        } else {
            Self::Nothing
        }
    }
}

impl<T: Into<Self>> From<Option<T>> for Cell {
    fn from(cell: Option<T>) -> Self {
        cell.map_or(Self::Nothing, Into::into)
    }
}

impl Cell {
    /// Its number, if it has one.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Count(count) => Some(*count as f64),
            Self::Number(number) => Some(*number),
            Self::Text(_) | Self::Nothing => None,
        }
    }

    fn text(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Count(count) => grouped(&count.to_string()),
            Self::Number(number) => readable(*number),
            Self::Nothing => "–".to_owned(),
        }
    }

    fn json(&self) -> Value {
        match self {
            Self::Text(text) => json!(text),
            Self::Count(count) => json!(count),
            Self::Number(number) => json!(number),
            Self::Nothing => Value::Null,
        }
    }
}

/// A number with three digits, without an exponent if it is readable without one.
pub fn readable(number: f64) -> String {
    if number == 0.0 {
        return "0".to_owned();
    }
    let exponent = number.abs().log10().floor() as i32;
    if exponent < -3 {
        return format!("{number:.2e}");
    }
    let decimals = DIGITS - 1 - exponent;
    if decimals > 0 {
        return format!("{number:.*}", decimals as usize);
    }
    let unit = 10_f64.powi(-decimals);
    grouped(&format!("{:.0}", (number / unit).round() * unit))
}

/// Groups digits by three, from ten thousand on.
fn grouped(digits: &str) -> String {
    let (sign, digits) = digits
        .strip_prefix('-')
        .map_or(("", digits), |digits| ("-", digits));
    if digits.len() < 5 {
        return format!("{sign}{digits}");
    }
    let mut text = String::from(sign);
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

impl Table {
    /// An empty table.
    pub fn new(name: &'static str, title: impl Into<String>, columns: &[Column]) -> Self {
        Self {
            name,
            title: title.into(),
            columns: columns.to_vec(),
            rows: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Adds a row.
    ///
    /// # Panics
    /// If it does not have one cell for each column.
    pub fn push(&mut self, row: impl IntoIterator<Item = Cell>) {
        let row: Vec<Cell> = row.into_iter().collect();
        assert_eq!(row.len(), self.columns.len(), "a cell for each column");
        self.rows.push(row);
    }

    /// Adds a note.
    pub fn note(&mut self, sentence: impl Into<String>) {
        self.notes.push(sentence.into());
    }

    /// The pairs of numbers in two columns, from the rows that have both.
    ///
    /// # Panics
    /// If there is no such column.
    pub fn pairs(&self, x: &str, y: &str) -> Vec<(f64, f64)> {
        self.pairs_of(self.rows.iter(), x, y)
    }

    /// The pairs of numbers in two columns, from some rows.
    pub(crate) fn pairs_of<'a>(
        &self,
        rows: impl Iterator<Item = &'a Vec<Cell>>,
        x: &str,
        y: &str,
    ) -> Vec<(f64, f64)> {
        let pair = |row: &Vec<Cell>| self.number_in(row, x).zip(self.number_in(row, y));
        rows.filter_map(pair).collect()
    }

    /// The number in a column of a row.
    ///
    /// # Panics
    /// If there is no such column.
    pub(crate) fn number_in(&self, row: &[Cell], key: &str) -> Option<f64> {
        let place = self.columns.iter().position(|column| column.key == key);
        let place = place.unwrap_or_else(|| panic!("{} has no column {key}", self.name));
        row[place].number()
    }

    /// The distinct names in the first column, in the order of the rows.
    pub(crate) fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = self.rows.iter().map(|row| row[0].text()).collect();
        names.dedup();
        names
    }

    /// The rows with a name in the first column.
    pub(crate) fn rows_named(&self, name: &str) -> impl Iterator<Item = &Vec<Cell>> {
        self.rows.iter().filter(move |row| row[0].text() == name)
    }

    /// The table for a terminal: names left-aligned, numbers right-aligned.
    pub fn text(&self) -> String {
        let mut table = comfy_table::Table::new();
        table
            .load_style(NOTHING)
            .set_content_arrangement(ContentArrangement::Disabled)
            .set_header(self.columns.iter().map(|column| column.head));
        for row in &self.rows {
            table.add_row(row.iter().map(Cell::text));
        }
        for (place, column) in table.column_iter_mut().enumerate() {
            let mut cells = self.rows.iter().map(|row| &row[place]);
            if !cells.any(|cell| matches!(cell, Cell::Text(_))) {
                column.set_cell_alignment(CellAlignment::Right);
            }
        }
        let mut text = format!("{}\n{}\n", self.title, table.trim_fmt());
        for note in &self.notes {
            text.push_str(&format!("  {note}\n"));
        }
        text
    }

    /// Title, columns, rows as objects with the keys of the columns, and notes.
    pub fn json(&self) -> Value {
        let object = |row: &Vec<Cell>| {
            let cells = self.columns.iter().zip(row);
            let pairs = cells.map(|(column, cell)| (column.key.to_owned(), cell.json()));
            Value::Object(pairs.collect::<Map<_, _>>())
        };
        let heads: Vec<&str> = self.columns.iter().map(|column| column.head).collect();
        json!({
            "title": self.title,
            "columns": heads,
            "rows": self.rows.iter().map(object).collect::<Vec<_>>(),
            "notes": self.notes,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let columns = [column("step", "step"), column("wall_ms", "wall, ms")];
        let mut table = Table::new("steps", "Steps", &columns);
        table.push(["closing".into(), 72.345.into()]);
        table.push(["core".into(), Cell::Nothing]);
        table.note("Least of five.");
        table
    }

    #[test]
    fn numbers_keep_three_digits() {
        let readings = [
            (0.0, "0"),
            (0.000_123_4, "1.23e-4"),
            (0.001_234, "0.00123"),
            (1.234e-9, "1.23e-9"),
            (0.5, "0.500"),
            (12.345, "12.3"),
            (999.6, "1000"),
            (1234.0, "1230"),
            (123_456.0, "123,000"),
            (-42.0, "-42.0"),
        ];
        for (number, text) in readings {
            assert_eq!(readable(number), text);
        }
        assert_eq!(Cell::from(500_000_usize).text(), "500,000");
    }

    #[test]
    fn names_stand_left_and_numbers_right() {
        let text = table().text();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1], " step     wall, ms");
        assert_eq!(lines[2], " closing      72.3");
        assert_eq!(lines[3], " core            –");
        assert_eq!(lines[4], "  Least of five.");
    }

    #[test]
    fn json_has_all_digits_by_key() {
        let json = table().json();
        assert_eq!(
            json["rows"][0],
            json!({"step": "closing", "wall_ms": 72.345})
        );
        assert_eq!(json["rows"][1]["wall_ms"], Value::Null);
    }

    #[test]
    fn pairs_leave_out_what_is_not_there() {
        let columns = [column("x", "x"), column("y", "y")];
        let mut table = Table::new("pairs", "Pairs", &columns);
        table.push([1_usize.into(), 2.5.into()]);
        table.push([2_usize.into(), Cell::Nothing]);
        table.push([f64::NAN.into(), 1.0.into()]);
        assert_eq!(table.pairs("x", "y"), [(1.0, 2.5)]);
    }
}
