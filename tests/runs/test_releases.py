"""Folders of earlier releases are read, and what they do not say is what was true when they were written."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.tools import compare
from granular_lmp import Record, Scene
from granular_lmp.cli import main
from granular_lmp.errors import LammpsError, RunFolderError
from granular_lmp.frozen import dataclass
from granular_lmp.problem import prepare
from granular_lmp.runs import formats
from granular_lmp.runs.adopt import adopt
from granular_lmp.runs.launch import resume
from granular_lmp.runs.record import STATUS, read_status, write_status
from granular_lmp.runs.seal import accept
from granular_lmp.scene.json_schema import keys
from granular_lmp.scene.schema import count, switch
from granular_lmp.scene.sections import Effects, Packing
from granular_lmp.scene.without_wave import NOT_HELD, WAVE
from granular_lmp.studies.identity import dotted, frozen, names_of
from granular_lmp.studies.sweep import Sweep, sweep
from granular_lmp.studies.sweep_points import scene_hash
from tests.conftest import members

RELEASES = Path(__file__).parents[1] / "data" / "releases"
OLD = ["e02a04e", "832ce44"]  # states of release 0.1.0
RUNS = [f"{release}/{name}" for release in OLD for name in ("run", "tolerance", "sheet")]
RUNS += ["0.2.0/run", "0.2.0/tolerance"]
SWEEPS = [*(f"{release}/sweep" for release in OLD), "832ce44/columns", "832ce44/impacts", "0.2.0/sweep"]
YOUNGER = RELEASES.parent / "younger_keys.json"
NAMES: dict[str, dict[str, Any]] = json.loads((RELEASES / "832ce44" / "names.json").read_text(encoding="utf-8"))


@pytest.fixture
def there(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A copy of a folder of an earlier release."""
    return Path(shutil.copytree(RELEASES / request.param, tmp_path / "old"))


def files(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# --- run folders ---


# Of each release a run and of each kind a release
@pytest.mark.parametrize(
    "there", members(RUNS, "e02a04e/sheet", "e02a04e/tolerance", "832ce44/run", "0.2.0/run"), indirect=True
)
def test_an_old_run_is_loaded_compared_viewed_and_exported(
    drawn_once: None, there: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = Record.load(there)
    assert formats.format_of(record.info) == {"0.1.0": 1, "0.2.0": 2}[record.info["versions"]["granular_lmp"]]
    # What it does not switch was off
    assert prepare(record.scene).scene == record.scene
    assert not record.scene.effects.rolling
    assert compare.main([str(there)]) == 0
    assert "of the run     perturbation order" not in capsys.readouterr().out  # it is an error of the theory
    assert main(["export", str(there), "-o", str(there.parent / "out.csv")]) == 0
    if record.scene.output.particles:
        assert len(record.snapshots()) == 2
        assert main(["export", str(there), "-o", str(there.parent / "out.xyz")]) == 0
        assert main(["view", str(there), "-o", str(there.parent / "out.png")]) == 0


def test_the_two_states_of_the_release_agree_on_the_motion() -> None:
    first, second = (Record.load(RELEASES / release / "run") for release in OLD)
    assert first.scene == second.scene
    for name, values in first.signals.items():
        np.testing.assert_allclose(values, second.signals[name], rtol=0, atol=1e-9)  # another order of the same sums


def test_an_old_run_of_one_column_is_that_of_three() -> None:
    narrow, wide = (Sweep.load(RELEASES / "832ce44" / name) for name in ("columns", "sweep"))
    one, other = (each.record(each.rows[0]) for each in (narrow, wide))
    assert (one.info["particles"], other.info["particles"]) == (8, 24)
    for name, values in one.columns.items():
        np.testing.assert_allclose(values, other.columns[name], rtol=0, atol=1e-9)  # another order of the same sums


def test_an_old_impact_is_loaded() -> None:
    record = Record.load(RELEASES / "832ce44" / "impact")
    assert record.velocity.shape == (7, 6, 2)


@pytest.mark.parametrize("there", ["e02a04e/run"], indirect=True)
def test_an_old_run_lists_no_files_that_could_be_accepted(there: Path) -> None:
    before = (there / STATUS).read_bytes()
    with pytest.raises(RunFolderError, match=r"release 0\.1\.0, which listed no files"):
        accept(there)
    assert (there / STATUS).read_bytes() == before


@pytest.mark.parametrize("there", ["832ce44/run"], indirect=True)
def test_a_stopped_run_of_another_format_is_not_resumed(there: Path) -> None:
    write_status(there, read_status(there) | {"status": "interrupted"})
    with pytest.raises(RunFolderError, match="was begun by an earlier release; run it again with force=True"):
        resume(there)


@pytest.mark.parametrize("there", ["e02a04e/run", "832ce44/run"], indirect=True)
def test_what_plain_lmp_left_of_an_old_deck_is_adopted(there: Path) -> None:
    own = Record.load(there)
    for name in ("run.json", "trajectory.csv"):
        (there / name).unlink()
    first = "slip_at" not in (there / "log.lammps").read_text(encoding="utf-8")
    # The first decks did not write their variables into the log
    record = adopt(there, there.parent / "adopted", changes={"wave.amplitude": 0.2} if first else None)
    assert record.scene == own.scene
    assert {name: each["value"] for name, each in record.info["guards"].items()} == {
        name: each["value"] for name, each in own.info["guards"].items()
    }
    assert record.info["looks"]["every_tau"] == (5.0 if first else 0.0)  # the latter kept extremes of every step
    again = Record.load(there.parent / "adopted")
    for name, values in own.signals.items():
        np.testing.assert_allclose(again.signals[name], values, rtol=0, atol=1e-12)  # of the same dump


@pytest.mark.parametrize("there", ["e02a04e/run"], indirect=True)
@pytest.mark.parametrize(
    ("lost", "put", "said"),
    [
        (r"^ +50 .*\n", "", "step 50"),
        (" v_slip ", " v_x ", "the guard largest_slip"),
        (" v_open ", " v_x ", "the guard open"),
    ],
)
def test_an_old_log_that_lacks_a_line_or_a_guard_is_refused(lost: str, put: str, said: str, there: Path) -> None:
    log = there / "log.lammps"
    text = log.read_text(encoding="utf-8")
    log.write_text(re.sub(lost, put, text, flags=re.MULTILINE), encoding="utf-8")
    with pytest.raises(LammpsError, match=f"the log lacks {said}"):
        adopt(there, there.parent / "adopted", changes={"wave.amplitude": 0.2})


# --- sweeps ---


@pytest.mark.parametrize("there", SWEEPS, indirect=True)
def test_an_old_sweep_is_finished_and_none_of_its_runs_is_repeated(drawn_once: None, there: Path) -> None:
    found = Sweep.load(there)
    assert [row["status"] for row in found.rows] == ["finished", "finished"]
    assert {there / row["run"] for row in found.rows} == set((there / "runs").iterdir())
    assert all(found.record(row).info["status"] == "finished" for row in found.rows)
    assert main(["view", str(there), "-o", str(there.parent / "out.png")]) == 0
    before = files(there / "runs")
    assert sweep(found.scene, found.over, there).rows == found.rows
    assert files(there / "runs") == before


# --- names of runs ---


@pytest.mark.parametrize("name", NAMES)
def test_the_name_of_a_run_is_that_of_the_last_release(name: str) -> None:
    assert names_of(Scene.from_dict(NAMES[name]))[0] == name


@pytest.mark.parametrize(("kind", "variant"), [("Scene", WAVE), ("ImpactScene", NOT_HELD)])
def test_no_default_changes_and_no_key_is_lost(kind: str, variant: str) -> None:
    """A file that does not say a key would mean something else, and two runs would have one name."""
    now = {f"{key.section}.{key.name}": "must be given" if key.required else key.default for key in keys(variant)}
    data = frozen(kind) | dotted(json.loads(YOUNGER.read_text(encoding="utf-8"))[kind])
    assert json.loads(json.dumps(now)) == data, f"a new key joins {YOUNGER.name}, and no other line changes"


@dataclass(frozen=True)
class YoungerPacking(Packing):
    """A table with a made-up key."""

    coats: int = count("along z", 1, 100, default=1)


@dataclass(frozen=True)
class YoungerEffects(Effects):
    """A table with a made-up effect."""

    capillarity: bool | str = switch("menisci between spheres")


@pytest.fixture
def younger(monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with two keys that the earlier release did not have."""
    monkeypatch.setitem(Scene.layout.sections, "packing", YoungerPacking)
    monkeypatch.setitem(Scene.layout.sections, "effects", YoungerEffects)


@pytest.mark.usefixtures("younger")
@pytest.mark.parametrize("there", SWEEPS[:2], indirect=True)
def test_a_new_key_leaves_finished_sweeps_finished(there: Path) -> None:
    found = Sweep.load(there)
    assert found.scene.to_dict()["packing"]["coats"] == 1
    assert [row["status"] for row in found.rows] == ["finished", "finished"]


@pytest.mark.usefixtures("younger")
def test_a_new_key_is_part_of_the_name_where_it_departs() -> None:
    scene = Scene.from_dict(NAMES["9e298ea678f7394c"])
    changes = [{}, {"packing.coats": 1}, {"effects.capillarity": False}]
    others = [{"packing.coats": 2}, {"effects.capillarity": True}]
    assert {names_of(scene.with_values(each))[0] for each in changes} == {"9e298ea678f7394c"}
    assert len({names_of(scene.with_values(each))[0] for each in [{}, *others]}) == 3


def test_a_new_table_is_part_of_the_name_where_it_departs(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene.from_dict(NAMES["9e298ea678f7394c"])
    told = scene.to_dict()
    sections = Scene.layout.sections | {"substrate": YoungerPacking}
    monkeypatch.setattr(Scene, "layout", replace(Scene.layout, sections=sections))
    for coats, same in ((1, True), (2, False)):
        table = {name: item.default for name, item in YoungerPacking.__dataclass_fields__.items()} | {"coats": coats}
        monkeypatch.setattr(Scene, "to_dict", lambda self, table=table: told | {"substrate": table})
        assert (names_of(scene)[0] == "9e298ea678f7394c") == same


def test_another_value_of_an_old_key_gives_another_name() -> None:
    scene = Scene.from_dict(NAMES["9e298ea678f7394c"])
    assert scene_hash(scene.with_values({"wave.amplitude": 0.06})) not in names_of(scene)
