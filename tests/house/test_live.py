"""The live page: its program, in Node, answers as the theory and the package do, and says what is wrong."""

import json
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis import second_harmonic as theory
from granular_lmp.crystal.sphere import Sphere

PROGRAM = Path(__file__).parents[2] / "docs/live.js"
NODE = shutil.which("node")
# Answers what is typed into the form, or says what is wrong with it
ANSWERS = """
const fs = require("fs"), vm = require("vm"), place = {};
const [program, forms] = process.argv.slice(1);
vm.runInNewContext(fs.readFileSync(program, "utf8"), place);
const answered = form => { try { return place.answerOf(form); } catch (wrong) { return wrong.message; } };
console.log(JSON.stringify(JSON.parse(forms).map(answered)));
"""
SILICA = {"modulus": "73", "density": "2200", "radius": "0.5", "adhesion": "0.063", "force": "0"}
STEEL = {"modulus": "2.1e2", "density": "7800", "radius": "9525", "adhesion": "0", "force": "1"}
RUBBER = {"modulus": "0.002", "density": "970", "radius": "50", "adhesion": "0.05", "force": "1e-5"}
VALUES: list[dict[str, str]] = [
    {"mode": "TR", "geometry": "paper", "xi": "1.475", "a": "0.2", "nu": "0.17", **SILICA},
    {"mode": "RT", "geometry": "lammps", "xi": "2.5", "a": "0.31", "nu": "-0.6", **SILICA},
    {"mode": "L", "geometry": "paper", "xi": "0.802", "a": "0.05", "nu": "0.29", **STEEL},
    {"mode": "TR", "geometry": "paper", "xi": "3", "a": "1e-2", "nu": "0.49", **RUBBER},
]


@cache
def answers(*forms: str) -> list[Any]:
    """Return what the program of the page answers to forms, as JSON."""
    if NODE is None:
        pytest.skip("no Node")
    words = [NODE, "-e", ANSWERS, str(PROGRAM), f"[{','.join(forms)}]"]
    found: list[Any] = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
    return found


def compared_with_theory(typed: dict[str, str], shown: dict[str, Any]) -> None:
    """Assert that the numbers of the page are those of `granular_analysis.second_harmonic` and of `Sphere`.

    To 1e-11, and signals to 1e-12 of the amplitude: both do the same sums of some twenty terms in double precision.
    The places of resonance, roots of a cubic, are found to 1e-9.
    """
    xi, amplitude, nu, modulus, density, radius, adhesion, force = (
        float(typed[name]) for name in ("xi", "a", "nu", "modulus", "density", "radius", "adhesion", "force")
    )
    sphere = Sphere(radius * 1e-6, modulus * 1e9, nu, adhesion, density, force)
    rest = [shown["sphere"][name] for name in ("overlap", "stiffness", "time", "row")]
    row = np.sqrt(3) / 2 * sphere.lattice_constant
    expected = [sphere.static_overlap, sphere.normal_stiffness, sphere.time_scale, row]
    np.testing.assert_allclose(rest, expected, rtol=1e-11)
    ratios = theory.ratios(nu, overlap_ratio=sphere.overlap_ratio if typed["geometry"] == "lammps" else 0.0)
    mode = theory.mode(typed["mode"], xi, ratios)
    numbers = [mode.frequency, mode.p, mode.q, mode.f, theory.generated_amplitude(mode, ratios)]
    read = [shown["mode"][name] for name in ("frequency", "p", "q", "f")] + [shown["generated"]]
    np.testing.assert_allclose(read, numbers, rtol=1e-11, atol=1e-12)
    p, q, turn = theory.second_order(mode, ratios, amplitude, np.array([7.0, 60.0, 120.0]))
    read = [[at[name] for at in shown["at"]] for name in ("p", "q", "φ")]
    np.testing.assert_allclose(read, [p, q, turn], rtol=0, atol=1e-12)
    special = {"resonance": theory.resonance(ratios), "antiresonance": theory.antiresonance(ratios)}
    waves = [mode, *(theory.mode("TR", place, ratios) for place in special.values() if place)]
    hertz = [wave.frequency / (2 * np.pi * sphere.time_scale) for wave in waves]
    assert [each["name"] for each in shown["waves"]] == [typed["mode"], *(name for name in special if special[name])]
    np.testing.assert_allclose([each["hertz"] for each in shown["waves"]], hertz, rtol=1e-9)
    lengths = [2 * np.pi / wave.wavenumber * row for wave in waves]
    np.testing.assert_allclose([each["length"] for each in shown["waves"]], lengths, rtol=1e-9)


def test_the_page_computes_the_closed_form_for_the_spheres_that_are_typed() -> None:
    for typed, shown in zip(VALUES, answers(*map(json.dumps, VALUES)), strict=True):
        compared_with_theory(typed, shown)
    assert len(shown["waves"]) == 3


@pytest.mark.parametrize(
    ("name", "value"), [("xi", "1.4750001"), ("nu", "0.1700001"), ("density", "2200.001"), ("adhesion", "0.0630001")]
)
def test_a_wrong_number_of_the_page_is_seen(name: str, value: str) -> None:
    (shown,) = answers(json.dumps(VALUES[0]))
    with pytest.raises(AssertionError):
        compared_with_theory(VALUES[0] | {name: value}, shown)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"radius": "0,5"}, 'radius: "0,5" is no number; write one as 0.2 or 2e-1'),
        ({"density": " "}, 'density: "" is no number; write one as 0.2 or 2e-1'),
        ({"nu": "0.6"}, "Poisson's ratio ν = 0.6: must be from -0.99 to 0.5"),
        ({"mode": "XX"}, 'wave = "XX": must be one of TR, RT, L'),
        ({"geometry": "true"}, 'points of contact = "true": must be one of paper, lammps'),
        ({"adhesion": "0"}, "work of adhesion and pressing force are both 0: nothing holds the contacts"),
        ({"modulus": "1e-3"}, "the overlap at rest is 44 % of a diameter: must be at most 10 %"),
        (
            {"geometry": "lammps", "force": "1e-7"},
            "points of contact of LAMMPS: need a pressing force of 0, which makes the crystal softer across",
        ),
    ],
)
def test_the_page_says_what_is_wrong_with_what_is_typed(changed: dict[str, str], says: str) -> None:
    assert answers(json.dumps(VALUES[0] | changed)) == [says]
