"""A disk that fails for a moment: every fsync, or every write of the database, ends with EIO or ENOSPC (by strace).

While it fails, uploads answer 507 (or 202 if none of their calls failed), readiness does not answer 200, and
reads go on. When the disk is well again, so must be the server, without a restart. A deletion or a change of the label
that was refused has not happened, also after the server is killed and started. The short form tries fsync alone.
"""

import os
import shutil
import signal
import subprocess
import time

from attack import Report, Server, head, is_short, skip

FAULTS = [
    ("fsync fails", "fsync,fdatasync", "fsync,fdatasync:error=EIO"),
    ("positioned writes fail", "pwrite64", "pwrite64:error=EIO"),
    ("no room for positioned writes", "pwrite64", "pwrite64:error=ENOSPC"),
    ("every third fsync fails", "fsync,fdatasync", "fsync,fdatasync:error=EIO:when=1+3"),
]


def break_disk(server, trace, inject):
    """Attaches to the server; every traced call fails from then on."""
    command = ["strace", "-f", "-qq", "-o", "/dev/null", "-e", f"trace={trace}", "-e", f"inject={inject}", "-p", str(server.process.pid)]
    tracer = subprocess.Popen(command, stderr=subprocess.PIPE)
    time.sleep(1)
    if tracer.poll() is not None:
        skip(f"strace cannot attach: {tracer.stderr.read().decode()[-200:]}")
    return tracer


REFUSED = [
    ("DELETE", None, "deletion"),
    ("PATCH", b'{"name": "refused"}', "change of the label"),
]


def refused_changes(report, trials):
    """Changes that are refused while fsync fails; then the server is killed, and started on a disk that is well."""
    for method, body, what in REFUSED:
        seen = []
        for _ in range(trials):
            with Server() as server:
                case = server.prepared(head(8.0, 1))
                before = server.json(case)["name"]
                tracer = break_disk(server, *FAULTS[0][1:])
                status = server.ask(method, case, body, body and {"Content-Type": "application/json"})[0]
                server.stop(signal.SIGKILL)
                tracer.wait(20)
                server.start()
                after = server.json(case)
                seen.append((status, after is not None and after["name"] == before))
        report.expect(f"a {what} that was refused has not happened after a kill", seen == [(507, True)] * trials, seen)


def main():
    if not shutil.which("strace"):
        skip("strace is not installed")
    report = Report("a disk that fails for a moment")
    for name, trace, inject in FAULTS[:1] if is_short() else FAULTS:
        with Server() as server:
            kept = server.prepared(head(8.0, 1))
            tracer = break_disk(server, trace, inject)
            try:
                broken = [server.upload(head(8.0, seed), timeout=30)[0] for seed in range(10, 16)]
                ready = server.ask("GET", "/readyz")[0]
                reads = [server.ask("GET", f"{kept}{rest}")[0] for rest in ("", "/mesh")]
            finally:
                tracer.send_signal(signal.SIGINT)
                tracer.wait(20)
            after = [server.upload(head(8.0, seed), timeout=30) for seed in range(30, 36)]
            statuses = [status for status, _, _ in after]
            report.figure(name, f"uploads {broken}, readyz {ready}, reads {reads}; afterwards {statuses}")
            # Readiness makes a small file durable, and writes no row for good.
            if name == "fsync fails":
                report.expect(f"{name}: readiness says so", ready == 507, ready)
            # With some of the calls, an upload can succeed.
            answers = {202, 507} if "when" in inject else {507}
            report.expect(f"{name}: uploads answer 507", set(broken) <= answers, broken)
            report.expect(f"{name}: reads go on", reads == [200, 200], reads)
            report.expect(f"{name}: uploads go on afterwards", all(s == 202 for s in statuses), statuses)
            states = [server.until_settled(h["location"], 40).get("state") for s, h, _ in after if s == 202]
            report.expect(f"{name}: and get ready", states == ["ready"] * 6, states)
            report.expect(f"{name}: ready at the end", server.ask("GET", "/readyz")[0] == 200)
            depth = server.log().count("non-zero transaction depth")
            report.expect(f"{name}: no connection is left inside its transaction", depth == 0, f"{depth} times in the log")
    refused_changes(report, 1 if is_short() else 3)
    asked = "a failing disk: uploads are refused in words, reads go on, all is well without a restart"
    report.target("A3", asked, f"{report.failed} expectations broken", not report.failed)
    report.end()


main()
