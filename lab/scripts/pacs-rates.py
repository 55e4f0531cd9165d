#!/usr/bin/env python3
"""Measures what a PACS meets: instances received per second by C-STORE, the CPU time of a series by STOW-RS beside the same series as a
zip file, `rendered3D` beside `render`, and a cine of 36 pictures. Server and client share this machine. Needs DCMTK's storescu.

    lab/scripts/pacs-rates.py PROGRAM FOLDER    (a folder with the files of one series of a head, and nothing else)
"""

import http.client
import io
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

BOUNDARY = "isocortex-rates-boundary"
DIMSE_PORT = 11198
SETTINGS = f"""
[limits]
maps = "off"
[pacs]
stable_seconds = {{stable_seconds}}
[pacs.dimse]
listen = "127.0.0.1:{DIMSE_PORT}"
[[pacs.dimse.peers]]
aet = "RATES"
address = "127.0.0.1"
"""
ROUNDS = 40
MUCH = 2_000_000_000
STOW = {"Content-Type": f'multipart/related; type="application/dicom"; boundary={BOUNDARY}'}
SIZE = "width=512&height=512"


class Server:
    """A server of its own, in a temporary folder."""

    def __init__(self, program, stable_seconds=3):
        self.folder = tempfile.TemporaryDirectory()
        settings = Path(self.folder.name, "isocortex.toml")
        settings.write_text(SETTINGS.format(stable_seconds=stable_seconds))
        command = [program, "serve", "--config", settings, "--data", Path(self.folder.name, "data")]
        command += ["--listen", "127.0.0.1:0", "--gpu", "off"]
        log = open(Path(self.folder.name, "log"), "wb")
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log)
        self.port = int(self.process.stdout.readline().decode().rsplit(":", 1)[1])
        self.connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=300)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(60)

    def send(self, method, path, body=None, headers=None):
        self.connection.request(method, path, body, headers or {})
        answer = self.connection.getresponse()
        text = answer.read()
        if answer.status >= 400:
            sys.exit(f"{method} {path}: {answer.status} {text[:500]}")
        return text

    def json(self, path):
        return json.loads(self.send("GET", path))

    def cpu_s(self):
        """User and system time, of the children that have ended too."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return sum(int(field) for field in fields[11:15]) / os.sysconf("SC_CLK_TCK")

    def memory_mb(self, key):
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(status.split(f"{key}:")[1].split()[0]) / 1024

    def until_ready(self):
        """Waits for the one case."""
        while True:
            cases = self.json("/v1/cases")["cases"]
            if cases and cases[0]["state"] == "ready":
                return cases[0]
            if cases and cases[0]["state"] == "failed":
                sys.exit(f"the case has failed: {cases[0]}")
            time.sleep(0.1)


def stow_body(files):
    part = f"--{BOUNDARY}\r\nContent-Type: application/dicom\r\n\r\n".encode()
    return b"".join(part + file.read_bytes() + b"\r\n" for file in files) + f"--{BOUNDARY}--\r\n".encode()


def zip_form(files):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        for file in files:
            archive.write(file, file.name)
    disposition = 'form-data; name="volume"; filename="series.zip"'
    head = f"--{BOUNDARY}\r\nContent-Disposition: {disposition}\r\nContent-Type: application/zip\r\n\r\n".encode()
    return head + packed.getvalue() + f"\r\n--{BOUNDARY}--\r\n".encode()


def receive_by_stow(program, files):
    with Server(program) as server:
        body, before = stow_body(files), server.cpu_s()
        started = time.monotonic()
        server.send("POST", "/dicomweb/studies", body, STOW)
        wall, received = time.monotonic() - started, server.cpu_s() - before
        print(f"STOW-RS: {len(files)} instances, {len(body) / 1e6:.0f} MB in {wall:.2f} s, {len(files) / wall:.0f}/s, {received:.2f} s of CPU")
        server.until_ready()
        return server.cpu_s() - before


def receive_much(program, files):
    """The series again and again in one request: what is there already is received all the same. No case is made meanwhile."""
    with Server(program, stable_seconds=600) as server:
        memory, sent = server.memory_mb("VmRSS"), 0
        part = f"--{BOUNDARY}\r\nContent-Type: application/dicom\r\n\r\n".encode()

        def parts():
            nonlocal sent
            while sent < MUCH:
                for file in files:
                    text = part + file.read_bytes() + b"\r\n"
                    sent += len(text)
                    yield text
            yield f"--{BOUNDARY}--\r\n".encode()

        started = time.monotonic()
        server.send("POST", "/dicomweb/studies", parts(), STOW)
        wall, above = time.monotonic() - started, server.memory_mb("VmHWM") - memory
        print(f"STOW-RS: one request of {sent / 1e9:.1f} GB in {wall:.0f} s, at most {above:.0f} MB above idle")


def receive_by_zip(program, files):
    with Server(program) as server:
        before = server.cpu_s()
        server.send("POST", "/v1/cases", zip_form(files), {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"})
        server.until_ready()
        return server.cpu_s() - before


def receive_by_c_store(program, folder, files):
    for associations in (1, 4):
        with Server(program) as server:
            shares = [files[at::associations] for at in range(associations)]
            command = ["storescu", "-aet", "RATES", "-aec", "ISOCORTEX", "127.0.0.1", str(DIMSE_PORT)]
            before, started = server.cpu_s(), time.monotonic()
            senders = [subprocess.Popen([*command, *share], stderr=subprocess.PIPE) for share in shares]
            for sender in senders:
                said = sender.communicate()[1]
                if sender.returncode != 0:
                    sys.exit(f"storescu has failed: {said[-500:]}")
            wall = time.monotonic() - started
            cpu = server.cpu_s() - before
            print(f"C-STORE, {associations} association(s): {len(files)} instances in {wall:.2f} s, {len(files) / wall:.0f}/s, {cpu:.2f} s of CPU")


def pictures(program, files):
    with Server(program) as server:
        server.send("POST", "/dicomweb/studies", stow_body(files), STOW)
        case = server.until_ready()["id"]
        study = server.json("/v1/arrivals")["arrivals"][0]["study"]
        # The same picture by both ways, in turn, so that noise of the machine meets both.
        ways = {
            "render": (f"/v1/cases/{case}/render?depth_mm=8&view=left&{SIZE}", {}),
            "rendered3D": (f"/dicomweb/studies/{study}/rendered3D?depth_mm=8&viewport=512,512", {"Accept": "image/png"}),
        }
        took = {way: [] for way in ways}
        for number in range(ROUNDS):
            for way, (address, headers) in ways.items():
                started = time.monotonic()
                # Each picture is another one, so that none is kept.
                address = address.replace("depth_mm=8", f"depth_mm={8 + number / 100}")
                server.send("GET", address, headers=headers)
                took[way].append(1000 * (time.monotonic() - started))
        for way, times in took.items():
            print(f"{way}: median {statistics.median(times):.1f} ms of {ROUNDS}")
        difference = statistics.median(b - a for a, b in zip(took["render"], took["rendered3D"]))
        print(f"rendered3D after render: median of the differences {difference:+.1f} ms")
        request = {"what": "cine", "render": {"depth_mm": 8, "width": 512, "height": 512}, "cine": {"frames": 36}}
        before, started = server.cpu_s(), time.monotonic()
        answer = server.send("POST", f"/v1/cases/{case}/dicom-results", json.dumps(request))
        print(f"cine of 36 pictures, 512 × 512: {time.monotonic() - started:.2f} s, {server.cpu_s() - before:.2f} s of CPU, {len(answer) / 1e6:.0f} MB")


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    program, folder = os.path.abspath(sys.argv[1]), Path(sys.argv[2])
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    print(f"{os.getloadavg()[0]:.1f} programs wanted a core in the last minute")
    receive_by_c_store(program, folder, files)
    stow, zipped = receive_by_stow(program, files), receive_by_zip(program, files)
    print(f"received and made ready: {stow:.2f} s of CPU by STOW-RS, {zipped:.2f} s as a zip file: {stow / zipped:.2f} times")
    pictures(program, files)
    receive_much(program, files)


main()
