//! A study of synthetic lesions in real heads: what the lists of the program find of them.

mod heads;
mod lesion;
mod page;
mod paint;
mod places;
mod run;
mod search;
mod stored;
#[cfg(test)]
mod tests;
mod widen;

pub use heads::{Finished, MaskFrom, StudyFolders, StudyHead};
pub use lesion::{Effect, Lesion};
pub use page::{Report, page};
pub use places::{Area, Place};
pub use run::{
    FOUR_LESIONS, HeadResult, SEED, Sighting, Sign, Simulator, StudyParameters, Trial, run_head,
    seed_of,
};
pub use search::{Mark, hit};

use std::sync::OnceLock;

use analysis::{Block, Head, MapsUndefined, TissueScale, tissue_of};
use geometry::Volume;
use glam::DVec3;

/// A head that receives lesions.
pub struct Ground<'a> {
    pub(crate) head: Head<'a>,
    pub(crate) block: Block,
    pub(crate) values: Vec<f32>,
    tissue: TissueScale,
    /// The noise of the head, for the second simulator.
    grain: OnceLock<paint::Grain>,
    /// Points of the ventricles, LPS mm.
    ventricles: OnceLock<Vec<DVec3>>,
}

impl<'a> Ground<'a> {
    /// # Errors
    /// If the head has no maps.
    pub fn new(head: Head<'a>) -> Result<Self, MapsUndefined> {
        let (block, values, tissue) = tissue_of(head)?;
        Ok(Self {
            head,
            block,
            values,
            tissue,
            grain: OnceLock::new(),
            ventricles: OnceLock::new(),
        })
    }

    /// Places for lesions, shams and comparison, by seed: all by one rule, each independently of the others.
    pub fn places(&self, count: usize, seed: u64) -> Vec<Place> {
        let offers = places::offers(self.head, &self.block, &self.values);
        places::places(&offers, count, seed)
    }

    /// The point of the ventricles nearest to a position, LPS mm; `None` if none are found.
    pub fn nearest_ventricle(&self, position: DVec3) -> Option<DVec3> {
        let found = || places::ventricles(self.head, &self.block, &self.values);
        let ventricles = self.ventricles.get_or_init(found).iter().copied();
        ventricles.min_by(|one, other| {
            let [one, other] = [one, other].map(|point| point.distance_squared(position));
            one.total_cmp(&other)
        })
    }

    /// The volume of the head with a lesion from one of the simulators.
    pub fn simulated(&self, lesion: &Lesion, simulator: Simulator) -> Volume {
        match simulator {
            Simulator::Displaced => self.with_lesion(lesion),
            Simulator::Painted => paint::painted(&self.canvas(), lesion),
            Simulator::Widened => widen::widened(&self.canvas(), lesion),
        }
    }

    fn canvas(&self) -> paint::Canvas<'_> {
        let grain = || paint::Grain::of(&self.block, &self.values, &self.tissue);
        paint::Canvas {
            volume: self.head.volume,
            block: &self.block,
            values: &self.values,
            tissue: &self.tissue,
            grain: *self.grain.get_or_init(grain),
        }
    }

    /// The volume of the head with a lesion from the first simulator.
    pub fn with_lesion(&self, lesion: &Lesion) -> Volume {
        let ground = lesion::Ground {
            volume: self.head.volume,
            block: &self.block,
            values: &self.values,
            tissue: &self.tissue,
        };
        lesion::with_lesion(&ground, lesion)
    }
}
