"""Claims about the forms of a wave that hold for each that is declared (`granular_lmp.scene.forms`)."""

from math import pi
from pathlib import Path

import pytest

from granular_lmp import Scene, run
from granular_lmp.rest.linear import mode_of
from granular_lmp.scene.forms import FORMS

FILLING = [name for name, form in FORMS.items() if form.fills]
SAMPLES = 16  # of a period
PAPER = Scene.load("tr_periodic").with_values({"wave.amplitude": 1e-3, "time.timestep": 0.02})
SAMPLE = 2 * pi / mode_of(PAPER).frequency / SAMPLES
WATCHED = PAPER.with_values(
    {
        "time.sample": SAMPLE,
        "time.duration": SAMPLES * SAMPLE,
        "monitor": [{"name": "line", "rows": [4, 4], "what": "flux"}],
    }
)


def mean_flux(scene: Scene, folder: Path) -> float:
    """Return the mean over one period, of a flux that has the frequencies 0 and 2Ω."""
    return float(run(scene, folder).monitor("line").flux[:SAMPLES].mean())


@pytest.fixture(scope="module")
def flux_of_the_running_wave(tmp_path_factory: pytest.TempPathFactory) -> float:
    return mean_flux(WATCHED, tmp_path_factory.mktemp("forms") / "running")


@pytest.mark.parametrize("name", FILLING)
def test_the_flux_is_that_of_the_wave_less_that_of_its_time_reversal(
    name: str, flux_of_the_running_wave: float, tmp_path: Path
) -> None:
    """A flux goes as the square of an amplitude. The step shifts Ω by 1e-5, and the mean by about as much."""
    form = FORMS[name]
    found = mean_flux(WATCHED.with_values({"wave.form": name}), tmp_path / "run") / flux_of_the_running_wave
    assert found == pytest.approx(form.forward**2 - form.backward**2, abs=1e-3)


@pytest.mark.parametrize("name", FORMS)
def test_a_form_fills_drives_or_leaves_the_crystal_at_rest(name: str) -> None:
    form = FORMS[name]
    assert form.fills + form.driven <= 1
    assert form.waves == (form.fills or form.driven)
    assert form.fills == bool(form.displacement or form.velocity)
