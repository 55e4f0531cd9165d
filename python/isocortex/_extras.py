"""Packages that only some methods need, imported when they are."""

from __future__ import annotations

import importlib
from typing import Any


def _imported(module: str, extra: str, what: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(f"{what} needs {extra}: pip install 'isocortex[{extra}]'") from error


def anywidget(what: str) -> Any:
    return _imported("anywidget", "anywidget", what)


def nibabel(what: str) -> Any:
    return _imported("nibabel", "nibabel", what)


def pandas(what: str) -> Any:
    return _imported("pandas", "pandas", what)


def pillow(what: str) -> Any:
    return _imported("PIL.Image", "pillow", what)
