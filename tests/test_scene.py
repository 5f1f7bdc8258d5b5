"""Scenes: what is read, what is refused and with which words, what follows from the values."""

import re
from math import inf, nan, pi
from typing import Any

import pytest

from analysis.lattice import rows, torus
from analysis.second_harmonic import mode, ratios
from granular_lmp.errors import SceneError
from granular_lmp.modes import mode_along_y
from granular_lmp.packing import unit_lattice
from granular_lmp.scene import MODES, SHIPPED, Scene, assignment
from granular_lmp.shape import FASTEST_ROWS_PER_TAU
from granular_lmp.sphere import Sphere
from tests.conftest import PAPER

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


def test_defaults_are_filled_in_and_written_out() -> None:
    text = Scene.loads(PAPER_MINIMAL).to_toml()
    for line in (
        "columns = 3",
        'ends = "fixed"',
        "timestep = 0.05",
        "sample = 0.5",
        "allow_echo = false",
        "phase = 0.0",
    ):
        assert line in text


@pytest.mark.parametrize("folder", sorted(path.parent.name for path in SHIPPED.glob("*/scene.toml")))
def test_every_shipped_scene_is_found_by_its_name(folder: str) -> None:
    assert Scene.load(folder).name == folder


# Each: what is changed, and the key, value and hint that the one line of the error must hold.
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"sphere.poisson_ratio": 0.6}, r"sphere\.poisson_ratio = 0\.6: must be a number in \(-1, 0\.5\]"),
    ({"sphere.poisson_ratio": -1.5}, r"sphere\.poisson_ratio = -1\.5"),
    ({"sphere.radius": 0}, r"sphere\.radius = 0\.0: must be a number in \[1e-9, 1\], m"),
    ({"sphere.radius": -5e-7}, r"sphere\.radius = -5e-07"),
    ({"sphere.youngs_modulus": nan}, r"sphere\.youngs_modulus = nan"),
    ({"sphere.density": inf}, r"sphere\.density = inf"),
    ({"sphere.work_of_adhesion": "0.06"}, r"sphere\.work_of_adhesion = '0\.06': must be 0 or a number"),
    ({"sphere.youngs_modulus": 1e4}, r"sphere: the static overlap is .* at most 0\.05 is allowed"),
    ({"wave.wavenumber": 0}, r"wave\.wavenumber = 0\.0: must be a number in \[1e-9, pi\], rad per row"),
    ({"wave.wavenumber": 3.2}, r"wave\.wavenumber = 3\.2: must be a number in \[1e-9, pi\]"),
    ({"wave.wavenumber": 10**400}, r"wave\.wavenumber = inf"),
    ({"wave.amplitude": True}, r"wave\.amplitude = True: must be a number"),
    ({"wave.mode": "S"}, r"wave\.mode = 'S': must be one of \"L\", \"TR\", \"RT\""),
    ({"output.particles": -1.0}, r"output\.particles = -1\.0: must be a number in \[0, 1e7\], in tau"),
    ({"output.particles": 0.7}, r"output\.particles = 0\.7: must be 0 or a whole multiple of time\.sample = 0\.5"),
    ({"output.particles": 121.0}, r"output\.particles = 121\.0: .* at most time\.duration = 120\.0"),
    ({"packing.rows": 200}, r"packing\.rows = 200: must be odd between fixed ends"),
    ({"packing.rows": 201, "packing.ends": "periodic"}, r"packing\.rows = 201: must be even in a periodic cell"),
    ({"packing.rows": 201.0}, r"packing\.rows = 201\.0: must be a whole number"),
    ({"packing.rows": 2}, r"packing\.rows = 2: must be a whole number from 4"),
    ({"packing.columns": 10**11}, r"packing\.columns = 100000000000: must be"),
    ({"packing.columns": 10**6}, r"packing\.rows x packing\.columns = 201 x 1000000: must be at most 10000000 spheres"),
    ({"packing.columns": 2}, r"packing\.columns = 2: .*at least 3 .*share one shear history"),
    ({"packing.ends": "open"}, r"packing\.ends = 'open': must be one of \"fixed\", \"periodic\""),
    ({"time.timestep": 0}, r"time\.timestep = 0\.0: must be a number in \[1e-09, 2\]"),
    ({"time.duration": 170}, r"time\.duration = 170\.0: the walls are heard .* set time\.allow_echo = true"),
    ({"time.sample": 500}, r"time\.sample = 500\.0: must be at most time\.duration"),
    ({"wave.amplitude": 100, "sphere.radius": 1e-9}, r"wave\.amplitude = 100\.0: must be at most"),
    ({"wave.lenght": 1}, r"wave\.lenght: unknown key; allowed: mode, wavenumber"),
    ({"wave.wavenumer": 1}, r"wave\.wavenumer: unknown key; did you mean 'wavenumber'\?"),
    ({"waves.mode": "L"}, r"waves\.mode: unknown key; did you mean 'wave'\?"),
    ({"name": "../escape"}, r"name = '\.\./escape': must be ASCII letters, digits"),
    ({"name": ""}, r"name = ''"),
]


@pytest.mark.parametrize(("changes", "message"), REFUSED, ids=lambda value: str(value)[:60])
def test_a_wrong_value_is_named_with_what_is_allowed(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        PAPER.with_values({"time.duration": 120, "time.timestep": 0.05, "time.sample": 0.5} | changes)
    assert re.search(message, str(caught.value)), caught.value
    assert "\n" not in str(caught.value)


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
    with pytest.raises(SceneError, match="no such scene file; shipped scenes: l_opening, l_wave, rt_wave"):
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
    for poisson_ratio in (-0.99, -0.5, 0.0, 0.17, 0.5):
        sphere = Sphere(0.5e-6, 73e9, poisson_ratio, 0.063, 2200.0)
        lattice, step = unit_lattice(sphere), pi / 400
        for name in MODES:
            frequencies = [mode_along_y(lattice, sphere, (i + 1) * step, name).frequency for i in range(400)]
            speeds = [abs(b - a) / step for a, b in zip(frequencies, frequencies[1:], strict=False)]
            assert max(speeds) <= FASTEST_ROWS_PER_TAU


@pytest.mark.parametrize("name", MODES)
def test_walls_are_not_heard_before_the_echo_time_and_are_soon_after(name: str) -> None:
    # 61 rows against the infinite lattice, both integrated without LAMMPS; the margin promises 1e-6 of the wave
    scene = PAPER.with_values({"packing.rows": 61, "time.duration": 10})
    wave, echo = mode(name, 0.802, ratios(0.17)), scene.echo_time
    late = {"L": 1.5, "TR": 2.0, "RT": 3.0}[name]  # the slower the group, the later its echo
    times = [0.9 * echo, echo, (late - 0.2) * echo, late * echo]
    walls, infinite = rows(wave, 0.2, times, 0.17, rows=61), torus(wave, 0.2, times, 0.17)
    departure = [max(abs(a[i] - b[i]) for a, b in zip(walls, infinite, strict=True)) for i in range(4)]
    assert max(departure[:2]) < 1e-6
    assert max(departure[2:]) > 1e-4


def test_an_assignment_is_read_as_toml_or_as_a_bare_word() -> None:
    assert assignment("wave.wavenumber=1.2") == ("wave.wavenumber", 1.2)
    assert assignment("wave.mode = TR") == ("wave.mode", "TR")
    assert assignment("time.allow_echo=true") == ("time.allow_echo", True)
    for wrong in ("wave.mode", "=3", "wave.mode="):
        with pytest.raises(SceneError, match="must be KEY=VALUE"):
            assignment(wrong)
