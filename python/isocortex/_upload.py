"""Sending files to a server."""

from __future__ import annotations

import contextlib
import io
import json
import os
import tempfile
import zipfile
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Iterator, Union

from ._extras import nibabel
from ._http import Connection

if TYPE_CHECKING:
    from nibabel.spatialimages import SpatialImage

    Image = Union[str, os.PathLike[str], SpatialImage]


def upload(
    connection: Connection, path: str, parts: dict[str, IO[bytes]], parameters: dict[str, Any]
) -> dict[str, Any]:
    """Sends files with their parameters. No file name leaves this machine: it may name a patient."""
    form: dict[str, Any] = {part: (part, file, "application/octet-stream") for part, file in parts.items()}
    given = {name: value for name, value in parameters.items() if value is not None}
    form["parameters"] = (None, json.dumps(given), "application/json")
    answer: dict[str, Any] = connection.send("POST", path, files=form).json()
    return answer


# What a server reads of the folder of a FreeSurfer or FastSurfer subject.
_VOLUMES = ("mri/T1.mgz", "mri/orig.mgz", "mri/nu.mgz")
_OTHERS = (
    *("mri/brainmask.mgz", "mri/mask.mgz", "mri/aparc*+aseg*.mgz", "label/[lr]h.aparc*.annot"),
    *(f"surf/[lr]h.{name}" for name in ("white", "pial", "thickness", "curv", "sulc")),
)


def _files(folder: Path) -> Iterator[tuple[Path, str]]:
    """The files of a folder and their names in an archive: of a subject what is read, otherwise all as numbers."""
    if any((folder / name).is_file() for name in _VOLUMES):
        found = sorted(path for pattern in (*_VOLUMES, *_OTHERS) for path in folder.glob(pattern) if path.is_file())
        yield from ((path, path.relative_to(folder).as_posix()) for path in found)
    else:
        found = sorted(path for path in folder.rglob("*") if path.is_file())
        yield from ((path, str(number)) for number, path in enumerate(found))


@contextlib.contextmanager
def opened(volume: Image) -> Iterator[IO[bytes]]:
    """The bytes of a volume: of a file, of a folder of DICOM files or a subject as a zip, or of a nibabel image."""
    if hasattr(volume, "affine") and hasattr(volume, "dataobj"):
        image = nibabel("a nibabel image").Nifti1Image.from_image(volume)
        yield io.BytesIO(image.to_bytes())
        return
    if not isinstance(volume, (str, os.PathLike)):
        raise TypeError(f"a volume is a path or a nibabel image, not {type(volume).__name__}")
    if os.path.isdir(volume):
        with tempfile.TemporaryFile() as packed:
            # A file without a date has that of 1970, which a zip cannot state.
            with zipfile.ZipFile(packed, "w", strict_timestamps=False) as folder:
                for path, name in _files(Path(volume)):
                    folder.write(path, name)
            packed.seek(0)
            yield packed
    else:
        with open(volume, "rb") as file:
            yield file
