#!/usr/bin/env python3
"""Measures what the audit record and TLS cost: the CPU time of the server for each request, and the time that its client waits, beside
those of a server without them. All servers run at the same time and are asked in turn, by one client over one connection each, so that other load
on the machine meets all of them alike; what is compared are the ratios of each round. Needs openssl.

    lab/scripts/cost.py PROGRAM [VOLUME [ROUNDS]]    (a NIfTI file; otherwise a synthetic head of 2 mm)
"""

import http.client
import os
import ssl
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests/faults"))
from attack import FORM, form, head  # noqa: E402

TOKEN = "a-token-of-the-measurement"
# What is asked, and how often in a round: about a quarter of a second of CPU time. No depth comes twice, so that nothing is kept of the answers.
KINDS = {
    "list of cases": (lambda case, number: "/v1/cases", 800),
    "case": (lambda case, number: case, 800),
    "case, a connection each": (lambda case, number: case, 150),
    "mesh": (lambda case, number: f"{case}/mesh?depth_mm={1 + number % 7001 / 1000}", 80),
    "picture": (lambda case, number: f"{case}/render?width=256&height=256&depth_mm={1 + number % 7001 / 1000}", 40),
    "mask (an export)": (lambda case, number: f"{case}/mask", 100),
}
NEW_CONNECTION = "case, a connection each"


class Server:
    """A server of its own, with a token, in a temporary folder."""

    def __init__(self, program, name, arguments=(), settings="", tls=False):
        self.name, self.tls = name, tls
        self.folder = tempfile.TemporaryDirectory()
        at = Path(self.folder.name)
        (at / "token").write_text(TOKEN)
        (at / "token").chmod(0o600)
        (at / "isocortex.toml").write_text(settings)
        (at / "audit").mkdir()
        words = [str(word).replace("{folder}", self.folder.name) for word in arguments]
        command = [program, "serve", "--config", at / "isocortex.toml", "--data", at / "data", "--token-file", at / "token"]
        command += ["--listen", "127.0.0.1:0", "--gpu", "off", "--log", "warn", *words]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.port = int(self.process.stdout.readline().decode().rsplit(":", 1)[1])
        self.connection = self.connect()
        self.number = 0

    def connect(self):
        if not self.tls:
            return http.client.HTTPConnection("127.0.0.1", self.port, timeout=300)
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        return http.client.HTTPSConnection("127.0.0.1", self.port, timeout=300, context=context)

    def ask(self, method, path, body=None, headers=None):
        self.connection.request(method, path, body, {"Authorization": f"Bearer {TOKEN}", **(headers or {})})
        answer = self.connection.getresponse()
        content = answer.read()
        assert answer.status in (200, 202), (self.name, path, answer.status, content[:300])
        return answer, content

    def prepare(self, volume):
        answer, _ = self.ask("POST", "/v1/cases", form([("volume", volume)]), {"Content-Type": FORM})
        self.case = answer.headers["location"]
        while b'"state":"ready"' not in self.ask("GET", self.case)[1]:
            time.sleep(0.5)

    def round(self, kind):
        """CPU time and time of one request, in ms."""
        address, count = KINDS[kind]
        # The server has closed the connection of the round before.
        self.connection.close()
        self.ask("GET", "/healthz")
        cpu, began = self.cpu_ns(), time.monotonic()
        for _ in range(count):
            if kind == NEW_CONNECTION:
                self.connection.close()
            self.number += 7919
            self.ask("GET", address(self.case, self.number))
        took = time.monotonic() - began
        cpu = sum(now - cpu.get(thread, 0) for thread, now in self.cpu_ns().items())
        return cpu / 1e6 / count, 1000 * took / count

    def cpu_ns(self):
        """The CPU time of each thread, in ns. One that ends has done nothing for seconds."""
        tasks = Path("/proc", str(self.process.pid), "task")
        return {task.name: int((task / "schedstat").read_text().split()[0]) for task in tasks.iterdir()}

    def end(self):
        self.connection.close()
        self.process.terminate()
        self.process.wait(60)
        self.folder.cleanup()


def main():
    program, volume, rounds = [*sys.argv[1:], None, None][:3]
    volume = Path(volume).read_bytes() if volume else head(2.0)
    rounds = int(rounds or 15)
    with tempfile.TemporaryDirectory() as keys:
        request = f"openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=localhost -keyout {keys}/key.pem -out {keys}/cert.pem"
        subprocess.run(request.split(), check=True, capture_output=True)
        os.chmod(f"{keys}/key.pem", 0o600)
        cached = "[limits]\nmaps = \"off\"\n"
        warm = [
            Server(program, "nothing", settings=cached),
            Server(program, "audit", ["--audit", "{folder}/audit"], cached),
            Server(program, "TLS", ["--tls-cert", f"{keys}/cert.pem", "--tls-key", f"{keys}/key.pem"], cached, tls=True),
        ]
        try:
            for server in warm:
                server.prepare(volume)
            print("| request | CPU, waiting | with | CPU | waiting |\n|---|---|---|---|---|")
            compare(warm, KINDS, rounds)
        finally:
            for server in warm:
                server.end()


def compare(servers, kinds, rounds):
    """Prints a row for each kind of request and each server but the first, which is what it is compared with."""
    for kind in kinds:
        for server in servers:
            server.round(kind)
        seen = [[] for _ in servers]
        for number in range(rounds):
            order = [(number + step) % len(servers) for step in range(len(servers))]
            for at in order:
                seen[at].append(servers[at].round(kind))
        plain = [statistics.median(values) for values in zip(*seen[0])]
        for server, values in zip(servers[1:], seen[1:]):
            ratios = []
            for part in (0, 1):
                each = sorted(own[part] / first[part] for own, first in zip(values, seen[0]) if first[part])
                quarter = len(each) // 4
                ratios.append(f"× {statistics.median(each):.2f} ({each[quarter]:.2f} to {each[-1 - quarter]:.2f})")
            print(f"| {kind} | {plain[0]:.2f} ms, {plain[1]:.2f} ms | {server.name} | {ratios[0]} | {ratios[1]} |", flush=True)


main()
