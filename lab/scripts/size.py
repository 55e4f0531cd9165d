#!/usr/bin/env python3
"""Prints how large the project is at a commit: lines of code, of comments and of tests of each crate, none of them blank; words of documents;
structs, public methods of Store and Cases, routes and crates locked.

    lab/scripts/size.py [COMMIT]

Tests are modules with `#[cfg(test)]` or a feature for tests, whether in a file or as one, files and folders named `tests`, benches and examples. A comment is a line that begins with `//`.
"""

import re
import subprocess
import sys
from collections import Counter, defaultdict

FOR_TESTS = r"#\[cfg\((?:any\()?(?:test|feature = \"(?:testing|conformance)\").*\)\]\n"
commit = sys.argv[1] if len(sys.argv) > 1 else "HEAD"


def git(*words):
    return subprocess.run(["git", *words], check=True, capture_output=True, text=True).stdout


def crate_of(path):
    parts = path.split("/")
    return parts[1] if parts[0] == "server" else parts[0]


def is_test_file(path):
    return re.search(r"(^|/)(tests|benches|examples)(/|\.rs$)", path) is not None


def test_modules(path, lines):
    """The files, without their ending, of the modules that a file declares for tests alone."""
    folder, _, name = path.removesuffix(".rs").rpartition("/")
    if name not in ("lib", "main", "mod"):
        folder += "/" + name
    text = "\n".join(lines)
    return [f"{folder}/{module}" for module in re.findall(FOR_TESTS + r"(?:#\[.*\]\n)*(?:pub(?:\(.*\))? )?mod (\w+);", text)]


def test_lines(lines):
    """The numbers of the lines in modules for tests, which the formatter closes at the indentation of their beginning."""
    within = set()
    number = 0
    while number < len(lines):
        if lines[number].strip() == "#[cfg(test)]":
            start = number
            indent = re.match(r" *", lines[number]).group()
            number += 1
            while number < len(lines) and lines[number].strip().startswith("#["):
                number += 1
            if number < len(lines) and lines[number].rstrip().endswith("{"):
                while number < len(lines) and lines[number].rstrip() != indent + "}":
                    number += 1
            within.update(range(start, number + 1))
        number += 1
    return within


sources = {}
for path in git("ls-tree", "-r", "--name-only", commit).splitlines():
    if path.endswith(".rs"):
        sources[path] = git("show", f"{commit}:{path}").splitlines()
for_tests = tuple(module for path, lines in sources.items() for module in test_modules(path, lines))
crates = defaultdict(Counter)
product = []
for path, lines in sources.items():
    is_for_tests = is_test_file(path) or any(path == f"{module}.rs" or path.startswith(f"{module}/") for module in for_tests)
    tests = range(len(lines)) if is_for_tests else test_lines(lines)
    for number, line in enumerate(lines):
        if not line.strip():
            continue
        kind = "tests" if number in tests else "comments" if line.strip().startswith("//") else "code"
        crates[crate_of(path)][kind] += 1
        if kind == "code" and path.startswith("server/"):
            product.append(line)

total = Counter()
print("| crate | code | comments | tests |\n|---|---|---|---|")
for crate, counts in sorted(crates.items()):
    total += counts
    print(f"| {crate} | {counts['code']:,} | {counts['comments']:,} | {counts['tests']:,} |")
print(f"| **all** | {total['code']:,} | {total['comments']:,} | {total['tests']:,} |")

words = Counter()
for path in git("ls-tree", "-r", "--name-only", commit).splitlines():
    if path.endswith(".md"):
        words[path.rpartition("/")[0] or "."] += len(git("show", f"{commit}:{path}").split())
print("\n| documents in | words |\n|---|---|")
for folder, count in sorted(words.items()):
    print(f"| {folder} | {count:,} |")


def count(pattern, text):
    return len(re.findall(pattern, text, re.MULTILINE))


def public_methods(name):
    """The public functions in the blocks `impl NAME {`."""
    blocks = re.findall(rf"^impl {name} \{{\n(.*?)^\}}", "\n".join(product), re.MULTILINE | re.DOTALL)
    return sum(count(r"^    pub (?:async )?fn ", block) for block in blocks)


def text_of(path):
    return git("show", f"{commit}:{path}")


code = "\n".join(product)
scripts = [path for path in git("ls-tree", "-r", "--name-only", commit, "web/src").splitlines() if path.endswith((".ts", ".tsx"))]
print("\n| | count |\n|---|---|")
for name, number in [
    ("structs of the server", count(r"^\s*(?:pub(?:\(.*?\))? )?struct ", code)),
    ("enums of the server", count(r"^\s*(?:pub(?:\(.*?\))? )?enum ", code)),
    ("public methods of `Store`", public_methods("Store")),
    ("public methods of `Cases`", public_methods("Cases")),
    ("operations of the HTTP interface", count(r"^#\[utoipa::path\(", code)),
    ("crates locked", count(r"^name = ", text_of("Cargo.lock"))),
    ("lines of TypeScript in web/src", sum(len([line for line in text_of(path).splitlines() if line.strip()]) for path in scripts)),
]:
    print(f"| {name} | {number:,} |")
