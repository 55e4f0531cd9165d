"""An hour of an operator's mistakes in random order, after which every acknowledged upload is readable (H1, H2, M1, M2).

The server is started on a folder that is not mounted and with the objects of another store; its objects go away and come back; it is
killed during uploads; its database is that of an earlier backup; its clock is a year ahead while cases expire. After each step all heads that
were acknowledged and not deleted are ready, and draw what they drew first. Another store beside it does not change.
"""

import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time

from attack import Report, Server, head, is_short, program

SECONDS = 60 if is_short() else 3600
KEEP_DAYS = 30
SETTINGS = f'[limits]\nmaps = "off"\n[storage]\nkeep_days = {KEEP_DAYS}\n'
CONFIGURATION = 78
SEED = int(next((word for word in sys.argv[1:] if word.isdigit()), time.time()))


def files_of(folder):
    """The files below a folder with their contents' digests."""
    found = {}
    for place, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(place, name)
            with open(path, "rb") as file:
                found[os.path.relpath(path, folder)] = hashlib.sha256(file.read()).hexdigest()
    return found


def run(*words, **environment):
    done = subprocess.run(
        [program(), *words], env={"PATH": os.environ.get("PATH", ""), **environment}, capture_output=True, text=True, timeout=300
    )
    return done.returncode, done.stdout + done.stderr


def faketime():
    """The library that moves the clock of a program, if this machine has it."""
    paths = [f"/usr/lib/{machine}-linux-gnu/faketime/libfaketimeMT.so.1" for machine in ("x86_64", "aarch64")]
    return next((path for path in paths if os.path.exists(path)), None)


class Walk:
    def __init__(self, report, server, other):
        self.report, self.server, self.other = report, server, other
        self.other_files = files_of(other)
        self.heads, self.drawn, self.deleted, self.backup = 0, {}, [], None
        self.steps, self.asked = {}, 0

    def expect(self, what, met, seen=""):
        """Tells of what was not met alone: an hour has thousands of expectations."""
        self.asked += 1
        if not met:
            self.report.expect(what, met, seen)

    def upload(self):
        """Its address once it is acknowledged; `None` if it was not."""
        self.heads += 1
        status, headers, _ = self.server.upload(head(10.0, self.heads), timeout=30)
        return headers["location"] if status in (200, 202) else None

    def keep(self, address):
        """Notes what an acknowledged head draws."""
        case = self.server.until_settled(address)
        self.expect(f"{address} is ready", case.get("state") == "ready", case)
        self.drawn[address] = self.mesh(address)

    def mesh(self, address):
        status, _, body = self.server.ask("GET", f"{address}/mesh?depth_mm=6")
        return (status, hashlib.sha256(body).hexdigest())

    def check(self, step):
        for address, drawn in self.drawn.items():
            case = self.server.until_settled(address)
            found = self.mesh(address) if case.get("state") == "ready" else case
            if found != drawn:
                self.expect(f"after {step}, {address} is what it was", False, found)
        if files_of(self.other) != self.other_files:
            self.expect(f"after {step}, the other store is what it was", False)

    # -- Steps

    def uploads(self):
        for _ in range(2):
            address = self.upload()
            self.expect("an upload is acknowledged", address is not None)
            self.keep(address)

    def deletion(self):
        if len(self.drawn) < 4:
            return
        address = random.choice(list(self.drawn))
        status, _, _ = self.server.ask("DELETE", address)
        self.expect("a case is deleted", status == 204, status)
        del self.drawn[address]
        self.deleted.append(address)

    def kill(self):
        acknowledged = []

        def uploads():
            for _ in range(3):
                acknowledged.append(self.upload())

        thread = threading.Thread(target=uploads)
        thread.start()
        time.sleep(random.uniform(0.05, 1.5))
        self.server.stop(signal.SIGKILL)
        thread.join()
        self.server.start()
        for address in filter(None, acknowledged):
            self.keep(address)

    def wrong_folder(self):
        """The place where the store would be mounted is empty."""
        self.server.stop()
        empty = os.path.join(self.server.folder, "not-mounted")
        os.makedirs(empty, exist_ok=True)
        for words in (["serve", "--listen", "127.0.0.1:0"], ["check-store", "--repair"], ["check-store", "--adopt"]):
            status, said = run(*words, "--data", empty)
            self.expect(f"{words} on an empty folder is 78", status == CONFIGURATION, f"{status}: {said.splitlines()[-1:]}")
        self.expect("nothing is written there", os.listdir(empty) == [], os.listdir(empty))
        self.server.start()

    def wrong_objects(self):
        self.server.stop()
        before = files_of(self.server.data)
        objects = f"file://{self.other}/objects"
        for words in (
            ["serve", "--listen", "127.0.0.1:0"],
            ["check-store", "--repair", "--remove-unreferenced", "--yes"],
            ["check-store", "--adopt"],
            ["remove-expired", "--keep-days", "1", "--yes"],
        ):
            status, said = run(*words, "--data", self.server.data, ISOCORTEX_OBJECTS=objects)
            self.expect(f"{words} with the objects of another store is 78", status == CONFIGURATION, f"{status}: {said.splitlines()[-1:]}")
        self.expect("no object is touched", kept(before) == kept(files_of(self.server.data)))
        self.server.start()

    def unmount(self):
        """The objects of a server go away while it runs."""
        objects, away = (os.path.join(self.server.data, name) for name in ("objects", "away"))
        os.rename(objects, away)
        os.makedirs(objects)
        status, _, _ = self.server.ask("GET", "/readyz")
        self.expect("a server without its objects is not ready", status == 503, status)
        self.expect("it acknowledges nothing", self.upload() is None)
        if self.drawn:
            status, _, _ = self.server.ask("GET", f"{random.choice(list(self.drawn))}/mesh?depth_mm={random.randint(7, 30)}")
            self.expect("it draws what it has, or says that it cannot now", status in (200, 503), status)
        self.expect("nothing is written in their place", files_of(objects) == {}, files_of(objects))
        shutil.rmtree(objects)
        os.rename(away, objects)
        self.ready()

    def ready(self):
        end = time.monotonic() + 60
        while self.server.ask("GET", "/readyz")[0] != 200 and time.monotonic() < end:
            time.sleep(0.1)
        self.expect("the server is ready again", time.monotonic() < end)

    def restore(self):
        """The database is that of a backup, and what was uploaded since is submitted again."""
        self.server.stop()
        rows = [name for name in os.listdir(self.server.data) if name.startswith("rows.")]
        if self.backup:
            for name in rows:
                os.remove(os.path.join(self.server.data, name))
            for name, content in self.backup.items():
                with open(os.path.join(self.server.data, name), "wb") as file:
                    file.write(content)
            status, said = run("check-store", "--adopt", "--data", self.server.data)
            # The backup names what was deleted after it.
            lost = [line for line in said.splitlines() if line.startswith("missing: ")]
            gone = [address.rsplit("/", 1)[1] for address in self.deleted]
            others = [line for line in lost if line.rsplit(" ", 1)[1] not in gone]
            met = not others and (status == 0 or lost)
            self.expect("what was uploaded after the backup is adopted", met, f"{status}: {others or said.splitlines()[-1:]}")
        self.backup = {}
        for name in os.listdir(self.server.data):
            if name.startswith("rows."):
                with open(os.path.join(self.server.data, name), "rb") as file:
                    self.backup[name] = file.read()
        self.server.start()
        for address in self.deleted:
            if self.server.ask("GET", address)[0] == 200:
                self.server.ask("DELETE", address)

    def clock(self):
        """A clock that is a year ahead removes nothing."""
        library = faketime()
        if not library:
            return
        before = self.server.environment
        self.server.stop()
        self.server.environment = {**before, "LD_PRELOAD": library, "FAKETIME": "+400d", "FAKETIME_DONT_FAKE_MONOTONIC": "1"}
        self.server.start()
        time.sleep(3)
        for address in self.drawn:
            status, _, _ = self.server.ask("GET", address)
            self.expect("a year ahead, each case is there", status == 200, f"{address}: {status}")
        self.server.environment = before
        self.server.restart()


def kept(files):
    return {name: digest for name, digest in files.items() if name.startswith("objects")}


def main():
    random.seed(SEED)
    report = Report(f"{SECONDS} s of an operator's mistakes, in the order of {SEED}")
    report.figure("a clock that jumps", "faked" if faketime() else "left out: libfaketime is not here (Debian's package faketime)")
    with Server(settings=SETTINGS) as other:
        other.prepared(head(10.0, 1000))
        other.stop()
        with Server(settings=SETTINGS) as server:
            server.environment["ISOCORTEX_CREATE"] = "false"
            walk = Walk(report, server, other.data)
            walk.uploads()
            walk.restore()
            steps = [walk.uploads, walk.deletion, walk.kill, walk.wrong_folder, walk.wrong_objects, walk.unmount, walk.restore, walk.clock]
            end, taken = time.monotonic() + SECONDS, 0
            while time.monotonic() < end and not report.failed:
                step = random.choice(steps)
                step()
                walk.check(step.__name__)
                taken += 1
                walk.steps[step.__name__] = walk.steps.get(step.__name__, 0) + 1
            status, said = server.check()
            report.expect("in the end, check-store finds nothing", status == 0, said[-500:] if status else "")
            walk.expect("some steps were taken", taken > 0)
            report.figure("steps", walk.steps)
            measured = f"{taken} steps, {walk.heads} uploads, {walk.asked} expectations"
            report.target("operators (H1, H2, M1, M2)", "every acknowledged upload is readable after every mistake", measured, not report.failed)
    report.end()


main()
