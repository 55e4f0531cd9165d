"""Servers: the one that Python starts on this machine, and others."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._case import Case
from ._http import Connection
from ._program import Program
from ._upload import opened, upload

if TYPE_CHECKING:
    from ._upload import Image

# What the mask may be instead of a file: where the program takes it from.
MASK_SOURCES = ("auto", "volume", "network", "pruning")


class Server:
    """A server of Isocortex, which prepares heads and keeps them as cases.

    >>> server = iso.start()          # or iso.Server("https://isocortex.example", token="…")
    >>> case = server.open("head.nii.gz")
    >>> len(server.cases())
    1
    >>> server.close()
    """

    def __init__(self, address: str, token: str | None = None, *, program: Program | None = None) -> None:
        self._connection = Connection(address, token, program)

    @property
    def address(self) -> str:
        """Where it listens. A browser shows the page there, which asks for the :attr:`token`."""
        return self._connection.address

    @property
    def token(self) -> str | None:
        """The token that it requires, if any."""
        return self._connection.token

    def open(
        self,
        volume: Image,
        *,
        mask: Image | None = None,
        name: str | None = None,
        progress: bool = True,
        **parameters: Any,
    ) -> Case:
        """Uploads a head, waits until it is prepared, and returns the case: see :func:`isocortex.open`."""
        if isinstance(mask, str) and mask in MASK_SOURCES:
            parameters["mask"], mask = mask, None
        with contextlib.ExitStack() as stack:
            parts = {"volume": stack.enter_context(opened(volume))}
            if mask is not None:
                parts["mask"] = stack.enter_context(opened(mask))
            answer = upload(self._connection, "/v1/cases", parts, {"name": name, **parameters})
        return Case(self._connection, answer["id"], progress=progress)

    def case(self, id: str, *, progress: bool = True) -> Case:
        """The case with an id (:attr:`Case.id`). Waits until it is prepared."""
        return Case(self._connection, id, progress=progress)

    def cases(self) -> list[dict[str, Any]]:
        """All cases, newest first, as the server describes them: `id`, `name`, `state`, `created_at` and more."""
        found: list[dict[str, Any]] = []
        after = None
        while True:
            page = self._connection.json("/v1/cases", {"after": after, "limit": 100})
            found += page["cases"]
            after = page.get("next")
            if after is None:
                return found

    def close(self) -> None:
        """Closes the connection, and ends the program if this Python has started it."""
        self._connection.close()

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Server at {self.address}>"


def start(data: str | os.PathLike[str] | None = None) -> Server:
    """Starts the program on this machine, on a free port of 127.0.0.1, with a random token. It ends with this Python.

    `data` is the folder in which it keeps its cases; by default a temporary one, which is removed at the end.
    """
    folder = None if data is None else Path(data).expanduser().resolve()
    program = Program(folder)
    return Server(program.address, program.token, program=program)


_own: Server | None = None


def open(
    volume: Image,
    *,
    mask: Image | None = None,
    name: str | None = None,
    server: Server | str | None = None,
    token: str | None = None,
    progress: bool = True,
    **parameters: Any,
) -> Case:
    """Prepares a T1-weighted head and returns it as a :class:`Case`.

    It takes some seconds; the same head again is there at once.

    volume: NIfTI (`.nii`, `.nii.gz`) or MGH (`.mgz`), a folder or zip of DICOM files, the folder of a FreeSurfer or
        FastSurfer subject with its surfaces and regions as layers, or a nibabel image.
    mask: the brain, as a volume on any grid, or where to find it: `"network"`, `"pruning"` or `"volume"` (the volume is
        skull-stripped). By default the program finds the brain. If the mask is doubtful, a warning states why.
    name: a label for lists and pictures.
    server: a :class:`Server`, or the address of one. By default a program on this machine, which ends with this Python
        and keeps nothing.
    token: the token of the server at that address.
    progress: whether to show a progress bar, in a terminal or a notebook.
    parameters: others of the interface, such as `closing_radius_mm=10.0`, `mask_kind="envelope"`, `series=3` (DICOM) or
        `affine="sform"` (if a NIfTI header contradicts itself).

    >>> case = iso.open("head.nii.gz", mask="brain.nii.gz", name="subject 1")
    >>> case
    <Case ... 'subject 1': 92×108×92 voxels of 2×2×2 mm, 0 to 61.6 mm deep, mask review>
    """
    if isinstance(server, str):
        server = Server(server, token)
    elif token is not None:
        raise ValueError('token= is for a server that is named by its address: pass server="https://…", too')
    return (server or _own_server()).open(volume, mask=mask, name=name, progress=progress, **parameters)


def _own_server() -> Server:
    global _own
    if _own is None or not _own._connection.is_answered():
        _own = start()
    return _own
