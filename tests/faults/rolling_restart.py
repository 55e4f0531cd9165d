"""Two servers behind Caddy are restarted one after the other while 200 requests a second come in (target B2).

Rows are in PostgreSQL, objects in a folder that both share; the configuration of Caddy is that of docker/. Each server has a worker, and a head is
being prepared when the server is told to stop. No request may fail, and every head must be ready in the end. `--rate` and `--seconds` (before, between
and after the restarts) change the load. rolling_upgrade.py does the same over a schema version.
"""

import argparse
import collections
import http.client
import threading
import time
from contextlib import ExitStack

from attack import Report, Server, head, is_short, program
from cluster import Shared, free_ports
from proxy import Caddy

SETTINGS = "[limits]\nmaps = \"off\"\n[http]\ntrusted_proxies = [\"127.0.0.1\"]\n"


class Load:
    """Requests at a rate, each client on a connection of its own. `with Load(…) as load:` ends it."""

    def __init__(self, port, addresses, per_second, clients=16):
        self.port, self.addresses, self.clients = port, addresses, clients
        self.pause = clients / per_second
        self.answers, self.slowest, self.failures = collections.Counter(), 0.0, []
        self.running, self.lock = True, threading.Lock()
        self.begun = time.monotonic()

    def __enter__(self):
        self.threads = [threading.Thread(target=self.client, args=[number]) for number in range(self.clients)]
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *_):
        self.running = False
        for thread in self.threads:
            thread.join()
        self.took = time.monotonic() - self.begun

    def client(self, number):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        turn = number
        due = time.monotonic() + self.pause * number / self.clients
        while self.running:
            time.sleep(max(0.0, due - time.monotonic()))
            due += self.pause
            address = self.addresses[turn % len(self.addresses)]
            turn += 1
            begun = time.monotonic()
            try:
                connection.request("GET", address)
                answer = connection.getresponse()
                answer.read()
                status = answer.status
            except (OSError, http.client.HTTPException) as error:
                status = type(error).__name__
                connection.close()
            with self.lock:
                self.answers[status] += 1
                self.slowest = max(self.slowest, time.monotonic() - begun)
                if status != 200:
                    self.failures.append((round(begun - self.begun, 1), address, status))


def is_ready(server):
    return server.ask("GET", "/readyz", timeout=5)[0] == 200


def load_options():
    options = argparse.ArgumentParser()
    options.add_argument("--short", action="store_true")
    options.add_argument("--rate", type=float, default=50 if is_short() else 200)
    options.add_argument("--seconds", type=float, default=1 if is_short() else 10)
    return options.parse_args()


def rolling(report, what, asked, before=None, away=lambda store, server: None):
    """Restarts the servers and reports what became of the requests.

    The servers begin with the program `before`, if there is one. `away` is called while each of them is stopped.
    """
    with ExitStack() as stack:
        store = stack.enter_context(Shared())
        ports = free_ports(2)
        servers = []
        for port in ports:
            server = Server(environment=store.environment, settings=SETTINGS)
            server.listen = f"127.0.0.1:{port}"
            server.program = (lambda: before) if before else program
            servers.append(stack.enter_context(server))
        cases = [servers[0].prepared(head(10.0, seed)) for seed in range(8)]
        caddy = stack.enter_context(Caddy(ports))
        addresses = [f"{case}{rest}" for case in cases for rest in ("", "/mesh?depth_mm=5", "/volume?bits=8")] + ["/v1/cases"]
        uploads, stops = [], []
        heads = [head(4.0 if asked.short else 2.0, 100 + seed) for seed in range(4)]
        with Load(caddy.port, addresses, asked.rate) as load:
            time.sleep(asked.seconds)
            for number, server in enumerate(servers):
                # A head for each worker, so that the one that stops has one at work.
                for volume in heads[2 * number : 2 * number + 2]:
                    status, headers, body = servers[1 - number].upload(volume)
                    assert status == 202, body
                    uploads.append(headers["location"])
                time.sleep(0.5)
                begun = time.monotonic()
                server.stop()
                stops.append(time.monotonic() - begun)
                server.program = program
                away(store, server)
                server.start()
                while not is_ready(server):
                    time.sleep(0.1)
                # Caddy asks every 2 s who is healthy.
                time.sleep(max(4, asked.seconds))
        states = [servers[0].until_settled(address, 120).get("state") for address in uploads]
        count = sum(load.answers.values())
        failed = count - load.answers[200]
        measured = (
            f"{failed} of {count} requests failed at {count / load.took:.0f}/s, slowest {load.slowest:.1f} s; "
            f"stopped within {max(stops):.1f} s; {states.count('ready')} of {len(states)} heads ready"
        )
        met = not failed and max(stops) <= 30 and set(states) == {"ready"}
        report.figure("answers", dict(load.answers))
        if failed:
            report.figure("failures", load.failures[:10])
        report.target("B2", f"{what} at 200 requests/s: none fails, each server stops within 30 s", measured, met)


def main():
    report = Report("a rolling restart behind a proxy")
    rolling(report, "a rolling restart", load_options())
    report.end()


if __name__ == "__main__":
    main()
