"""Commands of the theory that have no answer say in one line why: what is typed, and what is said."""

import re
import shlex

import pytest

from granular_analysis import cli

SAID = [
    ("resonances nowhere", "no such scene file"),
    ("resonances tr_damped", "tr_damped: the theory of a crystal leaves out effects.viscosity = 2e-08"),
    ("resonances tr_impurity", "inclusion 1 has spheres; allowed: rows, every, density"),
    ("resonances solitary_chain", "solitary_chain: wave: missing table; this theory needs a wave"),
    ("resonances l_chain --direction 30", "a chain has one direction"),
    ("resonances l_chain --map 1", "2 or more"),
    ("resonances tr_nonresonant --direction nan", "--direction nan: must be degrees, finite"),
    ("harmonic solitary_chain", "solitary_chain: wave: missing table; this theory needs a wave"),
    ("design solitary_chain --vary sphere.density 1000 9000", "solitary_chain: wave: missing table"),
    ("design tr_periodic --vary packing.rows 2 4", "--vary packing.rows: must be one of sphere.radius, "),
    ("design tr_periodic --vary sphere.density 4 2", "--vary sphere.density 4 2: must be two finite numbers"),
    ("design tr_periodic --vary sphere.density -4 2", "sphere.density = -4.0"),
    ("design tr_periodic --vary sphere.density 2000 3000 --best frequency", "--at 0: must be the frequency"),
    ("design tr_periodic --vary sphere.density 2000 3000 --best gap --branch 3", "must be from 1 to 2"),
    ("design tr_periodic --vary sphere.density 2000 3000 --best passing", "passing needs a wave along y and"),
    (
        "design tr_periodic --vary sphere.density 2000 3000 --best frequency --at 1e8 --least",
        "--least: cannot be combined with --best frequency",
    ),
    (
        "design tr_impurity --best passing --vary inclusion.1.density 2300 4000",
        "inclusion 1 must have rows and density, not",
    ),
    ("design 1e8 --least", "--least is for a scene, not for a frequency"),
    ("design 1e8 --vary sphere.density 1 2", "--vary is for a scene, not for a frequency"),
    ("design tr_periodic --second 1e8", "--second is for two frequencies, not for a scene"),
    ("design tr_periodic --vary sphere.density 1 2 --at 3", "--at is for --best frequency, not for g"),
    ("design tr_periodic --vary sphere.density 1 2 --branch 2", "--branch is for --best gap, not for"),
    ("design -3", "frequency is -3.0; allowed: from 1e-15 to 1e15"),
    ("design 1e6 --opening 90", "frequency is 1e+06; allowed: 4.743e+07 Hz and above"),
    ("design 5e7 --second 0", "second is 0.0; allowed: from 1e-15"),
    ("design 5e7 --radius nan", "radius is nan; allowed: from 1e-15"),
    ("design 5e7 --work-of-adhesion -1", "work_of_adhesion is -1.0; allowed: 0 or above"),
    ("design 5e7 --work-of-adhesion 1e6", "work_of_adhesion is 1000000.0; … below 0.099 of a diameter"),
    ("design 5e7 --poisson-ratio 0.6", "poisson_ratio is 0.6; allowed: above -1, up to 0.5"),
    ("design 5e7 --poisson-ratio -1", "poisson_ratio is -1.0; allowed: above -1"),
    ("design 5e7 --opening inf", "directions and openings are […inf]; allowed: degrees"),
    ("design 5e7 --amplitude 1", "--amplitude 1.0: must be above 0 and below 1"),
    ("saw monolayer_vertical --below 73e9 0.17 2200", "--below: needs --thickness"),
    (
        "saw monolayer_vertical --thickness 1e-6 --below 73e9 0.5 2200",
        "Poisson's ratio between -1 and 0.5",
    ),
    ("saw monolayer_vertical --thickness=-1e-6", "--thickness -1e-06: must be positive and finite"),
    ("saw monolayer_vertical --density -1", "--density -1.0: must be positive and finite"),
    ("saw tr_periodic", "substrate"),
    ("saw nowhere", "nowhere"),
]


@pytest.mark.parametrize(("typed", "said"), SAID, ids=[typed for typed, _ in SAID])
def test_a_command_without_an_answer_says_why(typed: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        cli.main(shlex.split(typed))
    found = " ".join(f"{refused.value} {capsys.readouterr().err}".split())
    assert re.search(re.escape(said.strip()).replace("…", ".*"), found), found
