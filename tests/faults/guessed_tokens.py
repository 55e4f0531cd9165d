"""500 wrong tokens, one after the other.

They must leave a few lines in the log and be answered 429 at once on a connection that is then closed, so that they hold nothing; the right
token is answered at once from everywhere.
"""

import time

from attack import Report, Server

TOKEN = "correct-horse-battery-staple"
SECONDS = 20


def main():
    report = Report("guessing tokens")
    with Server(settings=f'[http]\ntoken = "{TOKEN}"\n') as server:
        started, tried, refused, slowest = time.monotonic(), 0, 0, 0
        while tried < 500 and time.monotonic() - started < SECONDS:
            begun = time.monotonic()
            guess = {"Authorization": f"Bearer wrong-token-number-{tried:04}"}
            status, headers, _ = server.ask("GET", "/v1/cases", headers=guess)
            slowest = max(slowest, time.monotonic() - begun)
            closed = headers.get("connection") == "close" and "retry-after" in headers
            refused += status == 429 and closed
            tried += 1
        report.figure("guesses", f"{tried}; the slowest took {1000 * slowest:.0f} ms")
        report.expect("all but the first few are 429, with Retry-After, and closed", refused >= tried - 10, f"{refused} of {tried}")
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
