//! The modules of a crate use each other in one direction. A module and those below it are not compared, nor is what only tests use;
//! a method that one module adds to a type of another is not seen.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// By the path of each module, such as `sql::cases`: its text without comments and unit tests.
type Texts = BTreeMap<String, String>;

fn read(folder: &Path, module: &str, texts: &mut Texts) {
    for entry in std::fs::read_dir(folder).expect("the folder can be listed") {
        let path = entry.expect("the entry can be read").path();
        let name = path.file_stem().expect("a name").to_string_lossy();
        let name = match &*name {
            "lib" | "main" | "mod" => module.to_owned(),
            name => joined(module, name),
        };
        if name.contains("test") || name.ends_with("conformance") {
            continue;
        } else if path.is_dir() {
            read(&path, &name, texts);
        } else if let Ok(text) = std::fs::read_to_string(&path) {
            let text = text.split("mod tests {").next().unwrap_or("");
            let lines = text.lines().filter(|line| !line.trim().starts_with("//"));
            texts.insert(name, lines.collect::<Vec<_>>().join("\n"));
        }
    }
}

fn joined(module: &str, rest: &str) -> String {
    format!("{module}::{rest}").trim_matches(':').to_owned()
}

/// The paths in a tree of `use`: of `a::{b, c as d}` these are `a::b` and `a::c@d`.
fn paths(tree: &str) -> Vec<String> {
    let (mut found, mut outer, mut path) = (Vec::new(), vec![String::new()], String::new());
    for letter in tree.replace(" as ", "@").chars().chain([',']) {
        match letter {
            '{' => outer.push(path.clone()),
            ',' | '}' => {
                found.push(path);
                outer.truncate(outer.len().saturating_sub(usize::from(letter == '}')));
                path = outer.last().cloned().unwrap_or_default();
            }
            letter => path.extend(Some(letter).filter(|letter| !letter.is_whitespace())),
        }
    }
    found.retain(|path| !path.is_empty() && !path.ends_with("::"));
    found
}

/// A path in a module from the root of the crate; `None` if it begins elsewhere.
fn absolute(texts: &Texts, module: &str, path: &str) -> Option<String> {
    let parent = module.rsplit_once("::").map_or("", |(parent, _)| parent);
    match path.split_once("::").unwrap_or((path, "")) {
        ("crate", rest) => Some(rest.to_owned()),
        ("self", rest) => Some(joined(module, rest)),
        ("super", rest) if rest.starts_with("super::") => absolute(texts, parent, rest),
        ("super", rest) => Some(joined(parent, rest)),
        (first, _) => (texts.contains_key(&joined(module, first))).then(|| joined(module, path)),
    }
}

/// The module of the item that a path names, whichever modules pass it on by a name.
fn home(texts: &Texts, names: &BTreeMap<String, String>, mut path: String) -> String {
    let mut module = String::new();
    while module != path {
        let rest = path[module.len()..].trim_start_matches(':');
        let name = joined(&module, rest.split("::").next().unwrap_or(""));
        match names.get(&name) {
            _ if texts.contains_key(&name) => module = name,
            Some(passed) => {
                path = joined(passed, &path[name.len()..]);
                module.clear();
            }
            None => break,
        }
    }
    module
}

/// Which module uses which, as far as the second one needs the first one.
fn circle(texts: &Texts) -> BTreeSet<(String, String)> {
    let (mut used, mut names) = (Vec::new(), BTreeMap::new());
    for (module, text) in texts {
        for statement in text.split(';') {
            let (before, tree) = statement.rsplit_once("use ").unwrap_or((statement, ""));
            let start = before.lines().last().unwrap_or("").trim();
            let is_use = start.is_empty() || start.starts_with("pub");
            for path in paths(if is_use { tree } else { "" }) {
                let (path, alias) = path.split_once('@').unwrap_or((&path, ""));
                let path = path.trim_end_matches("::self");
                let name = [alias, path.rsplit("::").next().unwrap_or("")];
                let name = name.into_iter().find(|name| !name.is_empty());
                if let Some(path) = absolute(texts, module, path) {
                    names.insert(joined(module, name.unwrap_or("")), path.clone());
                    used.push((module, path));
                }
            }
            let code = if is_use { before } else { statement };
            let words =
                code.split(|letter: char| !letter.is_alphanumeric() && !"_:".contains(letter));
            for word in words.filter(|word| word.contains("::")) {
                let path = absolute(texts, module, word).unwrap_or_else(|| joined(module, word));
                used.push((module, path));
            }
        }
    }
    let edges = used.into_iter();
    let edges = edges.map(|(module, path)| (module.clone(), home(texts, &names, path)));
    let is_below = |one: &str, other: &str| {
        other.is_empty() || one == other || one.starts_with(&format!("{other}::"))
    };
    let edges: BTreeSet<_> = edges
        .filter(|(one, other)| !is_below(one, other) && !is_below(other, one))
        .collect();
    let is_back =
        |(one, other): &&(String, String)| leads(&edges, other, one, &mut BTreeSet::new());
    edges.iter().filter(is_back).cloned().collect()
}

fn leads<'e>(
    edges: &'e BTreeSet<(String, String)>,
    from: &'e str,
    to: &str,
    seen: &mut BTreeSet<&'e str>,
) -> bool {
    let mut next = edges.iter().filter(|(one, _)| one == from);
    seen.insert(from) && next.any(|(_, next)| next == to || leads(edges, next, to, seen))
}

#[test]
fn no_modules_of_a_crate_use_each_other_in_a_circle() {
    let server = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../server"));
    for entry in std::fs::read_dir(server).expect("the folder can be listed") {
        let (folder, mut texts) = (entry.expect("the entry can be read").path(), Texts::new());
        read(&folder.join("src"), "", &mut texts);
        assert_eq!(circle(&texts), BTreeSet::new(), "{}", folder.display());
    }
}

#[test]
fn a_circle_is_found_through_what_passes_items_on() {
    let edges = |of_a: &str| {
        let texts = [
            (
                "",
                "mod a; mod b; mod c; pub use self::b::{inner::B as Other, C};",
            ),
            ("a", of_a),
            ("b", "pub(crate) mod inner; pub struct C;"),
            ("b::inner", "pub struct B(super::super::c::D);"),
            ("c", "use super::a; pub struct D(a::A);"),
        ];
        let texts = texts.map(|(module, text)| (module.to_owned(), text.to_owned()));
        let edges = circle(&texts.into()).into_iter();
        edges
            .map(|(one, other)| format!("{one}-{other}"))
            .collect::<Vec<_>>()
    };
    let circle = edges("use crate::Other; pub struct A;");
    assert_eq!(circle, ["a-b::inner", "b::inner-c", "c-a"]);
    assert!(edges("use crate::C; pub struct A;").is_empty());
}
