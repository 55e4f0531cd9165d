"""500 wrong tokens, one after the other.

They must leave a line in the log and meet a growing delay, while the right token is answered at once from elsewhere.
"""

import time

from attack import Report, Server

TOKEN = "correct-horse-battery-staple"
SECONDS = 20


def main():
    report = Report("guessing tokens")
    with Server(environment={"ISOCORTEX_TOKEN": TOKEN}) as server:
        started, tried, times = time.monotonic(), 0, []
        while tried < 500 and time.monotonic() - started < SECONDS:
            begun = time.monotonic()
            server.ask("GET", "/v1/cases", headers={"Authorization": f"Bearer wrong-token-number-{tried:04}"})
            times.append(time.monotonic() - begun)
            tried += 1
        rate = tried / (time.monotonic() - started)
        report.figure("guesses", f"{tried}, {rate:.0f} a second; the last took {1000 * times[-1]:.0f} ms")
        report.expect("a guess is slowed to 5 a second or fewer", rate <= 5)
        warnings = [line for line in server.log().splitlines() if "WARN" in line and "token" in line]
        report.expect("the log warns", bool(warnings), f"{len(warnings)} lines")
        report.expect("the log is not flooded", len(warnings) <= 20)
        report.expect("the log holds no token", "wrong-token" not in server.log() and TOKEN not in server.log())
        begun = time.monotonic()
        right = {"Authorization": f"Bearer {TOKEN}"}
        status, _, _ = server.ask("GET", "/v1/cases", headers=right, source="127.0.0.9")
        report.expect("the right token from elsewhere waits for nothing", status == 200 and time.monotonic() - begun < 0.2)
        status, _, _ = server.ask("GET", "/v1/cases", headers=right)
        report.expect("the right token is right from the same address, too", status == 200)
        begun = time.monotonic()
        server.ask("GET", "/healthz")
        report.expect("health checks wait for nothing", time.monotonic() - begun < 0.2)
    report.end()


main()
