//! Two cases registered to each other over HTTP.

use std::time::Duration;

use cases::jobs::start_workers;
use geometry::Grid;
use glam::{DAffine3, DVec3};
use imaging::nifti::write_numbers;
use pipeline::testing::phantom;
use serde_json::Value;

use super::server::Server;

/// Uploads the coarse head with its mask, moved in the patient; the id of its case, which is ready.
async fn moved(server: &Server, patient: DAffine3) -> String {
    let head = phantom();
    let grid = head.volume.grid();
    let grid = Grid::new(grid.size(), patient * grid.patient_from_voxel()).unwrap();
    let intensity = |&stored: &u16| head.volume.intensity(stored.into());
    let volume: Vec<f32> = head.volume.voxels().iter().map(intensity).collect();
    let mask = head.brain.voxels().iter();
    let mask: Vec<f32> = mask.map(|&inside| f32::from(u8::from(inside))).collect();
    let [volume, mask] = [volume, mask].map(|numbers| write_numbers(&grid, &numbers).unwrap());
    let answer = server.upload(&[("volume", &volume), ("mask", &mask)]).await;
    assert_eq!(answer.status, 202, "{answer:?}");
    let case = answer.header("location").to_owned();
    assert_eq!(server.settled(&case).await, "ready");
    id_of(&case)
}

fn id_of(case: &str) -> String {
    case.rsplit('/').next().unwrap().to_owned()
}

fn shift_mm(registration: &Value) -> f64 {
    registration["case_from_other"][0][3].as_f64().unwrap()
}

#[tokio::test]
async fn a_case_is_registered_to_another_one() {
    let (server, case) = Server::with_case().await;
    let workers = start_workers(server.cases.library.clone(), 1);
    let later = moved(&server, DAffine3::from_translation(DVec3::X * 9.0)).await;
    let stretched = moved(&server, DAffine3::from_scale(DVec3::new(1.0, 1.25, 1.0))).await;

    let ask = async |case: &str, with: &str| {
        let address = format!("{case}/registration?with={with}");
        let answer = server.get(&address).await;
        assert_eq!(answer.status, 200, "{answer:?}");
        (answer.json(), answer.header("etag").to_owned())
    };
    let (found, tag) = ask(&case, &later).await;
    assert_eq!(found["verdict"], "registered", "{found}");
    assert!((shift_mm(&found) + 9.0).abs() < 1.5, "{found}");
    let (back, _) = ask(&format!("/v1/cases/{later}"), &id_of(&case)).await;
    assert!((shift_mm(&back) - 9.0).abs() < 1.5, "{back}");
    let (rough, _) = ask(&case, &stretched).await;
    assert_eq!(rough["verdict"], "rough", "{rough}");

    let address = format!("{case}/registration?with={later}");
    let known = server.get_with(&address, &[("if-none-match", &tag)]).await;
    assert_eq!(known.status, 304);
    let nobody = "0".repeat(32);
    for (query, refusal) in [
        (String::new(), (400, "query-key-missing")),
        ("?with=7".into(), (400, "query-value-unreadable")),
        (format!("?with={nobody}"), (404, "no-such-case")),
        (format!("?with={later}&depth=1"), (400, "query-unknown-key")),
    ] {
        let answer = server.get(&format!("{case}/registration{query}")).await;
        let (status, kind) = answer.refusal();
        assert_eq!((status, kind.as_str()), refusal, "{query}");
    }
    // What the client knows of a case that is gone is no answer any more.
    let gone = format!("/v1/cases/{later}");
    let deleted = server.ask(
        axum::http::Method::DELETE,
        &gone,
        &[],
        axum::body::Body::empty(),
    );
    assert_eq!(deleted.await.status, 204);
    let known = server.get_with(&address, &[("if-none-match", &tag)]).await;
    assert_eq!(known.refusal(), (404, "no-such-case".to_owned()));
    workers.shut_down(Duration::from_secs(60)).await;
}
