"""The witness of somebody's deck agrees with it, and names what separates the two."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.cli import main
from granular_analysis.measure.witness import EXPLAINED, network_of, witness
from granular_analysis.theory.errors import TheoryError
from granular_lmp.foreign.adopt_dump import adopt_dump
from granular_lmp.foreign.conversion import Known
from granular_lmp.foreign.known import law_of
from granular_lmp.foreign.laws import Law
from granular_lmp.foreign.outside import Outside, Wall
from granular_lmp.runs.unnamed import Unnamed
from tests.instance import run_deck

# A chain of ten beads of steel that just overlap, the first of which is struck, and a bead off the line
DECK = """
units si
atom_style sphere
boundary f f f
newton off
comm_modify vel yes
region box block -0.02 0.25 -0.03 0.04 -0.02 0.02
create_box 1 box
variable i loop 10
label beads
variable x equal (v_i-1)*0.019999
create_atoms 1 single $x 0 0
next i
jump SELF beads
create_atoms 1 single 0.0899955 0.017319 0
set group all diameter 0.02 density 7780
pair_style granular
pair_coeff * * {law}
group first id 1
group free id 2:11
{start}
fix 1 all nve/sphere
timestep {step}
dump 1 all custom {every} dump.coarse id type x y z vx vy vz
dump 2 all custom {every} dump.fine id type x y z vx vy vz omegax omegay omegaz
dump_modify 2 format float %.17g
run {steps}
"""
WORDS = "hertz/material 2e11 0 0.3 tangential mindlin NULL 0.0 0.5"
STEEL = law_of(WORDS, 1)[1, 1]


def made(folder: Path, *, law: str = WORDS, step: float = 2e-7, start: str = "", known: Law = STEEL) -> Path:
    """Run the deck for 0.2 ms, and adopt its dump with all digits; return the folder of the deck."""
    folder.mkdir()
    every = round(4e-6 / step)
    start = start or "velocity first set 0.1 0.02 0"
    (folder / "in.beads").write_text(DECK.format(law=law, start=start, step=step, every=every, steps=50 * every))
    run_deck(folder, "in.beads")
    for name in ("fine", "coarse"):
        adopted(folder, name, known, step)
    return folder


def adopted(folder: Path, name: str, law: Law, step: float, **more: object) -> Unnamed:
    known = Known("si", step, [0.01], [7780.0], {(1, 1): law}, **more)  # type: ignore[arg-type]
    return adopt_dump([folder / f"dump.{name}"], folder / name, known, force=True)


@pytest.fixture(scope="module")
def beads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The struck chain, with slip at its contacts."""
    return made(tmp_path_factory.mktemp("witness") / "beads")


def test_the_witness_of_a_deck_agrees_with_it_to_its_step(beads: Path) -> None:
    found = witness(Unnamed.load(beads / "fine"))
    assert found.cause == "the step"
    assert found.reasons == ()
    assert found.parted is None
    assert found.steps == 1000
    assert found.digits == 0
    # Second order in a step of a two hundredth of the collision: what is left beside the step is far below it
    assert 1e-7 < found.step < 1e-3
    assert found.error == pytest.approx(found.step, rel=0.05)


def test_a_longer_step_is_named(beads: Path, tmp_path: Path) -> None:
    found = witness(Unnamed.load(made(tmp_path / "beads", step=2e-6) / "fine"))
    assert (found.cause, found.reasons) == ("the step", ())
    # The error of a step is of second order
    assert found.step == pytest.approx(100 * witness(Unnamed.load(beads / "fine")).step, rel=0.2)
    assert found.error == pytest.approx(found.step, rel=0.05)


def test_a_dump_of_six_digits_is_named(beads: Path) -> None:
    found = witness(Unnamed.load(beads / "coarse"))
    assert found.cause == "the digits of the dump"
    assert found.reasons == ("the dump has no spins (omegax, omegay, omegaz); the witness begins without spin",)
    assert found.digits > 10 * found.step
    assert found.error < EXPLAINED * found.digits


@pytest.mark.parametrize(
    "other",
    [replace(STEEL, young=2.1e11), replace(STEEL, tangential="none"), replace(STEEL, friction=0.001)],
    ids=["stiffer", "without shear", "slippery"],
)
def test_another_law_is_not_explained(other: Law, beads: Path, tmp_path: Path) -> None:
    (tmp_path / "dump.fine").write_bytes((beads / "dump.fine").read_bytes())
    found = witness(adopted(tmp_path, "fine", other, 2e-7))
    assert not found.explained
    assert found.error > 1e-3


def test_a_force_of_the_deck_is_not_explained(tmp_path: Path) -> None:
    folder = made(tmp_path / "beads", start="velocity first set 0.1 0.02 0\nfix 2 free addforce 5.0 0 0")
    found = witness(Unnamed.load(folder / "fine"))
    assert not found.explained
    assert found.cause == ""
    assert found.parted is not None
    assert found.reasons == ()


def test_history_that_a_later_dump_has_lost_is_named(beads: Path, tmp_path: Path) -> None:
    text = (beads / "dump.fine").read_text()
    (tmp_path / "dump.fine").write_text(text[text.index("ITEM: TIMESTEP\n500\n") :])
    found = witness(adopted(tmp_path, "fine", STEEL, 2e-7))
    assert not found.explained
    assert found.reasons == ("the first snapshot is at step 500, and no dump holds the slip of its contacts",)


LAWS = [
    "hertz/material 2e11 50.0 0.3 tangential mindlin NULL 1.0 0.5 damping velocity",
    "hertz/material 2e11 0.9 0.3 tangential mindlin NULL 1.0 0.5 damping coeff_restitution",
    "hertz/material 2e11 0 0.3 tangential mindlin/force NULL 0.0 0.1",
    "hertz/material 2e11 0 0.3 tangential linear_nohistory 0.0 0.0",
    "hertz/material 2e11 50.0 0.3 tangential linear_nohistory 0.0 0.0 damping velocity",
    "dmt 2e11 0 0.3 0.5 tangential mindlin NULL 0.0 0.5",
    "jkr 2e11 0 0.3 0.5 tangential mindlin NULL 0.0 0.5",
]


@pytest.mark.parametrize("words", LAWS)
def test_each_law_that_the_witness_knows_is_that_of_lammps(words: str, tmp_path: Path) -> None:
    law = law_of(words, 1)[1, 1]
    found = witness(Unnamed.load(made(tmp_path / "beads", law=words, known=law) / "fine"))
    assert found.explained
    assert found.error < 1e-2


REFUSED = {
    "hooke is not built": replace(STEEL, normal="hooke"),
    "linear_history is not built": replace(STEEL, tangential="linear_history"),
    "damping viscoelastic is not built": replace(STEEL, damping=50.0),
    "without a spring is not built": replace(STEEL, tangential="linear_nohistory", damping=1.0, shear_damping=1.0),
    "a separate shear stiffness": replace(STEEL, shear_stiffness=1e11),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_law_that_the_network_does_not_hold_is_refused(why: str, beads: Path, tmp_path: Path) -> None:
    (tmp_path / "dump.fine").write_bytes((beads / "dump.fine").read_bytes())
    crystal = adopted(tmp_path, "fine", REFUSED[why], 2e-7)
    with pytest.raises(TheoryError, match=why):
        witness(crystal)


FLOOR = Wall(1, -1, -0.01, STEEL)
OUTSIDE = {
    "a wall with friction = 0.1 and spheres with 0.5": {"walls": (Wall(1, -1, -0.01, replace(STEEL, friction=0.1)),)},
    "a wall with hooke": {"walls": (Wall(1, -1, -0.01, replace(STEEL, normal="hooke")),)},
    "a wall with JKR": {"walls": (Wall(1, -1, -0.01, replace(STEEL, normal="jkr", gamma=0.1)),)},
    "touches two opposite walls": {"walls": (FLOOR, replace(FLOOR, side=1, place=0.0099))},
    "'fix 2 all viscous 1' is not built": {"others": ("fix 2 all viscous 1",)},
}


@pytest.mark.parametrize("why", OUTSIDE)
def test_what_acts_and_is_not_in_the_network_is_refused(why: str, beads: Path, tmp_path: Path) -> None:
    (tmp_path / "dump.fine").write_bytes((beads / "dump.fine").read_bytes())
    crystal = adopted(tmp_path, "fine", STEEL, 2e-7, outside=Outside(**OUTSIDE[why]))  # type: ignore[arg-type]
    with pytest.raises(TheoryError, match=why):
        witness(crystal)


def test_a_restitution_beside_a_sphere_that_only_rests_is_refused(beads: Path, tmp_path: Path) -> None:
    """LAMMPS gives it a mass in the dashpot, unless it is frozen."""
    (tmp_path / "dump.fine").write_bytes((beads / "dump.fine").read_bytes())
    law = replace(STEEL, damping=0.9, shear_damping=1.0, damping_law="coeff_restitution")
    network_of(adopted(tmp_path, "fine", law, 2e-7, outside=Outside(held=(10,), frozen=(10,))))
    with pytest.raises(TheoryError, match="with sphere 10, which does not move, is not built"):
        witness(adopted(tmp_path, "fine", law, 2e-7, outside=Outside(held=(10,))))


def test_a_held_sphere_that_turns_in_the_deck_is_named(beads: Path, tmp_path: Path) -> None:
    (tmp_path / "dump.fine").write_bytes((beads / "dump.fine").read_bytes())
    found = witness(adopted(tmp_path, "fine", STEEL, 2e-7, outside=Outside(held=(9,))))
    assert found.reasons == ("sphere 9, which is held, turns in the deck and not in the witness",)


def test_a_held_sphere_with_a_velocity_is_named(beads: Path, tmp_path: Path) -> None:
    lines = (beads / "dump.fine").read_text().splitlines()
    first = next(line.split() for line in lines if line.startswith("11 "))
    still = [" ".join([*first[:5], "1e-3", "0", "0", *first[8:]]) if line.startswith("11 ") else line for line in lines]
    (tmp_path / "dump.fine").write_text("\n".join(still) + "\n")
    found = witness(adopted(tmp_path, "fine", STEEL, 2e-7, outside=Outside(held=(11,))))
    assert any(reason.startswith("sphere 11 has a velocity and does not move") for reason in found.reasons)


def test_a_step_that_changes_is_refused(beads: Path) -> None:
    crystal = Unnamed.load(beads / "fine")
    with pytest.raises(TheoryError, match="the time step changes from 2e-07 to 4e-07, which is not built"):
        witness(replace(crystal, time=crystal.time + np.maximum(crystal.time - crystal.time[25], 0)))


def test_compare_prints_where_deck_and_witness_part(
    beads: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", str(beads / "fine"), "--json", str(tmp_path / "found.json")]) == 0
    out = capsys.readouterr().out
    assert "11 spheres, 1000 steps of 2e-07 s" in out
    assert "no sphere differs by more than 1% of the largest speed" in out
    assert "the step explains this\n" in out
    assert '"parted": null' in (tmp_path / "found.json").read_text()
    adopt_dump([beads / "dump.fine"], tmp_path / "lawless", Known("si", 2e-7, [0.01], [7780.0]))
    with pytest.raises(SystemExit, match="no contact law is known"):
        main(["compare", str(tmp_path / "lawless")])
