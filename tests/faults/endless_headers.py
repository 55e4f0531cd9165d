"""Forms that never come to a part: no boundary at all, or a part's header without an end.

Six sockets send 64 MB each. The server must refuse each form (400) after 16 kB without a part, and keep none of it.
"""

import socket
import threading

from attack import BOUNDARY, FORM, Report, Server, Watch

SOCKETS = 6
BYTES = 64 << 20


def attack(server, opening, filler, statuses):
    """Sends a form that begins with `opening` and goes on with `filler` for ever."""
    length = BYTES + len(opening)
    request = (
        f"POST /v1/cases HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: {FORM}\r\nContent-Length: {length}\r\n\r\n"
    )
    block = (filler * (65536 // len(filler) + 1))[:65536]
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as connection:
        try:
            connection.sendall(request.encode() + opening)
            for _ in range(BYTES // len(block)):
                connection.sendall(block)
        except OSError:
            pass
        try:
            answer = connection.recv(4096)
        except OSError:
            answer = b""
    statuses.append(answer[9:12].decode())


def main():
    report = Report("forms without an end to their headers")
    head = f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="volume"\r\nX-Long: '.encode()
    for name, opening, filler in [
        ("no boundary", b"", b"not a boundary "),
        ("a header without an end", head, b"abcdefgh"),
        ("headers without an end", head, b"x\r\nX-More: abcdefgh"),
    ]:
        with Server() as server, Watch(server) as watch:
            statuses = []
            threads = [
                threading.Thread(target=attack, args=(server, opening, filler, statuses)) for _ in range(SOCKETS)
            ]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        report.figure(name, f"answers {sorted(statuses)}")
        watch.tell(report)
        report.expect(f"{name}: memory grows by less than 64 MB", watch.grown_mb() < 64, f"{watch.grown_mb():.0f} MB")
        # The answer is lost if the client is still sending when the connection is closed.
        report.expect(f"{name}: no form is taken", all(s in ("400", "") for s in statuses))
        report.expect(f"{name}: health within 0.5 s", watch.failed == 0 and watch.slowest_s < 0.5)
    report.end()


main()
