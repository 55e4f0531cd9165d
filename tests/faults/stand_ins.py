"""Images that stand in for those that docker/Dockerfile begins with, made of Debian's packages and of this machine's toolchains.

They have the names of the real ones, so that buildah takes them for `FROM node:22-bookworm-slim` and its like without a registry.
That of Rust has either this machine's toolchain, or a `cargo` that hands over a program compiled before.
"""

import os
import shutil
import subprocess

from attack import skip

CERTIFICATES = "etc/ssl/certs/ca-certificates.crt"


def say(text):
    print(f"   {text}", flush=True)


def run(*command, **options):
    """Runs a command, and shows the end of what it wrote if it fails."""
    done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: status {done.returncode}\n{done.stdout[-4000:]}")
    return done.stdout


class Buildah:
    """buildah with its images in a folder of its own."""

    def __init__(self, folder):
        self.folder = folder
        self.environment = {**os.environ, "TMPDIR": os.path.join(folder, "tmp")}
        os.makedirs(self.environment["TMPDIR"], exist_ok=True)
        os.makedirs(folder, exist_ok=True)

    def __call__(self, *arguments):
        storage = ["--root", f"{self.folder}/storage", "--runroot", f"{self.folder}/run", "--storage-driver", "overlay"]
        return run("buildah", *storage, *arguments, env=self.environment).strip()

    def has(self, image):
        return image in self("images", "--format", "{{.Name}}:{{.Tag}}").split()

    def image(self, name, base, fill, environment=None, anew=False):
        """Makes an image of another, or of nothing, if it is not there; `fill` gets its container and the folder of its files."""
        name = f"docker.io/library/{name}"
        if self.has(name) and not anew:
            return
        say(f"making a stand-in of {name}")
        container = self("from", "--pull-never", base) if base != "scratch" else self("from", "scratch")
        try:
            fill(container, self("mount", container))
            for variable, value in (environment or {}).items():
                self("config", "--env", f"{variable}={value}", container)
            self("commit", "--quiet", container, name)
        finally:
            self("rm", container)


def put_certificates(folder):
    """The authorities that this machine trusts, which its network may need."""
    if os.path.exists(f"/{CERTIFICATES}"):
        shutil.copyfile(f"/{CERTIFICATES}", os.path.join(folder, CERTIFICATES))


def is_possible(*programs):
    """Skips where this machine cannot build."""
    if os.geteuid() != 0:
        skip("building needs root")
    for name in ("buildah", "debootstrap", "unshare", *programs):
        if not shutil.which(name):
            skip(f"{name} is missing")


# As in Debian's own image: no caches of apt, which hold times.
CLEAN = """Dir::Cache::pkgcache ""; Dir::Cache::srcpkgcache "";
APT::Update::Post-Invoke { "rm -f /var/cache/apt/archives/*.deb || true"; };
DPkg::Post-Invoke { "rm -f /var/cache/apt/archives/*.deb || true"; };
"""

CARGO = """#!/bin/sh
# Stands in for cargo: hands over a program that was compiled before.
case "$*" in
  "install --locked --version "*" --root /auditable cargo-auditable") ;;
  "auditable build --release --locked --package isocortex --bin isocortex") install -D /usr/local/lib/isocortex target/release/isocortex ;;
  *) exit 1 ;;
esac
"""


def make_debian(buildah):
    """The image that the others, and the last stage of docker/Dockerfile, begin with."""
    # What earlier runs made and no name leads to any more; one that was interrupted left its containers.
    buildah("rm", "--all")
    buildah("rmi", "--prune")

    def of_debian(_, files):
        run("debootstrap", "--variant=minbase", "--include=ca-certificates", "bookworm", files)
        # What differs from one machine or day to the next.
        for left in ("var/log/bootstrap.log", "etc/hostname", "etc/resolv.conf"):
            if os.path.exists(os.path.join(files, left)):
                os.remove(os.path.join(files, left))
        with open(os.path.join(files, "etc/apt/apt.conf.d/docker-clean"), "w") as file:
            file.write(CLEAN)
        put_certificates(files)

    buildah.image("debian:bookworm-slim", "scratch", of_debian)


def make_toolchains(buildah, compiled=None, compiler=None):
    """The other three images of docker/Dockerfile.

    With `compiled`, the path of a program, the one with Rust hands that over; otherwise it compiles, with these variables.
    """
    debian = "docker.io/library/debian:bookworm-slim"

    def of_node(_, files):
        shutil.copy2(os.path.realpath(shutil.which("node")), f"{files}/usr/local/bin/node")
        npm = os.path.dirname(os.path.dirname(os.path.realpath(shutil.which("npm"))))
        shutil.copytree(npm, f"{files}/usr/local/lib/node_modules/npm", symlinks=True)
        os.symlink("../lib/node_modules/npm/bin/npm-cli.js", f"{files}/usr/local/bin/npm")

    def of_rust(_, files):
        if compiled:
            shutil.copy2(compiled, f"{files}/usr/local/lib/isocortex")
            with open(f"{files}/usr/local/bin/cargo", "w") as file:
                file.write(CARGO)
            os.chmod(f"{files}/usr/local/bin/cargo", 0o755)
            return
        toolchain = run("rustc", "--print", "sysroot", cwd=os.path.dirname(os.path.abspath(__file__))).strip()
        shutil.copytree(
            toolchain, f"{files}/usr/local/toolchain", symlinks=True, ignore=lambda at, _: ["share"] if at == toolchain else []
        )

    def of_python(container, _):
        packages = "apt-get update && apt-get install -y --no-install-recommends python3-pip && rm -rf /var/lib/apt/lists/*"
        buildah("run", "--isolation", "chroot", container, "--", "sh", "-c", packages)

    buildah.image("node:22-bookworm-slim", debian, of_node, {"NODE_EXTRA_CA_CERTS": f"/{CERTIFICATES}"})
    path = "/usr/local/toolchain/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
    buildah.image("rust:1.95-slim-bookworm", debian, of_rust, {"CARGO_HOME": "/usr/local/cargo", "PATH": path, **(compiler or {})}, anew=True)
    buildah.image("python:3.13-slim-bookworm", debian, of_python)
