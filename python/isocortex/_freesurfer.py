"""A case as a folder of FreeSurfer, written by nibabel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Sequence

import numpy as np

from ._extras import nibabel

if TYPE_CHECKING:
    from pathlib import Path

    from nibabel.freesurfer.mghformat import MGHImage
    from numpy.typing import NDArray

    from ._case import Case, Paths, SurfaceName, ValueName

# FreeSurfer's order of axes: then all its readings of the coordinates of surfaces agree, unless the volume is oblique.
AXES = "LIA"
HALVES: tuple[tuple[str, SurfaceName], ...] = (("lh", "left"), ("rh", "right"))
STAMP = "created by isocortex"


def write_subject(
    case: Case, folder: Path, depths_mm: Sequence[float], names: Sequence[ValueName], size: dict[str, int], paths: Paths
) -> None:
    """See :meth:`isocortex.Case.to_freesurfer`. Nothing is written before all of it is here."""
    nib = nibabel("case.to_freesurfer()")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise FileExistsError(f"{str(folder)!r} is not an empty folder: name a new one")
    halves = [(prefix, case.surface(name)) for prefix, name in HALVES]
    for _, half in halves:
        if max(depths_mm) > half.max_depth_mm:
            raise ValueError(f"{max(depths_mm):g} mm is too deep: the greatest depth is {half.max_depth_mm:.1f} mm")
    t1 = _acquired(case, nib)
    surfaces: dict[str, tuple[NDArray[Any], NDArray[Any]]] = {}
    values = {}
    header: Any = t1.header
    tkregister_from_scanner = header.get_vox2ras_tkr().astype(float) @ np.linalg.inv(header.get_vox2ras())
    for prefix, half in halves:
        for depth_mm in depths_mm:
            # The path of a FreeSurfer surface begins with its half.
            name = f"{prefix}.cut-{depth_mm:g}mm"
            points, triangles = half._gifti(depth_mm, {**size, "paths": paths}, "case.to_freesurfer()").darrays
            surfaces[name] = nib.affines.apply_affine(tkregister_from_scanner, points.data), triangles.data
            for value in names:
                values[f"{name}.{value}"] = half.values(depth_mm, value, **size, paths=paths)
    brain = nib.MGHImage(_within(case.mask(), t1), None, t1.header)

    for part in ("mri", "surf"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    nib.save(t1, folder / "mri" / "T1.mgz")
    nib.save(brain, folder / "mri" / "brainmask.mgz")
    geometry = _geometry(t1)
    for name, (coordinates, faces) in surfaces.items():
        nib.freesurfer.write_geometry(folder / "surf" / name, coordinates, faces, STAMP, geometry)
    for name, each in values.items():
        nib.freesurfer.write_morph_data(folder / "surf" / name, each)


def _acquired(case: Case, nib: Any) -> MGHImage:
    """The volume as it was acquired, with its axes in FreeSurfer's order: voxels are moved, not resampled."""
    answer = case._connection.get(f"{case._path}/volume", {"bits": 16, "extent": "whole"})
    numbers = {
        name: [float(number) for number in answer.headers[f"X-Isocortex-{name}"].split(",")]
        for name in ("Size", "Scale", "Offset", "Patient-From-Voxel")
    }
    size = tuple(map(int, numbers["Size"]))
    stored = np.frombuffer(answer.content, "<u2").reshape(size, order="F")
    affine = np.diag([-1.0, -1.0, 1.0, 1.0]) @ np.vstack(
        [np.reshape(numbers["Patient-From-Voxel"], (3, 4)), [0, 0, 0, 1]]
    )
    orientations = nib.orientations
    turn = orientations.ornt_transform(orientations.io_orientation(affine), orientations.axcodes2ornt(AXES))
    values = orientations.apply_orientation(stored, turn) * numbers["Scale"][0] + numbers["Offset"][0]
    t1: MGHImage = nib.MGHImage(_smallest(values), affine @ orientations.inv_ornt_aff(turn, size))
    return t1


def _smallest(values: NDArray[np.float64]) -> NDArray[Any]:
    """The values in the smallest type of MGH that holds them."""
    for kind in (np.uint8, np.int16, np.int32):
        limits = np.iinfo(kind)
        if limits.min <= values.min() and values.max() <= limits.max and np.array_equal(values, np.rint(values)):
            return values.astype(kind)
    return values.astype(np.float32)


def _within(mask: Any, t1: MGHImage) -> NDArray[Any]:
    """The values of a volume in a mask on another grid, 0 outside."""
    inside = np.asarray(mask.dataobj) > 0
    mask_from_voxel = np.linalg.inv(mask.affine) @ t1.affine
    values = np.array(t1.dataobj)
    for number, plane in enumerate(values):
        voxels = np.moveaxis(np.indices(plane.shape), 0, -1) @ mask_from_voxel[:3, 1:3].T
        voxels = np.rint(voxels + mask_from_voxel[:3, 0] * number + mask_from_voxel[:3, 3]).astype(int)
        is_there = np.all((voxels >= 0) & (voxels < inside.shape), axis=-1)
        x, y, z = np.moveaxis(np.where(is_there[..., None], voxels, 0), -1, 0)
        plane[~(is_there & inside[x, y, z])] = 0
    return values


def _geometry(t1: MGHImage) -> dict[str, Any]:
    """The volume of a surface, as its footer states it: with it, a reader finds scanner coordinates."""
    header = t1.header
    axes = dict(zip(("xras", "yras", "zras"), header["Mdc"].astype(float)))
    return {
        "head": [2, 0, 20],
        "valid": "1  # volume info valid",
        "filename": "../mri/T1.mgz",
        "volume": t1.shape,
        "voxelsize": header["delta"].astype(float),
        **axes,
        "cras": header["Pxyz_c"].astype(float),
    }
