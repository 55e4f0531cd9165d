//! The maps of a case: the sharpness of its junction of grey and white matter, computed once and stored as one object.

use analysis::{
    Candidate, DepthBand, Division, Flair, Head, JunctionPlaces, MapKind, Maps, MapsUndefined,
    MidsagittalPlane, NoDivision, Region, RegionDoubt, Regions, StoredMap,
};
use case::{
    BrainRegion, CandidateFacts, CaseFacts, JunctionBandFacts, MapName, MaskMethod, PatientSide,
    PlacementFacts, QualityState, RegionFacts, RegionNumbers, Unusual,
};
use geometry::{DepthField, Envelope, Grid, Volume};
use glam::DVec3;

pub use analysis::{
    HeadDoubts, Judgement, JunctionWidth, MAP_FORMAT, Scale, ScoreCaveat, ScoreLimits,
    UNDEFINED as UNDEFINED_CODE, width_table,
};

use crate::{Undefined, affine_of};

/// The maps of a case, or the map of a FLAIR among its layers.
#[derive(Debug, Clone, PartialEq)]
pub struct CaseMaps {
    /// The maps in the order of [`MapKind::OF_HEAD`], or the one of the FLAIR.
    pub(crate) maps: Vec<StoredMap>,
    /// The most blurred places of the cerebrum, or the brightest ones of the FLAIR, the highest value first.
    pub candidates: Vec<CandidateFacts>,
    /// The same elsewhere in the brain.
    pub elsewhere: Vec<CandidateFacts>,
    /// The places with the thickest cortex compared with the other side: in the cerebrum, and elsewhere in the brain.
    pub thick: [Vec<CandidateFacts>; 2],
    /// The regions of the brain.
    pub regions: RegionFacts,
    /// How slantwise isosurfaces meet the junction, from the surface inwards.
    pub junction_by_depth: Vec<JunctionBandFacts>,
    /// Why scores mean less than in other heads.
    pub doubts: HeadDoubts,
}

/// The reason for no map of a FLAIR whose place must be checked by eye.
fn doubtful_place(placement: &PlacementFacts) -> Undefined {
    let why = placement.reason.as_deref();
    let why = why.unwrap_or("it was not compared with the volume of the case");
    Undefined {
        code: "flair-place-doubtful".into(),
        sentence: format!(
            "the place of the FLAIR is not certain, and its map needs one that is: {why}"
        )
        .into(),
    }
}

/// The maps of a case, or the reason why it has none.
pub type MapsOrReason = Result<CaseMaps, Undefined>;

impl CaseMaps {
    /// How many places of the cerebrum have an unusual score, in any map that lists places.
    pub fn standing_out(&self) -> usize {
        let places = self.candidates.iter().chain(&self.thick[0]);
        places.filter(|place| place.stands_out()).count()
    }

    /// One of the maps.
    ///
    /// # Panics
    /// If it is not among them.
    pub fn map(&self, name: MapName) -> &StoredMap {
        let mut maps = self.maps.iter();
        let found = maps.find(|map| map.kind() == kind_of(name));
        found.expect("the maps of a case have one of each name, those of a layer have `flair`")
    }

    /// The grid of all of them.
    pub fn grid(&self) -> &Grid {
        self.maps[0].grid()
    }

    /// The maps with their names.
    pub fn into_named(self) -> impl Iterator<Item = (MapName, StoredMap)> {
        let named = |map: StoredMap| (name_of(map.kind()), map);
        self.maps.into_iter().map(named)
    }
}

/// The unit of a map's values; empty if they have none.
pub fn map_unit(name: MapName) -> &'static str {
    kind_of(name).unit()
}

/// What is known about the scores of a map of a head with voxels of these edges, in mm, and these doubts.
pub fn judgement(name: MapName, spacing_mm: [f64; 3], doubts: HeadDoubts) -> Judgement {
    Judgement::of(kind_of(name), spacing_mm, doubts)
}

/// The plane at which a case is mirrored.
///
/// # Panics
/// If its normal has no direction, which no preparation writes.
pub fn mirror_plane(facts: &CaseFacts) -> MidsagittalPlane {
    let plane = &facts.midsagittal;
    MidsagittalPlane::new(DVec3::from_array(plane.normal), plane.offset_mm)
        .expect("the normal of the stored plane has a direction")
}

/// Computes the maps of a case; the reason if they are undefined.
pub fn compute_maps(facts: &CaseFacts, envelope: &Envelope, volume: &Volume) -> MapsOrReason {
    let maps = of_head(facts, envelope, volume, analysis::maps)?;
    Ok(CaseMaps::of(maps, facts, envelope))
}

/// The same, and the parts of the brain, which are found with the regions that the maps need.
pub(crate) fn compute_maps_and_division(
    facts: &CaseFacts,
    envelope: &Envelope,
    volume: &Volume,
) -> (MapsOrReason, Result<Division, NoDivision>) {
    match of_head(facts, envelope, volume, analysis::maps_and_division) {
        Ok((maps, division)) => (Ok(CaseMaps::of(maps, facts, envelope)), division),
        Err(reason) => (Err(reason.into()), Err(reason.into())),
    }
}

/// What is doubtful about the regions of a case from its mask, unless that is rated as failed.
fn doubt_of(facts: &CaseFacts) -> Result<Option<RegionDoubt>, MapsUndefined> {
    let quality = facts.quality.as_ref();
    if quality.is_some_and(|quality| quality.state == QualityState::Failed) {
        return Err(MapsUndefined::FailedEnvelope);
    }
    let is_pruned = quality.is_some_and(|quality| quality.method == MaskMethod::TreePruning);
    Ok(is_pruned.then_some(RegionDoubt::PrunedMask))
}

/// Computes the map of a FLAIR of a case, whose stored voxels are `layer`; the reason if it is undefined.
pub fn compute_flair(
    facts: &CaseFacts,
    envelope: &Envelope,
    volume: &Volume,
    layer: &Volume,
    placement: &PlacementFacts,
) -> MapsOrReason {
    doubt_of(facts)?;
    if placement.quality != QualityState::Ok {
        return Err(doubtful_place(placement));
    }
    let flair = Flair {
        volume: layer,
        case_from_layer: affine_of(&placement.case_from_layer),
    };
    let find = |head: Head<'_>, doubt| Ok(analysis::flair_map(head, flair, doubt));
    let found = of_head(facts, envelope, volume, find)??;
    let [candidates, elsewhere] =
        (found.places.each_ref()).map(|places| facts_of(places, facts, envelope));
    Ok(CaseMaps {
        maps: vec![found.map],
        candidates,
        elsewhere,
        thick: Default::default(),
        regions: region_facts(&found.regions),
        junction_by_depth: Vec::new(),
        doubts: HeadDoubts::default(),
    })
}

/// Computes something of the head of a case, whose regions may be in doubt.
fn of_head<T>(
    facts: &CaseFacts,
    envelope: &Envelope,
    volume: &Volume,
    compute: impl FnOnce(Head<'_>, Option<RegionDoubt>) -> Result<T, MapsUndefined>,
) -> Result<T, MapsUndefined> {
    let doubt = doubt_of(facts)?;
    let head = Head {
        volume,
        depth: &DepthField::new(&geometry::distance_map(envelope)),
        plane: &mirror_plane(facts),
    };
    compute(head, doubt)
}

/// The junction of grey and white matter of a case; the reason if it is not seen.
pub(crate) fn junction_places(
    facts: &CaseFacts,
    envelope: &Envelope,
    volume: &Volume,
) -> Result<JunctionPlaces, MapsUndefined> {
    of_head(facts, envelope, volume, |head, _doubt| {
        JunctionPlaces::new(head)
    })
}

/// The regions of a brain as labels of voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionLabels {
    /// A block of the grid of the volume.
    pub grid: Grid,
    /// A number for each voxel, x-fastest; 0 outside the brain.
    pub numbers: Vec<u8>,
    /// The numbers with their names. If the regions are in doubt, there are two halves, which the names say.
    pub names: Vec<(u8, &'static str)>,
}

/// Finds the regions of the brain of a case again, as its maps have them; the reason if it has none.
pub fn compute_regions(
    facts: &CaseFacts,
    envelope: &Envelope,
    volume: &Volume,
) -> Result<RegionLabels, Undefined> {
    let find = |head: Head<'_>, doubt| {
        let (block, values, _) = analysis::tissue_of(head)?;
        Ok(analysis::regions(head, &block, &values, doubt))
    };
    let regions = of_head(facts, envelope, volume, find)?;
    let named = |region: &Region| (*region as u8, region_name(*region));
    let names = match regions.doubts.first() {
        // Then even the halves are not known.
        Some(doubt) if regions.sheet.is_none() => {
            return Err(Undefined {
                code: doubt.code().into(),
                sentence: doubt.to_string().into(),
            });
        }
        Some(_) => vec![
            (1, "left half, undivided because the regions are in doubt"),
            (2, "right half, undivided because the regions are in doubt"),
        ],
        None => Region::ALL.iter().map(named).collect(),
    };
    Ok(RegionLabels {
        grid: regions.grid().clone(),
        numbers: regions.codes().to_vec(),
        names,
    })
}

fn region_name(region: Region) -> &'static str {
    match region {
        Region::LeftCerebrum => "left cerebrum",
        Region::RightCerebrum => "right cerebrum",
        Region::Cerebellum => "cerebellum",
        Region::BrainStem => "brain stem",
        Region::LeftDeep => "left deep, no cortex",
        Region::RightDeep => "right deep, no cortex",
    }
}

/// The parts of the brain of a case; the reason if it has none.
pub(crate) fn compute_division(
    facts: &CaseFacts,
    envelope: &Envelope,
    volume: &Volume,
) -> Result<Division, NoDivision> {
    let divide = |head: Head<'_>, doubt| Ok(Division::new(head, doubt));
    of_head(facts, envelope, volume, divide)?
}

impl CaseMaps {
    fn of(maps: Maps, facts: &CaseFacts, envelope: &Envelope) -> Self {
        let facts_of = |places: &[Candidate]| facts_of(places, facts, envelope);
        Self {
            candidates: facts_of(&maps.candidates),
            elsewhere: facts_of(&maps.elsewhere),
            thick: (maps.thick.each_ref()).map(|places| facts_of(places)),
            regions: region_facts(&maps.regions),
            junction_by_depth: maps.depth_bands.iter().map(junction_band_facts).collect(),
            doubts: maps.doubts,
            maps: maps.into_maps(),
        }
    }
}

/// The side of a position (LPS mm); unknown if the plane between the hemispheres is in doubt, because the plane of half a brain lies
/// within that half.
pub fn side_at(facts: &CaseFacts, position_in_patient: DVec3) -> PatientSide {
    match facts.midsagittal.doubtful {
        true => PatientSide::Unknown,
        false => side_of(&mirror_plane(facts), position_in_patient),
    }
}

/// The side of a plane between the hemispheres that a position (LPS mm) is on.
pub(crate) fn side_of(plane: &MidsagittalPlane, position_in_patient: DVec3) -> PatientSide {
    PatientSide::at(plane.left_mm(position_in_patient))
}

fn facts_of(places: &[Candidate], facts: &CaseFacts, envelope: &Envelope) -> Vec<CandidateFacts> {
    let of = |candidate| candidate_facts(candidate, facts, envelope);
    places.iter().map(of).collect()
}

fn candidate_facts(
    candidate: &Candidate,
    facts: &CaseFacts,
    envelope: &Envelope,
) -> CandidateFacts {
    let Candidate {
        position_in_patient,
        depth_mm,
        ..
    } = *candidate;
    let is_known = envelope.cuts_leave(position_in_patient, depth_mm);
    CandidateFacts {
        position_in_patient: position_in_patient.to_array(),
        depth_mm: is_known.then_some(depth_mm),
        side: side_at(facts, position_in_patient),
        score: candidate.score,
        size_mm: candidate.size_mm,
        region: match candidate.region {
            Region::LeftCerebrum | Region::RightCerebrum => BrainRegion::Cerebrum,
            Region::Cerebellum => BrainRegion::Cerebellum,
            Region::BrainStem => BrainRegion::BrainStem,
            Region::LeftDeep | Region::RightDeep => BrainRegion::Deep,
        },
        unusual: candidate.unusual.map(|unusual| match unusual {
            analysis::Unusual::Yes => Unusual::Yes,
            analysis::Unusual::Borderline => Unusual::Borderline,
            analysis::Unusual::No => Unusual::No,
        }),
        gyrus: None,
        standard: None,
    }
}

fn region_facts(regions: &Regions) -> RegionFacts {
    let doubts = regions.doubts.iter();
    RegionFacts {
        state: if regions.doubts.is_empty() {
            QualityState::Ok
        } else {
            QualityState::Review
        },
        reasons: doubts.clone().map(ToString::to_string).collect(),
        reason_codes: doubts.map(|doubt| doubt.code().to_owned()).collect(),
        numbers: regions.numbers.map(|numbers| RegionNumbers {
            cerebrum_ml: numbers.cerebrum_ml,
            cerebellum_ml: numbers.cerebellum_ml,
            brain_stem_ml: numbers.brain_stem_ml,
            cerebellum_symmetry: numbers.cerebellum_symmetry,
            cerebrum_symmetry: numbers.cerebrum_symmetry,
            deep_ml: numbers.deep_ml,
            deep_symmetry: numbers.deep_symmetry,
            neck_cm2: numbers.neck_cm2,
            pons_cm2: numbers.pons_cm2,
            bright_share: numbers.bright_share,
            fissure_share: numbers.fissure_share,
        }),
    }
}

fn junction_band_facts(band: &DepthBand) -> JunctionBandFacts {
    let &DepthBand {
        from_mm,
        to_mm,
        places,
        slanted_share,
    } = band;
    JunctionBandFacts {
        from_mm,
        to_mm,
        places,
        slanted_share,
    }
}

/// The kind of a map in `analysis`, which does not know the names of the interfaces.
fn kind_of(name: MapName) -> MapKind {
    match name {
        MapName::Blur => MapKind::Blur,
        MapName::Sharpness => MapKind::Sharpness,
        MapName::Asymmetry => MapKind::Asymmetry,
        MapName::IntensityAsymmetry => MapKind::IntensityAsymmetry,
        MapName::Junction => MapKind::Junction,
        MapName::Thickness => MapKind::Thickness,
        MapName::Flair => MapKind::Flair,
    }
}

fn name_of(kind: MapKind) -> MapName {
    let name = MapName::ALL.into_iter().find(|&name| kind_of(name) == kind);
    name.expect("every kind has a name")
}

#[cfg(test)]
mod tests {
    use std::sync::OnceLock;
    use std::sync::atomic::AtomicBool;

    use geometry::phantom;

    use super::*;
    use crate::codec::{decode_maps, encode_maps};
    use crate::testing::upload;
    use crate::{Limits, Pipeline, Prepared};

    /// A head of 2 mm with a blurred lesion in the right frontal lobe.
    fn prepared() -> &'static Prepared {
        static PREPARED: OnceLock<Prepared> = OnceLock::new();
        PREPARED.get_or_init(|| {
            let source = upload(&phantom::head(2.0));
            let never = AtomicBool::new(false);
            let prepared = Pipeline::default().prepare(
                &source,
                &case::Parameters::default(),
                &Limits::default(),
                &|_| {},
                &never,
            );
            prepared.unwrap()
        })
    }

    fn maps(facts: &CaseFacts) -> MapsOrReason {
        let prepared = prepared();
        compute_maps(facts, prepared.envelope(), prepared.built.model.volume())
    }

    #[test]
    fn maps_come_back_from_their_payload_and_another_format_does_not() {
        let maps = maps(&prepared().facts);
        assert!(!maps.as_ref().unwrap().candidates.is_empty());
        let payload = encode_maps(&maps);
        assert_eq!(decode_maps(&payload), Some(maps));
        for length in [0, 3, 4, 40, payload.len() / 2, payload.len() - 1] {
            assert_eq!(decode_maps(&payload[..length]), None, "{length}");
        }
        let format = format!("{{\"format\":{MAP_FORMAT}");
        let place = payload
            .windows(format.len())
            .position(|part| part == format.as_bytes());
        let mut other = payload;
        other[place.unwrap() + format.len() - 1] = b'0';
        assert_eq!(decode_maps(&other), None);
    }

    #[test]
    fn a_mask_that_is_not_to_be_believed_gives_the_reason_in_place_of_maps() {
        let mut facts = prepared().facts.clone();
        facts.quality.as_mut().unwrap().state = QualityState::Failed;
        let none = maps(&facts);
        let reason = none.as_ref().unwrap_err();
        assert!(
            reason.sentence.contains("mask is rated `failed`"),
            "{reason}"
        );
        assert_eq!(reason.code, "failed-envelope");
        assert_eq!(decode_maps(&encode_maps(&none)), Some(none));
    }

    #[test]
    fn the_regions_of_a_pruned_mask_are_in_doubt_and_everything_is_cerebrum() {
        let mut facts = prepared().facts.clone();
        facts.quality.as_mut().unwrap().method = MaskMethod::TreePruning;
        let maps = maps(&facts).unwrap();
        assert_eq!(maps.regions.state, QualityState::Review);
        assert_eq!(maps.regions.reason_codes[0], "regions-pruned-mask");
        assert!(
            maps.regions.reasons[0].contains("tree pruning"),
            "{:?}",
            maps.regions
        );
        assert_eq!(maps.elsewhere, []);
        assert!(
            maps.candidates
                .iter()
                .all(|place| place.region == BrainRegion::Cerebrum)
        );
    }

    #[test]
    fn a_plane_in_doubt_tells_no_side() {
        let mut facts = prepared().facts.clone();
        let at = |facts: &CaseFacts, x: f64| side_at(facts, DVec3::new(x, 10.0, 20.0));
        let sides = |facts: &CaseFacts| [30.0, 0.0, -20.0, -60.0].map(|x| at(facts, x));
        use PatientSide::{Left, Middle, Right, Unknown};
        assert_eq!(sides(&facts), [Left, Middle, Right, Right]);
        // Of the right half alone, the plane lies within that half.
        facts.midsagittal.doubtful = true;
        assert_eq!(sides(&facts), [Unknown; 4]);
        let maps = maps(&facts).unwrap();
        let mut places = maps.candidates.iter();
        assert!(places.all(|place| place.side == at_place(&facts, place)));
    }

    fn at_place(facts: &CaseFacts, place: &CandidateFacts) -> PatientSide {
        side_at(facts, DVec3::from_array(place.position_in_patient))
    }

    #[test]
    fn a_place_near_a_face_that_cuts_the_brain_has_no_depth() {
        let prepared = prepared();
        let whole = maps(&prepared.facts).unwrap().candidates;
        let [_, _, height_mm] = whole[0].position_in_patient;
        let cut = geometry::Cut {
            face: geometry::Face::Inferior,
            inward: DVec3::Z,
            offset_mm: height_mm - 2.0,
        };
        let envelope = prepared.envelope().clone().with_cuts(vec![cut]);
        let volume = prepared.built.model.volume();
        let cut = compute_maps(&prepared.facts, &envelope, volume).unwrap();
        let at =
            |place: &&CandidateFacts| place.position_in_patient == whole[0].position_in_patient;
        let near = cut.candidates.iter().find(at).unwrap();
        assert_eq!(near.depth_mm, None);
        assert!(whole[0].depth_mm.is_some());
        assert!(cut.candidates.iter().any(|place| place.depth_mm.is_some()));
    }

    #[test]
    fn every_map_is_found_under_its_name() {
        let maps = maps(&prepared().facts).unwrap();
        for name in MapName::OF_CASE {
            assert_eq!(name_of(maps.map(name).kind()), name);
            assert_eq!(maps.map(name).kind().name(), name.name());
        }
        let named: Vec<_> = maps.clone().into_named().collect();
        assert!(named.iter().all(|(name, map)| maps.map(*name) == map));
    }
}
