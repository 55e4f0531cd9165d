//! The documents name only commands, files and variables that exist.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The text files below `folder` that end in one of `endings`.
fn texts_below(folder: &Path, endings: &[&str], texts: &mut String) {
    for entry in std::fs::read_dir(folder).expect("the folder can be listed") {
        let path = entry.expect("the entry can be read").path();
        let ending = path
            .extension()
            .and_then(|ending| ending.to_str())
            .unwrap_or_default();
        if path.is_dir() {
            texts_below(&path, endings, texts);
        } else if endings.contains(&ending) {
            texts.push_str(&std::fs::read_to_string(&path).expect("the file is UTF-8"));
        }
    }
}

/// The words of `text` that begin with `prefix`, taken as long as `belongs`.
fn words_after(text: &str, prefix: &str, belongs: fn(char) -> bool) -> BTreeSet<String> {
    text.match_indices(prefix)
        .map(|(at, _)| {
            let rest = &text[at + prefix.len()..];
            rest.chars().take_while(|&letter| belongs(letter)).collect()
        })
        .filter(|word: &String| !word.is_empty())
        .collect()
}

const DOCUMENTS: [&str; 15] = [
    "README.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "docker/README.md",
    "docs/accuracy.md",
    "docs/configuration.md",
    "docs/conformance.md",
    "docs/dicom.md",
    "docs/extraction.md",
    "docs/http.md",
    "docs/layers.md",
    "docs/pacs.md",
    "docs/performance.md",
    "docs/renderers.md",
    "docs/study.md",
];

#[test]
fn every_make_command_of_the_documents_is_in_the_makefile() {
    let makefile = read("Makefile");
    let mut named = BTreeSet::new();
    for document in DOCUMENTS {
        named.extend(words_after(&read(document), "`make ", |letter| {
            letter.is_ascii_lowercase()
        }));
        named.extend(words_after(&read(document), "\nmake ", |letter| {
            letter.is_ascii_lowercase()
        }));
    }
    assert!(
        named.contains("demo") && named.contains("test"),
        "the documents name {named:?}"
    );
    for target in named {
        assert!(makefile.contains(&format!("\n{target}: ")), "make {target}");
    }
}

#[test]
fn every_path_that_a_document_links_to_exists() {
    for document in DOCUMENTS {
        let folder = root()
            .join(document)
            .parent()
            .expect("a document lies in a folder")
            .to_owned();
        let links = words_after(&read(document), "](", |letter| !matches!(letter, ')' | '#'));
        for link in links.iter().filter(|link| !link.contains("://")) {
            assert!(folder.join(link).exists(), "{document} links to {link}");
        }
    }
}

#[test]
fn every_variable_of_the_documents_is_read_somewhere() {
    let mut code = String::new();
    for folder in ["server", "tests", "scripts"] {
        texts_below(&root().join(folder), &["rs", "sh", "mjs"], &mut code);
    }
    for document in DOCUMENTS {
        let belongs = |letter: char| letter.is_ascii_uppercase() || letter == '_';
        for name in words_after(&read(document), "ISOCORTEX_", belongs) {
            assert!(
                code.contains(&format!("ISOCORTEX_{name}")),
                "{document} names ISOCORTEX_{name}"
            );
        }
    }
}

#[test]
fn the_page_and_the_readme_show_the_notice() {
    let notice = render::RESEARCH_USE_NOTICE;
    for path in ["web/src/page.html", "web/src/words.en.json", "README.md"] {
        assert!(read(path).contains(notice), "{path}");
    }
}
