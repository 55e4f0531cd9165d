"""The program `isocortex` on this machine: where it is, and that it ends with Python."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import re
import secrets
import shutil
import subprocess
import sys
import tempfile
import weakref
from pathlib import Path

from ._http import IsocortexError

# Variables of the program that still hold for one that Python starts; others would lead it to another store or address.
KEPT_VARIABLES = ("ISOCORTEX_ATLAS", "ISOCORTEX_GPU", "ISOCORTEX_NETWORK")
PATIENCE_S = 20


def find_program() -> str:
    """The path of the program: `ISOCORTEX_BINARY`, otherwise the one of this package, otherwise the one on the PATH."""
    named = os.environ.get("ISOCORTEX_BINARY")
    if named:
        if not os.access(named, os.X_OK):
            raise IsocortexError(f"ISOCORTEX_BINARY is {named}, which is not a program; correct or unset it")
        return str(Path(named).resolve())
    found = _installed_program() or shutil.which("isocortex")
    if found is None:
        raise IsocortexError(
            "the program isocortex is not installed; install the wheel of this system, put the program on the PATH, "
            "name it in ISOCORTEX_BINARY, or name a running server: server=…, token=…"
        )
    return found


def _installed_program() -> str | None:
    try:
        files = importlib.metadata.files("isocortex") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    programs = [
        str(Path(file.locate()).resolve()) for file in files if file.name == "isocortex" and file.parent.name == "bin"
    ]
    return programs[0] if programs and os.access(programs[0], os.X_OK) else None


class Program:
    """The running program. It ends when this object is no longer used, and when Python ends, in whatever way.

    `_watch.py` sees to the latter. Forked processes (`multiprocessing` with "fork") count as this Python, too.
    """

    def __init__(self, data: Path | None) -> None:
        program = find_program()
        # Its mode is 700.
        folder = Path(tempfile.mkdtemp(prefix="isocortex-"))
        self.token = secrets.token_hex(32)
        token_file = os.open(folder / "token", os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(token_file, "w") as file:
            file.write(self.token)
        command = [program, "serve", "--create", "--data", str(data or folder / "store"), "--listen", "127.0.0.1:0"]
        command += ["--token-file", str(folder / "token"), "--log", "warn"]
        watch = [sys.executable, "-I", "-S", str(Path(__file__).with_name("_watch.py")), str(folder), *command]
        kept = [name for name in os.environ if not name.startswith("ISOCORTEX_") or name in KEPT_VARIABLES]
        with open(folder / "log", "wb") as log:
            # In a session of its own, Ctrl-C in a terminal interrupts Python alone.
            watcher = subprocess.Popen(
                watch,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                env={name: os.environ[name] for name in kept},
                start_new_session=True,
            )
        self.end = weakref.finalize(self, _end, watcher, folder, os.getpid())
        try:
            self.address = _address_of(watcher, folder / "log")
        except BaseException:
            self.end()
            raise


def _address_of(watcher: subprocess.Popen[bytes], log: Path) -> str:
    assert watcher.stdout is not None
    for line in watcher.stdout:
        found = re.search(r"http://\S+", line.decode())
        if found:
            return found.group()
    said = log.read_text(errors="replace").strip().splitlines()
    raise IsocortexError(f"the program did not start: {said[-1] if said else 'it gave no reason'}")


def _end(watcher: subprocess.Popen[bytes], folder: Path, pid: int) -> None:
    if os.getpid() != pid:
        return
    assert watcher.stdin is not None and watcher.stdout is not None
    # The byte ends it also if a forked process still holds the other end.
    with contextlib.suppress(OSError), watcher.stdin as pipe:
        pipe.write(b"\n")
    with contextlib.suppress(subprocess.TimeoutExpired):
        watcher.wait(PATIENCE_S)
    watcher.stdout.close()
    # It is left if the program could not be started.
    shutil.rmtree(folder, ignore_errors=True)
