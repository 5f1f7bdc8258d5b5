"""Crystals at rest in the plane and in space: force balance, closed forms of few spheres, and which contacts there are.

Lengths in Δ0 and forces in k1 Δ0 of `SILICA`, where nothing else is said.
"""

import json
from dataclasses import replace
from functools import cache

import ase
import numpy as np
import pytest

from granular_lmp.crystal import balance
from granular_lmp.crystal.balance import RULES
from granular_lmp.crystal.contacts import find_contacts
from granular_lmp.crystal.disorder import AVALANCHES, WAYS, WHOLE, Disorder, Inclusion, imperfect
from granular_lmp.crystal.equilibrium import BALANCED, Equilibrium, relax
from granular_lmp.crystal.factors import dissection
from granular_lmp.crystal.lattices import LATTICES, Shape, packed
from granular_lmp.crystal.let_go import SETTLED, let_go_near
from granular_lmp.crystal.potential import box_load, potential_of
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.tangent import Tangent
from granular_lmp.crystal.walls import Face, Wall
from granular_lmp.errors import CrystalError
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.scene import Scene
from tests.conftest import latin, members
from tests.crystal.test_sphere import SILICA

UNIT = SILICA.static_overlap / SILICA.radius  # Δ0 in radii
FORCE = SILICA.normal_stiffness * SILICA.static_overlap  # k1 Δ0
HERTZ = replace(SILICA, work_of_adhesion=0.0, contact_force=SILICA.pull_off_force)
# Overlaps are a rest of 2 radii that is rounded to 1e-16 of them
ROUNDED = 1e-11


def spread(s: float, seed: int = 1, **other: float) -> Disorder:
    """Return a disorder with the standard deviation s Δ0/2R of the radii."""
    return Disorder(radius=s * SILICA.overlap_ratio, seed=seed, **other)


FLOOR, CEILING = (Face(Wall(SILICA, SILICA), way * np.eye(3)[2], Wall(SILICA, SILICA).overlap) for way in (-1, 1))
FILM = LATTICES["fcc [11-2]"].layered(3)
CRYSTALS = {
    "sheet in the plane": (Shape(12, 10, "periodic"), ()),
    "strip in the plane": (Shape(13, 10, "fixed"), ()),
    "layer": (Shape(12, 10, "periodic"), (FLOOR,)),
    "layer between held rows": (Shape(13, 10, "fixed"), (FLOOR,)),
    "honeycomb": (Shape(12, 10, "periodic", LATTICES["honeycomb"]), (FLOOR,)),
    "chain": (Shape(20, 1, "periodic", LATTICES["chain"]), (FLOOR,)),
    "fcc": (Shape(6, 4, "periodic", LATTICES["fcc [001]"], layers=4), ()),
    "hcp": (Shape(6, 4, "periodic", LATTICES["hcp c"], layers=4), ()),
    "film": (Shape(6, 4, "periodic", FILM, layers=3), (FLOOR,)),
    "film between two plates": (Shape(6, 4, "periodic", FILM, layers=3), (FLOOR, CEILING)),
}
PLANE = {"sheet in the plane": 2, "strip in the plane": 2}  # axes; all others have three
WITHOUT_WALLS = [*PLANE, "fcc"]


@cache
def at_rest(name: str, s: float, sphere: Sphere = SILICA, vacancies: float = 0.0, **how: object) -> Equilibrium:
    """Return a crystal of the list with a disorder, at rest under the load of its lattice."""
    shape, faces = CRYSTALS[name]
    lattice, axes = packed(sphere, shape), PLANE.get(name, 3)
    load = box_load(lattice, sphere, axes=axes) if sphere is HERTZ else None
    crystal = imperfect(lattice, sphere, spread(s, vacancies=vacancies))
    return relax(*crystal, load=load, faces=faces, space=axes == 3, **how)


@cache
def disordered(s: float, seed: int = 1, **how: object) -> Equilibrium:
    return relax(*imperfect(packed(SILICA, Shape(12, 10, "periodic")), SILICA, spread(s, seed)), **how)


def forces(rest: Equilibrium) -> np.ndarray:
    """Return the forces of the contacts on the spheres, (N, 3), in k1 Δ0."""
    contacts = rest.contacts
    push, pairs = contacts.contact_force[:, None] * contacts.normals / FORCE, ~contacts.on_wall
    total = np.zeros((len(rest.lattice), 3))
    np.add.at(total, contacts.j[pairs], push[pairs])
    np.add.at(total, contacts.i, -push)
    return total


def cluster(positions: list[list[float]], radius: list[float]) -> ase.Atoms:
    """Return free spheres in no box; the lowest touch the floor as spheres of the reference radius do."""
    crystal = ase.Atoms(f"X{len(radius)}", positions=positions, cell=[20, 20, 20])
    crystal.set_array("radius", np.array(radius))
    return crystal


# --- at rest ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "sphere"),
    [*((name, SILICA) for name in CRYSTALS), *((name, HERTZ) for name in WITHOUT_WALLS)],
    ids=lambda value: value if isinstance(value, str) else "compressed" if value is HERTZ else "adhesive",
)
def test_a_perfect_crystal_is_returned_as_it_is(name: str, sphere: Sphere) -> None:
    rest, (shape, faces) = at_rest(name, 0.0, sphere), CRYSTALS[name]
    assert not rest.displacement.any()
    assert not rest.strain.any()
    assert (rest.crystal.positions == packed(sphere, shape).positions).all()
    assert rest.steps == 0
    assert np.count_nonzero(~rest.contacts.on_wall) == len(find_contacts(packed(sphere, shape), [sphere]))
    assert np.count_nonzero(rest.contacts.on_wall) == sum(shape.spheres // shape.layers for _ in faces)


@pytest.mark.parametrize(
    ("s", "name", "by"), [*latin([0.12, 0.8, 4.0, 12.0], PLANE, WAYS), *latin([0.12, 2.0], CRYSTALS, WAYS)]
)
def test_no_force_is_left_on_any_free_sphere_nor_on_the_box(s: float, name: str, by: str) -> None:
    rest = at_rest(name, s, by=by)
    free = ~rest.lattice.arrays["fixed"]
    assert rest.residual <= BALANCED
    # The forces of the record are those of the relaxation, rounded once more
    assert np.abs(forces(rest)[free]).max() < BALANCED + ROUNDED
    assert np.abs(rest.box_load[:2]).max() < 2 * BALANCED * len(rest.lattice) * FORCE * 2 * SILICA.radius
    assert len(rest.box_load) == PLANE.get(name, 3)
    assert not rest.displacement[~free, :2].any()
    assert rest.lifted == 0
    assert f"{RULES[by].in_words}; the box changes its size" in rest.protocol


def test_a_summary_says_how_a_crystal_came_to_rest_in_what_json_holds() -> None:
    disorder = spread(0.8, seed=3, vacancies=0.02)
    rest = relax(*imperfect(packed(SILICA, Shape(12, 10, "periodic")), SILICA, disorder))
    summary = json.loads(json.dumps(rest.summary()))
    expected = {"radius": disorder.radius, "density": 0.0, "vacancies": 0.02, "seed": 3, "stiffness": 0.0}
    assert summary["disorder"] == expected
    assert summary["protocol"] == rest.protocol
    assert summary["spheres"] == 118
    assert (summary["isolated"], summary["rattlers"]) == (0, 0)
    assert summary["residual"] == rest.residual
    assert summary["newton_steps"] == rest.steps > 0
    assert summary["contacts_per_sphere"] == 2 * len(rest.contacts) / 118
    # Lengths of some 20 radii, rounded a few times
    np.testing.assert_allclose(summary["box"], np.diag(rest.crystal.cell.array)[:2], rtol=1e-14)
    assert summary["strain"] == rest.strain[:2].tolist()
    assert summary["box_load"] == rest.box_load.tolist()


def test_a_summary_of_a_crystal_that_was_not_drawn_has_no_disorder() -> None:
    summary = relax(packed(SILICA, Shape(6, 4, "periodic")), [SILICA]).summary()
    assert summary["disorder"] is summary["isolated"] is None


def test_a_crystal_before_it_is_let_go_is_not_at_rest() -> None:
    crystal, materials = imperfect(packed(SILICA, Shape(12, 10, "periodic")), SILICA, spread(0.12))
    potential = potential_of(crystal, materials, np.zeros(2), breathes=True)
    assert np.abs(potential.start().force).max() > 0.1


def test_the_positions_at_rest_have_the_contacts_of_the_record() -> None:
    rest = disordered(2.0)
    found = find_contacts(rest.crystal, [SILICA])
    assert (found.i == rest.contacts.i).all()
    assert (found.j == rest.contacts.j).all()
    # Positions up to 20 radii are rounded to 4e-15 radii, 1e-11 of an overlap
    assert np.abs(found.overlap - rest.contacts.overlap).max() < 1e-10 * SILICA.static_overlap


@pytest.mark.parametrize("by", WAYS)
def test_a_box_that_stays_keeps_its_size_and_bears_a_load(by: str) -> None:
    rest = disordered(0.8, by=by, box="fixed")
    assert (rest.crystal.cell.array == rest.lattice.cell.array).all()
    assert rest.residual <= BALANCED
    assert np.abs(rest.box_load).min() > 1e-3 * len(rest.lattice) * FORCE * SILICA.radius


@pytest.mark.parametrize("by", WAYS)
def test_a_jkr_crystal_comes_to_rest(by: str) -> None:
    jkr = replace(SILICA, adhesion_law="jkr")
    lattice = packed(jkr, Shape(12, 10, "periodic"))
    rest = relax(*imperfect(lattice, jkr, Disorder(radius=2 * jkr.overlap_ratio)), by=by)
    assert rest.residual <= BALANCED


@pytest.mark.parametrize(("name", "by"), latin(WITHOUT_WALLS, WAYS))
def test_a_compressed_crystal_bears_the_load_of_its_lattice(name: str, by: str) -> None:
    rest, axes = at_rest(name, 0.4, HERTZ, vacancies=0.02, by=by), PLANE.get(name, 3)
    assert rest.residual <= BALANCED
    # The load is T (1 + e), as the force on the faces is held and the distances breathe
    load = box_load(packed(HERTZ, CRYSTALS[name][0]), HERTZ, axes=axes)
    np.testing.assert_allclose(rest.box_load / (1 + rest.strain[:axes]), load, rtol=1e-8)
    assert np.abs(rest.strain[:axes]).min() > 1e-7


def test_the_energy_never_rises_while_forces_are_balanced_and_ends_below_its_start() -> None:
    seen: list[tuple[str, float]] = []
    crystal, materials = imperfect(packed(SILICA, Shape(12, 10, "periodic")), SILICA, spread(4.0))
    relax(crystal, materials, progress=lambda stage, step, force, energy: seen.append((stage, energy)))
    balance = np.array([energy for stage, energy in seen if stage == "balance"])
    assert len(balance) > 3
    # A sum of 360 energies is rounded to less than 1e-13 of it
    assert np.diff(balance).max() < 1e-13 * np.abs(balance).max()
    assert balance[-1] < seen[0][1]


# --- closed forms ----------------------------------------------------------------------------------------------------


def chain(radius: list[float]) -> ase.Atoms:
    """Return a periodic chain along y with the spheres at the places of a perfect one."""
    count, step = len(radius), 2 - UNIT
    crystal = ase.Atoms(f"X{count}", positions=[[0, k * step, 0] for k in range(count)], cell=[4, count * step, 2])
    crystal.set_array("radius", np.array(radius))
    crystal.pbc = [False, True, False]
    return crystal


def overlap_of(one: float, other: float) -> float:
    """Return (F/A)^(2/3) of two spheres of silica, in Δ0: 2^(1/3) Rc^(1/3) for radii in R."""
    return (2 * one * other / (one + other)) ** (1 / 3)


def test_an_adhesive_chain_is_as_long_as_its_contacts_at_rest() -> None:
    radius = [1.0, 1.0002, 0.9999, 1.0004, 0.9997]
    rest = relax(chain(radius), [SILICA])
    pairs = list(zip(radius, radius[1:] + radius[:1], strict=True))
    length = sum(a + b - UNIT * overlap_of(a, b) for a, b in pairs)
    assert rest.crystal.cell[1, 1] == pytest.approx(length, rel=0, abs=1e-9 * UNIT)
    assert np.abs(rest.contacts.contact_force).max() < 1e-9 * FORCE
    assert not rest.displacement[:, 0].any()


def test_a_triangle_has_the_sides_of_its_contacts_at_rest() -> None:
    radius = [1.0, 1.01, 0.985]
    # Between 0.4 and 2 Δ0 inside each other: let go from much nearer, the spheres would be flung apart
    sides = {"01": 2.01 - 0.4 * UNIT, "02": 1.985 - 2 * UNIT, "12": 1.995 - 0.7 * UNIT}
    x = (sides["01"] ** 2 + sides["02"] ** 2 - sides["12"] ** 2) / (2 * sides["01"])
    places = [[0, 0, 0], [sides["01"], 0, 0], [x, np.sqrt(sides["02"] ** 2 - x**2), 0]]
    rest = relax(cluster(places, radius), [SILICA])
    assert list(zip(rest.contacts.i, rest.contacts.j, strict=True)) == [(0, 1), (0, 2), (1, 2)]
    expected = [overlap_of(radius[i], radius[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
    np.testing.assert_allclose(rest.contacts.overlap / SILICA.static_overlap, expected, rtol=0, atol=1e-9)


def test_two_materials_rest_at_the_overlap_of_the_two() -> None:
    steel = Sphere(radius=0.5e-6, youngs_modulus=210e9, poisson_ratio=0.3, work_of_adhesion=0.4, density=7850.0)
    pair = cluster([[0, 0, 0], [2 - UNIT, 0, 0]], [1.0, 1.0])
    pair.set_array("material", np.array([0, 1]))
    rest = relax(pair, [SILICA, steel])
    compliance = sum((1 - each.poisson_ratio**2) / each.youngs_modulus for each in (SILICA, steel))
    adhesion = np.sqrt(SILICA.work_of_adhesion * steel.work_of_adhesion)
    root = np.sqrt(SILICA.radius / 2)
    # A δ^(3/2) = F with A = (4/3) E* √Rc and F = 2π w Rc
    overlap = (2 * np.pi * adhesion * root * compliance * 3 / 4) ** (2 / 3)
    assert rest.contacts.overlap[0] == pytest.approx(overlap, rel=1e-9)


def test_a_crystal_elsewhere_comes_to_the_same_rest() -> None:
    crystal, materials = imperfect(packed(SILICA, Shape(12, 10, "periodic")), SILICA, spread(0.8))
    moved = crystal.copy()
    moved.positions += [0.25, -0.5, 0.0]
    here, there = relax(crystal, materials), relax(moved, materials)
    # No pair of this crystal is so near to parting that rounding would decide
    assert np.abs(here.displacement - there.displacement).max() < 1e-9 * UNIT
    assert len(here.contacts) == len(there.contacts)


@pytest.mark.parametrize("by", WAYS)
def test_the_same_seed_gives_the_same_rest_to_the_last_bit(by: str) -> None:
    one, other = disordered(2.0, by=by), disordered.__wrapped__(2.0, by=by)
    assert (one.displacement == other.displacement).all()
    assert (one.strain == other.strain).all()


# --- which contacts --------------------------------------------------------------------------------------------------


def test_contacts_part_and_form_on_the_way() -> None:
    crystal, materials = imperfect(packed(SILICA, Shape(12, 10, "periodic")), SILICA, spread(1.2))
    before, rest = find_contacts(crystal, materials), relax(crystal, materials)
    pairs = [set(zip(each.i.tolist(), each.j.tolist(), strict=True)) for each in (before, rest.contacts)]
    assert pairs[0] - pairs[1]
    assert pairs[1] - pairs[0]


def test_a_sphere_that_touches_nobody_is_counted_and_stays() -> None:
    small = Inclusion(spheres=[(5, 4)], radius=0.995 * SILICA.radius)
    rest = relax(*imperfect(packed(SILICA, Shape(12, 10, "periodic")), SILICA, inclusions=[small]))
    assert rest.rattlers == 1
    assert not rest.displacement[5 * 10 + 4].any()
    assert len(rest.contacts) == 3 * 120 - 6


def test_a_crystal_with_vacancies_stays_in_place_without_compression_and_relaxes_under_it() -> None:
    pressed = replace(SILICA, contact_force=0.1 * SILICA.pull_off_force)
    for sphere in (SILICA, pressed):
        lattice = packed(sphere, Shape(12, 10, "periodic"))
        crystal, materials = imperfect(lattice, sphere, Disorder(vacancies=0.03))
        rest = relax(crystal, materials, load=box_load(lattice, sphere))
        assert len(crystal) == 116
        assert rest.residual <= BALANCED
        assert bool(rest.displacement.any()) == (sphere is pressed)


@pytest.mark.parametrize("s", members([0.8, 2.0], 2.0))
def test_the_spread_over_the_overlap_alone_decides_how_many_contacts_there_are(s: float) -> None:
    """Spheres ten times as stiff have an overlap 4.6 times as small: the same s is another spread of radii."""
    stiff = replace(SILICA, youngs_modulus=10 * SILICA.youngs_modulus)
    contacts = []
    for sphere, seeds in ((SILICA, range(1, 9)), (stiff, range(1, 5))):
        lattice = packed(sphere, Shape(12, 10, "periodic"))
        disorders = [Disorder(radius=s * sphere.overlap_ratio, seed=seed) for seed in seeds]
        rests = [relax(*imperfect(lattice, sphere, disorder)) for disorder in disorders]
        contacts.append([rest.contacts_per_sphere for rest in rests])
    # The same deviates: the crystals differ by terms of order Δ0/R, and one contact more is 0.004 of the mean Z
    assert abs(np.mean(contacts[0][:4]) - np.mean(contacts[1])) < 0.02
    # The case "disorder"; 4 standard errors of the mean of 8 crystals of 120 spheres, from those of 1020 there
    expected, deviation = {0.8: (5.759, 0.017), 2.0: (5.01, 0.037)}[s]
    assert abs(np.mean(contacts[0]) - expected) < 4 * deviation * np.sqrt(1020 / 120 / 8)


@pytest.mark.parametrize("name", ["sheet in the plane", "layer", "film between two plates", "fcc"])
def test_stiffness_is_the_derivative_of_the_force(name: str) -> None:
    (shape, faces), axes = CRYSTALS[name], PLANE.get(name, 3)
    crystal, materials = imperfect(packed(SILICA, shape), SILICA, spread(0.3))
    potential = potential_of(crystal, materials, np.zeros(axes), breathes=True, faces=faces)
    random, u = np.random.default_rng(3), potential.start().u
    u, e = u + random.uniform(-0.1, 0.1, u.shape), random.uniform(-1e-5, 1e-5, axes)
    du, de = random.uniform(-1, 1, u.shape), random.uniform(-1, 1, axes) / potential.neighbour
    u[len(crystal) :] = du[len(crystal) :] = 0.0  # a wall does not move
    e, de = e * potential.breathing, de * potential.breathing
    state, h = potential.at(u, e), 1e-4
    tangent = Tangent.of(potential, state)
    more, less = (potential.state(state.pairs, u + sign * h * du, e + sign * h * de) for sign in (1, -1))
    force = -(more.force - less.force) / (2 * h)
    stress = -(more.stress - less.stress) / (2 * h)
    predicted = tangent.by_u @ du.ravel() + tangent.by_both @ de
    # Central differences: the third derivative of a contact is of order 1, h² = 1e-8
    np.testing.assert_allclose(force.ravel(), predicted, rtol=0, atol=1e-6)
    predicted = tangent.by_both.T @ du.ravel() + tangent.by_e @ de
    breathing = potential.breathing
    np.testing.assert_allclose(stress[breathing], predicted[breathing], rtol=0, atol=1e-6 * np.abs(predicted).max())
    assert not stress[~breathing].any()


@pytest.mark.parametrize(
    ("name", "by"),
    [*(("sheet in the plane", by) for by in WAYS), *((name, WHOLE) for name in ("layer", "fcc", "film"))],
)
def test_the_rest_is_stable(name: str, by: str) -> None:
    rest, axes, faces = at_rest(name, 1.2, by=by), PLANE.get(name, 3), CRYSTALS[name][1]
    potential = potential_of(rest.lattice, (SILICA,), np.zeros(axes), breathes=not faces, faces=faces)
    u, e = np.zeros((len(potential.free), axes)), rest.strain[:axes]
    u[: len(rest.lattice)] = rest.displacement[:, :axes] / UNIT
    tangent = Tangent.of(potential, potential.at(u, e))
    scale = potential.neighbour * np.sqrt(len(u))
    by_both, by_e = tangent.by_both / scale, tangent.by_e / scale**2
    whole = np.block([[tangent.by_u.toarray(), by_both], [by_both.T, by_e]])
    values = np.linalg.eigvalsh(tangent.by_u.toarray() if faces else whole)
    # Translations are free; contacts that push turn spheres with a stiffness of Δ0/2R, which lowers others by it
    assert values[0] > -1e-9
    if name in PLANE:
        assert (np.abs(values) < 1e-9).sum() == 2


@pytest.mark.parametrize("seed", members([1, 3, 9], 1, 9))
def test_newton_steps_end_in_crystals_whose_spheres_are_about_to_buckle(seed: int) -> None:
    """At s = 12 hardly a contact is to spare: secants that do not raise λ do not end within 1500 steps here."""
    rest = disordered(12.0, seed=seed)
    assert rest.residual <= BALANCED
    assert rest.steps < 1000


@pytest.mark.parametrize("s", members([0.8, 2.0, 4.0], 0.8, 2.0))
def test_as_many_contacts_are_left_by_avalanches_as_by_newton_steps(s: float) -> None:
    """Over 24 crystals of 1020 spheres the means differ by 0.0007(12) at s = 4 and by 0.0002(5) at s = 8.

    The same seeds, so that only what the ways differ in counts; one contact more is 0.017 of Z. A crystal of 120 then
    differs by 0.009 and the mean of two by 0.0064, a third of the bound.
    """
    contacts = [[disordered(s, seed=seed, by=by).contacts_per_sphere for seed in (1, 2)] for by in WAYS]
    assert abs(np.subtract(*contacts).mean()) < 0.02


def test_held_spheres_stay_where_they_are_while_others_are_let_go() -> None:
    crystal, materials = imperfect(packed(SILICA, Shape(12, 10, "fixed")), SILICA, spread(0.8))
    potential = potential_of(crystal, materials, np.zeros(2), breathes=True)
    state, moving = potential.start(), potential.free & (np.arange(len(crystal)) < 50)
    after = let_go_near(potential, state, moving)
    assert not after.u[~moving].any()
    assert np.abs(after.force[moving]).max() < SETTLED
    assert np.abs(state.force[moving]).max() > 0.1


def test_the_order_of_the_factors_names_every_sphere_once() -> None:
    contacts = find_contacts(packed(SILICA, Shape(20, 16, "periodic")), [SILICA])
    positions = packed(SILICA, Shape(20, 16, "periodic")).positions[:, :2]
    assert sorted(dissection(positions, contacts.i, contacts.j)) == list(range(320))


# --- refused ---------------------------------------------------------------------------------------------------------


def test_crystals_that_cannot_come_to_rest_are_refused_by_name() -> None:
    lattice = packed(SILICA, Shape(6, 4, "periodic"))
    with pytest.raises(CrystalError, match=r"packing.relax = 'free': must be one of box, fixed"):
        relax(lattice, [SILICA], box="free")
    with pytest.raises(CrystalError, match=r"packing.relax_by = 'parts': must be one of whole, avalanches"):
        relax(lattice, [SILICA], by="parts")
    with pytest.raises(CrystalError, match="nothing presses the spheres together"):
        relax(lattice, [replace(SILICA, work_of_adhesion=0.0)])
    with pytest.raises(CrystalError, match="give the load on the box"):
        relax(lattice, [HERTZ])
    with pytest.raises(CrystalError, match="needs periodic faces or held spheres"):
        relax(cluster([[0, 0, 0], [1.9, 0, 0]], [1, 1]), [HERTZ], load=np.ones(2))
    raised = lattice.copy()
    raised.positions[3, 2] = 0.1
    with pytest.raises(CrystalError, match="must be a sheet in a plane"):
        relax(raised, [SILICA])
    for how in ({"space": True}, {"faces": [FLOOR]}):
        with pytest.raises(CrystalError, match=r"friction = 0\.3: must be 0 in space and beside walls"):
            relax(*imperfect(lattice, SILICA, spread(0.01)), friction=0.3, **how)


@pytest.mark.parametrize("by", WAYS)
def test_a_crystal_that_does_not_come_to_rest_says_what_steps_were_taken(
    by: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(balance, "STEPS", 1)
    with pytest.raises(CrystalError, match=f"after 1 {RULES[by].in_words} a force of"):
        disordered(2.0, by=by, seed=9)


def test_a_scene_names_the_way_and_an_older_scene_keeps_its_own() -> None:
    tables = {
        "sphere": {name: getattr(SILICA, name) for name in ("radius", "youngs_modulus", "poisson_ratio", "density")}
        | {"work_of_adhesion": SILICA.work_of_adhesion},
        "packing": {"rows": 12, "columns": 10, "ends": "periodic"},
        "disorder": {"radius": 0.8 * SILICA.overlap_ratio},
        "wave": {"mode": "TR", "wavenumber": 0.785398, "amplitude": 0.01},
        "time": {"duration": 1.0},
    }
    for by, named in ((WHOLE, {}), (AVALANCHES, {"relax_by": AVALANCHES})):
        scene = Scene.from_dict({"name": "way"} | tables | {"packing": tables["packing"] | named})
        rest = crystal_of(scene).equilibrium
        assert scene.packing.relax_by == by
        assert rest is not None
        assert RULES[by].in_words in rest.protocol
