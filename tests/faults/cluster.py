"""A PostgreSQL of an attack's own, and processes of the program that share a store in it.

PostgreSQL's programs are Debian's, or in the folder that ISOCORTEX_POSTGRES names. Objects are in a folder that all share.
"""

import glob
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time

from attack import Server, program, skip


class Postgres:
    """`with Postgres() as postgres:` ends it."""

    def __enter__(self):
        folders = [os.environ.get("ISOCORTEX_POSTGRES", "")] + sorted(
            glob.glob("/usr/lib/postgresql/*/bin"), reverse=True
        )
        self.programs = next((f for f in folders if os.path.exists(os.path.join(f, "initdb"))), None)
        if not self.programs:
            skip("there is no PostgreSQL (Debian: postgresql)")
        self.folder = tempfile.mkdtemp(prefix="isocortex-postgres-")
        self.user = {}
        if os.geteuid() == 0:
            # PostgreSQL refuses to run as root.
            somebody = pwd.getpwnam("postgres")
            self.user = {"user": somebody.pw_uid, "group": somebody.pw_gid, "extra_groups": []}
            os.chown(self.folder, somebody.pw_uid, somebody.pw_gid)
        self._run("initdb", "--auth=trust", "--username=postgres", "-N", "-D", self.data())
        self.process = subprocess.Popen(
            [os.path.join(self.programs, "postgres"), "-D", self.data(), "-k", self.folder]
            + ["-c", "listen_addresses=", "-c", "logging_collector=off"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd="/", **self.user,
        )
        while True:
            try:
                self._run("createdb", "-h", self.folder, "-U", "postgres", "isocortex")
                return self
            except subprocess.CalledProcessError:
                time.sleep(0.1)

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGQUIT)
        self.process.wait(60)
        shutil.rmtree(self.folder, ignore_errors=True)

    def data(self):
        return os.path.join(self.folder, "data")

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
        for worker in self.workers:
            self.kill(worker)
        shutil.rmtree(self.folder, ignore_errors=True)

    def server(self):
        """A server, not started: `with cluster.server() as server:` does."""
        return Server(environment=self.environment, arguments=["--workers", "0"])

    def start_worker(self):
        self.begun += 1
        folder = os.path.join(self.folder, f"worker-{self.begun}")
        environment = {**self.environment, "PATH": os.environ.get("PATH", ""), "ISOCORTEX_DATA": folder}
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
