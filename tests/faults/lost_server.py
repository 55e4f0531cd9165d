"""One of four servers is lost behind Caddy (target B5): only its cases move, and no request fails.

The servers are stand-ins that answer with their number, because only the configuration of docker/Caddyfile is tried. Which cases a server has depends on
its port, as if at random: of 5,000 cases, one of four has more than 27 % once in two thousand runs. The short form has 1,000, and allows 30 %.
"""

import collections
import http.client
import http.server
import socket
import threading

from attack import Report, is_short
from proxy import Caddy

CASES = 1000 if is_short() else 5000
MOST_MOVED = 0.3 if is_short() else 0.27


class StandIn(http.server.ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Answer)
        self.open = set()
        threading.Thread(target=self.serve_forever, args=[0.05], daemon=True).start()

    def lose(self):
        self.shutdown()
        self.server_close()
        for connection in list(self.open):
            try:
                connection.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass


class Answer(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    wbufsize = -1
    disable_nagle_algorithm = True

    def setup(self):
        super().setup()
        self.server.open.add(self.connection)

    def do_GET(self):
        body = str(self.server.server_port).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass

    def handle_one_request(self):
        try:
            super().handle_one_request()
        except (OSError, ValueError):
            self.close_connection = True


def places(port):
    """Which server answers for each case, and how many requests fail."""
    found, failed = {}, 0
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    for number in range(CASES):
        connection.request("GET", f"/v1/cases/{number * 0x9E3779B97F4A7C15 % 2**128:032x}")
        answer = connection.getresponse()
        body = answer.read()
        failed += answer.status != 200
        found[number] = body
    return found, failed


def main():
    report = Report("a lost server")
    servers = [StandIn() for _ in range(4)]
    with Caddy([server.server_port for server in servers]) as caddy:
        before, failed = places(caddy.port)
        shares = sorted(collections.Counter(before.values()).values())
        lost = servers[0]
        lost.lose()
        after, failed_after = places(caddy.port)
    moved = sum(before[number] != after[number] for number in before)
    others = sum(before[number] != after[number] for number in before if before[number] != str(lost.server_port).encode())
    report.figure("cases of each server", shares)
    report.target(
        "B5", f"one of four servers is lost: at most {100 * MOST_MOVED:.0f} % of the cases move, no request fails",
        f"{100 * moved / CASES:.1f} % moved, {others} of other servers; {failed + failed_after} of {2 * CASES} requests failed",
        moved <= MOST_MOVED * CASES and not others and not failed + failed_after,
    )
    report.end()


main()
