"""Kills workers at random moments: every case is prepared all the same, each once, and nothing else is left.

Two workers prepare `--jobs` cases on one PostgreSQL; one of them is killed (SIGKILL) and replaced `--kills` times. A killed worker's
case waits for the end of its lease, 30 s.
"""

import argparse
import random
import time

from attack import Report, head, is_short
from cluster import Cluster, Postgres


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--jobs", type=int, default=12 if is_short() else 500)
    parser.add_argument("--kills", type=int, default=4 if is_short() else 100)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    chance = random.Random(asked.seed)
    report = Report(f"{asked.kills} killed workers, {asked.jobs} cases")
    with Postgres() as postgres, Cluster(postgres) as cluster, cluster.server() as server:
        started = time.monotonic()
        volume = head(8.0)
        cases, killed_at_work, kills = [], 0, asked.kills
        while len(cases) < asked.jobs or asked.kills > 0 or states(postgres) != {"ready": asked.jobs}:
            while len(cases) < asked.jobs and waiting(postgres) < 60:
                parameters = ('{"closing_radius_mm": %s}' % (5 + len(cases) / 100)).encode()
                status, headers, body = server.upload(volume, parameters=parameters)
                assert status == 202, (status, body)
                cases.append(headers["location"])
            while len(cluster.workers) < 2:
                cluster.start_worker()
            time.sleep(chance.uniform(0.3, 2.5))
            if asked.kills > 0:
                asked.kills -= 1
                before = leased(postgres)
                cluster.kill(chance.choice(cluster.workers))
                killed_at_work += before > 0
            if time.monotonic() - started > 3000:
                break
        report.figure("seconds", round(time.monotonic() - started))
        report.figure("kills while a case was at work", killed_at_work)
        report.expect("every case is ready", states(postgres) == {"ready": asked.jobs}, states(postgres))
        report.expect("no job is left", postgres.ask("SELECT count(*) FROM jobs WHERE state IN ('queued', 'running')") == [["0"]])
        # What killed workers were writing goes when its pin has ended, within the hour; it is protected until then.
        postgres.ask("UPDATE pins SET expires_at = 0")
        server.restart()
        status, words = cluster.check()
        report.expect("every object is there, whole and needed", status == 0, words.strip()[-300:])
        done = states(postgres).get("ready", 0)
        measured = f"{done} of {asked.jobs} cases ready once each after {kills} kills, {killed_at_work} at work"
        report.target("B1", f"{asked.jobs} jobs, {kills} kills: every job is done once", measured, done == asked.jobs and status == 0)
        report.expect("nothing is pinned", postgres.ask("SELECT count(*) FROM pins") == [["0"]])
    report.end()


def states(postgres):
    return {state: int(count) for state, count in postgres.ask("SELECT state, count(*) FROM cases GROUP BY state")}


def waiting(postgres):
    return int(postgres.ask("SELECT count(*) FROM jobs WHERE kind = 'prepare' AND state = 'queued'")[0][0])


def leased(postgres):
    now = "extract(epoch FROM clock_timestamp()) * 1000000"
    return int(postgres.ask(f"SELECT count(*) FROM jobs WHERE lease_until > {now}")[0][0])


main()
