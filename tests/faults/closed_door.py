"""Strangers without the token who try to close the server: 560 sockets of two addresses that send wrong tokens, say half a
header or say nothing, then 600 through Caddy as docker/ configures it.

A client with the right token at another address is served all the time, and so are health checks.
"""

import contextlib
import socket
import threading
import time

from attack import Report, Server, is_short
from proxy import Caddy

TOKEN = "correct-horse-battery-staple"
WRONG = b"GET /v1/cases HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer wrong-token-wrong-token\r\n\r\n"
SOCKETS = 560
SECONDS = 4 if is_short() else 15


def connect(port, source):
    stranger = socket.socket()
    stranger.settimeout(5)
    stranger.bind((source, 0))
    stranger.connect(("127.0.0.1", port))
    return stranger


def guess(port, source, ends):
    """Sends one wrong token after the other."""
    while not ends.is_set():
        with contextlib.suppress(OSError), connect(port, source) as stranger:
            while not ends.is_set():
                stranger.sendall(WRONG)
                if not stranger.recv(65536):
                    break


def hold(opening):
    """Opens connections that say no more than `opening`, again and again."""

    def attack(port, source, ends):
        while not ends.is_set():
            with contextlib.suppress(OSError), connect(port, source) as stranger:
                stranger.sendall(opening)
                stranger.settimeout(0.5)
                while not ends.is_set():
                    with contextlib.suppress(TimeoutError):
                        if not stranger.recv(65536):
                            break

    return attack


def honest(report, server, attack, sockets, sources, name):
    """Asks as a client and as a health check while strangers attack."""
    ends = threading.Event()
    strangers = [
        threading.Thread(target=attack, args=(server.port, sources[number % len(sources)], ends), daemon=True)
        for number in range(sockets)
    ]
    for stranger in strangers:
        stranger.start()
    right = {"Authorization": f"Bearer {TOKEN}"}
    started, answers, slowest = time.monotonic(), [], 0
    while time.monotonic() - started < SECONDS:
        for address, headers, source in [
            ("/v1/cases", right, "127.0.0.9"),
            ("/healthz", {}, "127.0.0.9"),
        ]:
            begun = time.monotonic()
            status, _, _ = server.ask("GET", address, headers=headers, source=source)
            slowest = max(slowest, time.monotonic() - begun)
            answers.append(status)
        time.sleep(0.05)
    ends.set()
    for stranger in strangers:
        stranger.join()
    served = answers.count(200)
    report.figure(f"{name}: the slowest answer", f"{slowest:.2f} s")
    report.expect(f"{name}: every client and health check is served", served == len(answers), f"{served} of {len(answers)}")


def main():
    report = Report("strangers at the door")
    attacks = {"wrong tokens": guess, "half a header": hold(b"GET /v1/ca"), "silence": hold(b"")}
    settings = {"settings": f'[http]\ntoken = "{TOKEN}"\n', "environment": {"ISOCORTEX_LOG": "warn"}}
    for name, attack in attacks.items():
        with Server(**settings) as server:
            honest(report, server, attack, SOCKETS, ["127.0.0.2", "127.0.0.3"], name)
    settings["environment"]["ISOCORTEX_TRUSTED_PROXIES"] = "127.0.0.1"
    with Server(**settings) as one, Server(**settings) as two, Caddy([one.port, two.port]) as caddy:
        # Caddy listens on 127.0.0.1 alone, and is asked as a server is.
        one.port = caddy.port
        honest(report, one, guess, 600, ["127.0.0.1"], "wrong tokens through Caddy")
    report.end()


main()
