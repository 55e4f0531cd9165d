"""What the tests and the examples in the docstrings share: the program, a phantom and its case.

The program is ISOCORTEX_BINARY, otherwise the debug build of this checkout.
"""

import os
from pathlib import Path

import phantom
import pytest

import isocortex as iso

ROOT = Path(__file__).resolve().parent.parent
os.environ["ISOCORTEX_BINARY"] = str(
    Path(os.environ.get("ISOCORTEX_BINARY", ROOT / "target/debug/isocortex")).resolve()
)


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A folder with `head.nii.gz` and `brain.nii.gz`."""
    folder = tmp_path_factory.mktemp("phantom")
    phantom.write_phantom(folder)
    return folder


@pytest.fixture(autouse=True)
def _in_folder(folder, monkeypatch):
    monkeypatch.chdir(folder)


@pytest.fixture(scope="session")
def case(folder):
    return iso.open(folder / "head.nii.gz", mask=folder / "brain.nii.gz")


@pytest.fixture(autouse=True)
def _names(doctest_namespace, request):
    doctest_namespace["iso"] = iso
    if "DoctestItem" in type(request.node).__name__:
        doctest_namespace["case"] = request.getfixturevalue("case")
