#!/usr/bin/env python3
"""Packs a tree that dist.sh has laid out as an archive and as a wheel:  scripts/pack.py ROOT FOLDER VERSION TARGET

The wheel installs the tree into the prefix of its environment: `bin/isocortex`, and beside it `share/`; and the Python package of
`python/`, with the widget that web.sh has bundled. The same tree gives the same bytes.
"""

import base64
import gzip
import hashlib
import io
import os
import sys
import tarfile
import time
import tomllib
import zipfile
from pathlib import Path

MOMENT = int(os.environ["SOURCE_DATE_EPOCH"])
PLATFORMS = {
    "x86_64-unknown-linux-gnu": "manylinux_2_28_x86_64",
    "aarch64-unknown-linux-gnu": "manylinux_2_28_aarch64",
    "aarch64-apple-darwin": "macosx_11_0_arm64",
}
DESCRIPTION = """\
Isocortex shows the cerebral cortex as curved cuts at any depth below the dura, in the browser, over HTTP, as PNG or in Python.
`isocortex demo` prepares a sample head and prints the address to open; it needs no network. `isocortex help` lists all commands.

```python
import isocortex as iso

case = iso.open("head.nii.gz")
coordinates, faces = case.mesh(8.0)
case.picture(8.0, view="left")
```

**For research use only. Not for diagnosis.**
"""
PYTHON = Path(__file__).parent.parent / "python"
LICENCES = ("LICENSE-MIT", "LICENSE-APACHE", "NOTICE")


def metadata(version):
    """What `python/pyproject.toml` states about the package, in the words of the core metadata."""
    project = tomllib.loads((PYTHON / "pyproject.toml").read_text())["project"]
    lines = ["Metadata-Version: 2.4", f"Name: {project['name']}", f"Version: {version}", f"Summary: {project['description']}"]
    lines += [f"Keywords: {','.join(project['keywords'])}", f"License-Expression: {project['license']}"]
    lines += [f"License-File: {name}" for name in LICENCES]
    lines += [f"Requires-Python: {project['requires-python']}"]
    lines += [f"Classifier: {classifier}" for classifier in project["classifiers"]]
    lines += [f"Requires-Dist: {needed}" for needed in project["dependencies"]]
    for extra, packages in project["optional-dependencies"].items():
        lines += [f"Provides-Extra: {extra}", *(f'Requires-Dist: {needed}; extra == "{extra}"' for needed in packages)]
    return "\n".join([*lines, "Description-Content-Type: text/markdown", "", DESCRIPTION])


def files_of(root):
    return [(path, path.relative_to(root)) for path in sorted(root.rglob("*")) if path.is_file()]


def mode_of(path):
    return 0o755 if os.access(path, os.X_OK) else 0o644


def archive(root, name):
    """A folder with the tree, as .tar.gz."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.GNU_FORMAT) as tar:
        for path, inside in files_of(root):
            entry = tarfile.TarInfo(f"{name}/{inside}")
            entry.size, entry.mode, entry.mtime = path.stat().st_size, mode_of(path), MOMENT
            with path.open("rb") as file:
                tar.addfile(entry, file)
    return gzip.compress(packed.getvalue(), mtime=MOMENT)


def wheel(root, version, platform):
    """The tree as a wheel: the format of PEP 427, the licences of PEP 639."""
    info, data = f"isocortex-{version}.dist-info", f"isocortex-{version}.data"
    tags = f"Wheel-Version: 1.0\nGenerator: isocortex\nRoot-Is-Purelib: false\nTag: py3-none-{platform}\n"
    licences = root / "share/doc/isocortex"
    contents = [
        (f"{data}/scripts/{path.name}" if inside.parts[0] == "bin" else f"{data}/data/{inside}", path.read_bytes(), mode_of(path))
        for path, inside in files_of(root)
    ]
    package = PYTHON / "isocortex"
    modules = sorted([*package.rglob("*.py"), package / "py.typed", package / "view.js"])
    contents += [(str(path.relative_to(PYTHON)), path.read_bytes(), 0o644) for path in modules]
    for name in LICENCES:
        contents.append((f"{info}/licenses/{name}", (licences / name).read_bytes(), 0o644))
    contents.append((f"{info}/METADATA", metadata(version).encode(), 0o644))
    contents.append((f"{info}/WHEEL", tags.encode(), 0o644))
    digests = [(name, base64.urlsafe_b64encode(hashlib.sha256(bytes).digest()).rstrip(b"=").decode(), len(bytes)) for name, bytes, _ in contents]
    record = "".join(f"{name},sha256={digest},{size}\n" for name, digest, size in digests) + f"{info}/RECORD,,\n"
    contents.append((f"{info}/RECORD", record.encode(), 0o644))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as file:
        for name, bytes, mode in contents:
            entry = zipfile.ZipInfo(name, time.gmtime(MOMENT)[:6])
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, (0o100000 | mode) << 16
            file.writestr(entry, bytes)
    return packed.getvalue()


def main():
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    root, folder, version, target = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], sys.argv[4]
    name = f"isocortex-{version}-{target}"
    (folder / f"{name}.tar.gz").write_bytes(archive(root, name))
    if platform := PLATFORMS.get(target):
        (folder / f"isocortex-{version}-py3-none-{platform}.whl").write_bytes(wheel(root, version, platform))


main()
