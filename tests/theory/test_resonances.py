"""Resonances and antiresonances of any crystal: those of the paper's in closed form, others in LAMMPS."""

import csv
from itertools import product
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cases.growth import case as growth
from granular_analysis import second_harmonic as sh
from granular_analysis.theory.bloch import frame, hexagonal
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.crystal import Crystal, padded
from granular_analysis.theory.lattices import LATTICES
from granular_analysis.theory.network import Material
from granular_analysis.theory.phase_matching import Match, matches, zone_edge
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.second_order import Mixed, branch_of
from granular_analysis.theory.selection import forbidden, mirrors
from granular_analysis.tools import resonances as script
from granular_lmp import Scene, run
from tests.conftest import members

ROOT3 = np.sqrt(3)
LAYERS = {"every": 2, "density": 4400.0}
LAYERED = Scene.load("tr_periodic").with_values(
    {"packing.rows": 24, "packing.columns": 3, "inclusion": [LAYERS | {"rows": [0, 23]}]}
)


def growing(found: list[Match]) -> list[Match]:
    return [each for each in found if each.rate > 0]


@pytest.mark.parametrize("overlap_ratio", [0.0, 2.5e-4])
def test_the_papers_crystal_has_one_resonance_and_one_antiresonance(overlap_ratio: float) -> None:
    contact = Contact(0.17, overlap_ratio=overlap_ratio)
    found = matches(hexagonal(contact), (0, 1))
    (resonance,) = growing(found)
    (silent,) = (each for each in found if each.kind == "antiresonance")
    xi = ROOT3 / 2
    # Roots of functions that are known to 1e-15 and have slopes of some tenths; a zero of a force loses a digit more
    assert resonance.wavenumber * xi == pytest.approx(sh.resonance(contact.closed), abs=1e-12)
    assert silent.wavenumber * xi == pytest.approx(sh.antiresonance(contact.closed), abs=1e-11)
    assert (resonance.branch, resonance.target) == (silent.branch, silent.target) == (0, 1)
    mode = sh.mode("TR", sh.resonance(contact.closed), contact.closed)
    # On the resonance p grows at the rate of the closed form, per square of the amplitude
    late = sh.second_harmonic(mode, contact.closed, 1.0, np.linspace(9990, 10000, 2001))
    assert np.abs(late).max() / 1e4 == pytest.approx(resonance.rate, rel=1e-3)
    forbidden = {each.forbidden for each in found if each.kind == "resonance" and not each.rate}
    assert forbidden == {
        "forbidden by a mirror: even + even is even, and this branch is odd",
        "forbidden by a mirror: odd + odd is even, and this branch is odd",
    }


def test_every_sign_of_a_detuning_that_changes_is_found() -> None:
    crystal, edge = hexagonal(Contact(0.3)), 2 * np.pi / ROOT3
    numbers = edge * np.arange(1, 4998) / 4997  # none of which is a resonance, as is half of the edge
    waves, doubled = (crystal.modes(np.outer(factor * numbers, (0, 1))).frequencies for factor in (1, 2))
    changes = np.count_nonzero(np.diff(np.sign(2 * waves[:, :, None] - doubled[:, None]), axis=0))
    assert zone_edge(crystal, (0, 1)) == pytest.approx(edge)
    assert len([each for each in matches(crystal, (0, 1)) if each.kind == "resonance"]) == changes


def test_mirrors_are_found_and_only_those() -> None:
    angles = sorted(_angle(each.normal) for each in mirrors(hexagonal(Contact(0.17))) if abs(each.normal[2]) < 1e-9)
    assert angles == pytest.approx([0, 30, 60, 90, 120, 150])
    # Rows of two densities have the mirror along y and the one along x; without it nothing would be forbidden
    layered = [_angle(each.normal) for each in mirrors(Setting(LAYERED).crystal()) if abs(each.normal[2]) < 1e-9]
    assert sorted(layered) == pytest.approx([0, 90])


def _angle(normal: NDArray[np.float64]) -> float:
    """Return the angle of a direction from x, in degrees, the same of its opposite."""
    return round(float(np.degrees(np.arctan2(normal[1], normal[0]))), 9) % 180


CELLS = {"square": ("", [0.7, 0.0]), "honeycomb": ("", [0.0, 0.5]), "fcc": ("[001]", [0.0, 0.6, 0.0])}


@pytest.mark.parametrize("name", CELLS)
def test_what_two_waves_of_any_crystal_may_not_make_they_do_not(name: str) -> None:
    orientation, k = CELLS[name]
    lattice, apart = LATTICES[name, orientation], 1000 - 0.2498514361612
    vectors, basis = apart * lattice.vectors[:, : len(k)], apart * lattice.basis[:, : len(k)]
    crystal = Crystal.of(vectors, basis, 500.0, 2.2e-3, [Material(73e3, 0.17, 63.0)])
    one, other = np.array(k) / apart, np.array([*reversed(k[:2]), *k[2:]]) / apart
    found = []
    for second, first, partner in product((1.3 * one, other), range(4), range(4)):
        if max(first, partner) < 3 * len(basis):
            pair = Mixed(crystal, branch_of(crystal, one, first), branch_of(crystal, second, partner))
            banned, drives = forbidden(pair), np.abs(pair.steady)
            assert drives[banned].max(initial=0.0) < 1e-9 * crystal.highest**2
            found += [*banned]
    assert 0 < sum(found) < len(found)


def _space(name: str, orientation: str) -> Crystal:
    lattice, apart = LATTICES[name, orientation], 1000 - 0.2498514361612
    return Crystal.of(apart * lattice.vectors, apart * lattice.basis, 500.0, 2.2e-3, [Material(73e3, 0.17, 63.0)])


@pytest.mark.parametrize(
    ("lattice", "degrees"),
    members([(("fcc", "[001]"), 23.0), (("hcp", "c"), 71.0), (("cubic", "[001]"), 23.0)], (("hcp", "c"), 71.0)),
)
def test_an_oblique_direction_and_its_mirror_image_have_one_list(lattice: tuple[str, str], degrees: float) -> None:
    """Rounding differs between the two, as it does between processors."""
    crystal = _space(*lattice)
    one, image = (matches(crystal, frame(angle)[0]) for angle in (degrees, 180 - degrees))
    columns = [[(each.kind, each.branch, each.target, bool(each.rate)) for each in found] for found in (one, image)]
    assert columns[0] == columns[1]
    assert [each.wavenumber for each in one] == pytest.approx([each.wavenumber for each in image], rel=1e-9)


@pytest.mark.parametrize("degrees", members([23.0, 45.0], 23.0))
def test_an_antiresonance_is_where_a_force_changes_its_sign_and_a_forbidden_branch_has_none(degrees: float) -> None:
    crystal, along = _space("fcc", "[001]"), padded(frame(degrees)[0])
    silent = [each for each in matches(crystal, along) if each.kind == "antiresonance"]
    assert silent
    for each in silent:
        # Rounding moves a zero by up to 1e-9 of its wave number, a part in a thousand of these distances
        numbers = each.wavenumber * (1 + 1e-6 * np.array([-2.0, -1.0, 1.0, 2.0]))
        one = branch_of(crystal, np.outer(numbers, along), each.branch)
        pair = Mixed(crystal, one, one)
        force = pair.steady[:, each.target]
        assert not forbidden(Mixed(crystal, *2 * [branch_of(crystal, numbers[0] * along, each.branch)]))[each.target]
        # A force that changes its sign grows in proportion to the distance, and as far on both sides; one that has none
        # is rounding
        far, near = np.abs(force[[0, 3]]), np.abs(force[[1, 2]])
        assert far.sum() == pytest.approx(2 * near.sum(), rel=1e-3)
        assert abs(near[1] - near[0]) < 1e-3 * near.sum()
        share = np.sum(pair.targets.duals[0, each.target] * pair.targets.shapes[3, each.target])
        wave = np.sum(crystal.modes(numbers[0] * along).duals[each.branch] * one.shape[3])
        turned = force[3] * share * wave.conj() ** 2 / force[0]
        assert turned.real / abs(turned) == pytest.approx(-1, abs=1e-3)


def test_honeycomb_has_resonances_that_a_chain_of_formulas_would_not_find() -> None:
    silica = Material(73e3, 0.17, 63.0)
    radius, depth = 500.0, 0.2498514361612
    a = 2 * radius - depth
    vectors = a * np.array([[ROOT3 / 2, 1.5], [-ROOT3 / 2, 1.5]])
    crystal = Crystal.of(vectors, [[0, 0], [0, a]], radius, 2.2e-3, [silica])
    found = growing(matches(crystal, (1.0, 0.0)))
    assert found
    for each in found:
        k = each.wavenumber * np.array([1.0, 0.0])
        twice = crystal.modes(2 * k).frequencies[each.target]
        assert 2 * crystal.modes(k).frequencies[each.branch] == pytest.approx(twice, rel=1e-12)


@pytest.mark.parametrize(
    ("mode", "cycles", "rows", "amplitude"),
    [("L", 23, 150, 0.0025), ("TR", 18, 130, 0.01)],
    ids=["L", "TR"],
)
@pytest.mark.more  # the next test holds the growth at a resonance of a layered crystal in LAMMPS in `make test`
def test_lammps_has_the_resonances_of_a_layered_crystal(
    mode: str, cycles: int, rows: int, amplitude: float, tmp_path: Path
) -> None:
    """The nearest waves that a periodic crystal holds, 5e-5 and 8e-4 rad per row from the resonances."""
    wavenumber = 2 * pi * cycles / rows
    layered = LAYERED.with_values({"packing.rows": rows, "inclusion": [LAYERS | {"rows": [0, rows - 1]}]})
    setting = Setting(layered)
    near = growing(matches(setting.crystal(), setting.wavevector(1.0)))
    assert min(abs(each.wavenumber / setting.unit - wavenumber) for each in near) < 1e-3
    values = {
        "wave.mode": mode,
        "wave.wavenumber": wavenumber,
        "wave.amplitude": amplitude,
        "time.duration": 160.0,
        "time.sample": 1.0,
    }
    even = np.zeros(3)[:, None]
    for step, weight in ((0.2, -1 / 3), (0.1, 4 / 3)):
        for phase in (0.0, pi):
            record = run(
                layered.with_values(values | {"time.timestep": step, "wave.phase": phase}), tmp_path / f"{step} {phase}"
            )
            even = even + weight / 2 * np.nan_to_num([record.p, record.q, record.phi])
    theory = np.array(Setting(record.scene).signals(record.tau)[1])
    assert np.abs(theory[0][-40:]).max() > 3 * np.abs(theory[0][:40]).max()  # it grows
    # Of the step's error, which the square of τ multiplies, the fourth order is left
    assert np.linalg.norm(even - theory) < 3e-3 * np.linalg.norm(theory)


BEST_LAYERS = {"wave.mode": "L", "packing.rows": 130, "wave.wavenumber": 1.111643, "wave.amplitude": 0.0025}
BEST_LAYERS |= {"packing.columns": 3, "inclusion": [LAYERS | {"rows": [0, 129], "density": 5293.4}]}
ALONG_A_ROW = {"wave.mode": "TR", "packing.rows": 4, "packing.columns": 53, "wave.direction": "x"}
ALONG_A_ROW |= {"wave.wavenumber": 1.540018, "wave.amplitude": 0.005}


@pytest.mark.parametrize("values", members([BEST_LAYERS, ALONG_A_ROW], ALONG_A_ROW), ids=["layers", "row"])
def test_lammps_has_the_growth_of_the_best_layers_and_along_a_row(values: dict[str, Any], tmp_path: Path) -> None:
    short = {"time.duration": 30.0, "time.sample": 1.0, "output.particles": 1.0}
    scene = Scene.load("tr_periodic").with_values(short | values)
    runs = [run(scene.with_values({"wave.phase": phase}), tmp_path / f"{phase:.0f}") for phase in (pi, 0.0)]
    (records,) = growth.pairs(runs)
    each = growth.Growing.of(scene)
    found = growth.measured(each, records)
    assert found == pytest.approx(each.theory, rel=1e-2)
    assert found != pytest.approx(1.03 * each.theory, rel=1e-2)
    assert found > 5 * growth.UNIFORM
    with pytest.raises(ValueError, match="needs one partner whose wave.phase is larger by pi"):
        growth.pairs(runs[:1])


@pytest.mark.usefixtures("drawn_once")
def test_the_command_prints_a_table_and_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script.main(["tr_periodic", "-o", str(tmp_path / "new" / "a.png")])
    text = capsys.readouterr().out
    assert "1.476273    TR -> L" in text
    assert "2.129234    TR -> L" in text
    assert text.split("\n")[-2].startswith("TR at xi = 0.785398, a = 0.2: contacts open at a = ")
    with (tmp_path / "new" / "a.csv").open() as stream:
        found = list(csv.DictReader(stream))
    (grows,) = (each for each in found if float(each["growth"]) > 0)
    assert float(grows["growth"]) == pytest.approx(0.0316, abs=5e-5)
    assert float(grows["frequency_Hz"]) == pytest.approx(159.0427e6, rel=1e-6)
    assert (tmp_path / "new" / "a.png").stat().st_size > 10_000


@pytest.mark.usefixtures("drawn_once")
def test_the_map_of_a_square_crystal_has_its_symmetry(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script.main(["tr_square", "--map", "5", "-o", str(tmp_path / "map.png")])
    assert "a = 0.2: contacts are not stretched in first order and slide below" in capsys.readouterr().out
    with (tmp_path / "map.csv").open() as stream:
        found = list(csv.DictReader(stream))
    by_angle = {
        angle: [round(float(each["wavenumber"]), 6) for each in found if float(each["direction"]) == angle]
        for angle in (0.0, 45.0, 90.0, 135.0, 180.0)
    }
    assert by_angle[0] == by_angle[90] == by_angle[180]
    assert by_angle[45] == by_angle[135] != by_angle[0]


def test_a_branch_by_number_is_refused_where_branches_have_names(tmp_path: Path) -> None:
    scene = tmp_path / "uniform.toml"
    scene.write_text(Scene.load("tr_periodic").with_values({"wave.mode": "2"}).to_toml())
    with pytest.raises(SystemExit, match=r"mode = '2' is not a branch of this crystal; allowed: L, TR, RT"):
        script.main([str(scene)])


def test_the_page_shows_what_is_found() -> None:
    page = (Path(__file__).parents[2] / "docs/resonances.md").read_text()
    found = script.rows(Setting(LAYERED), Setting(LAYERED).crystal(), 90.0)
    fastest = max(found, key=lambda row: row[6])
    assert f"$\\xi={fastest[2]:.4f}$. Its second harmonic gains {fastest[6]:.3f} $D_0$ a period" in page.replace(
        "\n", " "
    )
    shipped = Setting(Scene.load("tr_periodic"))
    lines = script.table(script.rows(shipped, shipped.crystal(), 90.0), several=False).split("\n")
    shown = [line for line in page.split("\n") if line.startswith(("resonance ", "antiresonance "))]
    assert set(shown) <= set(lines)
    assert len(shown) == 3
    assert fastest[6] > 5 * max(row[6] for row in script.rows(shipped, shipped.crystal(), 90.0))
