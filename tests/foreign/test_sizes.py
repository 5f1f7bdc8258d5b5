"""The sizes of errors that ``granular-lmp lint`` says are those that LAMMPS makes."""

import re
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp.foreign.in_files import _rounding
from granular_lmp.foreign.lint import lint
from granular_lmp.foreign.reading import Reading, read
from granular_lmp.foreign.vibrations import contacts_of, fastest, fastest_decay
from tests.foreign.decks import BOTH, CHAIN, CONTINUED, JKR, LAYER, OBLIQUE, SHEARED, SHEET, STIFF_FLOOR
from tests.instance import silent_lammps

ROOT = Path(__file__).parents[2]
MASS = 4 / 3 * pi * 5e-3**3 * 7800.0
STIFFNESS = 1e7
OMEGA = sqrt(2 * STIFFNESS / MASS)  # of a bead between two held ones, with linear contacts

BETWEEN = """
units si
atom_style sphere
atom_modify map array
comm_modify vel yes
boundary f f f
region box block -0.1 0.1 -0.1 0.1 -0.1 0.1
create_box 1 box
create_atoms 1 single 0.0 0.0 0.0
create_atoms 1 single -9.99e-3 0.0 0.0
create_atoms 1 single 9.99e-3 0.0 0.0
set group all diameter 0.01
set group all density 7800.0
neighbor 5e-4 bin
pair_style granular
pair_coeff * * hooke {stiffness!r} {dashpot!r} tangential linear_nohistory 0.0 0.0 damping velocity
group inner id 1
velocity inner set 1e-3 0.0 0.0
timestep {step!r}
fix move inner nve/sphere
run 400
"""


def read_text(text: str, folder: Path) -> Reading:
    (folder / "in.deck").write_text(text)
    return read(folder / "in.deck")


def size(reading: Reading, name: str) -> float:
    (found,) = (finding.size for check, finding in lint(reading) if check.name == name)
    assert found is not None
    return found


def mend(reading: Reading, name: str) -> str:
    (found,) = (finding.mend for check, finding in lint(reading) if check.name == name)
    return found


def after(deck: str, name: str, steps: int = 0) -> Any:
    """Return an array of the spheres in the order of their numbers after a deck, and after each of more steps."""
    with silent_lammps() as lmp:
        lmp.commands_string(deck)
        rows = []
        for step in range(steps + 1):
            if step:
                lmp.command("run 1 pre no post no")
            count = lmp.extract_setting("nlocal")
            order = np.argsort(lmp.numpy.extract_atom("id")[:count])
            rows.append(lmp.numpy.extract_atom(name)[:count][order])
    return np.array(rows) if steps else rows[0]


def vibration(deck: str) -> tuple[float, float]:
    """Return phase φ and decay γ a step of the first sphere: x₊ − 2e^{−γ} cos φ x + e^{−2γ} x₋ = 0."""
    x = after(deck.replace("run 400", "run 0 post no"), "x", 100)[:, 0, 0]
    (middle, before), *_ = np.linalg.lstsq(np.stack((x[1:-1], -x[:-2]), axis=1), x[2:], rcond=None)
    return float(np.arccos(middle / 2 / sqrt(before))), -float(np.log(before)) / 2


@pytest.mark.parametrize("phase", [0.3, 0.6])
def test_a_long_step_makes_a_vibration_as_fast_as_lint_says(phase: float, tmp_path: Path) -> None:
    deck = BETWEEN.format(stiffness=STIFFNESS, dashpot=0.0, step=phase / OMEGA)
    reading = read_text(deck, tmp_path)
    assert fastest(reading) == pytest.approx(OMEGA, rel=1e-9)
    measured, _ = vibration(deck)
    # The next term is 3(ωh)⁴/640: a tenth of (ωh)² of the first
    assert measured / phase - 1 == pytest.approx(size(reading, "time-step"), rel=phase**2 / 8)


def test_a_dashpot_lags_as_far_as_lint_says(tmp_path: Path) -> None:
    step, dashpot = 0.1 / OMEGA, 0.2 * sqrt(STIFFNESS * MASS)
    deck = BETWEEN.format(stiffness=STIFFNESS, dashpot=dashpot, step=step)
    reading = read_text(deck, tmp_path)
    assert fastest_decay(reading) == pytest.approx(2 * dashpot / MASS, rel=1e-9)
    _, measured = vibration(deck)
    # The next order is the square of the lag, 1.4 % here, and (ωh)² of the decay, 1 %
    lag = size(reading, "first-order-damping")
    assert measured / (dashpot / MASS * step) - 1 == pytest.approx(lag, abs=2 * lag**2)


def test_the_fastest_vibration_of_a_sheet_is_the_rotation_of_the_long_wave() -> None:
    """Its frequency is √(15 μ2) in units of 1/t0, with μ2 = κ/(κ + 3)."""
    reading = read(ROOT / "lammps_inputs/tr_grating/in.tr_grating")
    time = float(re.search(r"variable t0 +equal (\S+)", Path(reading.deck).read_text())[1])  # type: ignore[index]
    # Contacts in LAMMPS have the lever arm R − δ/2, and a wave of 0.1 of the overlap changes its root
    assert fastest(reading) * time == pytest.approx(sqrt(15 * 0.2321678321678), rel=5e-3)  # type: ignore[operator]


def test_short_collisions_lose_at_most_what_lint_says(tmp_path: Path) -> None:
    """The worst of several beginnings of a collision within a step loses at least a third of it."""
    deck = OBLIQUE.replace("timestep 5e-7", "timestep 4e-6").replace("run 10000", "run 20 post no")
    bound = size(read_text(deck, tmp_path), "collision-time")
    losses = []
    for part in np.linspace(0.0, 1.0, 9):
        velocity = after(deck.replace("-0.012 0.006 0.0", f"{-0.01 - 4e-6 * float(part)!r} 0.0 0.0"), "v")[:, 0]
        losses.append(abs(float(velocity[0] - velocity[1]) - 1.0))
    assert bound / 3 < max(losses) < bound


def test_lammps_mixes_the_shear_stiffness_that_lint_says(tmp_path: Path) -> None:
    deck = CHAIN.replace(BOTH, "")
    reading = read_text(deck, tmp_path)
    sheared = deck.replace("group first id 2", "group first id 11").replace("0.001 0.001 0.0", "0.0 0.1 0.0")
    mixed = sheared.replace("fix move free nve/sphere\nrun 5000", "fix move all nve/noforce\nrun 1 post no")
    right = mixed.replace("group ends", f"{mend(reading, 'mixed-shear-modulus')}\ngroup ends")
    wrong, force = (after(text, "f")[9] for text in (mixed, right))
    # E* is mixed right, and the mend has six digits
    assert wrong[0] == pytest.approx(force[0], rel=1e-5)
    assert 1 - wrong[1] / force[1] == pytest.approx(size(reading, "mixed-shear-modulus"), rel=1e-4)


def test_a_wall_is_as_stiff_as_lint_says(tmp_path: Path) -> None:
    """The mend has the stiffness of both materials, 1/E* = (1 − ν²)/E1 + (1 − ν²)/E2."""
    deck = LAYER.replace(*STIFF_FLOOR[0]).replace(*STIFF_FLOOR[1])
    reading = read_text(deck, tmp_path)
    overlap, pull = 500.0 - 499.83922, 2 * pi * 63.0 * 500.0
    young = re.match(r"E = (\S+) in this line", mend(reading, "wall-modulus"))
    assert young
    mended = deck.replace("granular dmt 200000.0", f"granular dmt {young[1]}")
    once, right = (after(text.replace("run 1000", "run 0 post no"), "f")[0, 2] + pull for text in (deck, mended))
    both = 4 / 3 / ((1 - 0.17**2) * (1 / 73000.0 + 1 / 200000.0)) * sqrt(500.0) * overlap**1.5
    assert right == pytest.approx(both, rel=1e-5)
    assert once / right - 1 == pytest.approx(size(reading, "wall-modulus"), rel=1e-5)


def test_a_jkr_contact_that_was_closed_pulls_as_hard_as_lint_says(tmp_path: Path) -> None:
    gap = JKR.replace("variable apart equal 999.82675", "variable apart equal 1000.02")
    missing = size(read_text(gap, tmp_path), "jkr-gap") * 1.5 * pi * 63.0 * 250.0
    pulled = JKR.replace("fix move all nve/sphere\nrun 1000", "fix move all nve/noforce\nrun 2 post no")
    speed = f"group one id 2\nvelocity one set {(1000.02 - 999.82675) / 0.05!r} 0 0\ntimestep"
    # LAMMPS solves the cubic equation of the contact radius to 1e-6
    assert after(pulled.replace("timestep", speed), "f")[0, 0] == pytest.approx(missing, rel=1e-4)
    assert not after(gap.replace("run 1000", "run 0 post no"), "f").any()


def test_a_data_file_forgets_the_shear_force_and_a_restart_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    force = after(SHEARED, "f")[0]
    before = force[1]
    again = CONTINUED.replace("run 1000", "run 0 post no")
    assert after(again, "f")[0, 1] == pytest.approx(before, rel=1e-9)
    forgotten = after(again.replace("read_restart sheared.restart", "read_data sheared.data"), "f")
    # The normal force is still there, and the normal has turned by 2e-6
    assert abs(forgotten[0, 1]) < 1e-4 * before
    assert forgotten[0, 0] == pytest.approx(force[0], rel=1e-6)


def test_newton_changes_the_last_digits_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that there is no check for it, and none for a restart file with the other setting."""
    monkeypatch.chdir(tmp_path)
    deck = SHEET.replace("boundary p f p", "boundary p p p").replace("restart 1000 checkpoint\n", "")
    forces = []
    for newton, other in (("on", "off"), ("off", "on")):
        begun = deck.replace("dimension 2", f"dimension 2\nnewton {newton}")
        forces.append(after(begun.replace("run 2000", "run 100\nwrite_restart half\nrun 100"), "f"))
        start, _, rest = begun.partition("lattice")
        again = f"{start}read_restart half\n{rest[rest.index('neighbor') :]}".replace("run 2000", "run 100")
        again = again.replace(f"newton {newton}", f"newton {other}").replace("velocity all set", "#")
        forces.append(after(again, "f"))
    # Rounding of places of 4e3 in overlaps of 0.25, which the wave amplifies; no slip is lost
    for each in forces[1:]:
        np.testing.assert_allclose(each, forces[0], atol=1e-8 * np.abs(forces[0]).max())


def test_a_dump_rounds_positions_as_lint_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    deck = CHAIN.replace("sq 9.499e-3", "sq 9.49901234e-3").replace(
        "run 5000", "dump all all custom 1 dump.all id x\nrun 5000"
    )
    ((_, finding),) = lint(read_text(deck, tmp_path))
    unit = re.search(r"written to (\S+); of", finding.what)
    assert unit
    place = after(deck.replace("run 5000", "dump_modify all sort id\nrun 0 post no"), "x")[:, 0]
    rows = [line.split() for line in Path("dump.all").read_text().splitlines()[9:]]
    error = max(abs(float(x) - place[int(number) - 1]) for number, x in rows)
    assert float(unit[1]) / 10 < error <= float(unit[1]) / 2


def test_a_wall_counts_in_the_fastest_vibration(tmp_path: Path) -> None:
    """A bead between a held one and a wall, of linear contacts both, has the frequency between two held ones."""
    law = f"hooke {STIFFNESS!r} 0.0 tangential linear_nohistory 0.0 0.0 damping velocity"
    deck = BETWEEN.format(stiffness=STIFFNESS, dashpot=0.0, step=0.1 / OMEGA)
    beside = deck.replace("create_atoms 1 single 9.99e-3 0.0 0.0\n", "")
    assert fastest(read_text(beside, tmp_path)) == pytest.approx(OMEGA / sqrt(2), rel=1e-9)
    walled = beside.replace("fix move", f"fix wall inner wall/gran granular {law} xplane NULL 4.99e-3\nfix move")
    assert fastest(read_text(walled, tmp_path)) == pytest.approx(OMEGA, rel=1e-9)
    assert vibration(walled)[0] == pytest.approx(0.1, rel=0.1**2 / 24 * 1.1)


@pytest.mark.parametrize(
    ("text", "unit"), [("%g", 1e-4), ("%.17g", 1e-15), ("%.3e", 1e-2), ("%f", 1e-6), ("%20.15lg", 1e-13), ("%d", 0.0)]
)
def test_formats_of_dumps_round_as_c_does(text: str, unit: float) -> None:
    assert _rounding(text, 12.3) == pytest.approx(unit)
    written = re.sub("l", "", text) % 12.3456789012345678
    assert len(written.strip()) > 0
    assert abs(float(written) - 12.3456789012345678) <= (unit / 2 or 1.0)


LAWS = {
    "hooke": "pair_style granular\npair_coeff * * hooke 1e7 0.0 tangential linear_history 6e6 0.0 9.0 damping velocity",
    "hertz": "pair_style granular\npair_coeff * * hertz 1e10 0.0 tangential mindlin 4e9 0.0 9.0 damping velocity",
    "material": "pair_style granular\npair_coeff * * hertz/material 2e11 0.0 0.3 tangential mindlin NULL 0.0 9.0",
    "dmt": "pair_style granular\npair_coeff * * dmt 2e11 0.0 0.3 5.0 tangential mindlin 1e11 0.0 9.0 damping velocity",
    "jkr": "pair_style granular\npair_coeff * * jkr 2e11 0.0 0.3 50.0 tangential mindlin NULL 0.0 9.0 damping velocity",
    "gran/hooke": "pair_style gran/hooke/history 1e7 NULL 0.0 NULL 9.0 1\npair_coeff * *",
    "gran/hertz": "pair_style gran/hertz/history 1e10 4e9 0.0 NULL 9.0 1\npair_coeff * *",
}


@pytest.mark.parametrize("law", LAWS)
def test_stiffnesses_are_those_of_the_forces_of_lammps(law: str, tmp_path: Path) -> None:
    deck = BETWEEN.format(stiffness=STIFFNESS, dashpot=0.0, step=1e-7)
    start, _, rest = deck.partition("pair_style")
    deck = f"{start}{LAWS[law]}\ngroup{rest.partition('group')[2]}"
    deck = deck.replace("create_atoms 1 single 9.99e-3 0.0 0.0\n", "")
    contacts = contacts_of(read_text(deck, tmp_path))
    assert contacts is not None
    way = 1e-10  # of an overlap of 1e-5
    moved = []
    for axes in ("{} 0 0", "-{} 0 0", "0 {} 0"):
        step = deck.replace("set 1e-3 0.0 0.0", f"set {axes.format(way / 1e-7)}").replace("run 400", "run 1 post no")
        moved.append(after(step.replace("inner nve/sphere", "all nve/noforce"), "f")[0])
    # The difference of two forces has 1e-10 of them, 1e-5 of the stiffness in the motion of 1e-5 of the overlap
    assert (moved[1][0] - moved[0][0]) / 2 / way == pytest.approx(contacts.normal[0], rel=1e-5)
    assert -moved[2][1] / way == pytest.approx(contacts.shear[0] + turned(moved, way), rel=1e-5)


def turned(moved: list[Any], way: float) -> float:
    """Return the stiffness of a push that turns with its contact."""
    return -float(moved[0][0] + moved[1][0]) / 2 / 9.99e-3


def test_spins_after_oblique_impacts_differ_by_what_lint_says() -> None:
    """Secant and rescaled law, friction 0.5 and 1, beginning 2 to 8 mm off the centre, over the speed of 1 m/s."""
    for friction, said in ((0.5, 0.03), (1.0, 0.06)):
        apart = []
        for off in (2e-3, 4e-3, 6e-3):
            begun = OBLIQUE.replace("-0.012 0.006", f"-{sqrt(1.00001e-4 - off**2):.17g} {off}")
            deck = begun.replace("timestep 5e-7", "timestep 2e-7").replace("run 10000", "run 500 post no")
            spins = [
                after(deck.replace("mindlin_rescale NULL 0.0 0.5", f"{law} NULL 0.0 {friction}"), "omega")[0, 2]
                for law in ("mindlin", "mindlin_rescale")
            ]
            apart.append(5e-3 * abs(spins[0] - spins[1]))
        assert max(apart) == pytest.approx(said, rel=0.1)


@pytest.mark.parametrize(
    ("law", "damping"), [("velocity", 50.0), ("mass_velocity", 3e4), ("viscoelastic", 2e8), ("coeff_restitution", 0.97)]
)
def test_dashpots_are_those_of_lammps(law: str, damping: float, tmp_path: Path) -> None:
    """The decay of a bead between two is half the largest rate, c/m."""
    deck = BETWEEN.format(stiffness=STIFFNESS, dashpot=damping, step=0.02 / OMEGA)
    deck = deck.replace("damping velocity", f"damping {law}")
    rate = fastest_decay(read_text(deck, tmp_path))
    assert rate
    _, measured = vibration(deck)
    # The lag of a step is below 1 %
    assert measured / (0.02 / OMEGA) == pytest.approx(rate / 2, rel=0.02)
