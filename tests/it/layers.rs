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

/// What a part of the server must not need, besides itself.
struct Layer {
    name: &'static str,
    /// Crates of ours.
    never: &'static [&'static str],
    /// Crates of others.
    never_others: &'static [&'static str],
}

/// What serves HTTP or reads a command line: the business of `service`, `pacs` and the program alone.
const PROTOCOLS: &[&str] = &["axum", "tower-http", "clap", "utoipa"];

/// What speaks HTTP: `storage` asks object stores by it, and nothing below does.
const HTTP: &[&str] = &["hyper"];

const FILES_AND_TASKS: &[&str] = &["tokio", "sqlx", "object_store"];

const LAYERS: &[Layer] = &[
    Layer {
        name: "geometry",
        never: &[
            "analysis",
            "case",
            "cases",
            "extraction",
            "imaging",
            "bench",
            "pipeline",
            "render",
            "service",
            "storage",
        ],
        never_others: &["wgpu", "naga", "image", "png", "flate2", "zstd", "serde"],
    },
    Layer {
        name: "analysis",
        never: &[
            "case",
            "cases",
            "extraction",
            "imaging",
            "bench",
            "pipeline",
            "render",
            "service",
            "storage",
        ],
        never_others: &["wgpu", "image", "png", "flate2", "zstd"],
    },
    Layer {
        name: "extraction",
        never: &[
            "analysis", "case", "cases", "imaging", "bench", "pipeline", "render", "service",
            "storage",
        ],
        never_others: &["wgpu"],
    },
    Layer {
        name: "imaging",
        never: &[
            "analysis",
            "case",
            "cases",
            "extraction",
            "bench",
            "pipeline",
            "render",
            "service",
            "storage",
        ],
        never_others: &["wgpu"],
    },
    Layer {
        name: "render",
        never: &[
            "analysis",
            "case",
            "cases",
            "extraction",
            "imaging",
            "bench",
            "pipeline",
            "service",
            "storage",
        ],
        never_others: &[],
    },
    Layer {
        name: "bench",
        never: &["cases", "service", "storage"],
        never_others: &[],
    },
    Layer {
        name: "case",
        never: &[
            "analysis",
            "cases",
            "extraction",
            "geometry",
            "imaging",
            "bench",
            "pipeline",
            "render",
            "service",
            "storage",
        ],
        never_others: &["wgpu"],
    },
    Layer {
        name: "pipeline",
        never: &["cases", "bench", "service", "storage"],
        never_others: &[],
    },
    Layer {
        name: "storage",
        never: &[
            "analysis",
            "cases",
            "extraction",
            "geometry",
            "imaging",
            "bench",
            "pipeline",
            "render",
            "service",
        ],
        never_others: &["wgpu"],
    },
    Layer {
        name: "cases",
        never: &["bench", "service"],
        never_others: &[],
    },
    Layer {
        name: "service",
        never: &["bench"],
        never_others: &["clap"],
    },
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
        let ours: Vec<_> = layer
            .never
            .iter()
            .map(|name| format!("isocortex-{name}"))
            .collect();
        let ours: Vec<_> = ours.iter().map(String::as_str).collect();
        assert_needs_none_of(&package, &needed, &ours);
        assert_needs_none_of(&package, &needed, layer.never_others);
        assert_needs_none_of(&package, &needed, &["isocortex"]);
        match layer.name {
            "service" => {}
            // A program of its own, which reads a command line and speaks no HTTP.
            "bench" => assert_needs_none_of(&package, &needed, &["axum", "tower-http"]),
            _ => assert_needs_none_of(&package, &needed, PROTOCOLS),
        }
        if !["storage", "cases", "service"].contains(&layer.name) {
            assert_needs_none_of(&package, &needed, FILES_AND_TASKS);
            assert_needs_none_of(&package, &needed, HTTP);
        }
    }
}

#[test]
fn the_program_stands_on_all_of_them() {
    let needed = needed_by("isocortex");
    for below in [
        "case", "cases", "geometry", "imaging", "pipeline", "render", "service", "storage",
    ] {
        let floor = format!("isocortex-{below}");
        assert!(
            needed.contains(&floor),
            "{floor} is missing below the program"
        );
    }
}
