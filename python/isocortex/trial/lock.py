"""Locks a trial: the hashes of the program, of this package and of all parameters, written before the first result."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from .._http import IsocortexError

FILE = "frozen.json"


def sha256(path: Path) -> str:
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            for piece in iter(lambda: file.read(1 << 20), b""):
                digest.update(piece)
    except OSError as error:
        raise IsocortexError(f"{path} cannot be read: {error}") from error
    return digest.hexdigest()


def write(path: Path, text: str) -> None:
    """Writes a file that is there as a whole or not at all."""
    part = _part(path)
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)


def _part(path: Path) -> Path:
    return path.with_name(f"{path.name}.part")


def _state(program: Path, parameters: dict[str, Any]) -> dict[str, Any]:
    own = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        own.update(path.read_bytes())
    text = json.dumps(parameters, sort_keys=True, separators=(",", ":"))
    return {
        "program": sha256(program),
        "package": own.hexdigest(),
        "parameters_hash": hashlib.sha256(text.encode()).hexdigest(),
        "parameters": parameters,
    }


def locked(results: Path, program: Path, parameters: dict[str, Any], is_requested: bool) -> dict[str, Any] | None:
    """Locks a folder of results on request. If it is locked already, checks that nothing has changed."""
    path = results / FILE
    if not path.exists():
        if not is_requested:
            return None
        # What an interrupted lock has left is no result.
        first = sorted(set(results.iterdir()) - {_part(path)})[:1]
        if first:
            late = f"--freeze comes too late: {first[0]} exists already"
            raise IsocortexError(f"{late}; name an empty directory with --results")
        state = _state(program, parameters)
        write(path, json.dumps(state, indent=2) + "\n")
        return state
    try:
        stored: dict[str, Any] = json.loads(path.read_text())
        before = stored["parameters"]
        hashes = [stored["program"], stored["package"]]
    except (ValueError, KeyError, TypeError) as error:
        raise IsocortexError(f"{path} is damaged: {error}") from error
    state = _state(program, parameters)
    changed: list[str] = [name for name in parameters if before.get(name) != parameters[name]]
    if hashes != [state["program"], state["package"]]:
        what = "another program"
    elif changed:
        what = f"other parameters: {', '.join(changed)}"
    elif stored != state:
        raise IsocortexError(f"{path} was changed by hand; name another directory with --results")
    else:
        return stored
    unchanged = "run it unchanged, or name another directory with --results"
    raise IsocortexError(f"the trial was locked with {what} ({path}); {unchanged}")
