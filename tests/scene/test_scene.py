"""Scenes: what is read, what is refused and with which words, what follows from the values."""

import copy
import pickle
import re
from dataclasses import replace
from math import atan2, degrees, hypot, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.paper_rows import rows
from granular_analysis.second_harmonic import mode, ratios
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.lattice import torus
from granular_analysis.theory.wave import Wave
from granular_lmp import build
from granular_lmp.crystal.lattices import lattice_constant, unit_lattice
from granular_lmp.crystal.modes import MODES, bloch_modes
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import ROW_SPACING
from granular_lmp.errors import SceneError
from granular_lmp.rest.linear import plane_along_y, uniform_rows
from granular_lmp.rest.scene import Scene, assignment
from granular_lmp.rest.shape import FASTEST_ROWS_PER_TAU
from granular_lmp.scene.collision import Collision
from granular_lmp.scene.shipped import SHIPPED
from tests.conftest import PAPER, members

PAPER_MINIMAL = """
[sphere]
radius = 0.5e-6
youngs_modulus = 73e9
poisson_ratio = 0.17
work_of_adhesion = 0.063
density = 2200
[packing]
rows = 201
[wave]
mode = "TR"
wavenumber = 0.802
amplitude = 0.2
[time]
duration = 120
"""


def test_a_scene_survives_the_way_through_toml() -> None:
    scene = PAPER.with_values({"sphere.radius": 4.76e-3, "wave.wavenumber": 1 / 3, "time.allow_echo": True})
    assert Scene.loads(scene.to_toml()) == scene


def test_a_file_holds_what_was_given_and_the_full_form_every_default() -> None:
    scene = Scene.loads(PAPER_MINIMAL)
    text, full = scene.to_toml(), scene.to_toml(full=True)
    assert Scene.loads(text) == Scene.loads(full) == scene
    for line in (
        'columns = "auto"',
        'ends = "fixed"',
        "timestep = 0.05",
        "sample = 0.5",
        "allow_echo = false",
        "phase = 0.0",
    ):
        assert line in full
        assert line not in text


@pytest.mark.parametrize("folder", sorted(path.parent.name for path in SHIPPED.glob("*/scene.toml")))
def test_every_shipped_scene_is_found_by_its_name(folder: str) -> None:
    assert Scene.load(folder).name == folder


def test_a_missing_key_and_a_missing_table_are_named() -> None:
    tables = PAPER.to_dict()
    del tables["wave"]["amplitude"]
    with pytest.raises(SceneError, match=r"wave\.amplitude: missing key; must be a number"):
        Scene.from_dict(tables)
    with pytest.raises(SceneError, match=r"sphere: missing table; it holds radius, youngs_modulus"):
        Scene.from_dict({"name": "x"})
    with pytest.raises(SceneError, match=r"wave = 3: must be a table"):
        Scene.from_dict(PAPER.to_dict() | {"wave": 3})


def test_unreadable_files_are_named(tmp_path: Any) -> None:
    with pytest.raises(
        SceneError, match="no such scene file; shipped scenes: corner_source, fcc_transverse, hcp_c_axis, l_beam, "
    ):
        Scene.load("nowhere")
    for impossible in ("a" * 300, "a\0b"):
        with pytest.raises(SceneError, match="no such scene file"):
            Scene.load(impossible)
    (tmp_path / "broken.toml").write_text("name = ")
    with pytest.raises(SceneError, match=r"broken\.toml: not valid TOML"):
        Scene.load(tmp_path / "broken.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SceneError, match="cannot be read as UTF-8"):
        Scene.load(tmp_path / "binary.toml")


def test_steps_fit_into_samples_and_are_never_longer_than_asked() -> None:
    for timestep, expected in ((0.05, 10), (0.03, 17), (0.5, 1), (0.1, 5)):
        time = PAPER.with_values({"time.timestep": timestep}).time
        assert time.steps_per_sample == expected
        assert time.step <= timestep
        assert time.steps == expected * 240


def test_the_wave_number_snaps_to_the_periodic_cell_and_the_scene_says_so() -> None:
    scene = PAPER.with_values({"packing.ends": "periodic", "packing.rows": 16, "wave.wavenumber": 0.8})
    assert scene.wavenumber == pytest.approx(2 * pi / 8, rel=1e-15)
    (remark,) = scene.remarks()
    assert "2 pi 2/16" in remark
    assert PAPER.remarks() == []
    with pytest.raises(SceneError, match=r"wave\.wavenumber = 0\.1: snaps to 0 .* the smallest is 2 pi/16"):
        scene.with_values({"wave.wavenumber": 0.1})


def test_no_branch_is_faster_than_the_long_longitudinal_wave() -> None:
    step = pi / 400
    for poisson_ratio in (-0.99, -0.5, 0.0, 0.17, 0.5):
        sphere = Sphere(0.5e-6, 73e9, poisson_ratio, 0.063, 2200.0)
        per_radius = step * np.arange(1, 401) / (ROW_SPACING * lattice_constant(sphere))
        along_y = np.column_stack([np.zeros(400), per_radius])
        frequencies, _ = bloch_modes(unit_lattice(sphere), sphere, along_y)  # ascending: slower where branches cross
        assert np.abs(np.diff(frequencies, axis=0)).max() <= FASTEST_ROWS_PER_TAU * step


@pytest.mark.parametrize("name", members(MODES, "RT"))
def test_walls_are_not_heard_before_the_echo_time_and_are_soon_after(name: str) -> None:
    # 41 rows against the infinite lattice, both integrated without LAMMPS; the margin promises 1e-6 of the wave
    scene = PAPER.with_values({"packing.rows": 41, "time.duration": 10})
    wave, echo = mode(name, 0.802, ratios(0.17)), scene.echo_time
    late = {"L": 1.5, "TR": 2.0, "RT": 3.0}[name]  # the slower the group, the later its echo
    times = [0.9 * echo, echo, (late - 0.2) * echo, late * echo]
    walls, infinite = rows(Wave(wave, 0.2, Contact(0.17)), times, rows=41), torus(Wave(wave, 0.2, Contact(0.17)), times)
    departure = [max(abs(a[i] - b[i]) for a, b in zip(walls, infinite, strict=True)) for i in range(4)]
    assert max(departure[:2]) < 1e-6
    assert max(departure[2:]) > 1e-4


def test_an_assignment_is_read_as_toml_or_as_a_bare_word() -> None:
    assert assignment("wave.wavenumber=1.2") == ("wave.wavenumber", 1.2)
    assert assignment("wave.mode = TR") == ("wave.mode", "TR")
    assert [assignment(f"a={text}")[1] for text in (".1", "-1.", "+.5e-3")] == [0.1, -1.0, 5e-4]
    assert assignment("wave.mode=.") == ("wave.mode", ".")
    assert assignment("time.allow_echo=true") == ("time.allow_echo", True)
    assert assignment("wave.amplitude=1 # half of it") == ("wave.amplitude", 1)
    for wrong in ("wave.mode", "=3", "wave.mode="):
        with pytest.raises(SceneError, match="must be KEY=VALUE"):
            assignment(wrong)
    with pytest.raises(SceneError, match=r"wave.amplitude = '1.nname=2'"):  # one assignment sets one value
        PAPER.with_values(dict([assignment("wave.amplitude=1\nname=2")]))


ANYWHERE = {"packing.ends": "auto", "packing.rows": "auto", "packing.columns": "auto"}


def test_a_wave_vector_is_another_way_to_write_wave_number_and_direction() -> None:
    oblique = PAPER.with_values(ANYWHERE | {"wave.wavevector": [0.5, 0.8]})
    assert oblique.wave.wavenumber == pytest.approx(sqrt(3) / 2 * hypot(0.5, 0.8), rel=1e-15)
    assert oblique.wave.degrees == pytest.approx(degrees(atan2(0.8, 0.5)), rel=1e-15)
    assert Scene.loads(oblique.to_toml()) == oblique
    again = PAPER.with_values(ANYWHERE | {"wave.wavenumber": oblique.wave.wavenumber, "wave.direction": 57.99461679})
    assert again.vector == oblique.vector


def test_an_oblique_wave_gets_the_smallest_cell_that_carries_it_and_the_scene_says_so() -> None:
    scene = PAPER.with_values(ANYWHERE | {"wave.wavenumber": 1.1, "wave.direction": 20.0})
    shape = scene.shape
    assert shape.ends == "periodic"
    assert shape.rows % 2 == 0
    assert abs(scene.vector.per_row - scene.declared_vector.per_row) < 1e-3
    assert abs(scene.vector.per_column - scene.declared_vector.per_column) < 1e-3
    remarks = scene.remarks()
    assert any(
        "at 20.0 degrees is snapped to" in remark and f"/{shape.columns} per column" in remark for remark in remarks
    )
    along_x = PAPER.with_values(ANYWHERE | {"wave.wavenumber": pi / 4 * sqrt(3) / 2, "wave.direction": "x"})
    assert (along_x.shape.rows, along_x.shape.columns) == (4, 8)


@pytest.mark.parametrize("direction", ["y", 90.0])
def test_a_wave_along_y_is_the_papers_however_it_is_written(direction: str | float) -> None:
    scene = PAPER.with_values({"wave.direction": direction})
    assert plane_along_y(scene)
    assert uniform_rows(scene)
    assert scene.vector == PAPER.vector
    for other in ({"wave.form": "standing"}, {"envelope.length": 9.0}, {"wave.direction": -90.0}):
        assert not plane_along_y(PAPER.with_values(other))


def test_the_zone_ends_elsewhere_in_other_directions() -> None:
    corner = PAPER.with_values(ANYWHERE | {"wave.wavenumber": 3.6275, "wave.direction": "x"})
    assert corner.shape.columns == 3  # 4π/3 a column at K


def test_an_envelope_has_room_in_a_packing_that_is_left_to_us() -> None:
    pulse = PAPER.with_values(ANYWHERE | {"wave.direction": 35.0, "envelope.length": 8.0, "envelope.width": 6.0})
    along, across = 10 * 8.0, 10 * 6.0
    x, y = pulse.declared_vector.unit
    assert pulse.shape.rows >= hypot(along * y, across * x)
    assert pulse.shape.columns >= hypot(along * x, across * y) * sqrt(3) / 2
    packet = PAPER.with_values({"packing.rows": "auto", "time.duration": 10.0, "envelope.length": 20.0})
    assert packet.shape.rows == 201  # not the 21 whose walls are silent
    assert packet.shape.columns == 3
    farther = packet.with_values({"envelope.offset": -30.0})
    assert farther.shape.rows == 261


def test_the_centre_of_a_driven_strip_hears_the_far_end_late() -> None:
    driven = PAPER.with_values({"wave.form": "driven", "packing.rows": "auto"})
    rows = driven.shape.rows
    distance = 1.5 * (rows - 1)
    assert driven.echo_time == pytest.approx(2 * (distance - 3.5 * distance ** (1 / 3)))
    assert driven.echo_time >= driven.time.duration
    assert PAPER.with_values({"wave.form": "driven", "packing.rows": rows - 2, "time.allow_echo": True}).echo_time < 120


def test_a_packet_along_y_gets_walls_and_not_a_cell_that_it_runs_around() -> None:
    packet = PAPER.with_values(ANYWHERE | {"wave.wavenumber": pi / 4, "envelope.length": 10.0, "time.duration": 500.0})
    assert packet.shape.ends == "fixed"
    assert packet.echo_time >= 500
    assert PAPER.with_values(ANYWHERE | {"wave.wavenumber": pi / 4}).shape.ends == "periodic"  # a plane wave
    for form, ways in (("running", 1), ("standing", 2)):
        cell = packet.with_values({"packing.ends": "periodic", "wave.form": form})
        assert cell.shape.rows >= 100 + ways * 250  # ten standard deviations, and ½ row per τ


def test_a_wave_that_runs_down_is_said_to() -> None:
    down = PAPER.with_values({"packing.ends": "periodic", "packing.rows": 20, "wave.direction": -90.0})
    (remark,) = down.remarks()
    assert "2 pi 3/20" in remark
    assert "along -y" in down.words
    assert "along -y" in repr(down)
    assert down.vector.per_row < 0


def test_what_rounds_to_itself_is_not_called_snapped() -> None:
    exact = PAPER.with_values({"packing.ends": "periodic", "packing.rows": 16, "wave.wavenumber": pi / 4 - 1e-16})
    assert exact.remarks() == []


def test_a_direction_that_rounds_to_itself_is_not_said_to_change() -> None:
    oblique = PAPER.with_values(ANYWHERE | {"wave.wavenumber": 1.1, "wave.direction": 20.0})
    cell = {"packing.ends": "periodic", "packing.rows": oblique.shape.rows, "packing.columns": oblique.shape.columns}
    there = {"wave.wavenumber": oblique.wavenumber * (1 + 1e-7), **cell}  # snaps to that of `oblique`
    for turned, said in ((2e-11, False), (1e-10, True)):  # degrees; 1e-12 rad are rounding
        used = PAPER.with_values({**there, "wave.direction": oblique.direction + turned}).used
        assert "wave.wavenumber" in used
        assert ("wave.direction" in used) == said


def test_a_wave_that_snaps_to_quite_another_one_is_warned_of() -> None:
    cell = {"packing.ends": "periodic", "packing.rows": 24, "packing.columns": 3, "wave.direction": 40.0}
    (remark,) = PAPER.with_values(cell).remarks()
    assert re.search(r"per row; that is \d\d% away: use more rows or columns", remark)
    (near,) = PAPER.with_values(cell | {"packing.rows": 200, "packing.columns": 200}).remarks()
    assert "away" not in near


def test_a_scene_without_a_name_is_called_after_its_file_or_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = PAPER.to_toml().split("\n", 1)[1]
    for folder in ("glass", "two words"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "scene.toml").write_text(text)
    (tmp_path / "steel.toml").write_text(text)
    assert Scene.load(tmp_path / "steel.toml").name == "steel"
    assert Scene.load(tmp_path / "glass").name == Scene.load(tmp_path / "glass" / "scene.toml").name == "glass"
    monkeypatch.chdir(tmp_path / "glass")
    assert Scene.load("scene.toml").name == Scene.load(".").name == "glass"
    with pytest.raises(
        SceneError, match="name = 'two words', taken from the file's name .*: must be a string of at most 200 ASC"
    ):
        Scene.load(tmp_path / "two words")


def test_a_byte_order_mark_is_no_part_of_a_scene(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("\ufeff" + PAPER.to_toml(), encoding="utf-8")
    assert Scene.load(tmp_path / "a.toml") == PAPER


@pytest.mark.parametrize("name", ["tr_oblique", "struck_crystal", "multilayer", "test5"])
def test_a_change_comes_before_any_check_of_the_value_in_the_file(name: str, tmp_path: Path) -> None:
    document = (Collision if name == "test5" else Scene).load(name)
    file, lines, table = tmp_path / f"{name}.toml", document.to_toml().splitlines(), ""
    for number, line in enumerate(lines):
        if header := re.fullmatch(r"(\[+)(\w+)\]+", line):
            before = lines[: number + 1].count(line)
            table = f"{header[2]}.{before}." if header[1] == "[[" else f"{header[2]}."
        elif line:
            key, value = assignment(line)
            file.write_text("\n".join([*lines[:number], f"{key} = [-7.5]", *lines[number + 1 :]]))
            with pytest.raises(SceneError, match=re.escape(f"{file}: ")):
                Scene.load(file)
            assert type(document).load(file, {f"{table}{key}": value}) == document
            assert Scene.load(file, {f"{table}{key}": value}) == Scene.load(name)


def test_a_part_of_a_wave_vector_of_a_file_is_changed(tmp_path: Path) -> None:
    file = tmp_path / "vector.toml"
    file.write_text(PAPER_MINIMAL.replace("wavenumber = 0.802", "wavevector = [0.3, 0.4]"))
    scene = Scene.load(file, {"wave.wavenumber": 0.5})
    assert (scene.wave.wavenumber, scene.wave.direction) == (0.5, Scene.load(file).wave.direction)
    assert Scene.load(file, {"wave.wavevector": [0.0, 0.4]}).wave.direction == 90.0


def test_one_column_of_an_earlier_release_is_read_as_three_with_a_remark(small: Scene) -> None:
    scene = small.with_values({"packing.columns": 1})
    assert scene.shape.columns == 3
    assert build(scene).input_text == build(small).input_text
    assert scene.remarks()[0] == "packing.columns 1 is read as 3, the fewest that LAMMPS simulates correctly"
    assert not Scene.load("l_chain").remarks()  # a chain has one


# --- dataclasses.replace ---

KINDS = [Scene.load(name) for name in ("solitary_chain", "struck_sheet", "tr_periodic", "point_source")]
of_each_kind = pytest.mark.parametrize("scene", KINDS, ids=lambda scene: scene.name)


@of_each_kind
def test_a_scene_is_replaced_table_by_table(scene: Scene) -> None:
    time, material = replace(scene.time, duration=scene.time.duration / 2), replace(scene.material, density=2100.0)
    changed = replace(scene, time=time, material=material)
    assert changed == scene.with_values({"time.duration": time.duration, "sphere.density": 2100.0})
    assert replace(scene, sphere=material) == replace(scene, material=material)
    assert replace(scene) == scene


@of_each_kind
@pytest.mark.parametrize("table", ["time", "packing", "effects", "output"])
def test_a_table_of_a_scene_is_one_that_it_takes(scene: Scene, table: str) -> None:
    kept = getattr(scene, table)
    assert scene.replace(**{table: kept}) == scene.replace(**{table: replace(kept)}) == scene


@of_each_kind
def test_a_tolerance_takes_the_place_of_a_step(scene: Scene) -> None:
    time = replace(scene.time, tolerance=1e-3)
    assert scene.replace(time=time).time.tolerance == replace(scene, time=time).time.tolerance == 1e-3


def test_a_wave_of_a_frequency_is_replaced() -> None:
    scene = PAPER.with_values({"wave.frequency": 2e6})
    assert scene.replace(wave=replace(scene.wave, amplitude=0.1)) == scene.with_values({"wave.amplitude": 0.1})


def test_what_is_replaced_is_checked_again() -> None:
    with pytest.raises(SceneError, match=r"time\.duration"):
        replace(PAPER, time=replace(PAPER.time, duration=1e5))


@of_each_kind
def test_a_scene_is_copied_and_pickled_with_what_was_given(scene: Scene) -> None:
    for copied in (copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        assert copied == scene
        assert scene.replace(effects=copied.effects) == scene
