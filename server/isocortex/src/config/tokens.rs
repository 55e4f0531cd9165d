//! The file of the named tokens.

use std::collections::HashSet;
use std::time::SystemTime;

use access::scopes::Scope;
use access::tokens::{ANYBODY, Holder, NamedToken, UNNAMED};
use jiff::civil::Date;
use jiff::tz::TimeZone;
use serde::Deserialize;

/// The longest name of a token.
const MAX_NAME: usize = 64;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    tokens: Vec<Entry>,
}

/// One token: `isocortex token new` writes it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    scopes: Vec<String>,
    /// The last day on which it opens, in UTC.
    until: Option<Date>,
    /// The digest of the token, 64 hexadecimal digits.
    blake3: String,
}

/// Reads the tokens of a file.
///
/// # Errors
/// What is wrong, in one sentence. It repeats nothing that could be a token.
pub(super) fn parse(text: &str) -> Result<Vec<NamedToken>, String> {
    // The message of the parser would repeat the line.
    let file: File = toml::from_str(text).map_err(|error| match error.span() {
        Some(span) => {
            let line = 1 + text[..span.start].matches('\n').count();
            format!("line {line}: {}", error.message())
        }
        None => error.message().to_owned(),
    })?;
    let mut names = HashSet::new();
    let mut digests = HashSet::new();
    let mut tokens = Vec::new();
    for entry in file.tokens {
        check_name(&entry.name)?;
        let of = |why: String| format!("the token `{}`: {why}", entry.name);
        if !names.insert(entry.name.clone()) {
            return Err(of("there are two of this name".to_owned()));
        }
        if entry.scopes.is_empty() {
            return Err(of("it has no scope".to_owned()));
        }
        let scopes = (entry.scopes.iter()).map(|word| word.parse::<Scope>());
        let scopes = scopes.collect::<Result<_, _>>().map_err(of)?;
        let digest = blake3::Hash::from_hex(&entry.blake3);
        let digest =
            digest.map_err(|_| of("`blake3` must have 64 hexadecimal digits".to_owned()))?;
        // Otherwise the scopes and the end of the first one would hold for both.
        if !digests.insert(digest) {
            return Err(of("another token has the same `blake3`".to_owned()));
        }
        tokens.push(NamedToken {
            holder: Holder {
                name: entry.name.as_str().into(),
                scopes,
            },
            digest,
            ends: entry.until.map(end_of).transpose().map_err(of)?,
        });
    }
    Ok(tokens)
}

/// Checks the name of a token, which log lines repeat.
///
/// # Errors
/// What is wrong, in one sentence.
pub(crate) fn check_name(name: &str) -> Result<(), String> {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"._@-".contains(&byte);
    if [UNNAMED, ANYBODY].contains(&name) {
        return Err(format!(
            "`{name}` stands for whoever has no name; choose another name"
        ));
    }
    if name == "isocortex" {
        return Err("`isocortex` stands for the program itself; choose another name".to_owned());
    }
    if (1..=MAX_NAME).contains(&name.len()) && name.bytes().all(is_plain) {
        return Ok(());
    }
    Err(format!(
        "the name of a token must be 1 to {MAX_NAME} letters, digits and `.`, `_`, `@`, `-`"
    ))
}

/// The end of a day in UTC.
fn end_of(day: Date) -> Result<SystemTime, String> {
    let end = day.tomorrow().and_then(|next| next.to_zoned(TimeZone::UTC));
    let end = end.map_err(|_| "`until` is too far away".to_owned())?;
    Ok(end.timestamp().into())
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIGEST: &str = "6437b3ac38465133ffb63b75273a8db548c558465d79db03fd359c6cd5bd9d85";
    const OTHER: &str = "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262";

    #[test]
    fn a_file_gives_names_scopes_and_ends() {
        let text = format!(
            "[[tokens]]\nname = \"orthanc\"\nscopes = [\"dicom-store\", \"read\"]\nuntil = \"2027-01-31\"\nblake3 = \"{DIGEST}\"\n\
             [[tokens]]\nname = \"dr.silva@site\"\nscopes = [\"read\"]\nblake3 = \"{OTHER}\"\n"
        );
        let tokens = parse(&text).unwrap();
        let [pacs, reader] = &tokens[..] else {
            panic!("{tokens:?}")
        };
        assert_eq!(&*pacs.holder.name, "orthanc");
        assert_eq!(pacs.holder.scopes, [Scope::Read, Scope::DicomStore].into());
        let end: jiff::Timestamp = "2027-02-01T00:00:00Z".parse().unwrap();
        assert_eq!(pacs.ends, Some(end.into()));
        assert_eq!(reader.ends, None);
        assert!(parse("").unwrap().is_empty());
    }

    #[test]
    fn what_is_wrong_is_said_without_the_token() {
        let entry = |name: &str, scopes: &str, rest: &str| {
            format!("[[tokens]]\nname = \"{name}\"\nscopes = [{scopes}]\n{rest}\n")
        };
        let good = format!("blake3 = \"{DIGEST}\"");
        for (text, part) in [
            (entry("a b", "\"read\"", &good), "the name of a token"),
            (entry("token", "\"read\"", &good), "choose another name"),
            (entry("a", "", &good), "it has no scope"),
            (entry("a", "\"all\"", &good), "`all` is no scope"),
            (
                entry("a", "\"read\"", "blake3 = \"secret\""),
                "64 hexadecimal digits",
            ),
            (
                entry("a", "\"read\"", "token = \"secret\""),
                "line 4: unknown field `token`",
            ),
            (entry("a", "\"read\"", &good).repeat(2), "two of this name"),
            (
                entry("a", "\"admin\"", &good) + &entry("b", "\"read\"", &good),
                "the token `b`: another token has the same `blake3`",
            ),
            (
                entry("a", "\"read\"", &format!("until = \"soon\"\n{good}")),
                "line 4",
            ),
        ] {
            let why = parse(&text).unwrap_err();
            assert!(why.contains(part), "{why}");
            assert!(!why.contains("secret"), "{why}");
        }
    }
}
