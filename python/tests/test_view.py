"""The widget of notebooks, as its browser sees it: traits and messages. `tests/browser/widget.test.ts` draws it."""

import sys

import numpy as np
import pytest
import traitlets

import isocortex as iso


class Browser:
    """What a browser sends to a widget, and what it gets."""

    def __init__(self, view):
        self.view, self.answers = view, []
        view.send = lambda content, buffers: self.answers.append((content, buffers))

    def ask(self, path, accept="*/*"):
        self.view._handle_custom_msg({"ask": len(self.answers), "path": path, "accept": accept}, [])
        content, [body] = self.answers[-1]
        assert content["answer"] == len(self.answers) - 1
        return content["status"], content["headers"], body


@pytest.fixture
def view(case):
    return iso.View(case, depth_mm=8, view="right")


def test_python_sets_and_watches_the_traits(view, case):
    assert (view.case_id, view.depth_mm, view.view, view.surface, view.overlay) == (
        case.id,
        8.0,
        "right",
        "whole",
        None,
    )
    heard = []
    view.observe(lambda change: heard.append((change.name, change.new)), ["depth_mm", "view"])
    view.depth_mm = 12
    # As a slider and a hand that turns the head do.
    view.set_state({"depth_mm": 20.5})
    view.set_state({"view": None})
    assert heard == [("depth_mm", 12.0), ("depth_mm", 20.5), ("view", None)]
    view.depth_mm = 500
    # As exact as the page.
    assert 0 <= case.max_depth_mm - view.depth_mm < 0.01
    view.overlay, view.surface = "blur", "left"
    # The notebook keeps no facts of the head, and no token.
    state = {name: value for name, value in view.get_state().items() if name != "_esm"}
    assert case._connection.token not in str(state) and "voxels" not in str(state)


@pytest.mark.parametrize(
    ("trait", "value", "words"),
    [
        ("depth_mm", -1, "a depth is 0 mm or more, not -1"),
        ("depth_mm", float("nan"), "not nan"),
        ("view", "lleft", "lleft"),
        ("surface", "half", "half"),
        ("overlay", "bluur", "there is no layer 'bluur'; those of this case are blur"),
        ("case_id", "0", "read-only"),
    ],
)
def test_a_value_that_cannot_be_shown_is_an_error(view, trait, value, words):
    with pytest.raises(traitlets.TraitError, match=words):
        setattr(view, trait, value)


def test_the_answers_of_the_server_come_through_python(view, case):
    browser = Browser(view)
    status, headers, body = browser.ask(f"v1/cases/{case.id}/mesh?depth_mm=8&contours=100&points=100")
    assert status == 200 and headers["x-isocortex-depth-mm"] == "8"
    positions = np.frombuffer(body, "<f4").reshape(-1, 3) * (-1, -1, 1)
    np.testing.assert_allclose(positions, case.mesh(8.0).coordinates, atol=1e-4)
    status, headers, body = browser.ask(f"v1/cases/{case.id}/render?depth_mm=8", "image/png")
    assert headers["content-type"] == "image/png" and bytes(body).startswith(b"\x89PNG")
    status, headers, body = browser.ask(f"v1/cases/{case.id}/layers/nothing/volume")
    assert status == 404 and headers["content-type"] == "application/problem+json" and b"no-such-layer" in body


@pytest.mark.parametrize(
    "path", ["v1/cases", "v1/cases/{other}", "v1/cases/{id}/../{other}", "metrics", "https://isocortex.example"]
)
def test_the_browser_reaches_this_case_alone(view, case, path):
    browser = Browser(view)
    assert browser.ask(path.format(id=case.id, other="0" * 32))[0] == 403
    view._handle_custom_msg("a message of somebody else", [])
    assert len(browser.answers) == 1


def test_a_server_that_is_gone_is_an_answer_too(folder):
    with iso.start() as server, pytest.warns(UserWarning, match="look at the brain mask"):
        case = server.open("head.nii.gz", mask="brain.nii.gz")
        view = iso.View(case)
    status, _, body = Browser(view).ask(f"v1/cases/{case.id}")
    assert status == 502 and b"was closed; open the head again" in body


def test_the_widget_is_the_only_thing_that_needs_its_package(case, monkeypatch):
    monkeypatch.delitem(sys.modules, "isocortex._view", raising=False)
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(ImportError, match=r"iso\.View needs anywidget: pip install 'isocortex\[anywidget\]'"):
        iso.View(case)
    assert not hasattr(iso, "Viewer")
