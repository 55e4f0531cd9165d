//! Findings as a closed mesh: for planning and printing.

use std::f64::consts::{FRAC_PI_2, TAU};

use case::findings::Finding;
use geometry::Solid;
use glam::DVec3;

use crate::findings::{BRUSH_RADIUS_MM, lines_between, points_of};

/// How finely tubes are made.
#[derive(Clone, Copy)]
struct Detail {
    /// The sides of a tube.
    sides: u32,
    /// The rings of a round end, without its pole.
    rings: i32,
}

/// A tube has 144 triangles.
const FINE: Detail = Detail {
    sides: 12,
    rings: 3,
};

/// A tube has 24 triangles, and pointed ends.
const COARSE: Detail = Detail { sides: 6, rings: 1 };

/// The most tubes that are fine. More, as of regions that a program has found, would make a file that is too large to be read.
const MAX_FINE_TUBES: usize = 3_000;

/// Findings as balls around points and tubes along the lines between them, of the radius [`BRUSH_RADIUS_MM`].
///
/// A tube has round ends, so that those of a line meet without a gap. A polygon is its outline. Each ball and each tube is closed;
/// where several meet, they overlap. More than 3,000 balls and tubes are coarser: they have six sides and pointed ends.
pub fn solid_of<'a>(findings: impl IntoIterator<Item = &'a Finding>) -> Solid {
    let mut tubes = Vec::new();
    for finding in findings {
        let points = points_of(finding);
        if let [point] = points[..] {
            tubes.push((point, point));
        }
        tubes.extend(lines_between(finding.kind, &points));
    }
    let detail = if tubes.len() > MAX_FINE_TUBES {
        COARSE
    } else {
        FINE
    };
    let mut solid = Solid::default();
    for (from, to) in tubes {
        add_tube(&mut solid, detail, from, to);
    }
    solid
}

/// Adds a tube with round ends; between equal points, a ball.
fn add_tube(
    solid: &mut Solid,
    Detail {
        sides,
        rings: round,
    }: Detail,
    from: DVec3,
    to: DVec3,
) {
    let axis = (to - from).try_normalize().unwrap_or(DVec3::Z);
    let x = axis.any_orthonormal_vector();
    let y = axis.cross(x);
    let at = |centre: DVec3, latitude: f64, angle: f64| {
        let outward = (x * angle.cos() + y * angle.sin()) * latitude.cos() + axis * latitude.sin();
        (centre + BRUSH_RADIUS_MM * outward).as_vec3().to_array()
    };
    let latitude = |ring: i32| f64::from(ring) * FRAC_PI_2 / f64::from(round);
    let around_start = (1 - round..=0).map(|ring| (from, latitude(ring)));
    let around_end = (0..round).map(|ring| (to, latitude(ring)));
    let mut rings: Vec<_> = around_start.chain(around_end).collect();
    // A ball has one equator.
    rings.dedup();

    let first = solid.positions_in_patient.len() as u32;
    let positions = &mut solid.positions_in_patient;
    positions.push(at(from, -FRAC_PI_2, 0.0));
    for &(centre, latitude) in &rings {
        let angles = (0..sides).map(|side| f64::from(side) * TAU / f64::from(sides));
        positions.extend(angles.map(|angle| at(centre, latitude, angle)));
    }
    let last = positions.len() as u32;
    positions.push(at(to, FRAC_PI_2, 0.0));

    let vertex = |ring: u32, side: u32| first + 1 + ring * sides + side % sides;
    let highest = rings.len() as u32 - 1;
    for side in 0..sides {
        let next = side + 1;
        let triangles = &mut solid.triangles;
        triangles.push([first, vertex(0, next), vertex(0, side)]);
        for ring in 0..highest {
            let (low, high) = (vertex(ring, side), vertex(ring + 1, next));
            triangles.push([low, vertex(ring, next), high]);
            triangles.push([low, high, vertex(ring + 1, side)]);
        }
        triangles.push([vertex(highest, side), vertex(highest, next), last]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;
    use std::f64::consts::PI;

    fn finding(kind: &str, points: &[[f64; 3]]) -> Finding {
        let json = serde_json::json!({
            "id": "a", "kind": kind, "points_in_patient": points, "depth_mm": 5.0,
        });
        serde_json::from_value(json).unwrap()
    }

    /// The volume within a closed mesh; negative if its triangles are seen from inside.
    fn volume_mm3(solid: &Solid) -> f64 {
        let corner = |vertex: u32| {
            glam::Vec3::from_array(solid.positions_in_patient[vertex as usize]).as_dvec3()
        };
        let of = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(corner);
            a.dot(b.cross(c)) / 6.0
        };
        solid.triangles.iter().map(of).sum()
    }

    #[test]
    fn balls_and_tubes_are_closed_and_of_the_volume_of_their_radius() {
        let r = BRUSH_RADIUS_MM;
        let ball_mm3 = 4.0 / 3.0 * PI * r.powi(3);
        let tube_mm3 = |length_mm: f64| PI * r.powi(2) * length_mm;
        let place = [-31.5, 12.0, 44.0];
        for (one, expected_mm3) in [
            (finding("point", &[place]), ball_mm3),
            (
                finding("trajectory", &[place, [-31.5, 52.0, 74.0]]),
                ball_mm3 + tube_mm3(50.0),
            ),
            // Two points may be the same.
            (finding("line", &[place, place]), ball_mm3),
            // A triangle of 3, 4 and 5 cm has three tubes, which overlap in its corners.
            (
                finding("polygon", &[[0.0; 3], [30.0, 0.0, 0.0], [0.0, 40.0, 0.0]]),
                3.0 * ball_mm3 + tube_mm3(120.0),
            ),
        ] {
            let solid = solid_of([&one]);
            let ratio = volume_mm3(&solid) / expected_mm3;
            assert!((0.85..=1.0).contains(&ratio), "{ratio}");
            assert_closed(&solid);
        }
    }

    /// Asserts that each edge has one triangle on either side.
    fn assert_closed(solid: &Solid) {
        let edges = solid
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        let edges: Vec<_> = edges.collect();
        let once: HashSet<_> = edges.iter().copied().collect();
        assert_eq!(once.len(), edges.len());
        assert!(edges.iter().all(|&(a, b)| a != b && once.contains(&(b, a))));
    }

    #[test]
    fn as_many_points_as_a_case_may_have_are_a_file_of_25_mb_at_most() {
        let along = |count: u32| -> Vec<_> {
            let mm = (0..count).map(|at| f64::from(at) * 0.005);
            mm.map(|mm| [mm, 0.0, 0.0]).collect()
        };
        let most = solid_of([&finding("line", &along(20_000))]);
        assert!(most.triangles.len() * 50 < 25_000_000);
        assert_closed(&most);
        assert!(volume_mm3(&most) > 0.0);
        let fine = solid_of([&finding("line", &along(3_001))]);
        assert_eq!(fine.triangles.len(), 3_000 * 144);
        let points = vec![finding("point", &[[0.0; 3]]); 3_001];
        let coarse = solid_of(&points);
        assert_eq!(coarse.triangles.len(), 3_001 * 12);
        assert_closed(&coarse);
    }

    #[test]
    fn each_finding_is_where_it_was_marked() {
        let point = finding("point", &[[40.0, 0.0, 0.0]]);
        let line = finding("line", &[[-40.0, 0.0, 0.0], [-40.0, 20.0, 0.0]]);
        let solid = solid_of([&point, &line]);
        for position in &solid.positions_in_patient {
            let position = glam::Vec3::from_array(*position).as_dvec3();
            let nearest = match position.x > 0.0 {
                true => DVec3::new(40.0, 0.0, 0.0),
                false => DVec3::new(-40.0, position.y.clamp(0.0, 20.0), 0.0),
            };
            assert!((position.distance(nearest) - BRUSH_RADIUS_MM).abs() < 1e-4);
        }
        assert_eq!(solid_of([]), Solid::default());
    }
}
