"""Small uploads that cost much: few bytes that become gigabytes or minutes.

* 3 kB: 64³ voxels of 100 × 100 × 0.01 mm, which no head has;
* four at once of 6.9 MB: 640³ zeros but for one voxel;
* four at once of 400³ voxels, which is within the limits.

They must be refused, or be prepared within the budget: 1.5 GB in all, and an honest upload is ready within 60 s.
"""

import gzip
import json
import struct
import threading
import time

from attack import Report, Server, Watch, gzip_of_zeros, head, nifti_header


def absurd_voxels():
    side = 64
    voxels = bytearray(2 * side**3)
    struct.pack_into(f"<{side**3}h", voxels, 0, *(100 + (voxel * 7919) % 50 for voxel in range(side**3)))
    return gzip.compress(nifti_header([side] * 3, [100.0, 100.0, 0.01]) + voxels)


def nearly_empty(side, spacing_mm):
    """Zeros but for the last voxel, so that the intensities differ."""
    header = nifti_header([side] * 3, [spacing_mm] * 3, datatype=2, bits=8)
    return gzip_of_zeros(header, side**3 - 1) + gzip.compress(b"\x01")


def try_at_once(report, name, volumes, most_mb):
    with Server() as server, Watch(server) as watch:
        answers = []

        def send(volume):
            started = time.monotonic()
            status, headers, body = server.upload(volume, timeout=200)
            kind = json.loads(body).get("type", "") if status else "no answer"
            answers.append((status, kind, time.monotonic() - started))

        threads = [threading.Thread(target=send, args=(volume,)) for volume in volumes]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        started = time.monotonic()
        status, headers, _ = server.upload(head(4.0))
        state = server.until_settled(headers.get("location", "/"), timeout=120).get("state")
        waited = time.monotonic() - started
    report.figure(name, ", ".join(f"{status} {kind.rsplit(':', 1)[-1]} {took:.1f} s" for status, kind, took in answers))
    watch.tell(report)
    report.figure("an honest upload behind them", f"{state} after {waited:.1f} s")
    report.expect(f"{name}: at most {most_mb} MB", watch.most_mb < most_mb, f"{watch.most_mb:.0f} MB")
    report.expect(f"{name}: an honest upload is ready within 60 s", state == "ready" and waited < 60)
    report.expect(f"{name}: health never fails", watch.failed == 0)
    return answers


def main():
    report = Report("volumes that cost much")
    answers = try_at_once(report, "voxels of 100 × 100 × 0.01 mm", [absurd_voxels()], 512)
    report.expect("refused before it is queued", answers[0][0] == 422)
    try_at_once(report, "four of 640³ zeros", [nearly_empty(640, 0.4)] * 4, 1500)
    try_at_once(report, "four of 400³ zeros", [nearly_empty(400, 0.6)] * 4, 1500)
    report.end()


main()
