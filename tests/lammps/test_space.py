"""Spheres in space: decks, records and guards of layers on a substrate and of crystals of many layers."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.tools.compare import compare
from granular_lmp import Record, Scene, build, run
from granular_lmp.crystal.lattices import centre, places
from granular_lmp.errors import SceneError
from granular_lmp.lammps.datafile import read
from granular_lmp.lammps.outputs import DUMP, SNAPSHOTS, read_centre
from granular_lmp.problem import prepare
from granular_lmp.runs.export import export
from tests.conftest import PAPER, members
from tests.manual import Measure, Mutant, off, verifies

QUARTER = 0.7853981633974483  # rad per row: one wavelength is eight rows
SILICA = {"youngs_modulus": 73e9, "poisson_ratio": 0.17, "work_of_adhesion": 0.063}
LAYER: dict[str, Any] = {
    "name": "layer",
    "packing.rows": 8,
    "packing.columns": 3,
    "packing.ends": "periodic",
    "substrate": SILICA,
    "wave.mode": "1",
    "wave.wavenumber": QUARTER,
    "wave.amplitude": 1e-4,
    "time.duration": 40.0,
    "time.timestep": 0.02,
    "time.sample": 0.1,
}
MOTION = ("ux", "uy", "uz", "phix", "phiy", "phiz")
ANISOTROPY = np.array([1, 1, 1, 0.4, 0.4, 0.4])  # m and I/R² over m


def layer(**changes: Any) -> Scene:
    return PAPER.with_values(LAYER | {key.replace("__", "."): value for key, value in changes.items()})


def motion(record: Record) -> np.ndarray:
    return np.stack([record.signals[name] for name in MOTION], axis=1)


def stepped(frequency: float, step: float) -> float:
    """The frequency with which velocity Verlet turns an oscillator."""
    return float(2 * np.arcsin(frequency * step / 2) / step)


# ---------------------------------------------------------------- motion


def amplitude(scene: Scene, folder: Path) -> np.ndarray:
    """The complex amplitude of the scene's own mode at all times, from all spheres; waves of 2k and k = 0 are out."""
    monitor, shape = run(scene, folder).monitor("all"), prepare(scene).wave.mode.shape()[0]
    moved = np.concatenate([monitor.displacement, monitor.rotation], axis=2)
    weight = (
        np.exp(-1j * scene.wavenumber * (monitor.row - scene.shape.centre_row))[:, None] * shape.conj() * ANISOTROPY
    )
    found = 2 * np.einsum("tnk,nk->t", moved, weight) / len(weight)
    return np.asarray(found / np.sum(np.abs(shape) ** 2 * ANISOTROPY))


@pytest.mark.parametrize("mode", members("123456", "1", "3", "4", "5"))
@verifies(
    "LAMMPS in space: six modes of a layer on a substrate, frequency of a run",
    reference="other code: modes of the package, with the frequency of velocity Verlet",
    tolerance=1e-07,
    reason="second order in an amplitude of 1e-4, and the slope of a phase over 40 τ",
    mutant=Mutant(
        "granular_lmp/lammps/contact.py",
        "float(law.shear_coefficient) / (8 * root)",
        "float(law.shear_coefficient) / (8.01 * root)",
    ),
)
def test_a_layer_kicked_in_each_of_its_modes_has_its_frequency(mode: str, tmp_path: Path, measured: Measure) -> None:
    scene = layer(wave__mode=mode, monitor=[{"name": "all", "rows": [0, 7]}])
    found, frequency = amplitude(scene, tmp_path / "run"), prepare(scene).wave.mode.frequency
    tau = scene.time.sample * np.arange(len(found))
    turned = -np.polyfit(tau, np.unwrap(np.angle(found)), 1)[0]
    measured(turned / stepped(frequency, scene.time.step) - 1)
    # Verlet's velocity of a mode with the frequency ω is too fast by (ω step)²/8
    assert np.abs(np.abs(found) - 1).max() < (frequency * scene.time.step) ** 2 / 7 + 1e-6


MEASURED = SILICA | {"normal_stiffness": 3000.0, "shear_stiffness": 4000.0}
CRYSTALS: dict[str, dict[str, Any]] = {
    "fcc": {"packing.lattice": "fcc", "wave.mode": "TR"},
    "fcc, longitudinal": {"packing.lattice": "fcc", "wave.mode": "L"},
    "cubic": {"packing.lattice": "cubic", "wave.mode": "RT"},
    "hcp": {"packing.lattice": "hcp", "wave.mode": "12"},
    "film": {"packing.lattice": "fcc", "packing.orientation": "[110]", "packing.layers": 3},
    "between two": {
        "packing.lattice": "fcc",
        "packing.orientation": "[11-2]",
        "packing.layers": 3,
        "wave.mode": "2",
        "substrate": SILICA | {"sides": "both"},
    },
    "square": {"packing.lattice": "square", "wave.mode": "2"},
    "honeycomb": {"packing.lattice": "honeycomb", "packing.columns": 4, "wave.mode": "3"},
    "JKR": {"sphere.adhesion_law": "jkr", "wave.mode": "S1"},
    "measured": {"substrate": MEASURED, "contact": {"normal_stiffness": 500.0, "shear_stiffness": 400.0}},
}


BULK = ("fcc", "fcc, longitudinal", "cubic", "hcp")


@pytest.mark.parametrize("name", CRYSTALS)
@verifies(
    "LAMMPS in space: fcc, cubic, hcp, films, square, honeycomb, JKR, measured stiffnesses; departure over its bound",
    reference="other code: the linear wave of the package, with the frequency of velocity Verlet",
    tolerance=1.0,
    reason="the bound: the amplitude, 1e-4, and (Ωh)²/7 of Verlet's velocity",
    mutant=Mutant("granular_lmp/effects/rotation.py", "v_D0*d_vphi{axis}/v_R/v_t0", "1.01*v_D0*d_vphi{axis}/v_R/v_t0"),
)
def test_a_wave_in_a_crystal_of_many_layers_or_laws_keeps_its_shape(
    name: str, tmp_path: Path, measured: Measure
) -> None:
    bare = {key: value for key, value in LAYER.items() if key != "substrate" or name not in BULK}
    scene = PAPER.with_values(bare | {"time.duration": 10.0} | CRYSTALS[name])
    problem = prepare(scene)
    shape = problem.wave.mode.shape()[places(problem.rest.atoms)[centre(problem.rest.atoms)]]
    record = run(scene, tmp_path / "run")
    turning = stepped(problem.wave.mode.frequency, scene.time.step)
    expected = (shape * np.exp(-1j * turning * record.tau)[:, None]).real
    # The second order in the amplitude, and Verlet's velocity
    bound = scene.wave.amplitude + (turning * scene.time.step) ** 2 / 7
    measured(off(motion(record), expected, size=bound))


@pytest.mark.parametrize(
    ("changes", "width"),
    [
        ({"packing.orientation": "[110]"}, False),
        ({"packing.orientation": "[110]", "wave.mode": "L"}, False),
        ({"inclusion": [{"layers": [1, 1], "density": 3000.0}]}, True),
        ({"inclusion": [{"layers": [1, 1], "density": 3000.0}], "wave.mode": "L"}, True),
    ],
    ids=["layers in between", "L with layers in between", "another layer", "L with another layer"],
)
def test_a_row_of_several_layers_moves_alike_where_it_lies_at_one_height_and_is_equal(
    changes: dict[str, Any], width: bool, tmp_path: Path
) -> None:
    record = run(Scene.load("fcc_transverse").with_values(changes | {"time.duration": 5.0}), tmp_path / "run")
    assert record.info["effects"]["width"]["on"] is width
    assert record.info["effects"]["rotation"]["on"]  # which is counted with branches, and where spheres differ
    assert all(guard["quiet"] for guard in record.info["guards"].values())
    errors = [error for error in compare(record, "network").error.values() if error is not None]
    assert max(errors) < 2e-3  # the time step leaves less


def test_a_wave_in_the_plane_is_the_same_in_space(tmp_path: Path) -> None:
    plane = PAPER.with_values(
        {
            "packing.rows": 12,
            "packing.ends": "periodic",
            "wave.wavenumber": 0.5235987755982988,
            "time.duration": 20.0,
            "time.timestep": 0.1,
        }
    )
    shape = prepare(plane).wave.mode.shape()[0]
    space = plane.with_values({"packing.space": 3, "wave.mode": _same_mode(plane, shape)})
    flat, free = run(plane, tmp_path / "plane"), run(space, tmp_path / "space")
    for name in ("p", "q", "phi"):
        assert np.abs(getattr(free, name) - getattr(flat, name)).max() < 1e-9
    assert not free.signals["uz"].any()


def _same_mode(plane: Scene, shape: np.ndarray) -> str:
    """The number of the branch in space with a shape; nothing holds some of the others."""
    for number in range(1, 7):
        with suppress(SceneError):
            own = prepare(plane.with_values({"packing.space": 3, "wave.mode": str(number)})).wave.mode.shape()[0]
            if abs(np.vdot(own, shape)) > 1 - 1e-9:
                return str(number)
    raise AssertionError("the wave is not there in space")


def test_the_angle_is_the_sum_of_the_spins(tmp_path: Path) -> None:
    short = {"time.timestep": 0.01, "time.sample": 0.01, "time.duration": 10.0, "wave.amplitude": 0.01}
    scene = layer(wave__mode="2").with_values(short)
    run(scene, tmp_path / "run")
    table = read_centre(tmp_path / "run" / DUMP)
    step = scene.time.step * scene.units.number(scene.scale.time, time=1)
    turned, spins = (np.stack([table[f"{name}{axis}"] for axis in "xyz"]) for name in ("theta", "omega"))
    summed = np.cumsum((spins[:, 1:] + spins[:, :-1]) / 2, axis=1) * step
    # The trapezoidal rule is off by (omega step)²/12, 2e-5 of the angle for the fastest branch
    assert np.abs(turned[:, 1:] - turned[:, :1] - summed).max() < 2e-5 * np.abs(turned).max()
    assert np.abs(turned).max() > 1e-7  # rad


# ---------------------------------------------------------------- runs


@pytest.mark.more
def test_the_program_and_two_ranks_give_the_same_as_the_module(tmp_path: Path) -> None:
    scene = layer(wave__amplitude=0.05, packing__rows=16, wave__wavenumber=QUARTER, time__duration=20.0)
    module = run(scene, tmp_path / "module")
    program = run(scene, tmp_path / "program", launcher="lmp")
    ranks = run(scene, tmp_path / "ranks", launcher="lmp", ranks=2)
    assert (tmp_path / "module" / DUMP).read_bytes() == (tmp_path / "program" / DUMP).read_bytes()
    assert np.abs(motion(module) - motion(program)).max() == 0
    assert np.abs(motion(module) - motion(ranks)).max() < 1e-9


def test_snapshots_and_monitors_hold_all_freedoms_and_are_exported(tmp_path: Path) -> None:
    scene = layer(wave__amplitude=0.05, output__particles=10.0, monitor=[{"name": "all", "rows": [0, 7]}])
    record = run(scene, tmp_path / "run")
    snapshots, monitor = record.snapshots(), record.monitor("all")
    centre = int(record.spheres[0])
    last = snapshots[len(snapshots) - 1]
    assert last.displacement.shape == last.rotation.shape == (len(snapshots.crystal), 3)
    own = np.concatenate([last.displacement[centre], last.rotation[centre]])
    at = np.argmin(np.abs(record.tau - last.tau))
    assert own == pytest.approx(motion(record)[at], abs=1e-9)
    assert monitor.rotation[at, centre] == pytest.approx(last.rotation[centre], abs=1e-9)
    assert {"w", "phix", "w_t", "phix_t"} <= set(monitor.columns())
    for ending in (".csv", ".xyz"):
        export(record, tmp_path / f"out{ending}")
    words = (tmp_path / "out.xyz").read_text().splitlines()[1]
    assert "displacement:R:3" in words
    assert "rotation:R:3" in words
    head = (tmp_path / "run" / SNAPSHOTS).read_text().splitlines()[8]
    assert "Displacement.Z" in head
    assert "Orientation.W" in head


def test_tables_tell_the_spheres_of_several_layers_apart(tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    watched = {"name": "line", "rows": [4, 4], "what": "contacts"}
    changes = {"monitor": [watched], "time.duration": 1.0, "output.particles": 1.0}
    record = run(Scene.load("fcc_transverse").with_values(changes), tmp_path / "run")
    snapshots, contacts = record.snapshots().to_pandas(), record.monitor("line").to_pandas()
    places = ["row", "column", "layer"]
    assert len(snapshots[places].drop_duplicates()) == 72
    assert len(snapshots[places[:2]].drop_duplicates()) == 24
    arrays, (first, *_) = record.problem.rest.atoms.arrays, record.monitor("line").contacts.pairs
    one = contacts.iloc[0]
    assert [[one[f"{name}_{end}"] for name in places] for end in "ij"] == [
        [arrays[name][sphere] for name in places] for sphere in first[:2]
    ]


# ---------------------------------------------------------------- decks and guards


def test_the_deck_says_what_it_needs_and_writes_the_law_of_the_wall() -> None:
    deck = build(layer(substrate=SILICA | {"youngs_modulus": 5e9, "poisson_ratio": 0.35}))
    assert "# Needs LAMMPS with the packages GRANULAR and BPM" in deck.input_text
    assert "atom_style   bpm/sphere" in deck.input_text
    assert "boundary     p p f" in deck.input_text
    assert "wall/gran granular dmt" in deck.input_text
    assert "enforce2d" not in deck.input_text
    assert deck.data.wave.shape == (24, 12)


def test_the_data_file_of_a_layer_is_read_back(tmp_path: Path) -> None:
    deck = build(layer())
    deck.write(tmp_path / "deck")
    back = read(tmp_path / "deck" / deck.data_name)
    assert back.style == deck.data.style == "bpm/sphere"
    assert np.array_equal(back.position, deck.data.position)
    assert np.array_equal(back.wave, deck.data.wave)


def test_a_sphere_that_leaves_the_substrate_is_seen(tmp_path: Path) -> None:
    vertical = _vertical(layer())
    quiet = layer(wave__mode=vertical, wave__amplitude=0.3, wave__form="standing", time__duration=10.0)
    assert run(quiet, tmp_path / "quiet").info["guards"]["open_contacts"]["value"] == 0
    parted = run(quiet.with_values({"wave.amplitude": 3.0}), tmp_path / "parted").info
    assert parted["effects"]["contact_opening"]["on"]
    assert parted["guards"]["open_contacts"]["value"] > 0


@pytest.mark.parametrize(("friction", "slides"), [(0.1, False), (0.02, True)])
def test_what_a_rocking_layer_rubs_on_its_substrate_is_foreseen_and_measured(
    friction: float, slides: bool, tmp_path: Path
) -> None:
    """In a long rocking wave spheres hardly move against each other, and shear their contacts with the wall."""
    rocking = layer(packing__rows=32, wave__mode="S1", wave__wavenumber=0.19634954084936207, wave__amplitude=0.1)
    scene = rocking.with_values({"effects.friction": friction, "time.timestep": 0.05})
    sliding = next(each for each in prepare(scene).effects if each.name == "sliding")
    found = run(scene, tmp_path / "run").info["guards"]["largest_slip"]["value"]
    assert sliding.on == slides
    if slides:
        assert found > 1 - 1e-9
    else:
        assert found == pytest.approx(sliding.number, rel=0.03)  # the second order in the amplitude


def _vertical(scene: Scene) -> str:
    """The number of the branch that moves most along z."""
    modes = {str(n): prepare(scene.with_values({"wave.mode": str(n)})).wave.mode.shape()[0] for n in range(1, 7)}
    return max(modes, key=lambda name: abs(modes[name][2]))


# ---------------------------------------------------------------- sources


CUBE: dict[str, Any] = {
    "name": "cube",
    "packing.lattice": "cubic",
    "packing.rows": 6,
    "packing.columns": 6,
    "packing.layers": 6,
    "packing.ends": "periodic",
    "wave.form": "none",
    "wave.amplitude": 1e-3,
    "wave.wavenumber": 1.0471975511965976,
    "time.duration": 8.0,
    "time.timestep": 0.05,
    "time.allow_echo": True,
}


def shaken(folder: Path, **what: str) -> Record:
    return run(PAPER.with_values(CUBE | {"source": [{"rows": [3, 3], "frequency": 0.5, "ramp": 5.0} | what]}), folder)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"force": "x"}, {"force": "z"}),
        ({"motion": "x"}, {"motion": "z"}),
        ({"force": "torque"}, {"force": "torque_x"}),
        ({"motion": "rotation"}, {"motion": "rotation_x"}),
    ],
)
def test_rows_shaken_along_x_and_z_make_waves_that_a_mirror_exchanges(
    one: dict[str, str], other: dict[str, str], tmp_path: Path
) -> None:
    first, second = (shaken(tmp_path / name, **what) for name, what in (("one", one), ("other", other)))
    pairs = {"ux": "uz", "phix": "phiz", "uz": "ux", "phiz": "phix", "uy": "uy", "phiy": "phiy"}
    largest = max(float(np.abs(first.signals[name]).max()) for name in pairs)
    assert largest > 1e-3
    for name, there in pairs.items():
        same = np.abs(np.abs(first.signals[name]) - np.abs(second.signals[there])).max()
        assert same < 3e-3 * largest, name  # the second order in the amplitude


def test_quiet_ends_are_of_crystals_whose_reflection_is_known() -> None:
    source = {"rows": [20, 20], "force": "y", "frequency": 0.4}
    held = {"packing.rows": 41, "packing.ends": "fixed", "wave.form": "none", "source": [source], "absorb.rows": "auto"}
    with pytest.raises(SceneError, match=r"absorb.rows = 'auto': must be 0 on a \[substrate\]"):
        prepare(layer().with_values(held))
    fcc = PAPER.with_values(held | {"packing.lattice": "fcc", "packing.rows": 81, "time.duration": 10.0})
    assert "vz v_kept_z omega v_kept_turnx v_kept_turny v_kept_turnz" in build(fcc).input_text
