"""Requests that schemathesis makes of the description of the interface: its coverage phase (C6).

For each operation it sends the borders of each value, wrong types, missing and doubled keys, and methods that do not exist. None may be answered with
5xx, with a status or a type that the description does not name, or with a body that differs from its schema; what a required header or token
guards stays closed without it. schemathesis is installed from PyPI into a folder of its own.
"""

import os
import re
import subprocess
import tempfile
import venv

from attack import Report, Server, head, skip

VERSION = "4.32.5"
TOKEN = "a-token-of-the-generated-requests"
# Not asked: that all wrong values are refused, which schemas alone cannot tell (a case that is not there, a key that depends on another one).
CHECKS = ["not_a_server_error", "status_code_conformance", "content_type_conformance", "response_headers_conformance",
          "response_schema_conformance", "missing_required_header", "ignored_auth", "allow_header_conformance"]
# The case of each path, and 428 of an `If-Match` that is missing (RFC 6585).
CONFIGURATION = """
[parameters]
"path.id" = "{case}"
[checks.missing_required_header]
expected-statuses = [400, 401, 403, 406, 415, 422, 428]
"""
# Streams of events do not end.
ENDLESS = r"/events$"


def installed(folder):
    """The program, in an environment of its own."""
    given = os.environ.get("SCHEMATHESIS")
    if given:
        return given
    try:
        venv.create(folder, with_pip=True)
    except (OSError, subprocess.CalledProcessError) as error:
        skip(f"Python makes no environment for schemathesis here (is python3-venv installed?): {error}")
    command = [f"{folder}/bin/pip", "install", "-q", "--retries", "1", "--timeout", "15", f"schemathesis=={VERSION}"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        skip(f"schemathesis {VERSION} cannot be installed from PyPI: {(done.stderr.strip().splitlines() or ['no reason'])[-1]}")
    return f"{folder}/bin/schemathesis"


def main():
    report = Report("generated requests to every operation")
    with tempfile.TemporaryDirectory() as folder:
        program = installed(os.path.join(folder, "environment"))
        settings = "".join(f"{line}\n" for line in ("[limits]", 'maps = "off"', "[http]", f'token = "{TOKEN}"'))
        with Server(settings=settings) as server:
            authorized = {"Authorization": f"Bearer {TOKEN}"}
            ask = server.ask
            server.ask = lambda method, address, body=None, headers=None, *more, **others: ask(
                method, address, body, {**authorized, **(headers or {})}, *more, **others
            )
            case = server.prepared(head(8.0)).rsplit("/", 1)[1]
            with open(os.path.join(folder, "schemathesis.toml"), "w") as file:
                file.write(CONFIGURATION.format(case=case))
            command = [program, "run", f"http://127.0.0.1:{server.port}/openapi.json", "--phases", "coverage", "--checks", ",".join(CHECKS)]
            command += ["--header", f"Authorization: Bearer {TOKEN}", "--exclude-path-regex", ENDLESS, "--continue-on-failure"]
            command += ["--request-timeout", "60", "--no-color", "--seed", "30"]
            made, failed = 0, 0
            # Deletions come last, because there is one case.
            for methods in (["--exclude-method", "DELETE"], ["--include-method", "DELETE"]):
                done = subprocess.run(command + methods, cwd=folder, capture_output=True, text=True, timeout=3600)
                said = done.stdout + done.stderr
                failed += done.returncode != 0
                if done.returncode:
                    print("\n".join(f"   | {line}" for line in said.splitlines()))
                made += int((re.search(r"(\d+) generated", said) or [0, 0])[1])
            measured = f"{made} requests, {'nothing' if not failed else 'failures, listed above'}"
            report.target("generated requests, coverage phase (C6)", "no 5xx, nothing that is not described", measured, made > 0 and not failed)
            status, _, _ = server.ask("GET", "/healthz")
            report.expect("the server still answers", status == 200)
    report.end()


main()
