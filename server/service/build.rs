//! Lists the bundled page, which the program carries, and compresses it as well as gzip allows.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

/// What `web/build.mjs` makes in any case; the scripts that are fetched on demand have names of their own.
const FILES: [&str; 8] = [
    "compare.html",
    "compare.js",
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
    println!("cargo::rerun-if-changed={}", folder.display());
    for name in FILES {
        if !folder.join(name).is_file() {
            println!(
                "cargo::error=web/dist/{name} is missing: run `make web` to bundle the page (it needs Node and npm)"
            );
        }
    }
    let out = std::env::var_os("OUT_DIR").expect("cargo names the folder for what is made");
    let out = PathBuf::from(out);
    fs::write(out.join("page_files.rs"), list(&folder, &out)).expect("the list is written");
}

/// The files with their bytes, as they are and gzipped, as an expression: a slice in the order of the names.
fn list(folder: &Path, out: &Path) -> String {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    let mut text = String::from("&[\n");
    for path in paths.iter().filter(|path| path.is_file()) {
        println!("cargo::rerun-if-changed={}", path.display());
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let path = path.canonicalize().expect("a file that is there");
        let packed = out.join(format!("{name}.gz"));
        fs::write(
            &packed,
            gzipped(&fs::read(&path).expect("a file that is there")),
        )
        .expect("the compressed file is written");
        writeln!(
            text,
            "    ({name:?}, include_bytes!({path:?}).as_slice(), include_bytes!({packed:?}).as_slice()),"
        )
        .expect("a string takes all");
    }
    text.push_str("]\n");
    text
}

/// The shortest gzip stream: it takes a second, which no client waits for, and is some 3 % shorter than the usual best.
fn gzipped(bytes: &[u8]) -> Vec<u8> {
    let mut packed = Vec::new();
    zopfli::compress(
        zopfli::Options::default(),
        zopfli::Format::Gzip,
        bytes,
        &mut packed,
    )
    .expect("compressing from memory to memory cannot fail");
    packed
}
