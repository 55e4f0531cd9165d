"""What every request needs: the token, waiting, errors in words, and the conversion of positions."""

from __future__ import annotations

import os
import sys
import time
import warnings
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, Any, Mapping

import httpx
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ._program import Program

# Answers to be repeated: the program is still computing what was asked for, or has too much to do.
NOT_YET = ("case-not-ready", "layer-not-ready", "busy")
PATIENCE_S = 600
LOOPBACK = ("127.0.0.1", "localhost", "::1")


class IsocortexError(Exception):
    """What cannot be done, and what to do about it.

    `kind` is the stable name of the problem, such as `"no-surfaces"`, if a server has stated it, and `status` its HTTP
    status.
    """

    def __init__(self, message: str, kind: str = "", status: int = 0) -> None:
        super().__init__(message)
        self.kind = kind
        self.status = status

    @classmethod
    def of(cls, problem: Mapping[str, Any]) -> IsocortexError:
        """The problem that a server states."""
        return cls(problem["detail"], problem["type"].rsplit(":", 1)[-1], problem["status"])


class Connection:
    """Requests to one server."""

    def __init__(self, address: str, token: str | None, program: Program | None = None) -> None:
        self.address = address.rstrip("/")
        # One that was read from a file ends with its line.
        self.token = token.strip() if token else None
        self._client = self._new_client()
        self._pid = os.getpid()
        # The program that Python has started ends when nothing refers to it.
        self._program = program

    def _new_client(self) -> httpx.Client:
        is_near = httpx.URL(self.address).host in LOOPBACK
        client = httpx.Client(
            base_url=self.address,
            headers={"Authorization": f"Bearer {self.token}"} if self.token else {},
            timeout=httpx.Timeout(PATIENCE_S, connect=10),
            # A proxy in the environment is not for this machine.
            trust_env=not is_near,
        )
        weakref.finalize(self, _close, client, os.getpid())
        return client

    def send(self, method: str, path: str, **more: Any) -> httpx.Response:
        """One request; an error is raised in words."""
        # Two processes on one connection would get each other's answers.
        if self._pid != os.getpid():
            self._client, self._pid = self._new_client(), os.getpid()
        try:
            response = self._client.request(method, path, **more)
        except httpx.TransportError as error:
            what_to_do = "open the head again" if self._program else "check the address, and that a server runs there"
            raise IsocortexError(f"no answer from {self.address} ({error}); {what_to_do}") from error
        except RuntimeError as error:  # httpx: the client has been closed
            raise IsocortexError(f"the server at {self.address} was closed; open the head again") from error
        if response.is_success:
            return response
        raise _error_of(response)

    def get(self, path: str, query: Mapping[str, object] | None = None, accept: str = "*/*") -> httpx.Response:
        """What is at a path. Waits while the server is still computing it."""
        last = time.monotonic() + PATIENCE_S
        while True:
            try:
                return self.send("GET", path, params=_words(query or {}), headers={"Accept": accept})
            except IsocortexError as error:
                if error.kind not in NOT_YET or time.monotonic() > last:
                    raise
            time.sleep(0.5)

    def json(self, path: str, query: Mapping[str, object] | None = None) -> Any:
        return self.get(path, query, "application/json").json()

    def close(self) -> None:
        self._client.close()
        if self._program is not None:
            self._program.end()

    def is_answered(self) -> bool:
        """Whether the server is there."""
        try:
            self.send("GET", "/healthz")
        except IsocortexError:
            return False
        return True


def _close(client: httpx.Client, pid: int) -> None:
    """Closes a client, but not in a process that was forked since: it would end the connections of the first one."""
    if os.getpid() == pid:
        client.close()


def _error_of(response: httpx.Response) -> IsocortexError:
    if response.status_code == httpx.codes.UNAUTHORIZED:
        return IsocortexError(f"{response.request.url.host} requires a valid token: pass token=…", "unauthorized", 401)
    try:
        return IsocortexError.of(response.json())
    except (ValueError, KeyError, TypeError):
        answer = f"{response.status_code} {response.reason_phrase}"
        return IsocortexError(f"the server answered {answer}: is it Isocortex?", "", response.status_code)


def _words(query: Mapping[str, object]) -> dict[str, str]:
    """A query as the interface writes it: `true`, `1,2,3`; without what is None."""

    def word(value: object) -> str:
        if isinstance(value, (bool, np.bool_)):
            return str(value).lower()
        if isinstance(value, (tuple, list, np.ndarray)):
            return ",".join(str(float(number)) for number in value)
        return str(value)

    return {name: word(value) for name, value in query.items() if value is not None}


FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])
"""From LPS to RAS, and back."""


def flipped(positions: ArrayLike) -> NDArray[Any]:
    """Positions in RAS mm from LPS mm, or the other way round: x and y change their sign. The last axis is x, y, z."""
    positions = np.asarray(positions)
    if positions.shape[-1:] != (3,):
        raise ValueError(f"a position has three coordinates, x, y and z in mm, not the shape {positions.shape}")
    # Adding 0 makes 0 of -0.
    flipped: NDArray[Any] = positions * np.array([-1, -1, 1], dtype=positions.dtype) + 0
    return flipped


def warn(text: str) -> None:
    """Warns about the line outside of this package that led here."""
    level, frame = 1, sys._getframe()
    while frame.f_back and Path(frame.f_code.co_filename).parent == Path(__file__).parent:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, stacklevel=level)


class Bar:
    """A progress bar on standard error, if somebody looks: in a terminal or a notebook."""

    WIDTH = 30

    def __init__(self, is_wanted: bool) -> None:
        self._is_shown = is_wanted and (sys.stderr.isatty() or "ipykernel" in sys.modules)

    def show(self, fraction: float, what: str) -> None:
        if self._is_shown:
            done = round(fraction * self.WIDTH)
            bar = "#" * done + "." * (self.WIDTH - done)
            print(f"\r[{bar}] {fraction:4.0%} {what:<12}", end="", file=sys.stderr, flush=True)

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_shown:
            print(file=sys.stderr)
