"""A disk that is full, and then is not: a tmpfs and an ext4 of 128 MB, they can be mounted.

Uploads must answer 507, readiness 507 (never 200 when nothing can be written), reads go on, a deletion either happens
and says so or does not, and everything is well again without a restart once there is room. The short form takes a tmpfs, and three amounts of room.
"""

import json
import os
import subprocess
import sys
import tempfile
import time

from attack import Report, Server, head, is_short, skip

FILLER = "filler"


def mount(folder, kind):
    point = os.path.join(folder, kind)
    os.mkdir(point)
    if kind == "tmpfs":
        command = ["mount", "-t", "tmpfs", "-o", "size=128m", "tmpfs", point]
    else:
        image = os.path.join(folder, "image")
        with open(image, "wb") as file:
            file.truncate(128 << 20)
        if subprocess.run(["mkfs.ext4", "-qF", "-m", "0", image], capture_output=True).returncode:
            return None
        command = ["mount", "-o", "loop", image, point]
    return point if subprocess.run(command, capture_output=True).returncode == 0 else None


def fill(point, leave=0):
    """Fills the disk but for so many bytes."""
    path = os.path.join(point, FILLER)
    with open(path, "ab", buffering=0) as file:
        for block in (1 << 20, 1 << 12):
            while True:
                try:
                    if file.write(bytes(block)) < block:
                        break
                except OSError:
                    break
        file.truncate(max(0, file.tell() - leave))


def make_room(point):
    os.remove(os.path.join(point, FILLER))


def uploads(server, count, first_seed):
    volumes = [head(8.0, seed) for seed in range(first_seed, first_seed + count)]
    return [server.upload(volume, timeout=30)[0] for volume in volumes]


def try_on(report, point, kind):
    data = os.path.join(point, "data")
    with Server(data=data) as server:
        kept = server.prepared(head(8.0, 1))
        doomed = server.prepared(head(8.0, 2))
        seed, poisoned = 10, []
        # From no room at all to a little: a commit fails at another place each time.
        for leave in (0, 16384, 65536) if is_short() else (0, 4096, 8192, 16384, 32768, 49152, 65536, 98304, 131072):
            fill(point, leave)
            full = uploads(server, 4, seed)
            ready = server.ask("GET", "/readyz")[0]
            reads = [server.ask("GET", f"{kept}{rest}")[0] for rest in ("", "/mesh", "/render?depth_mm=5&width=64&height=64")]
            deleted = server.ask("DELETE", doomed)[0] if leave == 16384 else None
            gone = server.ask("GET", doomed)[0] == 404
            make_room(point)
            after = uploads(server, 4, seed + 4)
            seed += 8
            report.figure(f"{kind}, {leave:6} bytes free", f"uploads {full}, readyz {ready}, reads {reads}; with room again {after}")
            if any(status not in (200, 202, 507, 503) for status in full):
                poisoned.append(("full", leave, full))
            if any(status != 202 for status in after):
                poisoned.append(("after", leave, after))
            if ready == 200:
                poisoned.append(("readyz", leave, ready))
            if any(status != 200 for status in reads):
                poisoned.append(("reads", leave, reads))
            if deleted is not None:
                honest = (deleted == 204) == gone
                report.expect(f"{kind}: a deletion on a full disk says what happened", honest, f"answered {deleted}, {'gone' if gone else 'still there'}")
            # The queue must not fill with what waits.
            end = time.monotonic() + 30
            while time.monotonic() < end and _waiting(server):
                time.sleep(0.2)
        for what in ("full", "readyz", "reads", "after"):
            of_this = [p for p in poisoned if p[0] == what]
            words = {
                "full": "uploads on a full disk answer 507",
                "readyz": "readiness says so",
                "reads": "reads go on",
                "after": "uploads go on without a restart once there is room",
            }[what]
            report.expect(f"{kind}: {words}", not of_this, of_this[:3])
        left = _waiting(server)
        report.expect(f"{kind}: every case that was taken gets ready", not left, f"{len(left)} left")
        status, _, _ = server.ask("GET", "/readyz")
        report.expect(f"{kind}: ready at the end", status == 200, status)
        depth = server.log().count("non-zero transaction depth")
        report.expect(f"{kind}: no connection is left inside its transaction", depth == 0, f"{depth} times in the log")


def _waiting(server):
    status, _, body = server.ask("GET", "/v1/cases?limit=100")
    if status != 200:
        return ["no list"]
    return [case["id"] for case in json.loads(body)["cases"] if case["state"] in ("queued", "preparing")]


def main():
    report = Report("a full disk")
    with tempfile.TemporaryDirectory(prefix="isocortex-fault-") as folder:
        mounted = []
        try:
            for kind in [word for word in sys.argv[1:] if word[0] != "-"] or (["tmpfs"] if is_short() else ["tmpfs", "ext4"]):
                point = mount(folder, kind)
                if not point:
                    print(f"   {kind}: cannot be mounted here")
                    continue
                mounted.append(point)
                try_on(report, point, kind)
        finally:
            for point in mounted:
                subprocess.run(["umount", "-l", point])
        if not mounted:
            skip("nothing can be mounted here: run it as root")
    asked = "a full disk: uploads are refused in words, reads go on, all is well without a restart"
    report.target("A3", asked, f"{report.failed} expectations broken", not report.failed)
    report.end()


main()
