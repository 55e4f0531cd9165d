#!/usr/bin/env python3
"""Writes what the program is made of, as CycloneDX 1.5 JSON: every crate that is linked into `isocortex`, as Cargo.lock has it.

    scripts/sbom.py [FILE [TARGET]]         by default target/isocortex.cdx.json for x86_64-unknown-linux-gnu
    scripts/sbom.py --licences FILE [TARGET]    instead, the texts of their licences, which go with the program

Nothing is fetched that a build would not fetch. Two runs on one Cargo.lock write the same bytes.
"""

import json
import subprocess
import sys
import tomllib
import uuid
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NAMES_OF_LICENCES = ("LICENSE", "LICENCE", "COPYING", "COPYRIGHT", "NOTICE", "UNLICENSE")
TARGET = "x86_64-unknown-linux-gnu"


def linked(metadata):
    """The ids of the packages that `isocortex` links, and on which of them each depends."""
    names = {package["id"]: package["name"] for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    root = next(id for id in metadata["workspace_members"] if names[id] == "isocortex")
    found, waiting = {}, [root]
    while waiting:
        id = waiting.pop()
        if id in found:
            continue
        # Neither those of tests alone (`dev`) nor those of build scripts alone (`build`) are in the program.
        needed = [dep["pkg"] for dep in nodes[id]["deps"] if any(kind["kind"] is None for kind in dep["dep_kinds"])]
        found[id] = needed
        waiting += needed
    return root, found


def reference(package):
    """Its name in the list: the folder of the checkout says nothing about the program."""
    return f"{package['name']}@{package['version']}"


def component(package, checksums):
    found = {
        "type": "library",
        "bom-ref": reference(package),
        "name": package["name"],
        "version": package["version"],
    }
    if package["license"]:
        found["licenses"] = [{"expression": package["license"].replace("/", " OR ")}]
    if package["source"]:
        found["purl"] = f"pkg:cargo/{package['name']}@{package['version']}"
        checksum = checksums.get((package["name"], package["version"]))
        if checksum:
            found["hashes"] = [{"alg": "SHA-256", "content": checksum}]
    return found


def licences(packages):
    """The texts of the licences of packages, each once, after the packages that come with it; last the packages that have none."""
    of_text, without = {}, []
    for package in packages:
        folder = Path(package["manifest_path"]).parent
        named = [path for path in folder.iterdir() if path.is_file() and path.name.upper().startswith(NAMES_OF_LICENCES)]
        name = f"{package['name']} {package['version']} ({package['license']})"
        if not named:
            without.append(name)
        for path in sorted(named):
            text = "\n".join(line.rstrip() for line in path.read_text(encoding="utf-8", errors="replace").splitlines()).strip()
            of_text.setdefault(text, set()).add(name)
    rule = "=" * 100
    parts = [f"{chr(10).join(sorted(names))}\n\n{text}\n" for text, names in sorted(of_text.items(), key=lambda each: sorted(each[1]))]
    if without:
        parts.append("Without a text of their own, under the licences that they name:\n" + "\n".join(sorted(without)) + "\n")
    return f"\n{rule}\n".join(["The licences of the crates that the program is made of.\n", *parts])


def main():
    arguments = sys.argv[1:]
    wants_licences = arguments[:1] == ["--licences"]
    arguments = arguments[1:] if wants_licences else arguments
    if len(arguments) > 2 or arguments[:1] == ["--help"] or (wants_licences and not arguments):
        sys.exit(__doc__)
    output = Path(arguments[0]) if arguments else ROOT / "target" / "isocortex.cdx.json"
    target = arguments[1] if arguments[1:] else TARGET
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", target]
    metadata = json.loads(subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout)
    lock = (ROOT / "Cargo.lock").read_text(encoding="utf-8")
    checksums = {(one["name"], one["version"]): one.get("checksum") for one in tomllib.loads(lock)["package"]}
    packages = {package["id"]: package for package in metadata["packages"]}
    root, found = linked(metadata)
    output.parent.mkdir(parents=True, exist_ok=True)
    if wants_licences:
        others = [packages[id] for id in found if packages[id]["source"]]
        output.write_text(licences(others), encoding="utf-8")
        print(f"{output}: {len(others)} crates")
        return
    program = component(packages[root], checksums) | {"type": "application"}
    components = [component(packages[id], checksums) for id in found if id != root]
    bom = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, lock)}",
        "version": 1,
        "metadata": {"component": program},
        "components": sorted(components, key=lambda one: (one["name"], one["version"])),
        "dependencies": sorted(
            (
                {"ref": reference(packages[id]), "dependsOn": sorted({reference(packages[dep]) for dep in deps})}
                for id, deps in found.items()
            ),
            key=lambda one: one["ref"],
        ),
    }
    output.write_text(json.dumps(bom, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    print(f"{output}: {len(components)} crates")


main()
