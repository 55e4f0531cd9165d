"""One study, uploaded by many at once, deleted and uploaded again, and cut off half-way (targets A5, A6, A7).

On a folder, and with the rows in PostgreSQL: 20 clients upload one study five times each; clients upload, delete and sweep the same content
for so many rounds; uploads are cut at random bytes by a reset of the connection.
"""

import os
import random
import socket
import struct
import threading
import time
from contextlib import ExitStack

from attack import FORM, Report, Server, form, head, is_short, memory_mb
from cluster import Shared, files_below

ROUNDS, CUT = (20, 20) if is_short() else (1000, 200)

SETTINGS = "[limits]\nmaps = \"off\"\nmax_queued_cases = 1000\n"


def at_once(count, job):
    """Runs `job(number)` in so many threads; what they return."""
    results = [None] * count

    def run(number):
        results[number] = job(number)

    threads = [threading.Thread(target=run, args=[number]) for number in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


def cases(server):
    return server.json("/v1/cases")["cases"]


def kept_in(objects):
    """The objects of a store but the one that names it."""
    return [path for path in files_below(objects) if path != "store-id"]


def one_of_many(report, kind, server, objects):
    """A5: 100 uploads of one study are one case, and nothing is left when it is deleted."""
    study = head(10.0, 5)
    answers = [a for client in at_once(20, lambda number: [server.upload(study, source=f"127.0.0.{2 + number}") for _ in range(5)]) for a in client]
    locations = {headers.get("location") for _, headers, _ in answers}
    statuses = {status for status, _, _ in answers}
    [address] = locations
    settled = server.until_settled(address)
    begun = [line for line in server.log().splitlines() if "beginning a job" in line]
    jobs = sum("prepare" in line for line in begun)
    sources = [path for path in kept_in(objects) if path.startswith("source-volume")]
    with_frame = os.path.getsize(os.path.join(objects, sources[0]))
    server.ask("DELETE", address)
    left = kept_in(objects)
    measured = (
        f"{kind}: {len(answers)} uploads, {len(locations)} case, {len(sources)} source of {len(study)} + {with_frame - len(study)} bytes, "
        f"{jobs} job; {len(left)} objects after DELETE"
    )
    met = statuses <= {200, 202} and len(sources) == 1 and jobs == 1 and not left and settled["state"] == "ready"
    report.target("A5", "20 clients × 5 uploads of one study: one case, one job, nothing left after it is deleted", measured, met)


def again_and_again(report, kind, server, objects):
    """A6: uploads and deletions of the same content by three clients."""
    study, lost, statuses = head(10.0, 6), [], {}

    def client(number):
        chance = random.Random(number)
        for _ in range(ROUNDS // 4):
            status, headers, _ = server.upload(study)
            statuses[status] = statuses.get(status, 0) + 1
            if chance.random() < 0.7 and status in (200, 202):
                server.ask("DELETE", headers["location"])

    at_once(4, client)
    # What is there now must be whole; and it must be possible to upload it once more.
    status, headers, _ = server.upload(study)
    state = server.until_settled(headers["location"]).get("state")
    status, words = server.check()
    wrong = [line for line in words.splitlines() if line.startswith(("missing", "damaged"))]
    orphans = sum(line.startswith("unreferenced") for line in words.splitlines())
    server.ask("DELETE", headers["location"])
    measured = f"{kind}: {ROUNDS} rounds, {len(wrong)} missing or damaged, {orphans} unreferenced, {len(kept_in(objects))} left at the end; {statuses}"
    met = not wrong and orphans <= 1 and state == "ready" and not kept_in(objects) and set(statuses) <= {200, 202}
    report.target("A6", "1,000 rounds of upload, delete and sweep of one content: nothing missing, at most one orphan", measured, met)


def cut_off(report, kind, server, objects):
    """A7: uploads that end in a reset leave nothing."""
    chance = random.Random(7)
    for seed in range(8):
        server.ask("DELETE", server.prepared(head(10.0, seed)))
    before = memory_mb(server.process.pid)
    for number in range(CUT):
        body = form([("volume", head(10.0, 100 + number % 16) + bytes(200_000))])
        request = (
            f"POST /v1/cases HTTP/1.1\r\nHost: localhost\r\nContent-Type: {FORM}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body
        )
        with socket.create_connection(("127.0.0.1", server.port)) as connection:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            connection.sendall(request[: chance.randrange(1, len(request) - 1)])
    uploads, started = os.path.join(server.data, "uploads"), time.monotonic()
    # The server may still be reading what was sent before the reset: only a second without a file is an end.
    seen = started
    while time.monotonic() - seen < 1 and time.monotonic() - started < 60:
        if files_below(uploads) or kept_in(objects):
            seen = time.monotonic()
        time.sleep(0.1)
    waited = seen - started
    rows, left = len(cases(server)), files_below(uploads) + kept_in(objects)
    grown = memory_mb(server.process.pid) / before - 1
    measured = f"{kind}: {CUT} cut uploads, {rows} cases, {len(left)} files {left[:3] or ''} after {waited:.1f} s, memory {100 * grown:+.0f} %"
    report.target("A7", "200 uploads cut at random bytes: no case, no file after 60 s, memory within 10 %", measured, not rows and not left and grown <= 0.1)


def main():
    report = Report("one study, many times")
    for kind in ("a folder", "PostgreSQL"):
        with ExitStack() as stack:
            shared = stack.enter_context(Shared()) if kind == "PostgreSQL" else None
            server = stack.enter_context(Server(settings=SETTINGS, environment=shared and shared.environment))
            objects = shared.objects if shared else os.path.join(server.data, "objects")
            one_of_many(report, kind, server, objects)
            again_and_again(report, kind, server, objects)
            cut_off(report, kind, server, objects)
    report.end()


main()
