//! The layers: a crate uses those below it, never one above or beside it.

use std::collections::BTreeSet;
use std::process::Command;

/// The names of all packages that `package` needs to run, itself among them.
fn needed_by(package: &str) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .args(["tree", "--locked", "--edges", "normal"])
        .args(["--prefix", "none", "--format", "{p}", "--package", package])
        .output()
        .expect("cargo can be run");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo tree {package}: {errors}");
    let names: BTreeSet<String> = String::from_utf8(output.stdout)
        .expect("cargo prints UTF-8")
        .lines()
        .filter_map(|line| line.split_whitespace().next())
        .map(str::to_owned)
        .collect();
    assert!(
        names.contains(package),
        "{package} is not in its own tree: {names:?}"
    );
    names
}

fn assert_needs_none_of(package: &str, forbidden: &[&str]) {
    let needed = needed_by(package);
    let found: Vec<_> = forbidden
        .iter()
        .filter(|&&name| needed.contains(name))
        .collect();
    assert!(found.is_empty(), "{package} must not need {found:?}");
}

#[test]
fn geometry_needs_no_files_no_server_and_no_gpu() {
    let forbidden = [
        "tokio",
        "axum",
        "hyper",
        "wgpu",
        "naga",
        "image",
        "png",
        "flate2",
        "zstd",
        "sqlx",
        "object_store",
        "isocortex-imaging",
        "isocortex-render",
        "isocortex-service",
    ];
    assert_needs_none_of("isocortex-geometry", &forbidden);
}

#[test]
fn extraction_stands_on_geometry_alone() {
    let beside_or_above = [
        "tokio",
        "axum",
        "sqlx",
        "object_store",
        "wgpu",
        "isocortex-imaging",
        "isocortex-render",
        "isocortex-service",
    ];
    assert_needs_none_of("isocortex-extraction", &beside_or_above);
}

#[test]
fn analysis_stands_on_geometry_alone() {
    let beside_or_above = [
        "tokio",
        "axum",
        "sqlx",
        "object_store",
        "wgpu",
        "isocortex-extraction",
        "isocortex-imaging",
        "isocortex-render",
        "isocortex-service",
    ];
    assert_needs_none_of("isocortex-analysis", &beside_or_above);
}

#[test]
fn imaging_and_render_do_not_know_each_other_or_the_server() {
    let above = ["tokio", "axum", "sqlx", "object_store", "isocortex-service"];
    assert_needs_none_of(
        "isocortex-imaging",
        &[&above[..], &["isocortex-render", "wgpu"]].concat(),
    );
    assert_needs_none_of(
        "isocortex-render",
        &[&above[..], &["isocortex-imaging"]].concat(),
    );
}

#[test]
fn what_measures_does_not_know_the_server() {
    let above = ["tokio", "axum", "sqlx", "object_store", "isocortex-service"];
    assert_needs_none_of("isocortex-measure", &above);
}

#[test]
fn the_service_stands_on_all_three() {
    let needed = needed_by("isocortex-service");
    for floor in [
        "isocortex-geometry",
        "isocortex-imaging",
        "isocortex-render",
    ] {
        assert!(
            needed.contains(floor),
            "{floor} is missing below the service"
        );
    }
}
