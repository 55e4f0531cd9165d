//! The table and the page of all heads of a run, and its progress.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use cases::bids::{Derivatives, Found, HeadName, HeadRecord};
use report::{ListedHead, page_of_heads};

use crate::cli::status::{CliError, ExitStatus};

/// What became of a head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Neither this run nor an earlier one did it.
    Pending,
    Done,
    /// It cannot be used.
    Refused,
    /// The program, the machine or the disk failed.
    Failed,
}

impl State {
    fn name(self) -> &'static str {
        match self {
            Self::Pending => "pending",
            Self::Done => "done",
            Self::Refused => "refused",
            Self::Failed => "failed",
        }
    }
}

/// A head of the summary.
#[derive(Debug, Clone)]
pub(super) struct Row {
    name: HeadName,
    state: State,
    reason: String,
    seconds: f64,
    notes: Vec<String>,
    record: Option<HeadRecord>,
    /// Whether it was done now.
    is_new: bool,
}

impl Row {
    pub(super) fn new(name: HeadName, notes: Vec<String>) -> Self {
        Self {
            name,
            state: State::Pending,
            reason: "not done yet".to_owned(),
            seconds: 0.0,
            notes,
            record: None,
            is_new: false,
        }
    }

    pub(super) fn done(self, record: HeadRecord, is_new: bool) -> Self {
        Self {
            state: State::Done,
            reason: String::new(),
            seconds: record.seconds,
            notes: record.notes.clone(),
            record: Some(record),
            is_new,
            ..self
        }
    }

    pub(super) fn refused(self, reason: String, took: Duration) -> Self {
        Self {
            state: State::Refused,
            ..self.failed(reason, took)
        }
    }

    pub(super) fn failed(self, reason: String, took: Duration) -> Self {
        Self {
            state: State::Failed,
            reason,
            seconds: took.as_secs_f64(),
            ..self
        }
    }

    /// What became of it, in a few words.
    fn words(&self) -> String {
        match (&self.record, self.is_new) {
            (Some(_), false) => "is done already".to_owned(),
            (Some(record), true) => format!(
                "done in {:.1} s: mask {}, maps {}, places that stand out: {}",
                self.seconds,
                record.mask.state,
                record.maps.state,
                standing_out(record)
            ),
            (None, _) => format!("{}: {}", self.state.name(), self.reason),
        }
    }

    fn tsv(&self) -> String {
        let record = self.record.as_ref();
        let of = |value: Option<&str>| value.unwrap_or("n/a").to_owned();
        let standing_out = record.map(standing_out);
        let fields = [
            self.name.prefix.clone(),
            self.state.name().to_owned(),
            of(Some(&*self.reason).filter(|reason| !reason.is_empty())),
            format!("{:.2}", self.seconds),
            of(record.map(|record| &*record.mask.state)),
            of(record.map(|record| &*record.maps.state)),
            of(record.and_then(|record| record.flair.as_deref())),
            of(standing_out.as_deref()),
            of(Some(&*self.notes.join("; ")).filter(|notes| !notes.is_empty())),
        ];
        let plain = |field: String| field.replace(|letter: char| letter.is_control(), " ");
        fields.map(plain).join("\t") + "\n"
    }

    fn listed(&self, out: &Derivatives) -> ListedHead {
        let mut lines = Vec::new();
        let mut doubts = Vec::new();
        if let Some(record) = &self.record {
            lines.push(format!("mask: {}", record.mask.state));
            lines.push(format!("maps: {}", record.maps.state));
            if let Some(verdict) = &record.flair {
                lines.push(format!("FLAIR: {verdict}"));
            }
            if record.maps.reason.is_none() {
                lines.push(format!("places that stand out: {}", standing_out(record)));
            }
            doubts.extend(record.mask.reasons.iter().cloned());
            doubts.extend(record.maps.reason.clone());
        }
        doubts.extend(Some(self.reason.clone()).filter(|reason| !reason.is_empty()));
        doubts.extend(self.notes.iter().cloned());
        let address = |path| self.record.as_ref().map(|_| out.address(path));
        ListedHead {
            name: self.name.prefix.clone(),
            state: self.state.name(),
            picture: address(&out.picture(&self.name)),
            report: address(&out.report(&self.name)),
            lines,
            doubts,
        }
    }
}

/// How many places stand out.
fn standing_out(record: &HeadRecord) -> String {
    let count = record.standing_out;
    count.map_or("n/a".to_owned(), |count| count.to_string())
}

/// All heads, in their order.
pub(super) struct Summary {
    out: Derivatives,
    /// Those of this run.
    rows: Vec<Row>,
    /// Those that this run does not do.
    others: Vec<Found>,
    begun: Instant,
}

impl Summary {
    pub(super) fn new(out: Derivatives, heads: &[Found], others: Vec<Found>) -> Self {
        let row = |found: &Found| Row::new(found.name.clone(), found.notes.clone());
        Self {
            out,
            rows: heads.iter().map(row).collect(),
            others,
            begun: Instant::now(),
        }
    }

    /// Adds a head, reports it with an estimate of the time left, and writes the table and the page as they are now.
    pub(super) fn add(&mut self, number: usize, row: Row) -> Result<(), CliError> {
        let (prefix, words) = (row.name.prefix.clone(), row.words());
        self.rows[number] = row;
        let ended = self.rows.iter().filter(|row| row.state != State::Pending);
        let (ended, worked) = (
            ended.clone().count(),
            ended.filter(|row| row.is_new).count(),
        );
        let left = left(self.begun.elapsed(), worked, self.rows.len() - ended);
        let left = left.map_or(String::new(), |left| format!("; about {left} left"));
        eprintln!("[{ended}/{}] {prefix} {words}{left}", self.rows.len());
        // Another program may do them meanwhile.
        let others: Vec<_> = self.others.iter().map(|found| self.other(found)).collect();
        let mut rows: Vec<_> = self.rows.iter().chain(&others).collect();
        rows.sort_by(|a, b| a.name.cmp(&b.name));
        let head = "head\tstate\treason\tseconds\tmask\tmaps\tflair\tstanding_out\tnotes\n";
        let table: String = rows.iter().map(|row| row.tsv()).collect();
        let root = self.out.root();
        let write = |name: &str, text: String| self.out.write(&root.join(name), text.as_bytes());
        write("summary.tsv", format!("{head}{table}"))?;
        let listed: Vec<_> = rows.iter().map(|row| row.listed(&self.out)).collect();
        write(
            "summary.html",
            page_of_heads("Isocortex: heads of a BIDS folder", &listed),
        )?;
        Ok(())
    }

    /// A head that this run does not do.
    fn other(&self, found: &Found) -> Row {
        let row = Row::new(found.name.clone(), found.notes.clone());
        // A record that cannot be read is none.
        let record = self.out.record(&found.name).ok().flatten();
        match (&found.files, record) {
            (Err(why), _) => row.refused(why.clone(), Duration::ZERO),
            (Ok(_), Some(record)) => row.done(record, false),
            (Ok(_), None) => row,
        }
    }

    /// Reports the whole run.
    ///
    /// # Errors
    /// If not all heads are done.
    pub(super) fn end(&self) -> Result<(), CliError> {
        let count = self.rows.len();
        let done = self.rows.iter();
        let done = done.filter(|row| row.state == State::Done).count();
        let root = self.out.root().display();
        if done == count {
            eprintln!("all {count} heads are done: {root}/summary.html");
            return Ok(());
        }
        let mut message = format!("{done} of {count} heads are done; ");
        let _ = write!(message, "{root}/summary.tsv states why the others are not");
        Err(CliError::new(ExitStatus::BadInput, message))
    }
}

/// The time that the other heads take, if they take as long as those that were done now.
fn left(elapsed: Duration, worked: usize, others: usize) -> Option<String> {
    if worked == 0 || others == 0 {
        return None;
    }
    let seconds = elapsed.as_secs_f64() / worked as f64 * others as f64;
    Some(match seconds {
        ..90.0 => format!("{seconds:.0} s"),
        ..5400.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3600.0),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_that_of_the_heads_that_were_done_now() {
        let minute = Duration::from_secs(60);
        assert_eq!(left(minute, 0, 5), None);
        assert_eq!(left(minute, 3, 0), None);
        assert_eq!(left(minute, 3, 2).as_deref(), Some("40 s"));
        assert_eq!(left(minute, 1, 10).as_deref(), Some("10 min"));
        assert_eq!(left(minute, 1, 300).as_deref(), Some("5.0 h"));
    }

    #[test]
    fn a_row_is_one_line_whatever_its_reason() {
        let name = HeadName {
            folder: "sub-1".into(),
            prefix: "sub-1".to_owned(),
        };
        let row = Row::new(name, Vec::new()).refused("a\tb\nc".to_owned(), Duration::ZERO);
        assert_eq!(
            row.tsv(),
            "sub-1\trefused\ta b c\t0.00\tn/a\tn/a\tn/a\tn/a\tn/a\n"
        );
    }
}
