#![doc = include_str!("../README.md")]

pub mod ac_pc;
mod affine;
pub mod atlas;
mod brain;
mod check;
pub mod codec;
mod cuts;
mod extractor;
mod failure;
pub mod finding_solid;
pub mod findings;
mod head_limits;
pub mod layers;
pub mod maps;
mod own_mask;
pub mod quality;
pub mod registration;
mod source;
mod steps;
pub mod surfaces;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
#[cfg(test)]
mod tests;
mod undefined;
mod voxels;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use analysis::midsagittal_fit;
use bytes::Bytes;
use case::{
    CaseFacts, DicomFacts, Failure, FailureKind, ImageRun, ObjectKind, Parameters, PlaneFacts,
    Progress, SphereFacts, Stage, WindowFacts,
};
use geometry::{
    BrainMask, BuildStep, BuiltModel, DeformableModel, Envelope, GeometryError, Volume,
};
use imaging::dicom::{Attributes, sequence_name};
use imaging::nifti::Replaced;

use self::affine::rows_of;
use self::brain::find_brain;
use self::codec::{encode_brain, encode_envelope, encode_forest, encode_paths, encode_volume};
use self::failure::from_geometry;
use self::source::{are_axes_assumed, check_intensities, read_sound_volume};
use self::steps::Steps;
use self::voxels::voxel_facts;

pub use self::affine::affine_of;
pub use self::check::{check, settled};
pub use self::cuts::envelope_of;
pub use self::extractor::{Extractor, NETWORK_FILE, NoNetwork, shipped};
pub use self::head_limits::HeadLimits;
pub use self::source::{Source, StoredBrain, keeping_form, read_volume};
pub use self::undefined::Undefined;
pub use imaging::Limits;

#[derive(Debug)]
pub struct Prepared {
    /// The brain mask on the working grid, before closing.
    pub brain: BrainMask,
    /// The whole acquired volume.
    pub native: Volume,
    /// Its model, with the distance map and the forest.
    pub built: BuiltModel,
    /// The facts for clients.
    pub facts: CaseFacts,
}

impl Prepared {
    /// The envelope, on the working grid.
    pub fn envelope(&self) -> &Envelope {
        self.built.distance.envelope()
    }
}

/// How a case is prepared.
#[derive(Debug, Clone, Copy)]
struct How<'a> {
    parameters: &'a Parameters,
    limits: &'a Limits,
    extractor: &'a Extractor,
}

/// Computes everything of a case, as [`Pipeline::prepare`].
fn prepare(source: &Source, how: How<'_>, mut steps: Steps<'_>) -> Result<Prepared, Failure> {
    let parameters = how.parameters;
    parameters.check()?;
    steps.begin(Stage::Reading)?;
    let (native, replaced) = read_sound_volume(source, how.limits)?;
    let mut found = find_brain(source, &native, how, &mut steps)?;

    steps.begin(Stage::Closing)?;
    let closed = found.close(parameters)?;
    let is_assumed = are_axes_assumed(source, how.limits)?;
    found.rate_source(closed.envelope(), native.grid(), &replaced, is_assumed);
    let quality = found.quality(closed.envelope(), native.grid());
    let volume = crop(&native, closed.envelope())?;

    let observe = |step| match stage_of(step) {
        Some(stage) => Ok(steps.begin(stage)?),
        None => Ok(steps.go_on()?),
    };
    let built = DeformableModel::build(volume, closed, observe);
    let built = built.map_err(|Refused(failure)| failure)?;

    let mut facts = CaseFacts {
        quality: Some(quality),
        dicom: source.dicom.as_deref().map(dicom_facts).transpose()?,
        ..facts_with(&built, &native, &replaced)
    };
    // Last, so that everything before belongs to a stage.
    facts.timings = steps.timings();
    Ok(Prepared {
        brain: found.brain,
        native,
        built,
        facts,
    })
}

/// The stage that begins with a step; `None` for a step within a stage.
fn stage_of(step: BuildStep) -> Option<Stage> {
    match step {
        BuildStep::Distance => Some(Stage::Distance),
        BuildStep::Core => Some(Stage::Core),
        BuildStep::Forest => Some(Stage::Forest),
        BuildStep::Field => Some(Stage::Mesh),
        BuildStep::Mesh | BuildStep::Table | BuildStep::Shell => None,
    }
}

/// The reason why no model was built.
struct Refused(Failure);

impl From<Failure> for Refused {
    fn from(failure: Failure) -> Self {
        Self(failure)
    }
}

impl From<GeometryError> for Refused {
    fn from(error: GeometryError) -> Self {
        Self(from_geometry(error))
    }
}

/// The facts about the DICOM files that clients may see, without the identity of the patient.
fn dicom_facts(stored: &[u8]) -> Result<DicomFacts, Failure> {
    let stored = attributes(stored)?;
    Ok(DicomFacts {
        sequence: sequence_of(&stored.attributes),
        series_number: series_number_of(&stored.attributes),
        images: images_of(&stored),
        interpolated_slices: stored.interpolated_slices,
    })
}

/// The number of the series.
fn series_number_of(attributes: &[(String, String)]) -> Option<i64> {
    let (_, number) = attributes.iter().find(|(name, _)| name == "SeriesNumber")?;
    number.trim().parse().ok()
}

/// The numbers of the images that are slices; empty if an image has none, or one beyond the 32 bits of DICOM.
fn images_of(stored: &Attributes) -> Vec<ImageRun> {
    let is_acquired = |slice: &usize| !stored.interpolated_slices.contains(slice);
    let slices = (1..).filter(is_acquired);
    let numbered = slices.zip(&stored.instances);
    let numbered: Option<Vec<_>> = numbered
        .map(|(slice, instance)| Some((slice, i32::try_from(instance.number?).ok()?)))
        .collect();
    ImageRun::join(&numbered.unwrap_or_default())
}

/// The scanner's own name of a sequence with its times. Descriptions that people type may name the patient: they are
/// left out.
fn sequence_of(attributes: &[(String, String)]) -> Option<String> {
    let parts = [
        ("SequenceName", ""),
        ("RepetitionTime", "TR "),
        ("EchoTime", "TE "),
        ("InversionTime", "TI "),
    ];
    let told = parts.iter().filter_map(|(keyword, before)| {
        let (_, value) = attributes.iter().find(|(name, _)| name == keyword)?;
        // Of several echoes, the first.
        let first = match *keyword {
            "SequenceName" => sequence_name(value)?,
            _ => value.split('\\').next().unwrap_or_default().trim(),
        };
        let is_fit = !first.is_empty() && first.len() <= 16 && !first.contains(char::is_control);
        is_fit.then(|| format!("{before}{first}"))
    });
    let told: Vec<_> = told.collect();
    (!told.is_empty()).then(|| told.join(", "))
}

/// The stored attributes of DICOM files.
///
/// # Errors
/// If they are damaged.
pub fn attributes(stored: &[u8]) -> Result<Attributes, Failure> {
    serde_json::from_slice(stored).map_err(|_| Failure::source_damaged())
}

/// The part of the volume inside the envelope's grid, which must have more than one intensity.
fn crop(native: &Volume, envelope: &Envelope) -> Result<Volume, Failure> {
    let volume = DeformableModel::crop(native, envelope).ok_or_else(|| {
        Failure::unusable(
            "mask-outside-volume",
            "nothing of the mask lies inside the volume; is it the mask of another head?"
                .to_owned(),
        )
    })?;
    check_intensities(&volume)?;
    Ok(volume)
}

/// The facts about a model that clients see: grids, depth, intensities, and the plane between the hemispheres. `native` is the
/// whole acquired volume.
pub fn facts(built: &BuiltModel, native: &Volume) -> CaseFacts {
    facts_with(built, native, &Replaced::default())
}

/// As [`facts`], with the voxels of the acquired volume that were replaced when it was read.
fn facts_with(built: &BuiltModel, native: &Volume, replaced: &Replaced) -> CaseFacts {
    let (volume, distance) = (built.model.volume(), &built.distance);
    let grid = distance.grid();
    let [intensity_min, intensity_max] = volume.intensity_range();
    let [low, high] = volume
        .percentiles_inside(distance.envelope(), [0.02, 0.98])
        .unwrap_or([intensity_min, intensity_max]);
    let fit = midsagittal_fit(distance.envelope(), volume);
    let sphere = built.model.bounds();
    CaseFacts {
        grid_size: grid.size(),
        spacing_mm: grid.spacing_mm()[0],
        patient_from_voxel: rows_of(grid.patient_from_voxel()),
        native_size: native.grid().size(),
        native_spacing_mm: native.grid().spacing_mm(),
        native_patient_from_voxel: rows_of(native.grid().patient_from_voxel()),
        voxels: Some(voxel_facts(native, replaced)),
        envelope_sphere: SphereFacts {
            center_in_patient: sphere.centre_in_patient.to_array(),
            radius_mm: sphere.radius_mm,
        },
        midsagittal: PlaneFacts {
            normal: fit.plane.normal().to_array(),
            offset_mm: fit.plane.offset_mm(),
            correlation: fit.correlation,
            doubtful: fit.is_doubtful(),
        },
        cuts: cuts::cut_facts(distance.envelope().cuts()),
        pipeline: cuts::PIPELINE,
        max_depth_mm: distance.max_depth_mm(),
        envelope_ml: distance.envelope().volume_ml(),
        intensity_min,
        intensity_max,
        window: window(low, high),
        dicom: None,
        quality: None,
        timings: Vec::new(),
    }
}

/// The window for an interval of intensities. An empty interval gets a minimal width, because DICOM requires one.
fn window(low: f32, high: f32) -> WindowFacts {
    let least_width = f32::EPSILON * low.abs().max(high.abs()).max(1.0) * 16.0;
    WindowFacts {
        center: f32::midpoint(low, high),
        width: (high - low).max(least_width),
    }
}

/// The stored results of a preparation.
#[derive(Debug)]
pub struct Derived {
    /// The payload of each derived object.
    pub objects: Vec<(ObjectKind, Bytes)>,
    /// The facts for clients.
    pub facts: CaseFacts,
}

impl Derived {
    /// Encodes the objects of a computed case.
    pub fn of(prepared: Prepared) -> Self {
        let Prepared {
            brain,
            native,
            built,
            facts,
        } = prepared;
        let BuiltModel {
            model,
            distance,
            forest,
        } = built;
        let (volume, default_paths) = model.into_stored();
        let envelope = distance.envelope();
        // The whole volume takes about as long as everything else.
        let (mut objects, whole) = rayon::join(
            || {
                vec![
                    (ObjectKind::Mask, encode_brain(&brain).into()),
                    (ObjectKind::Envelope, encode_envelope(envelope).into()),
                    (ObjectKind::Forest, encode_forest(&forest, envelope).into()),
                    (ObjectKind::Paths, encode_paths(&default_paths).into()),
                    (ObjectKind::Volume, encode_volume(&volume).into()),
                ]
            },
            || (ObjectKind::WholeVolume, encode_volume(&native).into()),
        );
        objects.push(whole);
        Self { objects, facts }
    }
}

/// Threads for a preparation.
fn pool_of(threads: usize) -> Result<rayon::ThreadPool, Failure> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|number| format!("preparation {number}"));
    pool.build().map_err(|_| {
        let detail = "no threads are available for the preparation";
        Failure::new(FailureKind::Internal, "preparation-crashed", detail)
    })
}

#[derive(Debug, Clone, Default)]
pub struct Pipeline {
    extractor: Arc<Extractor>,
    threads: Option<usize>,
}

impl Pipeline {
    /// A pipeline with an extractor.
    pub fn new(extractor: Extractor) -> Self {
        Self {
            extractor: Arc::new(extractor),
            threads: None,
        }
    }

    /// The same with so many threads for each preparation; without this, all preparations share one for each CPU core.
    /// The results do not depend on it.
    #[must_use]
    pub fn with_threads(self, threads: usize) -> Self {
        Self {
            threads: Some(threads),
            ..self
        }
    }

    /// Whether there is a network that extracts brains.
    pub fn has_network(&self) -> bool {
        self.extractor.has_network()
    }

    /// Computes everything of a case.
    ///
    /// `observe` receives each step as it begins, and the progress of an extraction. After `cancelled` is set, no
    /// further step begins, and an extraction stops at once.
    ///
    /// # Errors
    /// A [`Failure`] that states what is wrong with the input; `cancelled` if it was cancelled.
    pub fn prepare(
        &self,
        source: &Source,
        parameters: &Parameters,
        limits: &Limits,
        observe: &(dyn Fn(Progress) + Sync),
        cancelled: &AtomicBool,
    ) -> Result<Prepared, Failure> {
        let how = How {
            parameters,
            limits,
            extractor: &self.extractor,
        };
        self.on_its_threads(|| prepare(source, how, Steps::new(observe, cancelled)))
    }

    /// The same, encoded for the store.
    ///
    /// # Errors
    /// As [`Pipeline::prepare`].
    pub fn derive(
        &self,
        source: &Source,
        parameters: &Parameters,
        limits: &Limits,
        observe: &(dyn Fn(Progress) + Sync),
        cancelled: &AtomicBool,
    ) -> Result<Derived, Failure> {
        let how = How {
            parameters,
            limits,
            extractor: &self.extractor,
        };
        self.on_its_threads(|| {
            prepare(source, how, Steps::new(observe, cancelled)).map(Derived::of)
        })
    }

    fn on_its_threads<T: Send>(
        &self,
        work: impl FnOnce() -> Result<T, Failure> + Send,
    ) -> Result<T, Failure> {
        match self.threads {
            // Its own threads: a shared one that waits for a turn to extract could be the one that has the turn.
            Some(threads) => pool_of(threads)?.install(work),
            None => work(),
        }
    }
}
