"""The surface of a case in a notebook, as a widget."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._extras import anywidget
from ._http import IsocortexError

_widget = anywidget("iso.View")

import traitlets  # noqa: E402 (it comes with anywidget)

if TYPE_CHECKING:
    from ._case import Case

VIEWS = ("left", "right", "anterior", "posterior", "superior", "inferior")
SURFACES = ("whole", "left", "right", "cerebrum")
SCRIPT = Path(__file__).with_name("view.js")
BAD_GATEWAY = 502


def _script() -> str:
    try:
        return SCRIPT.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ImportError("iso.View needs view.js: install the wheel, or run scripts/web.sh in the checkout") from None


class View(_widget.AnyWidget):  # type: ignore[misc, name-defined]
    """A case in a notebook, drawn by the browser as on the page: a drag turns it, the wheel zooms, the slider peels.

    Python sets and watches its traits:

    depth_mm: below the envelope; at most the greatest depth of the case.
    view: from where it is seen: `"left"`, `"right"`, `"anterior"`, `"posterior"`, `"superior"` or `"inferior"`; None
        after a hand has turned it.
    surface: `"whole"`, `"left"`, `"right"` or `"cerebrum"`.
    overlay: a map or a layer in colours, by its name; None for none.
    height: of the picture, in pixels, when the widget is made.

    What the browser draws with, some tens of megabytes, comes from the server through this Python: the kernel may run
    on another machine, and the browser gets no token. While a cell runs, the kernel answers nothing.

    >>> view = iso.View(case, depth_mm=8, view="right")
    >>> view.observe(lambda change: print(f"{change.new:.1f} mm"), "depth_mm")
    >>> view.depth_mm = 12
    12.0 mm
    """

    _esm = _script()

    case_id = traitlets.Unicode(read_only=True).tag(sync=True)
    depth_mm = traitlets.Float(10.0).tag(sync=True)
    view = traitlets.Enum(VIEWS, "left", allow_none=True).tag(sync=True)
    surface = traitlets.Enum(SURFACES, "whole").tag(sync=True)
    overlay = traitlets.Unicode(None, allow_none=True).tag(sync=True)
    height = traitlets.Int(480, min=100).tag(sync=True)

    def __init__(self, case: Case, **traits: Any) -> None:
        self._case = case
        super().__init__(**traits)
        self.set_trait("case_id", case.id)
        self.on_msg(self._answer)

    @traitlets.validate("depth_mm")
    def _depth_of_case(self, proposal: Any) -> float:
        depth_mm = float(proposal["value"])
        if not (math.isfinite(depth_mm) and depth_mm >= 0):
            raise traitlets.TraitError(f"a depth is 0 mm or more, not {depth_mm:g}")
        # As exact as the page, which would change it otherwise.
        return min(round(depth_mm, 2), math.floor(100 * self._case.max_depth_mm) / 100)

    @traitlets.validate("surface")
    def _surface_of_case(self, proposal: Any) -> str:
        name: str = proposal["value"]
        if name != "whole":
            # If the case has no such surface, the server states the reason.
            self._case.surface(name)  # type: ignore[arg-type]
        return name

    @traitlets.validate("overlay")
    def _overlay_of_case(self, proposal: Any) -> str | None:
        name: str | None = proposal["value"]
        if name is not None:
            names = [layer["name"] for layer in self._case._connection.json(f"{self._case._path}/layers")["layers"]]
            if name not in names:
                raise traitlets.TraitError(f"there is no layer {name!r}; those of this case are {', '.join(names)}")
        return name

    def _answer(self, _: Any, content: Any, __: Any) -> None:
        """Passes a question of the browser about this case on to the server, and the answer back."""
        if not isinstance(content, dict) or "ask" not in content:
            return
        path = "/" + str(content.get("path"))
        status, headers, body = 403, {}, b""
        if path.split("?")[0].startswith(self._case._path) and ".." not in path:
            try:
                answer = self._case._connection.send("GET", path, headers={"Accept": str(content.get("accept"))})
                status, body = answer.status_code, answer.content
                headers = {name: value for name, value in answer.headers.items() if name.startswith("x-isocortex-")}
                headers["content-type"] = answer.headers.get("content-type", "")
            except IsocortexError as error:
                status = error.status or BAD_GATEWAY
                headers = {"content-type": "application/problem+json"}
                body = json.dumps({"type": error.kind, "detail": str(error)}).encode()
        self.send({"answer": content["ask"], "status": status, "headers": headers}, [body])
