"""The processes of docker/compose-cluster.yaml, without Docker: with its commands and its environment, from the secrets of docker/README.md to a picture.

All commands of that part of the README are run as they stand there, but those of Docker itself.
Names of machines become addresses of this one and /run/secrets a folder; what is mounted is read from docker/. The image is replaced by the
program and the variables of docker/Dockerfile.
"""

import gzip
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
from contextlib import ExitStack

from attack import Report, Server, head, program, skip
from with_yaml import need

need("yaml")

import yaml

from cluster import S3, Postgres, free_ports
from proxy import ROOT, Caddy

DOCKER = os.path.join(ROOT, "docker")


def text_of(name):
    with open(os.path.join(DOCKER, name)) as file:
        return file.read()


def commands_with(*words):
    """The one block of commands of docker/README.md in which all these words are."""
    blocks = re.findall(r"```sh\n(.*?)```", text_of("README.md"), re.DOTALL)
    [wanted] = [block for block in blocks if all(word in block for word in words)]
    return wanted


def make_secrets(folder):
    """Runs the commands of docker/README.md that make them."""
    os.mkdir(os.path.join(folder, "docker"))
    commands = commands_with("mkdir", "secrets/token\n") + commands_with("secrets/s3_identities.json")
    done = subprocess.run(["bash", "-c", "set -e\ndocker() { :; }\n" + commands], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return os.path.join(folder, "docker", "secrets")


def draw_a_head(report, docker, port):
    """Runs the commands of docker/README.md from a head to its picture, beside the secrets."""
    with gzip.open(os.path.join(docker, "head.nii.gz"), "wb", compresslevel=1) as file:
        file.write(head(8.0))
    commands = commands_with("volume=@head.nii.gz", "left.png").replace("127.0.0.1:8640", f"127.0.0.1:{port}")
    done = subprocess.run(["bash", "-ec", commands], cwd=docker, capture_output=True, text=True, timeout=300)
    report.expect("the events of a head end when it is ready", '"ready"' in done.stdout.rstrip().rsplit("data:", 1)[-1], done.stdout[-200:] if done.returncode else "")
    picture = os.path.join(docker, "left.png")
    content = open(picture, "rb").read() if os.path.exists(picture) else b""
    report.expect("the README leads to a picture", done.returncode == 0 and content.startswith(b"\x89PNG"), f"status {done.returncode}, {len(content)} bytes")
    return content


def variables_of_the_image():
    # Stages before the last one have variables of their own.
    *_, block = re.findall(r"^ENV (.*?[^\\])\n", text_of("Dockerfile"), re.DOTALL | re.MULTILINE)
    return dict(word.split("=", 1) for word in block.replace("\\\n", " ").split() if "=" in word)


class Processes:
    """What runs; `with Processes() as processes:` ends it."""

    def __enter__(self):
        self.running = []
        return self

    def __exit__(self, *_):
        for process in self.running:
            process.send_signal(signal.SIGTERM)
        for process in self.running:
            process.wait(60)

    def start(self, command, environment, log):
        with open(log, "ab") as file:
            self.running.append(
                subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=file, stderr=file)
            )


def main():
    report = Report("the processes of compose-cluster.yaml")
    for name in ("bash", "curl", "openssl"):
        if not shutil.which(name):
            skip(f"{name} is missing")
    compose = yaml.safe_load(text_of("compose-cluster.yaml"))
    services = compose["services"]
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="isocortex-compose-"))
        os.chmod(folder, 0o755)
        secrets = make_secrets(folder)
        of_secret = {}
        for name, secret in compose["secrets"].items():
            of_secret[f"/run/secrets/{name}"] = os.path.join(secrets, os.path.basename(secret["file"]))
        report.expect("the README makes every secret", all(map(os.path.isfile, of_secret.values())), sorted(os.listdir(secrets)))

        with open(of_secret["/run/secrets/database_password"]) as file:
            password = file.read().strip()
        postgres = stack.enter_context(Postgres())
        user = services["database"]["environment"]["POSTGRES_USER"]
        postgres.ask(f"CREATE ROLE {user} LOGIN PASSWORD '{password}'; ALTER DATABASE isocortex OWNER TO {user}")
        [database_port] = free_ports(1)
        postgres.stop()
        with open(os.path.join(postgres.data(), "pg_hba.conf"), "w") as file:
            file.write("local all postgres trust\nhost all all 127.0.0.1/32 scram-sha-256\n")
        os.environ["PGPORT"] = str(database_port)
        postgres.options = ["-c", "listen_addresses=127.0.0.1", "-c", f"port={database_port}"]
        postgres.start()

        s3 = S3()
        asked = services["objects"]["command"]
        s3.command = [of_secret_in(word, of_secret).replace("-dir=/data", "-dir=data") for word in asked]
        stack.enter_context(s3)

        def here(value):
            value = of_secret_in(value, of_secret)
            value = value.replace("@database/", f"@127.0.0.1:{database_port}/")
            return value.replace("http://objects:8333", f"http://127.0.0.1:{s3.ports['s3'][0]}")

        processes = stack.enter_context(Processes())
        ports, logs = [], []
        for name, service in services.items():
            if service.get("image") != "isocortex":
                continue
            environment = {"PATH": os.environ.get("PATH", ""), "ISOCORTEX_GPU": "off"}
            environment |= {key: here(value) for key, value in {**variables_of_the_image(), **service["environment"]}.items()}
            environment["ISOCORTEX_DATA"] = os.path.join(folder, name)
            if service["command"][0] == "serve":
                [port] = free_ports(1)
                ports.append(port)
                environment["ISOCORTEX_LISTEN"] = environment["ISOCORTEX_LISTEN"].replace("8640", str(port)).replace("0.0.0.0", "127.0.0.1")
            logs.append(os.path.join(folder, f"{name}.log"))
            if len(logs) == 1:
                made = subprocess.run([program(), "init-store"], env=environment, capture_output=True, text=True)
                report.expect("`init-store` makes the store", made.returncode == 0, made.stderr.strip())
            # Each container has the port for itself.
            command = [word.replace("0.0.0.0:8640", "127.0.0.1:0") for word in service["command"]]
            processes.start([program(), *command], environment, logs[-1])
        report.figure("processes", f"{len(logs)} of the program, {len(ports)} of them servers")
        caddy = stack.enter_context(Caddy(ports))
        client = Server.__new__(Server)
        client.port = caddy.port
        with open(of_secret["/run/secrets/token"]) as file:
            token = {"Authorization": f"Bearer {file.read().strip()}"}
        end = time.monotonic() + 60
        while client.ask("GET", "/v1/cases", headers=token)[0] != 200 and time.monotonic() < end:
            time.sleep(0.2)
        report.expect("without the token nothing is shown", client.ask("GET", "/v1/cases")[0] == 401)
        status, headers, _ = client.ask("GET", "/")
        report.expect("the page is there", status == 200 and "text/html" in headers.get("content-type", ""), status)
        draw_a_head(report, os.path.dirname(secrets), caddy.port)
        secret_words = [token["Authorization"].split()[1], password]
        shown = [log for log in logs if any(word in open(log).read() for word in secret_words)]
        report.expect("no log has a secret", not shown, shown)
        if report.failed:
            for log in logs:
                print(open(log).read()[-600:])
    report.end()


def of_secret_in(value, of_secret):
    """A value with the paths of secrets replaced; the longest first."""
    for path in sorted(of_secret, key=len, reverse=True):
        value = value.replace(path, of_secret[path])
    return value


main()
