"""A PostgreSQL of an attack's own, and processes of the program that share a store in it.

PostgreSQL's programs are Debian's, or in the folder that ISOCORTEX_POSTGRES names. Objects are in a folder that all share.
"""

import contextlib
import glob
import http.client
import json
import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time

from attack import Server, program, skip


class Postgres:
    """`with Postgres() as postgres:` ends it. Its files are in `folder`, or in a temporary one."""

    def __init__(self, folder=None):
        self.at = folder
        self.process = None
        self.options = ["-c", "listen_addresses="]
        self.log_file = tempfile.mkstemp(prefix="isocortex-postgres-log-")[1]

    def __enter__(self):
        return self.start()

    def start(self):
        """Starts it, and makes its database if there is none."""
        if self.process:
            self._run_server()
            self._until_ready()
            return self
        folders = [os.environ.get("ISOCORTEX_POSTGRES", "")] + sorted(
            glob.glob("/usr/lib/postgresql/*/bin"), reverse=True
        )
        self.programs = next((f for f in folders if os.path.exists(os.path.join(f, "initdb"))), None)
        if not self.programs:
            skip("there is no PostgreSQL (Debian: postgresql)")
        if self.at:
            os.makedirs(self.at)
        self.folder = self.at or tempfile.mkdtemp(prefix="isocortex-postgres-")
        self.user = {}
        if os.geteuid() == 0:
            # PostgreSQL refuses to run as root.
            somebody = pwd.getpwnam("postgres")
            self.user = {"user": somebody.pw_uid, "group": somebody.pw_gid, "extra_groups": []}
            os.chown(self.folder, somebody.pw_uid, somebody.pw_gid)
        # What an attack puts on a disk of its own must survive there.
        syncing = [] if self.at else ["-N"]
        self._run("initdb", "--auth=trust", "--username=postgres", *syncing, "-D", self.data())
        self._run_server()
        self._until_ready()
        self._run("createdb", "-h", self.folder, "-U", "postgres", "isocortex")
        return self

    def _run_server(self):
        with open(self.log_file, "ab") as log:
            self.process = subprocess.Popen(
                [os.path.join(self.programs, "postgres"), "-D", self.data(), "-k", self.folder]
                + ["-c", "logging_collector=off", *self.options],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, cwd="/", **self.user,
            )

    def _until_ready(self):
        end = time.monotonic() + 60
        while True:
            try:
                self._run("psql", "-h", self.folder, "-U", "postgres", "-c", "SELECT 1", "postgres")
                return
            except subprocess.CalledProcessError:
                if time.monotonic() > end or self.process.poll() is not None:
                    with open(self.log_file) as log:
                        raise RuntimeError(f"PostgreSQL does not start: {log.read()[-2000:]}") from None
                time.sleep(0.1)

    def stop(self, with_signal=signal.SIGQUIT):
        """Ends it at once. After SIGKILL its own processes may take a moment to notice."""
        if self.process.poll() is None:
            children = _children(self.process.pid) if with_signal == signal.SIGKILL else []
            for pid in [self.process.pid, *children]:
                # On a disk that is gone, any of them may have ended by itself.
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, with_signal)
            self.process.wait(60)
            for pid in children:
                while _is_running(pid):
                    time.sleep(0.02)

    def __exit__(self, *_):
        self.stop()
        shutil.rmtree(self.folder, ignore_errors=True)
        os.remove(self.log_file)

    def data(self):
        return os.path.join(self.folder, "data")

    def pids(self):
        """Its processes, of which each connection has one."""
        return [self.process.pid, *_children(self.process.pid)]

    def address(self):
        return f"postgres://postgres@{self.folder.replace('/', '%2F')}/isocortex"

    def ask(self, sql):
        """The rows of an answer, each a list of texts."""
        told = self._run("psql", "-h", self.folder, "-U", "postgres", "-At", "-F", "|", "-c", sql, "isocortex")
        return [line.split("|") for line in told.decode().splitlines()]

    def _run(self, name, *arguments):
        command = [os.path.join(self.programs, name), *arguments]
        done = subprocess.run(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd="/", check=True, **self.user
        )
        return done.stdout


def _is_running(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return stat.read().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def _children(pid):
    """The processes that a process has started."""
    found = []
    for entry in os.listdir("/proc"):
        try:
            with open(f"/proc/{entry}/stat") as stat:
                if entry.isdigit() and int(stat.read().rsplit(")", 1)[1].split()[1]) == pid:
                    found.append(int(entry))
        except OSError:
            pass
    return found


class S3:
    """A SeaweedFS of an attack's own. `with S3() as s3:` ends it. The program is `weed`, or named by ISOCORTEX_WEED."""

    BUCKET = "isocortex"

    def __init__(self):
        self.command = ["server", "-dir=data", "-s3", "-s3.config=s3.json", "-master.telemetry=false"]

    def __enter__(self):
        beside = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "demo-data", "seaweedfs", "weed")
        found = os.environ.get("ISOCORTEX_WEED") or shutil.which("weed") or (os.path.exists(beside) and beside)
        if not found:
            skip("there is no SeaweedFS: run scripts/weed.sh")
        self.program = os.path.abspath(found)
        self.folder = tempfile.mkdtemp(prefix="isocortex-weed-")
        os.mkdir(os.path.join(self.folder, "data"))
        with open(os.path.join(self.folder, "s3.json"), "w") as file:
            json.dump({"identities": [{
                "name": "app", "credentials": [{"accessKey": "AK", "secretKey": "SKSKSKSK"}],
                "actions": ["Admin", "Read", "Write", "List", "Tagging"],
            }]}, file)
        with open(os.path.join(self.folder, "credentials"), "w") as file:
            file.write("[default]\naws_access_key_id = AK\naws_secret_access_key = SKSKSKSK\n")
        parts = ["s3", "master", "volume", "filer"]
        ports = free_ports(2 * len(parts))
        self.ports = {part: (ports[2 * at], ports[2 * at + 1]) for at, part in enumerate(parts)}
        self.start()
        return self

    def __exit__(self, *_):
        self.stop()
        shutil.rmtree(self.folder, ignore_errors=True)
        for grpc in [grpc for _, grpc in self.ports.values()]:
            for left in glob.glob(f"/tmp/seaweedfs-*-{grpc}.sock"):
                os.remove(left)

    def start(self):
        command = [self.program, *self.command, "-ip=127.0.0.1", "-ip.bind=127.0.0.1"]
        command += ["-master.volumeSizeLimitMB=64", "-volume.max=200"]
        command += ["-s3.port.iceberg=0", "-s3.port.lance=0", "-filer.localSocket=filer.sock", "-s3.localSocket=s3.sock"]
        for part, (port, grpc) in self.ports.items():
            command += [f"-{part}.port={port}", f"-{part}.port.grpc={grpc}"]
        self.process = subprocess.Popen(
            command, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        end = time.monotonic() + 120
        while not self._makes_bucket():
            assert time.monotonic() < end and self.process.poll() is None, "SeaweedFS does not start"
            time.sleep(0.2)

    def _makes_bucket(self):
        try:
            # The address for S3 opens last; a bucket is a folder of the filer.
            http.client.HTTPConnection("127.0.0.1", self.ports["s3"][0], timeout=2).connect()
            for method in ("GET", "POST"):
                filer = http.client.HTTPConnection("127.0.0.1", self.ports["filer"][0], timeout=5)
                filer.request(method, f"/buckets/{self.BUCKET}/", headers={"Accept": "application/json"})
                if filer.getresponse().status // 100 == 2:
                    return True
            return False
        except OSError:
            return False

    def stop(self):
        """Ends it at once, as a fault would."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait(60)

    def environment(self, prefix):
        """The variables of a process that keeps its objects there."""
        return {
            "ISOCORTEX_OBJECTS": f"s3://{self.BUCKET}/{prefix}",
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.ports['s3'][0]}",
            "AWS_SHARED_CREDENTIALS_FILE": f"{self.folder}/credentials",
        }


def free_ports(count):
    """Ports that were free a moment ago."""
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


class Shared:
    """A store in a PostgreSQL of its own and a folder, for a server. `with Shared() as store:` ends it."""

    def __enter__(self):
        self.folder = tempfile.mkdtemp(prefix="isocortex-shared-")
        self.postgres = Postgres().start()
        self.objects = os.path.join(self.folder, "objects")
        self.environment = {
            "ISOCORTEX_DATABASE": self.postgres.address(),
            "ISOCORTEX_OBJECTS": f"file://{self.objects}",
        }
        return self

    def __exit__(self, *_):
        self.postgres.__exit__()
        shutil.rmtree(self.folder, ignore_errors=True)


def files_below(folder):
    """Every file below a folder, as paths from there."""
    return sorted(
        os.path.relpath(os.path.join(where, name), folder) for where, _, names in os.walk(folder) for name in names
    )


class Cluster:
    """Servers without workers, and workers, on one store. `with Cluster(postgres) as cluster:` ends them."""

    def __init__(self, postgres):
        self.folder = tempfile.mkdtemp(prefix="isocortex-cluster-")
        self.environment = {
            "ISOCORTEX_DATABASE": postgres.address(),
            "ISOCORTEX_OBJECTS": f"file://{self.folder}/objects",
            "ISOCORTEX_LOG": "info",
        }
        self.workers = []
        self.begun = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for worker in list(self.workers):
            self.kill(worker)
        shutil.rmtree(self.folder, ignore_errors=True)

    def server(self):
        """A server, not started: `with cluster.server() as server:` does."""
        return Server(environment=self.environment, arguments=["--workers", "0"])

    def start_worker(self, settings=""):
        self.begun += 1
        folder = os.path.join(self.folder, f"worker-{self.begun}")
        environment = {**self.environment, "PATH": os.environ.get("PATH", ""), "ISOCORTEX_DATA": folder, "ISOCORTEX_CREATE": "true"}
        if settings:
            environment["ISOCORTEX_CONFIG"] = f"{folder}.toml"
            with open(environment["ISOCORTEX_CONFIG"], "w") as file:
                file.write(settings)
        worker = subprocess.Popen(
            [program(), "work", "--workers", "1"],
            env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        self.workers.append(worker)
        return worker

    def kill(self, worker):
        """Ends a worker as a loss of power would."""
        worker.kill()
        worker.wait(60)
        self.workers.remove(worker)

    def check(self):
        """What `isocortex check-store` says of the store, and its status."""
        environment = {**self.environment, "PATH": os.environ.get("PATH", "")}
        environment["ISOCORTEX_DATA"] = os.path.join(self.folder, "check")
        done = subprocess.run([program(), "check-store"], env=environment, capture_output=True, text=True)
        return done.returncode, done.stdout + done.stderr
