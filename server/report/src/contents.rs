//! What a report says and shows, in its order. `html` and `pdf` write it.

use case::findings::{Finding, FindingKind};
use case::{AXES_CORRECTED, CandidateFacts, Gyrus, PatientSide, QualityState};
use geometry::{flat_area_of, length_of};
use glam::DVec3;
use render::NamedView;

use crate::pictures::{DEPTHS_MM, FindingPictures, Shot, Shows};
use crate::words::Words;
use crate::{
    ListedMap, Numbers, Reason, Report, ReportMaps, ReportedFinding, ShownPatient, Values,
};

/// The most places of the map in the tables, in the cerebrum and elsewhere.
const MAX_CANDIDATES: usize = 20;
const MAX_ELSEWHERE: usize = 5;
/// The same of a map for which no limit is known.
const MAX_UNJUDGED: usize = 5;

/// The contents of a report.
pub(crate) struct Contents<'a> {
    /// The tag of its language (BCP 47).
    pub(crate) language: &'static str,
    pub(crate) title: &'static str,
    /// The use that every page states.
    pub(crate) notice: &'static str,
    /// The case, for people.
    pub(crate) identity: String,
    /// The verdict on a mask that is not sound, which every page states.
    pub(crate) doubt: Option<String>,
    /// What a character without a glyph is written as, in words.
    pub(crate) unprintable: &'static str,
    /// Each begins a page.
    pub(crate) sections: Vec<Section<'a>>,
}

/// A part of a report that begins a page.
pub(crate) struct Section<'a> {
    pub(crate) is_finding: bool,
    pub(crate) blocks: Vec<Block<'a>>,
}

/// A part of a section.
pub(crate) enum Block<'a> {
    Title(&'static str),
    Notice(&'static str),
    /// What is wrong with the mask, and why.
    Warning(String, Vec<String>),
    Heading(Line),
    Subheading(Line),
    Text(Line),
    List(Vec<Line>),
    Facts(Facts),
    Table(Table),
    /// Facts, and a table beside them.
    FactsAndTable(Facts, Table),
    /// Rows of pictures with captions, each so many mm wide. They are compared, so no page divides them.
    Pictures(f64, Vec<Vec<Picture<'a>>>),
    Overview(Overview<'a>),
}

/// The sides of a cut and of a slice on paper, in mm: a row has three cuts or four slices, and a finding without a further
/// layer has one page of A4 or Letter. With one, the slices have a page of their own.
pub(crate) const CUT_MM: f64 = 55.0;
pub(crate) const SLICE_MM: f64 = 45.0;

/// What separates two pictures of a row, in mm.
pub(crate) const GAP_MM: f64 = 2.0;

/// Names with values.
pub(crate) type Facts = Vec<(&'static str, Line)>;

/// A table with a head.
pub(crate) struct Table {
    pub(crate) head: Vec<&'static str>,
    pub(crate) rows: Vec<Vec<Line>>,
}

/// A picture and what it shows.
pub(crate) struct Picture<'a> {
    pub(crate) shot: &'a Shot,
    pub(crate) caption: Line,
}

/// Small pictures in rows and columns, which no page divides.
pub(crate) struct Overview<'a> {
    pub(crate) title: &'static str,
    pub(crate) columns: Vec<&'static str>,
    pub(crate) rows: Vec<(String, Vec<Picture<'a>>)>,
}

#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Line(pub(crate) Vec<Piece>);

/// A part of a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Piece {
    /// Words of the program.
    Own(String),
    /// The same, to be seen first.
    Strong(String),
    /// Words of a reader or of a file, in any language and direction.
    Foreign(String),
}

impl Piece {
    pub(crate) fn text(&self) -> &str {
        let (Self::Own(text) | Self::Strong(text) | Self::Foreign(text)) = self;
        text
    }
}

impl<T: Into<String>> From<T> for Line {
    fn from(text: T) -> Self {
        Self(vec![Piece::Own(text.into())])
    }
}

impl Line {
    fn strong(text: &str) -> Self {
        Self(vec![Piece::Strong(text.to_owned())])
    }

    fn foreign(text: &str) -> Self {
        Self::default().and_foreign(text)
    }

    fn and(mut self, text: impl Into<String>) -> Self {
        self.0.push(Piece::Own(text.into()));
        self
    }

    fn and_foreign(mut self, text: &str) -> Self {
        self.0.push(Piece::Foreign(text.to_owned()));
        self
    }

    /// Whether all words are the program's own, and few.
    pub(crate) fn is_own(&self) -> bool {
        let is_foreign = |piece: &Piece| matches!(piece, Piece::Foreign(_));
        !self.0.iter().any(is_foreign)
    }

    /// Whether it is a number with its unit, or several: a line that is not broken.
    pub(crate) fn is_number(&self) -> bool {
        self.is_own()
            && self
                .plain()
                .contains(|letter: char| letter.is_ascii_digit())
    }

    pub(crate) fn plain(&self) -> String {
        self.0.iter().map(Piece::text).collect()
    }
}

impl Report {
    pub(crate) fn contents(&self) -> Contents<'_> {
        let words = self.query.language.words();
        let first = [
            self.warning(words),
            vec![Block::Title(words.title), Block::Notice(words.notice)],
            vec![Block::Facts(self.about(words))],
            self.summary(words),
            self.places(words),
        ];
        let mut overviews = vec![overview(words, words.overview, &self.overview.anatomy)];
        if !self.overview.map.is_empty() {
            overviews.push(overview(words, words.overview_of_map, &self.overview.map));
        }
        let section = |is_finding, blocks| Section { is_finding, blocks };
        let mut sections = vec![section(false, first.into_iter().flatten().collect())];
        for (number, finding) in (1..).zip(&self.findings) {
            sections.push(section(true, self.finding(words, number, finding)));
        }
        sections.push(section(false, overviews));
        Contents {
            language: self.query.language.tag(),
            title: words.title,
            notice: words.notice,
            identity: words.identity(&self.case),
            doubt: self.doubt(words),
            unprintable: words.unprintable,
            sections,
        }
    }

    /// That the case is closed, that its sides are in doubt, and the verdict on a mask that is not sound.
    fn doubt(&self, words: &Words) -> Option<String> {
        let closed = self.case.closed.map(|why| words.closed(why));
        let sides = self.has_sides_in_doubt().then(|| words.sides_in_doubt());
        let mask = self
            .state_of_mask()
            .filter(|state| *state != QualityState::Ok)
            .map(|state| format!("{}: {}", words.mask, words.state(state)));
        let doubts: Vec<_> = closed
            .into_iter()
            .chain(sides)
            .map(str::to_owned)
            .chain(mask)
            .collect();
        (!doubts.is_empty()).then(|| doubts.join(" · "))
    }

    fn has_sides_in_doubt(&self) -> bool {
        let quality = self.facts.quality.as_ref();
        quality.is_some_and(|quality| quality.has_reason(AXES_CORRECTED))
    }

    /// The verdict on the mask, for which doubts about the sides do not count.
    fn state_of_mask(&self) -> Option<QualityState> {
        let quality = self.facts.quality.as_ref()?;
        let is_about_sides_alone = self.has_sides_in_doubt() && quality.reasons.len() == 1;
        Some(match quality.state {
            QualityState::Review if is_about_sides_alone => QualityState::Ok,
            state => state,
        })
    }

    /// What is wrong with the case or its mask, if something is.
    fn warning(&self, words: &Words) -> Vec<Block<'_>> {
        let block = self.doubt(words).map(|doubt| {
            let quality = self.facts.quality.iter();
            let reasons = quality.flat_map(|quality| {
                let codes = quality.reason_codes.iter().map(String::as_str);
                let codes = codes.chain(std::iter::repeat(""));
                let reasons = quality.reasons.iter().zip(codes);
                reasons.map(|(reason, code)| words.reason(code, reason).to_owned())
            });
            Block::Warning(doubt, reasons.collect())
        });
        block.into_iter().collect()
    }

    fn about(&self, words: &Words) -> Facts {
        let identity = Line::foreign(&words.identity(&self.case));
        let mut facts = vec![(words.case, identity.and(format!(" · {}", self.case.id)))];
        if let Some(patient) = &self.patient {
            facts.push((words.patient, patient_of(words, patient)));
        }
        facts.push((words.acquisition, self.acquisition(words)));
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

    /// The findings on one page: those to look at, and those that were dismissed.
    fn summary(&self, words: &Words) -> Vec<Block<'_>> {
        let mut blocks = vec![Block::Heading(words.findings.into())];
        if self.findings.is_empty() {
            blocks.push(Block::Text(words.no_findings.into()));
        } else {
            let mut all = self.findings.iter();
            let has_gyri = all.any(|reported| reported.finding.gyrus.is_some());
            let mut head = vec![
                "",
                words.side,
                words.depth,
                words.position,
                words.certainty,
                words.label,
            ];
            if has_gyri {
                head.insert(2, words.about_gyrus());
            }
            let row = |(number, ReportedFinding { finding, .. }): (usize, &ReportedFinding)| {
                let mut row = vec![
                    number.to_string().into(),
                    side_of(words, finding).into(),
                    millimetres(words, finding.depth_mm).into(),
                    position(words, finding.middle_in_patient()).into(),
                    certainty_of(words, finding).into(),
                    Line::foreign(&finding.label),
                ];
                if has_gyri {
                    row.insert(2, gyrus_of(words, finding.gyrus).into());
                }
                row
            };
            blocks.push(Block::Table(Table {
                head,
                rows: (1..).zip(&self.findings).map(row).collect(),
            }));
        }
        if !self.dismissed.is_empty() {
            let lines = self.dismissed.iter();
            let lines = lines.map(|finding| line_about(words, finding));
            blocks.push(Block::Subheading(words.dismissed.into()));
            blocks.push(Block::List(lines.collect()));
        }
        blocks
    }

    fn finding<'a>(
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
        facts.extend(measures(words, finding));
        let certainty = certainty_of(words, finding);
        if !certainty.is_empty() {
            facts.push((words.certainty, certainty.into()));
        }
        if let Some(author) = &finding.author {
            let time = finding.changed_at.as_deref();
            let time = time.map(|time| format!(", {}", minute(time)));
            let line = Line::foreign(author).and(time.unwrap_or_default());
            facts.push((words.author, line));
        }
        let mut blocks = vec![Block::Heading(heading)];
        blocks.push(match numbers {
            Some(numbers) => Block::FactsAndTable(facts, table_of(words, numbers)),
            None => Block::Facts(facts),
        });
        if !finding.note.is_empty() {
            blocks.push(Block::Text(Line::foreign(&finding.note)));
        }
        blocks.extend(self.pictures(words, finding, pictures));
        blocks
    }

    /// The cuts with the same of the other side below them, and the slices, a row for each volume.
    fn pictures<'a>(
        &'a self,
        words: &Words,
        finding: &Finding,
        pictures: &'a FindingPictures,
    ) -> Vec<Block<'a>> {
        let own = side_of(words, finding);
        let opposite = match finding.side {
            Some(PatientSide::Left) => words.side(PatientSide::Right),
            Some(PatientSide::Right) => words.side(PatientSide::Left),
            _ => words.other_side,
        };
        let view = words.view(pictures.view);
        let depth = millimetres(words, finding.depth_mm);
        let picture = |shot: &'a Shot, shown: String| {
            let caption = self.what(words, shot.shows).and(format!(", {shown}"));
            Picture { shot, caption }
        };
        let here = pictures.cuts.iter().map(|[here, _]| {
            let shown = format!("{depth}, {view}: {own}, {}", words.as_acquired);
            picture(here, shown)
        });
        let other = pictures.cuts.iter().map(|[_, other]| {
            let shown = format!("{depth}: {opposite}, {}", words.flipped);
            picture(other, shown)
        });
        let cuts = vec![here.collect(), other.collect()];
        let of_slices = pictures.slices.first().map_or(0, |(_, shots)| shots.len());
        let slices_of = |number: usize| {
            let slices = pictures.slices.iter();
            slices
                .map(|(through, shots)| picture(&shots[number], words.through(through)))
                .collect()
        };
        let slices = (0..of_slices).map(slices_of).collect();
        vec![
            Block::Pictures(CUT_MM, cuts),
            Block::Pictures(SLICE_MM, slices),
        ]
    }

    /// The name of what a picture shows.
    fn what(&self, words: &Words, shows: Shows) -> Line {
        match (shows, &self.layer) {
            (Shows::Anatomy, _) | (Shows::Layer, None) => words.anatomy.into(),
            (Shows::Layer, Some(layer)) => Line::foreign(&layer.name),
            (Shows::Map(map), _) => format!("{}, {}", words.anatomy, words.map(map)).into(),
        }
    }

    /// What the maps know, or why there are none.
    fn places(&self, words: &Words) -> Vec<Block<'_>> {
        let mut blocks = vec![Block::Heading(words.candidates.into())];
        match &self.maps {
            Err(reason) => {
                let why = words.reason(&reason.code, &reason.sentence);
                blocks.push(Block::Text(format!("{} {why}", words.no_maps).into()));
            }
            Ok(maps) => {
                blocks.extend(places(words, maps));
                let flair = self.flair.iter();
                blocks.extend(flair.flat_map(|flair| bright_places(words, flair)));
            }
        }
        blocks
    }
}

/// The places that stand out, or that none does; then all others.
fn places(words: &Words, maps: &ReportMaps) -> Vec<Block<'static>> {
    let mut blocks = Vec::new();
    let candidates = &maps.blur.places;
    let nothing_stands_out = !candidates.iter().any(CandidateFacts::stands_out);
    if nothing_stands_out {
        blocks.push(Block::Text(words.nothing_stands_out().into()));
    }
    blocks.extend(caveat(words, &maps.blur));
    if maps.regions.state != QualityState::Ok {
        let reason = maps.regions.reasons.first().map_or("", String::as_str);
        let code = maps.regions.reason_codes.first().map_or("", String::as_str);
        let doubt = words.doubt_of_regions(words.reason(code, reason));
        blocks.push(Block::Text(doubt.into()));
    }
    let ranked = || (1_usize..).zip(candidates.iter().take(MAX_CANDIDATES));
    let of_cerebrum = |stands_out: bool| -> Vec<_> {
        let chosen = ranked().filter(|(_, place)| place.stands_out() == stands_out);
        chosen
            .map(|(rank, place)| (rank.to_string(), *place))
            .collect()
    };
    let elsewhere = maps.elsewhere.iter().take(MAX_ELSEWHERE);
    // The limits were read off the cerebrum.
    let unjudged = |place: &CandidateFacts| CandidateFacts {
        unusual: None,
        ..*place
    };
    let elsewhere = elsewhere
        .map(|place| (String::new(), unjudged(place)))
        .collect();
    for (heading, note, rows) in [
        (None, words.candidates_note, of_cerebrum(true)),
        (
            Some(words.others),
            words.candidates_note,
            of_cerebrum(false),
        ),
        (Some(words.elsewhere), words.elsewhere_note, elsewhere),
    ] {
        if rows.is_empty() {
            continue;
        }
        blocks.extend(heading.map(|heading| Block::Subheading(heading.into())));
        let is_said = heading == Some(words.others) && !nothing_stands_out;
        if !is_said {
            blocks.push(Block::Text(note.into()));
        }
        blocks.push(table_of_places(words, rows));
    }
    let about = [
        words.thickness(),
        words.thickness_note(),
        words.nothing_is_thick(),
    ];
    blocks.extend(listed(words, about, &maps.thickness));
    blocks
}

/// What is to be known about the scores of a map before one is believed to be unusual.
fn caveat(words: &Words, map: &ListedMap) -> Option<Block<'static>> {
    let Reason { code, sentence } = map.caveat.as_ref()?;
    let told = words.reason(code, sentence).to_owned();
    Some(Block::Text(told.into()))
}

/// The brightest places of the FLAIR, for which no limit is known, or why there is no such map.
fn bright_places<'a>(words: &Words, flair: &'a Result<ListedMap, Reason>) -> Vec<Block<'a>> {
    match flair {
        Ok(maps) => {
            let about = [words.flair(), words.flair_note(), ""];
            listed(words, about, maps)
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
fn listed(
    words: &Words,
    [heading, note, nothing]: [&'static str; 3],
    map: &ListedMap,
) -> Vec<Block<'static>> {
    let has_limits = map.has_limits;
    let most = if has_limits {
        MAX_CANDIDATES
    } else {
        MAX_UNJUDGED
    };
    let ranked = (1_usize..).zip(map.places.iter().take(most));
    let rows: Vec<_> = ranked
        .filter(|(_, place)| place.stands_out() || !has_limits)
        .map(|(rank, place)| (rank.to_string(), *place))
        .collect();
    let mut blocks = vec![Block::Subheading(heading.into())];
    if rows.is_empty() && has_limits {
        blocks.push(Block::Text(nothing.into()));
        return blocks;
    }
    blocks.push(Block::Text(note.into()));
    blocks.extend(caveat(words, map));
    if !rows.is_empty() {
        blocks.push(table_of_places(words, rows));
    }
    blocks
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

fn gyrus_of(words: &Words, gyrus: Option<Gyrus>) -> &'static str {
    gyrus.map_or("–", |gyrus| words.gyrus(gyrus))
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
    let gyrus = finding
        .gyrus
        .map(|gyrus| format!(" {}", words.gyrus(gyrus)));
    let place = format!(
        " ({}{}, {}, {})",
        side_of(words, finding),
        gyrus.unwrap_or_default(),
        millimetres(words, finding.depth_mm),
        position(words, finding.middle_in_patient()),
    );
    let line = Line::foreign(&finding.label).and(place);
    match &*finding.note {
        "" => line,
        note => line.and(": ").and_foreign(note),
    }
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

fn side_of(words: &Words, finding: &Finding) -> &'static str {
    finding.side.map_or(words.unknown, |side| words.side(side))
}

/// How certain a finding is; of one that was taken over, that it is not confirmed. Empty if nobody has said so.
fn certainty_of(words: &Words, finding: &Finding) -> &'static str {
    match finding.certainty {
        _ if finding.is_unconfirmed => words.unconfirmed,
        Some(certainty) => words.certainty(certainty),
        None => "",
    }
}

/// A time (RFC 3339, UTC) to the minute.
fn minute(time: &str) -> String {
    let [day, clock] = [time.get(..10), time.get(11..16)].map(Option::unwrap_or_default);
    format!("{day} {clock} UTC")
}

fn millimetres(words: &Words, mm: impl Into<f64>) -> String {
    format!("{} mm", words.number(mm, 1))
}

/// A position with the sides of its coordinates, as the page has it: `R 35.0 · A 29.0 · S 32.0`.
fn position(words: &Words, in_patient: [f64; 3]) -> String {
    let sides = ["LR", "PA", "SI"];
    let coordinates = in_patient.iter().zip(sides).map(|(mm, sides)| {
        let side = &sides[usize::from(*mm < 0.0)..][..1];
        format!("{} {}", side, words.number(mm.abs(), 1))
    });
    coordinates.collect::<Vec<_>>().join(" · ")
}

/// The values here and on the other side.
fn table_of(words: &Words, numbers: &Numbers) -> Table {
    let value = |value: Option<f32>| value.map_or("–".to_owned(), |value| words.number(value, 2));
    let other = numbers.mirrored.as_ref();
    let thickness = format!("{} (z)", words.thickness());
    let row = |name: &str, of: &dyn Fn(&Values) -> Option<f32>| {
        let values = [of(&numbers.own), other.and_then(of)];
        let [here, there] = values.map(value);
        vec![name.into(), here.into(), there.into()]
    };
    Table {
        head: vec!["", words.here, words.other_side],
        rows: vec![
            row(words.intensity, &|values| values.intensity),
            row(words.blur, &|values| values.blur),
            row(&thickness, &|values| values.thickness),
            row(words.sharpness, &|values| values.sharpness),
        ],
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use case::{Case, CaseId, CaseState, Parameters};
    use jiff::Timestamp;
    use serde_json::json;

    use super::*;
    use crate::pictures;
    use crate::{Language, ReportQuery};

    #[test]
    fn a_number_stays_on_its_line_and_a_name_may_be_broken() {
        assert!(Line::from("R 28.0 · P 19.0 · I 26.0").is_number());
        assert!(!Line::from("temporal pole, superior part").is_number());
        assert!(!Line::foreign("3 mm, as the reader wrote").is_number());
    }

    /// The report of a case without findings, and without a brain.
    fn report(language: Language) -> Report {
        let mut facts = storage::testing::facts();
        let quality = json!({
            "state": "failed", "method": "network", "reasons": ["the mask has 5000 ml"], "reason_codes": ["mask-volume"],
            "numbers": {"brain_ml": 5000.0, "closing_added": 0.0, "largest_component": 1.0, "extents_mm": [1.0, 1.0, 1.0],
                        "cut_area_cm2": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]},
        });
        facts.quality = Some(serde_json::from_value(quality).unwrap());
        Report {
            case: Case {
                id: CaseId::parse(&"0".repeat(32)).unwrap(),
                parameters: Parameters::default(),
                state: CaseState::Ready,
                progress: None,
                failure: None,
                facts: None,
                previous: None,
                next: Vec::new(),
                created_at: Timestamp::UNIX_EPOCH,
                uploaded_at: Timestamp::UNIX_EPOCH,
                kept: false,
                expires_at: None,
                closed: None,
            },
            facts: Arc::new(facts),
            query: ReportQuery {
                language,
                patient: false,
            },
            patient: None,
            maps: Err(Reason {
                code: "failed-envelope".into(),
                sentence: "the mask is wrong".into(),
            }),
            flair: None,
            layer: None,
            findings: Vec::new(),
            dismissed: Vec::new(),
            overview: pictures::Overview {
                anatomy: Vec::new(),
                map: Vec::new(),
            },
        }
    }

    #[test]
    fn sides_in_doubt_are_named_before_the_mask_on_every_page() {
        let sides = ("axes-corrected", "another case has other axes");
        let ragged = ("mask-ragged", "the mask is ragged");
        for (language, reasons, doubt) in [
            (
                Language::English,
                vec![sides],
                "Left and right are in doubt",
            ),
            (
                Language::English,
                vec![ragged, sides],
                "Left and right are in doubt · Brain mask: CHECK IT",
            ),
            (Language::English, vec![ragged], "Brain mask: CHECK IT"),
            (
                Language::Portuguese,
                vec![sides],
                "Esquerda e direita estão em dúvida",
            ),
        ] {
            let mut report = report(language);
            let mut facts = (*report.facts).clone();
            let quality = facts.quality.as_mut().unwrap();
            quality.state = QualityState::Review;
            quality.reason_codes = reasons.iter().map(|(code, _)| (*code).into()).collect();
            quality.reasons = reasons.iter().map(|(_, text)| (*text).into()).collect();
            report.facts = Arc::new(facts);
            let contents = report.contents();
            assert_eq!(contents.doubt.as_deref(), Some(doubt));
            let named = format!("<strong>{doubt}</strong>");
            assert_eq!(
                contents.html().matches(&named).count(),
                contents.sections.len()
            );
        }
    }

    #[test]
    fn a_mask_that_is_no_brain_is_named_at_the_head_of_every_page() {
        for (language, doubt, texts) in [
            (
                Language::English,
                "Brain mask: NOT A BRAIN",
                [
                    "The volume of the mask is not that of a brain.",
                    "There are no maps of this case: The brain mask is rated as failed",
                ],
            ),
            (
                Language::Portuguese,
                "Máscara do encéfalo: NÃO É UM ENCÉFALO",
                [
                    "O volume da máscara não é o de um encéfalo.",
                    "Não há mapas deste caso: A máscara do encéfalo foi avaliada como falha",
                ],
            ),
        ] {
            let report = report(language);
            let contents = report.contents();
            assert_eq!(contents.doubt.as_deref(), Some(doubt));
            let html = contents.html();
            let pages = contents.sections.len();
            assert_eq!(
                html.matches(&format!("<strong>{doubt}</strong>")).count(),
                pages
            );
            assert!(texts.iter().all(|text| html.contains(text)), "{html}");
            // How often a PDF states it, its own tests tell.
            assert!(contents.pdf().unwrap().starts_with(b"%PDF"));
        }
    }
}
