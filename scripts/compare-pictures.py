#!/usr/bin/env python3
"""Compares what two versions of the program answer about the same heads, digest by digest.

Each program serves each head from an empty directory of its own, on 127.0.0.1 and without a graphics device. 60 pictures are
drawn (views × depths × renderers, colours, slices, a sheet, animations), and every binary route is fetched: meshes in all
formats, their triangles and paths, volume, depth, mask, envelope and quality. A PNG whose bytes differ is also compared by its
pixels, because its texts name the version. The exit status is 1 if any pixel or byte differs.

    scripts/compare-pictures.py OLD NEW VOLUME[,MASK] [VOLUME[,MASK] ...]
"""

import argparse
import hashlib
import io
import json
import re
import struct
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
import zipfile
import zlib
from pathlib import Path

VIEWS = ["left", "right", "anterior", "posterior", "superior", "inferior"]
RENDERERS = ["splat", "mesh", "trace"]
DEPTHS_MM = [0, 6]
MESH_TYPES = ["application/octet-stream", "application/ply", "model/gltf-binary", "model/obj", "model/stl"]
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"

# Seconds that a head may take to be prepared: a debug build on a busy machine is slow.
PATIENCE_S = 900


def pictures():
    """The 60 pictures: a name, an address below the case, a body for POST or None, and the accepted media type."""
    for view in VIEWS:
        for depth_mm in DEPTHS_MM:
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
    yield "quality sheet", "quality", None, "image/png"


def bodies():
    """The binary routes, in the same form."""
    sizes = ["", "&contours=12&points=16", "&contours=40&points=30&paths=flow"]
    for size in sizes:
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


class Server:
    """A program that serves an empty directory."""

    def __init__(self, program):
        self.directory = tempfile.TemporaryDirectory()
        command = [program, "serve", "--data", self.directory.name, "--listen", "127.0.0.1:0", "--gpu", "off", "--log", "error"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        line = self.process.stdout.readline()
        address = re.search(r"http://\S+", line)
        if not address:
            sys.exit(f"{program} did not start: {line!r}")
        self.address = address.group()

    def ask(self, path, body=None, accept="*/*", content_type="application/json"):
        headers = {"Accept": accept, **({"Content-Type": content_type} if body is not None else {})}
        request = urllib.request.Request(f"{self.address}{path}", data=body, headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=300) as answer:
                return answer.read()
        except urllib.error.HTTPError as error:
            return f"{error.code} ".encode() + error.read()

    def prepare(self, volume, mask):
        """Uploads a head and waits until it is ready; gives its id and what is told of it."""
        boundary = "----compare-pictures"
        parts = b""
        for name, path in (("volume", volume), ("mask", mask)):
            if path:
                head = f'--{boundary}\r\nContent-Disposition: form-data; name="{name}"; filename="{name}.nii.gz"\r\n\r\n'
                parts += head.encode() + Path(path).read_bytes() + b"\r\n"
        parts += f"--{boundary}--\r\n".encode()
        told = json.loads(self.ask("/v1/cases", parts, content_type=f"multipart/form-data; boundary={boundary}"))
        begun = time.monotonic()
        while told.get("state") not in ("ready", "failed"):
            if "id" not in told or time.monotonic() - begun > PATIENCE_S:
                sys.exit(f"{volume} was not prepared: {told}")
            time.sleep(0.3)
            told = json.loads(self.ask(f"/v1/cases/{told['id']}"))
        if told["state"] == "failed":
            sys.exit(f"{volume} cannot be prepared: {told}")
        return told

    def memory_mib(self):
        """Memory held now and at most, in MiB, if the system tells."""
        try:
            text = Path(f"/proc/{self.process.pid}/status").read_text()
        except OSError:
            return None
        return [int(re.search(rf"{line}:\s+(\d+)", text).group(1)) / 1024 for line in ("VmRSS", "VmHWM")]

    def end(self):
        self.process.terminate()
        self.process.wait()
        self.directory.cleanup()


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


def digest(content):
    return hashlib.sha256(content).hexdigest()


def shown(content):
    """The digest of what an answer shows: pixels of a PNG, those of each member of a zip, else all bytes."""
    if content.startswith(PNG_MAGIC):
        return digest(pixels_of(content))
    if content.startswith(b"PK\x03\x04"):
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return digest("".join(name + shown(archive.read(name)) for name in sorted(archive.namelist())).encode())
    return digest(content)


def answers(program, volume, mask):
    """What is told of a head, everything that is answered about it (name to digest, digest of what is shown, length), and the memory."""
    server = Server(program)
    try:
        told = server.prepare(volume, mask)
        found = {}
        for name, path, body, accept in [*pictures(), *bodies()]:
            body = json.dumps(body).encode() if body is not None else None
            content = server.ask(f"/v1/cases/{told['id']}/{path}", body, accept)
            if re.match(rb"[45]\d\d ", content):
                sys.exit(f"{program} refuses {path}: {content[:300]!r}")
            found[name] = (digest(content), shown(content), len(content))
        return told, found, server.memory_mib()
    finally:
        server.end()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("heads", nargs="+", metavar="VOLUME[,MASK]")
    parser.add_argument("--list", action="store_true", help="print each digest")
    arguments = parser.parse_args()
    picture_names = [name for name, *_ in pictures()]
    assert len(picture_names) == 60 and len(set(picture_names)) == 60, len(picture_names)
    is_same = True
    for head in arguments.heads:
        volume, _, mask = head.partition(",")
        (old_told, old, old_memory), (new_told, new, new_memory) = (answers(program, volume, mask) for program in (arguments.old, arguments.new))
        names = {"pictures": picture_names, "binary routes": [name for name in old if name not in picture_names]}
        print(f"{Path(volume).parent.name}/{Path(volume).name}: id {'the same' if old_told['id'] == new_told['id'] else 'DIFFERENT'}")
        is_same &= old_told["id"] == new_told["id"]
        for kind, names in names.items():
            whole = [name for name in names if old[name][0] == new[name][0]]
            shown_only = [name for name in names if old[name][0] != new[name][0] and old[name][1] == new[name][1]]
            different = [name for name in names if old[name][1] != new[name][1]]
            size = sum(old[name][2] for name in names) / 1e6
            print(f"  {len(names)} {kind} ({size:.1f} MB): {len(whole)} the same bytes, {len(shown_only)} the same pixels, {len(different)} different")
            for name in different:
                print(f"    DIFFERENT: {name}: {old[name][1][:16]} {new[name][1][:16]}")
            is_same &= not different
            if arguments.list:
                for name in names:
                    print(f"    {old[name][1][:16]} {new[name][1][:16]} {name}")
        if old_memory and new_memory:
            (old_now, old_most), (new_now, new_most) = old_memory, new_memory
            print(f"  memory: {old_now:.0f} MiB and {new_now:.0f} at the end, {old_most:.0f} and {new_most:.0f} at most")
        sys.stdout.flush()
    sys.exit(0 if is_same else 1)


if __name__ == "__main__":
    main()
