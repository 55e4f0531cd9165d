"""The cortex of the brain as curved cuts at any depth below the dura, from an MR volume.

>>> import isocortex as iso
>>> case = iso.open("head.nii.gz")
>>> coordinates, faces = case.mesh(8.0)        # the cut 8 mm below the dura, in scanner RAS mm
>>> picture = case.picture(8.0, view="left")   # a PIL image

:func:`open` starts the program `isocortex` on this machine and prepares the head, which takes some seconds. The program
listens on 127.0.0.1 alone, requires a random token, and ends with this Python. :func:`start` keeps the heads in a
folder of yours, and :class:`Server` works with a server that runs elsewhere.

Positions are in scanner RAS, in millimetres, as in nibabel and nilearn: x grows to the patient's right, y to the face,
z to the top of the head. Depths are millimetres below the envelope, which hugs the dura.

For research use only. Not for diagnosis.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._case import Case, Mesh, Surface
from ._http import IsocortexError
from ._server import Server, open, start

if TYPE_CHECKING:
    from ._view import View as View

__all__ = ["Case", "IsocortexError", "Mesh", "Server", "Surface", "open", "start"]


def __getattr__(name: str) -> Any:
    # It needs a package that the others do not.
    if name == "View":
        from ._view import View

        return View
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
