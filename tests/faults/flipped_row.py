"""A digit of a case's facts that flips on the disk.

The facts hold the affine: a flipped digit moves every coordinate. The server must find out, answer no wrong number, and
make the facts again from the source. The same for a page of the database that is overwritten.
"""

import json
import os
import re
import sqlite3

from attack import Report, Server, head


def flip_a_digit(database):
    with sqlite3.connect(database) as rows:
        (facts,) = rows.execute("SELECT facts FROM cases").fetchone()
        place = re.search(r'"patient_from_voxel":\[\[-?(\d)', facts).start(1)
        digit = "7" if facts[place] != "7" else "3"
        rows.execute("UPDATE cases SET facts = ?", (facts[:place] + digit + facts[place + 1 :],))
    rows.close()


def main():
    report = Report("a digit that flips in a row")
    with Server() as server:
        case = server.prepared(head(8.0))
        sound = json.loads(server.ask("GET", case)[2])
        server.stop()
        flip_a_digit(os.path.join(server.data, "rows.sqlite"))
        server.start()
        status, _, body = server.ask("GET", case)
        first = json.loads(body)
        wrong = status == 200 and first.get("grid") not in (None, sound["grid"])
        report.figure("first answer", f"{status} {first.get('state', first.get('type'))}")
        report.expect("no wrong coordinate is answered", not wrong, first.get("grid", {}))
        healed = server.until_settled(case, timeout=30)
        report.expect("the facts are made again", healed.get("grid") == sound["grid"])
        report.expect("the log tells it", "damaged" in server.log() or "digest" in server.log())
    with Server() as server:
        server.prepared(head(8.0))
        server.stop()
        path = os.path.join(server.data, "rows.sqlite")
        with open(path, "r+b") as file:
            file.seek(4096 + 8)
            file.write(os.urandom(2048))
        try:
            server.start()
            started = True
        except RuntimeError as refusal:
            started = False
            report.figure("words", str(refusal)[-300:].strip())
        report.expect("a server does not start on a damaged database", not started)
    report.end()


main()
