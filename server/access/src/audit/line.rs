//! One line of a file, and its digest.

use jiff::{Timestamp, Unit};
use serde::{Deserialize, Serialize};

use crate::audit::event::{Action, Event, Outcome};

/// What stands before the digest, which is the last key of a line.
const BEFORE_DIGEST: &[u8] = b",\"digest\":\"";

/// Hexadecimal digits of a digest.
const DIGITS: usize = 64;

/// The digest before the first line of a process.
pub(crate) const NO_DIGEST: blake3::Hash = blake3::Hash::from_bytes([0; 32]);

/// Where a line stands in the chain of its process.
#[derive(Debug, Clone)]
pub(crate) struct Position {
    /// The number of the next line, from 1.
    pub(crate) seq: u64,
    /// The digest of the line before.
    pub(crate) previous: blake3::Hash,
}

impl Position {
    pub(crate) fn first() -> Self {
        Self {
            seq: 1,
            previous: NO_DIGEST,
        }
    }
}

/// The keys of a line, but for its digest.
#[derive(Debug, Serialize)]
struct Keys<'a> {
    seq: u64,
    time: String,
    process: &'a str,
    event: &'static str,
    name: &'static str,
    action: Action,
    outcome: Outcome,
    object: &'static str,
    who: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    from: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    to: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    case: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    study: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    route: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    request: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    count: Option<u64>,
    /// The number of the file, in its first line.
    #[serde(skip_serializing_if = "Option::is_none")]
    file: Option<u32>,
    previous: String,
}

/// The line of an event with its end, and where the next one stands. The first line of a file has the number of the file.
pub(crate) fn write(
    event: &Event,
    process: &str,
    at: &Position,
    begins_file: Option<u32>,
) -> (Vec<u8>, Position) {
    let (code, name) = event.kind.code();
    let now = Timestamp::now();
    let keys = Keys {
        seq: at.seq,
        time: now.round(Unit::Millisecond).unwrap_or(now).to_string(),
        process,
        event: code,
        name,
        action: event.action,
        outcome: event.outcome,
        object: event.object,
        who: &event.who,
        from: event.from.map(|address| address.to_canonical().to_string()),
        to: event.to.as_deref(),
        case: event.case.as_deref(),
        study: event.study.as_deref(),
        route: event.route.as_deref(),
        request: event.request.as_deref(),
        count: event.count,
        file: begins_file,
        previous: at.previous.to_hex().to_string(),
    };
    // Numbers, texts and options cannot fail.
    let mut line = serde_json::to_vec(&keys).unwrap_or_default();
    line.pop();
    let digest = blake3::hash(&line);
    line.extend(BEFORE_DIGEST);
    line.extend(digest.to_hex().as_bytes());
    line.extend(b"\"}\n");
    let next = Position {
        seq: at.seq + 1,
        previous: digest,
    };
    (line, next)
}

/// What a reader needs of a line.
#[derive(Debug)]
pub(crate) struct Read {
    pub(crate) seq: u64,
    pub(crate) process: String,
    pub(crate) previous: String,
    /// The digest that it states.
    pub(crate) digest: String,
    /// Whether that is its digest.
    pub(crate) is_sound: bool,
    /// Whether it is the last one of a process that stopped in order.
    pub(crate) is_stop: bool,
    /// The number of the file that begins with it.
    pub(crate) file: Option<u32>,
}

/// Reads a line without its end; `None` if it is none.
pub(crate) fn read(line: &[u8]) -> Option<Read> {
    #[derive(Deserialize)]
    struct Known {
        seq: u64,
        process: String,
        event: String,
        object: String,
        file: Option<u32>,
        previous: String,
        digest: String,
    }
    let known: Known = serde_json::from_slice(line).ok()?;
    let body = line.len().checked_sub(BEFORE_DIGEST.len() + DIGITS + 2)?;
    let (body, rest) = line.split_at(body);
    let is_last_key = rest.starts_with(BEFORE_DIGEST);
    let is_sound = is_last_key && *blake3::hash(body).to_hex() == *known.digest;
    Some(Read {
        is_stop: known.event == "110100" && known.object == STOP,
        file: known.file,
        seq: known.seq,
        process: known.process,
        previous: known.previous,
        digest: known.digest,
        is_sound,
    })
}

/// What a process records when it stops.
pub(crate) const STOP: &str = "stop";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::event::EventKind;

    #[test]
    fn a_line_is_json_that_states_its_digest_and_the_one_before() {
        let mut event = Event::new(
            EventKind::InstancesAccessed,
            Action::Read,
            "picture",
            "dr.silva",
        );
        event.from = Some("::ffff:10.0.0.5".parse().unwrap());
        event.case = Some("0123".into());
        let (line, next) = write(&event, "p", &Position::first(), Some(1));
        let json: serde_json::Value = serde_json::from_slice(&line).unwrap();
        assert_eq!(json["name"], "DICOM Instances Accessed");
        assert_eq!(json["from"], "10.0.0.5");
        assert_eq!(json["seq"], 1);
        assert_eq!(json["file"], 1);
        assert_eq!(json["previous"], "0".repeat(64));
        assert_eq!(json["digest"], *next.previous.to_hex());
        let read = super::read(line.trim_ascii_end()).unwrap();
        assert!(read.is_sound && !read.is_stop);
        assert_eq!((read.seq, next.seq), (1, 2));
        let changed = String::from_utf8(line).unwrap().replace("silva", "souza");
        assert!(!super::read(changed.trim_end().as_bytes()).unwrap().is_sound);
        // A key after the digest is no part of what was recorded.
        let longer = changed.trim_end().replace("\"}", "\",\"x\":1}");
        assert!(!super::read(longer.as_bytes()).unwrap().is_sound);
        assert!(super::read(b"{\"seq\": 1}").is_none());
    }
}
