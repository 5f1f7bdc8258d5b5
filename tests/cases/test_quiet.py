"""The figure of quiet ends: what is read off a run, and what is drawn beside it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cases.quiet import case as reflection
from granular_lmp import Scene
from granular_lmp.crystal.quiet_ends import reflection as lattice
from granular_lmp.rest.absorption import quiet_end_of
from granular_lmp.rest.linear import mode_of, unit_contacts

SCENE = Scene.load("tr_driven").with_values(
    {"packing.rows": 41, "absorb.rows": 10, "absorb.reflection": 0.5, "wave.wavenumber": 1.0, "envelope.ramp": 20.0}
)


def stand_in(scene: Scene, share: float, *, shift: float = 0.0, duration: float = 200.0) -> Any:
    """A run whose late rows are a wave and a share of it that comes back, as `measured` reads them."""
    scene = scene.with_values({"time.duration": duration})
    tau, n = np.arange(0, duration + 1.0, 2.0), np.arange(41)
    xi = scene.wavenumber + shift
    wave = np.exp(1j * xi * n) + share * np.exp(-1j * xi * n + 0.7j)
    field = np.zeros((len(tau), 41 * 3, 2))
    field[..., 0] = np.repeat((wave * np.exp(-1j * mode_of(scene).frequency * tau[:, None])).real, 3, axis=1)
    snapshots = SimpleNamespace(tau=tau, stack=lambda name: field)
    return SimpleNamespace(scene=scene, snapshots=lambda: snapshots, folder="run")


@pytest.mark.parametrize("share", [0.3, 1e-3, 40.0])
def test_the_smaller_of_two_waves_over_the_larger_is_the_reflection(share: float) -> None:
    found = reflection.measured(stand_in(SCENE, share, shift=2e-3))  # of a time step
    assert found == pytest.approx(min(share, 1 / share), rel=1e-4)  # the minimum over ξ is found to 1e-9


def test_theory_is_that_of_the_step() -> None:
    scene = SCENE.with_values({"wave.mode": "RT"})
    end = quiet_end_of(scene)
    assert end is not None
    at_zero = lattice(unit_contacts(scene), scene.sphere, mode_of(scene), end)
    found = [reflection.expected(scene.with_values({"time.timestep": step})) for step in (1e-3, 0.25)]
    assert found[0] == pytest.approx(at_zero, rel=1e-3)  # second order: 6e4 times less than at 0.25
    assert abs(found[1] / at_zero - 1) > 0.1


def test_runs_that_show_no_reflection_are_refused() -> None:
    with pytest.raises(ValueError, match="13 late snapshots of 18 rows: must be at least 20 of 8"):
        reflection.measured(stand_in(SCENE, 0.1, duration=100.0))
    with pytest.raises(ValueError, match='must have wave.form = "driven" and absorb.rows'):
        reflection.expected(Scene.load("tr_driven"))


def test_the_figure_has_a_panel_a_mode_and_a_mark_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = [stand_in(SCENE.with_values({"time.timestep": step}), 0.01) for step in (0.05, 0.025)]
    monkeypatch.setattr(reflection, "THICKNESSES", (4, 10))
    panels = reflection.draw(runs, wavenumbers=(1.0, 1.5)).axes
    assert [panel.get_title() for panel in panels] == [
        f"{reflection._TITLES[name]}\n({name})" for name in ("L", "TR", "RT")
    ]
    assert [len(panel.lines) for panel in panels] == [2, 6, 2]  # two lines; a ring and a dot of each run
    assert len(reflection.table(runs).splitlines()) == 2 + len(runs)
    with pytest.raises(ValueError, match="no run is finished"):
        reflection.table([])
