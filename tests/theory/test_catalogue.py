"""Unknown physics is refused: every effect, form and key is declared by a theory, or refused by name."""

from collections.abc import Callable
from dataclasses import field, fields, make_dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cases.effects import case as effects
from cases.figure3 import case as figure3
from cases.oblique import case as oblique
from cases.rows import load_form
from cases.sheets import case as sheets
from cases.spectrum import points as spectrum
from granular_analysis.theory import catalogue
from granular_analysis.theory.catalogue import (
    CRYSTAL,
    FACES,
    HOLDS,
    KEYS,
    KNOWN,
    NETWORK,
    OPENING,
    REFERENCES,
    SLIDING,
    missing,
)
from granular_analysis.theory.choice import THEORIES, TheoryError, holding, traits, traits_of, trajectory, wave_of
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, run
from granular_lmp.crystal.disorder import Inclusion
from granular_lmp.effects import selection as package_effects
from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import Effect
from granular_lmp.effects.selection import EFFECTS
from granular_lmp.frozen import dataclass
from granular_lmp.scene.forms import FORMS
from granular_lmp.scene.sections import MODES, SHEAR_LAWS
from tests.conftest import PAPER
from tests.stand_in import Changed

TAU = np.arange(0.0, 5.0, 0.5)
EFFECTS = [row.name for row in EFFECTS]
INVENTED_EFFECT, INVENTED_FORM = "capillary", "spiral"


def record_of(scene: Any = PAPER, *on: str, off: tuple[str, ...] = ()) -> Record:
    """A record that is the linear wave, of a run in which some effects were on."""
    said = {name: {"on": name in on, "called_for": name in on, "guard": ""} for name in (*on, *off)}
    still = np.zeros(len(TAU))
    return Record.of_centre(TAU, still, np.cos(TAU), np.sin(TAU), scene, {"effects": said})


def with_wave(**changes: Any) -> Any:
    """The paper's scene with a wave that no check of a scene has seen."""
    wave = replace(PAPER.wave, **changes)
    return Changed(PAPER, wave=wave, require_wave=lambda: wave)


def outcome(record: Record) -> tuple[bool, str]:
    """Return whether the comparison of a run holds a number, and the message if it does not."""
    try:
        result = compare.compare(record)
    except TheoryError as error:
        return False, str(error)
    numbers = [*result.error.values(), *result.lattice_error.values(), result.predicted, result.measured]
    return any(number is not None for number in numbers), " ".join(result.notes)


# --- effects and forms ---


@pytest.mark.parametrize("form", [*FORMS, INVENTED_FORM])
@pytest.mark.parametrize("name", [*EFFECTS, INVENTED_EFFECT])
def test_every_effect_and_form_is_declared_by_a_theory_or_refused_by_name(name: str, form: str) -> None:
    record = record_of(with_wave(form=form), name)
    traits, (judged, said) = traits_of(record), outcome(record)
    names = {f"effects.{name}", f"wave.form = '{form}'"}
    assert names - {"effects.damping"} <= traits  # without a dashpot nothing is damped
    left_out = (names & traits) - HOLDS["exact-lattice"]
    assert judged == (not left_out or not traits - HOLDS[CRYSTAL])
    # A trait that nobody knows is an error, which names it alone; else the comparison is empty and a note names all
    assert all(trait in said for trait in left_out - KNOWN or left_out), said
    for theory in THEORIES if left_out else ():
        with pytest.raises(TheoryError, match="no theory here holds|leaves out"):
            compare.compare(record, theory)


INVENTED = [
    (record_of(PAPER, INVENTED_EFFECT), "effects.capillary"),
    (record_of(with_wave(form=INVENTED_FORM)), "wave.form = 'spiral'"),
]


@pytest.mark.parametrize(("record", "name"), INVENTED, ids=[name for _, name in INVENTED])
def test_an_invented_effect_or_form_is_refused_by_every_theory_and_script(
    record: Record, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert all(name in missing(theory, traits_of(record)) for theory in HOLDS)
    with pytest.raises(TheoryError, match=f"no theory here holds {name}"):
        wave_of(record)
    with pytest.raises(ValueError, match=name):
        sheets.refuse(record)
    assert name in (spectrum.refusal(record) or "")
    assert name in (oblique.refusal(record) or "")
    for module, script in (("granular_analysis.tools.compare", compare), ("cases.runner", figure3)):
        monkeypatch.setattr(f"{module}.load", lambda folder, **_: record)
        with pytest.raises(SystemExit, match=f"no theory here holds {name}"):
            script.main(["run"])
    monkeypatch.setattr(effects, "sweep", lambda folder: [record])
    with pytest.raises(SystemExit, match=name):
        effects.main(["sweep"])


@pytest.mark.parametrize("form", ["standing", "driven"])
def test_an_invented_effect_or_form_is_no_standing_and_no_driven_wave(
    form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    capillary, spiral = record_of(with_wave(form=form), INVENTED_EFFECT), record_of(with_wave(form=INVENTED_FORM))
    for record, said in ((capillary, "leaves out effects.capillary, which"), (spiral, "has the form 'spiral'")):
        monkeypatch.setattr("cases.rows.load", lambda folder, record=record: record)
        with pytest.raises(SystemExit, match=said):
            load_form("run", form)


@pytest.mark.parametrize("law", [*SHEAR_LAWS, "rescaled"])
@pytest.mark.parametrize("mode", [*MODES, "TT"])
def test_every_law_and_mode_is_declared_or_refused_by_name(law: str, mode: str) -> None:
    scene = Changed(with_wave(mode=mode), effects=replace(PAPER.effects, shear_law=law))
    judged, said = outcome(record_of(scene))
    unknown = [f"effects.shear_law = '{law}'"] * (law == "rescaled") + [f"wave.mode = '{mode}'"] * (mode == "TT")
    assert judged == (not unknown)
    assert all(name in said for name in unknown)


@pytest.mark.parametrize("ends", ["fixed", "periodic", "free"])
def test_every_kind_of_ends_is_declared_or_refused_by_name(ends: str) -> None:
    scene = Changed(PAPER, shape=SimpleNamespace(ends=ends))
    judged, said = outcome(record_of(scene))
    assert judged == (ends != "free")
    assert judged or "packing.ends = 'free'" in said


# --- keys and sections that nobody knows ---


@dataclass(frozen=True)
class Absorb:
    """A section that scenes may have one day."""

    rows: int = 0
    reflection: float = 1e-3


def grown(section: str, key: str, default: Any, value: Any) -> Any:
    """The paper's scene whose section has one key more."""
    before = getattr(PAPER, section)
    kind = make_dataclass(
        type(before).__name__, [(key, Any, field(default=default))], bases=(type(before),), eq=False, repr=False
    )
    values = {known.name: getattr(before, known.name) for known in fields(before)}  # without what it has cached
    return replace(PAPER, **{section: kind(**values, **{key: value})})


NEW_KEYS = [
    ("effects", "capillary", "auto", True),
    ("effects", "surface_tension", 0.0, 0.1),
    ("material", "moment_of_inertia", 0.4, 0.5),
    ("wave", "chirp", 0.0, 1e-3),
]


@pytest.mark.parametrize(("section", "key", "default", "value"), NEW_KEYS)
def test_a_key_that_no_theory_knows_is_refused_unless_it_is_at_its_default(
    section: str, key: str, default: Any, value: Any
) -> None:
    judged, said = outcome(record_of(grown(section, key, default, value)))
    assert not judged
    assert said == f"no theory here holds {'sphere' if section == 'material' else section}.{key}"
    assert outcome(record_of(grown(section, key, default, default)))[0]


def test_an_effect_that_is_switched_off_is_not_there() -> None:
    assert outcome(record_of(grown("effects", "capillary", "auto", False)))[0]


@pytest.mark.parametrize(
    ("default", "value", "said"),
    [(Absorb(), Absorb(rows=40), "coating.rows"), ((), ({"vacancy": True},), "coating")],
)
def test_a_section_that_no_theory_knows_is_refused_unless_it_is_at_its_default(
    default: Any, value: Any, said: str
) -> None:
    kind = make_dataclass("Grown", [("coating", Any, field(default=default))], bases=(Scene,), eq=False, repr=False)
    values = {known.name: getattr(PAPER, known.name) for known in fields(Scene)}
    assert outcome(record_of(kind(**values)))[0]
    assert outcome(record_of(kind(**values, coating=value))) == (False, f"no theory here holds {said}")


def test_the_keys_that_are_known_are_those_of_a_scene() -> None:
    tables = {"name": "", **PAPER.with_values({"time.tolerance": 1e-2, "sphere.adhesion_law": "jkr"}).to_dict()}
    keys = {f"{table}.{key}" for table, values in tables.items() if isinstance(values, dict) for key in values}
    # A step excludes a tolerance, the force is of the packing, forces on spheres are recorded without a wave, a table
    # of which nothing is declared is not there, and monitors change no motion, nor does the density of a substrate that
    # is rigid; a face that is declared is a trait, and so is what makes a crystal one in space, a late parting, a table
    # of measured stiffnesses each key is there where it is declared
    others = {
        "contact.normal_stiffness",
        "contact.shear_stiffness",
        "time.timestep",
        "sphere.contact_force",
        "disorder.seed",
        "monitor",
        "output.forces",
        "substrate.density",
    }
    in_space = {f"packing.{name}" for name in ("space", "layers", "depth", "orientation")}
    assert keys - FACES - in_space - {"effects.parting", "packing.table"} | others == KEYS


def test_departures_are_what_is_not_at_its_default() -> None:
    scene = PAPER.with_values({"wave.phase": 0.3, "packing.contact_force": 0.0})
    found = scene.departures()
    assert found["wave.phase"] == 0.3
    assert found["sphere.radius"] == PAPER.material.radius
    assert not {"packing.contact_force", "wave.form", "effects.rotation", "envelope.length"} & set(found)


# --- the catalogue itself ---


def test_every_reference_has_its_line_and_the_network_alone_has_contacts_that_slide_or_open() -> None:
    assert (*THEORIES, NETWORK, CRYSTAL) == REFERENCES
    assert [name for name, held in HOLDS.items() if held & {SLIDING, OPENING}] == [NETWORK]


IMPERFECT = {
    "disorder.radius": 1e-5,
    "disorder.density": 0.1,
    "disorder.vacancies": 0.01,
    "inclusion": [{"rows": [2, 3], "density": 1e4, "poisson_ratio": 0.3}, {"spheres": [[5, 1]], "vacancy": True}],
}
SAID_OF_INCLUSIONS = {f"inclusion.{key}" for key in ("rows", "density", "poisson_ratio", "spheres", "vacancy")}


@pytest.mark.parametrize("key", IMPERFECT)
def test_an_imperfect_crystal_is_held_by_the_network_alone(key: str) -> None:
    sized = PAPER.with_values({"packing.rows": 201, "packing.columns": 4, "packing.ends": "fixed"})
    found = traits_of(record_of(sized.with_values({key: IMPERFECT[key]}))) - traits_of(record_of(sized))
    assert found == ({key} if key != "inclusion" else SAID_OF_INCLUSIONS)
    assert [name for name, held in HOLDS.items() if held >= found] == [NETWORK]


def test_a_seed_of_which_nothing_is_drawn_changes_nothing() -> None:
    assert traits_of(record_of(PAPER.with_values({"disorder.seed": 7}))) == traits_of(record_of())


@dataclass(frozen=True)
class Wet(Inclusion):
    """An inclusion with a key that scenes may have one day."""

    wetness: float = 0.0


def test_a_key_of_an_inclusion_that_no_theory_knows_is_refused_unless_it_is_at_its_default() -> None:
    dry, wet = (Changed(PAPER, inclusion=(Wet(rows=[2, 3], density=1e4, wetness=value),)) for value in (0.0, 0.5))
    assert outcome(record_of(wet)) == (False, "no theory here holds inclusion.wetness")
    assert "no theory of a plane wave holds inclusion.density, inclusion.rows" in outcome(record_of(dry))[1]


@pytest.mark.parametrize("theory", THEORIES)
def test_a_theory_that_lacks_one_trait_of_a_run_refuses_it(theory: str, monkeypatch: pytest.MonkeyPatch) -> None:
    record = record_of(PAPER, *("adhesion", "shear", "rotation", "tracking", "walls"))
    wave = wave_of(record)
    assert theory in holding(wave)
    for trait in traits(wave):
        monkeypatch.setitem(catalogue.HOLDS, theory, HOLDS[theory] - {trait})
        assert theory not in holding(wave)
        with pytest.raises(TheoryError, match=f"theory = '{theory}' leaves out {trait}; theories that hold it: "):
            trajectory(theory, wave, TAU)
        monkeypatch.undo()


# --- an effect that somebody adds, in LAMMPS ---


@pytest.fixture
def capillary(monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], None]:
    """Adds capillary forces to the table of effects, on or off."""

    def add(on: bool) -> None:
        def rule(case: Case) -> Finding:
            return Finding(on, 1.0, "of everything is wet")

        row = Effect(
            "capillary",
            rule,
            cost="1.00",
            loss=lambda case: "all",
            switch="packing.capillary",
            declared=lambda scene: on,
        )
        monkeypatch.setattr(package_effects, "EFFECTS", (*package_effects.EFFECTS, row))

    return add


@pytest.mark.usefixtures("unrendered")
def test_an_effect_added_to_the_table_is_refused_until_a_theory_declares_it(
    capillary: Callable[[bool], None], small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capillary(True)
    record = run(small, tmp_path / "on")
    assert record.info["effects"]["capillary"]["on"]
    with pytest.raises(SystemExit, match=r"on: no theory here holds effects\.capillary$"):
        compare.main([str(tmp_path / "on")])
    for theory in THEORIES:
        monkeypatch.setitem(catalogue.HOLDS, theory, HOLDS[theory] | {"effects.capillary"})
    monkeypatch.setattr(catalogue, "KNOWN", KNOWN | {"effects.capillary"})
    assert compare.main([str(tmp_path / "on")]) == 0


@pytest.mark.usefixtures("unrendered")
def test_an_effect_added_to_the_table_that_is_off_is_no_matter(
    capillary: Callable[[bool], None], small: Scene, tmp_path: Path
) -> None:
    capillary(False)
    run(small, tmp_path / "off")
    assert compare.main([str(tmp_path / "off")]) == 0
