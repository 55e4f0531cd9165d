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

from ._case import Case, Mesh, Surface
from ._http import IsocortexError
from ._server import Server, open, start

__all__ = ["Case", "IsocortexError", "Mesh", "Server", "Surface", "open", "start"]
