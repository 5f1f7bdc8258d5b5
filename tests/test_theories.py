"""Which theory holds which physics: what a run's scene calls for decides, and what leaves something out is refused."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from analysis import compare, directions, figure3, theories
from analysis.theories import (
    FORMS,
    LEAVES_OUT,
    THEORIES,
    Physics,
    TheoryError,
    Wave,
    best,
    holding,
    physics_of,
    trajectory,
)
from granular_lmp import Record
from granular_lmp.scene.sections import Envelope
from tests.conftest import PAPER

TAU = np.arange(0.0, 30.0, 0.5)
PLAIN = Record(TAU, TAU, TAU, TAU, PAPER)
USUAL = physics_of(PLAIN)
With = Callable[..., Wave]


@pytest.fixture
def with_physics(monkeypatch: pytest.MonkeyPatch) -> With:
    """The paper's wave, run with some of its physics changed, here and in `compare`."""

    def make(**changes: object) -> Wave:
        monkeypatch.setattr(theories, "physics_of", lambda record: replace(USUAL, **changes))
        return Wave.of(PLAIN)

    return make


def record_of(theory: str, wave: Wave) -> Record:
    p, q, phi = trajectory(theory, wave, TAU)
    return replace(PLAIN, p=p, q=q, phi=phi)


def worst(record: Record, theory: str, wave: Wave) -> float:
    return max(error or 0.0 for error in compare.errors(record, trajectory(theory, wave, TAU)).values())


# What a scene may call for: who holds it, who is best
PHYSICS = [
    ({}, set(THEORIES), "hierarchy"),
    ({"prestress": 1.0}, set(THEORIES), "hierarchy"),
    ({"rotation": False}, set(THEORIES), "hierarchy"),
    ({"shear": False}, set(THEORIES), "hierarchy"),
    ({"law": "incremental"}, {"second-order", "hierarchy", "exact-lattice"}, "hierarchy"),
    ({"viscosity": 0.005}, {"hierarchy", "exact-lattice"}, "hierarchy"),
    ({"prestress": 1.0, "restitution": 0.98}, {"hierarchy", "exact-lattice"}, "hierarchy"),
]


@pytest.mark.parametrize(("changes", "names", "expected"), PHYSICS, ids=[str(changes) for changes, *_ in PHYSICS])
def test_what_holds_the_physics_of_a_run_is_close_to_the_lattice(
    changes: dict[str, object], names: set[str], expected: str, with_physics: With
) -> None:
    wave = with_physics(**changes)
    assert set(holding(wave.physics)) == names
    assert best(wave, TAU) == expected
    exact = record_of("exact-lattice", wave)
    for name in names:
        # Second order is off by 0.4 % at ξ=0.802, a=0.2; the hierarchy by the next order, a⁶.
        limit = 1e-5 if name in ("hierarchy", "exact-lattice") else 0.01
        assert worst(exact, name, wave) < limit, name


@pytest.mark.parametrize("changes", [changes for changes, *_ in PHYSICS[1:]], ids=str)
def test_physics_left_out_is_seen(changes: dict[str, object], with_physics: With) -> None:
    exact = record_of("exact-lattice", with_physics(**changes))
    assert worst(exact, "hierarchy", with_physics()) > 1e-4  # compression of these spheres, h̃ = 2.5e-4, does least


@pytest.mark.parametrize(("changes", "names", "expected"), PHYSICS, ids=[str(changes) for changes, *_ in PHYSICS])
def test_a_theory_that_leaves_something_out_is_refused_by_name(
    changes: dict[str, object], names: set[str], expected: str, with_physics: With
) -> None:
    wave = with_physics(**changes)
    for name in set(THEORIES) - names:
        with pytest.raises(TheoryError, match=f"theory = '{name}' leaves out"):
            trajectory(name, wave, TAU)
        with pytest.raises(TheoryError, match=", ".join(holding(wave.physics))):
            compare.compare(PLAIN, name)


def test_sliding_contacts_are_compared_with_nothing(with_physics: With) -> None:
    wave = with_physics(sliding=True)
    result = compare.compare(PLAIN)
    assert (result.theory, result.error, result.lattice_error) == (None, {}, {})
    assert (result.predicted, result.measured) == (None, None)
    assert "sliding of contacts is in no theory here" in result.notes[-1]
    assert f"{'-':>9}{'-':>9}{'-':>9}" in compare.table([result])
    with pytest.raises(TheoryError, match="no theory here holds sliding"):
        best(wave, TAU)
    with pytest.raises(TheoryError, match="that hold it: none"):
        compare.compare(PLAIN, "exact-lattice")


def test_no_second_harmonic_is_predicted_for_a_damped_wave(with_physics: With) -> None:
    record = record_of("hierarchy", with_physics(viscosity=0.01))
    result = compare.compare(record)
    assert (result.predicted, result.measured) == (None, None)
    assert f"{'-':>11}" in compare.table([result])


def test_the_second_harmonic_under_the_incremental_law_is_measured_as_predicted(with_physics: With) -> None:
    result = compare.compare(record_of("second-order", with_physics(law="incremental")))
    assert result.measured == pytest.approx(result.predicted, rel=1e-9)
    with_physics()
    assert compare.compare(PLAIN, "second-order").predicted == pytest.approx((result.predicted or 0) / 1.906, rel=1e-2)


def test_where_the_hierarchy_has_not_converged_a_damped_wave_is_left_to_the_lattice(with_physics: With) -> None:
    wave = replace(with_physics(viscosity=0.01), amplitude=5.0)
    assert best(wave, TAU) == "exact-lattice"


def test_run_json_says_what_was_left_out() -> None:
    info = {"effects": {name: {"on": name == "sliding"} for name in ("shear", "rotation", "sliding")}}
    found = physics_of(replace(PLAIN, info=info))
    assert (found.shear, found.rotation, found.sliding) == (False, False, True)
    sphere = PAPER.sphere
    assert Physics(sphere.poisson_ratio, sphere.overlap_ratio) == USUAL


def test_every_theory_says_what_it_leaves_out() -> None:
    assert set(LEAVES_OUT) == set(THEORIES)
    everything = replace(
        USUAL, viscosity=0.1, law="incremental", sliding=True, opening=True, direction=17.0
    ).beyond_the_paper | set(FORMS)
    assert all(left <= everything for left in LEAVES_OUT.values())


# --- any direction, and what is no running plane wave ---

ANY_DIRECTION = {"second-order", "hierarchy", "exact-lattice"}


@pytest.mark.parametrize("direction", [0.0, 17.0, -41.0])
@pytest.mark.parametrize("changes", [changes for changes, *_ in PHYSICS], ids=str)
def test_theories_of_any_direction_are_close_to_the_lattice(
    changes: dict[str, object], direction: float, with_physics: With
) -> None:
    wave = with_physics(direction=direction, **changes)
    assert wave.mode.direction == direction
    damped = "viscosity" in changes or "restitution" in changes
    assert set(holding(wave.physics)) == ANY_DIRECTION - ({"second-order"} if damped else set())
    assert best(wave, TAU) == "hierarchy"
    exact = record_of("exact-lattice", wave)
    assert worst(exact, "hierarchy", wave) < 1e-5  # a⁶, as along y
    if not damped:
        # a² = 0.04 of the second harmonic, all there is in p but for 5e-4 of the mode itself.
        assert worst(exact, "second-order", wave) < 0.06


@pytest.mark.parametrize("changes", [{"direction": 18.0}, {"direction": 17.0, "law": "incremental"}], ids=str)
def test_another_direction_or_law_is_seen(changes: dict[str, object], with_physics: With) -> None:
    exact = record_of("exact-lattice", with_physics(**changes))
    assert worst(exact, "hierarchy", with_physics(direction=17.0)) > 1e-3


def test_the_wave_of_a_run_is_the_mode_of_its_direction(with_physics: With) -> None:
    wave = with_physics(direction=17.0, rotation=False)
    sphere = PAPER.sphere
    assert wave.mode == directions.mode(
        "TR", PAPER.wavenumber, 17.0, sphere.poisson_ratio, overlap_ratio=sphere.overlap_ratio, rotation=False
    )


@pytest.mark.parametrize("name", ["frequency-shift", "three-mode"])
def test_theories_of_y_refuse_another_direction(name: str, with_physics: With) -> None:
    wave = with_physics(direction=17.0)
    with pytest.raises(TheoryError, match=f"theory = '{name}' leaves out another direction than y"):
        trajectory(name, wave, TAU)


def test_where_the_hierarchy_has_not_converged_an_oblique_wave_is_left_to_the_lattice(with_physics: With) -> None:
    assert best(replace(with_physics(direction=17.0), amplitude=5.0), TAU) == "exact-lattice"


def test_an_oblique_run_is_compared_without_an_amplitude(with_physics: With) -> None:
    wave = with_physics(direction=17.0)
    result = compare.compare(record_of("exact-lattice", wave))
    assert (result.theory, result.direction) == ("hierarchy", 17.0)
    assert (result.predicted, result.measured, result.fit_error) == (None, None, None)
    assert all(error is not None and error < 1e-5 for error in result.error.values())
    assert all(error == 0 for error in result.lattice_error.values())
    assert "17" in compare.figure(PLAIN, result).get_suptitle()
    wrong = record_of("exact-lattice", wave)
    assert compare.compare(replace(wrong, q=1.01 * wrong.q)).error["q"] == pytest.approx(0.01, rel=1e-2)


@pytest.mark.parametrize("form", FORMS)
def test_what_is_no_running_plane_wave_is_left_to_its_script(form: str, with_physics: With) -> None:
    script = FORMS[form][1]
    wave = with_physics(form=form)
    result = compare.compare(PLAIN)
    assert (result.theory, result.error, result.lattice_error, result.predicted) == (None, {}, {}, None)
    by = f"by `python -m {script}`, here " if script else ""
    assert f"is compared {by}with nothing" in result.notes[-1]
    assert holding(wave.physics) == []
    with pytest.raises(TheoryError, match=f"leaves out {form}"):
        compare.compare(PLAIN, "exact-lattice")


@pytest.mark.parametrize(
    ("form", "direction", "width", "expected"),
    [
        ("running", 17.0, 0.0, "running"),
        ("running", 90.0, 9.0, "finite"),
        ("standing", 90.0, 0.0, "standing"),
        ("standing", 17.0, 0.0, "finite"),
        ("standing", 90.0, 9.0, "finite"),
        ("driven", 90.0, 0.0, "driven"),
        ("driven", 90.0, 9.0, "driven beam"),
    ],
)
@pytest.mark.parametrize("ends", ["periodic", "fixed"])
def test_the_scene_says_what_kind_of_wave_it_is(
    form: str, direction: float, width: float, expected: str, ends: str
) -> None:
    scene = SimpleNamespace(
        sphere=PAPER.sphere,
        effects=PAPER.effects,
        direction=direction,
        envelope=Envelope(width=width),
        shape=SimpleNamespace(ends=ends),
        wave=SimpleNamespace(form=form),
    )
    found = physics_of(replace(PLAIN, scene=scene))
    if expected == "finite" and ends == "fixed" and width:
        expected = "between walls"
    assert (found.form, found.direction) == (expected, direction)


@pytest.mark.parametrize(
    ("script", "words"), [(compare, ["--theory", "second-order"]), (figure3, ["-o", "{tmp}/a.png"])]
)
def test_scripts_refuse_in_one_line_what_a_theory_leaves_out(
    script, words, with_physics, monkeypatch, tmp_path
) -> None:
    with_physics(viscosity=0.01)
    monkeypatch.setattr(script, "load", lambda folder, **_: PLAIN)
    with pytest.raises(SystemExit, match="leaves out damping"):
        script.main(["run", *words])
