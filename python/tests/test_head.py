"""A real head: Colin27 of the folder ISOCORTEX_TEST_DATA."""

import os
from pathlib import Path

import nibabel as nib
import numpy as np
import pytest

import isocortex as iso

DATA = Path(os.environ.get("ISOCORTEX_TEST_DATA", Path(__file__).parents[3] / "shared/data")).resolve() / "colin27"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the real head is missing; set ISOCORTEX_TEST_DATA to its folder"
)


@pytest.fixture(scope="module")
def head():
    return iso.open(DATA / "ch2.nii.gz", mask=DATA / "mask_dura.nii.gz", name="Colin27")


def test_a_real_head_is_prepared(head):
    assert repr(head).endswith("'Colin27': 181×217×181 voxels of 1×1×1 mm, 0 to 58.8 mm deep, mask ok>")
    assert head.quality == "ok" and head.quality_reasons == []


def test_its_mesh_lies_in_its_brain_at_the_depth(head):
    image = nib.load(DATA / "ch2.nii.gz")
    brain = np.asarray(nib.load(DATA / "mask_dura.nii.gz").dataobj) > 0
    mesh = head.mesh(8.0)
    # The volume cuts the brain below.
    assert 0 < np.isnan(mesh.coordinates[:, 0]).sum() < 50
    coordinates = mesh.finite().coordinates
    voxels = np.round(nib.affines.apply_affine(np.linalg.inv(image.affine), coordinates)).astype(int)
    assert brain[tuple(voxels.T)].mean() > 0.99
    # Colin27 lies as the MNI does: the anterior commissure is the origin, and the frontal pole is 7 cm in front of it.
    assert coordinates.min(axis=0) == pytest.approx([-60, -98, -58], abs=8)
    assert coordinates.max(axis=0) == pytest.approx([60, 66, 74], abs=8)


def test_its_halves_lie_on_their_sides(head):
    for side, sign in (("left", -1), ("right", 1)):
        x = head.surface(side).mesh(6.0).coordinates[:, 0] * sign
        assert np.nanmin(x) > -2 and np.nanmedian(x) > 20


def test_its_places_have_sides_and_a_table(head):
    places = head.places(limit=10)
    assert places.attrs["nothing_stands_out"] is True
    far = places[places["x_mm"].abs() > 10]
    assert list(far["side"]) == ["left" if x < 0 else "right" for x in far["x_mm"]]


def test_its_map_covers_the_brain(head):
    blur = head.map("blur")
    values = blur.get_fdata()
    assert nib.aff2axcodes(blur.affine) == ("R", "A", "S")
    assert 0.02 < np.isfinite(values).mean() < 0.9 and np.nanmax(values) > 1.5


def test_its_halves_are_read_as_surfaces_of_freesurfer(head, tmp_path):
    head.to_freesurfer(tmp_path / "colin27", [8.0], values=["blur"])
    for prefix, side, sign in (("lh", "left", -1), ("rh", "right", 1)):
        path = tmp_path / "colin27" / "surf" / f"{prefix}.cut-8mm"
        coordinates, _, about = nib.freesurfer.read_geometry(path, read_metadata=True)
        # Its axes lie as FreeSurfer's do, so that the shift alone leads to the scanner.
        scanner = coordinates + about["cras"]
        expected = head.surface(side).mesh(8.0).coordinates
        known = np.isfinite(expected[:, 0])
        np.testing.assert_allclose(scanner[known], expected[known], atol=1e-3)
        assert np.median(scanner[known, 0]) * sign > 15 and np.linalg.norm(about["cras"]) > 20
        assert np.nanmax(nib.freesurfer.read_morph_data(f"{path}.blur")) > 1.5
