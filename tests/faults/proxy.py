"""Caddy with the configuration of docker/, in front of servers of an attack's own."""

import http.client
import os
import shutil
import subprocess
import tempfile
import time

from attack import skip
from cluster import free_ports

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")


class Caddy:
    """`with Caddy(ports) as caddy:` ends it. It listens on `port`. The program is `caddy`, or named by ISOCORTEX_CADDY."""

    def __init__(self, ports):
        self.ports = ports
        [self.port] = free_ports(1)

    def __enter__(self):
        beside = os.path.join(ROOT, "demo-data", "caddy", "caddy")
        found = os.environ.get("ISOCORTEX_CADDY") or shutil.which("caddy") or (os.path.exists(beside) and beside)
        if not found:
            skip("there is no Caddy: run scripts/caddy.sh")
        with open(os.path.join(ROOT, "docker", "Caddyfile")) as file:
            settings = file.read()
        for what, instead in [
            ("server-1:8640 server-2:8640", " ".join(f"127.0.0.1:{port}" for port in self.ports)),
            ("\n:8640 {", f"\nhttp://127.0.0.1:{self.port} {{"),
        ]:
            assert what in settings, f"docker/Caddyfile has no {what!r}"
            settings = settings.replace(what, instead)
        self.folder = tempfile.mkdtemp(prefix="isocortex-caddy-")
        with open(os.path.join(self.folder, "Caddyfile"), "w") as file:
            file.write(settings)
        environment = {"PATH": os.environ.get("PATH", ""), "HOME": self.folder, "XDG_DATA_HOME": self.folder}
        with open(os.path.join(self.folder, "log"), "wb") as log:
            self.process = subprocess.Popen(
                [os.path.abspath(found), "run", "--config", "Caddyfile", "--adapter", "caddyfile"],
                cwd=self.folder, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
            )
        end = time.monotonic() + 30
        while True:
            try:
                connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=5)
                connection.request("GET", "/readyz")
                if connection.getresponse().status == 200:
                    return self
            except OSError:
                pass
            with open(os.path.join(self.folder, "log")) as log:
                assert time.monotonic() < end and self.process.poll() is None, log.read()[-2000:]
            time.sleep(0.1)

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(30)
        shutil.rmtree(self.folder, ignore_errors=True)
