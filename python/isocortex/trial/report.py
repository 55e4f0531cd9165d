"""The report of a trial: one HTML file without scripts, JSON, and a few lines for a terminal."""

from __future__ import annotations

import dataclasses
import io
import json
import math
from dataclasses import dataclass
from html import escape
from typing import Any, Iterable, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from .figures import FALSE_MARKS, PLACES, AtThreshold, Figures, Interval, Shares, is_found
from .heads import Judgeable
from .judge import JudgedHead, MarkList
from .selection import Remark, Selection
from .truth import RULES

NOTICE = "For research use only. Not for diagnosis."
TITLE = "A trial on your own data"
# What the file may load: nothing.
POLICY = "default-src 'none'; style-src 'unsafe-inline'"
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #1b1f24; background: #fff; max-width: 62rem; margin: 2rem auto;
  padding: 0 1.2rem; }
h1 { font-size: 1.6rem; margin: 0 0 .4rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .5rem; border-bottom: 1px solid #d0d5da; }
h3 { font-size: 1rem; margin: 1.4rem 0 .3rem; }
table { border-collapse: collapse; margin: .6rem 0 1rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .22rem .9rem .22rem 0; border-bottom: 1px solid #e3e7ea; vertical-align: top; }
th { font-weight: 600; }
th[colspan] { padding-top: .9rem; color: #57606a; font-weight: 400; }
.notice { background: #fff4d6; border: 1px solid #e2c26a; padding: .5rem .8rem; }
.answer { background: #eef4fb; border: 1px solid #b9cfe6; padding: .6rem .9rem; }
.hash { font-family: ui-monospace, monospace; font-size: .85em; overflow-wrap: anywhere; white-space: pre-wrap; }
.scroll { overflow-x: auto; }
svg { max-width: 100%; height: auto; }
summary { cursor: pointer; font-weight: 600; }
small { color: #57606a; }
@media print { body { margin: 0; max-width: none; } details > * { display: block; } }
"""
# Colours for colour-blind readers (Okabe and Ito).
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
CURVE = (1, 2, 3, 5, 7, 10, 20, 30, 50, 100)


@dataclass
class Report:
    """All that a trial states. `judged` has the heads for each list of marks, in the order of `heads`."""

    version: str
    selection: Selection
    remarks: list[Remark]
    heads: list[Judgeable]
    lists: list[MarkList]
    judged: list[list[JudgedHead]]
    figures: list[Figures]
    differences: list[tuple[str, list[Interval]]]
    frozen: dict[str, Any] | None

    def count(self, role: str) -> int:
        return sum(head.chosen.role == role for head in self.heads)

    def json(self) -> dict[str, Any]:
        heads = [
            {
                "head": head.name,
                "role": head.chosen.role,
                "mask": head.mask,
                "highest_scores": [judged[number].highest for judged in self.judged],
                "lesions": [
                    {
                        **dataclasses.asdict(lesion),
                        "truth": head.truths[0].place,
                        "false_marks": [judged[number].lesions[place].false_marks for judged in self.judged],
                    }
                    for place, lesion in enumerate(head.found)
                ],
            }
            for number, head in enumerate(self.heads)
        ]
        facts = {
            "format": "isocortex trial 1",
            "version": self.version,
            "notice": NOTICE,
            "frozen": self.frozen,
            "rules": dataclasses.asdict(RULES),
            "fewer_false_marks_than": FALSE_MARKS,
            "folders": self.selection.folders,
            "patients": self.count("patient"),
            "controls": self.count("control"),
            "left_out": [dataclasses.asdict(remark) for remark in self.selection.left_out],
            "remarks": [dataclasses.asdict(remark) for remark in self.remarks],
            "lists": [dataclasses.asdict(figures) for figures in self.figures],
            "differences": [
                {"lists": name, "points": list(map(dataclasses.asdict, points))} for name, points in self.differences
            ],
            "heads": heads,
        }
        result: dict[str, Any] = _finite(facts)
        return result

    def text(self) -> str:
        """A few lines for a terminal."""
        left_out = self.selection.left_out
        lines = [f"{self.selection.folders} folders, {self._counted()} judged, {_heads(len(left_out))} left out"]
        lines += [f"  {remark.head}: {remark.reason}" for remark in left_out]
        for figures in self.figures:
            lines += ["", f"{figures.name}: found with fewer than 1 / 5 / 20 false marks"]
            for row in [*figures.shares, *figures.chance]:
                lines.append(f"  {row.name} ({row.lesions}): {' / '.join(map(percent, row.found))}")
            if figures.area:
                what = "area under the curve of the highest score, patients against controls"
                lines.append(f"  {what}: {number(figures.area)}")
        return "\n".join(lines) + "\n"

    def _counted(self) -> str:
        return f"{self.count('patient')} patients and {self.count('control')} controls"

    def html(self) -> str:
        """The report as one HTML file."""
        parts = [
            f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{TITLE}</title><style>{STYLE}</style></head><body><h1>{TITLE}</h1>"
            f'<p class="notice">{NOTICE}</p>',
            self._answer(),
            self._lock(),
            self._heads(),
            self._curves(),
            *(self._list(number) for number in range(len(self.lists))),
            self._compared(),
            RULES_IN_WORDS,
            self._all_heads(),
            _listed("Heads left out", self.selection.left_out),
            _listed("Remarks", self.remarks),
            "</body></html>\n",
        ]
        return "\n".join(parts)

    def _answer(self) -> str:
        """The result in sentences."""
        own = self.figures[0]
        sentences = ["No patient could be judged. The list of heads left out states why."]
        if own.shares:
            chance = "".join(f"; {whole(row.found[1].value)} of lesions {row.name}" for row in own.chance)
            found = f"<b>{percent(own.shares[0].found[1])}</b> of {own.shares[0].lesions} lesions"
            patients = f"in {self.count('patient')} patients before the fifth false mark"
            sentences = [f"The places that the map lists contain {found} {patients}{chance}."]
        if own.area:
            what = "The highest score of a head is higher in patients than in controls with a probability of"
            sentences.append(f"{what} <b>{number(own.area)}</b> (0.5 is chance).")
        for at in own.thresholds:
            if "unusual" in at.name and at.controls_without_marks and at.lesions_found:
                controls = f"{percent(at.controls_without_marks)} of {self.count('control')} controls"
                lesions = f"{percent(at.lesions_found)} of the lesions have a place above it"
                sentences.append(f"No place is above the limit for unusual ({at.above}) in {controls}; {lesions}.")
        sentences.append(
            "<small>Intervals of 95 %, bootstrapped over patients (if all or nothing is found, those of Wilson). This "
            "measures a list of places against lesions that people drew. It does not measure what a reader finds with "
            "the list, and says nothing about a single patient: a head without a place is not a head without a lesion."
            "</small>"
        )
        return f'<div class="answer">{"".join(f"<p>{sentence}</p>" for sentence in sentences)}</div>'

    def _lock(self) -> str:
        title = "<h2>Program and parameters</h2>"
        if not self.frozen:
            words = (
                "The trial was not locked before its first result; <code>--freeze</code> in an empty directory does so."
            )
            return f"{title}<p>Version {escape(self.version)}. {words}</p>"
        frozen = self.frozen
        names = {"program": "program", "package": "package", "parameters": "parameters_hash"}
        hashes = "".join(
            f'<tr><th>{name}</th><td class="hash">{escape(frozen[key])}</td></tr>' for name, key in names.items()
        )
        parameters = escape(json.dumps(frozen["parameters"], indent=2))
        return (
            f"{title}<p>Version {escape(self.version)}, locked before the first result (SHA-256):</p>"
            f"<table>{hashes}</table><details><summary>The locked parameters</summary>"
            f'<pre class="hash">{parameters}</pre></details>'
        )

    def _heads(self) -> str:
        left_out = len(self.selection.left_out)
        rows: list[list[Any]] = [
            ["folders", self.selection.folders],
            ["patients judged", self.count("patient")],
            ["controls judged", self.count("control")],
            ["left out", f"{left_out}, listed at the end with reasons" if left_out else 0],
        ]
        warning = "There are no controls: nothing here states how often sound heads are marked."
        notice = "" if self.count("control") else f'<p class="notice">{warning}</p>'
        return f"<h2>Heads</h2>{_table([], rows)}{notice}"

    def _curves(self) -> str:
        """Shares of lesions over false marks, for each list, and by chance for the first."""
        lesions = [[lesion for head in judged for lesion in head.lesions] for judged in self.judged]
        if not lesions[0]:
            return ""
        figure = Figure((7.6, 5.2), layout="constrained")
        axes = figure.subplots()
        curves = [(figures.name, [lesion.false_marks for lesion in own]) for figures, own in zip(self.figures, lesions)]
        for (name, found), colour in zip(curves, [COLOURS[number % 7] for number in range(len(curves))]):
            axes.plot(CURVE, _curve(found), "o-", color=colour, label=name)
        own = lesions[0]
        axes.plot(CURVE, _curve([lesion.mirrored for lesion in own]), "--", color="#57606a", label="mirrored places")
        at_random = [above for lesion in own for above in lesion.random]
        axes.plot(CURVE, _curve(at_random), ":", color="#57606a", label="random places")
        axes.set(xscale="log", xlabel="fewer false marks in the head than", ylabel="share of lesions found")
        axes.set(xticks=CURVE, xticklabels=CURVE, ylim=(0, 1.02), title=f"Found of {len(own)} lesions")
        axes.minorticks_off()
        axes.legend(loc="upper left")
        return _svg(figure, "the share of lesions found, by false marks")

    def _list(self, place: int) -> str:
        figures = self.figures[place]
        html = f"<h2>The list {escape(figures.name)}</h2>"
        html += "<p>Share found with fewer than so many false marks in the head.</p>" + _shares([("", figures.shares)])
        if figures.chance:
            words = "The same lesions at places that have none. A list that points nowhere finds as many."
            html += f"<h3>By chance</h3><p>{words}</p>{_shares([('', figures.chance)])}"
        if figures.area:
            words = f"The highest score of each head. Area under the curve: <b>{number(figures.area)}</b>."
            html += f"<h3>Patients against controls</h3><p>{words}</p>{self._strips(place)}"
        if figures.thresholds:
            html += f"<h3>Thresholds</h3>{_thresholds(figures.thresholds)}"
        if figures.strata:
            words = "Lesions of each kind. Few of a kind state little: look at the intervals."
            html += f"<h3>Strata</h3><p>{words}</p>{_shares(figures.strata.items())}"
        return html

    def _strips(self, place: int) -> str:
        """The highest score of each patient and each control, as dots. A head without marks is at the lower end."""
        figure = Figure((7.4, 1.6), layout="constrained")
        axes = figure.subplots()
        heads = list(zip(self.heads, self.judged[place]))
        finite = [judged.highest for _, judged in heads if judged.scores]
        for row, role in enumerate(("control", "patient")):
            scores = [max(judged.highest, min(finite, default=0)) for head, judged in heads if head.chosen.role == role]
            heights = row + np.array([-0.15, 0, 0.15])[np.arange(len(scores)) % 3]
            axes.plot(scores, heights, "o", color=COLOURS[1 - row], alpha=0.55, markersize=5)
        axes.set(yticks=[0, 1], yticklabels=["controls", "patients"], ylim=(-0.5, 1.5))
        axes.spines[["top", "right", "left"]].set_visible(False)
        return _svg(figure, "the highest score of each patient and each control")

    def _compared(self) -> str:
        if not self.differences:
            return ""
        rows = [[name, *map(points, intervals)] for name, intervals in self.differences]
        words = "Differences in the share of lesions found, in points, on the same patients."
        return f"<h2>The lists compared</h2><p>{words}</p>{_table(['', *_fewer()], rows)}"

    def _all_heads(self) -> str:
        names = [figures.name for figures in self.figures]
        titles = ["head", "", "mask", *(f"highest, {name}" for name in names), "lesion, ml", "depth, mm", "side"]
        titles += ["in the map", "truth", *(f"false marks before it, {name}" for name in names)]
        rows = []
        for place, head in enumerate(self.heads):
            highest = [judged[place].highest for judged in self.judged]
            scores = [f"{score:.2f}" if math.isfinite(score) else "none" for score in highest]
            start = [head.name, head.chosen.role, head.mask, *scores]
            if not head.found:
                rows.append(start)
            for at, lesion in enumerate(head.found):
                above = [judged[place].lesions[at].false_marks for judged in self.judged]
                facts = [f"{lesion.volume_ml:.2f}", f"{lesion.depth_mm:.0f}", lesion.side, whole(lesion.defined_share)]
                found = ["not found" if marks is None else str(marks) for marks in above]
                rows.append([*(start if at == 0 else [""] * len(start)), *facts, head.truths[0].place, *found])
        table = _table(titles, rows)
        return f"<h2>Each head</h2><details><summary>The heads that were judged</summary>{table}</details>"


RULES_IN_WORDS = f"""<h2>Rules</h2><ul>
<li>A mark hits a lesion if it lies inside or at most {RULES.hit_mm:g} mm from its border. If the lesion is larger than
{RULES.large_ml:g} ml, the mark must also lie within {RULES.from_centre_mm:g} mm of its centre.</li>
<li>Each connected part of a truth that is larger than {RULES.least_ml:g} ml is a lesion and counts once. If no part is,
the largest one is the lesion. Parts of several files that overlap are one lesion.</li>
<li>A false mark is one that lies farther than {RULES.hit_mm:g} mm from every part of every truth of the head. In a
control every mark is false.</li>
<li>Marks are read from the highest score down; a lesion is found at its first hit.</li>
<li>Chance: each lesion is moved to its mirrored place, and to {PLACES} random places of the cortex, where the map is
defined and the intensity is halfway between grey and white matter, half of them at the bottom of sulci and 60 %
frontal. Marks at a real lesion do not count.</li>
<li>A truth that was drawn on the FLAIR is brought to the T1-weighted volume by the registration of that FLAIR. If the
registration is in doubt, it lies where its header places it.</li>
</ul>"""


def _finite(value: Any) -> Any:
    """JSON has no infinity: a score that does not exist is null."""
    if isinstance(value, dict):
        return {name: _finite(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _curve(found: Sequence[int | None]) -> list[float]:
    return [sum(is_found(above, most) for above in found) / max(len(found), 1) for most in CURVE]


def _svg(figure: Figure, label: str) -> str:
    """A figure within HTML, the same bytes each time."""
    file = io.StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with mpl.rc_context({"svg.hashsalt": "isocortex", "svg.fonttype": "none", "font.family": "sans-serif"}):
        figure.savefig(file, format="svg", metadata=nothing)
    svg = file.getvalue()
    return f'<svg role="img" aria-label="{label}"' + svg[svg.index("<svg") + 4 :]


def _table(titles: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """The first cell of each row is its title. A row with one cell is one title over all columns."""
    html = "".join(f"<th>{escape(title)}</th>" for title in titles)
    html = f"<tr>{html}</tr>" if titles else ""
    for first, *others in map(list, rows):
        span = f' colspan="{len(titles)}"' if not others and len(titles) > 1 else ""
        cells = "".join(f"<td>{escape(str(cell))}</td>" for cell in others)
        html += f"<tr><th{span}>{escape(str(first))}</th>{cells}</tr>"
    return f'<div class="scroll"><table>{html}</table></div>'


def _fewer() -> list[str]:
    return [f"fewer than {most}" for most in FALSE_MARKS]


def _shares(groups: Iterable[tuple[str, Sequence[Shares]]]) -> str:
    rows: list[list[Any]] = []
    for name, group in groups:
        rows += [[name]] if name else []
        rows += [[row.name, row.lesions, row.patients, *map(percent, row.found)] for row in group]
    return _table(["", "lesions", "patients", *_fewer()], rows)


def _thresholds(rows: Sequence[AtThreshold]) -> str:
    def some(share: Interval | None) -> str:
        return percent(share) if share else "–"

    def count(mean: float | None) -> str:
        return "–" if mean is None else f"{mean:.2f}"

    titles = ["threshold", "scores above", "lesions found", "patients with a lesion found", "patients with a mark"]
    titles += ["controls without a mark", "marks per control", "false marks per patient"]
    cells = [
        [
            row.name,
            f"{row.above:.2f}" if math.isfinite(row.above) else "any score",
            *map(some, (row.lesions_found, row.patients_found, row.patients_with_marks, row.controls_without_marks)),
            *map(count, (row.marks_per_control, row.false_marks_per_patient)),
        ]
        for row in rows
    ]
    words = (
        "Thresholds of marks per control are chosen on these controls: their specificity is not measured independently."
    )
    return f"{_table(titles, cells)}<p><small>{words}</small></p>"


def _listed(title: str, remarks: Sequence[Remark]) -> str:
    return f"<h2>{title}</h2>{_table([], [[remark.head, remark.reason] for remark in remarks])}" if remarks else ""


def _heads(count: int) -> str:
    return "1 head" if count == 1 else f"{count} heads"


def percent(share: Interval) -> str:
    return f"{100 * share.value:.0f} % ({100 * share.low:.0f} to {100 * share.high:.0f})"


def points(share: Interval) -> str:
    return f"{100 * share.value:+.0f} ({100 * share.low:+.0f} to {100 * share.high:+.0f})"


def whole(share: float) -> str:
    return f"{100 * share:.0f} %"


def number(interval: Interval) -> str:
    return f"{interval.value:.2f} ({interval.low:.2f} to {interval.high:.2f})"
