"""What `isocortex bids` has found in a head, and where the lesions of the head lie."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Sequence
from urllib.parse import unquote

import numpy as np
from scipy import ndimage

from .._http import IsocortexError
from .._program import find_program
from .figures import PLACES, SEED
from .judge import Marks, Plane
from .selection import Chosen, HeadFiles, Remark, Strata, stem
from .truth import RULES, Lesion, Lesions, Volume, belonging, lesions_of, moved, opened

if TYPE_CHECKING:
    from .truth import Floats

MIDDLE_MM = 5.0
# The exit status of `isocortex bids` if it has refused a head.
SOME_ARE_NOT_DONE = 65
# What it writes before the first head.
DESCRIPTION = "dataset_description.json"
# How a truth was brought to the T1-weighted volume, by the verdict on the registration of the FLAIR.
ON_T1 = "drawn on the T1"
ON_FLAIR = {
    "registered": "drawn on the FLAIR, registered",
    "unchanged": "drawn on the FLAIR, fits by its header",
    "failed": "drawn on the FLAIR, registration in doubt",
}
# Where a brain mask comes from.
METHODS = {
    "supplied": "mask as supplied",
    "volume": "mask from the skull-stripped volume",
    "network": "brain extracted by the network",
    "tree_pruning": "brain extracted by tree pruning",
}
NOT_REGISTERED = "drawn on a FLAIR that is not registered"


class NoMapsError(Exception):
    """Why nothing can be judged in a head."""


class TruthError(Exception):
    """Why the truth of a head cannot be used."""


@dataclass
class Truth:
    """A file with lesions, and its place in the head."""

    path: Path
    place: str
    head_from_truth: Floats


@dataclass
class FoundLesion:
    """A lesion in the images of its head."""

    volume_ml: float
    depth_mm: float
    """Of its centre, below the envelope; 0 outside."""
    side: str
    defined_share: float
    """The share of its voxels at which the map is defined."""


@dataclass
class Judgeable:
    """A head of the trial with all that its marks are compared with."""

    chosen: Chosen
    voxel_mm: list[float]
    mask: str
    mask_state: str
    plane: Plane
    marks: Marks
    truths: list[Truth]
    lesions: Lesions
    found: list[FoundLesion]
    places: Floats
    """Random cortical places, RAS mm."""

    @property
    def name(self) -> str:
        return self.chosen.files.name

    @property
    def strata(self) -> list[Strata]:
        """Of each lesion: those that follow from the images, then those from the table of participants."""
        return [[*self._strata_of(lesion), *self.chosen.strata] for lesion in self.found]

    def _strata_of(self, lesion: FoundLesion) -> Strata:
        edge_mm = max(self.voxel_mm)
        ml, depth_mm, state = lesion.volume_ml, lesion.depth_mm, self.mask_state
        side = {"middle": "within 5 mm of the middle", "unknown": "in doubt"}.get(lesion.side, lesion.side)
        return [
            ("volume", "below 1 ml" if ml < 1 else "from 1 to 5 ml" if ml <= 5 else "more than 5 ml"),
            ("side", side),
            (
                "depth of the centre",
                "below 8 mm" if depth_mm < 8 else "from 8 to 15 mm" if depth_mm < 15 else "more than 15 mm",
            ),
            (
                "largest voxel edge",
                "below 0.95 mm" if edge_mm < 0.95 else "about 1 mm" if edge_mm <= 1.05 else "more than 1.05 mm",
            ),
            ("truth", self.truths[0].place),
            ("junction", f"where the map is {'defined' if lesion.defined_share > 0 else 'undefined'}"),
            ("brain mask", state),
        ]

    def remarks(self) -> list[Remark]:
        """What a reader of the report must know of it."""
        files, found = self.chosen.files, []
        if len(files.t1) > 1:
            found.append(f"{len(files.t1)} T1-weighted volumes; {files.t1[0].name} is used")
        for path in files.other_truths:
            found.append(f"{path.name}: it belongs to another session or volume, and does not count")
        for truth in self.truths:
            if truth.place in (ON_FLAIR["failed"], NOT_REGISTERED):
                found.append(f"{truth.path.name}: {truth.place}; it lies where its header places it")
        if any(lesion.depth_mm <= 0 for lesion in self.found):
            found.append("the centre of a lesion lies outside the brain; check its file")
        least = RULES.least_ml
        if self.found and self.found[0].volume_ml <= least:
            found.append(f"no part of the truth is larger than {least} ml; the largest counts")
        if self.found and len(self.places) < PLACES:
            found.append("it has too few cortical places for chance")
        return [Remark(self.name, reason) for reason in found]


def run_program(bids: Path, derivatives: Path, heads: Sequence[HeadFiles], jobs: int) -> None:
    """Prepares heads by `isocortex bids`, which continues where it was interrupted. Refused heads are no error."""
    command = [find_program(), "bids", str(bids), str(derivatives), "participant", "--skip-bids-validation"]
    command += ["--jobs", str(jobs), "--participant-label", *(head.name[4:] for head in heads)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    if done.returncode not in (0, SOME_ARE_NOT_DONE) or not (derivatives / DESCRIPTION).is_file():
        raise IsocortexError(f"isocortex bids ended with the status {done.returncode}; its lines above state why")


class Outputs:
    """The files of a head in the folder of derivatives."""

    def __init__(self, derivatives: Path, bids: Path, t1: Path) -> None:
        self._prefix = str(derivatives / t1.parent.relative_to(bids) / stem(t1)[: -len("_T1w")])
        self.head = os.path.basename(self._prefix)
        self._derivatives, self._bids = derivatives, bids

    def raw(self, uri: str) -> Path:
        """The file of the BIDS folder with a BIDS URI."""
        return self._bids / unquote(uri.split(":", 2)[2])

    def path(self, suffix: str) -> Path:
        return Path(f"{self._prefix}_{suffix}")

    def json(self, suffix: str) -> dict[str, Any] | None:
        path = self.path(suffix)
        if not path.is_file():
            return None
        try:
            facts: dict[str, Any] = json.loads(path.read_text())
        except ValueError as error:
            raise IsocortexError(f"{path} is damaged: {error}") from error
        return facts

    def facts(self) -> dict[str, Any]:
        """What is known of the mask; raises the reason if the head has no maps."""
        facts = self.json("desc-brain_mask.json")
        if facts is None:
            raise NoMapsError(f"without maps: {self._reason()}")
        maps = facts["Maps"]
        if maps["State"] != "ready":
            raise NoMapsError(f"without maps ({maps['Code']}): {maps['Reason']}")
        return facts

    def _reason(self) -> str:
        """Why `isocortex bids` has refused the head."""
        path = self._derivatives / "summary.tsv"
        if path.is_file():
            with path.open(newline="") as file:
                for row in csv.DictReader(file, delimiter="\t"):
                    if row["head"] == self.head:
                        return row["reason"] or row["state"]
        return f"{self.path('desc-brain_mask.json')} is missing"

    def marks(self) -> Marks:
        """The candidates of the map of blur."""
        with self.path("desc-places.tsv").open(newline="") as file:
            rows = [row for row in csv.DictReader(file, delimiter="\t") if row["map"] == "blur"]
        positions = [[float(row[axis]) for axis in "xyz"] for row in rows]
        return Marks(positions, [float(row["score"]) for row in rows])


def _truths_of(chosen: Chosen) -> list[Volume]:
    """The truths of a patient, none of a control. Raises the reason if there is nothing to be found."""
    if chosen.role != "patient":
        return []
    try:
        volumes = [opened(path) for path in chosen.files.truths]
    except IsocortexError as error:
        raise TruthError(str(error)) from error
    if not any(belonging(volume.data).any() for volume in volumes):
        raise TruthError("its truth has no voxel")
    return volumes


def read_head(chosen: Chosen, outputs: Outputs) -> Judgeable:
    """A head with its marks and lesions. Raises the reason if it cannot be judged."""
    volumes = _truths_of(chosen)
    facts = outputs.facts()
    truths: list[Truth] = []
    lesions = Lesions([], [])
    if chosen.role == "patient":
        truths = [placed(path, chosen.files, outputs) for path in chosen.files.truths]
        lesions = lesions_of([(volume, truth.head_from_truth) for volume, truth in zip(volumes, truths)])
    plane = facts["Midsagittal"]
    mask = facts["Mask"]
    depth, blur = opened(outputs.path("desc-depth_map.nii.gz")), opened(outputs.path("desc-blur_map.nii.gz"))
    head = Judgeable(
        chosen,
        voxel_mm=facts["VoxelMm"],
        mask=f"{METHODS.get(mask['Method'], mask['Method'])}, {mask['State']}",
        mask_state=mask["State"],
        plane=Plane(np.array(plane["Normal"]), plane["OffsetMm"], plane["Doubtful"]),
        marks=outputs.marks(),
        truths=truths,
        lesions=lesions,
        found=[],
        places=np.empty((0, 3)),
    )
    head.found = [_found(lesion, head.plane, depth, blur) for lesion in lesions.lesions]
    if lesions.lesions:
        head.places = cortical_places(chosen.files.name, head.plane, depth, blur, chosen.files.t1[0])
    return head


def placed(truth: Path, files: HeadFiles, outputs: Outputs) -> Truth:
    """Where a truth belongs. One that was drawn on the FLAIR moves as the FLAIR does."""
    facts = outputs.json("from-FLAIR_to-T1w_mode-image_xfm.json")
    registered = outputs.raw(facts["Sources"][1]) if facts else None
    flair = drawn_on(truth, files, registered)
    if flair == files.t1[0]:
        return Truth(truth, ON_T1, np.eye(4))
    if facts is None or flair != registered:
        return Truth(truth, NOT_REGISTERED, np.eye(4))
    return Truth(truth, ON_FLAIR[facts["Verdict"]], np.array(facts["Matrix"], float))


def drawn_on(truth: Path, files: HeadFiles, registered: Path | None) -> Path | None:
    """The volume on which a truth was drawn, by its name or else by its voxels; `None` for an unknown FLAIR."""
    name = stem(truth)
    if "_T1w" in name:
        return files.t1[0]
    # Of two FLAIRs with the same voxels, the one that is registered.
    offers = sorted(files.flair, key=lambda flair: flair != registered)
    is_on_flair = "_FLAIR" in name
    if is_on_flair:
        offers = [flair for flair in offers if name.startswith(stem(flair))] or offers
    else:
        offers.insert(0, files.t1[0])
    if len(offers) == 1:
        return offers[0]
    own = opened(truth)
    alike = (volume for volume in offers if _have_same_voxels(own, opened(volume)))
    return next(alike, None if is_on_flair else files.t1[0])


def _have_same_voxels(one: Volume, other: Volume) -> bool:
    return bool(one.data.shape == other.data.shape and np.abs(one.affine - other.affine).max() <= 1e-3)


def _found(lesion: Lesion, plane: Plane, depth: Volume, blur: Volume) -> FoundLesion:
    place = moved(np.linalg.inv(depth.affine), lesion.centre)
    first = np.clip(np.floor(place).astype(int), 0, np.array(depth.data.shape) - 2)
    around = np.nan_to_num(depth.data[tuple(slice(start, start + 2) for start in first)].astype(float))
    depth_mm = ndimage.map_coordinates(around, (place - first)[:, None], order=1)[0]
    left_mm = float(plane.left_mm(lesion.centre))
    side = "middle" if abs(left_mm) <= MIDDLE_MM else "left" if left_mm > 0 else "right"
    voxels = np.rint(moved(np.linalg.inv(blur.affine), lesion.parts[0].positions)).astype(int)
    inside = voxels[np.all((voxels >= 0) & (voxels < blur.data.shape), axis=1)]
    defined = np.isfinite(blur.data[tuple(inside.T)]).sum()
    return FoundLesion(
        lesion.volume_ml, float(depth_mm), "unknown" if plane.is_doubtful else side, float(defined / len(voxels))
    )


# As the laboratory's study places synthetic lesions: a half at the bottom of sulci (from 12 mm), a quarter each in
# their walls and in crowns (up to 7 mm); 60 % in the front 45 %; a tenth each within 12 mm of the middle and basal.
KINDS = (0.5, 0.25, 0.25)
FRONT, FRONTAL, BASE, LEAST, MESIAL_MM, NEAR_MIDDLE = 0.45, 0.6, 0.35, 0.1, 12.0, 0.15
SHALLOWEST_MM, DEEPEST_MM, CROWN_MM, BOTTOM_MM = 4.0, 28.0, 7.0, 12.0


def cortical_places(name: str, plane: Plane, depth: Volume, blur: Volume, t1: Path, count: int = PLACES) -> Floats:
    """Random places at the junction of grey and white matter, RAS mm, the same ones for the same name."""
    # One voxel in eight is enough.
    coarse = (slice(None, None, 2),) * 3
    depths = depth.data[coarse]
    brain = moved(depth.affine, 2.0 * np.argwhere(depths >= 0))
    if not len(brain):
        return brain
    low, high = brain.min(axis=0), brain.max(axis=0)
    intensity = opened(t1).data[coarse].astype(float)
    is_defined = np.isfinite(blur.data[coarse])
    # The map is defined on both sides of the junction.
    grey, white = np.percentile(intensity[is_defined], (25, 75)) if is_defined.any() else (0.0, 0.0)
    is_between = np.abs(intensity - (grey + white) / 2) <= NEAR_MIDDLE * (white - grey)
    is_offered = is_defined & is_between & (depths >= SHALLOWEST_MM) & (depths < DEEPEST_MM)
    offers = moved(depth.affine, 2.0 * np.argwhere(is_offered))
    depth_mm = depths[is_offered]
    share = (offers - low) / (high - low)
    is_basal, is_frontal = share[:, 2] < BASE, share[:, 1] > 1 - FRONT
    kind = np.select([depth_mm >= BOTTOM_MM, depth_mm >= CROWN_MM], [0, 1], 2)
    is_mesial = np.abs(plane.left_mm(offers)) < MESIAL_MM
    # The cerebellum is below and behind.
    is_cerebrum = ~is_basal | is_frontal
    random = np.random.default_rng([SEED, zlib.crc32(name.encode())])
    suitable: dict[tuple[int, bool, bool, bool], Any] = {}
    places: list[Floats] = []
    # A small head may lack a kind of place; it gets others.
    for _ in range(10 * count):
        wanted = int(random.choice(3, p=KINDS))
        front, mesial, base = (bool(random.random() < share) for share in (FRONTAL, LEAST, LEAST))
        wish = (wanted, front, mesial, base)
        if wish not in suitable:
            meets = is_cerebrum & (kind == wanted) & (is_frontal == front)
            meets &= is_mesial if mesial else True
            meets &= is_basal if base else True
            suitable[wish] = np.flatnonzero(meets)
        if len(suitable[wish]) and len(places) < count:
            places.append(offers[random.choice(suitable[wish])])
    return np.array(places).reshape(-1, 3)
