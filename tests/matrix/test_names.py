"""Names that users import, and a script that one of them wrote, stay what they are."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import Scene, run
from tests.house.test_independence import imports
from tests.matrix.names import CHANGELOG, at, gone, listed, public_names

SCRIPT = Path(__file__).with_name("ten_lines.py")


def test_no_name_goes_without_a_word_in_the_changelog() -> None:
    assert not gone(listed(), public_names(), CHANGELOG.read_text("utf-8"))


def test_every_listed_name_is_there() -> None:
    """The list itself is of names that can be imported, and not of what was once found in a text."""
    for name in (
        "granular_lmp.Scene.with_values",
        "granular_analysis.second_harmonic.ratios",
        "granular_lmp.runs.record.Record",
    ):
        assert name in listed()
        assert at(name)
    assert len(listed()) > 500


def test_a_name_that_is_gone_is_noticed_unless_the_changelog_says_it() -> None:
    held, now = {"a.b.kept", "a.b.lost"}, {"a.b.kept", "a.b.new"}
    text = "# Changelog\n\n## Unreleased\n- {}\n\n## 0.1\n- `lost` is new\n"
    assert gone(held, now, text.format("nothing")) == {"a.b.lost"}
    assert not gone(held, now, text.format("`lost` is gone: take `new`"))
    assert not gone(held, now, text.format("`a.b.lost` is gone"))


def test_the_script_of_a_user_reads_a_run_with_numpy_and_the_closed_form(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert {name.partition(".")[0] for name in imports(SCRIPT.read_text("utf-8"))} == {"sys", "numpy", "analysis"}
    scene = Scene.load("tr_periodic").with_values({"time.duration": 40.0})
    run(scene, tmp_path / "run")
    words = [str(tmp_path / "run"), *map(repr, (scene.wavenumber, scene.wave.amplitude, scene.sphere.poisson_ratio))]
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), *words])
    found = runpy.run_path(str(SCRIPT))
    # Third order and the time step leave 2e-3 at this amplitude; another mode or wave number is off by 0.1 and more
    assert found["error"] < 5e-3
    assert np.abs(found["p"]).max() > 1e-3
    # The deck is in nm; a number that is divided by D0 and multiplied again is rounded twice, to 1e-16
    moved = scene.displacement_amplitude * 1e9
    np.testing.assert_allclose(found["dump"]["ux"], -moved * found["q"], rtol=1e-14)
    np.testing.assert_allclose(found["dump"]["uy"], moved * found["p"], rtol=1e-14)
    assert found["tau"][-1] == 40.0
    assert np.isfinite(found["phi"]).all()
