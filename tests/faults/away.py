"""The object store is away for a minute, and the database (targets B7 and the outage of S3).

Two servers without workers and a worker share a PostgreSQL and a SeaweedFS. While one of them is away, pictures of a case that was seen
before are served, uploads get 503 with Retry-After, and no upload is acknowledged and lost. When it is back, normal service
returns within 10 s without a restart, and what waited is prepared.
"""

import sys
import time
from contextlib import ExitStack

from attack import Report, Server, head, is_short
from cluster import S3, Postgres

AWAY_S = 6 if is_short() else 60
SETTINGS = "[limits]\nmaps = \"off\"\n"
SEEN = ["", "/mesh?depth_mm=5", "/render?depth_mm=5&width=96&height=96"]


def probe(server, case, seed):
    """The statuses of what was seen before, and of an upload with its `Retry-After`."""
    seen = [server.ask("GET", f"{case}{rest}", timeout=30)[0] for rest in SEEN]
    status, headers, _ = server.upload(head(10.0, seed), timeout=60)
    return seen, status, headers.get("retry-after"), headers.get("location")


def away(report, name, what, stop, start, servers, case):
    for server in servers:
        for rest in SEEN:
            assert server.ask("GET", f"{case}{rest}", timeout=60)[0] == 200
    stop()
    begun, seen, uploads, waits, accepted = time.monotonic(), [], [], set(), []
    seed = 1000 if what == "database" else 2000
    while time.monotonic() - begun < AWAY_S:
        for server in servers:
            seed += 1
            statuses, status, wait, location = probe(server, case, seed)
            # The JSON of the case comes from the rows.
            seen += statuses[1:] if what == "database" else statuses
            uploads.append(status)
            waits.add(wait)
            accepted += [location] if status in (200, 202) else []
        time.sleep(0.5)
    start()
    back, recovered = time.monotonic(), None
    while recovered is None and time.monotonic() - back < 60:
        seed += 1
        ready = all(server.ask("GET", "/readyz", timeout=10)[0] == 200 for server in servers)
        status, headers, _ = servers[0].upload(head(10.0, seed), timeout=30)
        if ready and status in (200, 202):
            recovered = time.monotonic() - back
            accepted.append(headers["location"])
        time.sleep(0.1)
    states = [servers[1].until_settled(address, 120).get("state") for address in accepted]
    measured = (
        f"{what} away for {AWAY_S} s: {seen.count(200)} of {len(seen)} requests for a seen case answered, uploads {sorted(set(uploads))} "
        f"with Retry-After {sorted(map(str, waits))}, recovered after {-1 if recovered is None else recovered:.1f} s, "
        f"{states.count('ready')} of {len(states)} accepted heads ready"
    )
    met = set(seen) == {200} and set(uploads) == {503} and None not in waits and recovered is not None and recovered <= 10 and set(states) == {"ready"}
    report.target(name, f"the {what} is away: seen cases are served, uploads get 503, recovery within 10 s", measured, met)


def main():
    report = Report("the object store is away, the database is away")
    kinds = [word for word in sys.argv[1:] if not word.startswith("--")] or ["objects", "database"]
    with ExitStack() as stack:
        postgres, s3 = stack.enter_context(Postgres()), stack.enter_context(S3())
        environment = {"ISOCORTEX_DATABASE": postgres.address(), **s3.environment("heads")}
        # The first one has a worker.
        servers = [
            stack.enter_context(Server(environment=environment, settings=SETTINGS, arguments=["--workers", workers]))
            for workers in ("1", "0")
        ]
        case = servers[0].prepared(head(10.0, 1))
        if "objects" in kinds:
            away(report, "S3", "object store", s3.stop, s3.start, servers, case)
        if "database" in kinds:
            away(report, "B7", "database", postgres.stop, postgres.start, servers, case)
    report.end()


main()
