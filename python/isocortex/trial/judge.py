"""Compares marks with truths: what is found before how many false marks, and what would be found by chance."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Sequence

import numpy as np

from .._http import IsocortexError
from .selection import Table, same_head
from .truth import FALSE, HIT, RULES, Lesions, Rules

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from .truth import Floats


@dataclass(frozen=True)
class Plane:
    """The plane between the hemispheres. `normal` points towards the patient's left, in scanner RAS."""

    normal: Floats
    offset_mm: float
    is_doubtful: bool = False

    def left_mm(self, positions: Floats) -> Floats:
        return np.asarray(positions @ self.normal - self.offset_mm)

    def reflected(self, positions: Floats) -> Floats:
        return np.asarray(positions - 2 * self.left_mm(positions)[..., None] * self.normal)


class Marks:
    """The marks of a program in a head, the highest first: positions in RAS mm, (n, 3), and scores."""

    def __init__(self, positions: ArrayLike = (), scores: ArrayLike = ()) -> None:
        self.scores = np.array(scores, dtype=float)
        order = np.argsort(-self.scores, kind="stable")
        self.scores = self.scores[order]
        self.positions = np.array(positions, dtype=float).reshape(-1, 3)[order]


@dataclass
class MarkList:
    """The marks of a program in all heads of a trial."""

    name: str
    heads: dict[str, Marks]
    unknown: list[str] = field(default_factory=list)
    """The heads of its file that are not among the heads of the trial."""


@dataclass
class JudgedLesion:
    """What a program finds of one lesion: the number of false marks above the first hit, `None` if no mark hits it."""

    false_marks: int | None = None
    hit_score: float | None = None
    """The score of the first hit."""
    mirrored: int | None = None
    """The false marks with the lesion at its mirrored place."""
    random: list[int | None] = field(default_factory=list)
    """The same with the lesion at random cortical places."""


@dataclass
class JudgedHead:
    """What a program marks in one head. A head without a lesion has false marks alone."""

    lesions: list[JudgedLesion]
    scores: list[float]
    false_scores: list[float]

    @property
    def highest(self) -> float:
        return self.scores[0] if self.scores else -np.inf


def before_hit(touches: NDArray[np.int8]) -> int | None:
    """The number of false marks before the first hit; `None` if there is none."""
    hits = np.flatnonzero(touches == HIT)
    return int((touches[: hits[0]] == FALSE).sum()) if len(hits) else None


def judge(marks: Marks, lesions: Lesions, plane: Plane, places: Floats, rules: Rules = RULES) -> JudgedHead:
    """Judges the marks in a head. `places` are those to which its lesions are moved by chance."""
    touches = lesions.touches(marks.positions, rules)
    is_false = (touches == FALSE).all(axis=0)
    # What hits a truth says nothing about chance.
    others = marks.positions[is_false]
    judged = []
    for lesion, own in zip(lesions.lesions, touches):
        hits = np.flatnonzero(own == HIT)
        shifted = others - (places - lesion.centre)[:, None]
        at_random = lesion.touch(shifted.reshape(-1, 3), rules).reshape(len(places), len(others))
        judged.append(
            JudgedLesion(
                before_hit(own),
                float(marks.scores[hits[0]]) if len(hits) else None,
                before_hit(lesion.touch(plane.reflected(others), rules)),
                [before_hit(touches) for touches in at_random],
            )
        )
    return JudgedHead(judged, marks.scores.tolist(), marks.scores[is_false].tolist())


def marks_of_file(path: Path, heads: Sequence[str], folders: Sequence[str]) -> MarkList:
    """The marks of another program: a table with the columns participant_id, x, y, z (scanner RAS mm) and score.

    heads: those of the trial.
    folders: all heads of the BIDS folder, so that the marks of one that is left out are not taken for another's.
    """
    table = Table(path)
    columns = ("x", "y", "z", "score")
    for column in columns:
        table.check_column(column)
    found: dict[str, list[list[float]]] = {head: [] for head in heads}
    unknown: dict[str, None] = {}
    for number, row in enumerate(table.rows, start=2):
        values = []
        for column in columns:
            try:
                values.append(float(row.get(column) or ""))
            except ValueError:
                values.append(np.nan)
            if not np.isfinite(values[-1]):
                raise IsocortexError(f"row {number} of {path}: {column} must be a number")
        head = same_head(row.id, folders)
        if head and head in found:
            found[head].append(values)
        else:
            unknown[row.id] = None
    if not any(found.values()):
        raise IsocortexError(f"{path} has no mark in any head of the trial")
    marks = {head: Marks([row[:3] for row in rows], [row[3] for row in rows]) for head, rows in found.items()}
    return MarkList(path.name, marks, list(unknown))
