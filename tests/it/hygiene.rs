//! The documents name only commands, files and variables that exist, and state what was measured.

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

/// All documents but the changelog, which tells what was; relative to the root.
fn documents() -> Vec<PathBuf> {
    let folders = ["", "docker", "docs", "lab", "lab/docs", "tests/faults"];
    let mut found = Vec::new();
    for folder in folders {
        for entry in std::fs::read_dir(root().join(folder)).expect("the folder can be listed") {
            let name = entry.expect("the entry can be read").file_name();
            let path = Path::new(folder).join(name);
            let is_document = path.extension().is_some_and(|ending| ending == "md");
            if is_document && path != Path::new("CHANGELOG.md") {
                found.push(path);
            }
        }
    }
    found
}

#[test]
fn every_make_command_of_the_documents_is_in_the_makefile() {
    let makefile = read("Makefile");
    let mut named = BTreeSet::new();
    for document in documents() {
        named.extend(words_after(&read(&document), "`make ", |letter| {
            letter.is_ascii_lowercase()
        }));
        named.extend(words_after(&read(&document), "\nmake ", |letter| {
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

/// The names by which the headings and the anchors of a document are linked to.
fn anchors_of(text: &str) -> BTreeSet<String> {
    let mut is_code = false;
    let mut found = words_after(text, "<a id=\"", |letter| letter != '"');
    for line in text.lines() {
        is_code ^= line.starts_with("```");
        if is_code || !line.starts_with('#') {
            continue;
        }
        let heading = line.trim_start_matches('#').trim().to_lowercase();
        let kept = heading.chars().filter_map(|letter| match letter {
            ' ' => Some('-'),
            '-' | '_' => Some(letter),
            _ => letter.is_alphanumeric().then_some(letter),
        });
        found.insert(kept.collect());
    }
    found
}

#[test]
fn every_path_and_every_heading_that_a_document_links_to_exists() {
    for document in documents() {
        let path = root().join(&document);
        let folder = path.parent().expect("a document lies in a folder");
        let links = words_after(&read(&document), "](", |letter| letter != ')');
        for link in links.iter().filter(|link| !link.contains("://")) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = match file {
                "" => path.clone(),
                _ => folder.join(file),
            };
            let exists = target.exists()
                && (anchor.is_empty() || anchors_of(&read(&target)).contains(anchor));
            assert!(exists, "{} links to {link}", document.display());
        }
    }
}

#[test]
fn every_variable_of_the_documents_is_read_somewhere() {
    let mut code = String::new();
    for folder in [
        "lab/scripts",
        "lab/src",
        "lab/tests",
        "server",
        "tests",
        "scripts",
    ] {
        texts_below(&root().join(folder), &["mjs", "py", "rs", "sh"], &mut code);
    }
    let belongs = |letter: char| letter.is_ascii_uppercase() || letter == '_';
    let read_somewhere = words_after(&code, "ISOCORTEX_", belongs);
    for document in documents() {
        for name in words_after(&read(&document), "ISOCORTEX_", belongs) {
            assert!(
                read_somewhere.contains(&name),
                "{} names ISOCORTEX_{name}",
                document.display()
            );
        }
    }
}

#[test]
fn every_test_that_holds_a_defence_exists() {
    let text = read("SECURITY.md");
    let rows = text.lines().filter(|line| line.starts_with("| "));
    let (mut file, mut tests) = (String::new(), 0);
    for row in rows.skip(1) {
        let cells: Vec<_> = row.split(" | ").collect();
        let [_, _, _, held_by] = cells[..] else {
            panic!("{row} has {} cells", cells.len());
        };
        if held_by.ends_with("not this program |") {
            continue;
        }
        let named: Vec<_> = held_by.split('`').skip(1).step_by(2).collect();
        assert!(!named.is_empty(), "nothing holds {row}");
        for name in named {
            if name.contains('.') {
                file = read(name);
            } else {
                let function = format!("fn {name}(");
                assert!(file.contains(&function), "{name} is not where {row} says");
                tests += 1;
            }
        }
    }
    assert!(tests > 15, "{tests} tests");
}

#[test]
fn the_page_and_the_readme_show_the_notice() {
    let notice = render::RESEARCH_USE_NOTICE;
    for path in ["web/src/page.html", "web/src/words.en.json", "README.md"] {
        assert!(read(path).contains(notice), "{path}");
    }
}

#[test]
fn children_and_caches_fit_into_the_memory_of_the_shipped_containers() {
    let config = isocortex::config::Config::default();
    let mut containers = 0;
    for file in [
        "docker/compose.yaml",
        "docker/compose-cluster.yaml",
        "docker/orthanc/compose.yaml",
        "docker/kubernetes/isocortex.yaml",
    ] {
        let text = read(file);
        for container in text.split("image: isocortex\n").skip(1) {
            // One that makes the store and ends has no children and no caches.
            if container
                .lines()
                .take(3)
                .any(|line| line.contains("init-store"))
            {
                continue;
            }
            let limits = ["mem_limit: ", "limits: { memory: "];
            let places = limits.map(|limit| Some(container.find(limit)? + limit.len()));
            let at = places.into_iter().flatten().min().expect(file);
            let digits: String = container[at..]
                .chars()
                .take_while(char::is_ascii_digit)
                .collect();
            let unit = container[at + digits.len()..].chars().next();
            assert!(unit.is_some_and(|unit| "gG".contains(unit)), "{file}");
            let bytes = digits.parse::<u64>().unwrap() << 30;
            let children = config.children_in(Some(bytes)).unwrap();
            let least = children.least();
            let all = children.bytes + config.render.cache_bytes + (512 << 20);
            assert!(all <= bytes && children.bytes >= least, "{file}: {all}");
            containers += 1;
        }
    }
    assert_eq!(containers, 5);
}

#[test]
fn every_test_that_a_measurement_was_made_with_exists() {
    let mut code = String::new();
    for folder in ["server", "tests"] {
        texts_below(&root().join(folder), &["rs"], &mut code);
    }
    let named = words_after(&read("lab/docs/reliability.md"), "test(", |letter| {
        letter != ')'
    });
    assert!(named.len() > 10, "{named:?}");
    for name in named {
        let module = name.trim_end_matches("::");
        let is_there = ["fn ", "mod "]
            .iter()
            .flat_map(|kind| code.split(kind).skip(1))
            .any(|rest| {
                rest.split(['(', ';', ' ', '<'])
                    .next()
                    .is_some_and(|it| it.contains(module))
            });
        assert!(is_there, "no test has {name} in its name");
    }
}

/// The rows of the table after an anchor of the study: the first cell, the number in the second, and the last.
fn rows_of_study(anchor: &str) -> Vec<(String, f64, String)> {
    let study = read("lab/docs/study.md");
    let (_, after) = study
        .split_once(&format!("<a id=\"{anchor}\"></a>"))
        .unwrap_or_else(|| panic!("the study has no {anchor}"));
    let table = after.trim_start().lines().skip(2);
    let rows = table.take_while(|line| line.starts_with('|')).map(|line| {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let number = cells[1].parse().expect("a number");
        let last = cells.last().expect("cells").replace('*', "");
        (cells[0].to_owned(), number, last)
    });
    rows.collect()
}

/// The 95 % interval of a share, by Wilson's formula.
fn interval(count: f64, number: f64) -> [f64; 2] {
    let z = 1.96f64;
    let share = count / number;
    let spread = (share * (1.0 - share) / number + z * z / (4.0 * number * number)).sqrt();
    [-1.0, 1.0]
        .map(|sign| (share + z * z / (2.0 * number) + sign * z * spread) / (1.0 + z * z / number))
}

#[test]
fn documents_and_page_state_the_shares_that_the_study_measured() {
    let (sound, lesions) = (rows_of_study("sound"), rows_of_study("texture"));
    for (what, number, measured) in sound.iter().chain(&lesions) {
        let share: f64 = measured[..4].parse().expect("a share");
        let count = (share * number).round();
        let [low, high] = interval(count, *number);
        let written = format!("{:.2} ({:.2} to {:.2})", count / number, low.abs(), high);
        assert_eq!(measured, &written, "{what}: {count} of {number}");
    }

    // The least and the greatest share of a lesion over all simulators, in percent; the first check has one row for the limit.
    let study = read("lab/docs/study.md");
    let by_limit = study
        .lines()
        .find(|line| line.starts_with("| **2.25**"))
        .expect("the limit");
    let first: Vec<u32> = by_limit
        .split(['|', '*'])
        .filter_map(|cell| cell.strip_suffix(" %")?.parse().ok())
        .collect();
    let percent = |text: &str| (text.parse::<f64>().expect("a share") * 100.0).round();
    let range = |kind: &str, first: Option<u32>| {
        let shares = lesions
            .iter()
            .filter(|(what, ..)| what.starts_with(kind))
            .map(|(_, _, measured)| percent(&measured[..4]) as u32)
            .chain(first);
        let shares: Vec<u32> = shares.collect();
        let least = *shares.iter().min().expect("shares");
        (least, *shares.iter().max().expect("shares"))
    };
    let blurs = range("blur, 6 mm", Some(first[0]));
    let small = range("blur, 4 mm", Some(first[1]));
    let mixtures = range("mixture", Some(first[3]));
    let (reading, readme, words) = (
        read("docs/reading.md"),
        read("README.md"),
        read("web/src/words.en.json"),
    );
    for ((least, most), name) in [
        (blurs, "blurs of 6 mm"),
        (small, "blurs of 4 mm"),
        (
            mixtures,
            "mixtures of blur, thickening and changed intensities",
        ),
    ] {
        let sentence = format!("{name}: {least} to {most} %");
        assert!(reading.contains(&sentence), "reading.md: {sentence}");
    }
    let missed = |(least, most): (u32, u32), to| format!("{} {to} {} %", 100 - most, 100 - least);
    let [six, four, mixed] = [blurs, small, mixtures].map(|range| missed(range, "to"));
    let of_page =
        format!("{six} of blurs of 6 mm radius, {four} of blurs of 4 mm, {mixed} of mixed signs");
    assert!(words.contains(&of_page), "words.en.json: {of_page}");
    let [six, four, mixed] = [blurs, small, mixtures].map(|range| missed(range, "a"));
    let of_page =
        format!("{six} dos borramentos de 6 mm de raio, {four} dos de 4 mm, {mixed} das de sinais");
    assert!(
        read("web/src/words.pt-BR.json").contains(&of_page),
        "{of_page}"
    );
    let (least, most) = range("blur, 6 mm, texture kept", None);
    let of_readme = format!("{least} to {most} % of the blurs of 6 mm");
    assert!(readme.contains(&of_readme), "README.md: {of_readme}");

    for (document, text, list) in [
        ("README.md", &readme, 0),
        ("docs/reading.md", &reading, 0),
        ("docs/reading.md", &reading, 1),
    ] {
        let (_, number, measured) = &sound[list];
        let none = (percent(&measured[..4]) * number / 100.0).round();
        let sentence = format!("{none} of {number} ");
        let interval = format!(
            "{} to {} %",
            percent(&measured[6..10]),
            percent(&measured[14..18])
        );
        let said = text
            .lines()
            .any(|line| line.contains(&sentence) && line.contains(&interval));
        assert!(said, "{document}: {sentence}, {interval}");
    }
}
