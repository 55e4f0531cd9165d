//! Writes the derivatives of one head. Its case must be ready.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use ::report::{ReportFormat, ReportQuery};
use case::{CaseId, MapName, PlacementFacts, PlacementVerdict, QualityState};
use case::{SurfaceName, VoxelValues};
use geometry::{DeformableModel, MeshSize, ShrunkMesh};
use glam::DAffine3;
use imaging::nifti::lps_from_ras;
use pipeline::Undefined;
use render::NamedView;
use serde_json::{Value, json};

use super::derivatives::{Derivatives, OutputError, encoded};
use super::folder::{HeadFiles, HeadName};
use super::names::{
    BRAIN, HEMISPHERES, PLACES, SURFACE_DEPTHS_MM, TRANSFORM, VOXELS, ends, stem, surface_end,
};
use super::places;
use super::record::{HeadRecord, MadeWith, MapsRecord, MaskRecord};
use crate::gyri::PlaceNames;
use crate::library::LoadedMaps;
use crate::models::PathKind;
use crate::nifti::native_grid;
use crate::pictures::{PictureRequest, PictureSeries, SeriesPicture, mesh_size};
use crate::report::{AskedReport, ReportSubject, found_or_reason};
use crate::{Cases, Error};

/// Contours of a surface, and points on each.
const SURFACE_POINTS: usize = 100;

/// The depth of the picture of a head, and its side in pixels.
const PICTURE_MM: f32 = 8.0;
const PICTURE_SIDE: u32 = 320;

/// Writes a mesh of a surface as GIFTI.
pub type SurfaceFile = fn(&ShrunkMesh, &DeformableModel, MeshSize, SurfaceName) -> Vec<u8>;

/// Why a head was not written.
#[derive(Debug, thiserror::Error)]
pub enum HeadError {
    #[error(transparent)]
    Case(#[from] Error),
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// A head to be written.
#[derive(Debug)]
pub struct NewHead {
    pub name: HeadName,
    pub files: HeadFiles,
    /// The BIDS folder.
    pub raw: PathBuf,
    pub made_with: MadeWith,
    /// The hash of each volume by the name of its file.
    pub source_blake3: BTreeMap<String, String>,
    /// The place of its FLAIR, or why that has none.
    pub flair: Option<Result<PlacementFacts, String>>,
    pub notes: Vec<String>,
    pub begun: Instant,
}

impl NewHead {
    /// The BIDS URI of one of its volumes.
    fn uri(&self, path: &std::path::Path) -> String {
        let relative = path.strip_prefix(&self.raw).unwrap_or(path);
        format!("bids:raw:{}", encoded(&relative.to_string_lossy()))
    }
}

/// Writes everything of a head, and returns what [`Derivatives::finish`] records of it.
///
/// # Errors
/// As [`Cases::nifti`] and [`Cases::report`], and [`OutputError`].
pub async fn write_head(
    cases: &Cases,
    id: &CaseId,
    new: NewHead,
    (out, surface_file): (&Derivatives, SurfaceFile),
) -> Result<HeadRecord, HeadError> {
    let facts = cases.ready(id).await?;
    let maps = found_or_reason(cases.library.maps(id).await.map_err(Error::from)?)?;
    let flair = match &new.flair {
        None => None,
        Some(_) => cases.library.flair(id).await.map_err(Error::from)?,
    };
    let flair = flair
        .map(|flair| found_or_reason(flair.state))
        .transpose()?;
    let t1w = new.uri(&new.files.t1w);
    let flair_volume = new.files.flair.as_deref().map(|path| new.uri(path));
    let mut writer = Writer {
        out,
        t1w: &t1w,
        name: &new.name,
        files: Vec::new(),
        notes: new.notes.clone(),
    };
    writer
        .write_voxels(cases, id, flair_volume.as_deref())
        .await?;
    writer.write_places(cases, id, (&maps, &flair)).await?;
    if let (Some(placed), Some(volume)) = (&new.flair, &flair_volume) {
        writer.write_transform(placed, volume)?;
    }
    if let Some(Err(reason)) = &flair {
        writer.notes.push(format!("no map of the FLAIR: {reason}"));
    }
    writer.write_surfaces(cases, id, surface_file).await?;
    writer.write_report(cases, id).await?;
    let mask = cases.nifti(id, VoxelValues::Brain).await?;
    writer.add(BRAIN, &mask.bytes)?;

    let found = maps.as_ref().ok();
    Ok(HeadRecord {
        description: "The brain, before it is closed to the envelope".to_owned(),
        kind: "Brain".to_owned(),
        spatial_reference: t1w.clone(),
        sources: vec![t1w.clone()],
        mask: MaskRecord::of(facts.quality.as_ref()),
        midsagittal: (&facts.midsagittal).into(),
        cerebrum: match found.map(|maps| maps.regions.state) {
            Some(state) => state.name(),
            None => "undefined",
        }
        .to_owned(),
        voxel_mm: native_grid(&facts)?.spacing_mm(),
        standing_out: found.and_then(|maps| standing_out(maps)),
        maps: MapsRecord::of(maps.as_ref().err()),
        flair: new
            .flair
            .as_ref()
            .map(|placed| verdict(placed).0.to_owned()),
        notes: writer.notes,
        files: writer.files,
        made_with: new.made_with,
        source_blake3: new.source_blake3,
        seconds: (new.begun.elapsed().as_secs_f64() * 100.0).round() / 100.0,
    })
}

/// How many places of the maps of a head stand out; `None` if no limits are known for any of them.
fn standing_out(maps: &LoadedMaps) -> Option<usize> {
    let count = |name: MapName| {
        let places = maps.places(name).iter();
        let count = places.filter(|place| place.stands_out()).count();
        maps.judgement(name).limits.map(|_| count)
    };
    let counts = [MapName::Blur, MapName::Thickness].map(count);
    counts.into_iter().flatten().reduce(|a, b| a + b)
}

/// The verdict on the place of a FLAIR, and the doubt about it.
fn verdict(placed: &Result<PlacementFacts, String>) -> (&'static str, Option<&str>) {
    match placed {
        Err(why) => ("failed", Some(why)),
        Ok(facts) => {
            let word = match facts.verdict {
                PlacementVerdict::Registered => "registered",
                PlacementVerdict::Unchanged => "unchanged",
                PlacementVerdict::Unchecked => "failed",
            };
            let is_doubtful = facts.quality != QualityState::Ok;
            (word, facts.reason.as_deref().filter(|_| is_doubtful))
        }
    }
}

/// The files of a head.
struct Writer<'a> {
    out: &'a Derivatives,
    name: &'a HeadName,
    /// The URI of the T1-weighted volume.
    t1w: &'a str,
    /// The names of those that are written.
    files: Vec<String>,
    notes: Vec<String>,
}

impl Writer<'_> {
    fn add(&mut self, end: &str, bytes: &[u8]) -> Result<(), OutputError> {
        debug_assert!(ends().any(|one| one == end), "{end}");
        self.add_at(self.out.path(self.name, end), bytes)
    }

    fn add_at(&mut self, path: PathBuf, bytes: &[u8]) -> Result<(), OutputError> {
        self.out.write(&path, bytes)?;
        self.files.push(self.out.relative(&path));
        Ok(())
    }

    fn add_json(&mut self, end: &str, value: &Value) -> Result<(), OutputError> {
        self.add(end, format!("{value:#}\n").as_bytes())
    }

    /// The volumes of depths, maps and labels that the head has.
    async fn write_voxels(
        &mut self,
        cases: &Cases,
        id: &CaseId,
        flair: Option<&str>,
    ) -> Result<(), HeadError> {
        for values in VOXELS {
            let is_of_flair = values.map() == Some(MapName::Flair);
            if is_of_flair && flair.is_none() {
                continue;
            }
            let flair = flair.filter(|_| is_of_flair);
            let sources: Vec<_> = std::iter::once(self.t1w).chain(flair).collect();
            let file = match cases.nifti(id, values).await {
                // The record states the reason.
                Err(Error::MapsUndefined(_)) => continue,
                other => other?,
            };
            let stem = stem(values);
            self.add(&format!("{stem}.nii.gz"), &file.bytes)?;
            let (description, units) = words(values);
            let mut about = json!({
                "Description": description,
                "Sources": sources,
                "SpatialReference": self.t1w,
            });
            if let Some(units) = units {
                about["Units"] = units.into();
            }
            self.add_json(&format!("{stem}.json"), &about)?;
            if values.are_labels() {
                let row = |(number, name): &(u16, String)| format!("{number}\t{name}\n");
                let rows: String = file.labels.iter().map(row).collect();
                self.add(
                    &format!("{stem}.tsv"),
                    format!("index\tname\n{rows}").as_bytes(),
                )?;
            }
        }
        Ok(())
    }

    async fn write_places(
        &mut self,
        cases: &Cases,
        id: &CaseId,
        (maps, flair): (&MapsOrNone, &Option<MapsOrNone>),
    ) -> Result<(), HeadError> {
        let gyri = cases.gyri(id).await?;
        let own = maps.as_deref().ok();
        let own = own.map(|maps| [MapName::Blur, MapName::Thickness].map(|name| (name, maps)));
        let of_flair = flair.as_ref().and_then(|maps| maps.as_deref().ok());
        let of_flair = of_flair.map(|maps| (MapName::Flair, maps));
        let names = PlaceNames {
            gyri: gyri.as_deref(),
            ac_pc: None,
        };
        let table = places::table(own.into_iter().flatten().chain(of_flair), &names);
        let [as_table, about] = PLACES;
        self.add(as_table, table.as_bytes())?;
        Ok(self.add_json(about, &places::columns())?)
    }

    fn write_transform(
        &mut self,
        placed: &Result<PlacementFacts, String>,
        flair: &str,
    ) -> Result<(), OutputError> {
        let (verdict, doubt) = verdict(placed);
        let lps = placed.as_ref().ok();
        let lps = lps.map_or(DAffine3::IDENTITY, |facts| {
            pipeline::affine_of(&facts.case_from_layer)
        });
        let matrix = lps_from_ras() * lps * lps_from_ras();
        let row = |axis: usize| {
            let row = matrix.matrix3.row(axis);
            // Adding 0 turns −0 into 0.
            [row.x, row.y, row.z, matrix.translation[axis]].map(|number| number + 0.0)
        };
        let about = json!({
            "Description": "The rigid transform from the scanner space (RAS, mm) of the FLAIR to that of the T1-weighted volume",
            "Sources": [self.t1w, flair],
            "Verdict": verdict,
            "Doubt": doubt,
            "ResidualMm": placed.as_ref().ok().and_then(|facts| facts.residual_mm),
            "Matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
        });
        self.add_json(TRANSFORM, &about)
    }

    async fn write_surfaces(
        &mut self,
        cases: &Cases,
        id: &CaseId,
        surface_file: SurfaceFile,
    ) -> Result<(), HeadError> {
        let size = mesh_size(SURFACE_POINTS, SURFACE_POINTS)?;
        for (surface, hemisphere) in HEMISPHERES {
            let model = match cases.surface(id, surface).await {
                Err(Error::NoSurfaces(reason)) => {
                    self.notes
                        .push(format!("no surfaces of the halves: {reason}"));
                    return Ok(());
                }
                other => other?,
            };
            for depth_mm in SURFACE_DEPTHS_MM {
                let shrunk = model.shrink(size, PathKind::Forest, depth_mm).await?;
                let of = Arc::clone(model.model());
                let write = move || surface_file(&shrunk, &of, size, surface);
                let bytes = cases.queue.run(write).await?;
                self.add(&surface_end(hemisphere, depth_mm), &bytes)?;
            }
        }
        Ok(())
    }

    /// The report, and the picture for the page of all heads.
    async fn write_report(&mut self, cases: &Cases, id: &CaseId) -> Result<(), HeadError> {
        let asked = AskedReport {
            query: ReportQuery::default(),
            format: ReportFormat::Html,
            subject: ReportSubject::OfCase,
            reading: None,
        };
        let report = cases.report(id, asked).await?;
        self.add_at(self.out.report(self.name), &report)?;
        let picture = PictureRequest {
            depth_mm: PICTURE_MM,
            view: Some(NamedView::Left),
            width: PICTURE_SIDE,
            height: PICTURE_SIDE,
            ..PictureRequest::default()
        };
        let series = PictureSeries::of(cases, id, [picture.checked()?]).await?;
        let keep = |png: &mut Vec<u8>, picture: SeriesPicture| {
            *png = picture.encoded()?.png;
            Ok::<_, Error>(())
        };
        let png = series.unnamed().draw_each(cases, Vec::new(), keep).await?;
        Ok(self.add_at(self.out.picture(self.name), &png)?)
    }
}

type MapsOrNone = Result<Arc<LoadedMaps>, Undefined>;

/// What values of voxels are, and their unit.
fn words(values: VoxelValues) -> (&'static str, Option<&'static str>) {
    match values {
        VoxelValues::Depth => (
            "The depth below the envelope of the brain; NaN outside, and where it is unknown",
            Some("mm"),
        ),
        VoxelValues::Sides => (
            "The side of the plane between the hemispheres, within the envelope",
            None,
        ),
        VoxelValues::Regions => ("The regions of the brain", None),
        VoxelValues::Blur => (
            "How much less sharp the junction of grey and white matter is than around it and on the other side, a robust z of this head; NaN where it is undefined",
            Some("arbitrary"),
        ),
        VoxelValues::Thickness => (
            "How much thicker the cortex is than on the other side, a robust z of this head; NaN where it is undefined",
            Some("arbitrary"),
        ),
        VoxelValues::Flair => (
            "How much brighter the FLAIR is at and below the junction of grey and white matter than around it and on the other side, a robust z of this head; NaN where it is undefined",
            Some("arbitrary"),
        ),
        VoxelValues::BlurPlaces => (
            "The ranks of the places of desc-blur; most are normal",
            None,
        ),
        VoxelValues::ThicknessPlaces => (
            "The ranks of the places of desc-thickness; most are normal",
            None,
        ),
        VoxelValues::FlairPlaces => (
            "The ranks of the places of desc-flair; most are normal",
            None,
        ),
        _ => ("Values of voxels", None),
    }
}
