"""Spheres that can no longer affect the record leave the run, and the record does not show it."""

from collections.abc import Callable
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp import Deck, Scene, build, run
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.outputs import DUMP, LOG, MONITOR, read_log
from granular_lmp.lammps.region_of_influence import leave, mean_count
from granular_lmp.problem import prepare
from granular_lmp.runs.options import core_count
from granular_lmp.runs.record import Record
from tests.conftest import kernel_lacks, members
from tests.instance import run_deck
from tests.pause import as_if_killed

# Of the largest displacement, or velocity: what docs/how-long.md says
CHANGE = 1e-9
USUAL = {"packing.rows": "auto", "packing.ends": "fixed", "time.duration": 50.0, "time.timestep": 1 / 6}
STRIP = Scene.load("tr_nonresonant").with_values(USUAL)
CELL = {"packing.rows": 60, "packing.columns": 60, "packing.ends": "periodic", "wave.wavenumber": pi / 2}
MONITORS = [{"name": "behind", "rows": [58, 60], "what": "flux"}, {"name": "one", "spheres": [[90, 1]]}]
SOURCE = {"rows": [20, 20], "force": "x", "ramp": 5.0, "frequency": 0.4}
SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "strip": ("tr_nonresonant", {}),
    "rotation": ("tr_nonresonant", {"wave.mode": "RT", "wave.wavenumber": 0.11, "wave.form": "standing"}),
    "coarse steps": ("tr_nonresonant", {"wave.mode": "L", "wave.wavenumber": 0.29, "time.timestep": 0.5}),
    "square": ("tr_nonresonant", {"packing.lattice": "square", "wave.mode": "L"}),
    "fcc": ("fcc_transverse", {"output.particles": 0.0, "time.duration": 20.0}),
    "beam": ("tr_nonresonant", CELL | {"envelope.width": 4.0, "time.duration": 25.0}),
    "unequal": (
        "tr_nonresonant",
        {"packing.rows": 81, "packing.columns": 6, "disorder.density": 0.2, "time.allow_echo": True},
    ),
    "wide": (
        "tr_nonresonant",
        {"packing.columns": 40, "wave.mode": "L", "wave.wavenumber": 2.0, "wave.amplitude": 0.3, "time.duration": 25.0},
    ),
    "source": (
        "tr_nonresonant",
        {"packing.rows": 81, "wave.form": "none", "time.allow_echo": True, "source": [SOURCE]},
    ),
    "monitors": ("tr_nonresonant", {"packing.rows": 151, "monitor": MONITORS}),
    "at an end and a source": (
        "tr_nonresonant",
        {
            "packing.rows": 151,
            "wave.form": "none",
            "time.allow_echo": True,
            "source": [SOURCE],
            "monitor": [{"name": "end", "rows": [1, 1]}, {"name": "source", "rows": [21, 21]}],
        },
    ),
    "beside a beam": (
        "tr_nonresonant",
        CELL
        | {
            "envelope.width": 4.0,
            "time.duration": 20.0,
            "monitor": [{"name": "one", "spheres": [[34, 50]], "what": "contacts"}],
        },
    ),
}


def with_all(deck: Deck) -> Deck:
    """Return a deck whose spheres all stay."""
    return deck.edited(before={"record": "unfix gone"})


def spheres_at_the_end(folder: Path) -> int:
    return int((folder / LOG).read_text().rpartition(" steps with ")[2].split()[0])


def change(one: Record, other: Record) -> float:
    """Return the largest change of a displacement or velocity over the largest of its kind, monitors too."""
    names = [each.name for each in one.scene.monitor]
    motions = [(one, other), *((one.monitor(name), other.monitor(name)) for name in names)]
    pairs = [pair for a, b in motions for pair in ((a.displacement, b.displacement), (a.velocity, b.velocity))]
    return max(float(np.abs(a - b).max() / np.abs(a).max()) for a, b in pairs)


@pytest.mark.parametrize(
    "name",
    members(SCENES, "strip", "rotation", "source", "beam", "wide", "at an end and a source", "beside a beam"),
)
def test_the_record_does_not_show_that_spheres_leave(name: str, tmp_path: Path) -> None:
    base, changes = SCENES[name]
    deck = build(Scene.load(base).with_values(USUAL | changes))
    whole, left = run(with_all(deck), tmp_path / "whole"), run(deck, tmp_path / "left")
    assert spheres_at_the_end(tmp_path / "whole") == len(deck.packing) > 1.5 * spheres_at_the_end(tmp_path / "left")
    assert change(whole, left) < CHANGE


@pytest.mark.skipif(bool(kernel_lacks()), reason=kernel_lacks())
def test_nor_with_the_kernel(kernel: Path, tmp_path: Path) -> None:
    deck = build(STRIP)
    whole, left = (run(each, tmp_path / name, kernel=True) for name, each in (("w", with_all(deck)), ("l", deck)))
    assert spheres_at_the_end(tmp_path / "l") < 0.5 * len(deck.packing)
    assert change(whole, left) < CHANGE


@pytest.mark.parametrize("duration", [20.0, 80.0])
def test_the_cone_follows_a_duration_that_lmp_is_given(duration: float, tmp_path: Path) -> None:
    """A guard that judged spheres at the new face would find open contacts there."""
    deck = build(STRIP.with_values({"packing.rows": 151}))
    found = {}
    for name, each in (("whole", with_all(deck)), ("left", deck)):
        each.write(tmp_path / name)
        run_deck(tmp_path / name, deck.input_name, f"duration={duration}")
        rows = (tmp_path / name / DUMP).read_text().splitlines()[9::10]
        found[name] = np.array([row.split() for row in rows], dtype=float)
        assert read_log(tmp_path / name / LOG).table["v_open"].max() == 0
    assert spheres_at_the_end(tmp_path / "left") < 0.5 * len(deck.packing)
    size = np.abs(found["whole"]).max(axis=0)
    shift = np.abs(found["whole"] - found["left"]).max(axis=0)
    moved = [1, 2, 4, 5]  # ux, uy and vx, vy, of which uy and vy are of second order
    assert shift[moved].max() < CHANGE * size[[1, 1, 4, 4]].min()


@pytest.mark.parametrize("options", members([{}, {"kernel": True}, {"ranks": 2}], {"kernel": True}, {"ranks": 2}))
def test_a_run_is_continued_while_spheres_leave(
    options: dict[str, Any], stop: Callable[..., None], request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    if options.get("ranks", 1) > core_count():
        pytest.skip("one core")
    if "kernel" in options:
        if lack := kernel_lacks():
            pytest.skip(lack)
        request.getfixturevalue("kernel")
    watched = {"packing.rows": 151, "monitor": [MONITORS[0] | {"what": "motion"}]}
    usual = {"time.duration": 75.0, "time.timestep": 0.05, "output.checkpoint": 3e-4}
    scene = STRIP.with_values(usual | watched)
    whole = run(scene, tmp_path / "whole", **options)
    stop(scene, tmp_path / "cut", **options)
    resume(tmp_path / "cut")
    assert (
        spheres_at_the_end(tmp_path / "cut") == spheres_at_the_end(tmp_path / "whole") < len(whole.problem.rest.atoms)
    )
    for name in (DUMP, MONITOR.format("behind")):
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_run_that_began_with_other_guards_is_not_continued(stop: Callable[..., None], tmp_path: Path) -> None:
    stop(STRIP.with_values({"time.duration": 100.0, "output.checkpoint": 1e-4}), tmp_path / "cut")
    as_if_killed(tmp_path / "cut")
    deck = tmp_path / "cut" / "in.tr_nonresonant"
    deck.write_text(deck.read_text().replace(" v_tau f_", " v_tau v_next f_"))
    with pytest.raises(
        RunFolderError, match="was started by a version with other guards; run it again with force=True"
    ):
        resume(tmp_path / "cut")


@pytest.mark.parametrize(
    "changes",
    [
        {"output.particles": 5.0},
        {"packing.ends": "periodic"},
        {"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7},
        {"packing.rows": 151, "sphere.adhesion_law": "jkr", "disorder.radius": 1e-5},
    ],
)
def test_spheres_stay_that_are_recorded_counted_or_press_others(changes: dict[str, Any]) -> None:
    scene = STRIP.with_values(changes)
    assert leave(prepare(STRIP))
    assert not leave(prepare(scene))
    assert "evaporate" not in build(scene).input_text


@pytest.mark.parametrize("changes", members([{}, {"packing.rows": 151, "monitor": MONITORS}], {}))
def test_the_mean_count_is_that_of_a_run(changes: dict[str, Any], tmp_path: Path) -> None:
    deck = build(STRIP.with_values(changes))
    counted = deck.edited(before={"run": 'fix count all print 1 "$(atoms)" file counts screen no'})
    run(counted, tmp_path / "run")
    counts = np.loadtxt(tmp_path / "run" / "counts")
    # A row at the edge stays or leaves by rounding
    assert mean_count(deck.problem) == pytest.approx(counts.mean(), rel=0.01)
    assert counts.mean() < 0.8 * len(deck.packing)
    everyone = STRIP.with_values(changes | {"output.particles": 1.0})
    assert mean_count(prepare(everyone)) == len(deck.packing)
