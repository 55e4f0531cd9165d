//! The resident memory of a server over many cases. `tests/faults/memory.py` is the long form, also with real heads.
#![cfg(target_os = "linux")]

use std::collections::HashMap;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use geometry::phantom::head;

use crate::server::form;
use crate::several_machines::{Process, get, send};

/// Cases of which the models and answers would need more than is allowed, if none was dropped.
const CASES: u8 = 12;

/// Edge of a voxel of each head: the volume of one has 3 MB.
const SPACING_MM: f64 = 1.5;

/// What the cache may hold, and what the server may hold beside it, in MiB.
const CACHE_MIB: u64 = 20;
const BESIDE_MIB: u64 = 120;

/// The resident memory that a process has allocated, in MiB: without the program itself, of which a test has more than a release.
fn resident_mib(pid: u32) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = text.lines().find(|line| line.starts_with("RssAnon:"));
    let kib = line.and_then(|line| line.split_whitespace().nth(1));
    kib.unwrap().parse::<u64>().unwrap() / 1024
}

/// Uploads a head, waits until it is ready, and loads every part of it into the cache.
async fn use_case(server: SocketAddr, upload: &[u8]) {
    let case = send(server, "POST", "/v1/cases", Some(upload)).await.json();
    let address = case["links"]["self"].as_str().unwrap();
    let begun = Instant::now();
    while get(server, address).await.json()["state"] != "ready" {
        assert!(begun.elapsed() < Duration::from_secs(60));
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    for rest in ["render?depth_mm=8", "volume", "distance", "mesh/paths"] {
        let answer = get(server, &format!("{address}/{rest}")).await;
        assert_eq!(answer.status(), "200", "{}", answer.head);
    }
}

#[tokio::test]
async fn a_server_holds_no_more_than_its_cache_after_many_cases() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("config.toml");
    let text = format!(
        "[render]\ncache_bytes = {}\n[limits]\nmaps = \"off\"\n",
        CACHE_MIB << 20
    );
    std::fs::write(&config, text).unwrap();
    let options = ["--config", config.to_str().unwrap()];
    let (process, server) = Process::server_with(&options, &HashMap::new());
    let head = head(SPACING_MM);
    let volume = imaging::nifti::write_volume(&head.volume).unwrap();
    let mask = imaging::nifti::write_mask(&head.brain).unwrap();
    for number in 0..CASES {
        // Another radius is another case.
        let parameters = format!(
            "{{\"closing_radius_mm\": {}}}",
            5.0 + f64::from(number) / 8.0
        );
        let parts = [
            ("volume", &volume[..]),
            ("mask", &mask[..]),
            ("parameters", parameters.as_bytes()),
        ];
        use_case(server, &form(&parts)).await;
    }
    let resident_mib = resident_mib(process.id());
    println!("{resident_mib} MiB");
    assert!(resident_mib <= CACHE_MIB + BESIDE_MIB, "{resident_mib} MiB");
}
