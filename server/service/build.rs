//! Lists the files of the bundled page, which the program carries: those that `web/dist/manifest.json` names, each as it is, as
//! brotli and as gzip.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

fn main() {
    // Asked while running: a program that was built for another checkout may be run for this one.
    let package = std::env::var_os("CARGO_MANIFEST_DIR").expect("cargo names the package's folder");
    let folder = PathBuf::from(package).join("../../web/dist");
    let manifest = folder.join("manifest.json");
    println!("cargo::rerun-if-changed={}", manifest.display());
    let Ok(text) = fs::read(&manifest) else {
        println!(
            "cargo::error=web/dist/manifest.json is missing: run `make web` to bundle the page (it needs Node and npm)"
        );
        return;
    };
    let manifest = serde_json::from_slice(&text).expect("the manifest is JSON");
    let out = std::env::var_os("OUT_DIR").expect("cargo names the folder for what is made");
    fs::write(
        PathBuf::from(out).join("page_files.rs"),
        list(&manifest, &folder),
    )
    .expect("the list is written");
}

/// The files with their addresses, as an expression: a slice of `PageFile`.
fn list(manifest: &Value, folder: &Path) -> String {
    let items = |key: &str| manifest[key].as_array().cloned().unwrap_or_default();
    let text = |value: &Value| {
        let text = value.as_str().expect("the manifest names files");
        text.to_owned()
    };
    let mut expression = String::from("&[\n");
    for document in items("documents") {
        let name = text(&document["file"]);
        write_file(
            &mut expression,
            folder,
            &name,
            &text(&document["address"]),
            false,
        );
    }
    for name in items("hashed").iter().map(text) {
        write_file(&mut expression, folder, &name, &format!("/{name}"), true);
    }
    expression.push_str("]\n");
    expression
}

fn write_file(
    expression: &mut String,
    folder: &Path,
    name: &str,
    address: &str,
    is_immutable: bool,
) {
    let bytes = |ending: &str| {
        let path = folder.join(format!("{name}{ending}"));
        println!("cargo::rerun-if-changed={}", path.display());
        let path = path.canonicalize();
        let path =
            path.unwrap_or_else(|_| panic!("web/dist/{name}{ending} is missing: run `make web`"));
        format!("include_bytes!({path:?})")
    };
    writeln!(
        expression,
        "PageFile {{ name: {name:?}, address: {address:?}, is_immutable: {is_immutable}, bytes: {}, brotli: {}, gzip: {} }},",
        bytes(""),
        bytes(".br"),
        bytes(".gz"),
    )
    .expect("a string takes all");
}
