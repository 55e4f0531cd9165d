"""The figures of a trial: shares with intervals, areas, thresholds, strata, chance."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Callable, Sequence

import numpy as np
from scipy import stats

from .judge import JudgedHead, JudgedLesion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .selection import Strata

    Found = Callable[[JudgedLesion, int], float]

# The numbers of false marks in the tables: found with fewer than these.
FALSE_MARKS = (1, 5, 20)
# The marks per control at which thresholds are set.
MARKS_PER_CONTROL = (0.5, 1.0, 2.0)
PLACES = 200
SEED = 20061122
ROUNDS = 1000


@dataclass(frozen=True)
class Interval:
    """A share or another statistic with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass
class Shares:
    """The share of lesions that are found with fewer than 1, 5 and 20 false marks, bootstrapped over patients."""

    name: str
    lesions: int
    patients: int
    found: list[Interval]


@dataclass
class AtThreshold:
    """Sensitivity and specificity if only scores above a threshold count."""

    name: str
    above: float
    lesions_found: Interval | None
    patients_found: Interval | None
    patients_with_marks: Interval | None
    controls_without_marks: Interval | None
    marks_per_control: float | None
    false_marks_per_patient: float | None


@dataclass
class Patient:
    """What is found in a patient, with the strata of each lesion."""

    head: JudgedHead
    strata: Sequence[Strata] = ()


@dataclass
class Figures:
    """All figures of one list of marks."""

    name: str
    shares: list[Shares] = field(default_factory=list)
    """Of lesions; then of patients, with any lesion; then of lesions with heads without maps as missed."""
    chance: list[Shares] = field(default_factory=list)
    strata: dict[str, list[Shares]] = field(default_factory=dict)
    area: Interval | None = None
    """The area under the curve of the highest score of patients against controls."""
    thresholds: list[AtThreshold] = field(default_factory=list)


@functools.lru_cache(maxsize=None)
def drawn(*counts: int) -> list[NDArray[np.int64]]:
    """The members of groups that each sample draws with replacement, by number: (rounds, count) for each group."""
    random = np.random.default_rng(SEED)
    return [random.integers(count, size=(ROUNDS, count)) for count in counts]


def _interval(value: float, samples: NDArray[np.float64]) -> Interval:
    samples = np.sort(samples)
    return Interval(float(value), float(samples[ROUNDS * 25 // 1000]), float(samples[ROUNDS * 975 // 1000 - 1]))


def quotient(patients: Sequence[tuple[float, float]]) -> Interval:
    """The quotient of sums over patients: the parts over the wholes."""
    parts, wholes = np.array(patients, dtype=float).T
    [numbers] = drawn(len(patients))
    samples = parts[numbers].sum(axis=1) / np.maximum(wholes[numbers].sum(axis=1), 1)
    return _interval(parts.sum() / max(wholes.sum(), 1), samples)


def share(patients: Sequence[tuple[float, float]]) -> Interval:
    """A share whose parts and wholes come from patients.

    If all or nothing is found, every sample is the same: then the interval is Wilson's for the number of patients.
    """
    found = quotient(patients)
    if 0 < found.value < 1:
        return found
    count = len(patients)
    ends = stats.binomtest(count if found.value else 0, count).proportion_ci(method="wilson")
    return Interval(found.value, float(ends.low), float(ends.high))


def is_found(above: int | None, fewer_than: int) -> bool:
    return above is not None and above < fewer_than


def _own(lesion: JudgedLesion, fewer_than: int) -> float:
    return is_found(lesion.false_marks, fewer_than)


def _by_mirror(lesion: JudgedLesion, fewer_than: int) -> float:
    return is_found(lesion.mirrored, fewer_than)


def _at_random(lesion: JudgedLesion, fewer_than: int) -> float:
    return sum(is_found(above, fewer_than) for above in lesion.random) / max(len(lesion.random), 1)


def shares(name: str, patients: Sequence[Sequence[JudgedLesion]], found: Found = _own) -> list[Shares]:
    """One row, or none if no patient has a lesion. Patients without a lesion are left out."""
    patients = [lesions for lesions in patients if lesions]
    if not patients:
        return []
    each = [
        share([(sum(found(lesion, most) for lesion in lesions), len(lesions)) for lesions in patients])
        for most in FALSE_MARKS
    ]
    return [Shares(name, sum(map(len, patients)), len(patients), each)]


def figures(
    name: str,
    patients: Sequence[Patient],
    controls: Sequence[JudgedHead],
    missed: int = 0,
    limits: Sequence[tuple[str, float]] = (),
) -> Figures:
    """`missed` is the number of patients without maps; `limits` are thresholds that are known before."""
    result = Figures(name)
    every = [patient.head.lesions for patient in patients]
    result.shares = shares("lesions", every)
    if patients:
        any_found = [
            share([(any(_own(lesion, most) for lesion in lesions), 1) for lesions in every]) for most in FALSE_MARKS
        ]
        result.shares.append(Shares("patients, with any lesion", sum(map(len, every)), len(patients), any_found))
    if missed and result.shares:
        with_missed = "lesions, with patients without maps as one missed lesion each"
        result.shares += shares(with_missed, [*every, *([JudgedLesion()] for _ in range(missed))])
    result.chance = shares("moved to their mirrored places", every, _by_mirror)
    result.chance += shares(f"moved to {PLACES} random cortical places", every, _at_random)
    result.strata = _strata(patients)
    highest = [[head.highest for head in heads] for heads in ([patient.head for patient in patients], controls)]
    if all(highest):
        result.area = area(*highest)
    result.thresholds = [_at_threshold(name, above, patients, controls) for name, above in [*_rates(controls), *limits]]
    return result


def _strata(patients: Sequence[Patient]) -> dict[str, list[Shares]]:
    tags = [dict.fromkeys(strata) for patient in patients for strata in patient.strata]
    rows: dict[str, list[Shares]] = {}
    for name in dict.fromkeys(name for strata in tags for name, _ in strata):
        rows[name] = []
        for value in sorted({value for strata in tags for other, value in strata if other == name}):
            chosen = [
                [lesion for lesion, own in zip(patient.head.lesions, patient.strata) if (name, value) in own]
                for patient in patients
            ]
            rows[name] += shares(value, chosen)
    return rows


def area(patients: Sequence[float], controls: Sequence[float]) -> Interval:
    """How often a score of a patient exceeds one of a control; equal ones count half."""
    ones, others = np.array(patients)[:, None], np.array(controls)
    wins = (ones > others) / 2 + (ones >= others) / 2
    # How often each sample has drawn each member.
    counts = [
        np.array([np.bincount(numbers, minlength=group.shape[1]) for numbers in group])
        for group in drawn(len(patients), len(controls))
    ]
    samples = ((counts[0] @ wins) * counts[1]).sum(axis=1) / wins.size
    return _interval(wins.mean(), samples)


def _rates(controls: Sequence[JudgedHead]) -> list[tuple[str, float]]:
    """The thresholds at which controls have so many marks on average."""
    if not controls:
        return []
    scores = sorted((score for head in controls for score in head.scores), reverse=True)
    scores.append(-np.inf)
    # So many marks of all controls are above the next one.
    at = [min(int(rate * len(controls)), len(scores) - 1) for rate in MARKS_PER_CONTROL]
    return [(f"{rate:g} marks per control", scores[marks]) for rate, marks in zip(MARKS_PER_CONTROL, at)]


def _at_threshold(name: str, above: float, patients: Sequence[Patient], controls: Sequence[JudgedHead]) -> AtThreshold:
    heads = [patient.head for patient in patients]

    def count(scores: Sequence[float]) -> int:
        return sum(score > above for score in scores)

    def some(each: list[tuple[float, float]]) -> Interval | None:
        return share(each) if each else None

    def mean(counts: list[int]) -> float | None:
        return sum(counts) / len(counts) if counts else None

    hits = [[lesion.hit_score is not None and lesion.hit_score > above for lesion in head.lesions] for head in heads]
    return AtThreshold(
        name,
        above,
        lesions_found=some([(sum(lesions), len(lesions)) for lesions in hits]),
        patients_found=some([(any(lesions), 1) for lesions in hits]),
        patients_with_marks=some([(head.highest > above, 1) for head in heads]),
        controls_without_marks=some([(not head.highest > above, 1) for head in controls]),
        marks_per_control=mean([count(head.scores) for head in controls]),
        false_marks_per_patient=mean([count(head.false_scores) for head in heads]),
    )


def differences(ones: Sequence[Patient], others: Sequence[Patient]) -> list[Interval]:
    """The differences between the shares of lesions that two lists find, over the same patients."""

    def hits(patient: Patient, most: int) -> int:
        return sum(is_found(lesion.false_marks, most) for lesion in patient.head.lesions)

    return [
        quotient([(hits(one, most) - hits(other, most), len(one.head.lesions)) for one, other in zip(ones, others)])
        for most in FALSE_MARKS
    ]
