"""What a case returns, and what it states if it cannot."""

import io
import sys
from collections import Counter

import nibabel as nib
import numpy as np
import phantom
import pytest
from PIL import Image

import isocortex as iso


def test_every_depth_has_the_same_triangles_and_lies_as_deep_as_it_says(case):
    shallow, deep = case.mesh(4.0, paths="flow"), case.mesh(12.0, paths="flow")
    np.testing.assert_array_equal(shallow.faces, deep.faces)
    assert shallow.coordinates.dtype == np.float32 and shallow.faces.dtype == np.int32
    moved = np.linalg.norm(deep.coordinates - shallow.coordinates, axis=-1)
    assert np.median(moved) == pytest.approx(8.0, abs=1.0)
    # Outwards: the signed volume is positive, and shrinks.
    volumes = [np.einsum("ij,ij->", *_normals(mesh)) / 6000 for mesh in (shallow, deep)]
    assert case.envelope_ml > volumes[0] > volumes[1] > 0.5 * case.envelope_ml
    assert repr(deep) == "<Mesh of 10002 vertices and 20000 triangles, RAS mm>"


def _normals(mesh):
    a, b, c = np.moveaxis(mesh.coordinates[mesh.faces].astype(float), 1, 0)
    return a, np.cross(b, c)


def test_an_isosurface_is_closed_and_is_what_a_picture_shows(case):
    mesh = case.isosurface(8.0)
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    directed = Counter(map(tuple, edges.tolist()))
    assert all(directed[b, a] == count for (a, b), count in directed.items())
    shown = case.positions(8.0, view="superior", width=64, height=64).reshape(-1, 3)
    shown = shown[np.isfinite(shown).all(axis=1)][::20]
    nearest = [np.linalg.norm(mesh.coordinates - position, axis=1).min() for position in shown]
    assert max(nearest) < phantom.EDGE_MM


def test_a_picture_is_the_png_of_the_server_with_its_texts(case):
    png = case.png(8.0, view="superior", width=256, height=128, zoom=2, window=(500, 600), annotate=True)
    picture = case.picture(8.0, view="superior", width=256, height=128, zoom=2, window=(500, 600), annotate=True)
    assert Image.open(io.BytesIO(png)) == picture and picture.size == (256, 128)
    assert picture.info["depth_mm"] == "8" and picture.info["case"] == case.id
    assert case.picture(8.0, overlay="blur", overlay_threshold=0).mode == "RGB"


def test_a_layer_is_shown_and_measured(case, folder):
    head = nib.load(folder / "head.nii.gz")
    doubled = nib.Nifti1Image(2 * np.asarray(head.dataobj), head.affine)
    layer = case.add_layer(doubled, "twice/?", kind="map", unit="a")
    assert "twice/?" in [one["name"] for one in case.layers()]
    assert layer["state"] == "ready" and layer["unit"] == "a"
    point = case.profile((30.0, 10.0, 20.0)).query("point == 'own' and distance_mm == 0")
    assert point["twice/?"].item() == pytest.approx(2 * point["intensity"].item(), abs=0.1)
    assert case.map("twice/?").get_fdata().max() == 2 * phantom.BALL
    assert case.picture(8.0, layer="twice/?").size == (512, 512)


def test_a_layer_lies_where_a_matrix_in_ras_puts_it(case, folder):
    head = nib.load(folder / "head.nii.gz")
    to_the_right = np.eye(4)
    to_the_right[0, 3] = 5
    layer = case.add_layer(
        nib.Nifti1Image(np.asarray(head.dataobj), head.affine), "moved", kind="map", transform=to_the_right
    )
    assert layer["case_from_layer"][0] == [1, 0, 0, -5]


def test_labels_have_the_values_of_their_file(case, folder):
    head = nib.load(folder / "head.nii.gz")
    labels = np.zeros(head.shape, np.int32)
    labels[: head.shape[0] // 2], labels[head.shape[0] // 2 :] = 7, 1035
    case.add_layer(nib.Nifti1Image(labels, head.affine, dtype=np.int32), "depth_mm", kind="labels")
    case.add_layer(nib.Nifti1Image(labels, head.affine, dtype=np.int32), "halves", kind="labels", transform="none")
    for x, value in ((-30.0, 7), (30.0, 1035)):
        point = case.profile((x, 10.0, 20.0)).query("point == 'own' and distance_mm == 0")
        assert point["halves"].item() == value
        # A layer of the same name does not hide a column.
        assert 5 < point["depth_mm"].item() < 50 and point["depth_mm"].item() != value
    assert set(np.unique(case.map("halves").get_fdata())) == {7, 1035}


def test_a_nibabel_image_of_any_format_is_a_head(case, folder):
    head = nib.load(folder / "head.nii.gz")
    image = nib.MGHImage(np.asarray(head.dataobj).astype(np.float32), head.affine)
    with pytest.warns(UserWarning, match="look at the brain mask") as warned:
        other = iso.open(image, mask=nib.load(folder / "brain.nii.gz"))
    assert warned[0].filename == __file__
    np.testing.assert_allclose(other.mesh(5.0).coordinates, case.mesh(5.0).coordinates, atol=1e-3)


def test_a_server_is_used_by_its_address_and_outlives_the_connection(case):
    address, token = case._connection.address, case._connection.token
    with iso.Server(address, token) as server:
        assert case.id in [one["id"] for one in server.cases()]
        assert iso.open("head.nii.gz", mask="brain.nii.gz", server=server).id == case.id
    assert iso.open("head.nii.gz", mask="brain.nii.gz", server=address, token=token).mesh(3.0).faces.shape == (20000, 3)


def test_the_profile_has_numbers_only(case):
    profile = case.profile((38, 20, 30))
    assert profile.drop(columns="point").dtypes.eq(float).all()
    own = profile[profile["point"] == "own"]
    assert own["depth_mm"].is_monotonic_increasing and own["distance_mm"].diff().dropna().eq(0.5).all()


def test_findings_and_reports(case, tmp_path):
    assert list(case.findings().columns)[:4] == ["id", "kind", "label", "certainty"]
    assert b"Not for diagnosis" in case.report(tmp_path / "report.html").read_bytes()
    assert case.report(str(tmp_path / "report.pdf")).read_bytes().startswith(b"%PDF")


def test_what_is_too_deep_is_said(case):
    with pytest.warns(UserWarning, match="200 mm is too deep: this is the surface at 61.6 mm") as warned:
        case.mesh(200)
    assert warned[0].filename == __file__


@pytest.mark.parametrize(
    ("ask", "kind", "words"),
    [
        (lambda case: case.picture(8.0, view="lleft"), "query-value-unreadable", "`view` must be one of `left`"),
        (lambda case: case.mesh(-1), "depth-negative", "must not be negative"),
        (lambda case: case.map("flair"), "maps-undefined", "no layer of this case is a FLAIR"),
        (lambda case: iso.open("head.nii.gz", closing_radius_mm=3000), "closing-radius-out-of-range", "0 to 50"),
        (lambda case: iso.open(__file__), "not-nifti", "send a NIfTI or MGH volume"),
        (lambda case: iso.open("folder"), "dicom-none", "none of 1 files is DICOM"),
        (lambda case: iso.open("head.nii.gz", server="http://127.0.0.1:9"), "", "check the address"),
        (lambda case: iso.open("head.nii.gz", server=case._connection.address), "unauthorized", "pass token="),
    ],
)
def test_an_error_has_the_words_of_the_server(case, folder, ask, kind, words):
    (folder / "folder").mkdir(exist_ok=True)
    (folder / "folder" / "notes.txt").write_text("no image")
    with pytest.raises(iso.IsocortexError, match=words) as error:
        ask(case)
    assert error.value.kind == kind


@pytest.mark.parametrize(
    ("ask", "kind", "words"),
    [
        (lambda case: case.profile((0, 0, 300)), ValueError, r"\(0, 0, 300\) is outside the brain"),
        (lambda case: case.profile((0, 0)), ValueError, "three coordinates"),
        (lambda case: case.report("report.docx"), ValueError, "rename 'report.docx'"),
        (lambda case: iso.open("head.nii.gz", token="a"), ValueError, "pass server="),
        (lambda case: iso.open(3), TypeError, "not int"),
        (lambda case: iso.open("nothing.nii.gz"), FileNotFoundError, "nothing.nii.gz"),
    ],
)
def test_what_python_itself_can_tell_is_an_error_of_its_kind(case, ask, kind, words):
    with pytest.raises(kind, match=words):
        ask(case)


@pytest.mark.parametrize(
    ("module", "extra", "ask"),
    [
        ("pandas", "pandas", lambda case: case.places()),
        ("nibabel", "nibabel", lambda case: case.map("blur")),
        ("PIL.Image", "pillow", lambda case: case.picture(8.0)),
    ],
)
def test_a_missing_package_is_named(case, monkeypatch, module, extra, ask):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=rf"needs {extra}: pip install 'isocortex\[{extra}\]'"):
        ask(case)


def test_a_progress_bar_is_drawn_in_a_terminal(case, monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    iso.open("head.nii.gz", mask="brain.nii.gz")
    assert capsys.readouterr().err.endswith(f"[{'#' * 30}] 100% ready       \n")


def test_a_mesh_without_its_unknown_vertices_is_the_rest_of_it(case):
    mesh = case.surface("left").mesh(5.0)
    finite = mesh.finite()
    unknown = np.isnan(mesh.coordinates).any(axis=1)
    assert 0 < unknown.sum() == len(mesh.coordinates) - len(finite.coordinates)
    kept = mesh.faces[~unknown[mesh.faces].any(axis=1)]
    np.testing.assert_array_equal(finite.coordinates[finite.faces], mesh.coordinates[kept])
    assert case.mesh(5.0).finite().faces.shape == (20000, 3)
