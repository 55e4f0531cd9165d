"""The program that Python starts is private, and leaves nothing behind, however Python ends."""

import contextlib
import multiprocessing
import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest

import isocortex as iso

needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="only Linux lists processes in /proc")
START = "import isocortex as iso, os, signal, sys, time\nserver = iso.start()\nprint(server.address, flush=True)\n"
PATIENCE_S = 60


def descendants(pid):
    """The processes below one, with their command lines."""
    parents = {}
    for stat_file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat_file.read_text().rsplit(")", 1)[1].split()
            if fields[0] != "Z":
                parents[int(stat_file.parent.name)] = int(fields[1])
    found, seen = {}, {pid}
    while more := {child for child, parent in parents.items() if parent in seen} - seen:
        seen |= more
        for child in more:
            with contextlib.suppress(OSError):
                found[child] = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
    return found


def is_alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def await_end(processes, folder=None):
    """Waits until no process is left, and no folder."""
    last = time.monotonic() + PATIENCE_S
    while any(map(is_alive, processes)) or (folder is not None and folder.exists()):
        assert time.monotonic() < last, f"left behind: {[p for p in processes if is_alive(p)]} {folder}"
        time.sleep(0.05)


class Script:
    """A Python of its own, and what it has started."""

    def __init__(self, text, **more):
        command = [sys.executable, "-W", "ignore", "-c", text]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **more)
        self.address = self.process.stdout.readline().strip()
        self.below = descendants(self.process.pid)
        [self.watcher] = [pid for pid, words in self.below.items() if any(w.endswith(b"_watch.py") for w in words)]
        words = self.below[self.watcher]
        self.folder = Path(os.fsdecode(words[words.index(b"serve") - 2]))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.communicate()


@pytest.fixture(autouse=True)
def _package_on_the_path(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(iso.__file__).parent.parent))


@needs_proc
@pytest.mark.parametrize(
    "end",
    [
        "",
        "sys.exit(3)",
        "raise RuntimeError",
        "os._exit(0)",
        "os.kill(os.getpid(), signal.SIGKILL)",
        "os.kill(os.getpid(), signal.SIGTERM)",
        "server.close(); time.sleep(600)",
        "del server; time.sleep(600)",
    ],
)
def test_nothing_is_left_however_python_ends(end):
    with Script(START + "sys.stdin.readline()\n" + end, stderr=subprocess.DEVNULL) as script:
        assert len(script.below) >= 2 and script.folder.exists()
        script.process.stdin.write("\n")
        script.process.stdin.flush()
        await_end(script.below, script.folder)


@needs_proc
def test_nothing_is_left_if_the_notebook_is_closed_in_the_middle(folder):
    text = START + f"server.open({str(folder / 'head.nii.gz')!r}, closing_radius_mm=9.25)"
    with Script(text) as script:
        token = (script.folder / "token").read_text()
        with httpx.Client(headers={"Authorization": f"Bearer {token}"}) as client:
            while not client.get(script.address + "/v1/cases").json()["cases"]:
                time.sleep(0.01)
        below = {**script.below, **descendants(script.process.pid)}
        script.process.kill()
        await_end(below, script.folder)


@needs_proc
def test_the_program_ends_if_its_watcher_is_killed():
    with Script(START + "sys.stdin.readline()") as script:
        os.kill(script.watcher, signal.SIGKILL)
        await_end([pid for pid in script.below if pid != script.watcher])
        # What the watcher would have removed.
        subprocess.run(["rm", "-r", str(script.folder)], check=True)


@needs_proc
def test_an_interrupt_at_the_terminal_ends_what_python_does_and_not_the_program():
    text = START + (
        "try: print('at work', flush=True); time.sleep(600)\n"
        "except KeyboardInterrupt: print(len(server.cases()), flush=True)\ninput()"
    )
    with Script(text, start_new_session=True) as script:
        assert script.process.stdout.readline() == "at work\n"
        os.killpg(script.process.pid, signal.SIGINT)
        assert script.process.stdout.readline() == "0\n"
        assert all(map(is_alive, script.below))


@needs_proc
def test_it_is_private():
    with Script(START + "sys.stdin.readline()") as script:
        token = (script.folder / "token").read_text()
        assert stat.S_IMODE((script.folder / "token").stat().st_mode) == 0o600
        assert stat.S_IMODE(script.folder.stat().st_mode) == 0o700
        assert len(token) == 64
        words = b" ".join(word for words in script.below.values() for word in words)
        variables = b"".join(Path(f"/proc/{pid}/environ").read_bytes() for pid in script.below)
        assert token.encode() not in words + variables
        assert script.address.startswith("http://127.0.0.1:")
        assert httpx.get(script.address + "/v1/cases").status_code == 401


def test_the_environment_leads_it_nowhere_else(monkeypatch):
    for name, value in {
        "ISOCORTEX_DATABASE": "postgres://nowhere/heads",
        "ISOCORTEX_LISTEN": "0.0.0.0:1",
        "HTTP_PROXY": "http://127.0.0.1:9",
        "ALL_PROXY": "http://127.0.0.1:9",
    }.items():
        monkeypatch.setenv(name, value)
    with iso.start() as server:
        assert server.cases() == []


def test_a_folder_of_ones_own_keeps_its_cases(tmp_path, case):
    with iso.start(tmp_path / "store") as server:
        assert repr(server) == f"<Server at {server.address}>"
        with pytest.warns(UserWarning, match="look at the brain mask"):
            first = server.open("head.nii.gz", mask="brain.nii.gz", name="kept")
    with pytest.raises(iso.IsocortexError, match="was closed; open the head again"):
        first.mesh(1.0)
    with iso.start(tmp_path / "store") as server:
        assert [(one["id"], one["name"]) for one in server.cases()] == [(case.id, "kept")]
        server.case(case.id).delete()
        assert server.cases() == []


@needs_proc
def test_the_next_head_starts_the_program_again_if_it_has_crashed(monkeypatch):
    monkeypatch.setattr("isocortex._server._own", None)
    before = descendants(os.getpid())
    first = iso.open("head.nii.gz", mask="brain.nii.gz")
    [crashed] = [pid for pid, words in descendants(os.getpid()).items() if pid not in before and words[1] == b"serve"]
    os.kill(crashed, signal.SIGKILL)
    await_end([crashed])
    with pytest.raises(iso.IsocortexError, match="open the head again"):
        first.mesh(5.0)
    second = iso.open("head.nii.gz", mask="brain.nii.gz")
    assert second.id == first.id and second._connection.address != first._connection.address


def test_a_folder_that_cannot_be_used_is_an_error_with_the_words_of_the_program(folder):
    with pytest.raises(iso.IsocortexError, match=r"the program did not start: .*head\.nii\.gz"):
        iso.start(folder / "head.nii.gz")


def _size(case, queue):
    queue.put(case.picture(5.0).size)


@pytest.mark.skipif(sys.platform != "linux", reason="fork is safe on Linux alone")
def test_a_forked_process_gets_answers_of_its_own_and_leaves_the_program_running(case):
    fork = multiprocessing.get_context("fork")
    queue = fork.SimpleQueue()
    children = [fork.Process(target=_size, args=(case, queue)) for _ in range(3)]
    for child in children:
        child.start()
    assert [queue.get() for _ in children] == [(512, 512)] * 3
    for child in children:
        child.join()
    assert case.picture(5.0).size == (512, 512)


def test_a_file_that_is_no_program_is_an_error_and_leaves_nothing(monkeypatch, tmp_path):
    program = tmp_path / "isocortex"
    program.write_bytes(b"\x7fELF of another machine")
    program.chmod(0o755)
    monkeypatch.setenv("ISOCORTEX_BINARY", str(program))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(iso.IsocortexError, match=r"the program did not start: .*Exec format error"):
        iso.start()
    assert list(tmp_path.iterdir()) == [program]


def test_a_missing_program_is_named(monkeypatch):
    monkeypatch.setenv("ISOCORTEX_BINARY", "/nowhere/isocortex")
    with pytest.raises(iso.IsocortexError, match="ISOCORTEX_BINARY is /nowhere/isocortex, which is not a program"):
        iso.start()
    monkeypatch.delenv("ISOCORTEX_BINARY")
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setattr("isocortex._program._installed_program", lambda: None)
    with pytest.raises(iso.IsocortexError, match="install the wheel of this system"):
        iso.start()
