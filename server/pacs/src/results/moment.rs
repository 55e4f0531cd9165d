//! The dates and times of a result, in the zone of its source.

use imaging::dicom::Attributes;
use jiff::Timestamp;
use jiff::civil::{Date, DateTime, Time};
use jiff::tz::{Offset, TimeZone};

/// A moment as DICOM writes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Moment {
    /// Such as `20261122`.
    pub(super) date: String,
    /// Such as `153000`.
    pub(super) time: String,
    /// Such as `+0100`; `None` if the zone of the source is not known.
    pub(super) offset: Option<String>,
}

impl Moment {
    /// A moment in the zone of the source: in the one that it states, or else in the one of the configuration when the
    /// study was made. One offset holds for all dates and times of an object, also for those that are copied.
    /// If there is neither, it is in UTC and does not state so.
    pub(super) fn of(moment: Timestamp, source: &Attributes, zone: Option<&TimeZone>) -> Self {
        let stated = value(source, "TimezoneOffsetFromUTC").and_then(offset_of);
        let of_study = |zone: &TimeZone| match study(source) {
            Some(study) => zone
                .to_ambiguous_timestamp(study)
                .compatible()
                .map(|at| zone.to_offset(at)),
            None => Ok(zone.to_offset(moment)),
        };
        let offset = stated.or_else(|| of_study(zone?).ok());
        let here = offset.unwrap_or(Offset::UTC).to_datetime(moment);
        Self {
            date: here.strftime("%Y%m%d").to_string(),
            time: here.strftime("%H%M%S").to_string(),
            offset: offset.map(text_of),
        }
    }
}

/// The value of an attribute, unless it is empty.
pub(super) fn value<'a>(source: &'a Attributes, keyword: &str) -> Option<&'a str> {
    let mut attributes = source.attributes.iter();
    let found = attributes.find(|(name, value)| name == keyword && !value.is_empty());
    found.map(|(_, value)| value.as_str())
}

/// An offset as DICOM writes it (PS3.3 C.12.1.1.8).
fn offset_of(text: &str) -> Option<Offset> {
    let (sign, digits) = match text.split_at_checked(1)? {
        ("+", digits) => (1, digits),
        ("-", digits) => (-1, digits),
        _ => return None,
    };
    let is_sound = digits.len() == 4 && digits.bytes().all(|byte| byte.is_ascii_digit());
    let number: i32 = is_sound.then(|| digits.parse().ok())??;
    let minutes = number / 100 * 60 + number % 100;
    Offset::from_seconds(sign * 60 * minutes).ok()
}

fn text_of(offset: Offset) -> String {
    let minutes = offset.seconds() / 60;
    let sign = if minutes < 0 { '-' } else { '+' };
    format!("{sign}{:02}{:02}", minutes.abs() / 60, minutes.abs() % 60)
}

/// When the study was made, in the zone of the scanner.
fn study(source: &Attributes) -> Option<DateTime> {
    let date = Date::strptime("%Y%m%d", value(source, "StudyDate")?).ok()?;
    let time = value(source, "StudyTime").unwrap_or_default();
    let time: String = time
        .chars()
        .take_while(char::is_ascii_digit)
        .chain("000000".chars())
        .take(6)
        .collect();
    Some(date.to_datetime(Time::strptime("%H%M%S", time).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(texts: &[(&str, &str)], zone: Option<&TimeZone>) -> [Option<String>; 3] {
        let attributes = texts
            .iter()
            .map(|&(name, value)| (name.to_owned(), value.to_owned()));
        let source = Attributes {
            attributes: attributes.collect(),
            ..Attributes::default()
        };
        let at: Timestamp = "2026-11-23T00:30:15Z".parse().unwrap();
        let Moment { date, time, offset } = Moment::of(at, &source, zone);
        [Some(date), Some(time), offset]
    }

    #[test]
    fn the_zone_is_that_of_the_source_or_that_of_the_configuration_when_the_study_was_made() {
        let some = |texts: [&str; 3]| texts.map(|text| Some(text.to_owned()));
        let fixed = TimeZone::fixed(Offset::constant(-3));
        let offset = |text| moment(&[("TimezoneOffsetFromUTC", text)], Some(&fixed));
        assert_eq!(offset("+0100"), some(["20261123", "013015", "+0100"]));
        assert_eq!(offset("-0330"), some(["20261122", "210015", "-0330"]));
        assert_eq!(offset("Berlin"), some(["20261122", "213015", "-0300"]));
        let none = [Some("20261123".to_owned()), Some("003015".to_owned()), None];
        assert_eq!(moment(&[], None), none);
        // Summer time in Berlin ended on 2026-10-25.
        let Ok(berlin) = TimeZone::get("Europe/Berlin") else {
            eprintln!("SKIPPED: this machine knows no time zones");
            return;
        };
        let study = |day, time| moment(&[("StudyDate", day), ("StudyTime", time)], Some(&berlin));
        assert_eq!(
            study("20260701", "1011"),
            some(["20261123", "023015", "+0200"])
        );
        assert_eq!(study("20261101", ""), some(["20261123", "013015", "+0100"]));
    }
}
