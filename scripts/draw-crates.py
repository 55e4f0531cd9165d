#!/usr/bin/env python3
"""Draws the crates of server/ and their dependencies as docs/crates.svg.

The boxes stand where PLACES puts them. The arrows come from the `[dependencies]` of each crate; an arrow that follows from
others is omitted. With --check nothing is written, and the exit status is 1 if the picture is stale.
"""

import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs/crates.svg"

COLUMN, ROW = 182, 104
WIDTH, HEIGHT = 168, 62
MARGIN = 16


@dataclass
class Place:
    """A box: its row and first column, how many columns it spans, and two lines about it."""

    row: int
    column: float
    span: float
    lines: tuple[str, str]

    @property
    def left(self):
        return MARGIN + self.column * COLUMN

    @property
    def right(self):
        return self.left + (self.span - 1) * COLUMN + WIDTH

    @property
    def top(self):
        return MARGIN + self.row * ROW

    @property
    def bottom(self):
        return self.top + HEIGHT


PLACES = {
    "isocortex": Place(0, 0, 3, ("the program: commands and configuration", "serve, demo, prepare, render")),
    "service": Place(1, 1, 2, ("HTTP: routes, wire formats", "carries the page")),
    "access": Place(2, 0, 1, ("tokens, scopes, the proxy's user", "who did what: the audit record")),
    "http": Place(3, 0, 1, ("problems, conditions, queries", "listening and its limits")),
    "pacs": Place(1, 0, 1, ("DICOMweb and C-STORE:", "what a PACS asks and sends")),
    "cases": Place(2, 1, 3, ("the application: library, workers, warm models, pictures", "errors without a protocol")),
    "worker": Place(3, 1, 2, ("a confined process: an order in, values out", "reads untrusted files, prepares heads, within limits")),
    "report": Place(3, 3, 1, ("contents and pictures in,", "HTML or PDF out")),
    "shader-translate": Place(3, 4, 1, ("WGSL to the page's GLSL", "a developer's program")),
    "storage": Place(4, 1, 1, ("the store: rows, jobs, objects", "a folder; or PostgreSQL, a bucket")),
    "pipeline": Place(4, 2, 1, ("upload → model and facts", "knows no storage, no async")),
    "render": Place(4, 4, 1, ("scene → pixels → PNG", "CPU and GPU")),
    "case": Place(6, 0, 1, ("the vocabulary", "ids, states, facts, failures")),
    "imaging": Place(5, 1, 1, ("file formats", "NIfTI, DICOM ↔ values")),
    "extraction": Place(5, 2, 1, ("head → brain mask", "and how far to trust it")),
    "analysis": Place(5, 3, 1, ("reading aids", "mirror, blur, registration")),
    "geometry": Place(6, 1, 4, ("mask → envelope → distance → forest → mesh: the DeformableModel", "values in, values out; no files, no tasks, no GPU")),
}

# Not a crate: it reaches the service over HTTP alone.
PAGE = Place(1, 3.5, 1.5, ("web/: the page", "TypeScript and WebGL2"))

STYLE = """
  svg { background: #ffffff; font-family: system-ui, "Segoe UI", Helvetica, Arial, sans-serif }
  .ground { fill: #ffffff }
  .box { fill: #eef3f8; stroke: #5b7083 }
  .page { fill: #ffffff; stroke-dasharray: 5 4 }
  text { fill: #1b2733; font-size: 12px; text-anchor: middle }
  .name { font-size: 15px; font-weight: 600 }
  .arrow { stroke: #5b7083; stroke-width: 1.4; fill: none }
  .head { fill: #5b7083 }
  @media (prefers-color-scheme: dark) {
    svg { background: #12181f }
    .ground { fill: #12181f }
    .box { fill: #1f2b37; stroke: #8fa6ba }
    .page { fill: #12181f }
    text { fill: #e3ebf2 }
    .arrow { stroke: #8fa6ba }
    .head { fill: #8fa6ba }
  }
"""


def dependencies():
    """For each crate of server/ the crates that it needs, by their short names."""
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]
    crates = {Path(member).name for member in workspace["members"] if member.startswith("server/")}
    needs = {}
    for crate in crates:
        manifest = tomllib.loads((ROOT / "server" / crate / "Cargo.toml").read_text())
        needs[crate] = crates & manifest.get("dependencies", {}).keys()
    return needs


def reached(needs, crate):
    """All crates that `crate` stands on."""
    return needs[crate].union(*(reached(needs, other) for other in needs[crate]))


def arrows(needs):
    """The dependencies that do not follow from others."""
    for crate in sorted(needs):
        for target in sorted(needs[crate]):
            if not any(target in reached(needs, other) for other in needs[crate]):
                yield crate, target


def clamped(value, least, most):
    return max(least, min(value, most))


def arrow(above, below):
    """A line from one box down to another, as upright as the boxes allow."""
    inset = 24
    low, high = max(above.left, below.left) + inset, min(above.right, below.right) - inset
    if low <= high:
        start = end = (low + high) / 2
    else:
        toward = below.left if below.left > above.right else below.right
        start = clamped(toward, above.left + inset, above.right - inset)
        end = clamped(start, below.left + inset, below.right - inset)
    return (
        f'<path class="arrow" marker-end="url(#head)" d="M{start:g} {above.bottom:g}'
        f' L{end:g} {below.top - 2:g}"/>'
    )


def box(name, place, kind="box"):
    middle = (place.left + place.right) / 2
    size = f'width="{place.right - place.left:g}" height="{HEIGHT}"'
    title, lines = (name, place.lines) if name else (place.lines[0], place.lines[1:])
    parts = [f'<rect class="{kind}" x="{place.left:g}" y="{place.top:g}" {size} rx="6"/>']
    parts.append(f'<text class="name" x="{middle:g}" y="{place.top + 21:g}">{title}</text>')
    for number, line in enumerate(lines):
        parts.append(f'<text x="{middle:g}" y="{place.top + 38 + 15 * number:g}">{line}</text>')
    return "".join(parts)


def picture(needs):
    width = MARGIN + 5 * COLUMN - (COLUMN - WIDTH) + MARGIN
    height = MARGIN + 6 * ROW + HEIGHT + 2 * MARGIN + 8
    service = PLACES["service"]
    beside = service.top + HEIGHT / 2
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">',
        "<title>The crates of Isocortex and what each stands on</title>",
        f"<style>{STYLE}</style>",
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path class="head" d="M0 0 L8 4 L0 8 z"/></marker></defs>',
        f'<rect class="ground" width="{width}" height="{height}"/>',
        *(arrow(PLACES[crate], PLACES[target]) for crate, target in arrows(needs)),
        f'<path class="arrow" stroke-dasharray="5 4" marker-end="url(#head)" d="M{PAGE.left:g} {beside:g}'
        f' L{service.right + 2:g} {beside:g}"/>',
        f'<text x="{(PAGE.left + service.right) / 2:g}" y="{beside - 8:g}">HTTP</text>',
        *(box(name, place) for name, place in PLACES.items()),
        box("", PAGE, "box page"),
        f'<text x="{width / 2:g}" y="{height - MARGIN:g}">An arrow means “depends on”.'
        " A crate may also use what lies further down its arrows.</text>",
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def main():
    needs = dependencies()
    if missing := needs.keys() ^ PLACES.keys():
        sys.exit(f"give these crates a place in {Path(__file__).name}, or remove it: {', '.join(sorted(missing))}")
    drawn = picture(needs)
    if "--check" not in sys.argv[1:]:
        PICTURE.write_text(drawn)
    elif not PICTURE.exists() or PICTURE.read_text() != drawn:
        sys.exit("docs/crates.svg is stale: run scripts/draw-crates.py")


if __name__ == "__main__":
    main()
