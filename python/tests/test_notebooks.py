"""The notebooks of the documentation run, and are committed without outputs."""

import json
import os
import shutil
import warnings
from pathlib import Path

import nibabel as nib
import numpy as np
import pandas as pd
import pytest

import isocortex as iso

NOTEBOOKS = Path(iso.__file__).parents[2] / "docs" / "notebooks"
COLIN = Path(os.environ.get("ISOCORTEX_TEST_DATA", Path(__file__).parents[3] / "shared/data")).resolve() / "colin27"


def cells_of(name):
    return [cell for cell in json.loads((NOTEBOOKS / name).read_text())["cells"] if cell["cell_type"] == "code"]


def run(name):
    """Runs the cells in one namespace, which it returns; what a notebook would show of a name must have a text."""
    names = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for cell in cells_of(name):
            source = "".join(cell["source"])
            exec(compile(source, name, "exec"), names)
            last = source.rsplit("\n", 1)[-1]
            assert not last.isidentifier() or repr(names[last])
    return names


def test_no_notebook_has_outputs():
    notebooks = sorted(path.name for path in NOTEBOOKS.glob("*.ipynb"))
    assert notebooks == ["group.ipynb", "one-head.ipynb"]
    for name in notebooks:
        assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells_of(name))


def test_one_head(tmp_path, monkeypatch, folder):
    shutil.copy(folder / "head.nii.gz", tmp_path)
    monkeypatch.chdir(tmp_path)
    names = run("one-head.ipynb")
    assert names["view"].depth_mm == 12 and len(names["places"]) == 5
    assert Path("report.html").stat().st_size > 10_000 and nib.load("blur.nii.gz").ndim == 3


def test_a_group(tmp_path, monkeypatch, folder):
    group = tmp_path / "group"
    group.mkdir()
    head, brain = (nib.load(folder / f"{name}.nii.gz") for name in ("head", "brain"))
    # The patient's left is in the first half of the columns.
    is_left = np.arange(head.shape[0])[:, None, None] < head.shape[0] / 2
    for name, factor, gain in (("small", 0.9, 1.0), ("usual", 1.0, 1.1)):
        affine = head.affine @ np.diag([factor, factor, factor, 1])
        values = np.where(is_left, gain, 1.0) * np.asarray(head.dataobj)
        nib.save(nib.Nifti1Image(values.astype(np.int16), affine), group / f"{name}.nii.gz")
        nib.save(nib.Nifti1Image(np.asarray(brain.dataobj), affine), group / f"{name}.mask.nii.gz")
    (group / "broken.nii.gz").write_bytes(b"no head")
    if COLIN.is_dir():
        shutil.copy(COLIN / "ch2.nii.gz", group / "colin27.nii.gz")
        shutil.copy(COLIN / "mask_dura.nii.gz", group / "colin27.mask.nii.gz")
    monkeypatch.chdir(tmp_path)
    run("group.ipynb")
    table = pd.read_csv("group.csv", index_col="head")
    assert set(table.index) == {"broken", "small", "usual"} | ({"colin27"} if COLIN.is_dir() else set())
    assert "NIfTI" in table.loc["broken", "problem"] and table["problem"].notna().sum() == 1
    ratio = table.loc["small", "envelope_ml"] / table.loc["usual", "envelope_ml"]
    assert ratio == pytest.approx(0.9**3, rel=0.05)
    # Brighter on the left by a tenth.
    assert table.loc["usual", "asymmetry"] - table.loc["small", "asymmetry"] == pytest.approx(0.095, abs=0.02)
    if COLIN.is_dir():
        assert table.loc["colin27", "mask"] == "ok" and table.loc["colin27", "max_depth_mm"] == pytest.approx(
            58.8, abs=0.1
        )
