//! The pages of a finding.

use case::findings::{Finding, FindingKind};
use case::{CandidateFacts, MapName, PatientSide, StandardPosition};
use geometry::{flat_area_of, length_of};
use glam::DVec3;

use super::{
    Block, CUT_ABOVE_SLICES_MM, CUT_MM, Line, Picture, SLICE_BELOW_CUTS_MM, SLICE_MM, Table,
    certainty_of, gyrus_of, millimetres, position, shortened, side_of,
};
use crate::pictures::{Shot, Shows, Through};
use crate::words::Words;
use crate::{Numbers, Report, ReportedFinding, Values};

/// The most letters of a layer's name under a picture, so that four rows of slices fit on a page.
const MAX_LETTERS_OF_LAYER: usize = 24;

/// So near to a place of a list a finding is of it, in mm.
const SAME_PLACE_MM: f64 = 0.5;

impl Report {
    pub(super) fn finding<'a>(
        &'a self,
        words: &Words,
        number: usize,
        reported: &'a ReportedFinding,
    ) -> Vec<Block<'a>> {
        let ReportedFinding {
            finding,
            pictures,
            numbers,
        } = reported;
        let name = format!("{} {number}", words.finding);
        let heading = match finding.label.as_str() {
            "" => name.into(),
            label => Line::from(format!("{name}: ")).and_foreign(label),
        };
        let mut facts = vec![
            (words.side, Line::strong(side_of(words, finding))),
            (words.depth, millimetres(words, finding.depth_mm).into()),
            (
                words.position,
                position(words, finding.middle_in_patient()).into(),
            ),
            (words.kind, words.kind(finding.kind).into()),
        ];
        if finding.gyrus.is_some() {
            let name = gyrus_of(words, finding.gyrus);
            facts.insert(1, (words.about_gyrus(), name.into()));
        }
        facts.extend(standard(words, finding));
        facts.extend(measures(words, finding));
        let certainty = certainty_of(words, finding);
        if !certainty.is_empty() {
            facts.push((words.certainty, certainty.into()));
        }
        if let Some(map) = finding.from_map {
            facts.push((words.map_of, words.map(map).into()));
        }
        if let Some((rank, place)) = self.place_of(finding) {
            facts.extend(rank.map(|rank| (words.rank, rank.to_string().into())));
            facts.extend([
                (words.score, words.number(place.score, 2).into()),
                (words.unusual, words.unusual(rank.and(place.unusual)).into()),
                (words.size, self.size(words, finding).into()),
                (words.region, words.region(place.region).into()),
            ]);
        }
        if let Some(author) = &finding.author {
            let time = finding.changed_at.as_deref();
            let time = time.map(|time| format!(", {}", minute(time)));
            let line = Line::foreign(author).and(time.unwrap_or_default());
            facts.push((words.author, line));
        }
        let mut blocks = vec![Block::Heading(heading)];
        if !finding.note.is_empty() {
            blocks.push(Block::Text(Line::foreign(&finding.note)));
        }
        let table = numbers
            .as_ref()
            .map(|numbers| self.table_of(words, numbers));
        let cut = |shot: &'a Shot| Picture {
            shot,
            caption: self.shown(words, reported, shot),
        };
        let rows = pictures.cuts.iter();
        let cuts = rows.map(|row| row.iter().map(cut).collect()).collect();
        let slice = |through: &Through, shot: &'a Shot, is_other: bool| {
            let mut caption = self.what(words, shot.shows);
            caption = caption.and(format!(", {}", words.through(through)));
            if let Through::Sulcus { position: at, .. } = through {
                caption = caption.and(format!(", {}", position(words, *at)));
            }
            if is_other {
                let side = Line::strong(&words.other_side.to_lowercase());
                caption = caption.and(": ").and_line(side);
            }
            if shot.is_flipped {
                caption = caption.and(format!(", {}", words.flipped));
            }
            Picture { shot, caption }
        };
        let pair = |[own, other]: &'a [(Through, Vec<Shot>); 2]| {
            let both = own.1.iter().zip(&other.1);
            both.map(|(shot, opposite)| {
                [slice(&own.0, shot, false), slice(&other.0, opposite, true)]
            })
        };
        let planes = pictures.slices.iter();
        let (cut_mm, slice_mm, rows) = match self.layer {
            // The own side above the other one.
            None => {
                let pairs = planes.flat_map(pair);
                let (own, other) = pairs.map(|[own, other]| (own, other)).unzip();
                (CUT_ABOVE_SLICES_MM, SLICE_BELOW_CUTS_MM, vec![own, other])
            }
            // Of each plane both sides, of one volume and of the other.
            Some(_) => {
                let rows = planes.map(|plane| pair(plane).flatten().collect());
                (CUT_MM, SLICE_MM, rows.collect())
            }
        };
        blocks.extend([
            Block::PicturesAndFacts(cut_mm, cuts, facts, table),
            Block::Pictures(slice_mm, rows),
        ]);
        blocks
    }

    /// What a cut of a finding shows: of which volume, how deep, and of which side.
    pub(super) fn shown(&self, words: &Words, reported: &ReportedFinding, shot: &Shot) -> Line {
        let ReportedFinding {
            finding, pictures, ..
        } = reported;
        let surface = match shot.is_flipped {
            true => pictures.surface.mirrored(),
            false => pictures.surface,
        };
        let inner_side = words.inner_side(surface);
        let inner_side = inner_side.map_or(String::new(), |side| format!(", {side}"));
        let depth = millimetres(words, pictures.depth_mm);
        let side = match (shot.is_flipped, finding.side) {
            (false, _) => side_of(words, finding),
            (true, Some(PatientSide::Left)) => words.side(PatientSide::Right),
            (true, Some(PatientSide::Right)) => words.side(PatientSide::Left),
            (true, _) => words.other_side,
        };
        let how = if shot.is_flipped {
            words.flipped
        } else {
            words.as_acquired
        };
        self.what(words, shot.shows)
            .and(format!(", {depth}{inner_side}: "))
            .and_line(Line::strong(side))
            .and(format!(", {how}"))
    }

    /// The name of what a picture shows.
    fn what(&self, words: &Words, shows: Shows) -> Line {
        match (shows, &self.layer) {
            (Shows::Anatomy, _) | (Shows::Layer, None) => words.anatomy.into(),
            (Shows::Layer, Some(layer)) => {
                Line::foreign(&shortened(&layer.name, MAX_LETTERS_OF_LAYER))
            }
            (Shows::Map(map), _) => format!("{}, {}", words.anatomy, words.map(map)).into(),
        }
    }

    /// The values here and on the other side.
    fn table_of(&self, words: &Words, numbers: &Numbers) -> Table {
        let value =
            |value: Option<f32>| value.map_or("–".to_owned(), |value| words.number(value, 2));
        let other = numbers.mirrored.as_ref();
        let row = |name: Line, of: &dyn Fn(&Values) -> Option<f32>| {
            let values = [of(&numbers.own), other.and_then(of)];
            let [here, there] = values.map(value);
            vec![name, here.into(), there.into()]
        };
        let intensity = |of| Line::from(format!("{}, ", words.intensity)).and(of);
        let mut rows = vec![row(intensity(words.anatomy), &|values| values.intensity)];
        if let Some(layer) = &self.layer {
            let name = intensity("").and_foreign(&layer.name);
            rows.push(row(name, &|values| values.of_layer));
        }
        let thickness = format!("{} (z)", words.thickness());
        rows.extend([
            row(words.blur.into(), &|values| values.blur),
            row(thickness.into(), &|values| values.thickness),
            row(words.sharpness.into(), &|values| values.sharpness),
        ]);
        Table {
            head: vec!["", words.here, words.other_side],
            rows,
        }
    }

    /// How large a finding is: what was measured, or the size of its place.
    pub(super) fn size(&self, words: &Words, finding: &Finding) -> String {
        let place = self.place_of(finding).map(|(_, place)| place);
        match (measures(words, finding).first(), place) {
            (Some((_, size)), _) => size.plain(),
            (None, Some(place)) => format!("{:.0} mm", place.size_mm),
            (None, None) => "–".to_owned(),
        }
    }

    /// The place of a list that a finding was made of, and its rank; elsewhere in the brain it has none.
    pub(super) fn place_of(&self, finding: &Finding) -> Option<(Option<usize>, &CandidateFacts)> {
        let (list, elsewhere): (_, &[_]) = match (finding.from_map?, &self.maps, &self.flair) {
            (MapName::Flair, _, Some(Ok(flair))) => (flair, &[]),
            (MapName::Blur, Ok(maps), _) => (&maps.blur, &maps.elsewhere),
            (MapName::Thickness, Ok(maps), _) => (&maps.thickness, &[]),
            _ => return None,
        };
        let ranked = (1..).map(Some).zip(&list.places);
        let mut places = ranked.chain(elsewhere.iter().map(|place| (None, place)));
        places.find(|(_, place)| is_of(finding, place))
    }

    pub(super) fn is_kept(&self, map: MapName, place: &CandidateFacts) -> bool {
        let mut findings = self.findings.iter().map(|reported| &reported.finding);
        findings.any(|finding| finding.from_map == Some(map) && is_of(finding, place))
    }
}

/// Whether a finding was made of a place.
fn is_of(finding: &Finding, place: &CandidateFacts) -> bool {
    let [point] = finding.points_in_patient[..] else {
        return false;
    };
    let apart = DVec3::from_array(point).distance(DVec3::from_array(place.position_in_patient));
    apart < SAME_PLACE_MM
}

/// Where the middle of a finding is in other heads.
fn standard(words: &Words, finding: &Finding) -> Vec<(&'static str, Line)> {
    let StandardPosition { atlas, ac_pc } = finding.standard.unwrap_or_default();
    let signed = |mm: [i32; 3]| mm.map(|mm| words.number(f64::from(mm), 0)).join(" · ");
    let of_atlas = atlas.map(|atlas| {
        let [mni152, talairach] = [atlas.mni152, atlas.talairach].map(signed);
        let text = format!("{mni152} / {talairach} (± {} mm)", atlas.error_mm);
        (words.atlas, text.into())
    });
    let of_axes = ac_pc.map(|ac_pc| (words.ac_pc, signed(ac_pc).into()));
    of_atlas.into_iter().chain(of_axes).collect()
}

/// What can be measured of the points of a finding.
fn measures(words: &Words, finding: &Finding) -> Vec<(&'static str, Line)> {
    let points = &finding.points_in_patient;
    let vectors: Vec<_> = points.iter().copied().map(DVec3::from_array).collect();
    let length = (words.length, millimetres(words, length_of(&vectors)).into());
    match (finding.kind, &**points) {
        (FindingKind::Line, _) => vec![length],
        (FindingKind::Trajectory, [entry, target]) => vec![
            length,
            (words.entry, position(words, *entry).into()),
            (words.target, position(words, *target).into()),
        ],
        (FindingKind::Polygon, _) => {
            let area = format!("{} mm²", words.number(flat_area_of(&vectors), 0));
            vec![(words.area, area.into())]
        }
        _ => Vec::new(),
    }
}

/// A time (RFC 3339, UTC) to the minute.
fn minute(time: &str) -> String {
    let [day, clock] = [time.get(..10), time.get(11..16)].map(Option::unwrap_or_default);
    format!("{day} {clock} UTC")
}
