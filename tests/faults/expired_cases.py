"""Cases that are too old: they are listed, removed with everything of them, and kept where that was asked for.

The rows of three cases are made ninety days older. `remove-expired --dry-run` must list those that are not kept and remove nothing; a server that
has just started must remove nothing either. `remove-expired` must then remove them, and no file of the store may hold their label.
"""

import json
import os
import sqlite3
import subprocess

from attack import Report, Server, head, program
from leftovers import files_with


def expired(data, *arguments):
    command = [program(), "remove-expired", "--data", data, "--keep-days", "30", *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def main():
    report = Report("cases that are too old")
    with Server() as server:
        labels = ["CANARY-OLD-Zylberzwick", "kept", "uploaded again", "new"]
        volumes = [head(10.0, seed) for seed in range(4)]
        cases = [
            server.prepared(volume, parameters=json.dumps({"name": label}).encode())
            for volume, label in zip(volumes, labels)
        ]
        old, kept, again, _new = cases
        server.stop()
        rows = sqlite3.connect(os.path.join(server.data, "rows.sqlite"))
        ninety_days_us = 90 * 24 * 3600 * 1_000_000
        for case in cases[:3]:
            rows.execute("UPDATE cases SET created_at = created_at - ? WHERE id = ?", (ninety_days_us, case.rsplit("/", 1)[1]))
        rows.commit()
        rows.close()
        server.start()
        status, _, body = server.ask("PATCH", kept, b'{"kept": true}')
        report.expect("a case can be kept", status == 200 and json.loads(body)["kept"], status)
        server.upload(volumes[2])
        listed = expired(server.data, "--dry-run")
        ids = [case.rsplit("/", 1)[1] for case in cases]
        report.expect("the dry run lists the old case alone", [one in listed for one in ids] == [True, False, False, False], listed.strip())
        report.expect("and removes nothing", all(server.ask("GET", case)[0] == 200 for case in cases))
        server.stop()
        server.arguments = ["--keep-days", "30"]
        server.start()
        statuses = [server.ask("GET", case)[0] for case in cases]
        report.expect("a server removes nothing in its first hour", statuses == [200] * 4, statuses)
        expired(server.data)
        statuses = [server.ask("GET", case)[0] for case in cases]
        report.expect("a person removes it", statuses == [404, 200, 200, 200], statuses)
        report.expect("the age counts from the last upload", server.json(again)["expires_at"] > server.json(again)["created_at"])
        for needle in (labels[0].encode(), ids[0].encode()):
            left = files_with(server.data, needle)
            report.expect("no file holds its label or id", not left, left)
        report.expect("nothing is left to remove", "would be removed: 0" in expired(server.data, "--dry-run"))
    report.end()


main()
