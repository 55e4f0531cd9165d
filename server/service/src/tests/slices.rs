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
}
