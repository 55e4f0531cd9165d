//! Pictures of a case, drawn one after the other: the one way from requests to pixels of a case in the store.

use case::{CaseId, LayerId};
use render::{Frame, RenderBackend};

use super::drawing::{DrawnPicture, backend_for, draw_all, positions, shown_depth, warm_jobs};
use super::encoding::{EncodedImage, ImageMetadata, annotated, encode};
use super::request::{CheckedPicture, PictureRequest};
use super::{ChosenLayers, PictureLayers, ShownDepth};
use crate::error::Error;
use crate::limit::Turn;
use crate::{Cases, models::WarmModel};

/// Pictures of one case, with their layers and backends.
#[derive(Debug)]
pub struct PictureSeries {
    id: CaseId,
    pictures: Vec<Planned>,
    /// Whether the pictures name their case.
    is_named: bool,
    /// What is written of the case into annotated pictures.
    identity: Option<String>,
}

#[derive(Debug)]
struct Planned {
    picture: CheckedPicture,
    layers: ChosenLayers,
    backend: RenderBackend,
}

/// A drawn picture of a series.
#[derive(Debug)]
pub struct SeriesPicture {
    /// Its number, from 0.
    pub number: usize,
    pub request: PictureRequest,
    /// The depth that it shows.
    pub depth: ShownDepth,
    pub drawn: DrawnPicture,
    /// Its state and its annotation.
    pub metadata: ImageMetadata,
}

impl SeriesPicture {
    /// Its pixels, annotated if requested.
    pub fn into_frame(self) -> Frame {
        let frame = self.drawn.rendered.frame;
        annotated(frame, &self.metadata, self.request.annotate)
    }

    /// Its file, annotated if requested.
    ///
    /// # Errors
    /// If it cannot be encoded.
    pub fn encoded(self) -> Result<EncodedImage, Error> {
        encode(self.drawn, &self.metadata, self.request.annotate)
    }
}

impl PictureSeries {
    /// Finds the layers and the backends of pictures of a case.
    ///
    /// # Errors
    /// [`Error::NoSuchLayer`], those of layers that are not ready, or an error of the store.
    pub async fn of(
        cases: &Cases,
        id: &CaseId,
        pictures: impl IntoIterator<Item = CheckedPicture>,
    ) -> Result<Self, Error> {
        let mut planned = Vec::new();
        for picture in pictures {
            planned.push(Planned {
                layers: picture.asked.layers().of_case(&cases.library, id).await?,
                backend: backend_for(&picture.asked, &cases.graphics).await,
                picture,
            });
        }
        let is_annotated = planned.iter().any(|planned| planned.picture.asked.annotate);
        Ok(Self {
            id: *id,
            pictures: planned,
            is_named: true,
            identity: cases.identity(id, is_annotated).await?,
        })
    }

    /// What is written of the case into annotated pictures; `None` if none is annotated.
    pub fn identity(&self) -> Option<&str> {
        self.identity.as_deref()
    }

    /// The backends, each once, such as `trace on cpu`.
    pub fn backends(&self) -> String {
        let backends = self
            .pictures
            .iter()
            .map(|planned| planned.backend.to_string());
        each_once(backends)
    }

    /// The name of the renderer of the first picture, such as `trace`.
    pub fn renderer(&self) -> &'static str {
        self.pictures
            .first()
            .map_or("", |planned| planned.backend.name())
    }

    /// The uploaded layers, also those of which maps were computed, each once.
    pub fn layers(&self) -> Vec<LayerId> {
        let pictures = self.pictures.iter();
        let mut layers: Vec<_> = pictures.flat_map(|planned| planned.layers.ids()).collect();
        layers.sort_unstable();
        layers.dedup();
        layers
    }

    /// The versions of the layers, of maps and of the surfaces, each once; `None` if there are no layers and only the whole brain is shown,
    /// from one direction.
    pub fn versions(&self) -> Option<String> {
        let pictures = self.pictures.iter();
        let surfaces = pictures.clone();
        let surfaces = surfaces.filter_map(|planned| planned.picture.asked.version());
        let layers = pictures.filter_map(|planned| planned.layers.version());
        let versions = each_once(layers.chain(surfaces));
        (!versions.is_empty()).then_some(versions)
    }

    /// The same series of a case that nobody can ask for later: its pictures do not name it.
    #[must_use]
    pub fn unnamed(self) -> Self {
        Self {
            is_named: false,
            identity: None,
            ..self
        }
    }

    /// Draws each picture and passes it to `add`, which runs in the same turn. The pictures share one place in the queue;
    /// between them others get their turn, and the work ends if the future is dropped.
    ///
    /// # Errors
    /// As [`Cases::model`]; [`Error::Busy`] if too much work waits; those of the layers, of the pictures, and of `add`.
    pub async fn draw_each<T: Send + 'static>(
        self,
        cases: &Cases,
        mut kept: T,
        add: impl Fn(&mut T, SeriesPicture) -> Result<(), Error> + Clone + Send + 'static,
    ) -> Result<T, Error> {
        let mut models = match self.pictures.first() {
            Some(first) => cases.surfaces_of(&self.id, &first.picture.asked).await?,
            None => return Ok(kept),
        };
        let queued = cases.queue.enter()?;
        for (number, planned) in self.pictures.into_iter().enumerate() {
            let surfaces = planned.picture.asked.surfaces();
            if !models.iter().map(WarmModel::surface).eq(surfaces) {
                models = cases.surfaces_of(&self.id, &planned.picture.asked).await?;
            }
            let turn = queued.turn().await?;
            let loaded = planned.layers.load(&cases.library, &self.id).await?;
            let named = (self.is_named.then_some(&self.id), self.identity.clone());
            let picture = planned.draw(named, number, &models, loaded, &turn);
            let (picture, add) = (picture.await?, add.clone());
            let add_it = move || add(&mut kept, picture).map(|()| kept);
            kept = turn.run(add_it).await??;
        }
        Ok(kept)
    }
}

impl Planned {
    async fn draw(
        self,
        (id, identity): (Option<&CaseId>, Option<String>),
        number: usize,
        models: &[WarmModel],
        layers: PictureLayers,
        turn: &Turn,
    ) -> Result<SeriesPicture, Error> {
        let jobs = warm_jobs(models, &self.picture, &layers, &self.backend).await?;
        let depth = shown_depth(models, &self.picture);
        let request = self.picture.asked;
        let mut metadata = ImageMetadata::of(id, &jobs).of_surface(request.surface);
        if request.map().is_some() && request.annotate {
            let (positions, _) = positions(jobs.clone(), turn).await?;
            metadata = metadata.with_positions(positions);
        }
        Ok(SeriesPicture {
            number,
            depth,
            metadata: metadata.named(identity.filter(|_| request.annotate)),
            drawn: draw_all(jobs, turn).await?,
            request,
        })
    }
}

/// Texts, each once, in their order.
fn each_once(texts: impl Iterator<Item = String>) -> String {
    let mut once: Vec<String> = Vec::new();
    for text in texts {
        if !once.contains(&text) {
            once.push(text);
        }
    }
    once.join("; ")
}
