"""Two servers behind Caddy are upgraded one after the other, over a schema version, while requests come in (target B2).

With ISOCORTEX_BEFORE, the path of an earlier program, the servers begin with that one and are restarted with this one.

Otherwise this program stands for both versions. While the first server is away, the tables become those of a next version: each gets a column, there is
one table more, and the version is noted. The server that is left must continue to work on them, and this program must refuse to start on
them. Then the note is removed, so that from there on this program stands for the newer one.
"""

import os
import time

from attack import Report
from rolling_restart import load_options, rolling

NEWEST = "SELECT max(version) FROM _sqlx_migrations"


def newest(store):
    return int(store.postgres.ask(NEWEST)[0][0])


def migrate_to_the_next(store):
    """Changes the tables as the next version may: it adds, and takes nothing away."""
    tables = [name for [name] in store.postgres.ask("SELECT tablename FROM pg_tables WHERE schemaname = 'public'") if not name.startswith("_")]
    assert {"cases", "case_objects", "jobs"} <= set(tables), tables
    statements = [f"ALTER TABLE {name} ADD COLUMN of_the_next_version BIGINT NOT NULL DEFAULT 0" for name in tables]
    statements.append("CREATE TABLE next_version (id TEXT PRIMARY KEY)")
    statements.append(
        "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)"
        f" SELECT max(version) + 1, 'the next version', TRUE, '', 0 FROM _sqlx_migrations"
    )
    store.postgres.ask("BEGIN;" + ";".join(statements) + ";COMMIT")


def main():
    report = Report("a rolling upgrade behind a proxy")
    before, asked, seen = os.environ.get("ISOCORTEX_BEFORE"), load_options(), []

    def away(store, server):
        if seen:
            return
        seen.append(newest(store))
        if before:
            return
        migrate_to_the_next(store)
        try:
            server.start()
            said = "it started"
        except RuntimeError as refused:
            said = str(refused)
        report.expect("a program that is older than the tables refuses to start", "newer version" in said, said.strip()[-160:])
        # The other server works on, on tables that are newer than itself.
        time.sleep(max(2, asked.seconds))
        store.postgres.ask(f"DELETE FROM _sqlx_migrations WHERE version > {seen[0]}")

    what = "a rolling upgrade from an earlier program" if before else "a rolling upgrade over a schema version"
    rolling(report, what, asked, before, away)
    report.end()


if __name__ == "__main__":
    main()
