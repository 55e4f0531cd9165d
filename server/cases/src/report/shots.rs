//! The pictures of a report.

use std::sync::Arc;

use ::report::{DEPTHS_MM, FindingPictures, Overview, Shot, Shows, Through};
use case::findings::{Finding, FindingKind};
use case::{CaseFacts, CaseId, MapName};
use glam::{DMat3, DQuat, DVec3};
use pipeline::maps::mirror_plane;
use render::{NamedView, Projection, SlicePlane, edge_letters};

use super::map_of;
use crate::pictures::{
    LayerRef, Numbers, PictureRequest, PictureSeries, SeriesPicture, SliceKind, SlicePicture,
    SliceQuery,
};
use crate::{Cases, Error};

/// The side of a picture of a finding, of a slice and of a picture of the overview, in pixels.
const CUT_SIDE: u32 = 264;
const SLICE_SIDE: u32 = 240;
const OVERVIEW_SIDE: u32 = 120;

/// What a picture of a finding and a slice show, in mm.
const CUT_MM: f64 = 90.0;
const SLICE_MM: f64 = 70.0;

/// Draws all pictures: those of each finding, in their order, and the overview.
pub(super) async fn draw(
    cases: &Cases,
    id: &CaseId,
    facts: &Arc<CaseFacts>,
    findings: &[Finding],
    layer: Option<&LayerRef>,
    has_maps: bool,
) -> Result<(Vec<FindingPictures>, Overview), Error> {
    let shown = |finding: &Finding| {
        let layer = layer.map(|_| Shows::Layer);
        let map = has_maps.then(|| Shows::Map(map_of(finding)));
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
    for finding in findings {
        for shows in shown(finding) {
            requests.extend(cut_and_mirror(facts, finding).map(|cut| with(cut, shows)));
        }
    }
    let of_map = Shows::Map(MapName::Blur);
    for shows in [Shows::Anatomy, of_map] {
        if shows == Shows::Anatomy || has_maps {
            requests.extend(overview().map(|request| with(request, shows)));
        }
    }
    let mut drawn = draw_surfaces(cases, id, requests).await?.into_iter();
    let mut pictures = Vec::with_capacity(findings.len());
    for finding in findings {
        let mut cuts = Vec::new();
        for shows in shown(finding) {
            let mut next = |is_flipped| {
                let (png, projection) = drawn.next().ok_or(Error::Internal)?;
                let shot = marked(facts, finding, png, &projection, shows, is_flipped);
                Ok::<_, Error>(shot)
            };
            cuts.push([next(false)?, next(true)?]);
        }
        let slices = slices(cases, id, facts, finding, layer).await?;
        let view = view_of(facts, finding);
        pictures.push(FindingPictures { view, cuts, slices });
    }
    let mut rows = |shows| -> Vec<Vec<Shot>> {
        let mut row = || -> Vec<Shot> {
            let some = drawn.by_ref().zip(NamedView::ALL);
            some.map(|((png, _), view)| plain(png, OVERVIEW_SIDE, shows, view.orientation()))
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

/// The standard view from which a finding is seen best.
fn view_of(facts: &CaseFacts, finding: &Finding) -> NamedView {
    let centre = DVec3::from_array(facts.envelope_sphere.center_in_patient);
    let outwards = DVec3::from_array(finding.middle_in_patient()) - centre;
    let towards_viewer = |view: &NamedView| view.orientation().inverse() * DVec3::Z;
    let facing = |view: &NamedView| towards_viewer(view).dot(outwards);
    let views = NamedView::ALL.into_iter();
    let best = views.max_by(|a, b| facing(a).total_cmp(&facing(b)));
    best.unwrap_or(NamedView::Left)
}

/// From where a finding is seen, and from where its mirrored place looks like the mirror image of that picture.
fn orientations(facts: &CaseFacts, finding: &Finding) -> [DQuat; 2] {
    let plane = mirror_plane(facts);
    let own = view_of(facts, finding).orientation();
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
fn cut_and_mirror(facts: &CaseFacts, finding: &Finding) -> [PictureRequest; 2] {
    let [own, other] = orientations(facts, finding);
    let at = DVec3::from_array(finding.middle_in_patient());
    let opposite = mirror_plane(facts).reflected(at);
    [(own, at), (other, opposite)].map(|(orientation, at)| {
        let sphere = &facts.envelope_sphere;
        let centre = DVec3::from_array(sphere.center_in_patient);
        let offset = orientation * (at - centre);
        PictureRequest {
            depth_mm: finding.depth_mm as f32,
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

/// The slices through a finding, of the anatomy and of the layer.
async fn slices(
    cases: &Cases,
    id: &CaseId,
    facts: &CaseFacts,
    finding: &Finding,
    layer: Option<&LayerRef>,
) -> Result<Vec<(Through, Vec<Shot>)>, Error> {
    let sphere = &facts.envelope_sphere;
    let at = DVec3::from_array(finding.middle_in_patient());
    let offset = at - DVec3::from_array(sphere.center_in_patient);
    let mut slices = Vec::new();
    let kinds = SlicePlane::ALL.map(SliceKind::Standard);
    for kind in kinds.into_iter().chain([SliceKind::Oblique]) {
        let mut through = Through::Sulcus(String::new());
        let mut shots = Vec::new();
        for layer in std::iter::once(None).chain(layer.cloned().map(Some)) {
            let shows = match layer {
                None => Shows::Anatomy,
                Some(_) => Shows::Layer,
            };
            let place = match kind {
                SliceKind::Standard(plane) => SliceQuery {
                    position_mm: Some(at[plane.axis()]),
                    pan: Some(pan_of(plane, offset)),
                    ..SliceQuery::default()
                },
                SliceKind::Oblique => SliceQuery {
                    position: Some(Numbers(at.to_array())),
                    ..SliceQuery::default()
                },
            };
            let query = SliceQuery {
                width: SLICE_SIDE,
                height: SLICE_SIDE,
                zoom: 2.0 * sphere.radius_mm / SLICE_MM,
                layer,
                ..place
            };
            let picture = SlicePicture::of(cases, id, kind, query.checked()?).await?;
            let drawn = picture.draw(cases).await?;
            let [x, y, _] = drawn
                .projection
                .frame_from_patient()
                .transform_point3(at)
                .to_array();
            let convention = render::SliceConvention::default();
            let orientation = match (kind, drawn.oblique) {
                (SliceKind::Standard(plane), _) => {
                    through = Through::Standard(plane);
                    plane.view(convention).orientation()
                }
                (SliceKind::Oblique, oblique) => {
                    let oblique = oblique.ok_or(Error::Internal)?;
                    through = Through::Sulcus(oblique.angles());
                    oblique.orientation(convention)
                }
            };
            shots.push(Shot {
                mark: Some([x, y]),
                ..plain(drawn.png, SLICE_SIDE, shows, orientation)
            });
        }
        slices.push((through, shots));
    }
    Ok(slices)
}

/// The shift that brings a point into the middle of a slice, given how far it lies from the centre of the head.
fn pan_of(plane: SlicePlane, offset: DVec3) -> Numbers<2> {
    let view = plane.view(render::SliceConvention::default());
    let shown = view.orientation() * offset;
    Numbers([-shown.x, -shown.y])
}

fn plain(png: Vec<u8>, side: u32, shows: Shows, orientation: DQuat) -> Shot {
    Shot {
        directions: edge_letters(orientation),
        png,
        side,
        mark: None,
        outline: Vec::new(),
        is_closed: false,
        is_flipped: false,
        shows,
    }
}

/// A picture of the surface with a finding, or with its mirror image.
fn marked(
    facts: &CaseFacts,
    finding: &Finding,
    png: Vec<u8>,
    projection: &Projection,
    shows: Shows,
    is_flipped: bool,
) -> Shot {
    let plane = mirror_plane(facts);
    let pixel = |point: [f64; 3]| {
        let point = DVec3::from_array(point);
        let point = if is_flipped {
            plane.reflected(point)
        } else {
            point
        };
        let [x, y, _] = projection
            .frame_from_patient()
            .transform_point3(point)
            .to_array();
        [
            if is_flipped {
                f64::from(CUT_SIDE) - x
            } else {
                x
            },
            y,
        ]
    };
    let outline = match finding.kind {
        FindingKind::Point => Vec::new(),
        _ => finding
            .points_in_patient
            .iter()
            .map(|&point| pixel(point))
            .collect(),
    };
    let [own, other] = orientations(facts, finding);
    let plain = plain(png, CUT_SIDE, shows, if is_flipped { other } else { own });
    let [left, right, up, down] = plain.directions;
    Shot {
        mark: Some(pixel(finding.middle_in_patient())),
        outline,
        is_closed: finding.kind == FindingKind::Polygon,
        is_flipped,
        directions: match is_flipped {
            true => [right, left, up, down],
            false => [left, right, up, down],
        },
        ..plain
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

    /// The projections of the picture of a finding and of the other side.
    fn projections(facts: &CaseFacts, finding: &Finding) -> [Projection; 2] {
        let sphere = BoundingSphere {
            centre_in_patient: DVec3::from_array(facts.envelope_sphere.center_in_patient),
            radius_mm: facts.envelope_sphere.radius_mm,
        };
        let size = FrameSize::new(CUT_SIDE, CUT_SIDE).unwrap();
        cut_and_mirror(facts, finding).map(|cut| {
            let checked = cut.checked().unwrap();
            checked.camera().projection(&sphere, size)
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
            let [own, other] = projections(&facts, &finding);
            let shot = |projection, flipped| {
                marked(
                    &facts,
                    &finding,
                    Vec::new(),
                    projection,
                    Shows::Anatomy,
                    flipped,
                )
            };
            let (here, there) = (shot(&own, false), shot(&other, true));
            let [x, y] = here.mark.unwrap();
            assert!((x - 132.0).hypot(y - 132.0) < 1e-6, "{x}, {y}");
            for (one, mirrored) in here.outline.iter().zip(&there.outline) {
                let apart = (one[0] - mirrored[0]).hypot(one[1] - mirrored[1]);
                assert!(apart < 1e-6, "{one:?} {mirrored:?}");
            }
            assert!(there.is_flipped && !here.is_flipped);
        }
    }

    #[test]
    fn the_directions_are_those_of_the_picture_as_it_is_shown() {
        let mut facts = facts();
        facts.midsagittal.normal = [1.0, 0.0, 0.0];
        for (at, expected) in [
            ([60.0, -5.0, 30.0], ["APSI", "APSI"]),
            ([-60.0, -5.0, 30.0], ["PASI", "PASI"]),
            // Seen from above: the other side is on the left of the picture as it is shown, where its letter must be.
            ([10.0, 5.0, 110.0], ["LRAP", "RLAP"]),
        ] {
            let finding = finding(at);
            let [own, other] = projections(&facts, &finding);
            let letters = [(own, false), (other, true)].map(|(projection, is_flipped)| {
                let (png, shows) = (Vec::new(), Shows::Anatomy);
                let shot = marked(&facts, &finding, png, &projection, shows, is_flipped);
                shot.directions.concat()
            });
            assert_eq!(letters, expected, "{at:?}");
        }
    }

    #[test]
    fn a_finding_is_seen_from_its_own_side() {
        let view = |at| view_of(&facts(), &finding(at));
        assert_eq!(view([60.0, -5.0, 30.0]), NamedView::Left);
        assert_eq!(view([-60.0, -5.0, 30.0]), NamedView::Right);
        assert_eq!(view([10.0, 5.0, 110.0]), NamedView::Superior);
        assert_eq!(view([0.0, -90.0, 20.0]), NamedView::Anterior);
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
