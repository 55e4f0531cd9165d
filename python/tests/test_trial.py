"""The trial: rules and figures on paper, a made-up folder, and heads of the program."""

import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import nibabel as nib
import numpy as np
import pytest
from scipy import stats

from isocortex import Case, IsocortexError
from isocortex.trial import __main__ as trial
from isocortex.trial import heads as trial_heads
from isocortex.trial import repeat
from isocortex.trial.figures import Interval, Patient, area, figures, share
from isocortex.trial.heads import cortical_places
from isocortex.trial.judge import JudgedHead, JudgedLesion, Marks, Plane, judge
from isocortex.trial.repeat import repeated
from isocortex.trial.report import percent
from isocortex.trial.selection import Choice, Table, heads_of, is_same_head
from isocortex.trial.truth import FALSE, HIT, NEAR, Volume, belonging, lesions_of

# Heads of a phantom with truths of many kinds, as `isocortex bids` describes them, and what the former trial of the
# laboratory, written in Rust, stated about them. The random places are its own.
GOLDEN = Path(__file__).with_name("trial.zip")
ORIGIN = np.zeros(3)


def ball(affine, size, *balls):
    """A mask with balls, each a centre in RAS mm and a radius."""
    positions = nib.affines.apply_affine(affine, np.stack(np.indices(size), axis=-1))
    inside = [np.linalg.norm(positions - centre, axis=-1) < radius for centre, radius in balls]
    return Volume(np.any(inside, axis=0).astype(np.uint8), affine)


def grid(spacing):
    affine = np.diag([*spacing, 1.0])
    affine[:3, 3] = -40
    return affine, tuple(int(80 / edge) for edge in spacing)


def balls(*of, spacing=(1.0, 1.0, 1.0)):
    return ball(*grid(spacing), *of)


def lesions(*truths):
    return lesions_of([(truth, np.eye(4)) for truth in truths])


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.8, 0.8, 2.5)])
def test_distances_are_those_of_the_ball_on_any_grid_and_outside_of_it(spacing):
    [lesion] = lesions(balls((ORIGIN, 6.0), spacing=spacing)).lesions
    assert lesion.volume_ml == pytest.approx(0.905, abs=0.06)
    for direction in np.array([[1, 0, 0], [0, 0, 1], [3**-0.5] * 3]):
        for radius in (0.0, 4.0, 12.0, 100.0):
            [part], expected = lesion.parts, max(radius - 6, 0)
            assert part.within(direction[None] * radius, expected + 1.3).all()
            assert not part.within(direction[None] * radius, expected - 1.3).any() or expected < 1.3


def test_a_voxel_has_its_full_extent():
    affine = np.diag([2.0, 2.0, 2.0, 1.0])
    mask = Volume(np.zeros((9, 9, 9), np.uint8), affine)
    mask.data[4, 4, 4] = 1
    [part] = lesions(mask).lesions[0].parts
    at = np.array([[8 + 1 + 9.99, 8, 8], [8 + 1 + 10.01, 8, 8], [8 - 1 - 6.001, 8, 8 + 1 + 8]])
    assert part.within(at, 10.0).tolist() == [True, False, False]


def test_hits_are_near_the_border_and_those_of_a_large_truth_near_its_centre_too():
    def touches(radius, *along):
        return lesions(balls((ORIGIN, radius))).touches(np.array([[x, 0, 0] for x in along]))[0].tolist()

    assert touches(6.0, 3.0, 15.0, 17.5) == [HIT, HIT, FALSE]
    assert touches(18.0, 17.0, 23.0, 29.5) == [HIT, NEAR, FALSE]


def test_parts_count_once_each_and_small_ones_only_if_there_is_no_other():
    left, right, tiny = np.array([[-20.0, 0, 0], [20, 0, 0], [0, 0, 0]])
    found = lesions(balls((left, 7.0), (right, 5.0), (tiny, 2.5)))
    assert (len(found.lesions), len(found.small)) == (2, 1)
    assert np.linalg.norm(found.lesions[0].centre - left) < 0.1
    assert found.touches(np.array([left, tiny])).T.tolist() == [[HIT, NEAR], [NEAR, NEAR]]
    found = lesions(balls((tiny, 2.5), (left, 2.0)))
    assert (len(found.lesions), len(found.small)) == (1, 1)


def test_two_truths_of_one_lesion_count_once_where_their_transforms_bring_them():
    one, other, back = balls((ORIGIN, 6.0)), balls((np.array([25.0, 0, 0]), 8.0)), np.eye(4)
    back[0, 3] = -25
    assert len(lesions(one, other).lesions) == 2
    [lesion] = lesions_of([(one, np.eye(4)), (other, back)]).lesions
    assert np.linalg.norm(lesion.centre) < 0.1 and len(lesion.parts) == 2
    assert lesion.touch(np.array([[17.5, 0, 0], [19.0, 0, 0]])).tolist() == [HIT, FALSE]


def test_a_mask_has_ones_or_probabilities():
    assert belonging(np.array([0, 1, 7, -1])).tolist() == [False, True, True, False]
    assert belonging(np.array([0.2, 0.7, 1.0, np.nan])).tolist() == [False, True, True, False]
    assert belonging(np.array([0.2, 7.0, 0.0])).tolist() == [True, True, False]


def test_a_lesion_is_found_at_its_first_hit_and_moved_by_chance():
    left = np.array([-20.0, 0, 0])
    marks = Marks([[20, 0, 0], [-20, 0, 12], [0, 35, 0], [-20, 0, 0]], [4, 3, 2, 1])
    plane, places = Plane(np.array([-1.0, 0, 0]), 0.0), np.array([[0, 35, 0], [20, 0, 0], [0, 0, -39.0]])
    judged = judge(marks, lesions(balls((left, 7.0))), plane, places)
    [lesion] = judged.lesions
    assert (lesion.false_marks, lesion.hit_score) == (1, 3.0)
    assert (judged.scores, judged.false_scores) == ([4, 3, 2, 1], [4, 2])
    # The mark on the right is the only one at the mirrored place.
    assert lesion.mirrored == 0 and lesion.random == [1, 0, None]


def test_both_kinds_of_tables_are_read(tmp_path):
    tabs, commas = tmp_path / "tabs.tsv", tmp_path / "commas.csv"
    tabs.write_text("participant_id\tgroup\tage_scan\nsub-01\tFCD\t12.5\nsub-02\thc\tn/a\n")
    commas.write_text('\ufeffgroup,ID,note\r\nfcd,1,"one, ""two""\nthree"\r\n', newline="")
    choice = Choice.parse("group=fcd")
    one, two = Table(tabs).row("sub-01"), Table(tabs).row("2")
    assert choice.holds(one) and one.age_years == 12.5
    assert not choice.holds(two) and np.isnan(two.age_years)
    row = Table(commas).row("sub-001")
    assert row.get("note") == 'one, "two"\nthree' and choice.holds(row)
    assert is_same_head("sub-07", "7") and not is_same_head("sub-7a", "7")
    # With a zero or without, they may be two heads.
    both = tmp_path / "both.tsv"
    both.write_text("participant_id\tgroup\nsub-01\tfcd\nsub-1\tcontrol\n")
    assert [Table(both).row(head).get("group") for head in ("sub-01", "sub-1")] == ["fcd", "control"]
    with pytest.raises(IsocortexError, match="sub-001 may be any of sub-01, sub-1"):
        Table(both).row("sub-001")
    both.write_text("participant_id\tgroup\nsub-1\tcontrol\n")
    assert Table(both).row("sub-01").get("group") == "control"
    assert Table(both).row("sub-01", ["sub-01", "sub-1"]) is None


def test_heads_are_found_with_sessions_and_with_truths_elsewhere(tmp_path):
    for name in (
        "sub-02/ses-b/anat/sub-02_ses-b_T1w.nii.gz",
        "sub-02/ses-a/anat/sub-02_ses-a_T1w.nii",
        "sub-02/ses-a/anat/sub-02_ses-a_FLAIR.nii.gz",
        "sub-02/ses-a/anat/sub-02_ses-a_T1w_roi.nii.gz",
        "masks/2/2_MaskInOrig.nii.gz",
        "sub-10/anat/sub-10_T1w.json",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    two, ten = heads_of(tmp_path, "anat/*_roi.nii*")
    assert [path.name for path in two.t1] == ["sub-02_ses-a_T1w.nii", "sub-02_ses-b_T1w.nii.gz"]
    assert (two.name, len(two.flair), len(two.truths), ten.t1) == ("sub-02", 1, 1, [])
    # A truth of the second session belongs to its volume, and one of the first no longer counts.
    (tmp_path / "sub-02/ses-a/anat/sub-02_ses-a_T1w_roi.nii.gz").unlink()
    (tmp_path / "sub-02/ses-b/anat/sub-02_ses-b_roi.nii.gz").touch()
    [two, _] = heads_of(tmp_path, "anat/*_roi.nii*")
    assert [path.name for path in two.t1] == ["sub-02_ses-b_T1w.nii.gz", "sub-02_ses-a_T1w.nii"]
    (tmp_path / "sub-02/ses-a/anat/sub-02_ses-a_roi.nii.gz").touch()
    [two, _] = heads_of(tmp_path, "anat/*_roi.nii*")
    assert [path.name for path in (two.t1[0], *two.truths)] == ["sub-02_ses-a_T1w.nii", "sub-02_ses-a_roi.nii.gz"]
    assert [path.name for path in two.other_truths] == ["sub-02_ses-b_roi.nii.gz"]
    [two, _] = heads_of(tmp_path, "{n}/{n}_MaskInOrig.nii*", tmp_path / "masks")
    assert [path.name for path in two.truths] == ["2_MaskInOrig.nii.gz"]


def lesion(false_marks, hit_score):
    return JudgedLesion(false_marks, hit_score, None, [0, None, None, 7])


def test_shares_thresholds_and_areas_are_those_on_paper():
    heads = [
        JudgedHead([lesion(0, 3.0)], [3.0, 1.0], [1.0]),
        JudgedHead([lesion(4, 1.5), lesion(None, None)], [2.5, 1.5], [1.5]),
    ]
    sides = [[("side", "left")]], [[("side", "right")], [("side", "left")]]
    controls = [JudgedHead([], [2.0, 1.8], [2.0, 1.8]), JudgedHead([], [2.75, 0.5], [2.75, 0.5])]
    found = figures("own", list(map(Patient, heads, sides)), controls, 1, [("limit", 2.6)])
    values = [[share.value for share in row.found] for row in [*found.shares, *found.chance]]
    assert values == [[1 / 3, 2 / 3, 2 / 3], [0.5, 1, 1], [0.25, 0.5, 0.5], [0, 0, 0], [0.25, 0.25, 0.5]]
    left, right = found.strata["side"]
    assert (left.lesions, left.patients, left.found[1].value, right.found[1].value) == (2, 2, 0.5, 1.0)
    # 3.0 exceeds both, 2.5 one of two.
    assert found.area.value == 0.75
    assert [at.above for at in found.thresholds] == [2.0, 1.8, -np.inf, 2.6]
    half, _, _, limit = found.thresholds
    assert (limit.controls_without_marks.value, limit.lesions_found.value) == (0.5, 1 / 3)
    assert (limit.marks_per_control, half.marks_per_control) == (0.5, 0.5)


def test_intervals_are_drawn_from_patients_not_from_lesions():
    heads = [JudgedHead([lesion(0, 1.0)] * 20, [1.0], []), JudgedHead([lesion(None, None)] * 20, [1.0], [])]
    found = figures("own", list(map(Patient, heads)), [])
    assert found.shares[0].found[0] == Interval(0.5, 0.0, 1.0) and found.area is None
    # Of Wilson, for 8 of 8.
    assert percent(share([(1, 1)] * 8)) == "100 % (68 to 100)"
    assert percent(share([(0, 3)] * 8)) == "0 % (0 to 32)"


def test_the_area_is_that_of_mann_and_whitney_and_its_interval_covers_it():
    random = np.random.default_rng(3)
    ones, others = random.integers(0, 12, 40) + 2.0, random.integers(0, 12, 30) + 0.0
    found = area([*ones, -np.inf], [*others, -np.inf])
    assert found.value == stats.mannwhitneyu([*ones, -99], [*others, -99]).statistic / (41 * 31)
    spread = np.sqrt((41 + 31 + 1) / (12 * 41 * 31))
    assert found.low < found.value < found.high and 2 * spread < found.high - found.low < 5 * spread


def test_a_pair_is_of_two_sessions_or_runs(tmp_path):
    anat = tmp_path / "sub-1/anat"
    anat.mkdir(parents=True)
    for end in ("T1w.nii", "T1w.nii.gz", "rec-norm_T1w.nii.gz", "desc-preproc_T1w.nii.gz"):
        (anat / f"sub-1_{end}").touch()
    with pytest.raises(IsocortexError, match="no head"):
        repeat.pairs_of(tmp_path)
    (anat / "sub-1_run-2_T1w.nii.gz").touch()
    [pair] = repeat.pairs_of(tmp_path)
    assert {pair.first.name, pair.second.name} & {"sub-1_run-2_T1w.nii.gz"}


def test_a_place_is_repeated_by_one_of_as_many_within_10_mm():
    one, other = (np.array([[x, 0.0, 0.0] for x in along]) for along in ((0, 50, 100), (9, 130, 52)))
    assert [repeated(one, other, count) for count in (1, 2, 20)] == [1.0, 0.5, 4 / 6]
    assert repeated(one, np.empty((0, 3)), 20) == 0.0


@pytest.fixture
def golden(tmp_path):
    with zipfile.ZipFile(GOLDEN) as packed:
        packed.extractall(tmp_path)
    return tmp_path


def run(golden, *more, results="results"):
    words = [golden / "bids", "--like", "bonn", "--stratum", "site", "--results", golden / results, *more]
    return trial.main(list(map(str, words)))


def report(golden, results="results"):
    return json.loads((golden / results / "report.json").read_text())


def figures_of(found, path=""):
    """The numbers and words of a report by their places. The ends of intervals are drawn at random."""
    if isinstance(found, dict):
        found = [(name, inner) for name, inner in found.items() if name not in ("low", "high")]
    elif isinstance(found, list):
        found = list(enumerate(found))
    else:
        # What follows from the grids of the maps, which are made up, is rounded. Scores were float32.
        is_number = isinstance(found, float)
        return {path: round(found, 2) if "defined" in path else np.float32(found) if is_number else found}
    return {place: value for name, inner in found for place, value in figures_of(inner, f"{path}/{name}").items()}


def keep(golden, *heads):
    """Leaves a few heads, which take less time."""
    for path in (golden / "bids").glob("sub-*"):
        if path.name not in heads:
            shutil.rmtree(path)


@pytest.fixture
def expected(golden):
    """What the former trial has stated, in the words of this one."""
    expected = json.loads((golden / "expected.json").read_text())
    for row in expected["lists"]:
        row["name"], row["strata"] = row.pop("list"), dict(row["strata"])
    expected["differences"] = [{"lists": name, "points": points} for name, points in expected["differences"]]
    return expected


@pytest.fixture
def known_places(golden, monkeypatch):
    places = json.loads((golden / "places.json").read_text())
    monkeypatch.setattr(trial_heads, "cortical_places", lambda name, *_: np.array(places[name]))


@pytest.mark.usefixtures("known_places")
def test_figures_are_those_of_the_former_trial(golden, expected, capsys):
    more = ["--derivatives", golden / "derivatives", "--candidates-of", golden / "other.csv", "--json"]
    assert run(golden, *more) == 0
    found = json.loads(capsys.readouterr().out)
    assert found == report(golden)
    assert figures_of({name: found[name] for name in expected}) == figures_of(expected)
    assert len(figures_of(expected)) > 450
    page = (golden / "results" / "report.html").read_text()
    assert "<script" not in page and "src=" not in page and page.count("<svg") == 3
    assert "<td>43 % (" in page and "sub-023" in page


@pytest.mark.usefixtures("known_places")
def test_intervals_are_nearly_those_of_the_former_trial(golden, expected):
    assert run(golden, "--derivatives", golden / "derivatives") == 0
    [own], other = report(golden)["lists"], expected["lists"][0]
    for part in ("shares", "chance"):
        for one, two in zip(own[part], other[part]):
            ends = [[[share["low"], share["high"]] for share in row["found"]] for row in (one, two)]
            # A step of six patients.
            assert np.abs(np.subtract(*ends)).max() < 0.06


def test_random_places_are_cortical_and_the_same_for_the_same_name(tmp_path):
    affine, size = grid((2.0, 2.0, 2.0))
    positions = nib.affines.apply_affine(affine, np.stack(np.indices(size), axis=-1))
    radius = np.linalg.norm(positions, axis=-1)
    depth = Volume(np.where(radius < 38, 38 - radius, np.nan), affine)
    # Layers of grey and of white matter, with a seam of 1 mm; the map ends on the left.
    layer = np.clip(np.abs(radius % 8 - 4) - 1.5, 0, 1)
    nib.save(nib.Nifti1Image((500 + 300 * layer).astype(np.int16), affine), tmp_path / "t1.nii.gz")
    blur = Volume(np.where(positions[..., 0] > -20, 1.0, np.nan), affine)
    plane = Plane(np.array([-1.0, 0, 0]), 0.0)
    places = cortical_places("sub-1", plane, depth, blur, tmp_path / "t1.nii.gz")
    assert len(places) == 200 and (places == cortical_places("sub-1", plane, depth, blur, tmp_path / "t1.nii.gz")).all()
    assert not (places == cortical_places("sub-2", plane, depth, blur, tmp_path / "t1.nii.gz")).all()
    from_centre = np.linalg.norm(places, axis=1)
    deep = 38 - from_centre
    assert deep.min() >= 4 and deep.max() < 28
    assert places[:, 0].min() > -20 and (np.abs(np.abs(from_centre % 8 - 4) - 2) <= 0.16).all()
    assert np.mean(deep >= 12) == pytest.approx(0.5, abs=0.1)
    in_front, below = places[:, 1] > 0.1 * 38, places[:, 2] < -0.3 * 38
    assert in_front.mean() == pytest.approx(0.6, abs=0.1) and not (below & ~in_front).any()


@pytest.mark.usefixtures("known_places")
def test_heads_that_cannot_be_judged_are_listed_with_the_reason(golden, capsys):
    bids, derivatives = golden / "bids", golden / "derivatives"
    rows = (bids / "participants.tsv").read_text()
    (bids / "participants.tsv").write_text(f"{rows}sub-090\tfcd\t1\ttest\ta\nsub-091\tfcd\t1\ttest\ta\n")
    os.rename(bids / "sub-005/anat/sub-005_roi.nii.gz", bids / "sub-020/anat/sub-020_roi.nii.gz")
    os.remove(bids / "sub-005/anat/sub-005_desc-two_roi.nii.gz")
    (bids / "sub-091/anat").mkdir(parents=True)
    (bids / "sub-091/anat/sub-091_roi.nii.gz").touch()
    (bids / "sub-092").mkdir()
    (bids / "sub-007/anat/sub-007_roi.nii.gz").write_bytes(b"no NIfTI")
    empty = bids / "sub-010/anat/sub-010_roi.nii.gz"
    for path in empty.parent.glob("*_roi.nii.gz"):
        path.unlink()
    nib.save(nib.Nifti1Image(np.zeros((4, 4, 4), np.uint8), np.eye(4)), empty)
    facts = derivatives / "sub-012/anat/sub-012_desc-brain_mask.json"
    about = json.loads(facts.read_text())
    about["Maps"] = {"State": "undefined", "Code": "too-coarse", "Reason": "its voxels are too coarse"}
    facts.write_text(json.dumps(about))
    # Nothing could be found there, with maps or without.
    (derivatives / "sub-010/anat/sub-010_desc-brain_mask.json").write_text(json.dumps(about))
    os.remove(derivatives / "sub-018/anat/sub-018_desc-brain_mask.json")
    os.remove(derivatives / "sub-023/anat/sub-023_desc-places.tsv")
    summary = (derivatives / "summary.tsv").read_text()
    summary = re.sub("(?m)^sub-018\t.*", "sub-018\trefused\tit has four axes\t1", summary)
    (derivatives / "summary.tsv").write_text(summary)

    assert run(golden, "--derivatives", derivatives) == 0
    reasons = {row["head"]: row["reason"] for row in report(golden)["left_out"]}
    assert reasons.pop("sub-007").startswith("patient without a truth: ")
    assert "is damaged" in reasons.pop("sub-023")
    assert reasons == {
        "sub-005": "patient without a truth",
        "sub-010": "patient without a truth: its truth has no voxel",
        "sub-012": "patient without maps (too-coarse): its voxels are too coarse",
        "sub-018": "control without maps: it has four axes",
        "sub-020": "control with a truth",
        "sub-090": "in the table of participants, but without a folder",
        "sub-091": "patient without a T1-weighted volume (*_T1w.nii.gz)",
        "sub-092": "it is not in the table of participants",
    }
    [found] = report(golden)["lists"]
    patients = [row["patients"] for row in found["shares"]]
    # One patient without maps counts as missed; of those without a truth, nobody knows what there was to be found.
    assert patients == [2, 2, 3] and "7 heads" not in capsys.readouterr().out


@pytest.mark.usefixtures("known_places")
def test_a_truth_that_was_drawn_on_the_flair_moves_with_it(golden):
    keep(golden, "sub-012", "sub-018")
    anat, prefix = golden / "bids/sub-012/anat", golden / "derivatives/sub-012/anat/sub-012"
    run(golden, "--derivatives", golden / "derivatives")
    before = {row["head"]: row for row in report(golden)["heads"]}["sub-012"]["lesions"]
    # The FLAIR lies 100 mm to the right of the T1, the truth with it.
    image = nib.load(anat / "sub-012_roi.nii.gz")
    shift = np.eye(4)
    shift[0, 3] = 100
    nib.save(nib.Nifti1Image(image.dataobj, shift @ image.affine), anat / "sub-012_FLAIR_roi.nii.gz")
    os.remove(anat / "sub-012_roi.nii.gz")
    (anat / "sub-012_FLAIR.nii.gz").touch()

    def lesions_with(registered="sub-012_FLAIR.nii.gz", **facts):
        if facts:
            path = Path(f"{prefix}_from-FLAIR_to-T1w_mode-image_xfm.json")
            sources = ["bids:raw:sub-012/anat/sub-012_T1w.nii.gz", f"bids:raw:sub-012/anat/{registered}"]
            path.write_text(json.dumps({"Sources": sources, "Matrix": np.linalg.inv(shift).tolist(), **facts}))
        run(golden, "--derivatives", golden / "derivatives")
        return {row["head"]: row for row in report(golden)["heads"]}["sub-012"]["lesions"]

    def remarks():
        return [row["reason"] for row in report(golden)["remarks"] if row["head"] == "sub-012"]

    assert {lesion["truth"] for lesion in lesions_with()} == {"drawn on a FLAIR that is not registered"}
    assert any("lies where its header places it" in reason for reason in remarks())
    assert "registration in doubt" in lesions_with(Verdict="failed")[0]["truth"]
    found = lesions_with(Verdict="registered")
    assert {lesion.pop("truth") for lesion in found} == {"drawn on the FLAIR, registered"} and not remarks()
    for lesion, other in zip(found, before):
        del other["truth"]
        assert lesion.pop("false_marks") == other.pop("false_marks")
        assert lesion == pytest.approx(other, abs=1e-3)

    # There are two FLAIRs with other voxels, of which the second is registered: its name is most like that of the T1.
    (anat / "sub-012_FLAIR.nii.gz").unlink()
    mask, blank = anat / "sub-012_roi.nii.gz", np.zeros(image.shape, np.uint8)
    (anat / "sub-012_FLAIR_roi.nii.gz").rename(mask)
    nib.save(nib.Nifti1Image(blank, image.affine), anat / "sub-012_T1w.nii.gz")
    nib.save(nib.Nifti1Image(blank, shift @ image.affine), anat / "sub-012_acq-á_FLAIR.nii.gz")
    nib.save(nib.Nifti1Image(blank[1:], shift @ image.affine), anat / "sub-012_acq-b_FLAIR.nii.gz")
    for registered, place in {"acq-%C3%A1": "registered", "acq-b": "that is not registered"}.items():
        found = lesions_with(f"sub-012_{registered}_FLAIR.nii.gz", Verdict="registered")
        assert place in found[0]["truth"] and ("not" in place) == bool(remarks())
    for name, place in {"acq-á_FLAIR_roi": "that is not registered", "acq-b_FLAIR_roi": ", registered"}.items():
        mask = mask.rename(anat / f"sub-012_{name}.nii.gz")
        assert place in lesions_with()[0]["truth"]


@pytest.mark.usefixtures("known_places")
def test_the_masks_of_ideas_lie_in_a_folder_of_their_own(golden):
    keep(golden, "sub-002", "sub-018")
    for name in ("2/2_MaskInOrig.nii.gz", "18/note.txt"):
        (golden / "bids/masks" / name).parent.mkdir(parents=True)
    (golden / "bids/sub-002/anat/sub-002_roi.nii.gz").rename(golden / "bids/masks/2/2_MaskInOrig.nii.gz")
    words = [golden / "bids", "--like", "ideas", "--no-controls", "--derivatives", golden / "derivatives"]
    assert trial.main([*map(str, words), "--results", str(golden / "results")]) == 0
    found = report(golden)
    assert (found["patients"], found["controls"]) == (1, 0)
    assert {"head": "sub-018", "reason": "it is neither a patient nor a control"} in found["left_out"]
    [list] = found["lists"]
    assert list["area"] is None and [row["name"] for row in list["thresholds"]] == [name for name, _ in trial.LIMITS]
    assert "There are no controls" in (golden / "results/report.html").read_text()


STAND_IN = """#!{python}
import shutil, sys
assert sys.argv[1] == "bids" and sys.argv[4] == "participant"
shutil.copytree("{derivatives}", sys.argv[3], dirs_exist_ok=True)
"""


@pytest.fixture
def stand_in(golden, monkeypatch):
    """A program whose heads are those of the golden folder."""
    program = golden / "isocortex"
    program.write_text(STAND_IN.format(python=sys.executable, derivatives=golden / "derivatives"))
    program.chmod(0o755)
    monkeypatch.setenv("ISOCORTEX_BINARY", str(program))
    return program


@pytest.mark.usefixtures("known_places")
def test_a_locked_trial_is_refused_if_anything_has_changed(golden, stand_in, capsys):
    keep(golden, "sub-002", "sub-005", "sub-018")

    def refused(*words, more=(), results="results"):
        assert run(golden, *more, results=results) == 2
        errors = capsys.readouterr().err
        assert all(word in errors for word in words), errors

    assert run(golden, "--freeze") == 0
    first = (golden / "results/report.json").read_bytes()
    frozen = json.loads((golden / "results/frozen.json").read_text())
    assert frozen["program"] in (golden / "results/report.html").read_text()
    assert run(golden) == 0 and (golden / "results/report.json").read_bytes() == first
    capsys.readouterr()
    refused("locked with other parameters: strata", more=["--stratum", "age"])
    refused("omit --derivatives", more=["--derivatives", golden / "derivatives"])
    (golden / "deepbet-0-py3-none-any.whl").touch()
    refused("locked with other parameters: network")
    os.remove(golden / "deepbet-0-py3-none-any.whl")
    truth = golden / "bids/sub-002/anat/sub-002_roi.nii.gz"
    before = truth.read_bytes()
    shutil.copy(golden / "bids/sub-005/anat/sub-005_roi.nii.gz", truth)
    refused("locked with other parameters: files")
    truth.write_bytes(before)
    table = golden / "bids/participants.tsv"
    rows = table.read_text()
    table.write_text(f"{rows}sub-099\tfcd\t1\ttest\ta\n")
    refused("locked with other parameters: table of participants")
    table.write_text(rows)
    refused("locked with other parameters: marks of others", more=["--candidates-of", golden / "other.csv"])
    with stand_in.open("a") as program:
        program.write("# another one\n")
    refused("locked with another program")
    assert run(golden, results="other") == 0
    refused("--freeze comes too late", more=["--freeze"], results="other")
    # A lock that was interrupted is no result.
    (golden / "cut").mkdir()
    (golden / "cut/frozen.json.part").write_text("{")
    assert run(golden, "--freeze", "--candidates-of", golden / "other.csv", results="cut") == 0
    assert sorted(path.name for path in (golden / "cut").iterdir() if path.is_file()) == [
        "frozen.json",
        "report.html",
        "report.json",
    ]
    with (golden / "other.csv").open("a") as marks:
        marks.write("sub-002,1,2,3,4\n")
    more = ["--candidates-of", golden / "other.csv"]
    refused("locked with other parameters: marks of others", more=more, results="cut")


def test_a_trial_ends_with_the_words_of_a_program_that_could_not_begin(golden, stand_in, capfd):
    for status in (65, 66):
        stand_in.write_text(f"#!/bin/sh\necho 'error: there is no head' >&2\nexit {status}\n")
        assert run(golden) == 2
        first, last = capfd.readouterr().err.splitlines()
        assert first == "error: there is no head" and f"ended with the status {status}" in last


@pytest.mark.usefixtures("known_places")
def test_a_place_that_cannot_be_written_is_an_error(golden, capsys):
    (golden / "file").touch()
    (golden / "results/report.html.part").mkdir(parents=True)
    for results in ("file", "results"):
        assert run(golden, "--derivatives", golden / "derivatives", results=results) == 2
        assert f"{golden / results}" in capsys.readouterr().err


def test_a_folder_without_what_a_trial_needs_is_refused_before_any_work(tmp_path, capsys):
    def refused(*words, more=()):
        with pytest.raises(SystemExit) if "argument" in words[0] else contextlib.nullcontext():
            assert trial.main([str(tmp_path / "bids"), "--results", str(tmp_path / "results"), *more]) == 2
        errors = capsys.readouterr().err
        assert all(word in errors for word in words), errors

    def touch(name, text=""):
        (tmp_path / "bids" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "bids" / name).write_text(text)

    refused("cannot be read")
    (tmp_path / "bids").mkdir()
    refused("no folder sub-*")
    touch("sub-1/anat/sub-1_T1w.nii.gz")
    refused("no patient with a truth", "--truth")
    touch("sub-1/anat/sub-1_roi.nii.gz")
    touch("sub-2/anat/sub-2_T1w.nii.gz")
    refused("no control", "--no-controls", "sub-2: it is neither")
    refused('"group"', "--participants", more=["--like", "bonn"])
    touch("participants.tsv", "participant_id\tage\nsub-1\t3\n")
    refused('no column "group"', "participant_id, age", more=["--like", "bonn"])
    refused("argument --jobs: must be between 1 and 64", more=["--jobs", "0"])
    refused("argument --patients", "COLUMN=VALUE", more=["--patients", "fcd"])
    assert not (tmp_path / "results").exists()


@pytest.mark.usefixtures("known_places")
def test_marks_of_another_program_are_refused_if_they_are_no_numbers(golden, capsys):
    marks = golden / "marks.csv"
    for text, words in {
        "participant_id,x,y,score\nsub-2,1,2,3\n": 'no column "z"',
        "participant_id,x,y,z,score\nsub-2,1,2,3,much\n": "row 2 of",
        "participant_id,x,y,z,score\nsub-2,1,2,nan,1\n": "z must be a number",
        "participant_id,x,y,z,score\nsub-99,1,2,3,1\n": "no mark in any head",
    }.items():
        marks.write_text(text)
        assert run(golden, "--derivatives", golden / "derivatives", "--candidates-of", marks) == 2
        assert words in capsys.readouterr().err


HELP = subprocess.run([os.environ["ISOCORTEX_BINARY"], "bids", "--help"], capture_output=True, check=False)


@pytest.mark.skipif(HELP.returncode != 0, reason="the program has no command `bids` yet")
def test_the_program_prepares_the_heads_of_a_trial(folder, tmp_path):
    head = nib.load(folder / "head.nii.gz")
    stripped = np.asarray(head.dataobj) * np.asarray(nib.load(folder / "brain.nii.gz").dataobj)
    for name, voxels in {"sub-1": stripped, "sub-2": stripped[:, ::-1]}.items():
        anat = tmp_path / "bids" / name / "anat"
        anat.mkdir(parents=True)
        nib.save(nib.Nifti1Image(voxels, head.affine), anat / f"{name}_T1w.nii.gz")
    (tmp_path / "bids/sub-3/anat").mkdir(parents=True)
    (tmp_path / "bids/sub-3/anat/sub-3_T1w.nii.gz").write_bytes(b"no NIfTI")
    # Behind on the left.
    centre = np.array([-38.0, -30, 10])
    truth = ball(head.affine, head.shape, (centre, 9.0))
    nib.save(nib.Nifti1Image(truth.data, truth.affine), tmp_path / "bids/sub-1/anat/sub-1_roi.nii.gz")
    (tmp_path / "bids/participants.tsv").write_text("participant_id\tgroup\nsub-1\tfcd\nsub-2\thc\nsub-3\thc\n")
    marks = tmp_path / "marks.csv"
    marks.write_text("participant_id,x,y,z,score\n1,38,-30,10,3\n1,-38,-30,12,2\n")
    results = tmp_path / "results"
    words = [tmp_path / "bids", "--patients", "group=fcd", "--controls", "group=hc", "--candidates-of", marks]
    words += ["--results", results, "--freeze"]
    assert trial.main(list(map(str, words))) == 0
    found = json.loads((results / "report.json").read_text())
    assert [row["head"] for row in found["left_out"]] == ["sub-3"]
    [lesion] = found["heads"][0]["lesions"]
    assert lesion["side"] == "left" and lesion["volume_ml"] == pytest.approx(3.05, abs=0.2)
    assert 5 < lesion["depth_mm"] < 40 and 0.1 < lesion["defined_share"] < 1
    # The mark on the right is false, and a hit only by chance.
    assert lesion["false_marks"][1] == 1
    own, other = found["lists"]
    assert other["chance"][0]["found"][0]["value"] == 1.0 and own["chance"][1]["lesions"] == 1
    assert len(own["thresholds"]) == 5 and own["area"]["value"] in (0.0, 0.5, 1.0)
    about = json.loads((results / "derivatives/dataset_description.json").read_text())
    assert found["version"] == about["GeneratedBy"][0]["Version"]


def test_a_scan_that_lies_elsewhere_repeats_all_places_of_the_first(folder, tmp_path, capsys):
    head, brain = nib.load(folder / "head.nii.gz"), nib.load(folder / "brain.nii.gz")
    stripped = np.asarray(head.dataobj) * np.asarray(brain.dataobj)
    elsewhere = np.eye(4)
    elsewhere[:3, 3] = (4, -3, 5)
    anat = tmp_path / "sub-1/anat"
    anat.mkdir(parents=True)
    nib.save(nib.Nifti1Image(stripped, head.affine), anat / "sub-1_run-1_T1w.nii.gz")
    nib.save(nib.Nifti1Image(stripped, elsewhere @ head.affine), anat / "sub-1_run-2_T1w.nii.gz")
    assert repeat.main([str(tmp_path), "--json"]) == 0
    [found] = json.loads(capsys.readouterr().out)
    assert (found["head"], found["placement"], found["of_first"]) == ("sub-1", "registered", [1.0, 1.0, 1.0])
    assert found["by_chance"][1] < 1 and found["unusual"] == [0, 0] and found["of_unusual"] is None


def test_scans_that_cannot_be_compared_are_stated(tmp_path, capsys):
    (tmp_path / "sub-1/anat").mkdir(parents=True)
    one = tmp_path / "sub-1/anat/sub-1_T1w.nii.gz"
    one.write_bytes(b"no NIfTI")
    assert repeat.main([str(tmp_path)]) == 2
    assert "no head in" in capsys.readouterr().err
    assert repeat.main(["--pair", str(one), str(one)]) == 0
    assert "| anat/sub-1_T1w.nii.gz | sub-1_T1w.nii.gz | the first scan has no maps: " in capsys.readouterr().out


def test_one_pair_that_fails_leaves_the_others(folder, tmp_path, capsys, monkeypatch):
    head, brain = nib.load(folder / "head.nii.gz"), nib.load(folder / "brain.nii.gz")
    image = nib.Nifti1Image(np.asarray(head.dataobj) * np.asarray(brain.dataobj), head.affine)
    for person in ("sub-1", "sub-2"):
        (tmp_path / person / "anat").mkdir(parents=True)
        for number in (1, 2):
            nib.save(image, tmp_path / person / f"anat/{person}_run-{number}_T1w.nii.gz")
    add_layer = Case.add_layer

    def refusing(case, volume, name):
        if "sub-2" in volume.name:
            raise IsocortexError("too many layers")
        return add_layer(case, volume, name)

    monkeypatch.setattr(Case, "add_layer", refusing)
    deleted = []
    delete = Case.delete
    monkeypatch.setattr(Case, "delete", lambda case: (deleted.append(case.id), delete(case)))
    assert repeat.main([str(tmp_path), "--json"]) == 0
    one, two = json.loads(capsys.readouterr().out)
    assert one["of_first"] == [1.0, 1.0, 1.0] and two["of_first"] is None
    assert two["placement"] == "the second scan cannot be brought to the first: too many layers"
    # Both files of a pair are one case.
    assert len(deleted) == 2
