"""Power cuts: what was acknowledged is there after each of them (target A1).

The store lies on an ext4 of its own. Clients upload until so many uploads are acknowledged; some of the cases are ready by then. The file
system is then shut down without writing its journal (EXT4_IOC_SHUTDOWN), so that everything that was not synced is lost, the server
is killed, and the file system is mounted again. Every acknowledged upload must be there with its bytes, and every case that was seen ready
must be ready. Run on a folder, and with the rows in a PostgreSQL whose data lie on the same file system.
"""

import fcntl
import os
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time

from attack import Report, Server, head, is_short, skip
from cluster import Postgres

# _IOR('X', 125, __u32), and its flag for "do not write the journal".
SHUTDOWN, WITHOUT_JOURNAL = 0x8004587D, 2

CUTS, ACKNOWLEDGED = (1, 20) if is_short() else (20, 60)


class Disk:
    """An ext4 in a file. `with Disk() as disk:` unmounts it."""

    def __enter__(self):
        self.folder = tempfile.mkdtemp(prefix="isocortex-power-")
        os.chmod(self.folder, 0o755)
        self.image, self.point = (os.path.join(self.folder, name) for name in ("image", "disk"))
        os.mkdir(self.point)
        with open(self.image, "wb") as file:
            file.truncate(1 << 30)
        made = subprocess.run(["mkfs.ext4", "-qF", self.image], capture_output=True)
        if made.returncode or not self.mount():
            skip("an ext4 cannot be made and mounted here: run it as root")
        return self

    def __exit__(self, *_):
        subprocess.run(["umount", "-l", self.point], capture_output=True)
        subprocess.run(["rm", "-rf", self.folder])

    def mount(self):
        return subprocess.run(["mount", "-o", "loop", self.image, self.point], capture_output=True).returncode == 0

    def cut(self):
        """What was not synced is gone, and nothing can be written any more."""
        point = os.open(self.point, os.O_RDONLY)
        try:
            fcntl.ioctl(point, SHUTDOWN, struct.pack("I", WITHOUT_JOURNAL))
        finally:
            os.close(point)

    def restore(self):
        for _ in range(100):
            if subprocess.run(["umount", self.point], capture_output=True).returncode == 0:
                break
            time.sleep(0.1)
        assert self.mount()


def upload_until(server, first_seed, count):
    """Uploads from four clients until so many are acknowledged; their addresses, and those that were seen ready."""
    acknowledged, ready, lock = [], set(), threading.Lock()
    is_over = threading.Event()
    seeds = iter(range(first_seed, first_seed + 100 * count))

    def client():
        while not is_over.is_set():
            with lock:
                seed = next(seeds)
            status, headers, _ = server.upload(head(10.0, seed), timeout=30)
            if status == 202:
                with lock:
                    acknowledged.append(headers["location"])
                if len(acknowledged) >= count:
                    is_over.set()
            for address in [one for one in acknowledged if one not in ready][:2]:
                case = server.json(address)
                if case and case["state"] == "ready":
                    ready.add(address)

    threads = [threading.Thread(target=client) for _ in range(4)]
    for thread in threads:
        thread.start()
    # The cut comes in the middle of what the other clients do.
    is_over.wait(300)
    return threads, acknowledged, ready


def lost_of(server, acknowledged, ready):
    """Acknowledged uploads that are not there, and ready cases that are not ready."""
    lost = []
    for address in acknowledged:
        case = server.json(address)
        if case is None or case["state"] == "failed":
            lost.append((address, case and case.get("error")))
        elif address in ready and case["state"] != "ready":
            lost.append((address, case["state"]))
    return lost


def cut_on(report, kind, cuts):
    acks = ready_seen = 0
    lost, faults = [], []
    with Disk() as disk:
        postgres = Postgres(os.path.join(disk.point, "postgres")) if kind == "PostgreSQL" else None
        environment = {}
        if postgres:
            postgres.start()
            environment = {
                "ISOCORTEX_DATABASE": postgres.address(),
                "ISOCORTEX_OBJECTS": f"file://{disk.point}/objects",
            }
        settings = "[limits]\nmax_queued_cases = 100000\nmaps = \"off\"\n"
        data = os.path.join(disk.point, "data")
        with Server(data=data, environment=environment, settings=settings) as server:
            for cut in range(cuts):
                threads, acknowledged, ready = upload_until(server, 1000 * cut, ACKNOWLEDGED)
                acknowledged, ready = list(acknowledged), set(ready)
                disk.cut()
                server.stop(signal.SIGKILL)
                for thread in threads:
                    thread.join()
                if postgres:
                    postgres.stop(signal.SIGKILL)
                disk.restore()
                if postgres:
                    postgres.start()
                server.start()
                acks += len(acknowledged)
                ready_seen += len(ready)
                lost += lost_of(server, acknowledged, ready)
                status, words = server.check()
                faults += [line for line in words.splitlines() if line.startswith(("missing", "damaged"))]
                for address in acknowledged:
                    server.ask("DELETE", address)
                print(f"   {kind}, cut {cut + 1}: {len(acknowledged)} acknowledged, {len(ready)} seen ready", flush=True)
        if postgres:
            postgres.__exit__()
    measured = f"{kind}: {len(lost)} of {acks} acknowledged and of {ready_seen} seen ready lost in {cuts} cuts"
    report.target("A1", "nothing acknowledged is lost in 20 power cuts", measured, not lost and not faults)
    if lost or faults:
        report.figure("lost", (lost[:5], faults[:5]))


def main():
    report = Report("power cuts")
    kinds = [word for word in sys.argv[1:] if not word.startswith("--")] or ["a folder", "PostgreSQL"]
    for kind in kinds:
        cut_on(report, kind, CUTS)
    report.end()


main()
