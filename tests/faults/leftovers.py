"""What a deleted case leaves behind: its label, its id, the texts of its files.

After DELETE no file of the data folder may hold any of them: not the rows, not their write-ahead log, not an object.
"""

import os

from attack import Report, Server, head

LABEL = "CANARY-LABEL-Zylberzwick"
DESCRIPTION = b"CANARY-DESCRIPTION-Quuxmore"


def files_with(folder, needle):
    found = []
    for root, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(root, name)
            with open(path, "rb") as file:
                if needle in file.read() or needle in path.encode():
                    found.append(os.path.relpath(path, folder))
    return sorted(found)


def main():
    report = Report("what a deleted case leaves behind")
    with Server() as server:
        parameters = ('{"name": "%s"}' % LABEL).encode()
        others = [server.prepared(head(8.0, seed)) for seed in (1, 2)]
        case = server.prepared(head(8.0, 3, description=DESCRIPTION), parameters=parameters)
        needles = {
            "label": LABEL.encode(),
            "id": case.rsplit("/", 1)[1].encode(),
            "description": DESCRIPTION,
        }
        for what, needle in needles.items():
            report.figure(f"files with the {what} before", files_with(server.data, needle))
        status, _, _ = server.ask("DELETE", case)
        report.expect("the case is deleted", status == 204, status)
        for what, needle in needles.items():
            left = files_with(server.data, needle)
            report.expect(f"no file holds the {what} after DELETE", not left, left)
        server.restart()
        for what, needle in needles.items():
            left = files_with(server.data, needle)
            report.expect(f"no file holds the {what} after a restart", not left, left)
        report.expect("the other cases are there", all(server.ask("GET", c)[0] == 200 for c in others))
        server.stop()
        report.expect("the write-ahead log is empty at the end", _length(server.data, "rows.sqlite-wal") == 0)
    report.end()


def _length(folder, name):
    try:
        return os.path.getsize(os.path.join(folder, name))
    except OSError:
        return 0


if __name__ == "__main__":
    main()
