//! Lists the files of the bundled page, which the program carries: those that `web/dist/manifest.json` names, each as it is, as
//! brotli and as gzip.

use std::fs;
use std::path::PathBuf;

use serde_json::Value;

fn main() {
    // Asked while running: a program that was built for another checkout may be run for this one.
    let package = std::env::var_os("CARGO_MANIFEST_DIR").expect("cargo names the package's folder");
    let folder = PathBuf::from(package).join("page");
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
    let folders = Folders {
        dist: folder,
        out: PathBuf::from(out),
    };
    fs::write(folders.out.join("page_files.rs"), folders.list(&manifest))
        .expect("the list is written");
    folders.copy("share.html");
}

struct Folders {
    /// Where the page is.
    dist: PathBuf,
    /// Where its files are copied to, so that the page can be bundled again while the program is compiled.
    out: PathBuf,
}

impl Folders {
    /// The files with their addresses, as an expression: a slice of `PageFile`.
    fn list(&self, manifest: &Value) -> String {
        let items = |key: &str| manifest[key].as_array().into_iter().flatten();
        let documents = items("documents").map(|document| {
            let name = text(&document["file"]);
            self.file(name, text(&document["address"]), false)
        });
        let hashed = items("hashed").map(text);
        let hashed = hashed.map(|name| self.file(name, &format!("/{name}"), true));
        let files: String = documents.chain(hashed).collect();
        format!("&[\n{files}]\n")
    }

    fn file(&self, name: &str, address: &str, is_immutable: bool) -> String {
        let [bytes, brotli, gzip] = ["", ".br", ".gz"].map(|ending| {
            let file = format!("{name}{ending}");
            format!("include_bytes!({:?})", self.copy(&file))
        });
        format!(
            "    PageFile {{ name: {name:?}, address: {address:?}, is_immutable: {is_immutable}, bytes: {bytes}, brotli: {brotli}, gzip: {gzip} }},\n"
        )
    }

    /// Copies a file of the page; where it is then.
    fn copy(&self, file: &str) -> PathBuf {
        let bundled = self.dist.join(file);
        println!("cargo::rerun-if-changed={}", bundled.display());
        let copied = self.out.join(file);
        if let Err(error) = fs::copy(bundled, &copied) {
            panic!("web/dist/{file}: {error}; run `make web`");
        }
        copied
    }
}

fn text(value: &Value) -> &str {
    value.as_str().expect("the manifest names files")
}
