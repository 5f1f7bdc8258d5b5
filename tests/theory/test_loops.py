"""The compiled loops beside NumPy: the same forces, the same motion, and none where they cannot be."""

import logging
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Barrier
from typing import get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.paper_rows import ring_neighbours
from cases.solitary.chain import acceleration, compressed
from cases.solitary.chain_loop import chain_slope
from cases.solitary.chain_motion import SIXTH, VERLET, Scheme, march
from cases.solitary.chain_motion import integrate as integrate_chain
from granular_analysis.theory import lattice, loops, network_verlet
from granular_analysis.theory.contact import Contact, Law
from granular_analysis.theory.lattice_loop import MOST, torus_slope
from granular_analysis.theory.neighbours import torus_neighbours
from granular_analysis.theory.network import Law as NetworkLaw
from granular_analysis.theory.network import Material, Network, Wall
from granular_analysis.theory.network_compiled import march as marched
from granular_analysis.theory.network_ledger import work_rate
from granular_analysis.theory.network_loop import contact_loop
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_outside import Drive
from granular_analysis.theory.network_state import State, present, resultants, settled, start
from granular_analysis.theory.wave import Wave
from granular_lmp.compiled import seal, trouble
from tests.conftest import latin
from tests.stepped import stepped

compiled = pytest.mark.skipif(loops.library() is None, reason="no C compiler")
Floats = NDArray[np.float64]
GLASS, STEEL = Material(1.0, 0.2, 2e-3), Material(3.0, 0.3, 1e-3)
RNG = np.random.default_rng(5)
SEEDED = RNG.bit_generator.state
UNOPTIMISED = ("-O0", "-DPLAIN", *loops.FLAGS[1:])


@pytest.fixture(autouse=True)
def numbers_do_not_depend_on_the_tests_before() -> None:
    RNG.bit_generator.state = SEEDED


def packing(**changes: object) -> Network:
    """Return 60 unequal spheres on a wall, which move and turn, with neighbours that touch and some that do not."""
    row, column = np.divmod(np.arange(60), 10)
    places = np.stack([column + row % 2 / 2, row * np.sqrt(3) / 2], axis=1) * 1.97
    numbers = {"radius": 1 + 0.02 * RNG.uniform(-1, 1, 60), "density": RNG.uniform(1, 3, 60)}
    network = Network(
        places, **numbers, materials=(GLASS, STEEL), kind=RNG.integers(0, 2, 60), cell=(19.7, np.inf),
        walls=(Wall((0.0, -0.98), (0.0, -1.0), STEEL),),
    )  # fmt: skip
    return replace(network, **changes)


def touching(dimension: int, torn: bool, **changes: object) -> tuple[Network, State]:
    """Return spheres of two materials, some of which touch each other and a wall; contacts are sheared if torn."""
    flat = packing()
    deep = RNG.uniform(-0.05, 0.05, (60, dimension - 2))
    floor = Wall((0.0, -0.98, 0.0)[:dimension], (0.0, -1.0, 0.0)[:dimension], STEEL)
    cell = (*flat.cell, np.inf)[:dimension]
    network = replace(flat, position=np.hstack([flat.position, deep]), cell=cell, walls=(floor,), **changes)
    spins = RNG.normal(0, 2e-3, (60, 3) if dimension == 3 else 60)
    state = start(network, *RNG.normal(0, 2e-3, (2, 60, dimension)), spins, spins)
    return network, replace(state, shear=state.shear + torn * RNG.normal(0, 1e-4, state.shear.shape))


def moving(network: Network, size: float = 2e-3) -> State:
    """Return random displacements, turns and their rates."""
    ways, turns = RNG.normal(0, size, (2, 60, network.dimension)), RNG.normal(0, size, (2, 60))
    return start(network, ways[0], ways[1], turns[0], turns[1])


LAWS = [
    *({}, {"friction": 1e3}, {"friction": 1e-6}, {"shear": False}),
    *(
        {"adhesion": "jkr", "law": law, "friction": friction}
        for law in get_args(NetworkLaw)
        for friction in (0.1, 10.0)
    ),
    {"law": "incremental", "friction": 1e-3, "viscosity": 1e-2},
    {"materials": (Material(1.0, 0.2), Material(3.0, 0.3)), "friction": 0.3, "restitution": 0.7},
    {"shear": False, "viscosity": 1e-2, "friction": 0.0},
]


@compiled
@pytest.mark.parametrize("changes", LAWS, ids=str)
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("torn", [False, True], ids=["settled", "torn"])
def test_forces_of_any_law_are_those_of_the_network(changes: dict[str, object], dimension: int, torn: bool) -> None:
    network, state = touching(dimension, torn, **changes)
    now, acting = present(network, state), contact_loop(network, state)
    load, rate = np.empty((network.freedoms, 60)), np.empty_like(state.shear)
    assert acting is not None
    work, tidy = acting(state.motion, state.shear, load, rate)
    assert np.allclose(load, resultants(state.pairs, now), rtol=0, atol=1e-13 * np.abs(load).max())
    assert np.allclose(rate, now.memory_rate, rtol=0, atol=1e-13 * np.abs(rate).max())
    assert work == pytest.approx(work_rate(network, state.pairs, now), rel=1e-10)
    after = settled(network, state)
    same = np.array_equal(after.shear, state.shear) and np.array_equal(after.begun, state.begun)
    assert same or not tidy
    assert tidy or not same or "friction" in changes  # a slip at the limit may be rounded beyond it


@compiled
@pytest.mark.parametrize(("changes", "dimension"), latin(LAWS, [2, 3]), ids=str)
def test_steps_of_any_law_are_those_of_numpy_also_where_pairs_are_searched_again(
    changes: dict[str, object], dimension: int
) -> None:
    network, state = touching(dimension, torn=True, **changes)
    swing = Drive(np.array([3, 4]), 0, lambda time: 0.3 * np.sin(time), moves=True, longest=1.0, size=0.3)
    turn = replace(swing, spheres=np.array([20]), component=network.freedoms - 1)
    push = replace(swing, spheres=np.array([10, 11]), component=1, moves=False, share=np.array([0.01, -0.02]))
    network = replace(network, drives=(swing, push, turn), drag=np.linspace(0, 0.1, 60))
    one, other = (np.array([*way(network, state, 0.02, 130, 40)]) for way in (network_verlet.march, marched))
    assert len(one) == 4  # 130 steps hold three times 40
    assert np.abs(one[-1, :2] - one[0, :2]).max() > network.margin / 4  # so that they were
    np.testing.assert_allclose(other, one, rtol=0, atol=1e-11)
    again = np.array([*marched(network, state, 0.02, 120, 120)])
    assert again[-1].tobytes() == other[-1].tobytes()


@compiled
@pytest.mark.parametrize(
    "changes",
    [{}, {"friction": 0.5}, {"drag": np.linspace(0, 0.3, 60)}, {"held": np.arange(60) < 10}],
    ids=["closed", "friction", "drag", "held"],
)
def test_the_motion_is_that_of_numpy(changes: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    # A packing that rounding does not rule: in others the last digits of rtol change NumPy's own motion by 1e-7
    monkeypatch.setitem(globals(), "RNG", np.random.default_rng(1))
    network = packing(**changes)
    state, times = moving(network, 1e-4), np.linspace(0, 4.0, 5)
    found = integrate(network, state, times, rtol=1e-9)
    monkeypatch.setattr(loops, "library", lambda: None)
    known = integrate(network, state, times, rtol=1e-9)
    assert np.allclose(found.motion, known.motion, rtol=0, atol=1e-8 * np.abs(known.motion).max())
    assert np.allclose(found.heat, known.heat, rtol=0, atol=1e-8 * abs(known.initial_energy))
    assert found.steps == pytest.approx(known.steps, abs=max(2, 0.02 * known.steps))


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Loops that are looked for and built in another cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(loops, "library", loops.library.__wrapped__)
    return tmp_path


def test_without_a_compiler_all_is_numpy(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with caplog.at_level(logging.INFO):
        assert loops.library() is None
    assert "no C compiler" in caplog.text


@pytest.fixture(scope="module")
def unoptimised(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[bool]]:
    """A cache of loops without vectors, and whether both threads that asked have them.

    They compile in a hundredth of the time. The two ask at once.
    """
    place, gate = tmp_path_factory.mktemp("unoptimised"), Barrier(2)

    def found(_: int) -> bool:
        gate.wait()
        return loops.library.__wrapped__() is not None

    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(2) as pool:
        patch.setenv("XDG_CACHE_HOME", str(place))
        patch.setattr(loops, "FLAGS", UNOPTIMISED)
        return place, [*pool.map(found, range(2))]


@pytest.fixture
def another(
    unoptimised: tuple[Path, list[bool]], elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[], str]:
    """Ask for loops that were compiled before in another cache: what a process of its own finds, and how it ends."""
    monkeypatch.setattr(loops, "FLAGS", UNOPTIMISED)
    shutil.copytree(unoptimised[0], elsewhere, dirs_exist_ok=True)
    code = (
        "import sys; from granular_analysis.theory import loops\n"
        "loops.FLAGS = tuple(sys.argv[1:]); print(loops.library() is not None)"
    )
    return lambda: subprocess.run([sys.executable, "-c", code, *UNOPTIMISED], capture_output=True, text=True).stdout


def overwritten(place: Path) -> None:
    """Write other bytes into the middle of a library."""
    content = place.read_bytes()
    half = len(content) // 2
    place.write_bytes(content[:1024] + bytes([6]) * half + content[1024 + half :])


@compiled
@pytest.mark.parametrize(
    "change",
    [
        lambda place: place.write_bytes(place.read_bytes()[:5000]),
        overwritten,
        lambda place: place.write_bytes(b""),
        lambda place: place.chmod(0o777),
    ],
    ids=["cut off", "other bytes", "empty", "others may write it"],
)
def test_a_library_that_is_damaged_is_compiled_again(
    change: Callable[[Path], object], another: Callable[[], str], elsewhere: Path
) -> None:
    (built,) = elsewhere.rglob("*.so")
    whole = built.read_bytes()
    change(built)
    assert another() == "True\n"
    assert built.read_bytes() == whole
    assert not trouble(built)


@compiled
@pytest.mark.usefixtures("another")
@pytest.mark.parametrize("up", [0, 1])
def test_a_folder_that_others_may_write_is_not_taken(
    up: int, elsewhere: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (built,) = elsewhere.rglob("*.so")
    built.parents[up].chmod(0o777)
    with caplog.at_level(logging.INFO):
        assert loops.library() is None
    assert f"{built.parents[up]}: is writable by others" in caplog.text


@compiled
@pytest.mark.usefixtures("another")
def test_a_library_without_the_functions_is_not_taken(
    elsewhere: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (built,) = elsewhere.rglob("*.so")
    (tmp_path / "nothing.c").write_text("int nothing;")
    built.unlink()  # not over a file that this process may have loaded
    subprocess.run(["cc", "-shared", "-fPIC", tmp_path / "nothing.c", "-o", built], check=True)
    seal(built)
    with caplog.at_level(logging.INFO):
        assert loops.library() is None
    assert "undefined symbol" in caplog.text


@compiled
def test_threads_that_compile_at_once_all_have_the_loops(unoptimised: tuple[Path, list[bool]]) -> None:
    place, found = unoptimised
    assert found == [True, True]
    (folder,) = (place / "granular-analysis").iterdir()
    assert [each.name for each in folder.iterdir()] == ["loops.so"]  # nothing is left beside it


CONTACTS = [
    {},
    {"law": "incremental"},
    {"law": "potential"},
    {"overlap_ratio": 0.01, "prestress": 0.4},
    {"overlap_ratio": 0.01, "law": "incremental", "viscosity": 0.03},
    {"prestress": 1.0, "restitution": 0.8},
    {"shear": False, "viscosity": 0.1},
    {"rotation": False},
    {"adhesion_law": "jkr"},
    {"adhesion_law": "jkr", "overlap_ratio": 0.01, "law": "incremental", "viscosity": 0.03, "prestress": 0.4},
]


@compiled
@pytest.mark.parametrize("contact", [Contact(0.17, **each) for each in CONTACTS], ids=[str(each) for each in CONTACTS])
@pytest.mark.parametrize("size", [0.1, 2.0, 0.1j], ids=["closed", "opening", "complex"])
def test_the_slope_of_the_lattice_is_that_of_numpy(contact: Contact, size: complex) -> None:
    neighbours = torus_neighbours(0.8, 31, 77.0)
    state = abs(size) * RNG.normal(size=(2, 9 if contact.has_history else 6, 31))
    if isinstance(size, complex):
        state = state + size * RNG.normal(size=state.shape)
    slope = torus_slope(state, contact, neighbours)
    assert slope is not None
    out = slope(state)
    known = lattice.rhs(state, contact, neighbours)
    # By the potential law a contact that barely touches takes 1/(1−x) of the rounding of x
    assert np.allclose(out, known, rtol=0, atol=1e-13 * np.abs(known).max())


@compiled
def test_the_lattice_moves_as_by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    wave, tau = Wave.of_mode("TR", 0.802, 0.2, Contact(0.17, overlap_ratio=0.003)), np.linspace(0, 60, 13)
    found = lattice.torus_trajectory(wave, tau)
    monkeypatch.setattr(loops, "library", lambda: None)
    # A step's error control follows the rounding of its sums, which 60 steps of rtol = 1e-11 do not let grow
    assert np.allclose(found, lattice.torus_trajectory(wave, tau), rtol=0, atol=1e-11)


@compiled
def test_rings_are_left_to_numpy() -> None:
    state, torus = np.zeros((6, 31)), torus_neighbours(0.8, 31)
    assert torus_slope(state, Contact(0.17), torus) is not None
    assert torus_slope(state, Contact(0.17), ring_neighbours()) is None
    points = MOST + 1  # than loops.c has
    assert torus_slope(np.zeros((6, points)), Contact(0.17), torus_neighbours(0.8, points)) is None


@compiled
@pytest.mark.parametrize("restitution", [1.0, 0.8], ids=["lossless", "damped"])
@pytest.mark.parametrize("force", [0.0, 0.1], ids=["touching", "pressed"])
def test_a_chain_moves_as_by_numpy(force: float, restitution: float, monkeypatch: pytest.MonkeyPatch) -> None:
    stiffness = np.append(0.0, RNG.uniform(1, 2, 20))  # free at the left, a wall at the right
    chain = compressed(np.append(RNG.uniform(1, 2, 19), np.inf), stiffness, force)
    chain = replace(chain, restitution=restitution)
    state, slope = RNG.normal(size=(2, 20)), chain_slope(chain, 0.7, 1.3)
    assert slope is not None
    rate = slope(state)
    known = np.stack([state[1], acceleration(chain, 0.7 * state[0], 1.3 * state[1]) * (0.7 / 1.3**2)])
    assert np.allclose(rate, known, rtol=0, atol=1e-14 * np.abs(known).max())
    asked = np.zeros(20), np.eye(20)[0], [2.0]  # later, rounding decides which step meets a collision: up to rtol
    found = integrate_chain(chain, *asked, rtol=1e-11)
    monkeypatch.setattr(loops, "library", lambda: None)
    # Rounding, 3e-15 at most in 120 other chains
    assert np.allclose(found, integrate_chain(chain, *asked, rtol=1e-11), rtol=0, atol=1e-13)


@compiled
@pytest.mark.parametrize(
    ("scheme", "restitution"), [(VERLET, 1.0), (VERLET, 0.8), (SIXTH, 1.0)], ids=["verlet", "damped", "sixth"]
)
def test_chains_march_to_the_bits_of_numpy(scheme: Scheme, restitution: float, monkeypatch: pytest.MonkeyPatch) -> None:
    chain = compressed(np.append(RNG.uniform(1, 2, 19), np.inf), np.append(0.0, RNG.uniform(1, 2, 20)), 0.1)
    chain = replace(chain, restitution=restitution)
    u, v = RNG.normal(size=(2, 3, 2, 20))
    found = march(chain, u, v, 0.02, 40, scheme, every=10)
    turned = march(chain, u + 1e-30j * v, v + 0j, 0.02, 40, scheme, every=10)
    monkeypatch.setattr(loops, "library", lambda: None)
    assert np.array_equal(found, march(chain, u, v, 0.02, 40, scheme, every=10))
    # Roots of complex numbers are not rounded alike, which 280 forces do not let grow
    known = np.array(march(chain, u + 1e-30j * v, v + 0j, 0.02, 40, scheme, every=10))
    assert np.allclose(np.real(turned), known.real, rtol=0, atol=1e-12)
    assert np.allclose(np.imag(turned), known.imag, rtol=0, atol=1e-12 * np.abs(known.imag).max())


@compiled
@pytest.mark.parametrize("law", ["secant", "incremental"])
def test_steps_are_those_of_numpy(law: Law, monkeypatch: pytest.MonkeyPatch) -> None:
    wave = Wave.of_mode("RT", 0.802, 0.1, Contact(0.17, overlap_ratio=0.003, law=law, viscosity=0.01))
    found = stepped([wave], 5, records=20, points=17)
    monkeypatch.setattr(loops, "library", lambda: None)
    assert np.allclose(found, stepped([wave], 5, records=20, points=17), rtol=0, atol=1e-13)
