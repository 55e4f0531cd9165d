//! What a series becomes beside the cases that were made of its images before.

use std::collections::HashMap;

use case::images::Image;
use case::{CaseId, CaseState};

use crate::values::MadeCase;

/// What a series becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Becomes {
    /// It is this case already: all its images are among those that it was made of.
    Known(CaseId),
    /// A case: a version of another one, if it has all images of an open case, and more.
    New(Option<CaseId>),
    /// Nothing yet: of so many images of a closed case, so many have come again.
    Incomplete { again: usize, of: usize },
}

/// The preferred of some cases that come newest first: the one with most images, and of equal ones the newest that can be seen.
fn first<'a>(made: impl Iterator<Item = &'a MadeCase>) -> Option<&'a MadeCase> {
    let rank = |made: &&MadeCase| (made.images.len(), made.state == CaseState::Ready);
    made.reduce(|best, next| {
        if rank(&next) > rank(&best) {
            next
        } else {
            best
        }
    })
}

/// What a series of these images becomes. Whoever takes it does not wait for what is missing.
pub(crate) fn becomes(images: &[Image], made: &[MadeCase], is_taken: bool) -> Becomes {
    let prints: HashMap<_, _> = (images.iter())
        .map(|image| (&image.uid, &image.fingerprint))
        .collect();
    let shared = |made: &MadeCase| {
        let own = made.images.iter();
        own.filter(|image| {
            let print = prints.get(&image.uid);
            print.is_some_and(|print| print.is_same(&image.fingerprint))
        })
        .count()
    };
    let open = || {
        let open = made.iter().filter(|made| made.closed.is_none());
        open.filter(|made| made.state != CaseState::Failed)
    };
    let known = open().filter(|made| shared(made) == prints.len());
    if let Some(known) = first(known) {
        return Becomes::Known(known.case);
    }
    // What was uploaded is nothing that the PACS would correct.
    let closed = made
        .iter()
        .filter(|made| made.closed.is_some() && made.is_received);
    let count = |made: &MadeCase| {
        let again = made.images.iter().filter(|image| image.has_come_again);
        (again.count(), made.images.len())
    };
    let mut incomplete = closed.map(count).filter(|(again, of)| again < of);
    if let Some((again, of)) = incomplete.next().filter(|_| !is_taken) {
        return Becomes::Incomplete { again, of };
    }
    let within = open().filter(|made| shared(made) == made.images.len());
    Becomes::New(first(within).map(|made| made.case))
}

#[cfg(test)]
mod tests {
    use case::Closed;
    use case::images::Fingerprint;
    use case::series::Uid;

    use super::*;
    use crate::values::MadeImage;

    fn uid(number: usize) -> Uid {
        Uid::parse(&format!("1.2.{number}")).unwrap()
    }

    fn print(version: usize) -> Fingerprint {
        Fingerprint::new(&format!("{version:032x}"), false, Vec::new()).unwrap()
    }

    /// Images with these numbers, all of one version.
    fn images(numbers: std::ops::Range<usize>, version: usize) -> Vec<Image> {
        numbers
            .map(|number| Image {
                uid: uid(number),
                fingerprint: print(version),
                times: 0,
            })
            .collect()
    }

    fn made(
        case: u8,
        closed: Option<Closed>,
        of: std::ops::Range<usize>,
        has_come_again: impl Fn(usize) -> bool,
    ) -> MadeCase {
        MadeCase {
            case: CaseId::parse(&format!("{case:032x}")).unwrap(),
            state: CaseState::Ready,
            closed,
            is_received: true,
            images: of
                .map(|number| MadeImage {
                    uid: uid(number),
                    fingerprint: print(1),
                    has_come_again: has_come_again(number),
                })
                .collect(),
        }
    }

    #[test]
    fn the_same_images_or_fewer_are_the_case_that_is_there_and_more_are_a_version() {
        let never = |_| false;
        let held = [made(1, None, 0..10, never), made(2, None, 0..12, never)];
        assert_eq!(
            becomes(&images(0..10, 1), &held, false),
            Becomes::Known(held[1].case)
        );
        assert_eq!(
            becomes(&images(3..5, 1), &held, false),
            Becomes::Known(held[1].case)
        );
        let version = Becomes::New(Some(held[1].case));
        assert_eq!(becomes(&images(0..20, 1), &held, false), version);
        // Some of the images, and others: neither.
        assert_eq!(becomes(&images(5..20, 1), &held, false), Becomes::New(None));
        let mut failed = held[0].clone();
        failed.state = CaseState::Failed;
        assert_eq!(
            becomes(&images(0..10, 1), &[failed], false),
            Becomes::New(None)
        );
    }

    #[test]
    fn a_correction_waits_until_every_image_has_come_again_and_inherits_nothing() {
        let corrected = Some(Closed::Corrected);
        let partly = [made(1, corrected, 0..10, |number| number < 4)];
        let new = images(0..10, 2);
        let incomplete = Becomes::Incomplete { again: 4, of: 10 };
        assert_eq!(becomes(&new, &partly, false), incomplete);
        assert_eq!(becomes(&new, &partly, true), Becomes::New(None));
        let mut uploaded = partly.clone();
        uploaded[0].is_received = false;
        assert_eq!(becomes(&new, &uploaded, false), Becomes::New(None));
        let wholly = [made(1, corrected, 0..10, |_| true)];
        assert_eq!(becomes(&new, &wholly, false), Becomes::New(None));
        // The correction was taken back, which opened the case.
        let open = [made(1, None, 0..10, |_| true)];
        assert_eq!(
            becomes(&images(0..10, 1), &open, false),
            Becomes::Known(open[0].case)
        );
    }
}
