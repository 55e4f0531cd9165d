//! The coarse names of the places of a case and where they are in other heads, from an atlas and the commissures.

use std::sync::Arc;

use case::findings::Finding;
use case::{BrainRegion, CandidateFacts, CaseId, Gyrus, Lobe, StandardPosition};
use glam::DVec3;
use pipeline::ac_pc::AcPc;
use pipeline::atlas::Gyri;

use crate::application::Cases;
use crate::cache::{CacheValue, Part};
use crate::error::Error;

impl CacheValue for Option<Arc<Gyri>> {
    fn bytes(&self) -> u64 {
        self.as_ref().map_or(0, |gyri| size_of_val(&**gyri) as u64)
    }
}

impl Cases {
    /// The names of the places of a ready case; `None` without an atlas, or if the head does not surely fit it.
    ///
    /// The first call for a case takes one to two seconds of CPU time. Nothing of it is stored: another server finds the same.
    ///
    /// # Errors
    /// As [`Cases::ready`]; [`Error::Busy`].
    pub async fn gyri(&self, id: &CaseId) -> Result<Option<Arc<Gyri>>, Error> {
        let Some(atlas) = &self.atlas else {
            return Ok(None);
        };
        let find = async {
            let facts = self.ready(id).await?;
            let _one_at_a_time = self.registering.lock().await;
            let turn = self.queue.turn().await?;
            let placed = self.placed(id).await?;
            let atlas = Arc::clone(atlas);
            let find = move || Gyri::of(&atlas, &facts, &placed.volume, &placed.envelope);
            let found = turn.run(find).await?.unwrap_or_else(|error| {
                tracing::error!("{error}; places have no names");
                None
            });
            Ok::<_, Error>(found.map(Arc::new))
        };
        let known = self.library.cache().get_or_make(id, Part::Gyri, find);
        Ok((*known.await?).clone())
    }

    /// What tells the atlas from others; empty without one.
    pub fn atlas_tag(&self) -> &str {
        self.atlas.as_ref().map_or("", |atlas| atlas.tag())
    }
}

/// What names the places of a head: the atlas that it fits, and the commissures that a reader has set.
#[derive(Debug, Clone, Copy)]
pub struct PlaceNames<'a> {
    pub gyri: Option<&'a Gyri>,
    pub ac_pc: Option<AcPc>,
}

impl PlaceNames<'_> {
    /// Where a position (LPS, mm) is in other heads; `None` where nothing is known.
    pub fn standard(&self, position_in_patient: [f64; 3]) -> Option<StandardPosition> {
        let position = DVec3::from_array(position_in_patient);
        let standard = StandardPosition {
            atlas: self.gyri.map(|gyri| gyri.position(position)),
            ac_pc: self.ac_pc.map(|axes| axes.at(position)),
        };
        (standard != StandardPosition::default()).then_some(standard)
    }

    fn gyrus(&self, position_in_patient: [f64; 3]) -> Option<Gyrus> {
        self.gyri?.at(DVec3::from_array(position_in_patient))
    }

    /// Places with their names. A gyrus that the region of a place excludes is left out: regions are found in the head itself.
    pub fn of_places(&self, places: &[CandidateFacts]) -> Vec<CandidateFacts> {
        let named = |place: &CandidateFacts| {
            let gyrus = self.gyrus(place.position_in_patient);
            CandidateFacts {
                gyrus: gyrus.filter(|gyrus| may_be_in(gyrus.lobe(), place.region)),
                standard: self.standard(place.position_in_patient),
                ..*place
            }
        };
        places.iter().map(named).collect()
    }

    /// Names a finding by the middle of its points.
    pub fn name(&self, finding: &mut Finding) {
        let middle = finding.middle_in_patient();
        finding.gyrus = self.gyrus(middle);
        finding.standard = self.standard(middle);
    }
}

/// Whether a region may have a gyrus of a lobe. What is called cerebrum may be anything, because it is the whole brain if the regions are
/// in doubt, and because the edge of a nucleus may have been missed.
fn may_be_in(lobe: Lobe, region: BrainRegion) -> bool {
    match region {
        BrainRegion::Cerebrum => true,
        BrainRegion::Cerebellum => lobe == Lobe::Cerebellum,
        BrainRegion::BrainStem => false,
        BrainRegion::Deep => lobe == Lobe::Deep,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_excludes_gyri_of_others() {
        let of = |region| {
            let lobes = [Lobe::Temporal, Lobe::Deep, Lobe::Cerebellum];
            lobes.map(|lobe| may_be_in(lobe, region))
        };
        assert_eq!(of(BrainRegion::Cerebrum), [true, true, true]);
        assert_eq!(of(BrainRegion::Cerebellum), [false, false, true]);
        assert_eq!(of(BrainRegion::BrainStem), [false, false, false]);
        assert_eq!(of(BrainRegion::Deep), [false, true, false]);
    }
}
