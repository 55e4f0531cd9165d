"""A case as a folder of FreeSurfer, read back by nibabel and by the program."""

import nibabel as nib
import numpy as np
import phantom
import pytest

import isocortex as iso

DEPTHS_MM = (4.0, 8.5)
HALVES = (("lh", "left", -1), ("rh", "right", 1))


def placed(head, kind):
    """The phantom elsewhere in the scanner: its affine, with axes as they are, in another order, or oblique."""
    values, affine = np.asarray(head.dataobj), head.affine.copy()
    if kind == "oblique":
        angle = np.radians(12)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        affine[:3] = turn @ affine[:3]
    affine[:3, 3] += (7.25, -13.5, 21.0)
    if kind == "sagittal":
        # Slices from the right to the left, rows from the front, columns from the top.
        values = values.transpose(1, 2, 0)[::-1, ::-1, ::-1]
        last = np.array(head.shape) - 1
        affine[:3, 3] = affine[:3, :3] @ last + affine[:3, 3]
        affine[:3, :3] = -affine[:3, [1, 2, 0]]
    return nib.Nifti1Image(values, affine)


@pytest.fixture(scope="module", params=["axial", "sagittal", "oblique"])
def subject(folder, request, tmp_path_factory):
    """A case away from the scanner's centre, its folder, and its volume."""
    image = placed(nib.load(folder / "head.nii.gz"), request.param)
    case = iso.open(image, mask=placed(nib.load(folder / "brain.nii.gz"), request.param))
    path = case.to_freesurfer(tmp_path_factory.mktemp("subjects") / "one", DEPTHS_MM, values=("intensity", "blur"))
    return case, path, image


def in_scanner(path, name):
    """A surface of the folder in scanner RAS, from its own footer and nothing else."""
    points, faces, about = nib.freesurfer.read_geometry(path / "surf" / name, read_metadata=True)
    assert about["valid"].startswith("1")
    axes = np.stack([about[axis] for axis in ("xras", "yras", "zras")], axis=1)
    size, edges = about["volume"], about["voxelsize"]
    tkregister = np.array([[-edges[0], 0, 0], [0, 0, edges[2]], [0, -edges[1], 0]])
    voxels = (points - tkregister @ (-size / 2)) @ np.linalg.inv(tkregister).T
    return (voxels - size / 2) @ (axes * edges).T + about["cras"], faces, about


def test_surfaces_lie_where_the_meshes_do(subject):
    case, path, image = subject
    for prefix, name, sign in HALVES:
        for depth_mm in DEPTHS_MM:
            points, faces, about = in_scanner(path, f"{prefix}.cut-{depth_mm:g}mm")
            assert np.linalg.norm(about["cras"]) > 20
            mesh = case.surface(name).mesh(depth_mm)
            known = ~np.isnan(mesh.coordinates[:, 0])
            assert len(points) == len(mesh.coordinates) and known.mean() > 0.5
            np.testing.assert_allclose(points[known], mesh.coordinates[known], atol=1e-3)
            # Left is left, and triangles look outwards.
            middle = nib.affines.apply_affine(image.affine, (np.array(image.shape) - 1) / 2)
            assert (np.median(points[known, 0]) - middle[0]) * sign > 15
            a, b, c = np.moveaxis((points - middle)[faces], 1, 0)
            assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0
            assert known[faces].all() and len(faces) > 5000


def test_the_volume_has_the_acquired_values_where_they_were(subject):
    _, path, image = subject
    t1 = nib.load(path / "mri" / "T1.mgz")
    assert nib.aff2axcodes(t1.affine) == ("L", "I", "A") and t1.get_data_dtype() == np.dtype(">i2")
    assert sorted(t1.shape) == sorted(image.shape)
    voxels = np.argwhere(np.asarray(image.dataobj) == phantom.BALL)
    moved = nib.affines.apply_affine(np.linalg.inv(t1.affine) @ image.affine, voxels)
    np.testing.assert_allclose(moved, np.rint(moved), atol=1e-3)
    assert (np.asarray(t1.dataobj)[tuple(np.rint(moved).astype(int).T)] == phantom.BALL).all()
    assert (np.asarray(t1.dataobj) == phantom.BALL).sum() == len(voxels) > 100
    # The footers are those of this volume.
    about = nib.freesurfer.read_geometry(path / "surf/lh.cut-4mm", read_metadata=True)[2]
    np.testing.assert_array_equal(about["volume"], t1.shape)
    np.testing.assert_allclose(about["cras"], t1.header["Pxyz_c"], atol=1e-4)


def test_values_are_those_of_the_vertices(subject):
    case, path, _ = subject
    t1 = nib.load(path / "mri" / "T1.mgz")
    data = np.asarray(t1.dataobj)
    for prefix, name, _ in HALVES:
        half = case.surface(name)
        points, _, _ = in_scanner(path, f"{prefix}.cut-8.5mm")
        for value in ("intensity", "blur"):
            read = nib.freesurfer.read_morph_data(path / "surf" / f"{prefix}.cut-8.5mm.{value}")
            np.testing.assert_array_equal(read, half.values(8.5, value))
            assert len(read) == len(points) and np.isfinite(read).mean() > 0.3
        # An intensity lies between those of the voxels around it.
        intensity = half.values(8.5, "intensity")
        known = np.flatnonzero(np.isfinite(intensity))[::50]
        corners = np.floor(nib.affines.apply_affine(np.linalg.inv(t1.affine), points[known]) + 1e-4).astype(int)
        for at, here in zip(corners, intensity[known]):
            around = data[tuple(slice(v, v + 2) for v in at)]
            assert around.min() - 0.5 <= here <= around.max() + 0.5


def test_the_folder_is_read_as_the_same_head(subject):
    case, path, _ = subject
    again = iso.open(path / "mri/T1.mgz", mask=path / "mri/brainmask.mgz")
    assert again.envelope_ml == pytest.approx(case.envelope_ml, rel=0.02)
    middle = np.nanmean(again.mesh(4.0).coordinates, axis=0) - np.nanmean(case.mesh(4.0).coordinates, axis=0)
    assert np.abs(middle).max() < 0.5


def test_values_of_vertices_follow_their_depth(case):
    mesh, depths = case.mesh(8.0), case.values(8.0, "depth")
    assert depths.shape == (len(mesh.coordinates),) and np.nanmedian(depths) == pytest.approx(8.0, abs=0.1)
    assert case.values(8.0, "depth", contours=20, points=30).shape == (602,)
    # The ball is on the left alone.
    near = [np.linalg.norm(mesh.coordinates - phantom.BALL_MM * (sign, 1, 1), axis=1) < 5 for sign in (1, -1)]
    left, right = (np.nanmedian(case.values(8.0)[around]) for around in near)
    assert left == phantom.BALL > 1.2 * right


def test_other_folders_are_left_as_they_are(case, tmp_path):
    (tmp_path / "mri").mkdir()
    (tmp_path / "mri" / "T1.mgz").write_bytes(b"another head")
    with pytest.raises(FileExistsError, match="is not an empty folder: name a new one"):
        case.to_freesurfer(tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["mri", "T1.mgz"]
    with pytest.raises(ValueError, match="90 mm is too deep: the greatest depth is"):
        case.to_freesurfer(tmp_path / "new", depths_mm=(5, 90))
    with pytest.raises(iso.IsocortexError, match="must be one of"):
        case.to_freesurfer(tmp_path / "new", values=("bluur",))
    assert not (tmp_path / "new").exists()
