"""A database with many cases (target B6): how long a page of the list takes, and how large the rows are.

One case is prepared; its row and its references are copied so many times (`--cases`) by SQL. Pages are then requested one after the other. The CPU time
of a page is printed too: other load on the machine hardly changes it.
"""

import argparse
import random
import statistics
import time

from attack import Report, Server, cpu_seconds, head
from cluster import Shared


def copy(postgres, first, last):
    """Copies the prepared case, with its references."""
    postgres.ask(
        "SET session_replication_role = replica;"
        "INSERT INTO cases (id, closing_radius_mm, parameters, name, state, facts, facts_digest, created_at)"
        " SELECT md5(n::TEXT), 10, parameters, 'Head ' || n, state, facts, facts_digest, created_at - n * 1000000::BIGINT"
        f" FROM cases, generate_series({first}, {last}) AS n WHERE name IS NULL;"
        "INSERT INTO case_objects (case_id, kind, digest)"
        f" SELECT md5(n::TEXT), kind, md5(n || kind) || md5(kind || n) FROM generate_series({first}, {last}) AS n, case_objects"
        " WHERE case_id = (SELECT id FROM cases WHERE name IS NULL)"
    )


def pages(store, server, count):
    """What so many pages of 50 cases take, one after the other; after the last one from the start again.

    The seconds of each, and the milliseconds of CPU that a page costs the server and PostgreSQL.
    """
    took, after, backends = [], "", store.postgres.pids()
    cpu = lambda: (cpu_seconds([server.process.pid]), cpu_seconds(backends))
    before = cpu()
    for _ in range(count):
        begun = time.monotonic()
        page = server.json(f"/v1/cases?limit=50{after}")
        took.append(time.monotonic() - begun)
        after = f"&after={page['next']}" if "next" in page else ""
    return took, *(1000 * (now - earlier) / count for now, earlier in zip(cpu(), before))


def main():
    options = argparse.ArgumentParser()
    options.add_argument("--cases", type=int, default=200_000)
    asked = options.parse_args()
    report = Report(f"{asked.cases:,} cases")
    with Shared() as store, Server(environment=store.environment) as server:
        server.prepared(head(10.0))
        # With the prepared one a full page, as each page of many cases is.
        copy(store.postgres, 1, 49)
        pages(store, server, 20)
        few, *cpu_of_few_ms = pages(store, server, 200)
        copy(store.postgres, 50, asked.cases)
        store.postgres.ask("ANALYZE")
        sizes = {
            name: int(store.postgres.ask(f"SELECT pg_total_relation_size('{name}')")[0][0]) for name in ("cases", "case_objects")
        }
        for name, size in sizes.items():
            report.figure(f"{name}, bytes a case", round(size / asked.cases))
        chance = random.Random(6)
        took, *cpu_ms = pages(store, server, 200)
        ids = [case["id"] for case in server.json("/v1/cases?limit=200")["cases"]]
        single = []
        for _ in range(200):
            begun = time.monotonic()
            assert server.json(f"/v1/cases/{chance.choice(ids)}")
            single.append(time.monotonic() - begun)
        p95 = statistics.quantiles(took, n=20)[-1]
        total_mb = sum(sizes.values()) / 1e6
        measured = (
            f"{asked.cases:,} cases: page of 50 p95 {1000 * p95:.0f} ms (median {1000 * statistics.median(took):.0f}, with 50 cases {1000 * statistics.median(few):.0f}), "
            f"{cpu_ms[0]:.1f} ms of CPU in the server and {cpu_ms[1]:.1f} in PostgreSQL; a case {1000 * statistics.median(single):.0f} ms; {sizes['cases'] / 1e6:.0f} MB of cases, {sizes['case_objects'] / 1e6:.0f} MB of references, so {total_mb / asked.cases * 1000:.1f} GB for a million"
        )
        report.target("B6", "1 million studies: page p95 at most 50 ms, at most 400 MB", measured, p95 <= 0.05 and total_mb / asked.cases <= 400 / 1e6, binds=False)
        costs = f"{sum(cpu_of_few_ms):.1f} ms of CPU with 50, {sum(cpu_ms):.1f} with {asked.cases:,}"
        report.expect("a page costs hardly more than with 50 cases", sum(cpu_ms) < sum(cpu_of_few_ms) + 5, costs)
    report.end()


main()
