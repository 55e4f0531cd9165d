"""What every attack shares: a server to attack, uploads, measurements and a verdict.

The Python standard library alone. The server is the program named by ISOCORTEX_BINARY. It listens on a free port of
127.0.0.1, works in a temporary folder, and ends with the attack.
"""

import gzip
import http.client
import io
import json
import math
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zipfile

BOUNDARY = "isocortex-fault-boundary"
FORM = f"multipart/form-data; boundary={BOUNDARY}"


def program():
    """The program to attack."""
    path = os.environ.get("ISOCORTEX_BINARY")
    if not path:
        sys.exit("set ISOCORTEX_BINARY to the program to attack, such as target/debug/isocortex")
    return os.path.abspath(path)


def is_short():
    """Whether to run for seconds, as the integration tests do, instead of minutes."""
    return "--short" in sys.argv[1:]


class Report:
    """What an attack measures, and what it expects. `end` exits with 1 if an expectation was not met."""

    def __init__(self, title):
        self.failed = 0
        print(f"== {title}", flush=True)

    def figure(self, what, value):
        print(f"   {what}: {value}", flush=True)

    def expect(self, what, met, seen=""):
        self.failed += not met
        note = f" ({seen})" if seen != "" else ""
        print(f"   {'ok    ' if met else 'BROKEN'} {what}{note}", flush=True)

    def target(self, name, asked, measured, met, binds=True):
        """A figure beside its target: a row of the table that ISOCORTEX_FAULTS_TABLE names and, if it binds, an expectation."""
        if binds:
            self.expect(f"{name}: {asked}", met, measured)
        else:
            self.figure(f"{name}: {asked}", f"{measured}{'' if met else ': missed'}")
        table = os.environ.get("ISOCORTEX_FAULTS_TABLE")
        if table:
            command = " ".join([f"tests/faults/{os.path.basename(sys.argv[0])}", *sys.argv[1:]])
            with open(table, "a") as file:
                file.write(f"| {name} | {asked} | {measured}{'' if met else ' **(missed)**'} | `{command}` |\n")

    def end(self):
        print(f"== {'as it should be' if not self.failed else f'{self.failed} broken'}", flush=True)
        sys.exit(1 if self.failed else 0)


def skip(why):
    """Ends an attack that this machine does not allow."""
    print(f"   SKIPPED: {why}", flush=True)
    sys.exit(77)


# As the unit and the image set it.
ALLOCATOR = {"MALLOC_ARENA_MAX": "2", "MALLOC_MMAP_THRESHOLD_": "1048576", "MALLOC_TRIM_THRESHOLD_": "1048576"}


class Server:
    """A server of its own for an attack. `with Server() as server:` ends it."""

    def __init__(self, data=None, environment=None, arguments=(), settings="", before=()):
        """`settings` is the text of a configuration file; `before` are words before the command, such as strace's."""
        self.folder = tempfile.mkdtemp(prefix="isocortex-fault-")
        self.before = list(before)
        self.settings = os.path.join(self.folder, "isocortex.toml")
        with open(self.settings, "w") as file:
            file.write(settings)
        self.data = data or os.path.join(self.folder, "data")
        self.environment = environment or {}
        self.arguments = list(arguments)
        self.log_file = os.path.join(self.folder, "log")
        self.process = None
        self.port = None
        self.program = program
        self.listen = "127.0.0.1:0"

    def __enter__(self):
        try:
            self.start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        self.stop(signal.SIGKILL)
        shutil.rmtree(self.folder, ignore_errors=True)

    def start(self):
        command = [*self.before, self.program(), "serve", "--config", self.settings, "--data", self.data]
        command += ["--listen", self.listen, "--gpu", "off"]
        environment = {"PATH": os.environ.get("PATH", ""), "ISOCORTEX_LOG": "debug", "ISOCORTEX_CREATE": "true", **ALLOCATOR, **self.environment}
        with open(self.log_file, "ab") as log:
            self.process = subprocess.Popen(
                command + self.arguments, env=environment, stdout=subprocess.PIPE, stderr=log
            )
        line = self.process.stdout.readline().decode()
        if "http://" not in line:
            raise RuntimeError(f"the server does not start: {self.log()[-2000:]}")
        self.port = int(line.rsplit(":", 1)[1])
        # Nothing but the first line is read: the pipe must not fill.
        threading.Thread(target=self.process.stdout.read, daemon=True).start()

    def stop(self, with_signal=signal.SIGTERM):
        if self.process and self.process.poll() is None:
            self.process.send_signal(with_signal)
            self.process.wait(60)

    def restart(self):
        self.stop()
        self.start()

    def check(self, *arguments):
        """The status of `isocortex check-store` on the store of a server in one folder, and what it says."""
        command = [program(), "check-store", "--data", self.data, *arguments]
        environment = {"PATH": os.environ.get("PATH", ""), **self.environment}
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        return done.returncode, done.stdout + done.stderr

    def json(self, address):
        """The JSON of an answer; `None` if it is not 200."""
        status, _, body = self.ask("GET", address)
        return json.loads(body) if status == 200 else None

    def log(self):
        with open(self.log_file, "rb") as log:
            return log.read().decode(errors="replace")

    def ask(self, method, address, body=None, headers=None, timeout=60, source=None):
        """Status, headers and body of an answer; status 0 if none comes."""
        connection = http.client.HTTPConnection(
            "127.0.0.1", self.port, timeout=timeout, source_address=source and (source, 0)
        )
        try:
            connection.request(method, address, body, headers or {})
            answer = connection.getresponse()
            return answer.status, dict((k.lower(), v) for k, v in answer.getheaders()), answer.read()
        except (OSError, http.client.HTTPException) as error:
            return 0, {}, str(error).encode()
        finally:
            connection.close()

    def upload(self, volume, timeout=120, source=None, **others):
        parts = {"volume": volume, **others}
        return self.ask("POST", "/v1/cases", form(parts.items()), {"Content-Type": FORM}, timeout, source)

    def until_settled(self, address, timeout=120):
        """A case's JSON once it is ready or failed; the last one seen if that takes too long."""
        end, case = time.monotonic() + timeout, {}
        while time.monotonic() < end:
            status, _, body = self.ask("GET", address)
            if status == 200:
                case = json.loads(body)
                if case["state"] in ("ready", "failed"):
                    break
            time.sleep(0.05)
        return case

    def prepared(self, volume, **others):
        """The address of a case that is ready."""
        status, headers, body = self.upload(volume, **others)
        assert status in (200, 202), (status, body)
        case = self.until_settled(headers["location"])
        assert case.get("state") == "ready", case
        return headers["location"]


def form(parts):
    """A multipart form of (name, bytes) pairs."""
    body = io.BytesIO()
    for name, content in parts:
        head = f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="{name}"; filename="f"\r\n\r\n'
        body.write(head.encode() + content + b"\r\n")
    body.write(f"--{BOUNDARY}--\r\n".encode())
    return body.getvalue()


def nifti_header(size, spacing_mm, datatype=4, bits=16, description=b""):
    """The header of a NIfTI-1 file, 352 bytes."""
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, *size, 1, 1, 1, 1)
    struct.pack_into("<hh", header, 70, datatype, bits)
    struct.pack_into("<8f", header, 76, 1, *spacing_mm, 0, 0, 0, 0)
    struct.pack_into("<f", header, 108, 352)
    header[123] = 2
    header[148 : 148 + len(description)] = description
    struct.pack_into("<hh", header, 252, 0, 1)
    for row in range(3):
        values = [0.0] * 4
        values[row] = spacing_mm[row]
        values[3] = -spacing_mm[row] * (size[row] - 1) / 2
        struct.pack_into("<4f", header, 280 + 16 * row, *values)
    header[344:348] = b"n+1\0"
    return bytes(header)


def head(spacing_mm=4.0, seed=0, description=b"", scale=1.0):
    """A brain over zeros, as plain NIfTI. Another `seed` is another head, another `scale` a larger or smaller one."""
    side = round(180 / spacing_mm)
    middle = (side - 1) / 2
    voxels = []
    for z in range(side):
        for y in range(side):
            for x in range(side):
                mm = [(v - middle) * spacing_mm for v in (x, y, z)]
                inside = sum((m / a / scale) ** 2 for m, a in zip(mm, (60, 76, 54))) <= 1
                value = 300 + 60 * math.sin(mm[1] / 15 + seed) + 40 * math.cos(mm[2] / 11)
                voxels.append(int(value) if inside else 0)
    return nifti_header([side] * 3, [spacing_mm] * 3, description=description) + struct.pack(
        f"<{len(voxels)}h", *voxels
    )


def gzip_of_zeros(header, count):
    """A gzip of a header and so many zero bytes, made in pieces."""
    out = io.BytesIO()
    with gzip.GzipFile(fileobj=out, mode="wb", compresslevel=9) as packed:
        packed.write(header)
        block = bytes(1 << 20)
        for _ in range(count >> 20):
            packed.write(block)
        packed.write(bytes(count & ((1 << 20) - 1)))
    return out.getvalue()


def zip_of(files):
    """A zip of (name, bytes) pairs."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in files:
            packed.writestr(name, content)
    return out.getvalue()


def memory_mb(pid):
    """Resident memory of a process and its children, in MB."""
    total = 0
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                with open(f"/proc/{entry}/stat") as stat:
                    parent = int(stat.read().rsplit(")", 1)[1].split()[1])
                if int(entry) == pid or parent == pid:
                    with open(f"/proc/{entry}/statm") as statm:
                        total += int(statm.read().split()[1]) * 4096
            except OSError:
                pass
    return total / 1e6


def cpu_seconds(pids):
    """The CPU time that processes and their ended children have used, which other load on the machine changes little. A process that has ended
    counts as none."""
    ticks = 0
    for pid in pids:
        try:
            with open(f"/proc/{pid}/stat") as stat:
                ticks += sum(int(word) for word in stat.read().rsplit(")", 1)[1].split()[11:15])
        except FileNotFoundError:
            pass
    return ticks / os.sysconf("SC_CLK_TCK")


class Watch:
    """Watches a server meanwhile: the most memory, and how its health checks fare."""

    def __init__(self, server, health_every_s=0.25, source=None):
        self.server, self.every_s, self.source = server, health_every_s, source
        self.start_mb = self.most_mb = memory_mb(server.process.pid)
        self.checks, self.failed, self.slowest_s = 0, 0, 0.0
        self.running = True
        self.threads = [threading.Thread(target=job, daemon=True) for job in (self._memory, self._health)]

    def __enter__(self):
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *_):
        self.running = False
        for thread in self.threads:
            thread.join()

    def _memory(self):
        while self.running:
            self.most_mb = max(self.most_mb, memory_mb(self.server.process.pid))
            time.sleep(0.02)

    def _health(self):
        while self.running:
            started = time.monotonic()
            status, _, _ = self.server.ask("GET", "/healthz", timeout=3, source=self.source)
            took = time.monotonic() - started
            self.checks += 1
            self.failed += status != 200
            self.slowest_s = max(self.slowest_s, took)
            time.sleep(self.every_s)

    def grown_mb(self):
        return self.most_mb - self.start_mb

    def tell(self, report):
        report.figure("memory", f"{self.start_mb:.0f} MB at the start, {self.most_mb:.0f} MB at most")
        report.figure(
            "health checks", f"{self.checks} asked, {self.failed} failed, slowest {self.slowest_s:.2f} s"
        )
