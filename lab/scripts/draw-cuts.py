#!/usr/bin/env python3
"""Draws docs/cuts.png: where depths are shown in a brain that its volume cuts.

    lab/scripts/draw-cuts.py VOLUME MASK [PROGRAM]

VOLUME and MASK are Colin27 (https://packages.debian.org/mricron-data, ch2.nii.gz) and a mask of its brain, with the same voxels.
Columns: the whole head; without the slices above 20 mm below the vertex; without those below 50 mm above the lowest slice of the
brain. Needs Pillow.
"""

import gzip
import io
import json
import os
import struct
import subprocess
import sys
import tempfile
import time
import urllib.request

from PIL import Image, ImageDraw

PIXELS = 300
QUERY = f"depth_mm=5,10,20&width={PIXELS}&height={PIXELS}"


def read(path):
    """The header and the slices of a NIfTI volume, from the feet upwards."""
    with gzip.open(path) as file:
        content = file.read()
    header = bytearray(content[:348])
    x, y, z = struct.unpack_from("<3h", header, 42)
    size = struct.unpack_from("<h", header, 72)[0] // 8 * x * y
    start = int(struct.unpack_from("<f", header, 108)[0])
    return header, [content[start + size * at : start + size * (at + 1)] for at in range(z)]


def written(header, slices, first):
    """A gzipped volume of some slices, the first of which was slice `first`."""
    header = bytearray(header)
    struct.pack_into("<h", header, 46, len(slices))
    rows = [struct.unpack_from("<4f", header, 280 + 16 * row) for row in range(3)]
    for row, values in enumerate(rows):
        struct.pack_into("<f", header, 280 + 16 * row + 12, values[3] + first * values[2])
    # The quaternion's translation says the same.
    for axis, values in enumerate(rows):
        struct.pack_into("<f", header, 268 + 4 * axis, values[3] + first * values[2])
    struct.pack_into("<f", header, 108, 352.0)
    return gzip.compress(bytes(header) + bytes(4) + b"".join(slices), 1)


def form(volume, mask):
    border = b"a-border-of-parts"
    parts = [
        b"--" + border + b'\r\nContent-Disposition: form-data; name="%s"; filename="%s.nii.gz"\r\n\r\n' % (name, name) + content + b"\r\n"
        for name, content in ((b"volume", volume), (b"mask", mask))
    ]
    return b"".join(parts) + b"--" + border + b"--\r\n", f"multipart/form-data; boundary={border.decode()}"


def picture(address, volume, mask, query):
    body, kind = form(volume, mask)
    request = urllib.request.Request(f"{address}/v1/cases", body, {"Content-Type": kind})
    with urllib.request.urlopen(request) as answer:
        case = json.load(answer)["id"]
    while True:
        with urllib.request.urlopen(f"{address}/v1/cases/{case}") as answer:
            facts = json.load(answer)
        if facts["state"] in ("ready", "failed"):
            break
        time.sleep(0.2)
    print(facts["quality"]["state"], facts["quality"].get("reason_codes"))
    drawn = []
    for route in ("slices/coronal?position_mm=20&zoom=1.15", query):
        with urllib.request.urlopen(f"{address}/v1/cases/{case}/{route}&{QUERY if 'slices' in route else QUERY.replace('5,10,20', '12')}") as answer:
            drawn.append(Image.open(io.BytesIO(answer.read())).convert("RGB"))
    return drawn


def main():
    if len(sys.argv) not in (3, 4):
        sys.exit(f"usage: {sys.argv[0]} VOLUME MASK [PROGRAM]")
    volume, mask = map(read, sys.argv[1:3])
    program = sys.argv[3] if len(sys.argv) == 4 else "target/debug/isocortex"
    marked = [at for at, one in enumerate(mask[1]) if any(one)]
    below, above = marked[0] + 50, marked[-1] - 20
    ranges = [(0, len(volume[1])), (0, above), (below, len(volume[1]))]
    with tempfile.TemporaryDirectory() as folder, open(os.path.join(folder, "log"), "w+") as log:
        server = subprocess.Popen([program, "serve", "--create", "--data", f"{folder}/data", "--listen", "127.0.0.1:0"], stdout=log, stderr=log)
        try:
            address = ""
            while not address:
                time.sleep(0.2)
                with open(log.name) as lines:
                    found = [word for line in lines for word in line.split() if word.startswith("http://127")]
                address = found[0].rstrip("/") if found else ""
            columns = []
            for first, last in ranges:
                parts = [written(header, slices[first:last], first) for header, slices in (volume, mask)]
                columns.append(picture(address, *parts, "render?view=left"))
        finally:
            server.terminate()
            server.wait()
    words = ["the whole head", "20 mm cut off above", "50 mm cut off below"]
    sheet = Image.new("RGB", (3 * PIXELS, 2 * PIXELS + 20), "black")
    for column, (cells, title) in enumerate(zip(columns, words)):
        ImageDraw.Draw(sheet).text((column * PIXELS + 6, 5), title, fill="white")
        for row, cell in enumerate(cells):
            sheet.paste(cell, (column * PIXELS, row * PIXELS + 20))
    sheet.quantize(96).save("docs/cuts.png", optimize=True)


main()
