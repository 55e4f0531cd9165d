"""Whether two scans of one person give the same places: `python -m isocortex.trial.repeat`.

The first 1, 5 and 20 places of each scan are repeated if they lie within 10 mm of one of as many of the other scan. By
chance means the places of the second scan, mirrored. The second scan is brought to the first by registration.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .. import Case, IsocortexError, Server, start
from .._http import FLIP
from .judge import Marks, Plane
from .selection import entity, heads_of
from .truth import RULES, moved

if TYPE_CHECKING:
    from .truth import Floats

# How many of the first places of each scan are compared, and how many a head lists at most.
FIRST, LISTED = (1, 5, 20), 60
UNUSUAL_ABOVE = 2.25


class Pair(NamedTuple):
    """Two scans of one person."""

    name: str
    first: Path
    second: Path


@dataclass
class Repeated:
    """The shares of places of each scan that the other one repeats, within 10 mm."""

    head: str
    second: str
    placement: str
    """How the second scan was brought to the first, or why nothing was compared."""
    of_first: list[float] | None = None
    """Of the first 1, 5 and 20 places, those that are among as many of the other scan."""
    by_chance: list[float] | None = None
    """The same with the places of the second scan mirrored."""
    unusual: list[int] | None = None
    """The number of places above the limit for unusual, in each scan."""
    of_unusual: float | None = None
    """The share of these that the first 20 of the other scan repeat; `None` if there are none."""


def pairs_of(bids: Path) -> list[Pair]:
    """The first T1-weighted volume of each head, and the first one of another session or run."""
    found = []
    for head in heads_of(bids, "anat/*_roi.nii*"):
        scans: dict[tuple[str, str], Path] = {}
        for path in sorted(head.t1):
            # A file of the same session and run is the same scan, reconstructed or written otherwise.
            scans.setdefault((entity(path, "ses"), entity(path, "run")), path)
        first, second = (*scans.values(), None, None)[:2]
        if first and second:
            found.append(Pair(head.name, first, second))
    if not found:
        raise IsocortexError(f"no head in {bids} has two T1-weighted volumes (sessions or runs)")
    return found


def marks_of(case: Case) -> Marks:
    """The places of the map of blur."""
    query = {"map": "blur", "limit": LISTED}
    places = case._connection.json(f"{case._path}/candidates", query)["candidates"]
    positions = np.array([place["position_in_patient"] for place in places]).reshape(-1, 3)
    return Marks(moved(FLIP, positions), np.array([place["score"] for place in places]))


def plane_of(case: Case) -> Plane:
    facts = case.info["midsagittal"]
    return Plane(FLIP[:3, :3] @ np.array(facts["normal"]), facts["offset_mm"], facts["doubtful"])


def hits(ones: Floats, others: Floats) -> int:
    """How many of the first positions lie near one of the others."""
    apart = np.linalg.norm(ones[:, None] - others, axis=2)
    return int((apart <= RULES.hit_mm).any(axis=1).sum())


def repeated(ones: Floats, others: Floats, count: int) -> float:
    """The share of the first positions of both that the first ones of the other repeat."""
    ones, others = ones[:count], others[:count]
    return (hits(ones, others) + hits(others, ones)) / max(len(ones) + len(others), 1)


def compare(pair: Pair, server: Server) -> Repeated:
    """Compares the places of both scans. If they cannot be compared, the result states the reason."""
    result = Repeated(pair.name, pair.second.name, "")
    cases: list[Case] = []
    try:
        _compare(pair, server, cases, result)
    except IsocortexError as error:
        result.placement = result.placement or f"the second scan cannot be brought to the first: {error}"
    finally:
        # Two files with the same bytes are one case.
        for case in {case.id: case for case in cases}.values():
            with contextlib.suppress(IsocortexError):
                case.delete()
    return result


def _compare(pair: Pair, server: Server, cases: list[Case], result: Repeated) -> None:
    """Adds what is found to a result, and the cases that are made to a list."""
    marks: list[Marks] = []
    for which, path in zip(("first", "second"), pair[1:]):
        try:
            cases.append(server.open(path))
            marks.append(marks_of(cases[-1]))
        except IsocortexError as error:
            result.placement = f"the {which} scan has no maps: {error}"
            return
    layer = cases[0].add_layer(pair.second, "second scan")
    if layer["verdict"] == "unchecked":
        result.placement = "the two scans do not fit each other: are they of one person?"
        return
    result.placement = {"registered": "registered", "unchanged": "fits by its header"}[layer["verdict"]]
    first = marks[0].positions
    brought = moved(FLIP @ np.array(layer["case_from_layer"]) @ FLIP, marks[1].positions)
    mirrored = plane_of(cases[0]).reflected(brought)
    result.of_first = [repeated(first, brought, count) for count in FIRST]
    result.by_chance = [repeated(first, mirrored, count) for count in FIRST]
    unusual = [int((own.scores > UNUSUAL_ABOVE).sum()) for own in marks]
    if any(unusual):
        both = hits(first[: unusual[0]], brought[: FIRST[-1]]) + hits(brought[: unusual[1]], first[: FIRST[-1]])
        result.of_unusual = both / sum(unusual)
    result.unusual = unusual


def line(result: Repeated) -> str:
    """A row of the table."""

    def shares(values: list[float] | None) -> str:
        return " / ".join(f"{value:.2f}" for value in values) if values else "–"

    unusual = " and ".join(map(str, result.unusual)) if result.unusual else "–"
    of_unusual = "–" if result.of_unusual is None else f"{result.of_unusual:.2f}"
    cells = [result.head, result.second, result.placement, shares(result.of_first), shares(result.by_chance)]
    return f"| {' | '.join([*cells, unusual, of_unusual])} |"


def main(words: list[str] | None = None) -> int:
    description = "Compares the places of two scans of one person, within 10 mm."
    parser = argparse.ArgumentParser(prog="python -m isocortex.trial.repeat", description=description)
    scans = parser.add_mutually_exclusive_group(required=True)
    heads = "the heads of this folder that have two T1-weighted volumes, as sessions or runs"
    scans.add_argument("bids", type=Path, nargs="?", metavar="BIDS", help=heads)
    pair = "two scans of one person, NIfTI"
    scans.add_argument("--pair", type=Path, nargs=2, metavar=("FIRST", "SECOND"), help=pair)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    arguments = parser.parse_args(words)
    try:
        if arguments.pair:
            # The folder and the file: many files are named t1.nii.gz.
            first, second = arguments.pair
            pairs = [Pair("/".join(first.parts[-2:]), first, second)]
        else:
            pairs = pairs_of(arguments.bids)
        with start() as server:
            results = [compare(pair, server) for pair in pairs]
    except (IsocortexError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if arguments.json:
        print(json.dumps([asdict(result) for result in results], indent=2))
        return 0
    print("| head | second scan | placement | first 1 / 5 / 20 repeated | by chance | unusual | of these repeated |")
    print("|---|---|---|---|---|---|---|")
    print("\n".join(map(line, results)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
