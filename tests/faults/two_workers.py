"""Two workers against one (target B4): heads with masks, one thread a preparation, by CPU time.

By wall time two workers can be twice as fast only on two idle cores. What they cost each other (waiting for locks of the database does not count, doing
the same work twice or spinning does) shows in the CPU time of a head, which other load does not change much. The wall times
are printed beside it.
"""

import os
import sys
import time

from attack import Report, cpu_seconds, head
from cluster import Cluster, Postgres

HEADS = 12
SETTINGS = "[limits]\nmaps = \"off\"\n"


def cpu_s(workers):
    return cpu_seconds(worker.pid for worker in workers)


def as_mask(volume):
    """The voxels that are not zero, as a mask on the same grid."""
    voxels = bytearray(volume[352:])
    for at in range(0, len(voxels), 2):
        voxels[at : at + 2] = b"\1\0" if voxels[at] or voxels[at + 1] else b"\0\0"
    return volume[:352] + bytes(voxels)


def prepared_by(postgres, cluster, server, workers, radius_mm, volume, mask):
    """Seconds and CPU seconds for all heads with so many workers, which have started before."""
    for _ in range(workers):
        cluster.start_worker(SETTINGS)
    time.sleep(3)
    before, begun = cpu_s(cluster.workers), time.monotonic()
    cases = []
    for number in range(HEADS):
        parameters = ('{"closing_radius_mm": %s}' % (radius_mm + number / 1000)).encode()
        status, headers, body = server.upload(volume, mask=mask, parameters=parameters)
        assert status == 202, body
        cases.append(headers["location"])
    while int(postgres.ask("SELECT count(*) FROM jobs WHERE kind = 'prepare' AND state IN ('queued', 'running')")[0][0]):
        time.sleep(0.05)
    took, spent = time.monotonic() - begun, cpu_s(cluster.workers) - before
    assert all(server.until_settled(case).get("state") == "ready" for case in cases)
    for worker in list(cluster.workers):
        cluster.kill(worker)
    return took, spent


def main():
    report = Report("two workers against one")
    spacing_mm = float(next((word for word in sys.argv[1:] if word[0] != "-"), 2.0))
    volume = head(spacing_mm)
    mask = as_mask(volume)
    with Postgres() as postgres, Cluster(postgres) as cluster, cluster.server() as server:
        prepared_by(postgres, cluster, server, 1, 5, volume, mask)
        one_s, one_cpu_s = prepared_by(postgres, cluster, server, 1, 6, volume, mask)
        two_s, two_cpu_s = prepared_by(postgres, cluster, server, 2, 7, volume, mask)
    by_cpu = 2 * one_cpu_s / two_cpu_s
    measured = (
        f"{by_cpu:.2f} by CPU ({one_cpu_s / HEADS:.2f} s of CPU a head with one, {two_cpu_s / HEADS:.2f} s with two); "
        f"{one_s / two_s:.2f} by wall time at a load of {os.getloadavg()[0]:.0f}"
    )
    report.target("B4", "two workers do at least 1.8 times the work of one, by CPU", measured, by_cpu >= 1.8)
    report.end()


main()
