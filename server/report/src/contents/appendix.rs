//! What is looked up: the acquisition, what was dismissed or not kept, and the whole head.

use case::findings::Finding;
use case::{CandidateFacts, MapName};
use render::NamedView;

use super::{
    Block, Facts, Line, MAX_CANDIDATES, Overview, Picture, Table, caveat, gyrus_of, millimetres,
    place_of, position,
};
use crate::pictures::{DEPTHS_MM, Shot};
use crate::words::Words;
use crate::{ListedMap, Reason, Report, ReportMaps};

/// The most places outside of the cerebrum in a table.
const MAX_ELSEWHERE: usize = 5;
/// The most places of a map for which no limit is known.
const MAX_UNJUDGED: usize = 5;

impl Report {
    /// What is looked up: how the images were acquired, what was dismissed or not kept, and the whole head.
    pub(super) fn appendix(&self, words: &Words) -> Vec<Block<'_>> {
        let mut blocks = vec![
            Block::Heading(words.appendix.into()),
            Block::Facts(self.about(words)),
        ];
        if !self.dismissed.is_empty() {
            let lines = self.dismissed.iter();
            let lines = lines.map(|finding| line_about(words, finding));
            blocks.push(Block::Subheading(words.dismissed.into()));
            blocks.push(Block::List(lines.collect()));
        }
        blocks.extend(self.places(words));
        blocks.push(overview(words, words.overview, &self.overview.anatomy));
        if !self.overview.map.is_empty() {
            blocks.push(overview(words, words.overview_of_map, &self.overview.map));
        }
        blocks
    }

    fn about(&self, words: &Words) -> Facts {
        let mut facts = vec![
            (words.case, self.case.id.to_string().into()),
            (words.acquisition, self.acquisition(words)),
        ];
        if let Some(state) = self.state_of_mask() {
            facts.push((words.mask, words.state(state).into()));
        }
        facts.push((words.letters, words.legend_of_letters().into()));
        let version = format!("Isocortex {}", env!("CARGO_PKG_VERSION"));
        facts.push((words.made_by, version.into()));
        facts
    }

    fn acquisition(&self, words: &Words) -> Line {
        let [x, y, z] = self.facts.native_size;
        let spacing = self.facts.native_spacing_mm.map(|mm| words.number(mm, 2));
        let dicom = self.facts.dicom.as_ref();
        let sequence = dicom.and_then(|dicom| dicom.sequence.as_deref());
        let size = format!(
            " · {x} × {y} × {z} {}, {} mm",
            words.voxels,
            spacing.join(" × ")
        );
        let line = match sequence {
            Some(sequence) => Line::foreign(sequence),
            None => words.unknown.into(),
        };
        let line = line.and(size);
        let Some(layer) = &self.layer else {
            return line;
        };
        let line = line.and(" · ").and_foreign(&layer.name);
        match layer.may_lie_elsewhere {
            true => line.and(format!(" ({})", words.may_lie_elsewhere)),
            false => line,
        }
    }

    /// The places that were not kept, in the order of their lists.
    fn places(&self, words: &Words) -> Vec<Block<'_>> {
        let Ok(maps) = &self.maps else {
            return Vec::new();
        };
        let mut blocks = vec![Block::Heading(words.candidates.into())];
        blocks.extend(self.blurred(words, maps));
        let about = [
            words.thickness(),
            words.thickness_note(),
            words.nothing_is_thick(),
        ];
        blocks.extend(self.others(words, about, MapName::Thickness, &maps.thickness));
        let flair = self.flair.iter();
        blocks.extend(flair.flat_map(|flair| self.bright_places(words, flair)));
        blocks
    }

    /// The places of the map of blur: those that stand out, then all others.
    fn blurred(&self, words: &Words, maps: &ReportMaps) -> Vec<Block<'static>> {
        let ranked = listed(&maps.blur, MAX_CANDIDATES);
        let ranked = ranked.filter(|(_, place)| !self.is_kept(MapName::Blur, place));
        let (first, others): (Vec<_>, Vec<_>) = ranked
            .map(|(rank, place)| (rank.to_string(), *place))
            .partition(|(_, place)| place.stands_out());
        let elsewhere = maps.elsewhere.iter().take(MAX_ELSEWHERE);
        let elsewhere = elsewhere.filter(|place| !self.is_kept(MapName::Blur, place));
        // The limits were read off the cerebrum.
        let unjudged = |place: &CandidateFacts| CandidateFacts {
            unusual: None,
            ..*place
        };
        let elsewhere = elsewhere.map(|place| (String::new(), unjudged(place)));
        let mut note = Some(words.candidates_note);
        let mut blocks = Vec::new();
        for (heading, note, rows) in [
            (None, note.take_if(|_| !first.is_empty()), first),
            (Some(words.others), note.take(), others),
            (
                Some(words.elsewhere),
                Some(words.elsewhere_note),
                elsewhere.collect(),
            ),
        ] {
            if rows.is_empty() {
                continue;
            }
            blocks.extend(heading.map(|heading| Block::Subheading(heading.into())));
            blocks.extend(note.map(|note| Block::Text(note.into())));
            blocks.push(table_of_places(words, rows));
        }
        blocks
    }

    /// The brightest places of the FLAIR, for which no limit is known, or why there is no such map.
    fn bright_places(
        &self,
        words: &Words,
        flair: &Result<ListedMap, Reason>,
    ) -> Vec<Block<'static>> {
        match flair {
            Ok(maps) => {
                let about = [words.flair(), words.flair_note(), ""];
                self.others(words, about, MapName::Flair, maps)
            }
            Err(reason) => {
                let why = words.reason(&reason.code, &reason.sentence);
                vec![
                    Block::Subheading(words.flair().into()),
                    Block::Text(words.no_map_of_flair(why).into()),
                ]
            }
        }
    }

    /// The places of a map that stand out, or that none does; or, if no limit is known, the highest ones. With its heading, a note
    /// about it, and what there is to say if none stands out.
    fn others(
        &self,
        words: &Words,
        [heading, note, nothing]: [&'static str; 3],
        map: MapName,
        list: &ListedMap,
    ) -> Vec<Block<'static>> {
        let has_limits = list.has_limits;
        let most = if has_limits {
            MAX_CANDIDATES
        } else {
            MAX_UNJUDGED
        };
        let ranked = listed(list, most);
        let mut rows: Vec<_> = ranked
            .filter(|(_, place)| place.stands_out() || !has_limits)
            .map(|(rank, place)| (rank.to_string(), *place))
            .collect();
        let mut blocks = vec![Block::Subheading(heading.into())];
        if rows.is_empty() && has_limits {
            blocks.push(Block::Text(nothing.into()));
            return blocks;
        }
        blocks.push(Block::Text(note.into()));
        blocks.extend(caveat(words, list));
        rows.retain(|(_, place)| !self.is_kept(map, place));
        if !rows.is_empty() {
            blocks.push(table_of_places(words, rows));
        }
        blocks
    }
}

/// The first places of a list with their ranks, and all others that stand out.
fn listed(list: &ListedMap, most: usize) -> impl Iterator<Item = (usize, &CandidateFacts)> {
    let ranked = (1..).zip(&list.places);
    ranked.filter(move |(rank, place)| *rank <= most || place.stands_out())
}

/// A table of places with their ranks; with gyri if any has one.
fn table_of_places(words: &Words, places: Vec<(String, CandidateFacts)>) -> Block<'static> {
    let has_gyri = places.iter().any(|(_, place)| place.gyrus.is_some());
    let mut head = vec![
        words.rank,
        words.side,
        words.region,
        words.depth,
        words.position,
        words.score,
        words.unusual,
        words.size,
    ];
    let mut rows: Vec<_> = places
        .iter()
        .map(|(rank, place)| row_of(words, rank, place))
        .collect();
    if has_gyri {
        head.insert(2, words.about_gyrus());
        for (row, (_, place)) in rows.iter_mut().zip(&places) {
            row.insert(2, gyrus_of(words, place.gyrus).into());
        }
    }
    Block::Table(Table { head, rows })
}

fn row_of(words: &Words, rank: &str, place: &CandidateFacts) -> Vec<Line> {
    vec![
        rank.into(),
        words.side(place.side).into(),
        words.region(place.region).into(),
        (place.depth_mm)
            .map_or("–".to_owned(), |depth_mm| millimetres(words, depth_mm))
            .into(),
        position(words, place.position_in_patient).into(),
        words.number(place.score, 2).into(),
        words.unusual(place.unusual).into(),
        format!("{:.0} mm", place.size_mm).into(),
    ]
}

fn line_about(words: &Words, finding: &Finding) -> Line {
    let place = format!(
        " ({}, {}, {})",
        place_of(words, finding),
        millimetres(words, finding.depth_mm),
        position(words, finding.middle_in_patient()),
    );
    let line = Line::foreign(&finding.label).and(place);
    match &*finding.note {
        "" => line,
        note => line.and(": ").and_foreign(note),
    }
}

fn overview<'a>(words: &Words, title: &'static str, rows: &'a [Vec<Shot>]) -> Block<'a> {
    let row = |(depth_mm, shots): (&f32, &'a Vec<Shot>)| {
        let pictures = shots.iter().zip(NamedView::ALL);
        let pictures = pictures.map(|(shot, view)| {
            let caption = format!("{depth_mm} mm, {}", words.view(view));
            let caption = caption.into();
            Picture { shot, caption }
        });
        (format!("{depth_mm} mm"), pictures.collect())
    };
    Block::Overview(Overview {
        title,
        columns: NamedView::ALL.map(|view| words.view(view)).to_vec(),
        rows: DEPTHS_MM.iter().zip(rows).map(row).collect(),
    })
}
