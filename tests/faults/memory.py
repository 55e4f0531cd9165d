"""Resident memory over many cases: each is uploaded, prepared, drawn and loaded into the cache whole.

Afterwards the server may hold what its cache is configured to hold, and 150 MB more. By default 60 heads of 1 mm; with
`--cases 200` the long form, and with `--volume HEAD --mask MASK` (or `--network WEIGHTS`) a real head.
"""

import argparse
import gzip
import os
import time

from attack import Report, Server, head, memory_mb

# What is allowed beyond the cache, in MB.
BESIDE_CACHE_MB = 150

MIB = 1 << 20


def arguments():
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--spacing", type=float, default=1.0, help="edge of a voxel of the synthetic head, in mm")
    parser.add_argument("--volume", help="a plain or gzipped NIfTI file")
    parser.add_argument("--mask", help="its mask")
    parser.add_argument("--network", help="the network's weights, instead of a mask")
    parser.add_argument("--cache", type=int, default=96, help="MiB of the cache")
    parser.add_argument("--minutes", type=float, help="ends earlier, after this time")
    parser.add_argument("--plot", help="writes the memory after each case into this CSV file")
    return parser.parse_args()


def read(path):
    if not path:
        return None
    with open(path, "rb") as file:
        content = file.read()
    return gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content


def described(volume, number):
    """The volume with another description, and so another case."""
    text = f"case {number}".encode().ljust(80, b"\0")
    return volume[:148] + text + volume[228:]


def write(path, rows):
    if path:
        with open(path, "w") as file:
            file.write("case,memory_mb\n")
            file.writelines(f"{number + 1},{mb:.1f}\n" for number, mb in enumerate(rows))


def main():
    asked = arguments()
    report = Report(f"memory over {asked.cases} cases")
    volume = read(asked.volume) or head(asked.spacing)
    others = {"mask": read(asked.mask)} if asked.mask else {}
    allowed_mb = asked.cache * MIB / 1e6 + BESIDE_CACHE_MB
    rows, started = [], time.monotonic()
    # To compare allocators.
    of_allocators = {name: value for name, value in os.environ.items() if name.startswith(("MALLOC_", "LD_PRELOAD"))}
    settings = f"[render]\ncache_bytes = {asked.cache * MIB}\n"
    network = ["--network", asked.network] if asked.network else []
    environment = {"ISOCORTEX_LOG": "warn", **of_allocators}
    with Server(environment=environment, settings=settings, arguments=network) as server:
        start_mb = memory_mb(server.process.pid)
        for number in range(asked.cases):
            case = server.prepared(described(volume, number), **others)
            for rest in ("render?depth_mm=8", "mesh?depth_mm=8", "volume?bits=8", "distance", "mesh/paths"):
                status, _, body = server.ask("GET", f"{case}/{rest}", headers={"Accept-Encoding": "zstd"})
                assert status == 200, (rest, status, body[:200])
            rows.append(memory_mb(server.process.pid))
            # Written as it goes, so that an interrupted run shows something.
            write(asked.plot, rows)
            if asked.minutes and time.monotonic() - started > 60 * asked.minutes:
                break
        # Maps are still being made, for minutes on a busy machine.
        while "isocortex_oldest_job_seconds{" in server.ask("GET", "/metrics")[2].decode():
            time.sleep(1)
        for _ in range(30):
            time.sleep(1)
            last_mb = memory_mb(server.process.pid)
            if last_mb < allowed_mb:
                break
    report.figure("cases", len(rows))
    report.figure("memory", f"{start_mb:.0f} MB at the start, {max(rows):.0f} MB at most, {last_mb:.0f} MB at the end")
    report.expect(f"at most {allowed_mb:.0f} MB at the end", last_mb <= allowed_mb, f"{last_mb:.0f} MB")
    report.end()


main()
