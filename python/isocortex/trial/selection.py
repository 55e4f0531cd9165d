"""The heads of a BIDS folder, the table of participants, and who is a patient or a control."""

from __future__ import annotations

import csv
import fnmatch
import io
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import List, Sequence, Tuple

from .._http import IsocortexError

# The column that names the participant; without it, the first column does.
ID_COLUMNS = ("participant_id", "participant", "subject", "id")
CHILD_BELOW = 16.0
Strata = List[Tuple[str, str]]


@dataclass(frozen=True)
class Choice:
    """A column and its value: `group=fcd`."""

    column: str
    value: str

    @classmethod
    def parse(cls, text: str) -> Choice:
        column, _, value = (part.strip() for part in text.partition("="))
        if not column or not value:
            raise ValueError
        return cls(column, value)

    def holds(self, row: Row | None) -> bool:
        return row is not None and (row.get(self.column) or "").lower() == self.value.lower()

    def __str__(self) -> str:
        return f"{self.column}={self.value}"


class Row:
    """A row of a table."""

    def __init__(self, columns: list[str], cells: list[str]) -> None:
        # The first of two columns with one name holds.
        self._cells = dict(reversed(list(zip((name.lower() for name in columns), (cell.strip() for cell in cells)))))
        named = (self.get(column) for column in ID_COLUMNS)
        self.id = next(filter(None, named), cells[0].strip() if cells else "")
        ages = (name for name in columns if re.match(r"age($|[_ ])", name.lower()))
        try:
            self.age_years = float(self.get(next(ages, "")) or "")
        except ValueError:
            self.age_years = float("nan")

    def get(self, column: str) -> str | None:
        """The value in a column; `None` if there is no such column, or the value is empty or `n/a`."""
        value = self._cells.get(column.lower(), "")
        return None if value.lower() in ("", "n/a") else value


class Table:
    """A table with a line of column names, tab-separated if that line has a tab, otherwise comma-separated."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            text = path.read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise IsocortexError(f"{path} cannot be read: {error}") from error
        is_tabbed = "\t" in text.partition("\n")[0]
        dialect = {"delimiter": "\t", "quoting": csv.QUOTE_NONE} if is_tabbed else {}
        try:
            lines = list(csv.reader(io.StringIO(text), **dialect))  # type: ignore[arg-type]
        except csv.Error as error:
            raise IsocortexError(f"{path} is no table: {error}") from error
        lines = [line for line in lines if any(cell.strip() for cell in line)]
        if not lines:
            raise IsocortexError(f"{path} is empty")
        self.columns = [name.strip() for name in lines[0]]
        self.rows = [Row(self.columns, line) for line in lines[1:]]

    def row(self, head: str, folders: Sequence[str] = ()) -> Row | None:
        """The row of a head; not one that has the very name of another of these folders."""
        id = same_head(head, [row.id for row in self.rows])
        is_of_other = id is not None and any(_label(id) == _label(other) != _label(head) for other in folders)
        return None if is_of_other else next((row for row in self.rows if row.id == id), None)

    def check_column(self, column: str) -> None:
        if column.lower() not in (name.lower() for name in self.columns):
            raise IsocortexError(f'{self.path} has no column "{column}"; it has {", ".join(self.columns)}')


def is_same_head(one: str, other: str) -> bool:
    """Whether two names mean the same head: `sub-07`, `07` and `7` do."""

    def number(name: str) -> str:
        return str(int(name)) if name.isascii() and name.isdigit() else name

    return number(_label(one)) == number(_label(other))


def _label(name: str) -> str:
    name = name.strip()
    return name[4:] if name.startswith("sub-") else name


def same_head(name: str, others: Sequence[str]) -> str | None:
    """The one of some names that means the same head. With zeros or without, `sub-1` and `sub-01` may be two heads."""
    exact = [other for other in others if _label(other) == _label(name)]
    alike = dict.fromkeys(exact or [other for other in others if is_same_head(other, name)])
    if len(alike) > 1:
        raise IsocortexError(f"{name} may be any of {', '.join(alike)}: write the same name everywhere")
    return next(iter(alike), None)


@dataclass
class HeadFiles:
    """A head of the folder, with its files in the order of their names. The first volume of each kind is used, but the
    T1-weighted volumes begin with that of the session, and of the name, of the first truth."""

    name: str
    t1: list[Path]
    flair: list[Path]
    truths: list[Path]
    other_truths: list[Path] = field(default_factory=list)
    """Truths of another session, or of another T1-weighted volume than the one that is used."""


def stem(path: Path) -> str:
    """The name of a NIfTI file without its ending."""
    return re.sub(r"\.nii(\.gz)?$", "", path.name)


def matching(folder: Path, pattern: str) -> list[Path]:
    """The files below a folder that match a pattern, in which `*` is any text within a part."""
    part, _, rest = pattern.partition("/")
    if not folder.is_dir():
        return []
    # Brackets and question marks are letters here.
    part = re.sub(r"([\[?])", r"[\1]", part)
    found = [path for path in sorted(folder.iterdir()) if fnmatch.fnmatchcase(path.name, part)]
    if rest:
        return [file for path in found for file in matching(path, rest)]
    return [path for path in found if path.is_file()]


def heads_of(bids: Path, pattern: str, truth_folder: Path | None = None) -> list[HeadFiles]:
    """The heads of a BIDS folder, in the order of their names.

    pattern: of the truths, relative to the folder of each head or session, or to `truth_folder`. `{id}` is the name of
        the head without `sub-`, `{n}` the same without leading zeros.
    """
    try:
        folders = sorted(path for path in bids.iterdir() if path.is_dir() and path.name.startswith("sub-"))
    except OSError as error:
        raise IsocortexError(f"{bids} cannot be read: {error}") from error
    if not folders:
        raise IsocortexError(f"{bids} has no folder sub-*: it is not a BIDS folder")
    heads = []
    for folder in folders:
        sessions = sorted(path for path in folder.iterdir() if path.is_dir() and path.name.startswith("ses-"))
        scanned = [folder, *sessions]
        id = folder.name[4:]
        own = pattern.replace("{id}", id).replace("{n}", id.lstrip("0") or id)

        def images(suffix: str, scanned: list[Path] = scanned) -> list[Path]:
            endings = (f"anat/*_{suffix}.nii.gz", f"anat/*_{suffix}.nii")
            found = (path for folder in scanned for ending in endings for path in matching(folder, ending))
            return sorted(path for path in found if not re.search(r"_(desc|space)-", path.name))

        truths = [path for place in ([truth_folder] if truth_folder else scanned) for path in matching(place, own)]
        head = HeadFiles(folder.name, images("T1w"), images("FLAIR"), sorted(set(truths)))
        if head.t1 and head.truths:
            head.t1.sort(key=lambda path: _distance(path, head.truths[0]))
            used = head.t1[0]
            belongs = [truth for truth in head.truths if _is_of(truth, used, head.t1)]
            head.other_truths = [truth for truth in head.truths if truth not in belongs]
            head.truths = belongs
        heads.append(head)
    return heads


def entity(path: Path, name: str) -> str:
    """An entity in the name of a BIDS file, such as its session; empty if it has none."""
    found = re.search(rf"(?:^|_){name}-([^_]*)_", path.name)
    return found[1] if found else ""


def _distance(t1: Path, truth: Path) -> tuple[bool, int]:
    """Least for the T1-weighted volume that a truth belongs to: one of its session, whose name has most in common."""
    prefix = stem(t1)[: -len("T1w")]
    return _session(t1) != _session(truth), -len(prefix) if truth.name.startswith(prefix) else 0


def _session(path: Path) -> str:
    """The session in whose folder, or in whose name, a file is."""
    folders = (parent.name for parent in list(path.parents)[:2] if parent.name.startswith("ses-"))
    return entity(path, "ses") or next(folders, "ses-")[4:]


def _is_of(truth: Path, used: Path, t1: list[Path]) -> bool:
    sessions = {_session(path) for path in t1}
    if _session(truth) in sessions and _session(truth) != _session(used):
        return False
    own = [path for path in t1 if stem(truth).startswith(stem(path))]
    return not own or used in own


@dataclass(frozen=True)
class Remark:
    """A head that is left out, or used with a remark."""

    head: str
    reason: str


@dataclass
class Chosen:
    """A head of the trial."""

    files: HeadFiles
    role: str
    """`patient` or `control`."""
    strata: Strata
    """Names and values from the table of participants."""


@dataclass
class Wish:
    """Which heads belong to a trial, and as what. `None` for the table of the folder, for every head with a truth as a
    patient, for no controls, for all participants."""

    participants: Path | None = None
    patients: Choice | None = None
    controls: Choice | None = None
    split: Choice | None = None
    mri_negative: Choice | None = None
    strata: list[str] = field(default_factory=list)
    needs_controls: bool = True


@dataclass
class Selection:
    """The heads of a folder: those of the trial, and those that are left out."""

    folders: int
    chosen: list[Chosen]
    left_out: list[Remark]
    table: Path | None
    """The table of participants."""


def select(bids: Path, heads: list[HeadFiles], wish: Wish) -> Selection:
    """Chooses the heads, or states why there is no trial."""
    table = _table(bids, wish)
    selection = Selection(len(heads), [], [], table.path if table else None)
    for row in table.rows if table else []:
        if not any(is_same_head(row.id, head.name) for head in heads):
            selection.left_out.append(Remark(row.id, "in the table of participants, but without a folder"))
    for head in heads:
        row_or_none = table.row(head.name, [one.name for one in heads]) if table else None
        if table and row_or_none is None:
            role, reason = None, "it is not in the table of participants"
        else:
            role, reason = _role(head, row_or_none, wish)
        if role:
            selection.chosen.append(Chosen(head, role, _strata(row_or_none, wish)))
        else:
            selection.left_out.append(Remark(head.name, reason))
    roles = [chosen.role for chosen in selection.chosen]
    if "patient" not in roles:
        advice = "name the files with --truth, and the patients with --patients COLUMN=VALUE"
        _refuse(f"there is no patient with a truth in {bids}; {advice}", selection)
    if wish.needs_controls and "control" not in roles:
        advice = (
            "name them with --controls COLUMN=VALUE. With --no-controls the trial runs without them, and cannot state"
        )
        _refuse(f"there is no control in {bids}; {advice} how often sound heads are marked", selection)
    return selection


def _refuse(text: str, selection: Selection) -> None:
    heads = [f"\n  {remark.head}: {remark.reason}" for remark in selection.left_out[:10]]
    raise IsocortexError(text + "".join(heads))


def _table(bids: Path, wish: Wish) -> Table | None:
    usual = bids / "participants.tsv"
    table = Table(wish.participants or usual) if wish.participants or usual.is_file() else None
    choices = (wish.patients, wish.controls, wish.split, wish.mri_negative)
    for column in [*(choice.column for choice in choices if choice), *wish.strata]:
        if table is None:
            what = f'there is no table with the column "{column}"'
            raise IsocortexError(f"{what}: {usual} is missing; name another one with --participants")
        table.check_column(column)
    return table


def _role(head: HeadFiles, row: Row | None, wish: Wish) -> tuple[str | None, str]:
    """The role of a head, or why it is left out."""
    if wish.split and not wish.split.holds(row):
        return None, f"it is not in the split {wish.split}"
    has_truth = bool(head.truths)
    is_control = wish.controls.holds(row) if wish.controls else False
    is_patient = wish.patients.holds(row) if wish.patients else has_truth and not is_control
    if is_patient and is_control:
        return None, "it is both a patient and a control"
    if not is_patient and not is_control:
        return None, "it is neither a patient nor a control"
    if is_patient and not has_truth:
        return None, "patient without a truth"
    if is_control and has_truth:
        return None, "control with a truth"
    role = "patient" if is_patient else "control"
    if not head.t1:
        return None, f"{role} without a T1-weighted volume (*_T1w.nii.gz)"
    return role, ""


def _strata(row: Row | None, wish: Wish) -> Strata:
    if row is None:
        return []
    is_child = {True: "below 16", False: "from 16 on"}[row.age_years < CHILD_BELOW]
    strata: dict[str, str] = {"age in years": is_child if row.age_years == row.age_years else "unknown"}
    if wish.mri_negative:
        strata["MRI-negative"] = "yes" if wish.mri_negative.holds(row) else "no"
    for column in wish.strata:
        strata[column] = row.get(column) or "unknown"
    return list(strata.items())
