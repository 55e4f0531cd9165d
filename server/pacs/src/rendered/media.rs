//! The media type of an answer with pictures.

use axum::http::{HeaderMap, StatusCode, header};

use http::negotiate::{Accepted, MediaType};
use http::problem::AppError;

/// The kind of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Jpeg,
    Png,
}

impl Kind {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Jpeg => "image/jpeg",
            Self::Png => "image/png",
        }
    }

    fn accepted_by(kind: &str) -> Option<Self> {
        match kind {
            "image/jpeg" | "image/*" | "*/*" => Some(Self::Jpeg),
            "image/png" => Some(Self::Png),
            _ => None,
        }
    }
}

/// What the client accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Answer {
    pub(crate) kind: Kind,
    /// Whether each picture is a part.
    pub(crate) is_multipart: bool,
}

/// The first accepted media type that is available; several pictures are only available as parts.
///
/// What the query accepts counts instead of the header.
pub(crate) fn accepted(
    query: Option<&str>,
    headers: &HeaderMap,
    are_several: bool,
) -> Result<Answer, AppError> {
    let ranges = match query {
        Some(text) => Accepted::parse(text),
        None => match Accepted::read(headers, header::ACCEPT) {
            Accepted(none) if none.is_empty() => Accepted::parse("*/*"),
            ranges => ranges,
        },
    };
    let ranges = ranges.0.into_iter();
    let answers =
        ranges.filter_map(|(range, quality)| Some((quality, answer(&range, are_several)?)));
    let mut answers: Vec<_> = answers.collect();
    // The greatest quality first, and of equal ones the first.
    answers.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    match answers.first() {
        Some(&(quality, answer)) if quality > 0.0 => Ok(answer),
        _ => Err(AppError::new(
            StatusCode::NOT_ACCEPTABLE,
            "not-acceptable",
            "none of the accepted media types is available; available types: image/jpeg, image/png, and for several pictures multipart/related of these",
        )),
    }
}

fn answer(range: &MediaType, are_several: bool) -> Option<Answer> {
    let is_multipart = range.essence == "multipart/related";
    let kind = match is_multipart {
        true => Kind::accepted_by(range.parameter("type").unwrap_or("*/*"))?,
        false => Kind::accepted_by(&range.essence)?,
    };
    let is_any = range.essence == "*/*";
    if are_several && !is_multipart && !is_any {
        return None;
    }
    Some(Answer {
        kind,
        is_multipart: is_multipart || are_several,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(accept: &str, are_several: bool) -> Option<(Kind, bool)> {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT, accept.parse().unwrap());
        let answer = accepted(None, &headers, are_several).ok()?;
        Some((answer.kind, answer.is_multipart))
    }

    #[test]
    fn jpeg_is_the_default_and_gif_is_not_available() {
        let none = accepted(None, &HeaderMap::new(), false).unwrap();
        assert_eq!((none.kind, none.is_multipart), (Kind::Jpeg, false));
        let png = accepted(Some("image/png"), &HeaderMap::new(), false).unwrap();
        assert_eq!(png.kind, Kind::Png);
        assert!(accepted(Some("image/gif"), &HeaderMap::new(), false).is_err());
        assert_eq!(asked("*/*", false), Some((Kind::Jpeg, false)));
        assert_eq!(asked("image/png", false), Some((Kind::Png, false)));
        assert_eq!(asked("image/gif", false), None);
        assert_eq!(
            asked("image/gif, image/png;q=0.5", false),
            Some((Kind::Png, false))
        );
        assert_eq!(
            asked("image/jpeg;q=0.1, image/png;q=0.5", false),
            Some((Kind::Png, false))
        );
        assert_eq!(asked("image/png;q=0", false), None);
        let parts = r#"multipart/related; type="image/png""#;
        assert_eq!(asked(parts, false), Some((Kind::Png, true)));
        assert_eq!(asked(parts, true), Some((Kind::Png, true)));
        assert_eq!(asked("*/*", true), Some((Kind::Jpeg, true)));
        assert_eq!(asked("image/jpeg", true), None);
        assert_eq!(asked(r#"multipart/related; type="image/gif""#, true), None);
    }
}
