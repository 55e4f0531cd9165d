#![doc = include_str!("../README.md")]

mod colors;
mod names;
mod translate;
mod twins;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

/// Translate the shaders to the page's language and write them into `web/shaders/`, and their blocks into the renderer.
#[derive(Parser)]
struct Arguments {
    /// Write nothing; fail if a file is stale.
    #[arg(long)]
    check: bool,
}

/// A file, by its path from the root of the repository.
struct File {
    path: String,
    text: String,
}

impl File {
    fn of_page(name: &str, text: String) -> Self {
        let path = format!("web/shaders/{name}");
        Self { path, text }
    }
}

fn main() -> ExitCode {
    let Arguments { check } = Arguments::parse();
    let stale = stale(files());
    if !check {
        return match stale.iter().try_for_each(write) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => fail(&error.to_string()),
        };
    }
    match stale.first() {
        None => ExitCode::SUCCESS,
        Some(file) => fail(&format!(
            "{} is stale: run `cargo run -p shader-translate`",
            file.path
        )),
    }
}

fn fail(why: &str) -> ExitCode {
    eprintln!("error: {why}");
    ExitCode::FAILURE
}

/// Everything that is written.
fn files() -> Vec<File> {
    let shaders = render::gpu::PAGE_SHADERS;
    let translated = shaders.map(|shader| (shader.file, translate::translate(&shader)));
    let mut files = vec![
        File::of_page("names.json", names::listing(&translated)),
        File::of_page("colors.json", colors::colors()),
        File {
            path: "server/render/src/gpu/layout.rs".to_owned(),
            text: twins::twins(),
        },
    ];
    let translated = translated.into_iter();
    files.extend(translated.map(|(name, shader)| File::of_page(name, shader.text)));
    files
}

/// Those that are not on the disk as they should be.
fn stale(mut files: Vec<File>) -> Vec<File> {
    files.retain(|file| std::fs::read_to_string(path(file)).ok().as_ref() != Some(&file.text));
    files
}

fn write(file: &File) -> std::io::Result<()> {
    let path = path(file);
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    std::fs::write(path, &file.text)
}

fn path(file: &File) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join(&file.path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_and_the_renderer_have_what_the_shaders_say() {
        let stale: Vec<_> = stale(files()).into_iter().map(|file| file.path).collect();
        assert!(
            stale.is_empty(),
            "{stale:?} are stale: run `cargo run -p shader-translate`"
        );
    }
}
