"""Runs of impacts: routes, ranks, stops, edits, commands and pictures."""

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import granular_lmp
from granular_lmp import ImpactRecord, ImpactScene, Record, Scene, run, run_impact
from granular_lmp.cli import main
from granular_lmp.errors import LammpsError, RunFolderError, RunInterrupted
from granular_lmp.lammps.deck import deck_of
from granular_lmp.lammps.outputs import RunLog, read_log
from granular_lmp.plot.view import view
from granular_lmp.problem import prepare
from granular_lmp.runs import loop
from granular_lmp.runs.options import Options
from granular_lmp.runs.record import read_status
from granular_lmp.runs.scales import force_of
from granular_lmp.studies.combine import together
from granular_lmp.studies.features import KINDS

CHAIN = ImpactScene.load("solitary_chain").with_values({"packing.rows": 10, "time.duration": 20.0})
SHEET = ImpactScene.load("point_impact").with_values(
    {"packing.rows": 8, "packing.columns": 9, "striker.1.spheres": [[0, 4]], "time.duration": 6.0, "time.sample": 2.0}
)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Run folders of a chain and of a sheet."""
    top = tmp_path_factory.mktemp("impacts")
    for name, scene in {"chain": CHAIN, "sheet": SHEET}.items():
        run_impact(scene, top / name)
    return {name: top / name for name in ("chain", "sheet")}


@pytest.mark.parametrize("name", ["chain", "sheet"])
def test_the_program_writes_the_bytes_of_the_module(folders: dict[str, Path], tmp_path: Path, name: str) -> None:
    scene = {"chain": CHAIN, "sheet": SHEET}[name]
    run_impact(scene, tmp_path / "run", Options("lmp"))
    dumps = [folder / "dump.particles" for folder in (folders[name], tmp_path / "run")]
    assert dumps[0].read_bytes() == dumps[1].read_bytes()


def test_a_run_whose_log_lacks_a_look_of_its_guards_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def lacking(path: Path) -> RunLog:  # as a full disk leaves it, of which LAMMPS does not say a word
        log = read_log(path)
        return replace(log, table={name: np.delete(values, 2) for name, values in log.table.items()})

    monkeypatch.setattr(loop, "read_log", lacking)
    with pytest.raises(LammpsError, match=r"the log lacks step \d+"):
        run_impact(CHAIN, tmp_path / "run")
    assert read_status(tmp_path / "run")["status"] == "failed"


def test_two_ranks_move_a_sheet_alike(folders: dict[str, Path], tmp_path: Path) -> None:
    one, two = ImpactRecord.load(folders["sheet"]), run_impact(SHEET, tmp_path / "run", Options("lmp", 2))
    # Forces of a sphere are added in another order: 1e-16 of each, over 120 steps
    assert two.velocity == pytest.approx(one.velocity, abs=1e-11)
    assert two.info["ranks"] == 2


def test_an_interrupted_run_says_so_and_keeps_what_was_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(done: int, steps: int) -> None:
        raise KeyboardInterrupt

    long = CHAIN.with_values({"time.duration": 1e6, "time.sample": 10.0})
    said = "interrupted; what was recorded is kept; it has no checkpoint yet; run it again with force=True"
    with pytest.raises(RunInterrupted, match=said):
        run_impact(long, tmp_path / "run", Options(progress=stop))
    assert json.loads((tmp_path / "run" / "run.json").read_text())["status"] == "interrupted"
    with pytest.raises(RunFolderError, match="not a finished run"):
        ImpactRecord.load(tmp_path / "run")
    assert main(["resume", str(tmp_path / "run")]) == 2
    assert "stopped before its first checkpoint; run it again with --force" in capsys.readouterr().err
    assert len(ImpactRecord.load(tmp_path / "run", unfinished=True).tau) >= 1


def test_an_edited_deck_is_run_and_named(tmp_path: Path) -> None:
    deck = deck_of(prepare(CHAIN))
    edited = replace(deck, input_text=deck.input_text.replace("neighbor     0.2", "neighbor     0.3"))
    assert run_impact(edited, tmp_path / "run").info["edited"] == ["- neighbor     0.2 bin", "+ neighbor     0.3 bin"]
    assert "edited" not in run_impact(deck, tmp_path / "plain").info


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["resume", "<chain>"], "there is nothing to resume"),
        (
            ["modes", "point_impact"],
            'packing.lattice = "hexagonal": must be "chain", with packing.contact',
        ),
        (["modes", "solitary_chain"], "packing.contact_force = 0.0: must be above 0; spheres that just touch"),
        (["adopt", "<chain>"], "does not print its variables, unlike decks of waves; give the values that differ"),
        (["export", "<chain>", "-o", "x.txt"], "x.txt: must end in one of .csv, .nc, .xyz, .extxyz, .h5md, .h5"),
        (
            ["export", "<chain>", "-o", "x.csv", "--monitor", "line"],
            "monitor 'line': no such monitor",
        ),
        (["export", "<chain>", "-o", "/proc/y.csv"], "/proc/y.csv: cannot be written"),
        (["view", "<chain>", "-o", "x.gif"], "a chain is drawn over time in a picture, not as a movie"),
        (
            ["view", "<chain>", "-o", "x.png", "--tau", "3"],
            "--tau: cannot be used for the picture of a chain, which shows all times",
        ),
        (["view", "<sheet>", "-o", "x.png", "--tau", "99"], "tau = 99.0: must be from 0 to 6"),
        (
            ["view", "<sheet>", "-o", "x.png", "--colour", "p"],
            "colour = 'p': needs a wave, and this run has none; take",
        ),
        (["view", "<sheet>", "-o", "x.gif", "--tau", "3"], "--tau: cannot be used for a movie of a run"),
        (["view", "solitary_chain", "-o", "x.png", "--at-rest"], "all spheres and contacts are equal"),
    ],
)
def test_what_a_command_cannot_do_with_an_impact_is_said(
    folders: dict[str, Path], words: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    there = {f"<{name}>": str(path) for name, path in folders.items()}
    words = [there.get(word, word) for word in words]
    words = [str(tmp_path / word) if word.startswith("x.") else word for word in words]
    assert main(words) == 2
    assert said in capsys.readouterr().err


def test_view_draws_a_chain_a_sheet_and_a_movie(folders: dict[str, Path], tmp_path: Path, drawn_once: None) -> None:
    calls: list[tuple[str, str, dict[str, Any]]] = [
        ("chain", "a.png", {}),
        ("sheet", "b.png", {"tau": 4.0}),
        ("sheet", "c.gif", {}),
    ]
    for name, file, options in calls:
        assert view(folders[name], tmp_path / file, **options) == []
        assert (tmp_path / file).stat().st_size > 5000
    with Image.open(tmp_path / "c.gif") as movie:
        assert movie.n_frames == 4


def test_init_writes_an_impact_to_begin_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(tmp_path / "mine.toml")
    assert main(["init", file, "--from", "point_impact"]) == 0
    scene = ImpactScene.load(file)
    shipped = ImpactScene.load("point_impact")
    assert scene == shipped.with_values({"name": "mine", "description": ""})
    assert "--set time.duration=50.0" in Path(file).read_text()
    assert "# tolerance = ...              # in place of timestep" in Path(file).read_text()
    assert main(["init", file, "--from", "point_impact"]) == 2
    assert "exists already; choose another name" in capsys.readouterr().err


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_an_export_is_in_si_units(tmp_path: Path, friction: float) -> None:
    record = run_impact(SHEET.with_values({"effects.friction": friction}), tmp_path / "run")
    assert main(["export", str(tmp_path / "run"), "-o", str(tmp_path / "run.csv")]) == 0
    names, *lines = csv.reader((tmp_path / "run.csv").read_text().splitlines())
    assert names[:7] == ["t_s", "row", "column", "ux_m", "uy_m", "vx_m_s", "vy_m_s"]
    table = dict(zip(names, np.array(lines, dtype=float).T, strict=True))
    assert ("spin_rad_s" in table) == (friction > 0) == record.spin.any()
    assert record.spin.shape == (4, 72)
    ball, scale = SHEET.sphere, record.scale
    last = table["t_s"] == table["t_s"][-1]
    assert table["t_s"][-1] == pytest.approx(6 * scale.time)
    # Momentum of the striker, in kg m/s
    assert np.sum(table["vy_m_s"][last]) * ball.mass == pytest.approx(ball.mass * 1.0)
    struck = (table["row"] == 0) & (table["column"] == 4) & last
    assert table["uy_m"][struck] == pytest.approx(record.displacement[-1, 4, 1] * scale.length)
    if friction:
        assert table["spin_rad_s"][last] * ball.radius == pytest.approx(record.spin[-1] * scale.velocity)


def test_the_commands_run_and_build_an_impact(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.toml").write_text(CHAIN.to_toml())
    assert main(["build", str(tmp_path / "mine.toml"), "-o", str(tmp_path / "deck")]) == 0
    names = sorted(path.name for path in (tmp_path / "deck").iterdir())
    assert names == ["data.solitary_chain", "in.solitary_chain", "scene.toml"]
    assert main(["run", str(tmp_path / "mine.toml"), "-o", str(tmp_path / "run")]) == 0
    said = capsys.readouterr().out
    assert re.search(r"10 spheres, 680 steps, 41 records of 10 spheres in", said)


@pytest.mark.parametrize("last", ["held", "wall"])
def test_a_sphere_comes_back_from_an_end_with_the_restitution(last: str, tmp_path: Path) -> None:
    values = {"packing.rows": 2, "packing.last": last, "effects.restitution": 0.5, "time.timestep": 0.01}
    beside = 0 if last == "held" else 1  # row 1 is held, or touches the wall
    scene = CHAIN.with_values({**values, "striker.1.rows": [beside, beside]})
    # Row 0 may be struck from the wall's side afterwards, which keeps the momentum of both. A step of 0.01 leaves 1e-4;
    # as if the held sphere were free, 0.62 would come back
    momentum = run_impact(scene, tmp_path / "run").velocity[-1, :, 1].sum()
    assert momentum == pytest.approx(-0.5, abs=1e-3)


def test_the_record_is_in_the_units_of_the_impact(folders: dict[str, Path], tmp_path: Path) -> None:
    record, fast = (
        ImpactRecord.load(folders["chain"]),
        run_impact(CHAIN.with_values({"striker.1.velocity": 7.0}), tmp_path / "run"),
    )
    # One motion at any velocity; rounding of positions over ℓ
    assert fast.velocity == pytest.approx(record.velocity, abs=1e-9)
    assert record.velocity[0, 0, 1] == pytest.approx(1.0, abs=1e-15)
    assert fast.scale.velocity == pytest.approx(7.0)
    assert np.max(record.kinetic_energy) == pytest.approx(0.5)


def test_energy_of_what_was_not_recorded_is_refused(tmp_path: Path) -> None:
    scenes = CHAIN.with_values({"output.rows": [0, 3]}), SHEET.with_values({"packing.last": "wall"})
    for number, scene in enumerate(scenes):
        record = run_impact(scene, tmp_path / str(number))
        with pytest.raises(RunFolderError, match="the stored energy needs a record of all spheres"):
            record.energy()


def test_the_door_runs_continues_and_reads_waves_and_impacts_alike(
    small: Scene, stop: Callable[..., None], tmp_path: Path
) -> None:
    long = {"time.duration": 200.0, "time.sample": 2.0, "output.checkpoint": 3e-5}
    for kind, scene, record in (("wave", small, Record), ("impact", CHAIN, ImpactRecord)):
        whole = granular_lmp.run(scene.with_values(long), tmp_path / kind)
        assert isinstance(whole, record)
        stop(scene.with_values(long), tmp_path / f"{kind} cut")
        granular_lmp.resume(tmp_path / f"{kind} cut")
        again = granular_lmp.load(tmp_path / f"{kind} cut")
        assert isinstance(again, record)
        assert np.array_equal(again.tau, whole.tau)
        table = granular_lmp.sweep(scene, {"time.sample": [0.5]}, tmp_path / f"{kind}s")
        assert table.having("finished") == table.rows


@pytest.mark.parametrize("restitution", [1.0, 0.9])
@pytest.mark.parametrize("feature", ["pressed sheet", "held"])
def test_the_force_on_a_held_sphere_is_that_of_its_contacts(feature: str, restitution: float, tmp_path: Path) -> None:
    impacts = KINDS[1]
    scene = impacts.scene.with_values(together(impacts.features[feature]))
    last = scene.shape.rows - 1
    asked = {"effects.restitution": restitution, "output.forces": True, "striker.1.spheres": [[last - 1, 4]]}
    watched = [{"name": "face", "rows": [last, last], "what": "contacts"}]
    record = run(scene.with_values(asked | {"monitor": watched}), tmp_path / "run")
    place = int(np.flatnonzero((record.row == last) & (record.column == 4))[0])
    contacts, sphere, scale = record.monitor("face").contacts, int(record.spheres[place]), record.scale
    sign = np.where(contacts.j == sphere, 1.0, np.where(contacts.i == sphere, -1.0, 0.0))
    expected = (sign[:, None] * contacts.force).sum(axis=1) * force_of(record.scene)
    found = record.signals["force"][:, place] * scale.mass * scale.length / scale.time**2
    # A sum of two contacts in another order; a dashpot pushes by the velocity of half a step ago
    error = 1e-12 if restitution == 1 else 5e-3
    np.testing.assert_allclose(found, expected, rtol=0, atol=error * np.abs(expected).max())
    assert np.ptp(found[:, 1]) > 1.0  # N: the strike arrives
