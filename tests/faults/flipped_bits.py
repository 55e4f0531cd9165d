"""Bits that flip and files that are cut short, in every kind of object: each is found, none is served (target A4).

Every case has its object of maps (which holds the reason why these heads have none) and a layer. In each round one object of each derived kind of every case is damaged: a bit is flipped, or the file is cut.
`check-store` must name every one. Then a server must answer every request with the bytes from before, because it makes the damaged objects again; for
maps and layers it may answer 409 with `Retry-After` meanwhile. Damaged uploads cannot be made again: their cases must be reported, and never
served with other bytes.
"""

import hashlib
import os
import random
import re
import sqlite3
import time

from attack import FORM, Report, Server, form, head, is_short

CASES, FLIPS, OF_SOURCES = (3, 20, 2) if is_short() else (20, 1000, 100)

ROUTES = ["mesh?depth_mm=5", "mesh?depth_mm=5&contours=9&points=12", "volume", "distance", "mask", "envelope", "mesh/paths", "render?depth_mm=5&width=96&height=96", "slices/axial"]
# What is made in the background.
ROUTES += ["layers/blur/volume", "layers/other/volume", "render?depth_mm=5&width=96&height=96&layer=other"]


def objects_of(data):
    """The files of the objects by their kind, without the id of the store: with a damaged one no server starts."""
    found = {}
    root = os.path.join(data, "objects")
    for folder, _, names in os.walk(root):
        if folder == root:
            continue
        kind = os.path.relpath(folder, root).split(os.sep)[0]
        for name in names:
            found.setdefault(kind, []).append(os.path.join(folder, name))
    return {kind: sorted(files) for kind, files in found.items()}


def cases_that_need(data, path):
    """How many cases need an object."""
    kind = os.path.relpath(path, os.path.join(data, "objects")).split(os.sep)[0]
    digest = "".join(os.path.relpath(path, os.path.join(data, "objects", kind)).split(os.sep))
    rows = sqlite3.connect(f"file:{data}/rows.sqlite?mode=ro", uri=True)
    try:
        named = "FROM {} WHERE kind = ? AND ? LIKE '%' || digest || '%'"
        sql = f"SELECT (SELECT count(*) {named.format('case_objects')}) + (SELECT count(*) {named.format('layer_objects')})"
        return rows.execute(sql, 2 * (kind, digest)).fetchone()[0]
    finally:
        rows.close()


def named_by(words):
    """How many times `check-store` names an object of a case."""
    return len(re.findall(r"^(damaged|missing): ", words, re.MULTILINE))


def damage(path, chance):
    """Flips a bit, or cuts the file; what was there."""
    with open(path, "rb") as file:
        before = file.read()
    after = bytearray(before)
    if chance.random() < 0.8:
        bit = chance.randrange(8 * len(after))
        after[bit // 8] ^= 1 << bit % 8
    else:
        after = after[: chance.randrange(len(after))]
    with open(path, "wb") as file:
        file.write(after)
    return before


def case_with_layer(server, seed):
    """The address of a case that is ready, with a layer that has its place by its header."""
    scale = 0.85 + 0.3 * seed / CASES
    case = server.prepared(head(10.0, seed, scale=scale))
    parts = [("parameters", b'{"name": "other", "transform": "none"}'), ("volume", head(10.0, seed + 500, scale=scale))]
    status, headers, body = server.ask("POST", f"{case}/layers", form(parts), {"Content-Type": FORM})
    assert status == 202, (status, body)
    return case


def patient(server, address):
    """Status and body of an answer, asked for again while the server says when. These heads have no maps, which is then the last answer (409)."""
    end = time.monotonic() + 60
    while True:
        status, headers, body = server.ask("GET", address, timeout=120)
        if status != 409 or "retry-after" not in headers or time.monotonic() > end:
            return status, body
        time.sleep(0.05)


def answers_of(server, cases):
    """A digest of every answer about every case; an answer that is no 200 by its status."""
    found = {}
    for case in cases:
        for route in ROUTES:
            status, body = patient(server, f"{case}/{route}")
            is_last = status == 200 or b"maps-undefined" in body
            found[case, route] = hashlib.sha256(body).hexdigest() if is_last else status
    return found


def main():
    report = Report("flipped bits")
    chance = random.Random(4)
    with Server() as server:
        cases = [case_with_layer(server, seed) for seed in range(CASES)]
        expected = answers_of(server, cases)
        assert all(isinstance(digest, str) for digest in expected.values()), expected
        server.stop()
        derived = [kind for kind in objects_of(server.data) if not kind.startswith("source")]
        flips = unnamed = wrong = not_remade = 0
        by_kind = {}
        while flips < FLIPS - OF_SOURCES:
            damaged = expected_names = 0
            for kind in derived:
                for path in objects_of(server.data)[kind]:
                    damage(path, chance)
                    damaged += 1
                    expected_names += cases_that_need(server.data, path)
                    by_kind[kind] = by_kind.get(kind, 0) + 1
            status, words = server.check()
            unnamed += abs(expected_names - named_by(words))
            flips += damaged
            server.start()
            after = answers_of(server, cases)
            wrong += sum(after[key] != expected[key] for key in expected)
            server.stop()
            # No answer needs a manifest: that is written again when asked for.
            server.check("--repair")
            status, words = server.check()
            not_remade += named_by(words)
            print(f"   {flips} damaged, {unnamed} not named, {wrong} answers with other bytes, {not_remade} not remade", flush=True)
        # Uploads: their bytes are all there is.
        sources = sorted(path for kind, files in objects_of(server.data).items() if kind.startswith("source") for path in files)
        for _ in range(OF_SOURCES):
            path = chance.choice(sources)
            before = damage(path, chance)
            status, words = server.check()
            unnamed += named_by(words) != cases_that_need(server.data, path)
            by_kind["source"] = by_kind.get("source", 0) + 1
            flips += 1
            with open(path, "wb") as file:
                file.write(before)
        server.start()
        after = answers_of(server, cases)
        wrong += sum(after[key] != expected[key] for key in expected)
        report.figure("damaged objects by kind", by_kind)
        measured = f"{flips} damaged: {unnamed} not found, {wrong} answers with other bytes, {not_remade} not made again"
        met = not unnamed and not wrong and not not_remade
        report.target("A4", "1,000 flipped bits and cut files: all found, none served, made again", measured, met)
    report.end()


main()
