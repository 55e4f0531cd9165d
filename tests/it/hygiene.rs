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

/// A row of a table of the study: its first cells, the number of lesions or heads, and shares of these with their intervals.
#[derive(Clone)]
struct RowOfStudy {
    what: String,
    number: f64,
    shares: Vec<String>,
}

/// A share that begins a text, in percent.
fn percent(text: &str) -> u32 {
    (text[..4].parse::<f64>().expect("a share") * 100.0).round() as u32
}

/// The rows of the table after an anchor of the study.
fn rows_of_study(anchor: &str) -> Vec<RowOfStudy> {
    let study = read("lab/docs/study.md").replace('*', "");
    let (_, after) = study
        .split_once(&format!("<a id=\"{anchor}\"></a>"))
        .unwrap_or_else(|| panic!("the study has no {anchor}"));
    let table = after.trim_start().lines().skip(2);
    let rows = table.take_while(|line| line.starts_with('|')).map(|line| {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let number = cells.iter().position(|cell| cell.parse::<f64>().is_ok());
        let number = number.expect("a number");
        let shares = cells[number..].iter().filter(|cell| cell.contains('('));
        RowOfStudy {
            what: cells[..number].join(" "),
            number: cells[number].parse().expect("a number"),
            shares: shares.map(ToString::to_string).collect(),
        }
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

/// What documents and page state about simulated lesions: ranges over all simulators and the independent checks.
const STATED: [&str; 18] = [
    "README.md: {blur} of the simulated blurs of 6 mm",
    "docs/reading.md: | blurs of 6 mm: {blur}; blurs of 4 mm: {small};",
    "docs/reading.md: mixtures of blur, thickening and changed intensities: {mixture};",
    "docs/reading.md: faint transmantle lesions: {transmantle};",
    "docs/reading.md: | thickenings of 2 mm: {thick} |",
    "docs/reading.md: (blurs of 6 mm: {smoothed})",
    "docs/reading.md: {kept} of them stood out",
    "docs/reading.md: {fifth} of the thickenings come before its fifth false mark",
    "web/src/words.en.json: {not blur} of blurs of 6 mm radius, {not small} of blurs of 4 mm, {not mixture} of mixed signs",
    "web/src/words.en.json: of simulated thickenings of 2 mm, {not thick} stay below",
    "web/src/words.en.json: {number} synthetic blurs of 6 mm radius, one in a head, from three simulators, {five} were among the first five places",
    "web/src/words.en.json: {number} synthetic thickenings of 2 mm in five heads, from three simulators, the thickening came before the fifth normal place in {fifth}",
    "web/src/words.en.json: and before the 20th in {twentieth}.",
    "web/src/words.pt-BR.json: {not blur} dos borramentos de 6 mm de raio, {not small} dos de 4 mm, {not mixture} das de sinais",
    "web/src/words.pt-BR.json: dos espessamentos simulados de 2 mm, {not thick} ficam abaixo",
    "web/src/words.pt-BR.json: {number} borramentos sintéticos de 6 mm de raio, um por cabeça, de três simuladores, {five} estavam entre os cinco primeiros lugares",
    "web/src/words.pt-BR.json: {number} espessamentos sintéticos de 2 mm em cinco cabeças, de três simuladores, o espessamento veio antes do quinto local normal em {fifth}",
    "web/src/words.pt-BR.json: e antes do 20º em {twentieth}.",
];

#[test]
fn documents_and_page_state_the_shares_that_the_study_measured() {
    let sound = rows_of_study("sound");
    let lesions = ["shares", "texture"].map(rows_of_study).concat();
    for row in sound.iter().chain(&lesions) {
        assert!(!row.shares.is_empty(), "{}", row.what);
        for measured in &row.shares {
            let count = (f64::from(percent(measured)) / 100.0 * row.number).round();
            let [low, high] = interval(count, row.number);
            let share = count / row.number;
            let written = format!("{share:.2} ({:.2} to {high:.2})", low.abs());
            assert_eq!(
                measured, &written,
                "{}: {count} of {}",
                row.what, row.number
            );
        }
    }

    // The first check has one row for the limit.
    let study = read("lab/docs/study.md");
    let by_limit = study.lines().find(|line| line.starts_with("| **2.25**"));
    let cells = by_limit.expect("the limit").split(['|', '*']);
    let of_first = cells.filter_map(|cell| cell.strip_suffix(" %")?.parse().ok());
    let of_first: Vec<u32> = of_first.collect();
    // The rows that begin so, the number of the share (the last is that of those that stood out), and that of the first check.
    let last = usize::MAX;
    let ranges = [
        ("blur", "blur `blur`/blur, 6 mm", last, Some(0)),
        ("small", "blur, 4 mm", last, Some(1)),
        ("mixture", "mixture `blur`/mixture,", last, Some(3)),
        ("transmantle", "transmantle `blur`", last, Some(4)),
        ("thick", "thickening `thickness`/thickening in", last, None),
        (
            "smoothed",
            "blur `blur` displaced/blur `blur` painted/blur, 6 mm, Gaussian",
            last,
            Some(0),
        ),
        (
            "kept",
            "blur `blur` widened/blur, 6 mm, texture kept",
            last,
            None,
        ),
        ("five", "blur `blur`", 1, None),
        ("fifth", "thickening `thickness`", 1, None),
        ("twentieth", "thickening `thickness`", 2, None),
    ];
    let rows_of = |begin: &str| {
        let rows: Vec<&RowOfStudy> = lesions
            .iter()
            .filter(|row| row.what.starts_with(begin))
            .collect();
        assert!(!rows.is_empty(), "{begin}");
        rows
    };
    let number: f64 = rows_of("blur `blur`").iter().map(|row| row.number).sum();
    for stated in STATED {
        let (file, sentence) = stated.split_once(": ").expect("a file");
        let mut sentence = sentence.replace("{number}", &number.to_string());
        for (name, begins, share, first) in ranges {
            let rows = begins.split('/').flat_map(rows_of);
            let share = |row: &RowOfStudy| row.shares.get(share).or(row.shares.last()).cloned();
            let shares = rows.map(|row| percent(&share(row).expect("a share")));
            let shares: Vec<u32> = shares.chain(first.map(|at| of_first[at])).collect();
            let (least, most) = (shares.iter().min().unwrap(), shares.iter().max().unwrap());
            let to = if file.contains("pt-BR") { "a" } else { "to" };
            let of_those = format!("{least} {to} {most} %");
            let of_others = format!("{} {to} {} %", 100 - most, 100 - least);
            sentence = sentence.replace(&format!("{{{name}}}"), &of_those);
            sentence = sentence.replace(&format!("{{not {name}}}"), &of_others);
        }
        assert!(read(file).contains(&sentence), "{file}: {sentence}");
    }

    for (document, list) in [
        ("README.md", 0),
        ("docs/reading.md", 0),
        ("docs/reading.md", 1),
    ] {
        let (number, measured) = (sound[list].number, &sound[list].shares[0]);
        let none = (f64::from(percent(measured)) / 100.0 * number).round();
        let sentence = format!("{none} of {number} ");
        let interval = format!(
            "{} to {} %",
            percent(&measured[6..10]),
            percent(&measured[14..18])
        );
        let said = (read(document).lines())
            .any(|line| line.contains(&sentence) && line.contains(&interval));
        assert!(said, "{document}: {sentence}, {interval}");
    }
}

/// No machine is booted here: of the unit, the lines are read that keep the service alive and confined.
#[test]
fn the_unit_starts_again_waits_for_its_disk_and_is_confined() {
    let unit = read("scripts/debian/isocortex.service");
    for line in [
        "RequiresMountsFor=/var/lib/isocortex /var/log/isocortex",
        "StartLimitIntervalSec=0",
        "Restart=on-failure",
        "RestartSec=5",
        "UMask=0077",
        "ProtectProc=invisible",
    ] {
        assert!(unit.lines().any(|it| it == line), "{line}");
    }
    let filter = unit
        .lines()
        .find(|line| line.starts_with("SystemCallFilter="));
    // A filter alone would take from the server what confines its own processes.
    for call in ["@system-service", "landlock_restrict_self", "seccomp"] {
        assert!(filter.is_some_and(|line| line.contains(call)), "{call}");
    }
}
