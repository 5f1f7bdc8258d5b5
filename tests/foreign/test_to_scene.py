"""A foreign deck of a crystal of ours becomes the scene of this crystal, and one that is nearly so none."""

from math import cos, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.own_deck.case import DECK
from granular_lmp import Scene, run
from granular_lmp.cli import main
from granular_lmp.errors import GranularError, SceneError
from granular_lmp.foreign.conversion import Known
from granular_lmp.foreign.known import known_of
from granular_lmp.foreign.likeness import likeness
from granular_lmp.foreign.outside import outside_of
from granular_lmp.foreign.reading import Reading, read
from granular_lmp.foreign.to_scene import Described, scene_of
from granular_lmp.problem import prepare
from granular_lmp.runs.unnamed import Unnamed
from tests.conftest import members
from tests.foreign.stripped import SAME, Y_TO_X, law, stripped
from tests.instance import run_deck

STEEL = {"radius": 0.005, "youngs_modulus": 2e11, "poisson_ratio": 0.3, "density": 7800.0}
SILICA = {"radius": 5e-7, "youngs_modulus": 73e9, "poisson_ratio": 0.17, "density": 2200.0, "work_of_adhesion": 0.063}
SHORT = {"duration": 1.0, "timestep": 0.05, "sample": 0.5}
STRUCK = {"time": SHORT, "striker": [{"rows": [0, 0], "velocity": 0.01}]}
# Scenes of all kinds that a deck without a word of ours can be: lattice, what holds it, law, spheres, beginning
SCENES: dict[str, dict[str, Any]] = {
    "walls": {
        "sphere": STEEL,
        "packing": {"lattice": "square", "rows": 4, "columns": 5, "first": "wall", "sides": "wall", "last": "free"},
        "striker": [{"rows": [3, 3], "velocity": 1.0, "direction": "-y"}],
    },
    "damped walls": {
        "sphere": STEEL,
        "packing": {"lattice": "square", "rows": 3, "columns": 4, "first": "wall", "last": "free"},
        "effects": {"friction": 0.3, "viscosity": 20.0, "shear_damping": 0.5},
        "striker": [{"rows": [2, 2], "velocity": 1.0, "direction": "-y"}],
    },
    "chain": {
        "sphere": STEEL,
        "packing": {"rows": 7, "first": "held"},
        "striker": [{"rows": [6, 6], "velocity": 1.0, "direction": "-y"}],
        "effects": {"restitution": 0.9},
    },
    "loaded chain": {"sphere": STEEL, "packing": {"rows": 8, "last": "held", "contact_force": 30.0}, **STRUCK},
    "chain of unequal spheres": {
        "sphere": STEEL,
        "packing": {"rows": 7},
        "inclusion": [{"rows": [2, 3], "radius": 0.004, "density": 1200.0}],
        **STRUCK,
    },
    "sheet with friction": {
        "sphere": STEEL,
        "packing": {"lattice": "hexagonal", "rows": 5, "columns": 6, "first": "held", "sides": "periodic"},
        "effects": {"friction": 0.3, "shear_law": "rescaled", "viscosity": 20.0, "shear_damping": 0.5},
        "striker": [{"spheres": [[4, 2], [4, 3]], "velocity": 1.0, "direction": "x"}],
    },
    "square sheet": {"sphere": STEEL, "packing": {"lattice": "square", "rows": 5, "columns": 4}, **STRUCK},
    "adhesive sheet": {
        "sphere": SILICA,
        "packing": {"lattice": "hexagonal", "rows": 6, "columns": 5, "ends": "periodic", "sides": "held"},
        "effects": {"friction": 5.0, "viscosity": 1e-8},
        "inclusion": [{"spheres": [[1, 3], [3, 1]], "vacancy": True}],
        "striker": [{"spheres": [[0, 2]], "velocity": 0.01}],
    },
    "jkr honeycomb": {
        "sphere": {**SILICA, "adhesion_law": "jkr"},
        "packing": {"lattice": "honeycomb", "rows": 4, "columns": 6, "ends": "periodic", "sides": "periodic"},
        "effects": {"shear": False},
        **STRUCK,
    },
    "pressed sheet": {
        "sphere": STEEL,
        "packing": {
            "lattice": "hexagonal",
            "rows": 6,
            "columns": 5,
            "ends": "periodic",
            "sides": "periodic",
            "contact_force": 50.0,
        },
        "start": {"state": [[2, 1, 0.0, 0.0, 1e-3, 2e-3, 0.0], [3, 4, 0.0, 0.0, 0.0, -1e-3, 0.5]]},
        "effects": {"friction": 0.5},
    },
    "spread of radii": {
        "sphere": SILICA,
        "packing": {"lattice": "hexagonal", "rows": 7, "columns": 6, "sides": "free"},
        "disorder": {"radius": 4e-5, "density": 0.1},
        "effects": {"shear": False},
        **STRUCK,
    },
    "wave in a chain": {
        "sphere": SILICA,
        "packing": {"lattice": "chain", "rows": 41},
        "wave": {"mode": "L", "wavenumber": 0.802, "amplitude": 0.2, "phase": 0.3},
        "time": {**SHORT, "allow_echo": True},
    },
    "oblique wave": {
        "sphere": SILICA,
        "packing": {"rows": 8, "columns": 8, "ends": "periodic"},
        "effects": {"shear": False},
        "wave": {"mode": "L", "wavevector": [0.7853981633974483, 0.9068996821171089], "amplitude": 0.1},
        "time": SHORT,
    },
    "standing wave": {
        "sphere": SILICA,
        "packing": {"lattice": "chain", "rows": 16, "ends": "periodic"},
        "wave": {"mode": "L", "wavenumber": 0.7853981633974483, "amplitude": 0.2, "form": "standing"},
        "time": SHORT,
    },
    "fcc": {
        "sphere": SILICA,
        "packing": {"lattice": "fcc", "rows": 6, "columns": 3, "ends": "periodic"},
        "effects": {"shear": False},
        "wave": {"mode": "L", "wavenumber": 0.5, "amplitude": 1.0, "form": "none"},
        "striker": [{"rows": [3, 3], "velocity": 1e-3, "direction": "z"}],
        "time": SHORT,
    },
}
SCENES["sheet of hexagons"] = {"sphere": STEEL, "packing": {"lattice": "hexagonal", "rows": 7, "columns": 6}, **STRUCK}
TURNED = ("walls", "damped walls", "sheet with friction", "chain", "spread of radii", "oblique wave", "fcc")
# Members of make stability
MORE = ("walls", "square sheet", "chain of unequal spheres", "jkr honeycomb", "standing wave", "pressed sheet")
REFUSED_MORE = ("gaps", "a drive", "two ways to move", "rest before", "rolling", "springs", "half a degree")


def described(deck: Path) -> Described:
    reading = read(deck)
    return scene_of(reading, known_of(reading, Known())[0], "plain", np.empty(0))


def made(name: str) -> Scene:
    return Scene.from_dict({"time": {"duration": 1.0, "timestep": 0.02}, **SCENES[name]}, "plain")


def keys_that_differ(scene: Scene, other: Scene) -> dict[str, tuple[Any, Any]]:
    """Return the keys of two scenes that differ, without those that are left to "auto" or are of the record."""
    one, two = prepare(scene).scene.to_dict(), prepare(other).scene.to_dict()
    found = {}
    for table in ("sphere", "packing", "effects", "wave", "start", "striker", "inclusion", "contact"):
        first, second = (_flat(each.get(table, {})) for each in (one, two))
        for key in first.keys() | second.keys():
            a, b = first.get(key), second.get(key)
            # Nine digits of a load, and eleven of a wave in a crystal whose ends no box says
            if a not in ("auto", b) and not (isinstance(a, float) and b == pytest.approx(a, rel=1e-9, abs=1e-11)):
                found[f"{table}.{key}"] = (a, b)
    return found


def _flat(value: Any) -> dict[str, Any]:
    pairs = enumerate(value) if isinstance(value, list | tuple) else getattr(value, "items", list)()
    found = {f"{key}.{name}".strip("."): each for key, inner in pairs for name, each in _flat(inner).items()}
    return found or {"": value}


@pytest.mark.parametrize(
    ("name", "turned"),
    members(
        [*((name, False) for name in SCENES), *((name, True) for name in TURNED)],
        *((name, False) for name in MORE),
        *((name, True) for name in TURNED[1:]),
    ),
)
def test_the_scene_of_a_plain_deck_is_the_first_one(name: str, turned: bool, tmp_path: Path) -> None:
    scene = made(name)
    found = described(stripped(scene, tmp_path, turn=Y_TO_X if turned else SAME, units="micro" if turned else "si"))
    others = keys_that_differ(scene, found.scene)
    if found.scene.packing.table:  # says the spheres one by one, in place of a spread or an [[inclusion]]
        others = {
            key: each for key, each in others.items() if not key.startswith(("sphere", "packing.table", "inclus"))
        }
        own, theirs = prepare(scene).rest, prepare(found.scene).rest
        ratio = scene.sphere.mass / found.scene.sphere.mass
        np.testing.assert_allclose(theirs.mass, own.mass * ratio, rtol=1e-12)  # rounding of density and radius
    assert others == {}
    like = found.likeness
    # Rounding of places, of up to 41 rows; in a crystal that comes to rest, what is left of its forces
    assert like.largest < (1e-9 if name == "spread of radii" else 1e-14) * like.diameter
    assert like.motion < 1e-10
    assert max(like.normal, like.shear, like.force, like.spheres) < 1e-4


def test_the_order_in_which_lammps_holds_spheres_does_not_count(tmp_path: Path) -> None:
    deck = stripped(made("chain of unequal spheres"), tmp_path)
    data = deck.with_name("data.plain")
    before, title, rest = data.read_text().partition("\n\nAtoms # sphere\n\n")
    lines, *others = rest.split("\n\n")
    spheres = lines.split("\n")
    turned = "\n".join(spheres[2:] + spheres[:2])  # a small sphere is the first
    data.write_text(before + title + "\n\n".join([turned, *others]))
    deck.write_text(deck.read_text().replace("newton off", "newton off\natom_modify sort 0 0"))
    assert described(deck).likeness.normal < 1e-4


def test_another_scene_is_seen_by_that_comparison() -> None:
    scene = made("chain")
    for key, value in (("sphere.density", 7801.0), ("packing.first", "free"), ("effects.restitution", 0.89)):
        assert list(keys_that_differ(scene, scene.with_values({key: value}))) == [key]


WRONG = {
    "sphere.youngs_modulus": (74.5e9, "from their places in the scene"),
    "sphere.density": (2201.0, "radii, masses or time steps"),
    "contact.shear_stiffness": (600.0, "shear stiffnesses"),
    "packing.sides": ("free", "holds other spheres"),
    "striker.1.velocity": (0.0101, "velocities"),
    "inclusion.1.spheres": ([[1, 3], [3, 2]], "contacts are in the deck"),
    "effects.viscosity": (2e-8, "forces at the beginning"),
    "time.timestep": (0.01, "radii, masses or time steps"),
}


@pytest.fixture(scope="module")
def adhesive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Reading, Described]:
    """A deck and its scene."""
    reading = read(stripped(made("adhesive sheet"), tmp_path_factory.mktemp("adhesive")))
    return reading, scene_of(reading, known_of(reading, Known())[0], "plain", np.empty(0))


@pytest.mark.parametrize("key", members(WRONG, "packing.sides", "inclusion.1.spheres", "time.timestep"))
def test_a_scene_of_another_crystal_is_refused(key: str, adhesive: tuple[Reading, Described]) -> None:
    reading, found = adhesive
    value, message = WRONG[key]
    assert reading.spheres is not None
    with pytest.raises(SceneError, match=message):
        likeness(reading, reading.spheres, found.scene.with_values({key: value}), found.indexed, outside_of(reading))


def _sheared(places: Any) -> Any:
    return 1e-3 * places[:, 1:2] * [1, 0, 0]


def _strained(places: Any) -> Any:
    return -1e-3 * places[:, 1:2] * [0, 1, 0]


def _stretched(places: Any) -> Any:
    return 1e-3 * places


def _twisted(degrees: float) -> Any:
    c, s = cos(radians(degrees)), sin(radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


STEEL_LAW = "hertz/material 200000000000.0 0.0 0.3 tangential linear_nohistory 0.0 0.0 damping velocity"
WALL = f"fix wall all wall/gran granular {STEEL_LAW} yplane -0.02785 NULL"
# Crystals that are nearly one of ours: scene, how its deck is another, and what is said of it
NEARLY: dict[str, tuple[str, dict[str, Any], str]] = {
    "a sheared square lattice": ("square sheet", {"move": _sheared}, "square lattice that is turned by|sheared by 5.0"),
    "a strained crystal": ("sheet of hexagons", {"move": _strained}, "hexagonal lattice that is strained: .* y -"),
    "gaps": ("square sheet", {"move": _stretched}, "are 1e-05 m apart, 0.002 of a radius; in a scene they touch"),
    "thirty degrees": ("square sheet", {"turn": _twisted(30)}, "square lattice with rows at 30 degrees to an axis"),
    "half a degree": ("sheet of hexagons", {"turn": _twisted(0.5)}, "is turned by 0.5 degrees"),
    "a wall": ("square sheet", {"more": WALL}, "a wall has young 200000000000.0, and 4000"),
    "weight": ("square sheet", {"more": "fix w free gravity 9.81 vector 0 -1 0"}, "a constant force acts on sphere 1"),
    "drag": ("square sheet", {"more": "fix v free viscous 1e-3"}, "'fix v free viscous 1e-3': no key of a scene"),
    "a drive": (
        "square sheet",
        {"more": "fix s free setforce 0 1 0"},
        "'fix s free setforce 0 1 0': no key of a scene",
    ),
    "a held sphere": (
        "square sheet",
        {"more": "unfix move\ngroup most id 1:9 11:20\nfix move most nve"},
        "is held: a scene",
    ),
    "two ways to move": (
        "sheet with friction",
        {"more": "unfix move\ngroup a id 7:20\ngroup b id 21:30\nfix m1 a nve\nfix m2 b nve/sphere"},
        "'fix m1 a nve': no key of a scene",
    ),
    "spheres that pass each other": (
        "square sheet",
        {"more": "neigh_modify exclude type 1 1"},
        "'neigh_modify exclude",
    ),
    "a motion of twice the speed": (
        "square sheet",
        {"more": "fix two all nve"},
        "moves sphere 1, which 'fix move free nve' moves too",
    ),
    "a later strike": ("square sheet", {"more": "run 5\nvelocity all set 1 0 0"}, "is not executed here"),
    "rest before": ("square sheet", {"more": "minimize 0 1e-9 5 5"}, "a minimization precedes the recorded run"),
    "nothing that moves": ("square sheet", {"more": "velocity all set 0 0 0"}, "nothing moves at the beginning"),
    "two materials": ("square sheet", {"law": "A"}, "contacts of types 1 1 and . 2 have different laws"),
    "springs": ("square sheet", {"law": "hooke 1e5 0.0 tangential linear_history 1e5 0.0 0.5"}, "says hooke"),
    "rolling": (
        "sheet with friction",
        {"law": "rolling sds 1.0 0.0 0.5"},
        "rolling .*': no key of a scene says rolling sds",
    ),
    "a tilted box": (
        "pressed sheet",
        {"more": "change_box all triclinic xy final 1e-4"},
        "the box is tilted; the box of a scene is not",
    ),
    "a mode of damping": ("square sheet", {"law": "damping tsuji"}, "damping tsuji: a scene has"),
}


@pytest.mark.parametrize("name", members(NEARLY, *REFUSED_MORE))
def test_a_crystal_that_is_nearly_one_of_ours_is_refused(name: str, tmp_path: Path) -> None:
    scene, how, message = NEARLY[name]
    crystal = made(scene)
    how = dict(how)
    if "move" in how:
        how["move"] = how["move"](prepare(crystal).rest.atoms.positions * crystal.sphere.radius)
    own = how.pop("law", None)
    deck = stripped(crystal, tmp_path, **how)
    if own:
        _with_law(deck, law(crystal, "si"), own)
    with pytest.raises(GranularError, match=message):
        print(described(deck).scene)


# Words of a wall with shear and damping, those of another wall, and what is said of it
OTHER_WALLS = {
    "shear law": ("mindlin/force NULL", "mindlin NULL", "a wall has tangential mindlin, and mindlin/force in a scene"),
    "shear stiffness": ("force NULL", "force 1e11", "a wall has shear_stiffness 100000000000.0, and 3619"),
    "shear damping": ("NULL 0.5", "NULL 0.25", "a wall has shear_damping 0.25, and 0.5"),
    "damping": (" 20.0 ", " 10.0 ", "a wall has viscosity 10.0, and 20.0"),
    "rolling": ("damping velocity", "rolling sds 1.0 0.0 0.5 damping velocity", "'fix .* rolling .*': no key of a"),
    "limit": ("damping velocity", "damping velocity limit_damping", "'fix .* limit_damping .*': no key of a scene"),
}


@pytest.mark.parametrize("name", OTHER_WALLS)
def test_a_wall_of_another_law_is_refused(name: str, tmp_path: Path) -> None:
    usual, own, message = OTHER_WALLS[name]
    deck = stripped(made("damped walls"), tmp_path)
    lines = deck.read_text().splitlines(keepends=True)
    deck.write_text("".join(line.replace(usual, own) if "wall/gran" in line else line for line in lines))
    with pytest.raises(SceneError, match=message):
        described(deck)


def _with_law(deck: Path, usual: str, own: str) -> None:
    """Give a deck another law: words in place of the last ones, a whole law, or two materials."""
    text = deck.read_text()
    if own == "A":
        data = deck.with_name("data.plain")
        data.write_text(data.read_text().replace("1 atom types", "2 atom types").replace("\n3 1 ", "\n3 2 "))
        soft = usual.replace("200000000000.0", "70000000000.0")
        lines = f"pair_coeff 1 1 {usual}\npair_coeff 1 2 {soft}\npair_coeff 2 2 {soft}"
        text = text.replace(f"pair_coeff * * {usual}", lines)
    elif own.startswith("hooke"):
        text = text.replace(usual, own)
    elif own.startswith("rolling"):
        text = text.replace(" damping velocity", f" {own} damping velocity")
    else:
        text = text.replace("hertz/material 200000000000.0 0.0", "hertz/material 200000000000.0 0.5")
        text = text.replace("damping velocity", own)
    deck.write_text(text)


# A hexagonal plate of glass as people make one: LAMMPS's lattice, regions, one side held, a sphere struck along it
PLATE = """
units si
dimension 2
boundary p f p
atom_style sphere
comm_modify vel yes
lattice hex 0.02
region box block 0 6 0 4 -0.5 0.5
create_box 1 box
region plate block -0.1 5.9 -0.1 3.4 -0.5 0.5
create_atoms 1 region plate
set group all diameter 0.02 density 2500
pair_style granular
pair_coeff * * hertz/material 7e10 0.0 0.22 tangential mindlin/force NULL 1.0 0.4 damping velocity
region low block INF INF -1 0.1 INF INF
group low region low
region strike block 1.9 2.1 2.9 3.1 INF INF
group strike region strike
velocity strike set -1.0 0.0 0.0 units box
group free subtract all low
fix 1 free nve/sphere
fix 2 all enforce2d
timestep 2e-6
neighbor 0.004 bin
dump 1 all custom 20 dump.plate id type x y z vx vy vz
dump_modify 1 format float %.17g sort id
run 200
"""


def test_a_run_of_the_scene_is_that_of_the_foreign_deck(tmp_path: Path) -> None:
    (tmp_path / "in.plate").write_text(PLATE)
    run_deck(tmp_path, "in.plate")
    assert main(["adopt", str(tmp_path / "in.plate"), "-o", str(tmp_path / "plate")]) == 0
    foreign, scene = Unnamed.load(tmp_path / "plate"), Scene.load(tmp_path / "plate.toml")
    assert (scene.packing.lattice, scene.packing.rows, scene.packing.columns) == ("hexagonal", 7, 6)
    assert (scene.effects.friction, scene.striker[0].spheres, scene.striker[0].direction) == (0.4, ((6, 2),), "-x")
    record = run(scene, tmp_path / "again", kernel=False)
    there = np.sort(np.linalg.norm(foreign.stack("velocity"), axis=2), axis=1)
    here = np.sort(np.linalg.norm(record.velocity, axis=2), axis=1) * record.scale.velocity
    # The contacts of places that differ by a rounding, 1e-17 m, of overlaps of 1e-5 m, over a dozen collisions
    np.testing.assert_allclose(here, there, atol=1e-9)
    assert there[-1, -1] < 0.5 * there[0, -1]  # the sphere that was struck has hit others


def test_adopt_writes_the_scene_beside_the_run_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    deck = stripped(made("chain of unequal spheres"), tmp_path, turn=Y_TO_X)
    run_deck(tmp_path, "in.plain")
    asked = ["adopt", str(deck), "-o", str(tmp_path / "beads")]
    assert main(asked) == 0
    said = capsys.readouterr().out
    assert "axes x, y, z of the scene are -y, x, z of the deck" in said
    assert "beads.toml: a chain of 7 spheres" in said
    found = Scene.load(tmp_path / "beads.toml")
    assert found.name == "beads"
    step = prepare(made("chain of unequal spheres")).scene.time.step
    assert found.time.timestep == pytest.approx(step, rel=1e-12)
    assert found.time.sample == pytest.approx(5 * step, rel=1e-12)
    assert found.time.duration == pytest.approx(20 * step, rel=1e-12)
    later = tmp_path / "in.later"
    later.write_text(f"{deck.read_text()}undump all\ntimestep 1.0\nrun 50\n")
    assert main(["adopt", str(later), "-o", str(tmp_path / "later")]) == 0
    assert Scene.load(tmp_path / "later.toml").time.duration == found.time.duration
    assert main(["adopt", str(deck), "-o", str(tmp_path / "other"), "--radius", "0.004"]) == 0
    assert "no scene is sought" in capsys.readouterr().err
    assert not (tmp_path / "other.toml").exists()
    assert main(["adopt", str(deck), "-o", f"{tmp_path / 'run.1'}/"]) == 0
    assert Scene.load(tmp_path / "run.1.toml").name == "run_1"
    capsys.readouterr()
    deck.write_text(deck.read_text().replace("run 20", "fix drag all viscous 1e-3\nrun 20"))
    assert main(["adopt", str(deck), "-o", str(tmp_path / "beads"), "--force"]) == 0
    assert f"says what it does; {tmp_path / 'beads.toml'} belongs to an earlier deck" in capsys.readouterr().err
    (tmp_path / "third.toml").write_text("mine")
    assert main(["adopt", str(deck), "-o", str(tmp_path / "third")]) == 0
    assert "third.toml: exists already" in capsys.readouterr().err
    assert (tmp_path / "third.toml").read_text() == "mine"


def test_a_scene_has_the_nearest_of_uneven_records(adhesive: tuple[Reading, Described]) -> None:
    reading, plain = adhesive
    unit, known = plain.scene.scale.time, known_of(reading, Known())[0]
    found = scene_of(reading, known, "plain", np.array([0.0, 2.0, 3.0, 6.0]) * unit)
    assert (found.scene.time.sample, found.scene.time.duration) == (pytest.approx(1.0), pytest.approx(6.0))
    assert [each[:26] for each in found.unsaid] == ["snapshots at uneven times:"]


def test_the_deck_of_the_page_is_a_chain_under_load() -> None:
    found = described(DECK)
    packing = found.scene.packing
    assert (packing.lattice, packing.rows, packing.first, packing.last) == ("chain", 100, "held", "held")
    # Hertz: two spheres of 9.5 mm whose centres are 2 µm nearer
    assert packing.contact_force == pytest.approx(4 / 3 * 2e11 / 1.82 * 0.002375**0.5 * 2e-6**1.5, rel=1e-6)
