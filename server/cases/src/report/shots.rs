//! The pictures of a report.

use std::sync::Arc;

use ::report::{DEPTHS_MM, FindingPictures, Overview, Shot, Shows, Through};
use case::findings::{Finding, FindingKind};
use case::{CaseFacts, CaseId, MapName, SphereFacts, SurfaceName};
use glam::{DMat3, DQuat, DVec3};
use pipeline::maps::mirror_plane;
use render::{NamedView, Projection, SlicePlane, edge_letters};

use super::map_of;
use crate::pictures::{
    LayerRef, Numbers, PictureRequest, PictureSeries, SeriesPicture, SliceKind, SlicePicture,
    SliceQuery,
};
use crate::profile::depth_mm;
use crate::{Cases, Error};

/// The side of a picture of a finding, of a slice and of a picture of the overview, in pixels: two or more to a voxel, so that the HTML of
/// three findings with both sides of two volumes stays below 3 MB.
const CUT_SIDE: u32 = 248;
const SLICE_SIDE: u32 = 160;
const OVERVIEW_SIDE: u32 = 120;

/// What a picture of a finding and a slice show, in mm.
const CUT_MM: f64 = 90.0;
const SLICE_MM: f64 = 70.0;

/// Deeper than this, the cut through the whole brain meets most of the cortex slantwise, in mm: the same as in the page.
const DEEP_MM: f64 = 30.0;

/// Points that lie so near to a slice lie in it, in mm.
const IN_SLICE_MM: f64 = 1.0;

/// Draws all pictures: those of each finding, in their order, and the overview.
pub(super) async fn draw(
    cases: &Cases,
    id: &CaseId,
    facts: &Arc<CaseFacts>,
    findings: &[Finding],
    layer: Option<&LayerRef>,
    maps: &[MapName],
) -> Result<(Vec<FindingPictures>, Overview), Error> {
    let shown = |finding: &Finding| {
        let layer = layer.map(|_| Shows::Layer);
        let map = map_of(finding, maps).map(Shows::Map);
        [Some(Shows::Anatomy), layer, map].into_iter().flatten()
    };
    let with = |request: PictureRequest, shows: Shows| PictureRequest {
        layer: layer.filter(|_| shows == Shows::Layer).cloned(),
        overlay: match shows {
            Shows::Map(map) => Some(map.into()),
            Shows::Anatomy | Shows::Layer => None,
        },
        ..request
    };
    let mut requests = Vec::new();
    let mut all_seen = Vec::with_capacity(findings.len());
    for finding in findings {
        let seen = seen(cases, id, facts, finding).await?;
        for shows in shown(finding) {
            requests.extend(cut_and_mirror(facts, finding, &seen).map(|cut| with(cut, shows)));
        }
        all_seen.push(seen);
    }
    let of_map = Shows::Map(MapName::Blur);
    for shows in [Shows::Anatomy, of_map] {
        if shows == Shows::Anatomy || maps.contains(&MapName::Blur) {
            requests.extend(overview().map(|request| with(request, shows)));
        }
    }
    let mut drawn = draw_surfaces(cases, id, requests).await?.into_iter();
    let mut pictures = Vec::with_capacity(findings.len());
    for (finding, seen) in findings.iter().zip(all_seen) {
        let mut cuts = Vec::new();
        for shows in shown(finding) {
            let mut next = |is_flipped| {
                let (png, projection) = drawn.next().ok_or(Error::Internal)?;
                let marked = Marked {
                    facts,
                    finding,
                    seen: &seen,
                    is_flipped,
                };
                Ok::<_, Error>(marked.shot(png, &projection, shows))
            };
            cuts.push([next(false)?, next(true)?]);
        }
        let slices = slices(cases, id, facts, finding, layer).await?;
        pictures.push(FindingPictures {
            depth_mm: seen.depth_mm,
            surface: seen.surface,
            cuts,
            slices,
        });
    }
    let mut rows = |shows| -> Vec<Vec<Shot>> {
        let mut row = || -> Vec<Shot> {
            let some = drawn.by_ref().zip(NamedView::ALL);
            some.map(|((png, projection), view)| plain(png, &projection, shows, view.orientation()))
                .collect()
        };
        let rows: Vec<_> = DEPTHS_MM.iter().map(|_| row()).collect();
        rows.into_iter().filter(|row| !row.is_empty()).collect()
    };
    let overview = Overview {
        anatomy: rows(Shows::Anatomy),
        map: rows(of_map),
    };
    Ok((pictures, overview))
}

/// The findings and the overview without pictures.
pub(super) fn none(findings: &[Finding]) -> (Vec<FindingPictures>, Overview) {
    let without = |finding: &Finding| FindingPictures {
        surface: SurfaceName::Whole,
        depth_mm: finding.depth_mm as f32,
        cuts: Vec::new(),
        slices: Vec::new(),
    };
    let overview = Overview {
        anatomy: Vec::new(),
        map: Vec::new(),
    };
    (findings.iter().map(without).collect(), overview)
}

/// How the cut of a finding is seen: as the page shows it to whoever goes to it.
struct Seen {
    /// The half on whose inner side it is, the other half being away; else the whole.
    surface: SurfaceName,
    depth_mm: f32,
    /// From where it faces the viewer.
    orientation: DQuat,
    /// The spheres around that surface and the mirrored one.
    spheres: [SphereFacts; 2],
}

/// How a finding is seen.
///
/// # Errors
/// As [`Cases::surface`], but for a case without the surfaces of halves.
async fn seen(
    cases: &Cases,
    id: &CaseId,
    facts: &CaseFacts,
    finding: &Finding,
) -> Result<Seen, Error> {
    let at = DVec3::from_array(finding.middle_in_patient());
    let outside = outside(facts, finding);
    let surface = surface_of(facts, finding);
    let leftwards = mirror_plane(facts).normal();
    let outwards = match surface {
        SurfaceName::Left => -leftwards,
        SurfaceName::Right => leftwards,
        SurfaceName::Whole | SurfaceName::Cerebrum => return Ok(outside),
    };
    let model = match cases.surface(id, surface).await {
        Err(Error::NoSurfaces(_)) => return Ok(outside),
        model => model?,
    };
    let depth_mm = depth_mm(model.model().field(), at);
    if depth_mm < 0.0 {
        return Ok(outside);
    }
    let opposite = cases.surface(id, surface.mirrored()).await?;
    Ok(Seen {
        surface,
        depth_mm,
        orientation: facing(outwards),
        spheres: [&model, &opposite].map(|half| half.facts().envelope_sphere),
    })
}

/// A finding as it is seen from outside of the whole brain.
fn outside(facts: &CaseFacts, finding: &Finding) -> Seen {
    let at = DVec3::from_array(finding.middle_in_patient());
    let centre = DVec3::from_array(facts.envelope_sphere.center_in_patient);
    Seen {
        surface: SurfaceName::Whole,
        depth_mm: finding.depth_mm as f32,
        orientation: facing(at - centre),
        spheres: [facts.envelope_sphere; 2],
    }
}

/// The half on whose inner side a finding is seen, because it is by far nearer to the plane between the halves than to the dura outside, or
/// nearer at all if it is too deep for the whole brain; else the whole.
fn surface_of(facts: &CaseFacts, finding: &Finding) -> SurfaceName {
    let plane = mirror_plane(facts);
    let at = DVec3::from_array(finding.middle_in_patient());
    let left_mm = plane.left_mm(at);
    let reach_mm = match finding.depth_mm {
        deep if deep > DEEP_MM => deep,
        depth_mm => depth_mm / 2.0,
    };
    match left_mm {
        _ if facts.midsagittal.doubtful || left_mm.abs() >= reach_mm => SurfaceName::Whole,
        0.0.. => SurfaceName::Left,
        _ => SurfaceName::Right,
    }
}

/// The orientation that brings a direction of the patient to the viewer, with the top of the head up; of the top itself, the front.
fn facing(outwards: DVec3) -> DQuat {
    let towards = outwards.try_normalize().unwrap_or(DVec3::X);
    let upright = match towards.z.abs() < 0.95 {
        true => DVec3::Z,
        false => DVec3::NEG_Y,
    };
    let right = upright.cross(towards).normalize();
    DQuat::from_mat3(&DMat3::from_cols(right, towards.cross(right), towards).transpose())
}

/// From where a finding is seen, and from where its mirrored place looks like the mirror image of that picture.
fn orientations(facts: &CaseFacts, own: DQuat) -> [DQuat; 2] {
    let plane = mirror_plane(facts);
    // Rows of the rotation into view space are its axes in the patient: right, up, towards the viewer.
    let axes = DMat3::from_quat(own).transpose();
    let mirrored = |axis: DVec3| plane.reflected(axis) - plane.reflected(DVec3::ZERO);
    let flipped = DMat3::from_cols(
        -mirrored(axes.x_axis),
        mirrored(axes.y_axis),
        mirrored(axes.z_axis),
    );
    [own, DQuat::from_mat3(&flipped.transpose())]
}

/// A finding on the surface at its depth, and the mirrored place as the mirror image of that picture, which is flipped when it is
/// shown.
fn cut_and_mirror(facts: &CaseFacts, finding: &Finding, seen: &Seen) -> [PictureRequest; 2] {
    let [own, other] = orientations(facts, seen.orientation);
    let at = DVec3::from_array(finding.middle_in_patient());
    let opposite = mirror_plane(facts).reflected(at);
    let [sphere, mirrored] = &seen.spheres;
    let cuts = [
        (own, at, seen.surface, sphere),
        (other, opposite, seen.surface.mirrored(), mirrored),
    ];
    cuts.map(|(orientation, at, surface, sphere)| {
        let centre = DVec3::from_array(sphere.center_in_patient);
        let offset = orientation * (at - centre);
        PictureRequest {
            depth_mm: seen.depth_mm,
            surface,
            orientation: Some(Numbers(orientation.to_array())),
            width: CUT_SIDE,
            height: CUT_SIDE,
            zoom: 2.0 * sphere.radius_mm / CUT_MM,
            pan: Some(Numbers([-offset.x, -offset.y])),
            ..PictureRequest::default()
        }
    })
}

fn overview() -> impl Iterator<Item = PictureRequest> {
    DEPTHS_MM.into_iter().flat_map(|depth_mm| {
        NamedView::ALL.into_iter().map(move |view| PictureRequest {
            depth_mm,
            view: Some(view),
            width: OVERVIEW_SIDE,
            height: OVERVIEW_SIDE,
            ..PictureRequest::default()
        })
    })
}

async fn draw_surfaces(
    cases: &Cases,
    id: &CaseId,
    requests: Vec<PictureRequest>,
) -> Result<Vec<(Vec<u8>, Projection)>, Error> {
    let checked = requests.iter().map(PictureRequest::checked);
    let checked: Vec<_> = checked.collect::<Result<_, _>>()?;
    let series = PictureSeries::of(cases, id, checked).await?;
    let add = |drawn: &mut Vec<_>, picture: SeriesPicture| {
        let projection = *picture.metadata.projection();
        drawn.push((picture.encoded()?.png, projection));
        Ok(())
    };
    series.draw_each(cases, Vec::new(), add).await
}

/// The slices through a finding, and beside each the one through the mirrored place, which is flipped where it would not be the mirror
/// image: of the anatomy and of the layer.
async fn slices(
    cases: &Cases,
    id: &CaseId,
    facts: &CaseFacts,
    finding: &Finding,
    layer: Option<&LayerRef>,
) -> Result<Vec<[(Through, Vec<Shot>); 2]>, Error> {
    let plane = mirror_plane(facts);
    let at = DVec3::from_array(finding.middle_in_patient());
    let mut slices = Vec::new();
    let kinds = SlicePlane::ALL.map(SliceKind::Standard);
    for kind in kinds.into_iter().chain([SliceKind::Oblique]) {
        let mut through = Slice {
            facts,
            kind,
            at,
            normal: None,
        };
        let own = through.drawn(cases, id, layer).await?;
        // Rows of a rotation into view space are its axes in the patient: right, up, towards the viewer.
        let axes = DMat3::from_quat(own.orientation).transpose();
        let reflected = |axis: DVec3| plane.reflected(axis) - plane.reflected(DVec3::ZERO);
        through.at = plane.reflected(at);
        through.normal = (kind == SliceKind::Oblique).then(|| reflected(axes.z_axis));
        let other = through.drawn(cases, id, layer).await?;
        let right = DMat3::from_quat(other.orientation).transpose().x_axis;
        let is_turned = reflected(axes.x_axis).dot(right) < 0.0;
        let outlined = |shot: Shot, projection: &Projection| Shot {
            outline: match kind {
                SliceKind::Standard(plane) if lies_in(finding, plane) => {
                    let points = finding.points_in_patient.iter();
                    points
                        .map(|&point| pixel(projection, DVec3::from_array(point)))
                        .collect()
                }
                _ => Vec::new(),
            },
            is_closed: finding.kind == FindingKind::Polygon,
            ..shot
        };
        let own_shots = own.shots.into_iter();
        let own_shots = own_shots.map(|(shot, projection)| outlined(shot, &projection));
        let other_shots = other.shots.into_iter().map(|(shot, _)| match is_turned {
            true => flipped(shot),
            false => shot,
        });
        slices.push([
            (own.through, own_shots.collect()),
            (other.through, other_shots.collect()),
        ]);
    }
    Ok(slices)
}

/// A slice through a place.
struct Slice<'a> {
    facts: &'a CaseFacts,
    kind: SliceKind,
    at: DVec3,
    /// The direction across it, if it is oblique; by default it goes across the sulcus.
    normal: Option<DVec3>,
}

/// Pictures of a slice, of the anatomy and of the layer.
struct DrawnShots {
    through: Through,
    orientation: DQuat,
    shots: Vec<(Shot, Projection)>,
}

impl Slice<'_> {
    async fn drawn(
        &self,
        cases: &Cases,
        id: &CaseId,
        layer: Option<&LayerRef>,
    ) -> Result<DrawnShots, Error> {
        let (at, sphere) = (self.at, &self.facts.envelope_sphere);
        let place = match self.kind {
            SliceKind::Standard(plane) => SliceQuery {
                position_mm: Some(at[plane.axis()]),
                pan: Some(pan_of(
                    plane,
                    at - DVec3::from_array(sphere.center_in_patient),
                )),
                ..SliceQuery::default()
            },
            SliceKind::Oblique => SliceQuery {
                position: Some(Numbers(at.to_array())),
                normal: self.normal.map(|normal| Numbers(normal.to_array())),
                ..SliceQuery::default()
            },
        };
        let convention = render::SliceConvention::default();
        let mut shots = Vec::new();
        let mut seen = None;
        for layer in std::iter::once(None).chain(layer.cloned().map(Some)) {
            let shows = match layer {
                None => Shows::Anatomy,
                Some(_) => Shows::Layer,
            };
            let query = SliceQuery {
                width: SLICE_SIDE,
                height: SLICE_SIDE,
                zoom: 2.0 * sphere.radius_mm / SLICE_MM,
                layer,
                ..place.clone()
            };
            let picture = SlicePicture::of(cases, id, self.kind, query.checked()?).await?;
            let drawn = picture.draw(cases).await?;
            let (through, orientation) = match (self.kind, drawn.oblique) {
                (SliceKind::Standard(plane), _) => (
                    Through::Standard(plane, at[plane.axis()]),
                    plane.view(convention).orientation(),
                ),
                (SliceKind::Oblique, oblique) => {
                    let oblique = oblique.ok_or(Error::Internal)?;
                    let through = Through::Sulcus {
                        angles: oblique.angles(),
                        position: at.to_array(),
                    };
                    (through, oblique.orientation(convention))
                }
            };
            let shot = Shot {
                mark: Some(pixel(&drawn.projection, at)),
                ..plain(drawn.png, &drawn.projection, shows, orientation)
            };
            shots.push((shot, drawn.projection));
            seen = Some((through, orientation));
        }
        let (through, orientation) = seen.ok_or(Error::Internal)?;
        Ok(DrawnShots {
            through,
            orientation,
            shots,
        })
    }
}

/// The shift that brings a point into the middle of a slice, given how far it lies from the centre of the head.
fn pan_of(plane: SlicePlane, offset: DVec3) -> Numbers<2> {
    let view = plane.view(render::SliceConvention::default());
    let shown = view.orientation() * offset;
    Numbers([-shown.x, -shown.y])
}

/// Whether something longer than a point was marked in a slice.
fn lies_in(finding: &Finding, plane: SlicePlane) -> bool {
    let middle = finding.middle_in_patient()[plane.axis()];
    let mut points = finding.points_in_patient.iter();
    finding.kind != FindingKind::Point
        && points.all(|point| (point[plane.axis()] - middle).abs() <= IN_SLICE_MM)
}

/// Where a point is in a picture, in pixels from its top left.
fn pixel(projection: &Projection, point: DVec3) -> [f64; 2] {
    let [x, y, _] = projection
        .frame_from_patient()
        .transform_point3(point)
        .to_array();
    [x, y]
}

fn plain(png: Vec<u8>, projection: &Projection, shows: Shows, orientation: DQuat) -> Shot {
    Shot {
        directions: edge_letters(orientation),
        png,
        side: projection.size().width(),
        pixels_per_mm: projection.mm_per_pixel().recip(),
        mark: None,
        outline: Vec::new(),
        is_closed: false,
        is_flipped: false,
        shows,
    }
}

/// A picture without outlines, to be shown flipped.
fn flipped(shot: Shot) -> Shot {
    let [left, right, up, down] = shot.directions;
    Shot {
        mark: shot.mark.map(|[x, y]| [f64::from(shot.side) - x, y]),
        is_flipped: true,
        directions: [right, left, up, down],
        ..shot
    }
}

/// A finding on a surface, or its mirrored place.
struct Marked<'a> {
    facts: &'a CaseFacts,
    finding: &'a Finding,
    seen: &'a Seen,
    is_flipped: bool,
}

impl Marked<'_> {
    /// Its picture. What was marked is outlined on its own side alone, and not if it was marked in a slice.
    fn shot(&self, png: Vec<u8>, projection: &Projection, shows: Shows) -> Shot {
        let finding = self.finding;
        let [own, other] = orientations(self.facts, self.seen.orientation);
        let middle = DVec3::from_array(finding.middle_in_patient());
        if self.is_flipped {
            let opposite = mirror_plane(self.facts).reflected(middle);
            return flipped(Shot {
                mark: Some(pixel(projection, opposite)),
                ..plain(png, projection, shows, other)
            });
        }
        let is_on_surface = finding.kind != FindingKind::Point
            && (finding.kind == FindingKind::Trajectory
                || !SlicePlane::ALL.iter().any(|&plane| lies_in(finding, plane)));
        let points = finding.points_in_patient.iter().filter(|_| is_on_surface);
        let points = points.map(|&point| pixel(projection, DVec3::from_array(point)));
        Shot {
            mark: Some(pixel(projection, middle)),
            outline: points.collect(),
            is_closed: finding.kind == FindingKind::Polygon,
            ..plain(png, projection, shows, own)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::BoundingSphere;
    use render::FrameSize;

    fn finding(at: [f64; 3]) -> Finding {
        serde_json::from_value(serde_json::json!({
            "id": "a", "kind": "line", "points_in_patient": [at, [at[0] - 4.0, at[1] + 6.0, at[2] + 5.0]], "depth_mm": 5.0,
        }))
        .unwrap()
    }

    fn shot(facts: &CaseFacts, finding: &Finding, on: &Projection, is_flipped: bool) -> Shot {
        let marked = Marked {
            facts,
            finding,
            seen: &outside(facts, finding),
            is_flipped,
        };
        marked.shot(Vec::new(), on, Shows::Anatomy)
    }

    /// The projections of the picture of a finding and of the other side.
    fn projections(facts: &CaseFacts, finding: &Finding, seen: &Seen) -> [Projection; 2] {
        let size = FrameSize::new(CUT_SIDE, CUT_SIDE).unwrap();
        let [own, other] = cut_and_mirror(facts, finding, seen);
        let [sphere, mirrored] = seen.spheres;
        [(own, sphere), (other, mirrored)].map(|(cut, sphere)| {
            let sphere = BoundingSphere {
                centre_in_patient: DVec3::from_array(sphere.center_in_patient),
                radius_mm: sphere.radius_mm,
            };
            cut.checked().unwrap().camera().projection(&sphere, size)
        })
    }

    /// A head whose middle is neither at 0 nor upright.
    fn facts() -> CaseFacts {
        let mut facts = storage::testing::facts();
        facts.envelope_sphere.center_in_patient = [3.0, -10.0, 20.0];
        facts.envelope_sphere.radius_mm = 100.0;
        facts.midsagittal.normal = DVec3::new(1.0, 0.1, -0.05).normalize().to_array();
        facts.midsagittal.offset_mm = 4.0;
        facts
    }

    #[test]
    fn both_sides_are_shown_at_the_same_pixels_and_the_other_flipped() {
        let facts = facts();
        for at in [[60.0, -5.0, 30.0], [-55.0, 20.0, 35.0], [10.0, 5.0, 110.0]] {
            let finding = finding(at);
            let [own, other] = projections(&facts, &finding, &outside(&facts, &finding));
            let (here, there) = (
                shot(&facts, &finding, &own, false),
                shot(&facts, &finding, &other, true),
            );
            let middle = f64::from(CUT_SIDE) / 2.0;
            for shot in [&here, &there] {
                let [x, y] = shot.mark.unwrap();
                assert!((x - middle).hypot(y - middle) < 1e-6, "{x}, {y}");
                assert!((shot.pixels_per_mm - f64::from(CUT_SIDE) / CUT_MM).abs() < 1e-9);
            }
            assert!(there.is_flipped && !here.is_flipped);
            // Nothing was measured on the other side.
            assert_eq!([here.outline.len(), there.outline.len()], [2, 0]);
        }
    }

    #[test]
    fn a_finding_on_an_inner_side_is_in_the_middle_though_each_half_has_its_own_sphere() {
        let (facts, finding) = (facts(), finding([8.0, -5.0, 30.0]));
        let mut seen = outside(&facts, &finding);
        seen.surface = SurfaceName::Left;
        let [sphere, mirrored] = &mut seen.spheres;
        (sphere.center_in_patient, sphere.radius_mm) = ([30.0, -4.0, 25.0], 80.0);
        (mirrored.center_in_patient, mirrored.radius_mm) = ([-28.0, -6.0, 22.0], 82.0);
        let [own, other] = projections(&facts, &finding, &seen);
        for (projection, is_flipped) in [(&own, false), (&other, true)] {
            let shot = shot(&facts, &finding, projection, is_flipped);
            let middle = f64::from(CUT_SIDE) / 2.0;
            let [x, y] = shot.mark.unwrap();
            assert!((x - middle).hypot(y - middle) < 1e-6, "{x}, {y}");
            assert!((shot.pixels_per_mm - f64::from(CUT_SIDE) / CUT_MM).abs() < 1e-9);
        }
    }

    #[test]
    fn a_line_is_drawn_in_the_slice_that_it_was_set_in_and_on_no_surface() {
        let facts = facts();
        let mut finding = finding([60.0, -5.0, 30.0]);
        assert!(
            !SlicePlane::ALL
                .iter()
                .any(|&plane| lies_in(&finding, plane))
        );
        finding.points_in_patient[1][2] = 30.5;
        let lies = SlicePlane::ALL.map(|plane| lies_in(&finding, plane));
        assert_eq!(
            lies,
            SlicePlane::ALL.map(|plane| plane == SlicePlane::Axial)
        );
        let [own, _] = projections(&facts, &finding, &outside(&facts, &finding));
        assert_eq!(shot(&facts, &finding, &own, false).outline, [[0.0; 2]; 0]);
        finding.kind = FindingKind::Trajectory;
        assert_eq!(shot(&facts, &finding, &own, false).outline.len(), 2);
    }

    #[test]
    fn the_directions_are_those_of_the_picture_as_it_is_shown() {
        let mut facts = facts();
        facts.midsagittal.normal = [1.0, 0.0, 0.0];
        facts.envelope_sphere.center_in_patient = [0.0, -3.0, 35.0];
        for (at, expected) in [
            ([60.0, -5.0, 30.0], ["APSI", "APSI"]),
            ([-60.0, -5.0, 30.0], ["PASI", "PASI"]),
            // Seen from above: the other side is on the left of the picture as it is shown, where its letter must be.
            ([2.0, -5.0, 110.0], ["LRAP", "RLAP"]),
        ] {
            let finding = finding(at);
            let [own, other] = projections(&facts, &finding, &outside(&facts, &finding));
            let letters = [(own, false), (other, true)].map(|(projection, is_flipped)| {
                let letters = shot(&facts, &finding, &projection, is_flipped).directions;
                letters.concat()
            });
            assert_eq!(letters, expected, "{at:?}");
        }
    }

    #[test]
    fn a_finding_faces_the_viewer_and_the_head_is_upright() {
        for outwards in [[1.0, 0.2, 0.3], [-0.4, -0.8, 0.1], [0.05, 0.1, 2.0]] {
            let outwards = DVec3::from_array(outwards).normalize();
            let orientation = facing(outwards);
            assert!((orientation * outwards).distance(DVec3::Z) < 1e-9);
            let up = orientation.inverse() * DVec3::Y;
            assert!(
                up.dot(DVec3::Z) > 0.0 && (up.z > 0.3 || up.y < -0.9),
                "{up}"
            );
        }
    }

    #[test]
    fn what_is_near_the_plane_between_the_halves_is_seen_on_its_inner_side() {
        let mut facts = facts();
        (facts.midsagittal.normal, facts.midsagittal.offset_mm) = ([1.0, 0.0, 0.0], 4.0);
        for (x, depth_mm, half) in [
            (12.0, 20.0, SurfaceName::Left),
            (-4.0, 20.0, SurfaceName::Right),
            (16.0, 20.0, SurfaceName::Whole),
            (30.0, 31.0, SurfaceName::Left),
            (12.0, 8.0, SurfaceName::Whole),
        ] {
            let mut finding = finding([x, 5.0, 30.0]);
            (finding.kind, finding.depth_mm) = (FindingKind::Point, depth_mm);
            finding.points_in_patient.truncate(1);
            assert_eq!(surface_of(&facts, &finding), half, "{x} {depth_mm}");
            facts.midsagittal.doubtful = true;
            assert_eq!(surface_of(&facts, &finding), SurfaceName::Whole);
            facts.midsagittal.doubtful = false;
        }
    }

    #[test]
    fn a_slice_is_centred_on_its_finding() {
        let facts = facts();
        let sphere = BoundingSphere {
            centre_in_patient: DVec3::from_array(facts.envelope_sphere.center_in_patient),
            radius_mm: facts.envelope_sphere.radius_mm,
        };
        let at = DVec3::new(40.0, -30.0, 50.0);
        for plane in SlicePlane::ALL {
            let query = SliceQuery {
                position_mm: Some(at[plane.axis()]),
                pan: Some(pan_of(plane, at - sphere.centre_in_patient)),
                ..SliceQuery::default()
            };
            let view = plane.view(render::SliceConvention::default());
            let Numbers(pan) = query.pan.unwrap();
            let camera = render::Camera::named(view).with_pan_mm(pan).unwrap();
            let projection = camera.projection(&sphere, FrameSize::new(512, 512).unwrap());
            let [x, y, _] = projection
                .frame_from_patient()
                .transform_point3(at)
                .to_array();
            assert!((x - 256.0).hypot(y - 256.0) < 1e-6, "{plane:?} {x} {y}");
        }
    }
}
