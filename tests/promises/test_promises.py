"""Each promise on each path; docs/promises.csv is the table of `tests.promises.table`."""

import csv
import re
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import build
from granular_lmp.cli import main
from granular_lmp.errors import EffectError, GranularError, RunInterrupted
from granular_lmp.lammps.checkpoints import SPEED
from granular_lmp.lammps.deck import deck_of
from granular_lmp.problem import prepare
from granular_lmp.runs.options import core_count
from granular_lmp.runs.record import read_status
from tests.conftest import members
from tests.pause import paused
from tests.promises.paths import PATHS, Path_, Signals, resume, signals
from tests.promises.table import ELSEWHERE, PROMISES, TABLE, covered, rows

ROOT = Path(__file__).parents[2]
Runs = Callable[[Path_, str], Path]
TOLERANCE = 1e-2
# Steps of a run that counts as the truth, for one of the scene: its error is at most 1/30 of that of a plain run
FINER = {2: 8, 1: 32}


def on(promise: str, *more: str) -> pytest.MarkDecorator:
    """Parametrize a test over the paths on which the table says that it holds a promise; `more` is for `members`."""
    paths = members((PATHS[name] for name in covered(promise)), *(PATHS[name] for name in more))
    return pytest.mark.parametrize("path", paths, ids=lambda each: each.name)


@pytest.fixture(autouse=True)
def _what_a_path_needs(request: pytest.FixtureRequest) -> None:
    """Build the kernel for its path, and leave out paths that this machine has not the cores or the compiler for."""
    path = getattr(request.node, "callspec", None) and request.node.callspec.params["path"]
    if path is None:
        return
    if path.ranks > core_count():
        pytest.skip("one core")
    if path.kernel:
        request.getfixturevalue("kernel")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Runs that several promises are read off, each made once; the truth about a scene is one, however it is run."""
    done: dict[tuple[str, str], Path] = {}

    def made(path: Path_, how: str) -> Path:
        path = PATHS[path.kind] if how == "fine" else path
        if (path.name, how) not in done:
            scene = path.scene()
            changes = {
                "plain": {},
                "to a tolerance": {"time.tolerance": TOLERANCE},
                "fine": {"time.timestep": scene.time.step / FINER[path.order]},
            }[how]
            folder = tmp_path_factory.mktemp("run")
            done[path.name, how] = path.run(scene.with_values(changes), folder / "run")
        return done[path.name, how]

    return made


def errors(found: Signals, truth: Signals, impact: bool) -> dict[str, float]:
    """Return relative L2 errors of the signals of a wave; of an impact the largest, in its unit of velocity."""
    if impact:
        return {name: float(np.abs(found[name] - truth[name]).max()) for name in truth}
    size = {name: float(np.linalg.norm(values)) for name, values in truth.items()}
    # What a symmetry forbids is rounding: in space, of nine signals, up to 1e-11 of the largest
    there = [name for name in truth if size[name] > 1e-10 * max(size.values())]
    return {name: float(np.linalg.norm(found[name] - truth[name])) / size[name] for name in there}


# --- numbers ---------------------------------------------------------------------------------------------------------


def columns_of(dump: Path) -> dict[str, np.ndarray]:
    """Return the columns of a text dump of LAMMPS, (T, N) each, as anybody would read them."""
    lines = dump.read_text(encoding="utf-8").split("ITEM: ATOMS ")[1:]
    names = lines[0].split("\n", 1)[0].split()
    values = [np.array([row.split() for row in each.split("ITEM:")[0].splitlines()[1:]], dtype=float) for each in lines]
    return dict(zip(names, np.moveaxis(np.stack(values), 2, 0), strict=True))


@on("numbers under the right name")
def test_numbers_are_what_the_dump_and_the_deck_say(path: Path_, runs: Runs) -> None:
    folder = runs(path, "plain")
    info, found = read_status(folder), signals(folder)
    if path.impact:
        each = columns_of(folder / "dump.particles")
        radius = path.scene().sphere.radius
        unit = info["velocity_m_s"]
        np.testing.assert_allclose(each["vx"] * radius / info["t0_s"] / unit, found["velocity"][..., 0], atol=1e-12)
        main(["export", str(folder), "-o", str(folder.parent / "si.csv")])
        si = np.genfromtxt(folder.parent / "si.csv", delimiter=",", names=True)
        np.testing.assert_allclose(si["vy_m_s"], (each["vy"] * radius / info["t0_s"]).ravel(), rtol=1e-12)
        return
    each = {name: values[:, 0] for name, values in columns_of(folder / "dump.centre").items()}
    unit = info["amplitude"] * info["Delta0_m"] * 1e9  # D0 in nm, as the deck is in units nano
    table = np.genfromtxt(folder / "trajectory.csv", delimiter=",", names=True)
    for name, expected in (("p", each["uy"]), ("q", -each["ux"])):
        np.testing.assert_allclose(table[name], expected / unit, rtol=1e-12)
        np.testing.assert_allclose(found[name], expected / unit, rtol=1e-12)
    if path.starts_with_a_wave:  # each row of the data file moves as its phase at the wave number of run.json
        moves, rows = wave_section(next(folder.glob("data.*"))), path.scene().shape.rows
        largest = 1 + int(np.abs(moves[:, 1:]).max(axis=0).argmax())
        across, along = moves[:: len(moves) // rows, largest], np.arange(rows)
        angle = info["wavenumber_used"] * along
        basis = np.column_stack([np.cos(angle), np.sin(angle)])
        residue = across - basis @ np.linalg.lstsq(basis, across, rcond=None)[0]
        assert np.abs(residue).max() < 1e-11  # 13 decimals are written
        assert np.abs(across).max() > 0.5


def wave_section(data: Path) -> np.ndarray:
    """Return the rows of the section "wave" of a data file."""
    rows = re.split(r"\n *[Ww]ave\n+", data.read_text(encoding="utf-8"))[1].split("\n\n")[0].splitlines()
    return np.array([row.split() for row in rows], dtype=float)


# --- accuracy --------------------------------------------------------------------------------------------------------


# A run to a tolerance is many runs, each on the path of a plain one
MANY = "standing", "driven", "JKR", "quiet ends", "lmp", "two ranks", "kernel", "sweep", "thread"


@on("error estimate", *MANY)
def test_an_estimate_is_at_least_half_the_error(path: Path_, runs: Runs) -> None:
    said = read_status(runs(path, "to a tolerance"))["error_estimate"]
    found = errors(signals(runs(path, "to a tolerance")), signals(runs(path, "fine")), path.impact)
    counted = {name: value for name, value in said.items() if value is not None}
    assert counted
    # Where an answer is far better than the tolerance its estimate may be low by a factor of two (docs/accuracy.md)
    assert all(found[name] <= 2 * value for name, value in counted.items()), (found, counted)


@on("tolerance", *MANY)
def test_an_answer_errs_by_less_than_its_tolerance(path: Path_, runs: Runs) -> None:
    said = read_status(runs(path, "to a tolerance"))["error_estimate"]
    found = errors(signals(runs(path, "to a tolerance")), signals(runs(path, "fine")), path.impact)
    # What is recorded counts, unless it is said to be noise
    assert all(error <= TOLERANCE for name, error in found.items() if said.get(name, 0.0) is not None), (found, said)


@on("error budget", *MANY)
def test_the_error_of_a_step_is_at_most_what_the_budget_says(path: Path_, runs: Runs) -> None:
    budget = {each["name"]: each for each in read_status(runs(path, "plain"))["error_budget"]}
    found = errors(signals(runs(path, "plain")), signals(runs(path, "fine")), path.impact)
    said = {name: budget["time step"][name] for name in ("p", "q", "phi") if budget["time step"][name] is not None}
    # The law is that of a phase; in a run of a period the shape of the mode errs by as much
    assert all(found[name] <= 2 * value for name, value in said.items()), (found, said)


# --- trust -----------------------------------------------------------------------------------------------------------


# A driven row stands in tests/validation/test_waves_in_lammps.py, a strike in a crystal that is not perfect in
# test_strikes_at_rest.py, lmp in tests/hard/test_honesty.py, and its ranks in tests/runs/test_continued.py
CONTINUED = "standing", "driven", "quiet ends", "imperfect", "JKR", "impact", "collision", "lmp", "two ranks", "thread"


@on("same bytes after resume", *CONTINUED)
def test_a_stopped_run_is_continued_to_the_same_bytes(path: Path_, tmp_path: Path) -> None:
    scene = path.scene()
    # Four times as long, as looks of guards are up to 200 steps apart, and checkpoints with them
    longer = {"time.duration": 4 * scene.time.duration} | ({"time.allow_echo": True} if scene.wave else {})
    scene = scene.with_values(longer | {"output.checkpoint": scene.shape.spheres * 100 / SPEED / 60 / path.ranks})
    whole = path.run(scene, tmp_path / "whole")
    with paused(tmp_path / "cut", 0.5), pytest.raises(RunInterrupted):
        path.run(scene, tmp_path / "cut")
    resume(tmp_path / "cut")
    dumps = sorted(each.name for each in whole.iterdir() if each.name.startswith(("dump.", "monitor")))
    assert dumps
    for name in dumps:
        if path.kind == "damped":  # LAMMPS sets a run up with other velocities than those between its steps
            found, expected = (columns_of(folder / name) for folder in (tmp_path / "cut", whole))
            unit = read_status(whole)["amplitude"] * read_status(whole)["Delta0_m"] * 1e9
            np.testing.assert_allclose(found["uy"], expected["uy"], atol=1e-6 * unit)
        else:
            assert (tmp_path / "cut" / name).read_bytes() == (whole / name).read_bytes(), name


@on("what was changed is refused")
def test_a_file_that_was_changed_is_refused(path: Path_, runs: Runs) -> None:
    folder = runs(path, "plain")
    listed = read_status(folder)["files"]
    assert {f"in.{path.scene().name}", f"data.{path.scene().name}", "log.lammps", "scene.toml"} <= set(listed)
    for name in listed:
        whole = (folder / name).read_bytes()
        for changed in (whole.replace(b"1", b"2", 1), whole[:-1], None):
            if changed is None:
                (folder / name).unlink()
            else:
                (folder / name).write_bytes(changed)
            with pytest.raises(GranularError, match=re.escape(name)):
                signals(folder)
        (folder / name).write_bytes(whole)
    signals(folder)


@on("guards", "standing", "JKR", "two ranks")
def test_a_guard_fails_the_run(path: Path_, tmp_path: Path) -> None:
    scene = path.scene()
    if scene.wave is None:
        deck = deck_of(prepare(scene))
        # Hertz's law breaks: the deck is of a striker ten thousand times as fast
        old, new, guard = r"(velocity +striker set \S+ )(\S+)", r"\g<1>$(1e4*\g<2>)", "largest_overlap"
        if path.kind == "collision":
            old, new = r"(variable +vy atom )(\S+)", r"\g<1>1e4*\g<2>"
    else:
        deck = build(scene)
        old, new, guard = r"variable friction index \S+", "variable friction index 1e-6", "sliding"
    text, count = re.subn(old, new, deck.input_text)
    assert count == 1
    with pytest.raises(EffectError, match=guard):
        path.run(replace(deck, input_text=text), tmp_path / "run")
    assert read_status(tmp_path / "run")["status"] == "failed"


@on("clear errors")
def test_bad_input_is_one_line(path: Path_, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(path.scene().to_toml(), encoding="utf-8")
    words = path.command(file, "time.sample=-1.0")
    status: list[int] = []
    if path.name == "thread":
        thread = threading.Thread(target=lambda: status.append(main(words)))
        thread.start()
        thread.join()
    else:
        status.append(main(words))
    (line,) = capsys.readouterr().err.splitlines()
    assert status == [2]
    assert line.startswith("granular-lmp: error: time.sample = -1.0: must be a number")
    assert [each.name for each in tmp_path.iterdir()] == ["scene.toml"]


# --- the table -------------------------------------------------------------------------------------------------------


def test_the_table_is_written_and_its_tests_are_there() -> None:
    assert list(csv.reader(TABLE.read_text(encoding="utf-8").splitlines())) == rows()
    here = Path(__file__).read_text(encoding="utf-8")
    assert all(f"def {name}(" in here for name in PROMISES.values())
    for said in ELSEWHERE.values():
        file, name = said.split("::")
        assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), said


def test_an_error_of_one_percent_is_one_percent() -> None:
    truth = {"p": np.sin(np.arange(30.0)), "still": np.zeros(30)}
    found = {name: 1.01 * values for name, values in truth.items()}
    assert errors(found, truth, impact=False) == pytest.approx({"p": 0.01})
    assert errors(found, truth, impact=True) == pytest.approx({"p": 0.01 * np.abs(truth["p"]).max(), "still": 0.0})
