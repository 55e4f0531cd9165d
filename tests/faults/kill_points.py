"""The server is killed at its system calls: at the n-th write, fsync, link, rename, unlink … of a fixed course (target A2).

The course is: start, upload, prepare, make another version, delete, sweep. strace kills the server (SIGKILL) at one call after another. After each
kill the server starts again without strace: what was acknowledged is there, every object that a case needs is there and whole, no file
of an upload is left, and no object is there that nobody needs.
"""

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from attack import Report, Server, head, is_short, skip

CALLS = ["openat", "write", "pwrite64", "fsync", "fdatasync", "linkat", "rename", "unlink", "ftruncate", "mkdir"]

SETTINGS = "[limits]\nmaps = \"off\"\n[render]\nthreads = 1\n"


def traced(inject):
    return ["strace", "-f", "-qq", "-o", "/dev/null", "-e", f"trace={inject.split(':')[0]}", "-e", f"inject={inject}"]


def settled(server, address):
    """The state of a case once it is ready or failed; `None` if the server is gone before."""
    end = time.monotonic() + 30
    while time.monotonic() < end and server.process.poll() is None:
        case = server.json(address)
        if case and case["state"] in ("ready", "failed"):
            return case["state"]
        time.sleep(0.05)
    return None


def course(server):
    """What is asked of the server, until it is gone; what it acknowledged: address -> state."""
    known = {}

    def note(address, state):
        known[address] = state

    status, headers, _ = server.upload(head(10.0, 1), timeout=20)
    if status != 202:
        return known
    first = headers["location"]
    note(first, "there")
    if settled(server, first) != "ready":
        return known
    note(first, "ready")
    status, headers, _ = server.ask("PUT", f"{first}/mask?offset_mm=-1", b"", timeout=20)
    if status not in (200, 202):
        return known
    second = headers["location"]
    note(second, "there")
    if settled(server, second) != "ready":
        return known
    note(second, "ready")
    status, _, _ = server.ask("DELETE", first, timeout=20)
    # Without an answer it may have happened, or not.
    note(first, "gone" if status == 204 else "perhaps gone")
    return known


def calls_of_the_course():
    """How often each call is made, counted by strace."""
    folder = tempfile.mkdtemp(prefix="isocortex-calls-")
    counts = os.path.join(folder, "counts")
    try:
        before = ["strace", "-f", "-qq", "-c", "-o", counts, "-e", f"trace={','.join(CALLS)}"]
        with Server(settings=SETTINGS, before=before) as server:
            known = course(server)
            stop(server)
            assert "gone" in known.values(), known
        found = {}
        with open(counts) as lines:
            for line in lines:
                words = line.split()
                if words and words[-1] in CALLS:
                    found[words[-1]] = int(words[3])
        return found
    finally:
        shutil.rmtree(folder)


def stop(server):
    """Ends the server below its strace."""
    with open(f"/proc/{server.process.pid}/task/{server.process.pid}/children") as children:
        for pid in children.read().split():
            os.kill(int(pid), signal.SIGTERM)
    server.process.wait(60)


def ended(server, within):
    """Whether the server and its strace have ended, within so many seconds."""
    try:
        server.process.wait(within)
    except subprocess.TimeoutExpired:
        return False
    return True


def kill_below(server):
    """Ends whatever is left of a killed server and its strace."""
    if server.process.poll() is None:
        try:
            with open(f"/proc/{server.process.pid}/task/{server.process.pid}/children") as children:
                for pid in children.read().split():
                    os.kill(int(pid), signal.SIGKILL)
        except (OSError, ProcessLookupError):
            pass
        server.process.kill()
        server.process.wait(60)


def faults_after(call, number):
    """Kills the server at the call of this number; what is wrong afterwards, and whether the server met it."""
    server = Server(settings=SETTINGS, before=traced(f"{call}:signal=SIGKILL:when={number}"))
    known = {}
    try:
        try:
            server.start()
            known = course(server)
        except RuntimeError:
            pass  # It was killed while it started.
        # strace ends a moment after what it traces.
        met = ended(server, 0 if "gone" in known.values() else 20)
        kill_below(server)
        server.before = []
        server.start()
        faults = []
        for address, state in known.items():
            case = server.json(address)
            if state == "gone" and case is not None:
                faults.append("a deleted case is back")
            elif state in ("there", "ready") and case is None:
                faults.append("an acknowledged case is gone")
            elif case is not None and (after := settled(server, address)) != "ready":
                faults.append(f"a case is {after}")
            elif case is not None and server.ask("GET", f"{address}/mesh?depth_mm=5")[0] != 200:
                faults.append("a case cannot be shown")
        # A case that was taken and whose answer was lost is prepared too, with files of its own until then.
        for case in server.json("/v1/cases")["cases"]:
            settled(server, f"/v1/cases/{case['id']}")
        uploads = os.path.join(server.data, "uploads")
        left = [name for _, _, names in os.walk(uploads) for name in names]
        faults += [f"an upload is left: {len(left)} files"] if left else []
        server.stop()
        status, words = server.check()
        faults += [words.strip()[-200:]] if status else []
        return met, faults
    finally:
        server.__exit__()


def main():
    if not shutil.which("strace"):
        skip("strace is not installed")
    points = int(next((word for word in sys.argv[1:] if word.isdigit()), 6 if is_short() else 210))
    report = Report("kills at system calls")
    counts = calls_of_the_course()
    report.figure("calls of the course", counts)
    if not counts:
        skip("strace cannot trace here")
    chance = random.Random(17)
    met, tried, broken, at = 0, 0, [], {}
    # strace counts the calls of each thread by itself, so the numbers stay well below the counts of the course, the more so
    # the more calls were not met.
    while met < points and tried < 3 * points:
        call = list(counts)[tried % len(counts)]
        number = chance.randrange(1, max(2, counts[call] // (8 + 8 * (tried - met) // points)))
        tried += 1
        was_met, faults = faults_after(call, number)
        met += was_met
        at[call] = at.get(call, 0) + was_met
        broken += [(call, number, fault) for fault in faults]
        if faults:
            print(f"   {call} {number}: {faults}", flush=True)
    report.figure("kills", at)
    measured = f"{met} kills at {len([n for n in at.values() if n])} kinds of calls, {len(broken)} faults"
    report.target("A2", "200 kills at system calls: nothing torn, nothing acknowledged lost, nothing left over", measured, not broken and met > 0)
    report.end()


main()
