"""Somebody guesses tokens, and holds connections, through Debian's nginx with the configuration of docs/configuration.md.

nginx answers 429 once they exceed its limits, and everybody else is served meanwhile.
"""

import contextlib
import http.client
import os
import shutil
import socket
import ssl
import subprocess
import tempfile
import threading
import time

from attack import FORM, Report, Server, form, head, is_short, skip
from cluster import free_ports
from debian import from_manual, unpacked

TOKEN = "correct-horse-battery-staple"
SECONDS = 4 if is_short() else 15


def ask(port, source, token):
    """The status of a list of cases, over TLS."""
    trust = ssl._create_unverified_context()
    connection = http.client.HTTPSConnection("127.0.0.1", port, timeout=10, context=trust, source_address=(source, 0))
    with contextlib.closing(connection):
        connection.request("GET", "/v1/cases", headers={"Authorization": f"Bearer {token}"})
        answer = connection.getresponse()
        answer.read()
        return answer.status


def start_nginx(folder, server):
    """nginx in front of a server, its process and its port."""
    environment = unpacked(f"{folder}/debian", "nginx")
    names = ["-subj", "/CN=isocortex.example", "-days", "2", "-keyout", f"{folder}/key.pem", "-out", f"{folder}/cert.pem"]
    curve = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]
    subprocess.run(["openssl", "req", "-x509", *curve, *names], check=True, capture_output=True)
    [port] = free_ports(1)
    text = from_manual("configuration.md", "limit_conn_zone")
    for what, instead in [
        ("listen 443 ssl", f"listen 127.0.0.1:{port} ssl"),
        ("/etc/ssl/isocortex.pem", f"{folder}/cert.pem"),
        ("/etc/ssl/isocortex-key.pem", f"{folder}/key.pem"),
        ("127.0.0.1:8640", f"127.0.0.1:{server.port}"),
    ]:
        assert what in text, f"{what} is not in the manual"
        text = text.replace(what, instead)
    paths = "".join(f"{name}_temp_path {folder}/{name};\n" for name in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
    with open(f"{folder}/nginx.conf", "w") as file:
        file.write(f"daemon off;\npid {folder}/nginx.pid;\nerror_log {folder}/error;\nevents {{}}\nhttp {{\naccess_log {folder}/access;\n{paths}{text}}}\n")
    # Its workers have another user, if it is started by root.
    os.chmod(folder, 0o755)
    with open(f"{folder}/said", "wb") as said:
        command = [f"{folder}/debian/usr/sbin/nginx", "-p", folder, "-c", f"{folder}/nginx.conf", "-e", f"{folder}/error"]
        process = subprocess.Popen(command, env=environment, stdout=said, stderr=said)
    end = time.monotonic() + 20
    while True:
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", port), 1).close()
            return process, port
        with open(f"{folder}/said") as said:
            assert time.monotonic() < end and process.poll() is None, said.read()
        time.sleep(0.1)


def guess(port, number, answers, ends):
    while not ends.is_set():
        with contextlib.suppress(OSError, http.client.HTTPException):
            answers.append(ask(port, "127.0.0.2", f"wrong-token-number-{number:04}"))


def attack(report, folder, server):
    nginx, port = start_nginx(folder, server)
    try:
        ends, answers, honest = threading.Event(), [], []
        guessers = [threading.Thread(target=guess, args=(port, number, answers, ends), daemon=True) for number in range(16)]
        for guesser in guessers:
            guesser.start()
        begun = time.monotonic()
        while time.monotonic() - begun < SECONDS:
            honest.append(ask(port, "127.0.0.9", TOKEN))
            time.sleep(0.1)
        ends.set()
        for guesser in guessers:
            guesser.join()
        allowed = answers.count(401)
        report.figure("guesses", f"{len(answers)}, of which {allowed} reached the server")
        report.expect("wrong tokens open nothing", set(answers) <= {401, 429}, sorted(set(answers)))
        # The burst, and what the rate permits.
        report.expect("no more than the limit reach the server", allowed <= 200 + 60 * (SECONDS + 2), allowed)
        report.expect("everybody else is served", set(honest) == {200}, f"{honest.count(200)} of {len(honest)}")
        report.expect("no token is in the log", "wrong-token" not in server.log() and TOKEN not in server.log())
        right = {"Authorization": f"Bearer {TOKEN}"}
        status, headers, _ = server.ask("POST", "/v1/cases", form([("volume", head())]), {"Content-Type": FORM, **right})
        assert status == 202, status
        # Its events do not end, because nobody prepares it.
        request = f"GET {headers['location']}/events HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {TOKEN}\r\n\r\n"
        trust, held, statuses = ssl._create_unverified_context(), [], []
        for _ in range(40):
            connection = socket.create_connection(("127.0.0.1", port), 10, source_address=("127.0.0.3", 0))
            held.append(trust.wrap_socket(connection))
            held[-1].sendall(request.encode())
            statuses.append(held[-1].recv(4096)[9:12])
        report.expect("one address has no more than 32 connections", statuses == [b"200"] * 32 + [b"429"] * 8, statuses.count(b"200"))
        report.expect("everybody else is still served", ask(port, "127.0.0.9", TOKEN) == 200)
        for stream in held:
            stream.close()
    finally:
        nginx.terminate()
        nginx.wait(30)


def main():
    report = Report("limits of nginx")
    if not shutil.which("openssl"):
        skip("openssl is missing")
    folder = tempfile.mkdtemp(prefix="isocortex-nginx-")
    settings = f'[http]\ntoken = "{TOKEN}"\ntrusted_proxies = ["127.0.0.1"]\n[prepare]\nworkers = 0\n'
    try:
        with Server(settings=settings) as server:
            attack(report, folder, server)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    report.end()


main()
