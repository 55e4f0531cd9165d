//! The profile from the envelope inwards through a point, and through its mirrored point.

use std::sync::Arc;

use case::{CaseFacts, Gyrus, Lobe, MapName, PatientSide};
use geometry::{DeformableModel, DepthField};
use glam::DVec3;
use pipeline::Undefined;
use pipeline::atlas::Gyri;
use pipeline::maps::{JunctionWidth, mirror_plane, side_at, width_table};
use serde::Serialize;

use crate::error::Error;
use crate::library::LoadedMaps;
use crate::models::WarmModel;

/// The distance from one sample to the next, in mm.
const STEP_MM: f64 = 0.5;

/// The length of a profile inwards from its point, in mm.
const INWARDS_MM: f64 = 20.0;

/// The greatest length outwards to the envelope, in mm.
const OUTWARDS_MM: f64 = 60.0;

/// Below this length, a gradient has no direction: at a ridge, every direction leads outwards.
const LEAST_GRADIENT: f32 = 0.2;

/// The profile through a point and the profile through its mirrored point.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Profile {
    /// Through the requested point.
    pub own: PointProfile,
    /// Through the point mirrored at the plane between the hemispheres; absent if that point is outside the envelope.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirrored: Option<PointProfile>,
    /// The reason why the values of maps are absent, if they are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub maps_undefined: Option<String>,
    /// The added layers that are ready, in the order of the values of each sample.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub layers: Vec<ProfileLayer>,
}

/// A layer of a profile.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ProfileLayer {
    /// Its id.
    #[cfg_attr(feature = "openapi", schema(value_type = String))]
    pub id: case::LayerId,
    /// Its name.
    pub name: String,
    /// The unit of its values; empty if they have none.
    pub unit: String,
    /// The labels, if it is a label map: a value is the number of one of them, from 1.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub labels: Vec<case::LabelFacts>,
}

/// An added layer to be sampled.
#[derive(Debug, Clone)]
pub struct SampledLayer {
    pub about: ProfileLayer,
    pub layer: Arc<render::Layer>,
}

/// A point and the profile through it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct PointProfile {
    /// The side of the plane between the hemispheres.
    pub side: PatientSide,
    /// About which gyrus the point is in, from an atlas; absent if there is no atlas, the head does not surely fit it, or no
    /// gyrus of this side is near.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>))]
    pub gyrus: Option<Gyrus>,
    /// The lobe of that gyrus.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lobe: Option<Lobe>,
    /// The width of the junction of grey and white matter.
    pub junction_width: JunctionWidthView,
    /// The position of the point.
    pub point: ProfileSample,
    /// From the envelope inwards, 0.5 mm apart, along the gradient of the depth. The point is one of them.
    pub samples: Vec<ProfileSample>,
}

/// The width of the junction of grey and white matter at a point: the standard deviation of the error function that
/// best fits the rise of intensity from grey to white.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = JunctionWidth))]
pub struct JunctionWidthView {
    /// `measured`, `under-1-mm` (sharper than these voxels can resolve), `over-6-mm`, or `undefined` if there is no
    /// junction.
    pub verdict: WidthVerdict,
    /// The width, if it was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mm: Option<f32>,
}

/// Whether the width of a junction was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum WidthVerdict {
    /// It was measured.
    #[serde(rename = "measured")]
    Measured,
    /// It is sharper than the voxels can resolve.
    #[serde(rename = "under-1-mm")]
    UnderOneMm,
    /// It is wider than the table.
    #[serde(rename = "over-6-mm")]
    OverSixMm,
    /// There is no junction.
    #[serde(rename = "undefined")]
    Undefined,
}

/// A point of a profile. Undefined values are null.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ProfileSample {
    /// The distance along the profile from the requested point; negative outwards.
    pub distance_mm: f64,
    /// LPS mm.
    pub position_in_patient: [f64; 3],
    /// The depth below the surface; null near a face of the volume that cuts the brain, and where a fence is nearer than the dura.
    pub depth_mm: Option<f32>,
    /// The intensity, interpolated.
    pub intensity: Option<f32>,
    /// The map `blur`.
    pub blur: Option<f32>,
    /// The map `thickness`.
    pub thickness: Option<f32>,
    /// The map `sharpness`, per mm.
    pub sharpness: Option<f32>,
    /// The map `asymmetry`.
    pub asymmetry: Option<f32>,
    /// The map `intensity-asymmetry`.
    pub intensity_asymmetry: Option<f32>,
    /// The map `junction`.
    pub junction: Option<f32>,
    /// The value of each added layer.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub layers: Vec<Option<f32>>,
}

/// The profile below a surface of a case through a point (LPS mm), with the values of its layers and of its maps if there are any,
/// and the names of its gyri. `opposite` is the surface of the mirrored point,
/// [`SurfaceName::mirrored`](case::SurfaceName::mirrored).
///
/// # Errors
/// [`Error::Parameter`] if the point is outside the envelope.
pub fn profile(
    [warm, opposite]: [&WarmModel; 2],
    maps: Result<&LoadedMaps, Undefined>,
    layers: &[SampledLayer],
    gyri: Option<&Gyri>,
    position_in_patient: DVec3,
) -> Result<Profile, Error> {
    let probe = Probe {
        layers,
        model: warm.model(),
        facts: warm.facts(),
        maps: maps.as_ref().ok().copied(),
        gyri,
    };
    let outside = || {
        let detail =
            "is outside the envelope; set the LPS coordinates in mm of a point in the brain";
        Error::out_of_range("position", detail)
    };
    let own = probe.point(position_in_patient).ok_or_else(outside)?;
    let plane = mirror_plane(warm.facts());
    let probe = Probe {
        model: opposite.model(),
        ..probe
    };
    Ok(Profile {
        own,
        mirrored: probe.point(plane.reflected(position_in_patient)),
        maps_undefined: maps.err().map(|reason| reason.sentence.into_owned()),
        layers: layers.iter().map(|layer| layer.about.clone()).collect(),
    })
}

/// What is looked at.
struct Probe<'a> {
    model: &'a DeformableModel,
    facts: &'a CaseFacts,
    maps: Option<&'a LoadedMaps>,
    layers: &'a [SampledLayer],
    gyri: Option<&'a Gyri>,
}

impl Probe<'_> {
    /// `None` outside the envelope.
    fn point(&self, position: DVec3) -> Option<PointProfile> {
        (self.field_depth_mm(position) >= 0.0).then(|| {
            let gyrus = self.gyri.and_then(|gyri| gyri.at(position));
            let point = self.sample(position, 0.0);
            let mut samples = self.way(position, -1.0);
            samples.reverse();
            samples.push(point.clone());
            samples.extend(self.way(position, 1.0));
            PointProfile {
                side: side_at(self.facts, position),
                gyrus,
                lobe: gyrus.map(Gyrus::lobe),
                junction_width: self.width(&point),
                point,
                samples,
            }
        })
    }

    /// The samples from a position on, inwards (1) or outwards (−1), until the envelope, a ridge or the greatest
    /// distance.
    fn way(&self, start: DVec3, sign: f64) -> Vec<ProfileSample> {
        let most_mm = if sign > 0.0 { INWARDS_MM } else { OUTWARDS_MM };
        let mut here = start;
        let mut samples = Vec::new();
        for step in 1..=(most_mm / STEP_MM) as u32 {
            let Some(direction) = self.inward(here) else {
                break;
            };
            // Half a step first, so that the profile follows bends.
            let middle = here + direction * (sign * STEP_MM / 2.0);
            let direction = self.inward(middle).unwrap_or(direction);
            here += direction * (sign * STEP_MM);
            if self.field_depth_mm(here) < 0.0 {
                break;
            }
            samples.push(self.sample(here, sign * STEP_MM * f64::from(step)));
        }
        samples
    }

    /// The direction inwards in the patient.
    fn inward(&self, position: DVec3) -> Option<DVec3> {
        let normals = self.model.normals();
        let gradient = normals.gradient(in_voxels(normals, position));
        (gradient.length() >= LEAST_GRADIENT).then(|| gradient.as_dvec3().normalize())
    }

    fn field_depth_mm(&self, position: DVec3) -> f32 {
        depth_mm(self.model.field(), position)
    }

    fn sample(&self, position: DVec3, distance_mm: f64) -> ProfileSample {
        let value = |name| {
            self.maps
                .and_then(|maps| maps.layer(name).value_at(position))
        };
        let depth_mm = self.field_depth_mm(position);
        let is_known = self.model.field().is_known(position, depth_mm);
        ProfileSample {
            distance_mm,
            position_in_patient: position.to_array(),
            depth_mm: is_known.then_some(depth_mm),
            intensity: self.model.volume().intensity_at(position),
            blur: value(MapName::Blur),
            thickness: value(MapName::Thickness),
            sharpness: value(MapName::Sharpness),
            asymmetry: value(MapName::Asymmetry),
            intensity_asymmetry: value(MapName::IntensityAsymmetry),
            junction: value(MapName::Junction),
            layers: self
                .layers
                .iter()
                .map(|sampled| sampled.value_at(position))
                .collect(),
        }
    }

    fn width(&self, point: &ProfileSample) -> JunctionWidthView {
        let spacing_mm = self.model.volume().grid().spacing_mm();
        let width = point
            .sharpness
            .and_then(|sharpness| width_table(spacing_mm).width(sharpness));
        let (verdict, mm) = match width {
            Some(JunctionWidth::Mm(mm)) => (WidthVerdict::Measured, Some(mm)),
            Some(JunctionWidth::UnderOneMm) => (WidthVerdict::UnderOneMm, None),
            Some(JunctionWidth::OverSixMm) => (WidthVerdict::OverSixMm, None),
            None => (WidthVerdict::Undefined, None),
        };
        JunctionWidthView { verdict, mm }
    }
}

/// The depth at a position, negative outside.
pub fn depth_mm(field: &DepthField, position: DVec3) -> f32 {
    field.depth_mm(in_voxels(field, position))
}

fn in_voxels(field: &DepthField, position: DVec3) -> glam::Vec3 {
    let voxel_from_patient = field.grid().voxel_from_patient();
    voxel_from_patient.transform_point3(position).as_vec3()
}

#[cfg(test)]
mod tests {
    use geometry::{BrainMask, BuiltModel, ClosedBrain, GeometryError, envelope, phantom};

    use super::*;

    /// A synthetic head with voxels of 2 mm, and its facts.
    fn built() -> (BuiltModel, CaseFacts) {
        let head = phantom::head(2.0);
        let brain = BrainMask::from_mask(&head.brain, head.volume.grid()).unwrap();
        let envelope = envelope(&brain, 10.0).unwrap();
        let volume = DeformableModel::crop(&head.volume, &envelope).unwrap();
        let closed = ClosedBrain::Envelope(envelope);
        let built = DeformableModel::build(volume, closed, |_| Ok::<_, GeometryError>(())).unwrap();
        let facts = pipeline::facts(&built, built.model.volume());
        (built, facts)
    }

    fn probe<'a>((built, facts): &'a (BuiltModel, CaseFacts)) -> Probe<'a> {
        Probe {
            model: &built.model,
            facts,
            maps: None,
            layers: &[],
            gyri: None,
        }
    }

    /// A point 15 mm below the envelope, on the left.
    fn place(built: &BuiltModel) -> DVec3 {
        let sphere = built.model.bounds();
        let field = built.model.field();
        let points = (1..100).map(|mm| sphere.centre_in_patient + DVec3::X * f64::from(mm));
        let nearest = |position: &DVec3| (depth_mm(field, *position) - 15.0).abs();
        points
            .min_by(|a, b| nearest(a).total_cmp(&nearest(b)))
            .unwrap()
    }

    #[test]
    fn samples_follow_the_depth_half_a_millimetre_apart() {
        let case = built();
        let place = place(&case.0);
        let profile = probe(&case).point(place).unwrap();
        let first = &profile.samples[0];
        assert!(first.depth_mm.unwrap() < 1.0, "{first:?}");
        assert!(first.distance_mm < -10.0, "{first:?}");
        let at = profile.samples.iter().position(|s| s.distance_mm == 0.0);
        assert_eq!(profile.samples[at.unwrap()], profile.point);
        for pair in profile.samples.windows(2) {
            let [from, to] = [0, 1].map(|n| DVec3::from_array(pair[n].position_in_patient));
            assert!((from.distance(to) - STEP_MM).abs() < 1e-9, "{pair:?}");
            assert!((pair[1].distance_mm - pair[0].distance_mm - STEP_MM).abs() < 1e-9);
            let deeper = pair[1].depth_mm.unwrap() - pair[0].depth_mm.unwrap();
            assert!((0.0..0.75).contains(&deeper), "{pair:?}");
        }
    }

    #[test]
    fn the_mirrored_point_is_as_deep_and_on_the_other_side() {
        let case = built();
        let place = place(&case.0);
        let plane = mirror_plane(&case.1);
        let own = probe(&case).point(place).unwrap();
        let mirrored = probe(&case).point(plane.reflected(place)).unwrap();
        assert_eq!(own.side, PatientSide::Left);
        assert_eq!(mirrored.side, PatientSide::Right);
        let depths = [&own, &mirrored].map(|profile| profile.point.depth_mm.unwrap());
        assert!((depths[0] - depths[1]).abs() < 1.5, "{depths:?}");
    }

    #[test]
    fn there_is_nothing_outside_and_no_width_without_maps() {
        let case = built();
        let outside = case.0.model.bounds().centre_in_patient + DVec3::X * 500.0;
        assert_eq!(probe(&case).point(outside), None);
        let inside = probe(&case).point(place(&case.0)).unwrap();
        assert_eq!(inside.junction_width.verdict, WidthVerdict::Undefined);
        assert_eq!((inside.point.blur, inside.point.junction), (None, None));
        assert!(inside.point.intensity.is_some());
    }
}
