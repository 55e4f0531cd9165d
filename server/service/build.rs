//! Looks for the bundled page, which the program carries.

use std::path::PathBuf;

/// What `web/build.mjs` makes.
const FILES: [&str; 6] = [
    "index.html",
    "main.js",
    "shaders.json",
    "style.css",
    "words.en.json",
    "words.pt-BR.json",
];

fn main() {
    // Asked while running: a program that was built for another checkout may be run for this one.
    let package = std::env::var_os("CARGO_MANIFEST_DIR").expect("cargo names the package's folder");
    let folder = PathBuf::from(package).join("../../web/dist");
    for name in FILES {
        let file = folder.join(name);
        println!("cargo::rerun-if-changed={}", file.display());
        if !file.is_file() {
            println!(
                "cargo::error=web/dist/{name} is missing: run `make web` to bundle the page (it needs Node and npm)"
            );
        }
    }
}
