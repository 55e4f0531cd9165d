//! Files with many pictures, which are added one after the other.

use std::io::{Cursor, Write as _};
use std::num::NonZeroU32;

use cases::Error;
use cases::pictures::{Layout, SeriesPicture};
use render::{AnimatedPng, Sheet, SheetPlan};
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use render::SOFTWARE;

/// A file with many pictures.
pub(super) enum File {
    Zip(Archive),
    Sheet(ContactSheet),
    Animation(Animation),
}

impl File {
    /// An empty file for `count` pictures.
    pub(super) fn new(layout: Layout, count: usize) -> Self {
        match layout {
            Layout::Separate => Self::Zip(Archive(Box::new(ZipWriter::new(Cursor::default())))),
            Layout::Sheet { plan, cells } => Self::Sheet(ContactSheet {
                plan,
                sheet: None,
                cells,
                states: Vec::new(),
            }),
            Layout::Animation { frame_time_ms } => Self::Animation(Animation {
                begun: None,
                frames: count as u32,
                frame_time_ms,
            }),
        }
    }

    /// Adds the next picture.
    pub(super) fn add(&mut self, picture: SeriesPicture) -> Result<(), Error> {
        match self {
            Self::Zip(archive) => archive.add(picture),
            Self::Sheet(sheet) => {
                sheet.add(picture);
                Ok(())
            }
            Self::Animation(animation) => animation.add(picture),
        }
    }

    /// The bytes of the file after the last picture.
    pub(super) fn finish(self) -> Result<Vec<u8>, Error> {
        match self {
            Self::Zip(archive) => archive.finish(),
            Self::Sheet(sheet) => sheet.finish(),
            Self::Animation(animation) => animation.finish(),
        }
    }
}

/// A zip of PNG files, which are compressed already.
pub(super) struct Archive(Box<ZipWriter<Cursor<Vec<u8>>>>);

impl Archive {
    fn add(&mut self, picture: SeriesPicture) -> Result<(), Error> {
        let direction = picture.request.direction().replace(',', "_");
        let (number, depth_mm) = (picture.number, picture.request.depth_mm);
        let name = format!("{number:03}-{direction}-{depth_mm}mm.png");
        let png = picture.encoded()?.png;
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        self.0.start_file(name, options).map_err(unwritable)?;
        self.0.write_all(&png).map_err(unwritable)
    }

    fn finish(self) -> Result<Vec<u8>, Error> {
        let finished = self.0.finish().map_err(unwritable)?;
        Ok(finished.into_inner())
    }
}

/// An archive in memory has room for the largest request.
fn unwritable(_: impl Into<ZipError>) -> Error {
    Error::Internal
}

/// One picture with all pictures.
pub(super) struct ContactSheet {
    plan: SheetPlan,
    /// Present after the first picture, which determines the format.
    sheet: Option<Sheet>,
    cells: Vec<[usize; 2]>,
    /// A PNG text for each picture.
    states: Vec<(String, String)>,
}

impl ContactSheet {
    fn add(&mut self, picture: SeriesPicture) {
        let [row, column] = self.cells[picture.number];
        self.states
            .push(state_of_cell([row, column], &texts_of(&picture)));
        let frame = picture.into_frame();
        let begin = || self.plan.clone().begin(frame.format());
        self.sheet
            .get_or_insert_with(begin)
            .put(&frame, row, column);
    }

    fn finish(self) -> Result<Vec<u8>, Error> {
        let frame = self.sheet.ok_or(Error::Internal)?.finish();
        let mut texts = vec![("Software", SOFTWARE.to_owned())];
        let states = self.states.iter();
        texts.extend(states.map(|(name, state)| (name.as_str(), state.clone())));
        Ok(render::encode_png(&frame, &texts)?)
    }
}

pub(super) struct Animation {
    /// Present after the first picture, which determines size and format.
    begun: Option<AnimatedPng>,
    frames: u32,
    frame_time_ms: u16,
}

impl Animation {
    fn add(&mut self, picture: SeriesPicture) -> Result<(), Error> {
        let texts = texts_of(&picture);
        let frame = picture.into_frame();
        let animation = match &mut self.begun {
            Some(animation) => animation,
            nothing => {
                let frames = NonZeroU32::new(self.frames).ok_or(Error::Internal)?;
                let (size, format) = (frame.size(), frame.format());
                let begun = AnimatedPng::begin(size, format, frames, self.frame_time_ms, &texts);
                nothing.insert(begun?)
            }
        };
        Ok(animation.add(&frame)?)
    }

    fn finish(self) -> Result<Vec<u8>, Error> {
        Ok(self.begun.ok_or(Error::Internal)?.finish()?)
    }
}

fn texts_of(picture: &SeriesPicture) -> Vec<(&'static str, String)> {
    picture.metadata.texts(&picture.drawn.backend)
}

/// The state of a picture of a sheet as one PNG text: `row 1 column 2`, counted from 1, and a JSON object.
fn state_of_cell([row, column]: [usize; 2], texts: &[(&'static str, String)]) -> (String, String) {
    let state: serde_json::Map<String, serde_json::Value> = texts
        .iter()
        .map(|(name, text)| ((*name).to_owned(), text.as_str().into()))
        .collect();
    let name = format!("row {} column {}", row + 1, column + 1);
    (name, serde_json::Value::Object(state).to_string())
}
