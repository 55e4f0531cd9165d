"""Sends the audit record to another machine by Debian's rsyslog, with the configuration of docs/configuration.md.

rsyslog and a receiver by TLS run as processes of the attack's own. All lines arrive: those of a process that begins later, and of the time in which
rsyslog or the receiver was away. What has arrived is a record that `isocortex audit verify` accepts.
"""

import contextlib
import glob
import json
import os
import shutil
import socket
import ssl
import subprocess
import tempfile
import threading
import time

from attack import Report, Server, head, is_short, program, skip
from cluster import free_ports
from debian import from_manual, unpacked

EXPORTS = 15 if is_short() else 60


class Receiver:
    """Accepts syslog by TLS, with octets counted, until `end`, and keeps the text of each message."""

    def __init__(self, folder, port):
        self.lines, self.open, self.ends = [], [], False
        self.tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.tls.load_cert_chain(f"{folder}/receiver.pem", f"{folder}/receiver.key")
        self.listener = socket.create_server(("127.0.0.1", port))
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while not self.ends:
            try:
                sender, _ = self.listener.accept()
                threading.Thread(target=self.receive, args=(self.tls.wrap_socket(sender, server_side=True),), daemon=True).start()
            except OSError:
                time.sleep(0.1)

    def receive(self, sender):
        self.open.append(sender)
        try:
            with sender, sender.makefile("rb") as stream:
                while True:
                    length = b""
                    while (byte := stream.read(1)) not in (b" ", b""):
                        length += byte
                    if not length:
                        return
                    message = stream.read(int(length)).decode()
                    self.lines.append(message[message.index("{"):].rstrip("\n"))
        except OSError:
            pass

    def end(self):
        self.ends = True
        # Whoever waits for one of them is woken.
        for one in [self.listener, *self.open]:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()


def make_certificate(folder):
    for words in [
        ["req", "-x509", "-subj", "/CN=authority", "-days", "2", "-keyout", "ca.key", "-out", "ca.pem"],
        ["req", "-x509", "-subj", "/CN=localhost", "-days", "2", "-keyout", "receiver.key", "-out", "receiver.pem",
         "-addext", "subjectAltName=DNS:localhost", "-CA", "ca.pem", "-CAkey", "ca.key"],
    ]:
        curve = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]
        subprocess.run(["openssl", *words, *curve], cwd=folder, check=True, capture_output=True)


class Rsyslog:
    """rsyslog, until `end`."""

    def __init__(self, folder, environment):
        modules = glob.glob(f"{folder}/debian/usr/lib/*/rsyslog")[0]
        files = ["-f", f"{folder}/rsyslog.conf", "-i", f"{folder}/rsyslog.pid", "-M", modules]
        with open(f"{folder}/said", "ab") as said:
            self.process = subprocess.Popen(
                [f"{folder}/debian/usr/sbin/rsyslogd", "-n", *files], env=environment, stdout=said, stderr=said
            )

    def end(self):
        self.process.terminate()
        self.process.wait(30)


def recorded(audit):
    lines = []
    for name in sorted(glob.glob(f"{audit}/*.jsonl")):
        with open(name) as file:
            lines += file.read().splitlines()
    return lines


def missing(receivers, audit):
    """The lines that have not arrived after a while."""
    end = time.monotonic() + 60
    while True:
        arrived = {line for receiver in receivers for line in receiver.lines}
        left = [line for line in recorded(audit) if line not in arrived]
        if not left or time.monotonic() > end:
            return left
        time.sleep(0.2)


def attack(report, folder):
    environment = unpacked(f"{folder}/debian", "rsyslog", "rsyslog-openssl", "libestr0", "libfastjson4", "liblognorm5")
    make_certificate(folder)
    [port] = free_ports(1)
    audit = f"{folder}/audit"
    for name in ("audit", "spool"):
        os.mkdir(f"{folder}/{name}")
    text = from_manual("configuration.md", 'module(load="imfile")')
    for what, instead in [
        ("/etc/isocortex/syslog-ca.pem", f"{folder}/ca.pem"),
        ("/var/log/isocortex/", f"{audit}/"),
        ("syslog.example", "localhost"),
        ("6514", str(port)),
    ]:
        assert what in text, f"{what} is not in the manual"
        text = text.replace(what, instead)
    with open(f"{folder}/rsyslog.conf", "w") as file:
        file.write(f'global(workDirectory="{folder}/spool")\n{text}')
    receivers, rsyslog = [Receiver(folder, port)], Rsyslog(folder, environment)
    settings = f'[audit]\nfolder = "{audit}"\n'
    with Server(settings=settings) as server:
        case = server.prepared(head())

        def export():
            for _ in range(EXPORTS):
                assert server.ask("GET", f"{case}/mask")[0] == 200

        export()
        # Each process begins a file.
        server.restart()
        export()
        left = missing(receivers, audit)
        files = len(glob.glob(f"{audit}/*.jsonl"))
        report.expect("all lines of several files arrive", not left and files > 1, f"{len(recorded(audit))} lines in {files} files, {len(left)} missing")
        rsyslog.end()
        export()
        rsyslog = Rsyslog(folder, environment)
        left = missing(receivers, audit)
        report.expect("those that were written while rsyslog was away arrive", not left, f"{len(left)} missing")
        receivers[-1].end()
        export()
        receivers.append(Receiver(folder, port))
        server.stop()
    left = missing(receivers, audit)
    # What is in the buffers of a connection that is lost may be lost with it: syslog has no receipts.
    report.expect("those of the time without a receiver arrive", len(left) <= 1, f"{len(left)} missing")
    lines = set(recorded(audit))
    arrived = dict.fromkeys(line for receiver in receivers for line in receiver.lines)
    report.expect("none is cut or changed", lines.issuperset(arrived), f"{len(arrived)} lines")
    os.mkdir(f"{folder}/back")
    for line in sorted(arrived, key=lambda line: json.loads(line)["seq"]):
        with open(f"{folder}/back/{json.loads(line)['process']}-000001.jsonl", "a") as file:
            file.write(line + "\n")
    verified = subprocess.run([program(), "audit", "verify", f"{folder}/back"], capture_output=True, text=True)
    report.expect("together they are the record", verified.returncode == 0 or left, verified.stdout.splitlines()[-1:])
    rsyslog.end()


def main():
    report = Report("the audit record through rsyslog")
    if not shutil.which("openssl"):
        skip("openssl is missing")
    folder = tempfile.mkdtemp(prefix="isocortex-rsyslog-")
    try:
        attack(report, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    report.end()


main()
