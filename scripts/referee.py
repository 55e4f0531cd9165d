#!/usr/bin/env python3
"""Compares what the program answers, and how long its tests take, with the recorded base, and names what differs.

    scripts/referee.py answers [--program FILE] [--base FILE] [--record]
    scripts/referee.py times [--base FILE] [--record]

`answers` compares ids of cases, pictures, meshes, textures and DICOM results of three made-up heads and, if ISOCORTEX_TEST_DATA is set, three real
ones, the parts of /openapi.json, and sizes. The program serves an empty directory on 127.0.0.1 without a graphics device. A PNG is also compared by its
pixels, because its texts name the version, and a DICOM object without dates, times and UIDs, because it has those of its case. An annotated picture has
the day in it. The exit status is 1 if anything but a size differs.

`times` compares the report of the last `cargo nextest run` (target/nextest/default/junit.xml). It names new and missing tests and those that take twice as long and
a second more; the exit status is 1 if a test is missing. Times of a busy machine are not comparable.

--record writes the base (tests/referee/): do so only for a change that is meant, and commit it with the reason.
"""

import argparse
import gzip
import hashlib
import io
import json
import os
import re
import struct
import sys
import tarfile
import xml.etree.ElementTree
import zipfile
import zlib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests/faults"))
import attack  # noqa: E402

TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
BASES = ROOT / "tests/referee"

VIEWS = ["left", "right", "anterior", "posterior", "superior", "inferior"]
RENDERERS = ["splat", "mesh", "trace"]
MESH_TYPES = ["application/octet-stream", "application/ply", "model/gltf-binary", "model/obj", "model/stl"]
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
# Seconds that a head may take to be prepared: a debug build on a busy machine is slow.
PATIENCE_S = 900


def pictures():
    """Pictures: a name, an address below the case, a body for POST or None, and the accepted media type."""
    for view in VIEWS:
        for depth_mm in [0, 6]:
            for renderer in RENDERERS:
                query = f"view={view}&depth_mm={depth_mm}&renderer={renderer}&width=256&height=256"
                yield f"{renderer} {view} {depth_mm} mm", f"render?{query}", None, "image/png"
    for colormap in ["inverted", "hot", "viridis", "bone"]:
        yield f"colours {colormap}", f"render?depth_mm=12&width=200&height=160&colormap={colormap}&renderer=splat", None, "image/png"
    odd = "orientation=0.3,-0.5,0.1,0.8&zoom=1.7&pan=4,-7&depth_mm=9.5&width=200&height=160"
    for renderer in RENDERERS:
        query = f"{odd}&renderer={renderer}&slab_mm=2&ambient=0.7&background=transparent"
        yield f"{renderer} oblique", f"render?{query}", None, "image/png"
    yield "mesh 80 × 50, flow", "render?renderer=mesh&contours=80&points=50&paths=flow&depth_mm=14", None, "image/png"
    yield "annotated", "render?annotate=true&depth_mm=3&renderer=splat", None, "image/png"
    yield "default", "render", None, "image/png"
    for plane in ["axial", "coronal", "sagittal"]:
        for depths in ["", "&depth_mm=5,10,20", "&depth_mm=2&annotate=true&colormap=bone"]:
            yield f"slice {plane} {depths}", f"slices/{plane}?width=240&height=200{depths}", None, "image/png"
    small = {"width": 96, "height": 96, "renderer": "splat"}
    some = [{**small, "view": view, "depth_mm": depth} for depth in (0, 8) for view in ("left", "superior")]
    yield "zip", "renders", {"renders": some}, "*/*"
    yield "sheet", "renders", {"renders": some, "sheet": True}, "*/*"
    yield "swivel", "renders", {"swivel": {"frames": 6, "render": {**small, "depth_mm": 5}}}, "*/*"
    sweep = {"from_mm": 0, "to_mm": 20, "frames": 5, "render": {**small, "renderer": "mesh"}}
    yield "sweep", "renders", {"sweep": sweep}, "*/*"
    back = {**sweep, "there_and_back": True, "average_shallow": True, "render": small}
    yield "sweep there and back", "renders", {"sweep": back}, "*/*"
    for normal in ["&normal=0.3,1,-0.2", ""]:
        yield f"oblique slice {normal}", f"slices/oblique?position=-20,-10,15{normal}&width=200&height=160&depth_mm=4", None, "image/png"
    yield "quality sheet", "quality", None, "image/png"


def bodies():
    """Meshes and textures, in the same form."""
    for size in ["", "&contours=12&points=16", "&contours=40&points=30&paths=flow"]:
        for depth_mm in [0, 7.5, 25]:
            for media_type in MESH_TYPES:
                yield f"mesh {media_type} {depth_mm} mm {size}", f"mesh?depth_mm={depth_mm}{size}", None, media_type
        yield f"paths {size}", f"mesh/paths?{size[1:]}", None, "*/*"
        # The triangles do not depend on the paths.
        yield f"triangles {size}", f"mesh/triangles?{size[1:].replace('&paths=flow', '')}", None, "*/*"
    for bits in [8, 16]:
        yield f"volume {bits}", f"volume?bits={bits}", None, "*/*"
    for step in [1, 4]:
        yield f"distance {step}", f"distance?step={step}", None, "*/*"
    for route in ["mask", "envelope"]:
        yield route, route, None, "*/*"


def results(is_dicom):
    """DICOM results, in the same form. A case from NIfTI names its study, and has no frame of reference for masks."""
    study = {} if is_dicom else {"study": {"StudyInstanceUID": "1.2.3", "PatientID": "P", "PatientName": "Doe^J"}}
    # Results are annotated, which needs 128 pixels.
    size = {"width": 160, "height": 128}
    wanted = {
        "view": {"what": "view", "render": {**size, "depth_mm": 5}},
        "sheet": {"what": "sheet", "render": size},
    }
    if is_dicom:
        wanted |= {what: {"what": what} for what in ("envelope", "mask")}
    for name, body in wanted.items():
        yield f"DICOM {name}", "dicom-results", {**body, **study}, "*/*"


def heads():
    """Names and parts of uploads; whether they are DICOM."""
    for name, spacing_mm, seed, scale in [("made-up 4 mm", 4.0, 0, 1.0), ("made-up 3 mm", 3.0, 1, 0.9), ("made-up 5 mm", 5.0, 2, 1.05)]:
        yield name, {"volume": attack.head(spacing_mm, seed, scale=scale)}, False
    data = os.environ.get("ISOCORTEX_TEST_DATA")
    if not data:
        print("SKIPPED: real heads; set ISOCORTEX_TEST_DATA to their folder")
        return
    for name, volume in [("colin27", "ch2"), ("csi1", "t1")]:
        folder = Path(data) / name
        parts = {"volume": f"{volume}.nii.gz", "mask": "mask_dura.nii.gz"}
        yield name, {part: (folder / file).read_bytes() for part, file in parts.items()}, False
    with tarfile.open(Path(data) / "dicom/sag-anon.tar.xz") as archive:
        files = [(file.name, archive.extractfile(file).read()) for file in archive if file.isfile()]
    mask = (Path(data) / "dicom/sag-anon.mask_dura.nii.gz").read_bytes()
    yield "sag-anon (DICOM)", {"volume": attack.zip_of(files), "mask": mask}, True


def digest(content):
    return hashlib.sha256(content).hexdigest()[:24]


def pixels_of(png):
    """What a PNG or animated PNG shows: its header and its unpacked pixels, without texts."""
    shown, packed, place = b"", b"", len(PNG_MAGIC)
    while place < len(png):
        (length,), kind = struct.unpack(">I", png[place : place + 4]), png[place + 4 : place + 8]
        content = png[place + 8 : place + 8 + length]
        if kind in (b"IHDR", b"PLTE", b"tRNS", b"acTL", b"fcTL"):
            shown += zlib.decompress(packed) if packed else b""
            packed = b""
            shown += kind + content
        elif kind == b"IDAT":
            packed += content
        elif kind == b"fdAT":
            packed += content[4:]
        place += 12 + length
    return shown + (zlib.decompress(packed) if packed else b"")


# The kinds of dates, times and UIDs in a DICOM object of explicit VR, and the lengths of their values.
MOMENT = re.compile(rb"(?:DA|TM|DT|UI)(..)", re.DOTALL)


def without_moments(dicom):
    """A DICOM object without the digits of its dates, times and UIDs: a result has the time of its case."""
    kept, place = [], 0
    while found := MOMENT.search(dicom, place):
        end = found.end() + int.from_bytes(found[1], "little")
        is_moment = not dicom[found.end() : end].strip(b"0123456789.+- \0")
        kept.append(dicom[place : found.end()])
        place = end if is_moment else found.end()
    return b"".join([*kept, dicom[place:]])


def shown(content):
    """The digest of what an answer shows: pixels of a PNG, those of each member of a zip, a DICOM object without its time, else all bytes."""
    if content[128:132] == b"DICM":
        return digest(without_moments(content))
    if content.startswith(PNG_MAGIC):
        return digest(pixels_of(content))
    if content.startswith(b"PK\x03\x04"):
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return digest("".join(name + shown(archive.read(name)) for name in sorted(archive.namelist())).encode())
    return digest(content)


def parts_of_openapi(document):
    """The description of each request and each component by name."""
    for path, methods in document["paths"].items():
        for method, description in methods.items():
            yield f"openapi {method.upper()} {path}", description
    for kind, components in document.get("components", {}).items():
        for name, description in components.items():
            yield f"openapi {kind} {name}", description


def sizes(server):
    """Sizes in bytes that people feel, for information."""
    found = {"program": Path(attack.program()).stat().st_size}
    _, _, page = server.ask("GET", "/")
    found["page's HTML, gzip"] = len(gzip.compress(page, mtime=0))
    scripts = [file for file in (ROOT / "web/dist").rglob("*") if file.suffix in (".js", ".mjs", ".css", ".html")]
    found["page, all texts, gzip"] = sum(len(gzip.compress(file.read_bytes(), mtime=0)) for file in scripts)
    found["locked crates"] = (ROOT / "Cargo.lock").read_text().count("[[package]]")
    return found


def ask(server, method, path, body=None, accept="*/*"):
    headers = {"Accept": accept, **({"Content-Type": "application/json"} if body is not None else {})}
    status, _, content = server.ask(method, path, body, headers, timeout=PATIENCE_S)
    if status != 200:
        sys.exit(f"{method} {path.split('?')[0]}: {status} {content[:300]!r}")
    return content


def answers():
    """Everything that is compared: a name, the digest of the bytes and that of what they show. The sizes are beside it."""
    found = {}
    with attack.Server(environment={"ISOCORTEX_LOG": "error"}) as server:
        for name, description in parts_of_openapi(json.loads(ask(server, "GET", "/openapi.json"))):
            found[name] = [digest(json.dumps(description, sort_keys=True).encode())] * 2
        measured = sizes(server)
        for head, parts, is_dicom in heads():
            status, headers, body = server.upload(timeout=PATIENCE_S, **parts)
            if status not in (200, 202):
                sys.exit(f"{head}: {status} {body[:300]!r}")
            case = headers["location"]
            told = server.until_settled(case, PATIENCE_S)
            if told.get("state") != "ready":
                sys.exit(f"{head} is not ready: {told}")
            found[f"{head}: id"] = [told["id"]] * 2
            for name, path, body, accept in [*pictures(), *bodies(), *results(is_dicom)]:
                method, body = ("GET", None) if body is None else ("POST", json.dumps(body))
                content = ask(server, method, f"{case}/{path}", body, accept)
                found[f"{head}: {name}"] = [digest(content), shown(content)]
            print(f"{head}: {sum(key.startswith(f'{head}: ') for key in found)} answers", flush=True)
    return {"answers": found, "sizes": measured}


def compare_answers(base, now):
    """Names what differs; whether nothing does. What is recorded of a head that was skipped does not count."""
    old, new = base["answers"], now["answers"]
    here = {name.split(": ")[0] for name in new}
    missing = [name for name in old if name not in new and (name.startswith("openapi ") or name.split(": ")[0] in here)]
    added = [name for name in new if name not in old]
    common = [name for name in new if name in old]
    different = [name for name in common if old[name][1] != new[name][1]]
    texts = [name for name in common if old[name][1] == new[name][1] and old[name][0] != new[name][0]]
    for word, names in [("MISSING", missing), ("NEW", added), ("DIFFERENT", different), ("DIFFERENT BYTES, SAME CONTENT", texts)]:
        for name in names:
            print(f"{word}: {name}")
    for name, size in now["sizes"].items():
        before = base["sizes"].get(name)
        print(f"size: {name}: {size}" + (f" ({100 * (size / before - 1):+.1f} %)" if before else ""))
    print(f"{len(common)} compared: {len(common) - len(different) - len(texts)} the same, {len(different) + len(texts)} different; {len(missing)} missing, {len(added)} new")
    return not (missing or added or different or texts)


def times():
    report = TARGET / "nextest/default/junit.xml"
    if not report.exists():
        sys.exit(f"{report} is missing: run the tests with cargo nextest")
    tree = xml.etree.ElementTree.parse(report)
    return {f"{case.get('classname')} {case.get('name')}": float(case.get("time")) for case in tree.iter("testcase")}


def compare_times(base, now):
    missing = sorted(base.keys() - now.keys())
    added = sorted(now.keys() - base.keys())
    slower = [name for name in now if name in base and now[name] > max(2 * base[name], base[name] + 1)]
    for name in missing:
        print(f"MISSING: {name}")
    for name in added:
        print(f"new: {name}: {now[name]:.1f} s")
    for name in sorted(slower, key=lambda name: base[name] - now[name]):
        print(f"slower: {name}: {base[name]:.1f} s, now {now[name]:.1f} s")
    for name in sorted(now, key=now.get, reverse=True)[:20]:
        print(f"longest: {now[name]:.1f} s {name}")
    print(f"{len(now)} tests in {sum(now.values()):.0f} s of tests; the base has {len(base)} in {sum(base.values()):.0f} s")
    return not missing


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["answers", "times"])
    parser.add_argument("--program", type=Path, default=TARGET / "debug/isocortex")
    parser.add_argument("--base", type=Path)
    parser.add_argument("--record", action="store_true")
    arguments = parser.parse_args()
    os.environ["ISOCORTEX_BINARY"] = str(arguments.program)
    path = arguments.base or BASES / f"{arguments.what}.json"
    now = answers() if arguments.what == "answers" else times()
    if arguments.record:
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(now, indent=0, sort_keys=True, ensure_ascii=False) + "\n")
        print(f"recorded in {path}")
        return
    compare = compare_answers if arguments.what == "answers" else compare_times
    sys.exit(0 if compare(json.loads(path.read_text()), now) else 1)


if __name__ == "__main__":
    main()
