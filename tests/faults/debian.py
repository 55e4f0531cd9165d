"""Programs of Debian's packages, unpacked into a folder of an attack's own: nothing is installed, and no service starts."""

import glob
import os
import shutil
import subprocess

from attack import skip


def unpacked(folder, *packages):
    """Unpacks packages into a folder; returns the environment that their programs need. Without apt-get or a network the attack is skipped."""
    if not (shutil.which("apt-get") and shutil.which("dpkg-deb")):
        skip("there is no apt-get")
    os.makedirs(folder)
    got = subprocess.run(["apt-get", "download", *packages], cwd=folder, capture_output=True, text=True)
    if got.returncode:
        subprocess.run(["apt-get", "update", "-qq"], capture_output=True)
        got = subprocess.run(["apt-get", "download", *packages], cwd=folder, capture_output=True, text=True)
    if got.returncode:
        skip(f"apt-get cannot download {' '.join(packages)}: {got.stderr.strip()[-200:]}")
    for package in glob.glob(f"{folder}/*.deb"):
        subprocess.run(["dpkg-deb", "-x", package, folder], check=True)
    libraries = glob.glob(f"{folder}/usr/lib/*-linux-*") + glob.glob(f"{folder}/lib/*-linux-*")
    return {"PATH": os.environ.get("PATH", ""), "LD_LIBRARY_PATH": ":".join(libraries)}


def from_manual(page, begins):
    """The block of a page of docs/ with a line that begins with these words."""
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "docs", page)) as file:
        blocks = file.read().split("```")[1::2]
    [block] = [block.split("\n", 1)[1] for block in blocks if any(line.startswith(begins) for line in block.splitlines())]
    return block
