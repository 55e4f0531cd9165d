//! Slices in any direction.

use super::layers::pixels;
use super::server::Server;

/// Whether two pictures are the same but for rounding: coordinates pass through text here.
fn are_alike(one: &[u8], other: &[u8]) -> bool {
    let apart = one.iter().zip(other).filter(|(a, b)| a.abs_diff(**b) > 2);
    one.len() == other.len() && apart.count() * 1000 <= one.len()
}

#[tokio::test]
async fn an_oblique_slice_across_an_axis_is_the_standard_one_and_others_are_not() {
    let (server, case) = Server::with_case().await;
    let sphere = server.get(&case).await.json()["envelope_sphere"]["center_in_patient"].clone();
    let [x, y, z] = [0, 1, 2].map(|axis| sphere[axis].as_f64().unwrap());
    let drawn = async |address: String| {
        let answer = server.get(&format!("{case}/slices/{address}")).await;
        assert_eq!(answer.status, 200, "{address}: {answer:?}");
        pixels(&answer.body)
    };
    let at = format!("position={x},{y},{z}");
    for convention in ["radiological", "neurological"] {
        for (plane, normal, mm) in [
            ("axial", "0,0,-2", z),
            ("coronal", "0,1,0", y),
            ("sagittal", "-1,0,0", x),
        ] {
            let rest = format!("convention={convention}&depth_mm=5&width=128&height=96");
            let oblique = drawn(format!("oblique?{at}&normal={normal}&{rest}")).await;
            let standard = drawn(format!("{plane}?position_mm={mm}&{rest}")).await;
            assert!(are_alike(&oblique, &standard), "{plane}, {convention}");
            assert!(oblique.iter().any(|&value| value > 40));
        }
    }
    // 15 mm to the left of the middle: the plane across the sulcus, and the same plane turned.
    let at = format!("position={},{y},{z}&width=128&height=128", x + 15.0);
    let across = drawn(format!("oblique?{at}")).await;
    let half = drawn(format!("oblique?{at}&turn_deg=180")).await;
    assert!(are_alike(&across, &half));
    let quarter = drawn(format!("oblique?{at}&turn_deg=90")).await;
    assert!(!are_alike(&across, &quarter));
    let named = drawn(format!("oblique?{at}&annotate=true")).await;
    assert_ne!(across, named);
    // The plane of the picture lies as the header says, and turns about the direction that it names.
    let plane_of = async |turn_deg: f64| {
        let at = format!("oblique?position={},{y},{z}&turn_deg={turn_deg}", x + 15.0);
        let answer = server.get(&format!("{case}/slices/{at}")).await;
        let plane: serde_json::Value =
            serde_json::from_str(answer.header("x-isocortex-plane")).unwrap();
        let numbers = |name: &str| -> Vec<f64> {
            let values = plane[name].as_array().unwrap();
            values.iter().map(|value| value.as_f64().unwrap()).collect()
        };
        let orientation = glam::DQuat::from_slice(&numbers("orientation"));
        let about = glam::DVec3::from_slice(&numbers("turned_about"));
        assert!(plane["angles"].as_str().is_some_and(str::is_ascii));
        (orientation.inverse() * glam::DVec3::Z, about)
    };
    let (normal, about) = plane_of(0.0).await;
    assert!(about.x > 0.9 && normal.dot(about).abs() < 1e-6, "{about}");
    let (turned, _) = plane_of(30.0).await;
    let expected = glam::DQuat::from_axis_angle(about, 30f64.to_radians()) * normal;
    assert!(
        turned.dot(expected).abs() > 1.0 - 1e-6,
        "{turned} {expected}"
    );
    let plain = server
        .get(&format!("{case}/slices/axial?width=16&height=16"))
        .await;
    assert!(plain.headers.get("x-isocortex-plane").is_none());
}
