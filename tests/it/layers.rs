//! The layers: a crate uses those below it, and not all of those; never one above or beside it.

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

/// A part of the server.
struct Layer {
    name: &'static str,
    /// The crates of ours that it may need, directly or not, besides itself: no others.
    needs: &'static [&'static str],
    /// Crates of others that it must not need.
    never: &'static [&'static str],
}

/// What serves HTTP or reads a command line: the business of `http`, `access`, `service`, `pacs` and the program alone.
const PROTOCOLS: &[&str] = &["axum", "tower-http", "clap", "utoipa"];

/// What speaks HTTP: `storage` asks buckets by it, and nothing below does.
const HTTP: &[&str] = &["hyper"];

const FILES_AND_TASKS: &[&str] = &["tokio", "sqlx", "object_store"];

const LAYERS: &[Layer] = &[
    Layer {
        name: "geometry",
        needs: &[],
        never: &["wgpu", "naga", "image", "png", "flate2", "zstd", "serde"],
    },
    Layer {
        name: "analysis",
        needs: &["geometry"],
        never: &["wgpu", "image", "png", "flate2", "zstd"],
    },
    Layer {
        name: "extraction",
        needs: &["geometry"],
        never: &["wgpu"],
    },
    Layer {
        name: "imaging",
        needs: &["geometry"],
        never: &["wgpu"],
    },
    Layer {
        name: "render",
        needs: &["geometry"],
        never: &[],
    },
    Layer {
        name: "case",
        needs: &[],
        never: &["wgpu"],
    },
    Layer {
        name: "pipeline",
        needs: &["analysis", "case", "extraction", "geometry", "imaging"],
        never: &["wgpu"],
    },
    Layer {
        name: "storage",
        needs: &["case"],
        never: &["wgpu"],
    },
    Layer {
        name: "report",
        needs: &["case", "geometry", "render"],
        never: &["zstd"],
    },
    Layer {
        name: "worker",
        needs: WORKER_NEEDS,
        never: &["wgpu"],
    },
    Layer {
        name: "cases",
        needs: CASES_NEED,
        never: &[],
    },
    Layer {
        name: "http",
        needs: &["case"],
        never: &["clap"],
    },
    Layer {
        name: "access",
        needs: &["case", "http"],
        never: &["clap"],
    },
    Layer {
        name: "service",
        needs: INTERFACE_NEEDS,
        never: &["clap"],
    },
    Layer {
        name: "pacs",
        needs: INTERFACE_NEEDS,
        never: &["clap"],
    },
];

const WORKER_NEEDS: &[&str] = &[
    "analysis",
    "case",
    "extraction",
    "geometry",
    "imaging",
    "pipeline",
    "storage",
];

const CASES_NEED: &[&str] = &[
    "analysis",
    "case",
    "extraction",
    "geometry",
    "imaging",
    "pipeline",
    "render",
    "report",
    "storage",
    "worker",
];

const INTERFACE_NEEDS: &[&str] = &[
    "access",
    "analysis",
    "case",
    "cases",
    "extraction",
    "geometry",
    "http",
    "imaging",
    "pipeline",
    "render",
    "report",
    "storage",
    "worker",
];

fn assert_needs_none_of(package: &str, needed: &BTreeSet<String>, forbidden: &[&str]) {
    let found: Vec<_> = forbidden
        .iter()
        .filter(|&&name| needed.contains(name))
        .collect();
    assert!(found.is_empty(), "{package} must not need {found:?}");
}

#[test]
fn no_layer_needs_what_is_above_or_beside_it() {
    for layer in LAYERS {
        let package = format!("isocortex-{}", layer.name);
        let needed = needed_by(&package);
        let is_ours = |name: &&String| *name == "isocortex" || name.starts_with("isocortex-");
        let ours: BTreeSet<_> = needed.iter().filter(is_ours).cloned().collect();
        let allowed = layer.needs.iter().chain([&layer.name]);
        let allowed = allowed.map(|name| format!("isocortex-{name}")).collect();
        let more: Vec<_> = ours.difference(&allowed).collect();
        assert!(more.is_empty(), "{package} must not need {more:?}");
        assert_needs_none_of(&package, &needed, layer.never);
        if !["http", "access", "service", "pacs"].contains(&layer.name) {
            assert_needs_none_of(&package, &needed, PROTOCOLS);
        }
        if ![
            "storage", "worker", "cases", "http", "access", "service", "pacs",
        ]
        .contains(&layer.name)
        {
            assert_needs_none_of(&package, &needed, FILES_AND_TASKS);
            assert_needs_none_of(&package, &needed, HTTP);
        }
    }
}

#[test]
fn the_program_stands_on_all_of_them() {
    let needed = needed_by("isocortex");
    for below in [
        "access", "case", "cases", "geometry", "http", "imaging", "pacs", "pipeline", "render",
        "report", "service", "storage", "worker",
    ] {
        let floor = format!("isocortex-{below}");
        assert!(
            needed.contains(&floor),
            "{floor} is missing below the program"
        );
    }
}
