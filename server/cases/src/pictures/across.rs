//! The plane across a sulcus.

use geometry::DeformableModel;
use glam::{DQuat, DVec3};
use render::{Layer, Oblique};

/// The distance at which values are compared with those in the middle, in mm: about the half of a gyrus.
const REACH_MM: f64 = 4.0;

/// How many directions are compared, over half a turn.
const DIRECTIONS: u32 = 36;

/// The plane across a sulcus.
#[derive(Debug, Clone, Copy)]
pub(super) struct Across {
    pub(super) plane: Oblique,
    /// The normal of the isosurface, about which the plane is turned, outwards (LPS).
    pub(super) outwards: DVec3,
}

/// The plane through a position that holds the normal of the isosurface there and the direction in which a map changes most,
/// turned about that normal. Without a map, or where it is undefined, the intensities stand for it.
///
/// At a place of a list the map has a maximum, where its gradient is zero. So the change in a direction is that from one side to
/// the other, or that from both sides to the middle, whichever is greater.
pub(super) fn across_the_sulcus(
    model: &DeformableModel,
    map: Option<&Layer>,
    position: DVec3,
    turn_deg: f64,
) -> Across {
    let outwards = outwards(model, position);
    let of_map = |at| map?.value_at(at);
    let volume = model.volume();
    let of_volume = |at| {
        let voxel = volume.grid().voxel_from_patient().transform_point3(at);
        volume.sample(voxel.as_vec3())
    };
    let steepest = steepest(&of_map, position, outwards)
        .or_else(|| steepest(&of_volume, position, outwards))
        .unwrap_or_else(|| outwards.any_orthonormal_vector());
    let turn = DQuat::from_axis_angle(outwards, turn_deg.to_radians());
    let normal = turn * outwards.cross(steepest);
    let plane = Oblique::new(position.clamp_length_max(1e4).to_array(), normal.to_array())
        .expect("the cross product of two orthogonal unit vectors is a direction");
    Across { plane, outwards }
}

/// The direction outwards, across the isosurface; towards superior where it has none.
fn outwards(model: &DeformableModel, position: DVec3) -> DVec3 {
    let normals = model.normals();
    let voxel_from_patient = normals.grid().voxel_from_patient();
    let voxel = voxel_from_patient.transform_point3(position);
    let inwards = normals.gradient(voxel.as_vec3()).as_dvec3();
    (-inwards).try_normalize().unwrap_or(DVec3::Z)
}

/// The direction along the surface in which values change most; `None` if they are undefined or all the same.
fn steepest(
    value: &dyn Fn(DVec3) -> Option<f32>,
    position: DVec3,
    outwards: DVec3,
) -> Option<DVec3> {
    let middle = value(position)?;
    let (x, y) = outwards.any_orthonormal_pair();
    let change = |direction: DVec3| -> Option<f32> {
        let [one, other] = [REACH_MM, -REACH_MM].map(|mm| value(position + direction * mm));
        let (one, other) = (one?, other?);
        let across = (one - other).abs();
        let bend = (one + other - 2.0 * middle).abs();
        Some(across.max(bend))
    };
    let directions = (0..DIRECTIONS).map(|number| {
        let angle = f64::from(number) * std::f64::consts::PI / f64::from(DIRECTIONS);
        x * angle.cos() + y * angle.sin()
    });
    let changes = directions.filter_map(|direction| Some((direction, change(direction)?)));
    let (direction, change) = changes.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (change > 0.0).then_some(direction)
}

#[cfg(test)]
mod tests {
    use geometry::{Grid, phantom};

    use super::*;

    /// A ball whose intensity rises along one direction, in steps of the volume.
    fn model(rises: DVec3) -> DeformableModel {
        let grid = Grid::aligned([61; 3], [1.0; 3], DVec3::splat(-30.0)).unwrap();
        let envelope = phantom::envelope(&grid, |position| position.length() <= 25.0);
        let volume = phantom::volume(grid, |at| (1000.0 + 10.0 * at.dot(rises)) as u16);
        phantom::model(volume, envelope).model
    }

    #[test]
    fn the_plane_holds_the_normal_and_the_steepest_direction() {
        for (at, rises) in [
            (DVec3::new(15.0, 0.0, 0.0), DVec3::Y),
            (
                DVec3::new(15.0, 0.0, 0.0),
                DVec3::new(0.0, 1.0, 2.0).normalize(),
            ),
            (
                DVec3::new(-9.0, -9.0, 9.0),
                DVec3::new(1.0, -1.0, 0.0).normalize(),
            ),
        ] {
            let Across { plane, outwards } = across_the_sulcus(&model(rises), None, at, 0.0);
            assert!(outwards.dot(at.normalize()) > 0.99, "{outwards}");
            assert_eq!(plane.centre_in_patient(), at);
            let normal = plane.normal();
            assert!(normal.dot(at.normalize()).abs() < 0.06, "{normal}");
            let along = rises.reject_from(at).normalize();
            assert!(normal.dot(along).abs() < 0.06, "{normal} {along}");
            // Turned by 90°, it lies across that direction, and still holds the normal of the surface.
            let turned = across_the_sulcus(&model(rises), None, at, 90.0)
                .plane
                .normal();
            assert!(turned.dot(along).abs() > 0.99 && turned.dot(at.normalize()).abs() < 0.06);
        }
    }

    #[test]
    fn without_anything_to_see_there_is_still_a_plane() {
        let middle = across_the_sulcus(&model(DVec3::ZERO), None, DVec3::ZERO, 0.0);
        assert!(middle.plane.normal().is_normalized());
        let outside = across_the_sulcus(&model(DVec3::X), None, DVec3::splat(500.0), 0.0);
        assert!(outside.plane.normal().is_normalized());
    }
}
