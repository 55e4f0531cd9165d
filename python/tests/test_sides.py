"""Left is left: a ball on the left of the phantom is found there, in everything that has positions."""

import nibabel as nib
import numpy as np
import phantom
import pytest

LEFT_MM, RIGHT_MM = phantom.BALL_MM, phantom.BALL_MM * (-1, 1, 1)
DEPTH_MM = 10.0


def bright(picture):
    """The pixels of the ball, in a picture whose window shows nothing else."""
    return np.asarray(picture.convert("L")) > 128


OPTIONS = {"window": (1000, 100), "ambient": 1}


def test_the_ball_is_seen_from_the_left_and_lies_there(case):
    seen = bright(case.picture(DEPTH_MM, view="left", **OPTIONS))
    positions = case.positions(DEPTH_MM, view="left")[seen]
    assert seen.sum() > 100
    assert np.linalg.norm(positions - LEFT_MM, axis=-1).max() < phantom.BALL_RADIUS_MM + 2 * phantom.EDGE_MM
    assert not bright(case.picture(DEPTH_MM, view="right", **OPTIONS)).any()


def test_the_face_is_on_the_left_of_a_picture_from_the_left(case):
    positions = case.positions(DEPTH_MM, view="left")
    assert np.nanmean(positions[:, :256, 1]) > 20 > -20 > np.nanmean(positions[:, 256:, 1])
    assert np.nanmean(positions[:256, :, 2]) > 15 > -15 > np.nanmean(positions[256:, :, 2])


def test_slices_show_the_ball_at_its_coordinates(case):
    for plane, at in (("sagittal", LEFT_MM[0]), ("coronal", LEFT_MM[1]), ("axial", LEFT_MM[2])):
        assert bright(case.slice(plane, at, window=(1000, 100))).sum() > 100
    assert not bright(case.slice("sagittal", RIGHT_MM[0], window=(1000, 100))).any()
    # The patient's right is on the left.
    for plane in ("coronal", "axial"):
        columns = np.nonzero(bright(case.slice(plane, LEFT_MM[(plane == "coronal" and 1) or 2], window=(1000, 100))))[1]
        assert columns.min() > 256


def test_a_profile_leads_through_the_ball_and_mirrors_it(case):
    profile = case.profile(tuple(LEFT_MM))
    assert profile.attrs["own"]["side"] == "left" and profile.attrs["mirrored"]["side"] == "right"
    point = profile[profile["distance_mm"] == 0].set_index("point")
    np.testing.assert_allclose(point.loc["own", ["x_mm", "y_mm", "z_mm"]].astype(float), LEFT_MM)
    assert point.loc["own", "intensity"] == phantom.BALL > 1.2 * point.loc["mirrored", "intensity"]
    np.testing.assert_allclose(point.loc["mirrored", ["x_mm", "y_mm", "z_mm"]].astype(float), RIGHT_MM, atol=3)


def test_the_left_half_lies_on_the_left(case):
    for side, sign in (("left", -1), ("right", 1)):
        surface = case.surface(side)
        for mesh in (surface.mesh(2.0), surface.isosurface(2.0)):
            x = mesh.coordinates[:, 0] * sign
            assert np.nanmin(x) > -5 and np.nanmax(x) > 60


def test_a_map_has_the_values_of_profiles_at_their_positions(case):
    for name in ("blur", "sharpness"):
        image = case.map(name)
        own = case.profile((38.0, -25.0, 20.0)).query("point == 'own' and distance_mm == 0")
        position = own[["x_mm", "y_mm", "z_mm"]].to_numpy()[0]
        values = image.get_fdata()
        voxel = nib.affines.apply_affine(np.linalg.inv(image.affine), position)
        around = values[tuple(slice(int(v), int(v) + 2) for v in voxel)]
        assert np.nanmin(around) - 1e-3 <= own[name].item() <= np.nanmax(around) + 1e-3


def test_the_mask_lies_on_the_brain(case, folder):
    mask, brain = case.mask(), nib.load(folder / "brain.nii.gz")
    inside = nib.affines.apply_affine(mask.affine, np.argwhere(np.asarray(mask.dataobj)))
    voxels = np.round(nib.affines.apply_affine(np.linalg.inv(brain.affine), inside)).astype(int)
    assert np.asarray(brain.dataobj)[tuple(voxels.T)].mean() > 0.97
    assert len(inside) * mask.header.get_zooms()[0] ** 3 == pytest.approx(1000 * case.envelope_ml, rel=0.1)


def test_a_finding_on_the_left_is_read_there(case):
    path = f"/v1/cases/{case.id}/findings"
    finding = {"id": "ball", "kind": "point", "points_in_patient": [[54, -10, 20]], "depth_mm": 8, "label": "ball"}
    etag = case._connection.get(path).headers["ETag"]
    written = case._connection.send("PUT", path, json={"findings": [finding]}, headers={"If-Match": etag})
    try:
        found = case.findings().iloc[0]
    finally:
        again = {"If-Match": written.headers["ETag"]}
        case._connection.send("PUT", path, json={"findings": []}, headers=again)
    assert found["side"] == "left" and found["label"] == "ball"
    assert not found["is_unconfirmed"] and not found["is_dismissed"]
    np.testing.assert_array_equal(found[["x_mm", "y_mm", "z_mm"]].astype(float), LEFT_MM)
    np.testing.assert_array_equal(found["points_mm"], [LEFT_MM])


def test_places_name_the_side_of_their_positions(case):
    places = case.places(limit=10, region="all")
    assert len(places) == 10 and places["score"].is_monotonic_decreasing
    far = places[places["x_mm"].abs() > 10]
    assert list(far["side"]) == ["left" if x < 0 else "right" for x in far["x_mm"]]


def test_voxels_know_their_depth_and_side_in_the_grid_of_the_head(case, folder):
    head = nib.load(folder / "head.nii.gz")
    images = {name: case.map(name) for name in ("depth", "brain", "sides", "regions", "blur", "blur-places")}
    for name, image in images.items():
        assert image.shape == head.shape, name
        np.testing.assert_allclose(image.affine, head.affine, atol=1e-4)
    from_mm = np.linalg.inv(head.affine)

    def at(name, place):
        return images[name].get_fdata()[tuple(np.round(nib.affines.apply_affine(from_mm, place)).astype(int))]

    # Deeper than the ball, which is a hole in the cortex.
    left, right = LEFT_MM * 0.7, RIGHT_MM * 0.7
    assert [at("sides", place) for place in (left, right)] == [1, 2]
    assert [at("regions", place) for place in (left, right)] in ([1, 2], [5, 6])
    profile = case.profile(tuple(left))
    point = profile.query("point == 'own' and distance_mm == 0")
    assert at("brain", left) == 1 and at("depth", left) == pytest.approx(point["depth_mm"].item(), abs=phantom.EDGE_MM)
    assert np.isnan(at("depth", (0, 0, 85))) and at("sides", (0, 0, 85)) == 0
    for rank, place in enumerate(case.places(limit=60)[["x_mm", "y_mm", "z_mm"]].to_numpy(), 1):
        assert 0 < at("blur-places", place) <= rank
