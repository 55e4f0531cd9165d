"""A subject as FreeSurfer lays it out, written by nibabel from a real head: pycortex-s1 in ISOCORTEX_TEST_DATA."""

import os
from pathlib import Path

import nibabel as nib
import numpy as np
import pytest

import isocortex as iso

DATA = Path(os.environ.get("ISOCORTEX_TEST_DATA", Path(__file__).parents[3] / "shared/data")).resolve() / "pycortex-s1"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the real head is missing; set ISOCORTEX_TEST_DATA to its folder"
)

# The centre of the volume moves by this in the scanner, away from the origin.
MOVED_MM = np.array([4.5, -20.25, 12.0])
HALVES = ("lh", "rh")
LAYERS = ("white and pial", "surface thickness", "aparc", "aparc+aseg")
KINDS = {"white": "wm", "pial": "pia"}


def surface(half, kind):
    """Places in scanner RAS, and triangles."""
    image = nib.load(DATA / f"{KINDS[kind]}_{half}.gii")
    return image.agg_data("pointset") + MOVED_MM, image.agg_data("triangle").astype(np.int32)


def heights(half, kind="white"):
    """The height of each vertex, rounded: a layer keeps whole numbers as they are."""
    return np.round(surface(half, kind)[0][:, 2]).astype(np.float32)


@pytest.fixture(scope="module")
def volumes():
    """The head and its brain, of which nibabel makes MGH files."""
    head, brain = (nib.load(DATA / name) for name in ("t1.nii.gz", "mask_brain.nii.gz"))
    affine = head.affine.copy()
    affine[:3, 3] += MOVED_MM
    values, inside = np.asarray(head.dataobj), np.asarray(brain.dataobj) > 0
    return nib.MGHImage(values.astype(np.int16), affine), nib.MGHImage(
        np.where(inside, values, 0).astype(np.int16), affine
    )


def write_surface(path, half, kind, head, has_footer=True):
    places, triangles = surface(half, kind)
    tkregister = head.header.get_vox2ras_tkr() @ np.linalg.inv(head.affine)
    axes = head.header["Mdc"]
    footer = {
        "head": np.array([2, 0, 20]),
        "valid": "1  # volume info valid",
        "filename": "../mri/T1.mgz",
        "volume": np.array(head.shape),
        "voxelsize": np.array(head.header.get_zooms()),
        **{name: axes[row] for row, name in enumerate(("xras", "yras", "zras"))},
        "cras": head.header["Pxyz_c"],
    }
    places = nib.affines.apply_affine(tkregister, places)
    nib.freesurfer.write_geometry(path, places, triangles, volume_info=footer if has_footer else None)


def write_subject(folder, head, brain, has_footer):
    for name in ("mri", "surf", "label"):
        (folder / name).mkdir(parents=True)
    nib.save(head, folder / "mri/T1.mgz")
    nib.save(brain, folder / "mri/brainmask.mgz")
    for half in HALVES:
        for kind in KINDS:
            write_surface(folder / f"surf/{half}.{kind}", half, kind, head, has_footer)
        values = heights(half)
        nib.freesurfer.write_morph_data(folder / f"surf/{half}.thickness", values)
        lobes = (surface(half, "white")[0][:, 1] > MOVED_MM[1]).astype(int) + 1
        table = np.array([[0, 0, 0, 0, 0], [25, 100, 40, 0, 0], [120, 20, 200, 0, 0]])
        nib.freesurfer.write_annot(
            folder / f"label/{half}.aparc.annot", lobes, table, ["unknown", "behind", "in front"]
        )
    # FreeSurfer links its pial surfaces to others beside them.
    pial = folder / "surf/lh.pial"
    pial.rename(folder / "surf/lh.pial.T1")
    pial.symlink_to("lh.pial.T1")
    regions = np.zeros(head.shape, np.int16)
    regions[100:120, 100:120, 100:120], regions[130:150, 100:120, 100:120] = 10, 1001
    nib.save(nib.MGHImage(regions, head.affine), folder / "mri/aparc+aseg.mgz")


@pytest.fixture(scope="module", params=[True, False], ids=["with footers", "without footers"])
def subject(request, volumes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("subject")
    write_subject(folder, *volumes, request.param)
    # Each is a case of its own, with layers of its own.
    return iso.open(folder, closing_radius_mm=10.0 if request.param else 9.0), folder


def layers(case):
    for name in LAYERS:
        case.map(name)
    listed = case._connection.get(f"{case._path}/layers").json()["layers"]
    return {layer["name"]: layer for layer in listed}


def defined(image):
    """The values of a layer, and where they lie in scanner RAS."""
    values = image.get_fdata()
    places = np.argwhere(np.isfinite(values) & (values != 0))
    return nib.affines.apply_affine(image.affine, places), values[tuple(places.T)]


def test_a_subject_becomes_a_case_with_its_layers(subject, volumes):
    case, _folder = subject
    # Its brain is the mask.
    mask, brain = case.mask(), volumes[1]
    volume_ml = [
        (image.get_fdata() > 0).sum() * abs(np.linalg.det(image.affine[:3, :3])) / 1000 for image in (mask, brain)
    ]
    assert volume_ml[0] == pytest.approx(volume_ml[1], rel=0.03)
    assert np.linalg.norm(volumes[0].header["Pxyz_c"]) > 10
    found = layers(case)
    assert {name: found[name]["kind"] for name in LAYERS} == {
        "white and pial": "labels",
        "surface thickness": "map",
        "aparc": "labels",
        "aparc+aseg": "labels",
    }
    assert found["surface thickness"]["unit"] == "mm"
    names = {name: [label["name"] for label in layer.get("labels", [])] for name, layer in found.items()}
    assert names["white and pial"] == ["lh.white", "rh.white", "lh.pial", "rh.pial"]
    assert names["aparc"] == ["behind", "in front"]
    assert names["aparc+aseg"] == ["Left-Thalamus", "ctx-lh-behind"]
    for name in LAYERS[:3]:
        assert found[name]["quality"] == "ok", found[name]
    fit = found["surface thickness"]["fit"]
    print(
        f"white lies {fit['junction_median_mm']:.2f} mm from the junction, 95 % within {fit['junction_p95_mm']:.2f} mm"
    )
    assert fit["junction_median_mm"] < 0.8 and fit["junction_p95_mm"] < 3


def test_values_lie_on_their_surface_and_on_their_side(subject):
    case, _folder = subject
    places, values = defined(case.map("surface thickness"))
    assert len(places) > 300_000
    # Rounded to half a millimetre, within a sheet of 1 mm on both sides.
    assert np.abs(places[:, 2] - values).max() < 1.6
    places, labels = defined(case.map("white and pial"))
    for label, sign in ((1, -1), (2, 1), (3, -1), (4, 1)):
        x = sign * (places[labels == label, 0] - MOVED_MM[0])
        assert np.median(x) > 20 and (x > -4).mean() > 0.99
    places, labels = defined(case.map("aparc"))
    assert ((places[:, 1] > MOVED_MM[1]) == (labels == 2)).mean() > 0.98


def test_gifti_of_the_same_surface_has_the_same_values(subject, tmp_path):
    case, _folder = subject
    parts = []
    for half in HALVES:
        places, triangles = surface(half, "white")
        scanner = nib.gifti.GiftiCoordSystem("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_SCANNER_ANAT", np.eye(4))
        arrays = [
            nib.gifti.GiftiDataArray(places.astype(np.float32), "NIFTI_INTENT_POINTSET", coordsys=scanner),
            nib.gifti.GiftiDataArray(triangles, "NIFTI_INTENT_TRIANGLE"),
            nib.gifti.GiftiDataArray(heights(half), "NIFTI_INTENT_SHAPE"),
        ]
        parts.append(("surface", ("surface", nib.gifti.GiftiImage(darrays=arrays).to_bytes(), "application/xml")))
    form = [*parts, ("parameters", (None, b'{"name": "by GIFTI"}', "application/json"))]
    case._connection.send("POST", f"{case._path}/layers", files=form)
    one, other = (case.map(name).get_fdata() for name in ("surface thickness", "by GIFTI"))
    assert (np.isfinite(one) == np.isfinite(other)).mean() > 0.99999
    both = np.isfinite(one) & np.isfinite(other)
    assert (np.abs(one - other)[both] < 1e-6).mean() > 0.999
    # What nibabel reads of the files is what was written.
    _case, folder = subject
    np.testing.assert_array_equal(nib.freesurfer.read_morph_data(folder / "surf/lh.thickness"), heights("lh"))


def test_an_overlay_of_nibabel_is_the_same_as_its_curv_file(subject):
    case, folder = subject
    parts = []
    for half in HALVES:
        values = nib.MGHImage(heights(half)[:, None, None], np.eye(4)).to_bytes()
        parts.append(("surface", ("surface", (folder / f"surf/{half}.white").read_bytes(), "application/octet-stream")))
        parts.append(("values", ("values", values, "application/octet-stream")))
    t1 = (folder / "mri/T1.mgz").read_bytes()
    parts.append(("t1", ("t1", t1, "application/octet-stream")))
    form = [*parts, ("parameters", (None, b'{"name": "overlay", "unit": "mm"}', "application/json"))]
    answer = case._connection.send("POST", f"{case._path}/layers", files=form).json()
    # The same voxels are the same layer.
    assert answer["name"] == "surface thickness"
