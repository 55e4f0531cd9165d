#![doc = include_str!("../README.md")]

mod colors;
mod names;
mod translate;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

/// Translate the shaders to the page's language and write them into `web/shaders/`.
#[derive(Parser)]
struct Arguments {
    /// Write nothing; fail if a file is stale.
    #[arg(long)]
    check: bool,
}

/// A file of `web/shaders/`.
struct File {
    name: &'static str,
    text: String,
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
            "web/shaders/{} is stale: run `cargo run -p shader-translate`",
            file.name
        )),
    }
}

fn fail(why: &str) -> ExitCode {
    eprintln!("error: {why}");
    ExitCode::FAILURE
}

/// Everything that `web/shaders/` holds.
fn files() -> Vec<File> {
    let shaders = render::gpu::PAGE_SHADERS;
    let translated = shaders.map(|shader| (shader.file, translate::translate(&shader)));
    let mut files = vec![
        File {
            name: "names.json",
            text: names::listing(&translated),
        },
        File {
            name: "colors.json",
            text: colors::colors(),
        },
    ];
    files.extend(translated.into_iter().map(|(name, shader)| File {
        name,
        text: shader.text,
    }));
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
        .join("../../web/shaders")
        .join(file.name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_draws_with_the_same_code() {
        let stale: Vec<_> = stale(files()).iter().map(|file| file.name).collect();
        assert!(
            stale.is_empty(),
            "{stale:?} of web/shaders are stale: run `cargo run -p shader-translate`"
        );
    }
}
