//! The first page: what is in doubt, the conclusion, the findings, and a line to sign.

use case::{MapName, QualityState};

use super::{
    Block, Facts, Line, Picture, Table, caveat, certainty_of, gyrus_of, place_of, shortened,
    side_of,
};
use crate::words::Words;
use crate::{Report, ReportedFinding, ReportedReading, ShownPatient};

/// The most findings in the conclusion, and the most letters of a note in it: all of them and the whole of it have their own pages.
const MAX_CONCLUDED: usize = 5;
pub(super) const MAX_CONCLUDED_LETTERS: usize = 200;

impl Report {
    /// What is to be known first, on one page unless there is very much of it.
    pub(super) fn front(&self, words: &Words) -> Vec<Block<'_>> {
        let mut blocks = Vec::from_iter(self.warning(words));
        blocks.extend([Block::Title(words.title), Block::Notice(words.notice)]);
        let mut facts = vec![(words.case, Line::foreign(&words.identity(&self.case)))];
        if let Some(patient) = &self.patient {
            facts.push((words.patient, patient_of(words, patient)));
        }
        blocks.push(Block::Facts(facts));
        let first = self.findings.first();
        blocks.extend(first.and_then(|reported| self.key_picture(words, reported)));
        blocks.push(Block::Heading(words.conclusion.into()));
        blocks.extend(self.conclusion(words));
        blocks.extend(self.told_by_maps(words));
        let doubted = self.layer.iter().filter(|layer| layer.may_lie_elsewhere);
        blocks.extend(doubted.map(|layer| {
            let line = Line::foreign(&layer.name).and(": ");
            Block::Text(line.and(words.may_lie_elsewhere))
        }));
        blocks.extend(self.table_of_findings(words));
        blocks.push(Block::Sign(self.signature(words)));
        blocks
    }

    /// The cut of the first finding.
    fn key_picture<'a>(
        &'a self,
        words: &Words,
        reported: &'a ReportedFinding,
    ) -> Option<Block<'a>> {
        let [shot, _] = reported.pictures.cuts.first()?;
        let caption = Line::from(format!("{} 1: ", words.finding));
        let caption = caption.and_line(self.shown(words, reported, shot));
        Some(Block::KeyPicture(Picture { shot, caption }))
    }

    /// What the reader concludes; without a reading, what was written of the first findings, in short, or that nothing was marked.
    fn conclusion(&self, words: &Words) -> Vec<Block<'static>> {
        if let Some(reading) = &self.reading {
            let lines = reading.conclusion.lines();
            let written = lines.filter(|line| !line.trim().is_empty());
            let written = written.map(|line| Block::Large(Line::foreign(line)));
            let template = reading.template.stated();
            let template = template.map(|(field, word)| {
                let value = words.template_word(field, word);
                (words.template_field(field), value.into())
            });
            let template: Facts = template.collect();
            let template = (!template.is_empty()).then_some(Block::Facts(template));
            return written.chain(template).collect();
        }
        if self.findings.is_empty() {
            return vec![Block::Large(words.no_findings.into())];
        }
        let numbered = (1_usize..).zip(&self.findings).take(MAX_CONCLUDED);
        let sentence = |(number, ReportedFinding { finding, .. }): (usize, &ReportedFinding)| {
            let number = Line::strong(&format!("{number}  "));
            let named = match &*finding.label {
                "" => number.and(place_of(words, finding)),
                label => number.and_foreign(label),
            };
            let short = shortened(&finding.note, MAX_CONCLUDED_LETTERS);
            Block::Large(match &*short {
                "" => named,
                short => named.and(": ").and_foreign(short),
            })
        };
        let mut blocks: Vec<_> = numbered.map(sentence).collect();
        if let more @ 1.. = self.findings.len().saturating_sub(MAX_CONCLUDED) {
            blocks.push(Block::Large(format!("… + {more}").into()));
        }
        blocks
    }

    /// Which places stand out, or why that is not known; and what makes it doubtful.
    fn told_by_maps(&self, words: &Words) -> Vec<Block<'static>> {
        let maps = match &self.maps {
            Ok(maps) => maps,
            Err(reason) => {
                let why = words.reason(&reason.code, &reason.sentence);
                return vec![Block::Text(format!("{} {why}", words.no_maps).into())];
            }
        };
        let mut blocks = Vec::new();
        for (map, list) in [
            (MapName::Blur, &maps.blur),
            (MapName::Thickness, &maps.thickness),
        ] {
            let all = list.places.iter().filter(|place| place.stands_out());
            let left = all.clone().filter(|place| !self.is_kept(map, place));
            match [all.count(), left.count()] {
                [0, _] if map == MapName::Blur => {
                    blocks.push(Block::Text(words.nothing_stands_out().into()));
                }
                [0, _] => {}
                counts => blocks.push(Block::Text(words.standing_out(map, counts).into())),
            }
        }
        blocks.extend(caveat(words, &maps.blur));
        if maps.regions.state != QualityState::Ok {
            let reason = maps.regions.reasons.first().map_or("", String::as_str);
            let code = maps.regions.reason_codes.first().map_or("", String::as_str);
            let doubt = words.doubt_of_regions(words.reason(code, reason));
            blocks.push(Block::Text(doubt.into()));
        }
        blocks
    }

    fn table_of_findings(&self, words: &Words) -> Option<Block<'static>> {
        let has_gyri = (self.findings.iter()).any(|reported| reported.finding.gyrus.is_some());
        let mut head = vec![
            words.finding,
            words.side,
            words.size,
            words.certainty,
            words.score,
            words.map_of,
            words.label,
        ];
        if has_gyri {
            head.insert(2, words.about_gyrus());
        }
        let row = |(number, ReportedFinding { finding, .. }): (usize, &ReportedFinding)| {
            let place = self.place_of(finding);
            let score = place.map_or("–".to_owned(), |(_, place)| words.number(place.score, 2));
            let map = finding.from_map.map_or("–", |map| words.map(map));
            let mut row = vec![
                number.to_string().into(),
                side_of(words, finding).into(),
                self.size(words, finding).into(),
                match certainty_of(words, finding) {
                    doubt if finding.is_unconfirmed => Line::strong(doubt),
                    certainty => certainty.into(),
                },
                score.into(),
                map.into(),
                Line::foreign(&finding.label),
            ];
            if has_gyri {
                row.insert(2, gyrus_of(words, finding.gyrus).into());
            }
            row
        };
        let rows: Vec<_> = (1..).zip(&self.findings).map(row).collect();
        (!rows.is_empty()).then_some(Block::Table(Table { head, rows }))
    }

    /// Who read the case, and when; each may be written by hand where it is not signed.
    fn signature(&self, words: &Words) -> Facts {
        if let Some(reading) = &self.reading {
            return signature_of(words, reading);
        }
        let findings = || self.findings.iter().map(|reported| &reported.finding);
        let mut authors: Vec<&str> = findings().filter_map(|one| one.author.as_deref()).collect();
        authors.sort_unstable();
        authors.dedup();
        let last = findings().filter_map(|one| one.changed_at.as_deref()).max();
        let day = last.and_then(|time| time.get(..10)).unwrap_or_default();
        vec![
            (words.reader, Line::foreign(&authors.join(", "))),
            (words.day, day.into()),
            (words.signature, Line::default()),
        ]
    }
}

/// Who has signed a reading, and when; or who may.
fn signature_of(words: &Words, reading: &ReportedReading) -> Facts {
    let signed = reading.signed_at.as_deref();
    let signed = signed.and_then(|at| Some((at.get(..10)?, at.get(11..16)?)));
    let Some((day, time)) = signed else {
        return vec![
            (words.reader, Line::foreign(&reading.reader)),
            (words.day, Line::default()),
            (words.signature, Line::default()),
        ];
    };
    let text = words.signed.replace("{day}", day).replace("{time}", time);
    let (before, after) = text.split_once("{reader}").unwrap_or((&text, ""));
    let line = Line::from(before).and_foreign(&reading.reader).and(after);
    vec![(words.signature, line)]
}

/// The patient as the page has it, and the study.
fn patient_of(words: &Words, patient: &ShownPatient) -> Line {
    let ShownPatient::Named {
        patient,
        sex,
        study_day,
        accession_number,
    } = patient
    else {
        return words.not_from_dicom.into();
    };
    let line = Line::foreign(patient);
    let line = match sex {
        Some(sex) => line.and(" · ").and_foreign(sex),
        None => line,
    };
    let study = [
        (words.study_of, study_day),
        (words.accession_number, accession_number),
    ];
    study
        .into_iter()
        .fold(line, |line, (name, value)| match value {
            Some(value) => line.and(format!(" · {name} ")).and_foreign(value),
            None => line,
        })
}
