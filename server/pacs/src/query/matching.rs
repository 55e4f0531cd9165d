//! Whether a value matches a key (PS3.4 C.2.2.2).

use jiff::civil::Date;

/// The key that matches what has no value, if the search asks for it (PS3.4 C.2.2.2.7).
pub(crate) const EMPTY: &str = "\"\"";

/// Whether a text is a date, a time, or a range of them: as the standard writes them, with the separators of its first
/// versions, and with an end left open. Parts at the end may be missing.
pub(crate) fn is_moment(vr: &str, wanted: &str) -> bool {
    let wanted = wanted.trim();
    let is_one: fn(&str) -> bool = match vr {
        "DA" => is_date,
        "TM" => is_time,
        _ => return true,
    };
    wanted.is_empty()
        || wanted == "*"
        || wanted
            .split('\\')
            .all(|one| match one.trim().split_once('-') {
                None => is_one(one.trim()),
                Some((from, to)) => {
                    let is_end = |end: &str| end.is_empty() || is_one(end);
                    is_end(from.trim()) && is_end(to.trim()) && !(from.is_empty() && to.is_empty())
                }
            })
}

fn is_date(text: &str) -> bool {
    let digits = text.replace('.', "");
    let part = |range: std::ops::Range<usize>| digits.get(range)?.parse::<i16>().ok();
    let short = |range| part(range).and_then(|part| i8::try_from(part).ok());
    let is_month = || short(4..6).is_some_and(|month| (1..=12).contains(&month));
    let is_day = || {
        let day = part(0..4).zip(short(4..6)).zip(short(6..8));
        day.is_some_and(|((year, month), day)| Date::new(year, month, day).is_ok())
    };
    digits.bytes().all(|byte| byte.is_ascii_digit())
        && match digits.len() {
            4 => true,
            6 => is_month(),
            8 => is_day(),
            _ => false,
        }
}

fn is_time(text: &str) -> bool {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = whole.replace(':', "");
    let are_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    let below = |at: usize, end: u32| {
        let part = digits
            .get(at..at + 2)
            .and_then(|part| part.parse::<u32>().ok());
        part.is_none_or(|part| part < end)
    };
    are_digits(&digits)
        && are_digits(fraction)
        && fraction.len() <= 6
        && matches!(digits.len(), 2 | 4 | 6)
        && below(0, 24)
        && below(2, 60)
        && below(4, 61)
}

/// Whether a held value matches what a key requests: an empty key matches everything, and a value that is not known
/// matches nothing else.
pub(crate) fn matches(vr: &str, wanted: &str, held: Option<&str>) -> bool {
    let wanted = wanted.trim();
    if wanted.is_empty() || wanted == "*" {
        return true;
    }
    let Some(held) = held.filter(|held| !held.is_empty()) else {
        return false;
    };
    let is_list = matches!(vr, "UI" | "CS");
    let wanted = wanted.split(|letter| letter == '\\' || is_list && letter == ',');
    let wanted: Vec<_> = wanted
        .map(str::trim)
        .filter(|text| !text.is_empty())
        .collect();
    held.split('\\').any(|held| {
        let held = held.trim();
        wanted.iter().any(|wanted| matches_one(vr, wanted, held))
    })
}

fn matches_one(vr: &str, wanted: &str, held: &str) -> bool {
    match vr {
        "UI" => wanted == held,
        "DA" | "TM" | "DT" => is_in_range(wanted, held),
        "IS" | "DS" | "US" | "SS" | "UL" | "SL" | "FL" | "FD" => {
            let numbers = wanted.parse::<f64>().ok().zip(held.parse::<f64>().ok());
            numbers.is_some_and(|(wanted, held)| wanted == held)
        }
        "PN" => has_form(&wanted.to_lowercase(), &held.to_lowercase()),
        _ => has_form(wanted, held),
    }
}

/// Whether a date or a time is within `from-to`, `from-`, `-to`, or begins as a single value does.
fn is_in_range(wanted: &str, held: &str) -> bool {
    let digits = |text: &str| {
        text.chars()
            .filter(char::is_ascii_digit)
            .collect::<String>()
    };
    let held = digits(held);
    let Some((from, to)) = wanted.split_once('-') else {
        let wanted = digits(wanted);
        return !wanted.is_empty() && held.starts_with(&wanted);
    };
    let (from, to) = (digits(from), digits(to));
    // What an upper end leaves open is included.
    let is_after = from.is_empty() || held.as_str() >= from.as_str();
    let is_before = to.is_empty() || held.as_str() <= to.as_str() || held.starts_with(&to);
    is_after && is_before
}

/// Whether a text has the form of a pattern: `*` stands for any letters, `?` for one.
fn has_form(pattern: &str, text: &str) -> bool {
    let pattern: Vec<char> = pattern.chars().collect();
    let text: Vec<char> = text.chars().collect();
    let (mut at, mut next) = (0, 0);
    // Where the last `*` is, and how much of the text it covers.
    let mut star: Option<(usize, usize)> = None;
    while at < text.len() {
        match pattern.get(next) {
            Some('*') => {
                star = Some((next, at));
                next += 1;
            }
            Some(&letter) if letter == '?' || letter == text[at] => {
                at += 1;
                next += 1;
            }
            _ => {
                let Some((place, covered)) = star else {
                    return false;
                };
                star = Some((place, covered + 1));
                (next, at) = (place + 1, covered + 1);
            }
        }
    }
    pattern[next..].iter().all(|&letter| letter == '*')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_matches_as_the_standard_says() {
        for (vr, wanted, held, expected) in [
            ("LO", "", None, true),
            ("LO", "*", None, true),
            ("LO", "P-7", None, false),
            ("LO", "P-7", Some("P-77"), false),
            ("LO", "P-*", Some("P-77"), true),
            ("LO", "p-*", Some("P-77"), false),
            ("LO", "?-7?", Some("P-77"), true),
            ("LO", "*7*7*", Some("P-77"), true),
            ("LO", "*7*7*7", Some("P-77"), false),
            ("PN", "*müll*", Some("Müller^Änne"), true),
            ("PN", "Änne", Some("Müller^Änne"), false),
            ("UI", "1.2,1.3", Some("1.3"), true),
            ("UI", "1.*", Some("1.3"), false),
            ("CS", "CT,MR", Some("SEG\\MR"), true),
            ("CS", "CT", Some("SEG\\MR"), false),
            ("DA", "20261101", Some("20261101"), true),
            ("DA", "20261001-20261031", Some("20261101"), false),
            ("DA", "20261101-", Some("20261101"), true),
            ("DA", "-20261101", Some("20261101"), true),
            ("DA", "-20261031", Some("20261101"), false),
            ("TM", "1000-1011", Some("101112.5"), true),
            ("TM", "1012-", Some("101112"), false),
            ("IS", "7", Some("07"), true),
            ("IS", "x", Some("7"), false),
        ] {
            assert_eq!(
                matches(vr, wanted, held),
                expected,
                "{vr} {wanted} {held:?}"
            );
        }
    }

    #[test]
    fn a_date_is_one_or_a_range() {
        for (vr, wanted, expected) in [
            ("DA", "20261101", true),
            ("DA", "202611", true),
            ("DA", "2026.11.01", true),
            ("DA", "20261001-20261031", true),
            ("DA", "-20261031", true),
            ("DA", "", true),
            ("DA", "*", true),
            ("DA", "-", false),
            ("DA", "20261301", false),
            ("DA", "20260230", false),
            ("DA", "20240229-20260229", false),
            ("DA", "2026-11-01", false),
            ("DA", "yesterday", false),
            ("TM", "1000-1011", true),
            ("TM", "101112.5", true),
            ("TM", "10:11", true),
            ("TM", "2500", false),
            ("LO", "yesterday", true),
        ] {
            assert_eq!(is_moment(vr, wanted), expected, "{vr} {wanted}");
        }
    }

    #[test]
    fn a_pattern_of_many_stars_is_no_burden() {
        let pattern = "*a".repeat(200) + "b";
        assert!(!has_form(&pattern, &"a".repeat(1024)));
    }
}
