//! The coarse names of the places of a case, from an atlas.

use std::sync::Arc;

use case::{BrainRegion, CandidateFacts, CaseId, Lobe};
use glam::DVec3;
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

/// Places with the names of their gyri. A name that the region of a place excludes is left out: regions are found in the head itself.
pub fn named(places: &[CandidateFacts], gyri: Option<&Gyri>) -> Vec<CandidateFacts> {
    let named = |place: &CandidateFacts| {
        let gyrus = gyri.and_then(|gyri| gyri.at(DVec3::from_array(place.position_in_patient)));
        CandidateFacts {
            gyrus: gyrus.filter(|gyrus| may_be_in(gyrus.lobe(), place.region)),
            ..*place
        }
    };
    places.iter().map(named).collect()
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
