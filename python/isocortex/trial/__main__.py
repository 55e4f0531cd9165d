"""`python -m isocortex.trial`."""

from __future__ import annotations

import argparse
import csv
import dataclasses
import json
import os
import sys
from pathlib import Path
from typing import Any

from .._http import IsocortexError
from .._program import find_program
from .figures import PLACES, SEED, Patient, differences, figures
from .heads import DESCRIPTION, Judgeable, NoMapsError, Outputs, TruthError, read_head, run_program
from .judge import MarkList, judge, marks_of_file
from .lock import locked, sha256, write
from .report import Report
from .selection import Choice, Remark, Selection, Wish, heads_of, select
from .truth import RULES

# Thresholds of the program, which are known before a trial (docs/reading.md).
LIMITS = (("above the limit for unusual", 2.25), ("above the limit for borderline", 2.0))


def _choice(text: str) -> Choice:
    try:
        return Choice.parse(text)
    except ValueError:
        raise argparse.ArgumentTypeError("write COLUMN=VALUE, such as group=fcd") from None


def _jobs(text: str) -> int:
    if not text.isdigit() or not 1 <= int(text) <= 64:
        raise argparse.ArgumentTypeError("must be between 1 and 64")
    return int(text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m isocortex.trial",
        description="Searches for the lesions that people drew in the heads of a BIDS folder, and writes report.html "
        "and report.json. `isocortex bids` prepares the heads; an interrupted trial continues with the next one.",
    )
    add = parser.add_argument
    add("bids", type=Path, metavar="BIDS", help="the folder, with sub-*/anat/*_T1w.nii.gz")
    like = "the files and columns of OpenNeuro ds004199 (bonn) or ds005602 (ideas), unless others are given"
    add("--like", choices=("bonn", "ideas"), help=like)
    truth = "the files with the lesions, relative to the folder of each head; * is any text (default: anat/*_roi.nii*)"
    add("--truth", metavar="PATTERN", help=truth)
    folder = "look for --truth there; {id} is the name of a head without sub-, {n} also without leading zeros"
    add("--truth-dir", type=Path, metavar="DIR", help=folder)
    add("--participants", type=Path, metavar="FILE", help="the table of participants (default: participants.tsv)")
    who: dict[str, Any] = {"type": _choice, "metavar": "COLUMN=VALUE"}
    add("--patients", **who, help="who is a patient (default: every head with a truth that is no control)")
    controls = parser.add_mutually_exclusive_group()
    controls.add_argument("--controls", **who, help="who is a control")
    controls.add_argument("--no-controls", action="store_true", help="run without controls")
    add("--split", **who, help="take these participants alone")
    add("--mri-negative", **who, help="whose MR was first reported as normal; a stratum of the report")
    add("--stratum", action="append", default=[], metavar="COLUMN", help="a further column whose values are strata")
    add("--results", type=Path, default=Path("trial"), metavar="DIR", help="the folder for results (default: trial)")
    add("--derivatives", type=Path, metavar="DIR", help="what `isocortex bids` has written: no head is prepared here")
    freeze = "lock program, package and parameters before the first result; changed ones are refused from then on"
    add("--freeze", action="store_true", help=freeze)
    others = "also judge the marks of another program, a table with participant_id, x, y, z (scanner RAS mm) and score"
    add("--candidates-of", type=Path, action="append", default=[], metavar="FILE", help=others)
    add(
        "--jobs",
        type=_jobs,
        default=1,
        metavar="N",
        help="heads at the same time; one of 256³ voxels needs 0.75 GB (default: 1)",
    )
    add("--json", action="store_true", help="print the figures as JSON")
    return parser


def _wish(arguments: argparse.Namespace) -> Wish:
    is_bonn = arguments.like == "bonn"
    controls = arguments.controls or (Choice("group", "hc") if is_bonn and not arguments.no_controls else None)
    strata = list(arguments.stratum)
    if is_bonn and "split" not in strata:
        strata.append("split")
    return Wish(
        arguments.participants,
        arguments.patients or (Choice("group", "fcd") if is_bonn else None),
        controls,
        arguments.split,
        arguments.mri_negative,
        strata,
        not arguments.no_controls,
    )


def _locked(selection: Selection, pattern: str, wish: Wish, arguments: argparse.Namespace) -> dict[str, Any] | None:
    def files(paths: list[Path]) -> list[list[str]]:
        return [[path.name, sha256(path)] for path in paths]

    is_locked = arguments.freeze or (arguments.results / "frozen.json").exists()
    if is_locked and arguments.derivatives:
        raise IsocortexError("a locked trial prepares its heads: omit --derivatives, or name another --results")
    if not is_locked:
        return None
    choices = {name: getattr(wish, name) for name in ("patients", "controls", "split", "mri_negative")}
    program = Path(find_program())
    parameters: dict[str, Any] = {
        "network": _network(program),
        "rules": dataclasses.asdict(RULES),
        "places": PLACES,
        "seed": SEED,
        "truth": pattern,
        **{name: str(choice) if choice else None for name, choice in choices.items()},
        "strata": wish.strata,
        "heads": {head.files.name: head.role for head in selection.chosen},
        "files": {
            head.files.name: files([*head.files.t1[:1], *head.files.flair, *head.files.truths])
            for head in selection.chosen
        },
        "table of participants": files([selection.table] if selection.table else []),
        "marks of others": files(arguments.candidates_of),
    }
    return locked(arguments.results, program, parameters, arguments.freeze)


def _network(program: Path) -> str | None:
    """The hash of the weights by which the program extracts brains."""
    named, above = os.environ.get("ISOCORTEX_NETWORK"), program.parent.parent
    folders = (program.parent, above, above / "share/isocortex")
    shipped = [path for folder in folders for path in sorted(folder.glob("deepbet-*.whl"))]
    return next(map(sha256, [Path(named)] if named else shipped), None)


def trial(arguments: argparse.Namespace) -> Report:
    """Runs a trial, and returns its report."""
    bids: Path = arguments.bids
    is_ideas = arguments.like == "ideas"
    folder = arguments.truth_dir or (bids / "masks" if is_ideas else None)
    pattern = arguments.truth or ("{n}/{n}_MaskInOrig.nii*" if is_ideas else "anat/*_roi.nii*")
    wish = _wish(arguments)
    folders = heads_of(bids, pattern, folder)
    selection = select(bids, folders, wish)
    chosen_names = [head.files.name for head in selection.chosen]
    every_name = [head.name for head in folders]
    others = [marks_of_file(path, chosen_names, every_name) for path in arguments.candidates_of]
    arguments.results.mkdir(parents=True, exist_ok=True)
    frozen = _locked(selection, pattern, wish, arguments)
    derivatives: Path = arguments.derivatives or arguments.results / "derivatives"
    if not arguments.derivatives:
        run_program(bids, derivatives, [head.files for head in selection.chosen], arguments.jobs)
    version = _version(derivatives)

    heads: list[Judgeable] = []
    remarks: list[Remark] = []
    missed = 0
    for chosen in selection.chosen:
        try:
            heads.append(read_head(chosen, Outputs(derivatives, bids, chosen.files.t1[0])))
            remarks += heads[-1].remarks()
            continue
        except TruthError as error:
            # The program has missed nothing there.
            selection.left_out.append(Remark(chosen.files.name, f"{chosen.role} without a truth: {error}"))
            continue
        except NoMapsError as error:
            reason = str(error)
        except IsocortexError as error:
            reason = f"without a result: {error}"
        except (OSError, LookupError, TypeError, ValueError, csv.Error) as error:
            reason = f"without a result: what isocortex bids has written of it is damaged ({error!r})"
        missed += chosen.role == "patient"
        selection.left_out.append(Remark(chosen.files.name, f"{chosen.role} {reason}"))
    selection.left_out.sort(key=lambda remark: remark.head)

    lists = [MarkList("blur", {head.name: head.marks for head in heads}), *others]
    judged = [
        [judge(marks.heads[head.name], head.lesions, head.plane, head.places) for head in heads] for marks in lists
    ]
    roles = [head.chosen.role for head in heads]
    patients = [
        [Patient(own, head.strata) for own, head in zip(each, heads) if head.chosen.role == "patient"]
        for each in judged
    ]
    names = [head.name for head in heads]
    for marks in others:
        unjudged = [head for head, own in marks.heads.items() if head not in names and len(own.scores)]
        not_judged = f"{marks.name} has marks for it, but it is not judged"
        remarks += [Remark(head, not_judged) for head in [*marks.unknown, *unjudged]]
        without = [head for head in names if not len(marks.heads[head].scores)]
        remarks += [Remark(head, f"{marks.name} has no mark for it") for head in without]
    return Report(
        version=version,
        selection=selection,
        remarks=remarks,
        heads=heads,
        lists=lists,
        judged=judged,
        figures=[
            figures(
                marks.name,
                patients[number],
                [own for own, role in zip(judged[number], roles) if role == "control"],
                missed,
                LIMITS if number == 0 else (),
            )
            for number, marks in enumerate(lists)
        ],
        differences=[
            (f"blur minus {marks.name}", differences(patients[0], others))
            for marks, others in zip(lists[1:], patients[1:])
            if others
        ],
        frozen=frozen,
    )


def _version(derivatives: Path) -> str:
    """That of the program which has prepared the heads."""
    path = derivatives / DESCRIPTION
    try:
        return str(json.loads(path.read_text())["GeneratedBy"][0]["Version"])
    except (OSError, LookupError, ValueError, TypeError) as error:
        raise IsocortexError(f"{path} does not state a version: `isocortex bids` has not written it") from error


def main(words: list[str] | None = None) -> int:
    arguments = _parser().parse_args(words)
    try:
        report = trial(arguments)
        figures = json.dumps(report.json(), indent=2) + "\n"
        write(arguments.results / "report.json", figures)
        page = arguments.results / "report.html"
        write(page, report.html())
    except (IsocortexError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(figures if arguments.json else f"{report.text()}\n{page}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
