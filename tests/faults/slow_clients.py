"""Slow clients of one address: 520 uploads at 30 bytes a second in all, headers that never end, and connections that say nothing.

What is beyond a quarter of the connections is closed at once, and slow headers within 15 s. Slow bodies have the time of an upload, for no more than
a quarter of the places. Health checks never fail meanwhile, and an honest upload gets through while they try. What many addresses do is the proxy's.
"""

import select
import socket
import threading
import time

from attack import BOUNDARY, FORM, Report, Server, Watch, form, head

UPLOADS = 520
SECONDS = 30


def openings():
    length = 1 << 29
    upload = (
        f"POST /v1/cases HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: {FORM}\r\nContent-Length: {length}\r\n\r\n"
        f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="volume"; filename="f"\r\n\r\n'
    )
    return {
        "slow bodies": (upload.encode(), None),
        "slow headers": (b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nX-A: ", 15),
        "silence": (b"", 15),
    }


def hold(server, opening):
    """Opens all connections and feeds them a byte now and then; the times after which they were gone."""
    started = time.monotonic()
    alive = {}
    for _ in range(UPLOADS):
        connection = socket.socket()
        connection.settimeout(2)
        try:
            connection.bind(("127.0.0.5", 0))
            connection.connect(("127.0.0.1", server.port))
            if opening:
                connection.sendall(opening)
        except OSError:
            continue
        connection.setblocking(False)
        alive[connection] = time.monotonic()
    gone, turn = [], 0
    while alive and time.monotonic() - started < SECONDS:
        for connection in list(alive):
            ready, _, _ = select.select([connection], [], [], 0)
            if ready:
                try:
                    data = connection.recv(65536)
                except OSError:
                    data = b""
                if not data:
                    gone.append(time.monotonic() - alive.pop(connection))
                    connection.close()
        if opening:
            feed = list(alive)
            for connection in feed[turn : turn + 15]:
                try:
                    connection.send(b"x")
                except OSError:
                    pass
            turn = (turn + 15) % max(1, len(feed))
        time.sleep(0.5)
    left = len(alive)
    for connection in alive:
        connection.close()
    return gone, left


def upload_meanwhile(server, after_s, taken):
    """Uploads from an address of its own until that succeeds; notes how long it took."""
    body = form([("volume", head(8.0))])
    time.sleep(after_s)
    started = time.monotonic()
    while time.monotonic() - started < SECONDS:
        status, _, _ = server.ask(
            "POST", "/v1/cases", body, {"Content-Type": FORM}, timeout=3, source="127.0.0.200"
        )
        if status in (200, 202):
            taken.append(time.monotonic() - started)
            return
        time.sleep(0.5)


def main():
    report = Report(f"{UPLOADS} slow clients")
    for name, (opening, within_s) in openings().items():
        with Server() as server:
            honest = []
            thread = threading.Thread(target=upload_meanwhile, args=(server, 7, honest), daemon=True)
            thread.start()
            with Watch(server) as watch:
                gone, left = hold(server, opening)
            thread.join(5)
            slowest = max(gone, default=0)
            report.figure(name, f"{len(gone)} ended, the last after {slowest:.1f} s; {left} left after {SECONDS} s")
            watch.tell(report)
            report.figure("an honest upload", f"taken after {honest[0]:.1f} s" if honest else "never taken")
            if within_s:
                report.expect(f"{name}: all gone within {within_s} s", left == 0 and slowest <= within_s)
            else:
                report.expect(f"{name}: a quarter of the connections at most is left", left <= 128, left)
            report.expect(f"{name}: health never fails", watch.failed == 0)
            report.expect(f"{name}: an honest upload is taken", bool(honest))
    report.end()


main()
