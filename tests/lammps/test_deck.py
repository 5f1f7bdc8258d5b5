"""Decks: the committed ones are what the package writes, and what they say can be changed can be changed."""

import re
import subprocess
from itertools import zip_longest
from math import isclose
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import Record, Scene, build, run
from granular_lmp.lammps.installation import lmp_command
from granular_lmp.lammps.outputs import read_centre
from granular_lmp.scene.shipped import SHIPPED
from granular_lmp.units import MICRO, NANO, SI, Units, units_for
from tests.instance import run_deck
from tests.manual import Measure, Mutant, off, verifies

PAPER = Scene.load("tr_resonant")
FOLDERS = sorted(path.parent.name for path in SHIPPED.glob("*/scene.toml"))


def lmp(folder: Path, deck: str, *variables: str) -> None:
    """Run a deck with plain lmp, as its user would."""
    pairs = [word for variable in variables for word in ("-var", *variable.split("="))]
    subprocess.run([*lmp_command(1), "-in", deck, "-screen", "none", *pairs], cwd=folder, check=True)


def test_the_paper_s_cases_and_the_other_modes_are_shipped() -> None:
    scenes = [each for each in map(Scene.load, FOLDERS) if each.wave and each.space == 2]
    waves = {(s.wave.mode, s.wave.wavenumber, s.packing.ends) for s in scenes}
    assert {("TR", xi, "fixed") for xi in (0.802, 1.475, 2.127)} <= waves
    assert {mode for mode, *_ in waves} == {"L", "TR", "RT"}
    assert "periodic" in {ends for *_, ends in waves}


def test_a_deck_names_a_dump_of_contacts_only_if_it_writes_one() -> None:
    scenes = [*map(Scene.load, FOLDERS), PAPER.with_values({"effects.sliding": False, "effects.friction": 0.3})]
    decks = [build(scene).input_text for scene in scenes]
    says, writes = ([text in deck for deck in decks] for text in ("then holds each contact", "dump         contacts "))
    assert says == writes == [False] * len(FOLDERS) + [True]


NUMBER = re.compile(r"(-?\d+(?:\.\d+)?(?:e[-+]\d+)?)")


def differing_lines(committed: str, made: str) -> list[str]:
    """Return the lines of a deck's file that differ from the committed ones by more than rounding.

    The last digits of a cosine or of a matrix depend on the processor. The wave is rounded to 1e-13 D0, and may fall to
    either side: 1e-12 D0 is far below what a run resolves. A position at rest is a sum over the crystal,
    and is known to the rounding of the box's length (2e-12 in 27,000 on Haswell). Every other number is a few
    operations from those of the scene, and keeps 14 digits.
    """

    def equal(one: str, other: str, floor: float) -> bool:
        words, numbers = NUMBER.split(one)[::2], NUMBER.findall(one)
        return words == NUMBER.split(other)[::2] and all(
            isclose(float(a), float(b), rel_tol=1e-14, abs_tol=floor)
            for a, b in zip(numbers, NUMBER.findall(other), strict=True)
        )

    found = []
    floor = 0.0
    for one, other in zip_longest(committed.splitlines(), made.splitlines(), fillvalue="(no line)"):
        if one.endswith("yhi"):  # the atoms follow
            floor = 1e-15 * (float(one.split()[1]) - float(one.split()[0]))
        if one == "wave":  # the last section of a data file, in D0
            floor = 1e-12
        if one != other and not equal(one, other, floor):
            found.append(other)
    return found


@pytest.mark.rounding
@pytest.mark.parametrize("folder", FOLDERS)
def test_committed_decks_are_what_the_package_writes(folder: str) -> None:
    for name, pieces in build(Scene.load(folder)).files().items():
        committed = (SHIPPED / folder / name).read_text("utf-8")
        assert differing_lines(committed, "".join(pieces)) == [], f"{folder}/{name}; make decks writes it again"


@pytest.mark.parametrize(
    ("line", "differs"),
    [
        ("variable R equal 500.00000000000006", False),  # the next double
        ("variable R equal 500.00000000001", True),
        ("variable R equal -500.0", True),
        ("variable r equal 500.0", True),
        ("1 0.25", True),
        ("1 0.2 0.25", True),
        ("1 0.2\n2 0.3", True),
    ],
)
def test_a_number_of_a_deck_that_differs_is_found(line: str, differs: bool) -> None:
    committed = "variable R equal 500.0" if line.startswith("variable") else "1 0.2"
    assert bool(differing_lines(committed, line)) is differs


def test_a_wave_of_a_deck_that_differs_is_found() -> None:
    assert not differing_lines("wave\n\n1 0.1234567890123 0.0", "wave\n\n1 0.1234567890124 1e-13")
    assert differing_lines("wave\n\n1 0.1234567890123 0.0", "wave\n\n1 0.1234567890143 0.0")
    assert differing_lines("1 0.1234567890123", "1 0.1234567890124")


def test_a_position_of_a_deck_that_differs_is_found() -> None:
    box = "-500.0 500.0 ylo yhi\n"
    assert not differing_lines(box + "1 0.0123456789", box + "1 0.0123456789005")
    assert differing_lines(box + "1 0.0123456789", box + "1 0.012345678902")


def test_amplitude_step_duration_and_file_names_can_be_overridden(small: Scene, tmp_path: Path) -> None:
    changed = small.with_values(
        {"wave.amplitude": 0.1, "time.timestep": 0.03, "time.duration": 1.0, "time.sample": 0.25}
    )
    build(small).write(tmp_path / "a")
    build(changed).write(tmp_path / "b")
    (tmp_path / "a" / "data.small").rename(tmp_path / "a" / "other.data")
    lmp(
        tmp_path / "a", "in.small", "amplitude=0.1", "timestep=0.03", "duration=1.0", "sample=0.25",
        "data=other.data", "dump=other.dump",
    )  # fmt: skip
    run_deck(tmp_path / "b", "in.small")
    assert (tmp_path / "a" / "other.dump").read_bytes() == (tmp_path / "b" / "dump.centre").read_bytes()


def test_numbers_of_a_deck_keep_their_digits(small: Scene) -> None:
    deck = build(small)
    assert f"variable Delta0 equal {small.sphere.static_overlap * 1e9!r}" in deck.input_text
    assert "dmt 73000.0 0.0 0.17 31.5" in deck.input_text
    assert "%.17g" in deck.input_text


# Equal w/(E R) is equal Δ0/R, and with equal ν the same dimensionless problem: in nm, µm and m.
@pytest.mark.parametrize(
    ("units", "radius", "youngs_modulus", "work_of_adhesion"),
    [(NANO, 5e-7, 73e9, 0.063), (MICRO, 5e-5, 73e9, 6.3), (SI, 5e-3, 7.3e7, 0.63)],
)
@verifies(
    "Unit styles nano, micro and si of LAMMPS: the same dimensionless wave, in D0",
    reference="analytic: equal w/ER and ν are one problem",
    tolerance=1e-09,
    reason="a position of 3e3 nm resolves 5e-13 nm, 1e-11 of D0",
    mutant=Mutant("granular_lmp/units.py", "value * 10.0**-exponent", "value * 9.999**-exponent"),
)
def test_every_unit_style_gives_the_same_dimensionless_wave(
    units: Units,
    radius: float,
    youngs_modulus: float,
    work_of_adhesion: float,
    small: Scene,
    tmp_path: Path,
    measured: Measure,
) -> None:
    assert units_for(radius) == units
    sphere = {"radius": radius, "youngs_modulus": youngs_modulus, "work_of_adhesion": work_of_adhesion}
    scaled = small.with_values({f"sphere.{name}": value for name, value in sphere.items()})
    assert f"units        {units.style}" in build(scaled).input_text
    reference, record = run(small, tmp_path / "nano"), run(scaled, tmp_path / "scaled")
    for name in ("p", "q", "phi"):
        measured(off(getattr(record, name), getattr(reference, name), size=1))


@pytest.mark.parametrize(
    ("variables", "changes"),
    [
        (["mode=TR", "xi=1.475", "amp=0.1"], {"wave.wavenumber": 1.475, "wave.amplitude": 0.1}),
        (["mode=RT"], {"wave.mode": "RT"}),
        pytest.param(["mode=L"], {"wave.mode": "L"}, marks=pytest.mark.more),
        (["phase=0.5"], {"wave.phase": 0.5}),
        pytest.param(["xi=3.141592653589793"], {"wave.wavenumber": 3.141592653589793}, marks=pytest.mark.more),
        (
            ["ends=periodic", "rows=16", "xi=0.8"],
            {"packing.ends": "periodic", "packing.rows": 16, "wave.wavenumber": 0.8},
        ),
    ],
)
def test_the_self_contained_deck_is_the_same_wave(
    variables: list[str], changes: dict[str, object], tmp_path: Path
) -> None:
    base = {"packing.rows": 41, "time.duration": 20.0}
    record = run(Scene.load("tr_nonresonant").with_values(base | changes), tmp_path / "run")
    rows = [] if "packing.rows" in changes else ["rows=41"]
    run_deck(tmp_path, str(SHIPPED / "in.plane_wave"), "duration=20", *rows, *variables)
    tau, p, q, phi = np.loadtxt(tmp_path / "trajectory.csv", delimiter=",", skiprows=1).T
    np.testing.assert_allclose(tau, record.tau, atol=1e-12)
    # LAMMPS places the lattice with other roundings: 1e-11 nm of 0.05 nm
    for here, there in ((p, record.p), (q, record.q), (phi, record.phi)):
        np.testing.assert_allclose(here, there, atol=2e-9)


@pytest.mark.parametrize(
    "variables",
    ["columns=2", "xi=0", "xi=3.2", "mode=S", "rows=200", "ends=open", "ends=periodic rows=2", "rows=3"]
    + ["ends=periodic rows=16 xi=0.1"],
)
def test_the_self_contained_deck_refuses_what_it_cannot_do(variables: str, tmp_path: Path) -> None:
    text = (SHIPPED / "in.plane_wave").read_text("utf-8")
    (tmp_path / "in.refusing").write_text(text.replace("quit 1", "refused"))  # no command: an error, and no exit
    with pytest.raises(Exception, match="Unknown command: refused"):
        run_deck(tmp_path, "in.refusing", *variables.split())
    assert not (tmp_path / "trajectory.csv").exists()


def test_lammps_ends_with_status_1_where_the_self_contained_deck_refuses(tmp_path: Path) -> None:
    with pytest.raises(subprocess.CalledProcessError, match="exit status 1"):
        lmp(tmp_path, str(SHIPPED / "in.plane_wave"), "xi=0")
    assert "xi must be in (0, pi]" in (tmp_path / "log.lammps").read_text()
    assert not (tmp_path / "trajectory.csv").exists()


@pytest.mark.parametrize(
    ("deck", "variables", "why"),
    [
        ("tr_resonant/in.tr_resonant", "duration=3", ""),
        ("tr_resonant/in.tr_resonant", "duration=3 amplitude=2.0", "v_open is above 0: contacts opened or formed"),
        (
            "tr_resonant/in.tr_resonant",
            "duration=3 friction=0.01",
            "v_slip is above 0.9305: contacts may slide in reality",
        ),
        ("impacts/solitary_chain/in.solitary_chain", "duration=5", ""),
        ("impacts/solitary_chain/in.solitary_chain", "duration=5 timestep=0.5", "v_omega_dt, the step times"),
        ("in.plane_wave", "duration=3 rows=41", ""),
        ("in.plane_wave", "duration=3 rows=41 mode=L amp=2.0", "contacts opened or formed"),
    ],
)
def test_the_last_line_of_plain_lammps_says_whether_a_limit_was_passed_and_why(
    deck: str, variables: str, why: str, tmp_path: Path
) -> None:
    path = SHIPPED / deck
    run_deck(tmp_path, str(path), f"data={path.parent}/data.{path.parent.name}", *variables.split())
    said = [line for line in (tmp_path / "log.lammps").read_text().splitlines() if line.startswith("INVALID")]
    assert [line.startswith(f"INVALID: {why}") for line in said] == ([True] if why else [])


def test_the_record_starts_at_the_wave_s_own_values(small: Scene, tmp_path: Path) -> None:
    deck = build(small)
    deck.write(tmp_path / "deck")
    run_deck(tmp_path / "deck", deck.input_name)
    record = Record.from_dump(tmp_path / "deck", small)
    assert record.q[0] == pytest.approx(-deck.problem.wave.mode.ux, abs=1e-9)
    assert record.p[0] == record.phi[0] == 0
    table = read_centre(tmp_path / "deck" / "dump.centre")
    spin = (
        deck.problem.wave.mode.f
        * deck.problem.wave.mode.frequency
        * small.wave.amplitude
        * small.sphere.overlap_ratio
        * 2
    )
    assert table["omegaz"][0] == pytest.approx(spin / (small.sphere.time_scale * 1e9), rel=1e-12)
