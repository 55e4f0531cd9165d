"""The image of docker/Dockerfile, built by buildah without Docker and without a registry, and run as its user on a read-only root.

The images that it begins with are replaced by stand-ins of the same names (stand_ins.py): Debian by debootstrap, and this machine's Rust, Node and
Python. It is built twice from the same sources, which must give the same image. By default it compiles with little optimisation, and the second time
only what is not there. `--release` compiles as the Dockerfile does, both times from nothing; `--short` does not compile: it puts the program of
ISOCORTEX_BINARY into the image. `--archive FOLDER` takes what `make dist` made, with PROGRAM=archive, and writes pictures of the sample head into the
folder (scripts/dist-test.sh). What is made stays in target/image; remove that folder to begin again.

The program runs in namespaces of its own for processes, mounts and network: with the image's user, variables and command, without capabilities, and
with nothing to write to but /data and /tmp, as docker/compose.yaml asks.
"""

import argparse
import fcntl
import json
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time

from attack import FORM, Report, Server, form, head, program
from proxy import ROOT
from stand_ins import Buildah, is_possible, make_debian, make_toolchains, run, say

IMAGE = "localhost/isocortex"
TOKEN = "t" * 64
QUICK = {
    "CARGO_PROFILE_RELEASE_OPT_LEVEL": "1",
    "CARGO_PROFILE_RELEASE_LTO": "off",
    "CARGO_PROFILE_RELEASE_CODEGEN_UNITS": "16",
}


def dockerfile(folder, archive):
    """docker/Dockerfile as this buildah can read it: Debian's 1.28 does not know --start-interval."""
    with open(os.path.join(ROOT, "docker/Dockerfile")) as file:
        text = file.read()
    version = re.search(r"(\d+)\.(\d+)", run("buildah", "--version"))
    if tuple(map(int, version.groups())) < (1, 33):
        text = text.replace(" --start-interval=1s", "")
        # It builds all stages and follows no variable to a stage.
        unused = r"FROM .*(?=FROM \S+ AS archive\n)" if archive else r"FROM \S+ AS archive\n.*?\n\n"
        text = re.sub(unused, "", text, count=1, flags=re.DOTALL).replace("FROM ${PROGRAM} AS", f"FROM {'archive' if archive else 'source'} AS")
    adapted = os.path.join(folder, "Dockerfile")
    with open(adapted, "w") as file:
        file.write(text)
    return adapted


def build(buildah, turn, keeps_compiled, archive):
    """Builds the image; the digests of its layers, and its configuration."""
    compiled = os.path.join(buildah.environment["TMPDIR"], "buildah-cache")
    if not keeps_compiled:
        for cache in [compiled, f"{compiled}-0"]:
            shutil.rmtree(cache, ignore_errors=True)
    begun = time.monotonic()
    buildah(
        "bud", "--pull-never", "--isolation", "chroot", "--timestamp", "0", "--no-cache", "--format", "docker",
        "--ignorefile", os.path.join(ROOT, "docker/Dockerfile.dockerignore"), "-f", dockerfile(buildah.folder, archive),
        "--build-arg", f"PROGRAM={'archive' if archive else 'source'}", "-t", f"{IMAGE}:{turn}", ROOT,
    )
    say(f"built in {time.monotonic() - begun:.0f} s")
    image = json.loads(buildah("inspect", "--type", "image", f"{IMAGE}:{turn}"))["Docker"]
    # In Docker's format, buildah notes the name of its container, which is random.
    del image["config"]["Hostname"]
    return image["rootfs"]["diff_ids"], image["config"]


def differences(buildah, turns):
    """The first files in which two images differ, for a report."""
    containers = [buildah("from", "--pull-never", f"{IMAGE}:{turn}") for turn in turns]
    try:
        folders = [buildah("mount", container) for container in containers]
        found = subprocess.run(
            ["diff", "-rq", "--no-dereference", *folders], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        return found.stdout.decode().splitlines()[:20]
    finally:
        for container in containers:
            buildah("rm", container)


def main():
    options = argparse.ArgumentParser()
    options.add_argument("--release", action="store_true")
    options.add_argument("--short", action="store_true")
    options.add_argument("--archive", metavar="FOLDER")
    options.add_argument("--folder", default=os.path.join(ROOT, "target/image"))
    options.add_argument("--inside", help=argparse.SUPPRESS)
    asked = options.parse_args()
    if asked.inside:
        return inside(asked.inside)
    report = Report("the image of docker/Dockerfile, built and run")
    is_possible(*([] if asked.archive else ["rustc", "node", "npm"]))
    buildah = Buildah(os.path.abspath(asked.folder))
    make_debian(buildah)
    if not asked.archive:
        make_toolchains(buildah, program() if asked.short else None, None if asked.release else QUICK)
    turns = ["first", "second"]
    (layers, config), (layers_again, config_again) = [build(buildah, turn, not asked.release, asked.archive) for turn in turns]
    last = [of[-1][:19] for of in (layers, layers_again)]
    report.expect("two builds of the same sources have the same layers", layers == layers_again, " ".join(last))
    if layers != layers_again:
        report.figure("files that differ", differences(buildah, turns))
    report.expect("and the same configuration", config == config_again)
    health = config.get("Healthcheck", {}).get("Test")
    report.expect("its user is not root", config["User"] == "10001:10001", config["User"])
    report.expect("it has a health check", health == ["CMD", "isocortex-healthcheck"], health)
    container = buildah("from", "--pull-never", f"{IMAGE}:second")
    try:
        files = buildah("mount", container)
        size = run("du", "-sm", files).split()[0]
        report.figure("size", f"{size} MB")
        with open(f"{files}/etc/shadow") as file:
            [fields] = [line.split(":") for line in file if line.startswith("isocortex:")]
        # Otherwise images that are built on different days differ.
        report.expect("its user has no date", fields[2] == "", fields[2])
        report.expect("no source is in it", not os.path.exists(f"{files}/source") and not os.path.exists(f"{files}/out"))
        with tempfile.TemporaryDirectory(prefix="isocortex-image-") as folder:
            with open(f"{folder}/run.json", "w") as file:
                json.dump({"files": files, "config": config, "pictures": asked.archive and os.path.abspath(asked.archive)}, file)
            shell = ["unshare", "--net", "--mount", "--pid", "--fork", "--kill-child"]
            done = subprocess.run([*shell, sys.executable, __file__, "--inside", folder], stdin=subprocess.DEVNULL)
        report.failed += done.returncode != 0
    finally:
        buildah("rm", container)
    report.end()


# What follows runs in namespaces of its own.


def bring_up_loopback():
    SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 1
    with socket.socket() as one:
        request = struct.pack("16sh14x", b"lo", 0)
        flags = struct.unpack("16sh14x", fcntl.ioctl(one, SIOCGIFFLAGS, request))[1]
        fcntl.ioctl(one, SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", flags | IFF_UP))


def read_only_root(folder, files):
    """A folder with the image's files, read-only, and what docker/compose.yaml lays over them."""
    root, data = f"{folder}/root", f"{folder}/data"
    os.mkdir(root)
    # A volume begins as what the image has at its place.
    shutil.copytree(f"{files}/data", data)
    owner = os.stat(f"{files}/data")
    os.chown(data, owner.st_uid, owner.st_gid)
    os.chmod(data, owner.st_mode & 0o7777)
    run("mount", "--make-rprivate", "/")
    run("mount", "--bind", files, root)
    run("mount", "-o", "remount,bind,ro", root)
    run("mount", "-t", "proc", "proc", f"{root}/proc")
    run("mount", "-t", "tmpfs", "-o", "mode=1777,size=64m", "tmp", f"{root}/tmp")
    run("mount", "-t", "tmpfs", "-o", "mode=755", "dev", f"{root}/dev")
    for name in ("null", "zero", "urandom", "random"):
        open(f"{root}/dev/{name}", "w").close()
        run("mount", "--bind", f"/dev/{name}", f"{root}/dev/{name}")
    os.symlink("/proc/self/fd", f"{root}/dev/fd")
    run("mount", "-t", "tmpfs", "-o", "mode=755", "run", f"{root}/run")
    # As Compose mounts a secret: read-only, from a file with another owner that all may read.
    os.mkdir(f"{root}/run/secrets")
    place, secret = f"{root}/run/secrets/token", f"{folder}/token"
    with open(secret, "w") as file:
        file.write(TOKEN)
    os.chmod(secret, 0o444)
    open(place, "w").close()
    run("mount", "--bind", secret, place)
    run("mount", "-o", "remount,bind,ro", place)
    run("mount", "--bind", data, f"{root}/data")
    return root


def inside(folder):
    report = Report("the image as a container")
    with open(f"{folder}/run.json") as file:
        image = json.load(file)
    config = image["config"]
    bring_up_loopback()
    root = read_only_root(folder, image["files"])
    uid, gid = config["User"].split(":")
    # As `user`, `cap_drop: [ALL]` and `no-new-privileges` do.
    user = ["chroot", root, "setpriv", f"--reuid={uid}", f"--regid={gid}", "--clear-groups", "--no-new-privs"]
    user += ["--bounding-set=-all", "--inh-caps=-all", "--"]
    environment = dict(variable.split("=", 1) for variable in config["Env"])
    environment["ISOCORTEX_TOKEN_FILE"] = "/run/secrets/token"

    def as_user(*command):
        return subprocess.run([*user, *command], env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True)

    for place in ("/", "/usr/bin", "/etc", "/run", "/var/tmp"):
        report.expect(f"it cannot write to {place}", as_user("touch", f"{place}/probe").returncode != 0)
    for place in ("/data", "/tmp"):
        report.expect(f"it can write to {place}", as_user("sh", "-c", f"touch {place}/probe && rm {place}/probe").returncode == 0)
    report.expect("the health check fails without a server", as_user(config["Healthcheck"]["Test"][1]).returncode != 0)
    refused = subprocess.run(
        [*user, *config["Entrypoint"], *config["Cmd"]], env={k: v for k, v in environment.items() if k != "ISOCORTEX_TOKEN_FILE"},
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60,
    )
    report.expect("it does not start without a token", refused.returncode != 0 and "token" in refused.stderr, refused.stderr[-200:].strip())

    without = as_user(*config["Entrypoint"], *config["Cmd"])
    report.expect("it does not start without a store", without.returncode == 78 and "init-store" in without.stderr, without.stderr[-200:].strip())
    made = as_user(*config["Entrypoint"], "init-store")
    report.expect("`init-store` makes one", made.returncode == 0, made.stderr[-200:].strip())

    def started():
        with open(f"{folder}/log", "ab") as log:
            process = subprocess.Popen(
                [*user, *config["Entrypoint"], *config["Cmd"]], env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
        begun = time.monotonic()
        while as_user(config["Healthcheck"]["Test"][1]).returncode != 0:
            with open(f"{folder}/log") as log:
                assert process.poll() is None and time.monotonic() < begun + 60, log.read()[-2000:]
            time.sleep(0.1)
        report.figure("healthy after", f"{time.monotonic() - begun:.1f} s")
        return process

    process = started()
    try:
        # Not /proc, which is of the machine's processes.
        with open(f"{root}/proc/{process.pid}/status") as file:
            status = {name: value.strip() for name, _, value in (line.partition(":") for line in file)}
        report.expect("the process has the image's user", status["Uid"].split()[1] == uid and status["Gid"].split()[1] == gid, status["Uid"])
        report.expect("it has no capability", {status[kind].strip("0") for kind in ("CapEff", "CapPrm", "CapBnd")} == {""}, status["CapEff"])

        client = Server.__new__(Server)
        client.port = int(environment["ISOCORTEX_LISTEN"].rsplit(":", 1)[1])
        report.expect("without the token it answers 401", client.ask("GET", "/v1/cases")[0] == 401)
        token = {"Authorization": f"Bearer {TOKEN}"}
        volume = head(4.0)
        if image["pictures"]:
            with open(f"{root}/usr/local/share/isocortex/ch2.nii.gz", "rb") as file:
                volume = file.read()
        body = form([("volume", volume)])
        code, headers, answer = client.ask("POST", "/v1/cases", body, {"Content-Type": FORM, **token}, 120)
        assert code == 202, (code, answer)
        address, state, end = headers["location"], {}, time.monotonic() + 300
        while state.get("state") not in ("ready", "failed") and time.monotonic() < end:
            time.sleep(0.2)
            state = json.loads(client.ask("GET", address, headers=token)[2])
        method = (state.get("quality") or {}).get("method")
        report.expect("a head is prepared", state.get("state") == "ready", f"{state.get('state')}, brain found by {method}")

        def draw_and_stop(name):
            code, headers, picture = client.ask("GET", f"{address}/render?depth_mm=12&view=left", headers=token, timeout=300)
            report.expect("it is drawn", code == 200 and picture.startswith(b"\x89PNG"), f"{code}, {len(picture)} bytes")
            if image["pictures"]:
                with open(f"{image['pictures']}/{name}.png", "wb") as file:
                    file.write(picture)
            process.send_signal(getattr(signal, config.get("StopSignal") or "SIGTERM"))
            begun = time.monotonic()
            ended = process.wait(60)
            report.expect("it stops in time", ended == 0 and time.monotonic() - begun <= 30, f"status {ended}, {time.monotonic() - begun:.1f} s")

        draw_and_stop("first")
        process = started()
        draw_and_stop("restarted")
        with open(f"{folder}/log") as log:
            said = log.read()
        report.expect("it has found the network's weights", "brains are extracted by the network" in said)
        report.expect("no secret is in its log", TOKEN not in said)
        warnings = [line for line in said.splitlines() if "token" in line and "WARN" in line]
        report.expect("it does not warn about the mounted token", not warnings, warnings[:1])
    finally:
        if process.poll() is None:
            process.kill()
    report.end()


main()
