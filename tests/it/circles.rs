//! No module imports another that imports it, directly or by way of others, within a crate.
//!
//! A module is a file; what it imports is resolved to the file that defines it, through `pub use`. A module may name what its parent
//! re-exports, and its parent may re-export it: that is no import.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The path of a module within its crate, without `crate`.
type Module = Vec<String>;

/// Names by module, and where each is defined: `pub use` of something else, or here.
#[derive(Default)]
struct Crate {
    modules: BTreeMap<Module, String>,
    /// What a module re-exports under a name: the module it comes from and its name there; `None` if another crate defines it.
    exports: BTreeMap<(Module, String), Option<(Module, String)>>,
}

/// Modules that are there for tests.
const FOR_TESTS: [&str; 3] = ["tests", "testing", "conformance"];

/// The code without what its strings hold. Of raw strings enough goes, too, as long as their quotes come in pairs.
fn without_strings(code: &str) -> String {
    let mut kept = String::new();
    let mut letters = code
        .replace("'\"'", "' '")
        .chars()
        .collect::<Vec<_>>()
        .into_iter();
    let mut is_inside = false;
    while let Some(letter) = letters.next() {
        match (letter, is_inside) {
            ('"', _) => is_inside = !is_inside,
            ('\\', true) => drop(letters.next()),
            (_, true) => {}
            (letter, false) => kept.push(letter),
        }
    }
    kept
}

/// The text without comments, strings, and the module of the tests.
fn code_of(file: &Path) -> String {
    let text = std::fs::read_to_string(file).expect("a source file");
    let end = text.find("\nmod tests {").unwrap_or(text.len());
    let lines = text[..end].lines();
    let code = lines.filter(|line| !line.trim_start().starts_with("//"));
    without_strings(&code.collect::<Vec<_>>().join("\n"))
}

fn source_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            source_files(&path, found);
        } else if path.extension().is_some_and(|kind| kind == "rs") {
            found.push(path);
        }
    }
}

fn module_of(root: &Path, file: &Path) -> Module {
    let inside = file.strip_prefix(root).expect("a file of the crate");
    let inside = inside.with_extension("");
    let parts = inside
        .iter()
        .map(|part| part.to_string_lossy().into_owned());
    parts
        .filter(|part| !["lib", "main", "mod"].contains(&part.as_str()))
        .collect()
}

/// The paths of a `use`, with the names that it brings: `a::{b, c::D}` → `a::b`, `a::c::D`.
fn flattened(tree: &str, prefix: &[String], found: &mut Vec<Vec<String>>) {
    let tree = tree.trim();
    let Some(open) = tree.find('{') else {
        let path = tree.split(" as ").next().unwrap_or_default();
        let parts = path.split("::").map(|part| part.trim().to_owned());
        found.push(prefix.iter().cloned().chain(parts).collect());
        return;
    };
    let above = tree[..open].trim().trim_end_matches("::").split("::");
    let above = above
        .map(|part| part.trim().to_owned())
        .filter(|part| !part.is_empty());
    let prefix: Vec<_> = prefix.iter().cloned().chain(above).collect();
    let inner = &tree[open + 1..tree.rfind('}').expect("a closed brace")];
    let (mut depth, mut start) = (0, 0);
    for (at, letter) in inner.char_indices().chain([(inner.len(), ',')]) {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                let part = &inner[start..at];
                if !part.trim().is_empty() {
                    flattened(part, &prefix, found);
                }
                start = at + 1;
            }
            _ => {}
        }
    }
}

/// Every path that a text names from `crate`, `self` or `super`, and whether it is re-exported.
fn named_paths(code: &str) -> Vec<(Vec<String>, bool)> {
    let mut found = Vec::new();
    let mut rest = String::new();
    let mut statements = code.split_inclusive(';');
    for statement in &mut statements {
        let at = statement.rfind("use ").filter(|&at| {
            let before = statement[..at].trim_end();
            let before = before.strip_suffix(')').map_or(before, |open| {
                open.rfind("pub(").map_or(before, |at| &open[..at])
            });
            before.is_empty() || before.ends_with([';', '}', ']']) || before.ends_with("pub")
        });
        let Some(at) = at else {
            rest.push_str(statement);
            continue;
        };
        rest.push_str(&statement[..at]);
        let is_exported = statement[..at].trim_end().ends_with("pub");
        let mut paths = Vec::new();
        flattened(statement[at + 4..].trim_end_matches(';'), &[], &mut paths);
        found.extend(paths.into_iter().map(|path| (path, is_exported)));
    }
    // What is named in full without a `use`.
    for start in ["crate::", "super::"] {
        for (at, _) in rest.match_indices(start) {
            let is_path = |letter: char| letter.is_alphanumeric() || letter == '_' || letter == ':';
            let end = rest[at..].find(|letter| !is_path(letter));
            let path = &rest[at..end.map_or(rest.len(), |end| at + end)];
            let parts = path.trim_end_matches(':').split("::").map(str::to_owned);
            found.push((parts.collect(), false));
        }
    }
    found
}

impl Crate {
    fn read(root: &Path) -> Self {
        let mut files = Vec::new();
        source_files(root, &mut files);
        let is_test = |file: &PathBuf| {
            let module = module_of(root, file);
            module.iter().any(|part| FOR_TESTS.contains(&part.as_str()))
        };
        files.retain(|file| !is_test(file));
        let modules = files
            .iter()
            .map(|file| (module_of(root, file), code_of(file)));
        let mut this = Self {
            modules: modules.collect(),
            ..Self::default()
        };
        for (module, code) in &this.modules {
            for (path, is_exported) in named_paths(code) {
                if let Some(name) = path.last().filter(|_| is_exported) {
                    let key = (module.clone(), name.clone());
                    this.exports.insert(key, this.split(module, &path));
                }
            }
        }
        this
    }

    /// The module and the name in it that a path means, seen from a module; `None` for a path of another crate, or of the tests.
    fn split(&self, from: &Module, path: &[String]) -> Option<(Module, String)> {
        if path.iter().any(|part| FOR_TESTS.contains(&part.as_str())) {
            return None;
        }
        let mut at: Module = match path.first()?.as_str() {
            "crate" => Vec::new(),
            "self" => from.clone(),
            "super" => from[..from.len().checked_sub(1)?].to_vec(),
            child => {
                let inner: Module = from.iter().cloned().chain([child.to_owned()]).collect();
                self.modules.get(&inner)?;
                inner
            }
        };
        let mut rest = path[1..].iter().peekable();
        while rest.next_if(|part| *part == "super").is_some() {
            at.pop();
        }
        while let Some(part) = rest.peek() {
            let inner: Module = at.iter().cloned().chain([(*part).clone()]).collect();
            if !self.modules.contains_key(&inner) {
                break;
            }
            at = inner;
            rest.next();
        }
        let name = rest.next().cloned().unwrap_or_else(|| "self".to_owned());
        Some((at, name))
    }

    /// The module that defines what is re-exported under a name; `None` if it is another crate's.
    fn origin(&self, mut at: (Module, String)) -> Option<Module> {
        while let Some(next) = self.exports.get(&at) {
            at = next.clone()?;
        }
        Some(at.0)
    }

    /// Which modules each module imports from.
    fn imports(&self) -> BTreeMap<&Module, BTreeSet<Module>> {
        let of = |(module, code): (&Module, &String)| {
            let paths = named_paths(code).into_iter();
            let used = paths.filter(|(_, is_exported)| !is_exported);
            let targets = used.filter_map(|(path, _)| self.split(module, &path));
            let mut targets: BTreeSet<_> = targets.filter_map(|at| self.origin(at)).collect();
            targets.remove(module);
            targets
        };
        self.modules
            .iter()
            .map(|entry| (entry.0, of(entry)))
            .collect()
    }

    /// The modules on circles: those that reach themselves and each other.
    fn circles(&self) -> Vec<Vec<String>> {
        let imports = self.imports();
        let reached = |from: &Module| {
            let mut reached = BTreeSet::new();
            let mut open: Vec<&Module> = vec![from];
            while let Some(next) = open.pop() {
                for target in imports.get(next).into_iter().flatten() {
                    if reached.insert(target) {
                        open.push(target);
                    }
                }
            }
            reached
        };
        let reach: BTreeMap<_, _> = imports
            .keys()
            .map(|module| (*module, reached(module)))
            .collect();
        let mut seen = BTreeSet::new();
        let mut circles = Vec::new();
        for (module, targets) in &reach {
            if !targets.contains(module) || seen.contains(module) {
                continue;
            }
            let circle: Vec<_> = targets
                .iter()
                .filter(|target| {
                    reach
                        .get(**target)
                        .is_some_and(|back| back.contains(module))
                })
                .collect();
            circles.push(circle.iter().map(|module| module.join("::")).collect());
            seen.extend(circle.into_iter().copied());
        }
        circles
    }
}

#[test]
fn no_modules_of_a_crate_import_each_other() {
    let server = Path::new(env!("CARGO_MANIFEST_DIR")).join("../server");
    let mut found = Vec::new();
    for entry in std::fs::read_dir(&server).expect("the crates") {
        let source = entry.expect("an entry").path().join("src");
        if source.is_dir() {
            let name = source.strip_prefix(&server).expect("a crate").display();
            for circle in Crate::read(&source).circles() {
                found.push(format!("{name}: {}", circle.join(" ↔ ")));
            }
        }
    }
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn the_paths_of_an_import_are_found() {
    let code = "const A: &str = \"; use x::{\"; use a::b;\npub use self::c::{D, e::{F, G as H}};\nfn f() { crate::g::h(); }\n";
    let found: Vec<_> = named_paths(&without_strings(code))
        .into_iter()
        .map(|(path, is_exported)| (path.join("::"), is_exported))
        .collect();
    let expected = [
        ("a::b", false),
        ("self::c::D", true),
        ("self::c::e::F", true),
        ("self::c::e::G", true),
        ("crate::g::h", false),
    ];
    assert_eq!(
        found,
        expected.map(|(path, is_exported)| (path.to_owned(), is_exported))
    );
}
