#!/usr/bin/env python3
"""Checks the locked crates against advisories of the RustSec database, without a network.

    scripts/advisories.py DATABASE [LOCK]    a checkout of github.com/RustSec/advisory-db, or a .tar.gz of it, or a folder with that;
                                             and a file of locked crates, by default Cargo.lock

An advisory that `[advisories] ignore` of deny.toml waives is listed with its reason. The exit status is 1 if another one applies, or if
a waiver applies to nothing any more.
"""

import re
import sys
import tarfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FRONT_MATTER = re.compile(r"\A```toml\n(.*?)\n```", re.DOTALL)


def texts(place):
    """The advisories about crates, as they are written."""
    if place.is_dir() and not (place / "crates").is_dir():
        archives = sorted(place.glob("*.tar.gz"))
        if not archives:
            sys.exit(f"{place} has neither `crates` nor a .tar.gz")
        place = archives[-1]
    if place.is_dir():
        for path in sorted((place / "crates").rglob("*.md")):
            yield path.read_text(encoding="utf-8")
        return
    with tarfile.open(place) as archive:
        for member in archive:
            if member.isfile() and member.name.endswith(".md") and "crates/" in member.name:
                yield archive.extractfile(member).read().decode()


def precedence(text):
    """What orders versions: SemVer 2.0, section 11."""
    core, _, suffix = text.partition("+")[0].partition("-")
    numbers = [int(number) for number in core.split(".")]
    words = [(0, int(word), "") if word.isdigit() else (1, 0, word) for word in suffix.split(".")] if suffix else []
    return (numbers + [0, 0, 0])[:3], not suffix, words


def meets(version, requirement):
    """Whether a version meets a requirement in the words of Cargo, such as `>=1.2.3, <2`."""
    return all(meets_one(version, part.strip()) for part in requirement.split(","))


def meets_one(version, part):
    sign, wanted = re.match(r"(>=|<=|>|<|=|\^|~|)\s*(\S+)", part).groups()
    if wanted == "*":
        return True
    mine, limit = precedence(version), precedence(wanted)
    if sign in (">=", ">", "<=", "<"):
        return {">=": mine >= limit, ">": mine > limit, "<=": mine <= limit, "<": mine < limit}[sign]
    given = len(wanted.split("-")[0].split("."))
    if sign == "=":
        return mine[0][:given] == limit[0][:given] and (given < 3 or mine == limit)
    # The numbers that must not change: for `~` all but the last, otherwise up to the first that is not zero.
    if sign == "~":
        fixed = max(1, min(2, given))
    else:
        fixed = next((at + 1 for at, number in enumerate(limit[0][:given]) if number), given)
    return mine >= limit and mine[0][:fixed] == limit[0][:fixed]


def applies(advisory, version):
    fixed = advisory.get("versions", {})
    safe = fixed.get("patched", []) + fixed.get("unaffected", [])
    return "withdrawn" not in advisory["advisory"] and not any(meets(version, requirement) for requirement in safe)


def check_the_rules():
    """The comparison of versions decides everything, so it is tried each time."""
    for version, requirement, answer in [
        ("1.2.3", ">=1.2.3", True), ("1.2.2", ">=1.2.3", False), ("1.2.3-rc.2", ">=1.2.3", False), ("1.2.3-rc.10", ">1.2.3-rc.9", True),
        ("0.3.9", "^0.3.5", True), ("0.4.0", "^0.3.5", False), ("2.0.0", "1.5", False), ("1.9.0", "1.5", True), ("0.0.4", "^0.0.3", False),
        ("1.4.9", "~1.4.2", True), ("1.5.0", "~1.4.2", False), ("1.5.0", ">=1.4, <1.5.1", True), ("1.5.1", ">=1.4, <1.5.1", False),
        ("1.2.9", "=1.2.3", False), ("1.2.3+extra", "=1.2.3", True),
    ]:
        assert meets(version, requirement) == answer, (version, requirement)


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    check_the_rules()
    locked = tomllib.loads((ROOT / (sys.argv[2:] or ["Cargo.lock"])[0]).read_text())["package"]
    versions = {}
    for package in locked:
        versions.setdefault(package["name"], []).append(package["version"])
    waivers = tomllib.loads((ROOT / "deny.toml").read_text())["advisories"]["ignore"]
    waivers = {waiver["id"]: waiver["reason"] for waiver in waivers}
    known, waived, found = 0, set(), 0
    for text in texts(Path(sys.argv[1])):
        match = FRONT_MATTER.match(text)
        if not match:
            continue
        known += 1
        advisory = tomllib.loads(match[1])
        about = advisory["advisory"]
        for version in versions.get(about["package"], []):
            if not applies(advisory, version):
                continue
            title = re.search(r"^# (.*)", text, re.MULTILINE)
            line = f"{about['id']} {about['package']} {version}: {about.get('informational', 'vulnerability')}: {title[1] if title else ''}"
            if about["id"] in waivers:
                waived.add(about["id"])
                print(f"waived: {line} ({waivers[about['id']]})")
            else:
                found += 1
                print(f"APPLIES: {line}")
    if known == 0:
        sys.exit(f"no advisories in {sys.argv[1]}")
    stale = sorted(set(waivers) - waived)
    for waiver in stale:
        print(f"STALE: the waiver of {waiver} in deny.toml applies to nothing")
    print(f"{len(locked)} crates, {known} advisories: {found} apply, {len(waived)} are waived")
    sys.exit(found > 0 or len(stale) > 0)


if __name__ == "__main__":
    main()
