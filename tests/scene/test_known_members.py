"""A member that is not known, a new table of a scene or a new signal, is refused and never taken for another."""

from pathlib import Path
from typing import Any

import pytest

from granular_lmp import Scene
from granular_lmp.accuracy.ladder import build, deciding_frequency
from granular_lmp.effects.between_looks import fastest
from granular_lmp.errors import SceneError
from granular_lmp.lammps.deck import deck_of
from granular_lmp.lammps.sources import FORMULAS
from granular_lmp.problem import prepare
from granular_lmp.rest.absorption import waves_at_ends
from granular_lmp.scene.monitors import placed_monitors
from granular_lmp.scene.signals import SIGNALS, Signal
from granular_lmp.scene.sources import Source
from granular_lmp.studies import forecast
from tests.conftest import members

INPUTS = Path(__file__).parents[2] / "lammps_inputs"
SCENES = sorted(path.parent.name for path in INPUTS.glob("**/scene.toml"))


# ---------------------------------------------------------------- the cell that stands for a large crystal


@pytest.fixture
def small_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every crystal is a large one, of which a cell of 12 rows and columns is built, and not run."""

    def built(scene: Any, kernel: bool = False) -> tuple[float, float]:
        assert scene.shape.spheres <= 144 * scene.shape.layers
        build(scene)
        return 1e6, 0.01

    monkeypatch.setattr(forecast, "_LARGEST", 10)
    monkeypatch.setattr(forecast, "_CELL", 12)
    monkeypatch.setattr(forecast, "speed", built)


# Similar scenes are shipped too
MORE = ("tr_burst_scattering", "tr_impurity", "tr_grating", "tr_resonant", "tr_antiresonant", "struck_sheet")
MORE += ("point_source", "monolayer_vertical")


@pytest.mark.parametrize("name", members(SCENES, *MORE))
def test_each_shipped_scene_has_a_cell_that_stands_for_it(name: str, small_cells: None) -> None:
    assert forecast.forecast(build(Scene.load(name)).problem).seconds is not None


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("tr_burst_scattering", {}),  # quiet ends, which a periodic cell has not
        ("tr_nonresonant", {"wave.wavenumber": 0.01, "packing.rows": 201}),  # longer than the cell
        ("tr_impurity", {"packing.rows": 120, "inclusion.1.spheres": [[110, 5]]}),  # a place that the cell has not
        ("tr_nonresonant", {"wave.direction": "x", "packing.ends": "periodic", "packing.rows": 100}),
    ],
    ids=str,
)
def test_a_large_scene_is_forecast_by_a_cell_that_is_a_valid_scene(name: str, changes: dict[str, Any]) -> None:
    problem = prepare(Scene.load(name).with_values(changes | {"packing.columns": 210}))
    assert forecast._small(problem).shape.spheres == 10_000
    assert forecast._small(problem).effects == problem.scene.effects


# ---------------------------------------------------------------- studies


def test_an_effect_that_the_record_of_contacts_does_not_know_is_refused_by_name() -> None:
    scene = Scene.load("two_tones").with_values({"monitor": [{"name": "line", "rows": [9, 9], "what": "flux"}]})
    problem = prepare(scene)
    with pytest.raises(SceneError, match=r'what = "flux": must be "motion".* with the effect capillary'):
        placed_monitors(scene.monitor, problem.rest.atoms, scene.shape, None, ["capillary"])


# ---------------------------------------------------------------- signals


SHAKEN = Scene.load("two_tones").with_values({"time.timestep": 0.05, "absorb.rows": 0, "time.allow_echo": True})


@pytest.fixture
def trill(monkeypatch: pytest.MonkeyPatch) -> Source:
    """A source with a signal that somebody has declared: up to 3 Ω, and down to 0; it has no formula in a deck yet."""
    lasts = SIGNALS["tone"].lasts
    monkeypatch.setitem(SIGNALS, "trill", Signal(("frequency",), lasts, lambda source: 3.0, lambda source: (), None))
    rule = Source.__dataclass_fields__["signal"].metadata["rule"]
    monkeypatch.setitem(vars(rule), "words", (*rule.words, "trill"))
    return Source(rows=(20, 20), force="x", signal="trill", frequency=0.5)


def with_source(source: Source, **changes: Any) -> Scene:
    table = {"rows": list(source.rows), "force": source.force, "signal": source.signal, "frequency": source.frequency}
    return SHAKEN.with_values({"source": [table], **changes})


def test_every_signal_that_is_declared_has_a_formula_in_the_deck() -> None:
    assert FORMULAS.keys() == SIGNALS.keys()


def test_a_new_signal_without_a_formula_is_refused_by_name(trill: Source) -> None:
    problem = prepare(with_source(trill))
    with pytest.raises(SceneError, match='signal = "trill": has no formula in a deck; must be one of tone, burst'):
        deck_of(problem)


def test_steps_and_looks_resolve_the_top_of_a_new_signal_and_not_its_centre(trill: Source) -> None:
    tone = Source(rows=(20, 20), force="x", signal="tone", frequency=0.5)
    for highest in (fastest, lambda scene: deciding_frequency(prepare(scene))):
        of_trill, of_tone = (highest(with_source(each, **{"wave.wavenumber": 0.1})) for each in (trill, tone))
        assert of_trill == pytest.approx(3 * of_tone)
    with pytest.raises(SceneError, match=r"fewer than 20 steps at its frequency of 1\.5 rad per t0"):
        prepare(with_source(trill, **{"time.timestep": 0.25}))
    prepare(with_source(tone, **{"time.timestep": 0.25}))


def test_a_new_signal_that_reaches_down_to_zero_has_no_quiet_ends(trill: Source) -> None:
    with pytest.raises(SceneError, match='signal = "trill": must be "tone" or "burst" or "chirp" with absorb'):
        with_source(trill, **{"packing.ends": "fixed", "absorb.rows": "auto"})


def test_quiet_ends_take_the_band_of_a_new_signal(trill: Source, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(
        SIGNALS,
        "trill",
        Signal(("frequency",), SIGNALS["tone"].lasts, lambda source: 1.5, lambda source: (0.5, 1.5), None),
    )
    found = waves_at_ends(with_source(trill))
    assert {round(wave.frequency, 6) for wave in found} == {0.25, 0.75}
