//! Preparations in processes of their own: the same bytes, and limits that the kernel keeps.

use geometry::phantom;
use isocortex::config::Config;

use crate::dicom::reader;
use crate::head::plain_head;
use crate::server::Server;

fn apart(config: &mut Config) {
    config.dicom_program = reader();
    config.prepares_apart = true;
}

#[tokio::test]
async fn a_case_has_the_same_bytes_wherever_it_is_prepared() {
    let [here, there] = [Server::start().await, Server::start_with(apart).await];
    let volume = plain_head().bytes();
    let parts = [("volume", &volume[..])];
    let case = here.prepared(&parts).await;
    assert_eq!(there.prepared(&parts).await, case);
    for what in ["mesh?depth_mm=6", "volume", "mask"] {
        let [from_here, from_there] = [
            here.get(&format!("{case}/{what}")).await,
            there.get(&format!("{case}/{what}")).await,
        ];
        assert_eq!(from_here.status, from_there.status, "{what}");
        assert_eq!(from_here.body, from_there.body, "{what}");
    }
    let left = there.stored_files();
    let is_upload =
        |path: &std::path::PathBuf| path.components().any(|part| part.as_os_str() == "uploads");
    assert!(!left.iter().any(is_upload), "{left:?}");
}

#[tokio::test]
async fn a_preparation_that_takes_too_much_time_of_the_processors_ends() {
    let server = Server::start_with(|config| {
        apart(config);
        config.prepare.max_cpu_secs = 1;
    })
    .await;
    let head = imaging::nifti::write_volume(&phantom::head(1.0).volume).unwrap();
    let answer = server.upload(&[("volume", &head)]).await;
    let settled = server.until_settled(answer.header("location")).await;
    assert_eq!(settled["state"], "failed", "{settled}");
    let kind = settled["error"]["type"].as_str().unwrap_or_default();
    assert!(kind.ends_with("preparation-too-slow"), "{settled}");
}
