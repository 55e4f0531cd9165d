"""An hour of mixed use: uploads, pictures, slices, deletions and a few attackers, with memory and file handles sampled.

Heads of several sizes (and with `--volume HEAD --mask MASK` a real one now and then) are uploaded, shown in every way and deleted, while attackers send
forms without an end, cut uploads, files that are no heads, and bodies byte by byte. Nothing honest may fail, and neither memory nor file
handles may grow. `--minutes` sets the time, `--csv` and `--svg` write the samples and a plot of them.
"""

import argparse
import collections
import gzip
import random
import socket
import statistics
import struct
import threading
import time
import os

from attack import FORM, Report, Server, form, gzip_of_zeros, head, is_short, memory_mb, nifti_header, zip_of

# What the cache may hold, in MiB, and what the server may hold beside them, in MB.
CACHE_MIB, BESIDE_CACHE_MB = 128, 150
SETTINGS = f"[render]\ncache_bytes = {CACHE_MIB << 20}\n"

# Cases that are kept at a time, and the most handles that may be open once nobody is connected, beyond those at the start.
LIVE, HANDLES_LEFT = 24, 12


def arguments():
    parser = argparse.ArgumentParser()
    parser.add_argument("--short", action="store_true", help="half a minute")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--volume", help="a plain or gzipped NIfTI file, for one upload in ten")
    parser.add_argument("--mask", help="its mask")
    parser.add_argument("--csv", help="writes the samples into this file")
    parser.add_argument("--svg", help="draws the samples into this file")
    return parser.parse_args()


def read(path):
    if not path:
        return None
    with open(path, "rb") as file:
        content = file.read()
    return gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content


def described(volume, number):
    """The volume with another description, and so another case."""
    text = f"soak {number}".encode().ljust(80, b"\0")
    return volume[:148] + text + volume[228:]


class Soak:
    """What the clients share: the cases there are, the answers they got, and when to end."""

    def __init__(self, server, seconds, seed):
        self.server, self.end, self.seed = server, time.monotonic() + seconds, seed
        self.cases, self.lock = [], threading.Lock()
        self.honest, self.hostile = collections.Counter(), collections.Counter()
        self.slowest_s, self.wrong = 0.0, []

    def running(self):
        return time.monotonic() < self.end

    def note(self, what, status, body=b"", took=0.0):
        """An honest request's answer: 0 is none at all, and 503 means to come again."""
        with self.lock:
            self.honest[f"{what} {status}"] += 1
            self.slowest_s = max(self.slowest_s, took)
            if status == 0 or (status >= 500 and status != 503):
                self.wrong.append(f"{what}: {status} {body[:120]!r}")

    def ask(self, what, method, address, body=None, headers=None, timeout=120):
        begun = time.monotonic()
        answer = self.server.ask(method, address, body, headers, timeout)
        self.note(what, answer[0], answer[2], time.monotonic() - begun)
        return answer


def uploads(soak, random, heads, real):
    """Uploads one head after another, some of them twice, and deletes the oldest or any other beyond `LIVE`."""
    number = 0
    while soak.running():
        number += 1
        parts = {"volume": described(random.choice(heads), number)}
        if real and number % 10 == 0:
            parts = {name: part for name, part in real.items()}
            parts["volume"] = described(parts["volume"], number)
        body = form(parts.items())
        for _ in range(random.choice((1, 1, 1, 2))):
            status, headers, _ = soak.ask("upload", "POST", "/v1/cases", body, {"Content-Type": FORM})
            if status in (200, 202):
                with soak.lock:
                    if headers["location"] not in soak.cases:
                        soak.cases.append(headers["location"])
        while len(soak.cases) > LIVE and soak.running():
            with soak.lock:
                gone = soak.cases.pop(random.choice((0, random.randrange(len(soak.cases)))))
            soak.ask("delete", "DELETE", gone)
        time.sleep(random.uniform(1, 6))


def requests_of(case, random):
    """A request for a case as its readers make them."""
    depth_mm = random.choice((0, 2, 5, 8, 8, 12, 20))
    view = random.choice(("left", "right", "anterior", "superior"))
    side = random.choice((128, 256, 512))
    slice_at = f"{random.choice(('axial', 'coronal', 'sagittal'))}?position_mm={random.randrange(-30, 30)}"
    renders = ",".join(f'{{"depth_mm": {d}, "width": 96, "height": 96}}' for d in (2, 6, 10))
    return random.choice(
        [
            ("json", "GET", case, None),
            ("list", "GET", "/v1/cases", None),
            ("render", "GET", f"{case}/render?depth_mm={depth_mm}&view={view}&width={side}&height={side}", None),
            ("splat", "GET", f"{case}/render?depth_mm={depth_mm}&view={view}&renderer=splat", None),
            ("mesh picture", "GET", f"{case}/render?depth_mm={depth_mm}&view={view}&renderer=mesh", None),
            ("slice", "GET", f"{case}/slices/{slice_at}", None),
            ("slice with lines", "GET", f"{case}/slices/{slice_at}&depth_mm=5,10", None),
            ("mesh", "GET", f"{case}/mesh?depth_mm={depth_mm}", None),
            ("volume", "GET", f"{case}/volume?bits=8", None),
            ("distance", "GET", f"{case}/distance", None),
            ("quality", "GET", f"{case}/quality", None),
            ("pictures", "POST", f"{case}/renders", f'{{"renders": [{renders}]}}'.encode()),
        ]
    )


def reads(soak, random):
    """Asks for whatever a case can show; what is not ready yet or deleted meanwhile answers 4xx."""
    while soak.running():
        with soak.lock:
            case = random.choice(soak.cases) if soak.cases else None
        if case:
            what, method, address, body = requests_of(case, random)
            headers = {"Accept-Encoding": random.choice(("zstd", "gzip", "identity"))}
            status, answered, _ = soak.ask(what, method, address, body, headers)
            if status == 200 and "etag" in answered and method == "GET":
                soak.ask(f"{what} again", method, address, None, {**headers, "If-None-Match": answered["etag"]})
        time.sleep(random.uniform(0.1, 0.7))


def watches(soak, random):
    """Follows the events of a case and leaves in the middle."""
    while soak.running():
        with soak.lock:
            case = soak.cases[-1] if soak.cases else None
        if case:
            with socket.create_connection(("127.0.0.1", soak.server.port), timeout=10) as connection:
                connection.sendall(f"GET {case}/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
                try:
                    soak.note("events", int(connection.recv(4096)[9:12]))
                except (OSError, ValueError):
                    pass
                time.sleep(random.uniform(0, 3))
        time.sleep(random.uniform(1, 5))


def health(soak, _random):
    while soak.running():
        soak.ask("health", "GET", "/healthz", timeout=10)
        soak.ask("ready", "GET", "/readyz", timeout=30)
        time.sleep(2)


def hostile_uploads(random):
    """Uploads that must be refused, or fail later; (name, body) pairs."""
    noise = random.randbytes(200_000)
    flat = nifti_header([64] * 3, [100, 100, 0.01])
    wide = gzip_of_zeros(nifti_header([640] * 3, [0.4] * 3), 2 * 640**3) if random.random() < 0.1 else noise
    return [
        ("noise", form([("volume", noise)])),
        ("no head", form([("volume", flat + bytes(2 * 64**3))])),
        ("cut", form([("volume", head(10.0)[:9000])])),
        ("zeros", form([("volume", wide)])),
        ("zip of noise", form([("volume", zip_of([(f"{n}.dcm", noise[n : n + 900]) for n in range(60)]))])),
        ("unknown part", form([("volume", head(12.0)), ("secret", b"x")])),
        ("wrong parameters", form([("volume", head(12.0)), ("parameters", b'{"closing_radius_mm": 1e99}')])),
    ]


def attacks(soak, random):
    """Attacks, one after the other; each is expected to be refused or disconnected, and to harm nobody."""
    while soak.running():
        kind = random.choice(("upload", "upload", "upload", "reset", "endless", "slow", "addresses"))
        if kind == "upload":
            name, body = random.choice(hostile_uploads(random))
            status, headers, _ = soak.server.ask("POST", "/v1/cases", body, {"Content-Type": FORM}, 120)
            soak.hostile[f"{name} {status}"] += 1
            if status in (200, 202):
                soak.server.until_settled(headers["location"], 60)
                soak.server.ask("DELETE", headers["location"])
        elif kind == "addresses":
            address = random.choice(
                ("/v1/cases/../../etc/passwd", "/v1/cases/" + "0" * 64, "/v1/cases?limit=-1", "/v1/cases/x/render?depth_mm=nan")
            )
            soak.hostile[f"{kind} {soak.server.ask('GET', address)[0]}"] += 1
        else:
            soak.hostile[f"{kind} {raw(soak, random, kind)}"] += 1
        time.sleep(random.uniform(1, 8))


def raw(soak, random, kind):
    """Sends a form that ends in a reset, never, or byte by byte; the status, if one comes."""
    body = form([("volume", head(8.0))])
    opening = f"POST /v1/cases HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: {FORM}\r\nContent-Length: {1 << 29}\r\n\r\n"
    try:
        with socket.create_connection(("127.0.0.1", soak.server.port), timeout=40) as connection:
            connection.sendall(opening.encode())
            if kind == "reset":
                connection.sendall(body[: random.randrange(len(body))])
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                return "reset"
            if kind == "endless":
                for _ in range(64):
                    connection.sendall(b"not a boundary " * 4096)
            else:
                until = time.monotonic() + 40
                while time.monotonic() < until:
                    connection.sendall(body[:1])
                    time.sleep(0.5)
            return connection.recv(4096)[9:12].decode() or "disconnected"
    except OSError:
        return "disconnected"


def handles(pid):
    return len(os.listdir(f"/proc/{pid}/fd"))


def sample(soak, started):
    pid = soak.server.process.pid
    with soak.lock:
        asked = sum(soak.honest.values()) + sum(soak.hostile.values())
    return (time.monotonic() - started, memory_mb(pid), handles(pid), len(soak.cases), asked)


COLUMNS = ("seconds", "memory_mb", "handles", "cases", "requests")


def write_csv(path, rows):
    with open(path, "w") as file:
        file.write(",".join(COLUMNS) + "\n")
        file.writelines(f"{s:.0f},{mb:.1f},{n},{cases},{asked}\n" for s, mb, n, cases, asked in rows)


def panel(rows, column, top, label, unit, limit=None):
    """The lines of SVG of one quantity over the time."""
    left, width, height = 70, 620, 150
    most = max([row[column] for row in rows] + ([limit] if limit else []))
    step = next(s for s in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if most / s <= 6)
    most = step * (int(most / step) + 1)
    minutes = max(rows[-1][0] / 60, 1e-9)

    def at(row):
        return left + width * row[0] / 60 / minutes, top + height * (1 - row[column] / most)

    lines = [f'<text x="{left}" y="{top - 10}" font-weight="bold">{label}</text>']
    for value in range(0, most + 1, step):
        y = top + height * (1 - value / most)
        lines.append(f'<line x1="{left}" y1="{y:.1f}" x2="{left + width}" y2="{y:.1f}" stroke="#ddd"/>')
        lines.append(f'<text x="{left - 8}" y="{y + 4:.1f}" text-anchor="end">{value}{unit}</text>')
    for tick in range(0, int(minutes) + 1, max(1, round(minutes / 6))):
        x = left + width * tick / minutes
        lines.append(f'<text x="{x:.1f}" y="{top + height + 18}" text-anchor="middle">{tick} min</text>')
    if limit:
        y = top + height * (1 - limit / most)
        lines.append(f'<line x1="{left}" y1="{y:.1f}" x2="{left + width}" y2="{y:.1f}" stroke="#c33" stroke-dasharray="6 4"/>')
        lines.append(f'<text x="{left + width}" y="{y - 5:.1f}" text-anchor="end" fill="#c33">allowed: {limit:.0f}{unit}</text>')
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(at, rows))
    lines.append(f'<polyline points="{points}" fill="none" stroke="#26c" stroke-width="1.2"/>')
    return lines


def write_svg(path, rows, allowed_mb):
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 720 440" font-family="sans-serif" font-size="12">',
        '<rect width="720" height="440" fill="white"/>',
        *panel(rows, 1, 40, "Resident memory of the server and its children", " MB", allowed_mb),
        *panel(rows, 2, 255, "Open file handles of the server", ""),
        "</svg>",
    ]
    with open(path, "w") as file:
        file.write("\n".join(parts) + "\n")


def quarter(rows, number, column):
    """The median of a column in a quarter of the time."""
    part = rows[len(rows) * (number - 1) // 4 : len(rows) * number // 4]
    return statistics.median(row[column] for row in part)


def idle(server, at_most, seconds=90):
    """The handles that are open once all clients are gone."""
    end = time.monotonic() + seconds
    while handles(server.process.pid) > at_most and time.monotonic() < end:
        time.sleep(1)
    return handles(server.process.pid)


def main():
    asked = arguments()
    seconds = 30 if asked.short else asked.minutes * 60
    report = Report(f"a soak of {seconds / 60:g} minutes")
    heads = [head(spacing_mm) for spacing_mm in ((10.0, 8.0) if asked.short else (8.0, 6.0, 4.0, 3.0))]
    real = {"volume": read(asked.volume), **({"mask": read(asked.mask)} if asked.mask else {})} if asked.volume else None
    allowed_mb = CACHE_MIB * (1 << 20) / 1e6 + BESIDE_CACHE_MB
    with Server(environment={"ISOCORTEX_LOG": "warn"}, settings=SETTINGS) as server:
        first_handles = handles(server.process.pid)
        soak = Soak(server, seconds, asked.seed)
        jobs = [(uploads, heads, real), (reads,), (reads,), (watches,), (health,), (attacks,), (attacks,)]
        threads = [
            threading.Thread(target=job, args=(soak, random.Random(asked.seed * 100 + number), *rest))
            for number, (job, *rest) in enumerate(jobs)
        ]
        for thread in threads:
            thread.start()
        started, rows = time.monotonic(), []
        while soak.running():
            rows.append(sample(soak, started))
            # Written as it goes, so that an interrupted run shows something.
            if asked.csv:
                write_csv(asked.csv, rows)
            time.sleep(1 if asked.short else 5)
        for thread in threads:
            thread.join()
        for case in soak.cases:
            soak.ask("delete", "DELETE", case)
        last_handles = idle(server, first_handles + HANDLES_LEFT)
        end_mb = memory_mb(server.process.pid)
        log = [line for line in server.log().splitlines() if " ERROR " in line or "panicked" in line]
        server.stop()
        sound, said = server.check()
    if asked.svg:
        write_svg(asked.svg, rows, allowed_mb)
    finish(report, soak, rows, allowed_mb, (first_handles, last_handles), end_mb, log, (sound, said))


def finish(report, soak, rows, allowed_mb, counted, end_mb, log, checked):
    report.figure("requests", f"{sum(soak.honest.values())} honest, {sum(soak.hostile.values())} hostile")
    report.figure("honest answers", dict(sorted(soak.honest.items())))
    report.figure("hostile answers", dict(sorted(soak.hostile.items())))
    report.figure("slowest honest answer", f"{soak.slowest_s:.1f} s")
    most_mb, most_handles = max(row[1] for row in rows), max(row[2] for row in rows)
    report.figure("memory", f"{rows[0][1]:.0f} MB at the start, {most_mb:.0f} at most, {end_mb:.0f} at the end")
    report.figure("handles", f"{counted[0]} at the start, {most_handles} at most, {counted[1]} at the end")
    report.expect("nothing honest fails", not soak.wrong, "; ".join(soak.wrong[:3]))
    report.expect("no attack is answered by 500", not [key for key in soak.hostile if key.endswith(" 500")])
    report.expect("no error in the log", not log, "; ".join(log[:3]))
    # A preparation needs memory of its own for a moment.
    usual_mb = sorted(row[1] for row in rows)[len(rows) * 95 // 100]
    report.expect(f"at most {allowed_mb:.0f} MB in 95 % of the samples", usual_mb <= allowed_mb, f"{usual_mb:.0f} MB")
    if len(rows) >= 100:
        memory = [quarter(rows, number, 1) for number in (2, 4)]
        report.expect("the memory of the last quarter is at most 15 % above the second's", memory[1] <= 1.15 * memory[0], f"{memory[0]:.0f} and {memory[1]:.0f} MB")
        opened = [quarter(rows, number, 2) for number in (2, 4)]
        report.expect("so are the handles", opened[1] <= 1.15 * opened[0], f"{opened[0]:.0f} and {opened[1]:.0f}")
    report.expect(f"at most {HANDLES_LEFT} handles more at the end than at the start", counted[1] <= counted[0] + HANDLES_LEFT, f"{counted[0]}, {counted[1]}")
    report.expect("the store is sound", checked[0] == 0, checked[1][-300:] if checked[0] else "")
    report.end()


main()
