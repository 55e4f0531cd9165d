"""The examples of the documentation run, and the package has the version of the program."""

import re
from pathlib import Path

import isocortex as iso

ROOT = Path(iso.__file__).parents[2]


def test_the_examples_of_the_documentation_run(folder, monkeypatch):
    monkeypatch.setenv("HOME", str(folder))
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / "docs/python.md").read_text(), re.DOTALL | re.MULTILINE)
    assert len(blocks) > 3
    names = {}
    for block in blocks:
        exec(compile(block, "docs/python.md", "exec"), names)
    assert (folder / "left.png").exists() and (folder / "report.html").exists()


def test_the_version_is_that_of_the_program():
    [package] = re.findall('^version = "(.*)"$', (ROOT / "python/pyproject.toml").read_text(), re.MULTILINE)
    assert f'\nversion = "{package}"\n' in (ROOT / "Cargo.toml").read_text()
