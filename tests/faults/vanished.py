"""Objects that vanish behind the rows, and one input on two back ends (targets A8, A9).

Every derived object of a case is removed, one kind after another and all at once, while a server has them in no cache. The next request
must be answered with the same bytes, or with 202 or 503 and Retry-After until it can be. The same volume is then prepared on a folder,
and with the rows in PostgreSQL and the objects in S3: its objects must have the same names, which are digests.
"""

import os
import shutil
import time
from contextlib import ExitStack

from attack import Report, Server, head, is_short
from cluster import S3, Postgres, Shared, files_below

ROUTES = ["mesh?depth_mm=5", "mesh?depth_mm=5&contours=9&points=12", "volume", "mask", "envelope", "mesh/paths", "render?depth_mm=5&width=96&height=96", "slices/axial"]
SETTINGS = "[limits]\nmaps = \"off\"\n"


def patient(server, address):
    """An answer, asked for again while the server says when; the seconds it took, and the statuses on the way."""
    begun, seen = time.monotonic(), []
    while True:
        status, headers, body = server.ask("GET", address, timeout=120)
        seen.append(status)
        if status == 200 or time.monotonic() - begun > 60:
            return body, time.monotonic() - begun, seen
        if status not in (202, 503) or "retry-after" not in headers:
            return body, time.monotonic() - begun, seen
        time.sleep(0.2)


def vanish(report):
    wrong, slowest, statuses, removed = [], 0, set(), 0
    with Server(settings=SETTINGS) as server:
        case = server.prepared(head(10.0, 8))
        expected = {route: server.ask("GET", f"{case}/{route}")[2] for route in ROUTES}
        objects = os.path.join(server.data, "objects")
        derived = [kind for kind in os.listdir(objects) if not kind.startswith(("source", "manifest", "store-id"))]
        for kinds in [[kind] for kind in derived] + [derived]:
            server.restart()
            for kind in kinds:
                removed += len(files_below(os.path.join(objects, kind)))
                shutil.rmtree(os.path.join(objects, kind))
            for route in ROUTES:
                body, took, seen = patient(server, f"{case}/{route}")
                slowest = max(slowest, took)
                statuses |= set(seen)
                if body != expected[route]:
                    wrong.append((kinds, route, seen))
        status, words = server.check()
        wrong += [words.strip()[-200:]] if status else []
    measured = f"{removed} objects removed, {len(wrong)} answers with other bytes; statuses {sorted(statuses)}, slowest {slowest:.1f} s"
    report.target("A8", "an object vanishes: 202 or 503 with Retry-After, or at once the same bytes", measured, not wrong and statuses <= {200, 202, 503})


def names_in_folder(volume):
    with Server(settings=SETTINGS) as server:
        server.prepared(volume)
        files = files_below(os.path.join(server.data, "objects"))
        return {path.replace(os.sep, "/") for path in files if path != "store-id"}


def names_elsewhere(volume):
    with ExitStack() as stack:
        if is_short():
            shared = stack.enter_context(Shared())
            postgres, environment = shared.postgres, shared.environment
        else:
            postgres = stack.enter_context(Postgres())
            s3 = stack.enter_context(S3())
            environment = {"ISOCORTEX_DATABASE": postgres.address(), **s3.environment("heads")}
        server = stack.enter_context(Server(settings=SETTINGS, environment=environment))
        server.prepared(volume)
        return {"/".join(row) for row in postgres.ask("SELECT kind, digest FROM case_objects")}


def same_bytes(report):
    volume = head(8.0, 9)
    here = {"/".join([path.split("/")[0], path.split("/")[-1]]) for path in names_in_folder(volume)}
    there = names_elsewhere(volume)
    report.target(
        "A9", "the same input gives the same bytes on both back ends",
        f"{len(here & there)} of {len(here | there)} objects have the same digest in a folder with SQLite and in {'a folder' if is_short() else 'S3'} with PostgreSQL",
        here == there and here,
    )


def main():
    report = Report("vanished objects, and the same bytes elsewhere")
    vanish(report)
    same_bytes(report)
    report.end()


main()
