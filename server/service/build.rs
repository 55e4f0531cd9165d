//! Looks for the bundled page, which the program carries.

use std::path::Path;

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
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../web/dist");
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
