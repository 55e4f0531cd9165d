"""Truths: lesions that people drew, each on a grid of its own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Sequence

import nibabel as nib
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from .._http import IsocortexError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Bools = NDArray[np.bool_]

# What a mark is to a lesion: it finds it, it is too near to be false and too far to find it, or it is false.
HIT, NEAR, FALSE = 2, 1, 0


@dataclass(frozen=True)
class Rules:
    """The rules by which marks are compared with truths."""

    hit_mm: float = 10.0
    """A mark within this distance of the border of a truth, or inside, hits it."""
    large_ml: float = 20.0
    """A truth larger than this counts as large."""
    from_centre_mm: float = 20.0
    """The hit of a large truth must also be within this distance of its centre."""
    least_ml: float = 0.3
    """A connected part of a truth is a lesion if it is larger than this."""


RULES = Rules()


def moved(matrix: NDArray[Any], positions: NDArray[Any]) -> Floats:
    """Positions, (n, 3), after an affine transform."""
    result: Floats = positions @ matrix[:3, :3].T + matrix[:3, 3]
    return result


class Volume(NamedTuple):
    """Voxels, and the transform from their numbers to scanner RAS mm."""

    data: NDArray[Any]
    affine: Floats


def opened(path: Path) -> Volume:
    """A NIfTI file with three axes."""
    try:
        image: Any = nib.load(path)
        data, affine = np.asanyarray(image.dataobj), np.array(image.affine, float)
    except Exception as error:
        raise IsocortexError(f"{path} cannot be read: {error}") from error
    while data.ndim > 3 and data.shape[-1] == 1:
        data = data[..., 0]
    if data.dtype.kind not in "biuf":
        raise IsocortexError(f"{path} has colours or other voxels that are no numbers")
    if data.ndim != 3 or not np.isfinite(affine).all() or np.linalg.det(affine) == 0:
        raise IsocortexError(f"{path} is no volume with three axes and a place in the scanner")
    return Volume(data, affine)


def belonging(values: NDArray[Any]) -> Bools:
    """The voxels of a mask: those above 0, or above a half if the values are probabilities."""
    if not np.issubdtype(values.dtype, np.floating):
        return np.asarray(values > 0)
    values = np.where(np.isfinite(values), values, 0)
    has_fractions = bool(((values > 0) & (values < 1)).any()) and values.max() <= 1.001
    return np.asarray(values > (0.5 if has_fractions else 0))


class Part:
    """A connected part of a truth. `head_from_truth` leads from the scanner RAS of the truth to that of the head."""

    def __init__(self, first: NDArray[np.int64], inside: Bools, affine: Floats, head_from_truth: Floats) -> None:
        self._first, self._inside, self._axes = first, inside, affine[:3, :3]
        self._head_from_voxel = head_from_truth @ affine
        self._voxel_from_head = np.linalg.inv(self._head_from_voxel)
        border = inside & ~ndimage.binary_erosion(inside)
        self._border = (np.argwhere(border) + first).astype(float)
        self._tree = cKDTree(self._border @ self._axes.T)
        corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        self._half_diagonal = float(np.linalg.norm(corners @ self._axes.T, axis=1).max()) + 1e-6
        voxels = np.argwhere(inside) + first
        self.positions = moved(self._head_from_voxel, voxels)
        """The centres of its voxels, RAS mm of the head."""
        self.centre = moved(self._head_from_voxel, voxels.mean(axis=0))
        self.volume_ml = float(abs(np.linalg.det(self._axes)) / 1000 * len(voxels))

    def contains(self, positions: Floats) -> Bools:
        return self._contains(moved(self._voxel_from_head, positions))

    def _contains(self, places: Floats) -> Bools:
        voxels = (np.trunc(places + np.copysign(0.5, places)) - self._first).astype(int)
        result = np.all((voxels >= 0) & (voxels < self._inside.shape), axis=1)
        result[result] = self._inside[tuple(voxels[result].T)]
        return np.asarray(result)

    def within(self, positions: Floats, reach_mm: float) -> Bools:
        """Which positions lie inside, or at most so far from the nearest voxel, which has its full extent."""
        places = moved(self._voxel_from_head, positions)
        result = self._contains(places)
        in_mm = places @ self._axes.T
        to_centre, _ = self._tree.query(in_mm, distance_upper_bound=reach_mm + self._half_diagonal)
        result |= to_centre <= reach_mm
        # Between the two, the shape of the voxels decides.
        for number in np.flatnonzero(~result & np.isfinite(to_centre)):
            near = self._tree.query_ball_point(in_mm[number], reach_mm + self._half_diagonal)
            apart = places[number] - self._border[near]
            outside = (apart - apart.clip(-0.5, 0.5)) @ self._axes.T
            result[number] = np.linalg.norm(outside, axis=1).min() <= reach_mm
        return result


class Lesion:
    """A connected part of a truth, with the parts of other truths that overlap it. The largest part comes first."""

    def __init__(self, part: Part) -> None:
        self.parts = [part]

    @property
    def volume_ml(self) -> float:
        return self.parts[0].volume_ml

    @property
    def centre(self) -> Floats:
        """The centre of gravity of its largest part, RAS mm of the head."""
        return self.parts[0].centre

    def meets(self, part: Part) -> bool:
        return any(own.contains(part.positions).any() for own in self.parts)

    def add(self, part: Part) -> None:
        self.parts = sorted([*self.parts, part], key=lambda part: -part.volume_ml)

    def touch(self, positions: Floats, rules: Rules = RULES) -> NDArray[np.int8]:
        """What marks at these positions are to this lesion alone."""
        near = np.any([part.within(positions, rules.hit_mm) for part in self.parts], axis=0)
        is_far = np.linalg.norm(positions - self.centre, axis=1) > rules.from_centre_mm
        hit = near & ~(is_far & (self.volume_ml > rules.large_ml))
        return np.where(hit, HIT, np.where(near, NEAR, FALSE)).astype(np.int8)


@dataclass
class Lesions:
    """The lesions of a head, the largest first."""

    lesions: list[Lesion]
    small: list[Lesion]
    """Parts that are too small: marks near them are neither hits nor false."""

    def touches(self, positions: Floats, rules: Rules = RULES) -> NDArray[np.int8]:
        """What each mark is to each lesion, (lesions, marks). The hit of another lesion is no false mark."""
        every = [*self.lesions, *self.small]
        touches = np.array([lesion.touch(positions, rules) for lesion in every], np.int8)
        touches = touches.reshape(len(every), len(positions))
        return np.maximum(touches, np.where((touches > FALSE).any(axis=0), NEAR, FALSE))[: len(self.lesions)]


def parts_of(truth: Volume, head_from_truth: Floats) -> list[Part]:
    """Voxels that share a face, an edge or a corner belong together. They come in the order of their first voxels."""
    inside = belonging(truth.data)
    # Transposed, x runs fastest, as in the file.
    labels, _ = ndimage.label(inside.T, np.ones((3, 3, 3)))
    labels = labels.T
    parts = []
    for number, box in enumerate(ndimage.find_objects(labels), start=1):
        first = np.array([along.start for along in box])
        parts.append(Part(first, labels[box] == number, truth.affine, head_from_truth))
    return parts


def lesions_of(truths: Sequence[tuple[Volume, Floats]], rules: Rules = RULES) -> Lesions:
    """The lesions of the truths of a head, which are given with their transforms into the head.

    A part larger than the least volume is a lesion. If no part is, the largest one is the only lesion.
    """
    found: list[Lesion] = []
    for truth, head_from_truth in truths:
        known = list(found)
        for part in parts_of(truth, head_from_truth):
            # Parts of one truth do not touch each other.
            other = next((other for other in known if other.meets(part)), None)
            if other:
                other.add(part)
            else:
                found.append(Lesion(part))
    found.sort(key=lambda lesion: -lesion.volume_ml)
    large = max(sum(lesion.volume_ml > rules.least_ml for lesion in found), 1)
    return Lesions(found[:large], found[large:])
