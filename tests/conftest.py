"""Scenes and LAMMPS runs that several tests share."""

# ruff: noqa: E402 (the environment is set before NumPy is imported)

import gc
import os
import shutil
import signal
import sys
from collections.abc import Callable, Generator, Iterable
from itertools import chain, count, product
from pathlib import Path
from typing import Any

import pytest

# Before numpy is imported, here and in every process that a test starts: tests run side by side, on a core each
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Ranks that wait sleep in place of polling: tests share the cores, and a rank that polls keeps the other from its work
os.environ.setdefault("MPIR_CVAR_CH4_PROGRESS_THROTTLE", "1")
os.environ.setdefault("MPIR_CVAR_CH4_PROGRESS_THROTTLE_NO_PROGRESS_COUNT", "100")
# JAX compiles for tests in a third of the time; they run for milliseconds
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
# Figures have the style of the commands
os.environ["MATPLOTLIBRC"] = str(Path(__file__).parents[1] / "granular_lmp/plot/matplotlibrc")
# Tests and the package are compiled once, whatever the environment says: not by each process that a test starts
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# A cache of the tests' own, in which runs find no kernel: they take LAMMPS's contacts unless a test asks for `kernel`
CACHE = Path(__file__).parents[1] / ".pytest_cache"
os.environ["XDG_CACHE_HOME"] = str(CACHE / "without_kernel")
# What JAX compiles is kept for later runs of the tests and for their other processes: two thirds of its tests' time
os.environ["JAX_COMPILATION_CACHE_DIR"] = str(CACHE / "jax")
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # in the background of a script; programs under test inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

from granular_lmp import Record, Scene, run
from granular_lmp.errors import LammpsMissingError, RunInterrupted
from granular_lmp.lammps.installation import has_package
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.outputs import LOG
from granular_lmp.runs import routes
from granular_lmp.runs.folder import locked
from granular_lmp.runs.options import Options
from granular_lmp.studies import forecast
from tests.pause import paused

pytest_plugins = ["tests.durations", "tests.manual.recorder"]

PAPER = Scene.load("tr_nonresonant")
NUMBERS = count()


@pytest.fixture(scope="module")
def folder_of_file(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a test file, in which each test has its own."""
    return tmp_path_factory.mktemp(request.path.stem)


@pytest.fixture
def tmp_path(request: pytest.FixtureRequest, folder_of_file: Path) -> Path:
    """New folder for each test; pytest's own fixture searches the folders of all earlier tests, for up to 2 ms."""
    folder = folder_of_file / f"{request.function.__name__[:30]}{next(NUMBERS)}"
    folder.mkdir()
    return folder


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect without a search for garbage, and search later among what tests leave: modules and items stay anyway."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def run_input(folder: Path, input_name: str, lock: int) -> None:
    """Run an input in its locked folder in this process; LAMMPS writes ``log.lammps`` there."""
    routes.route_of(Options())(routes.Job(folder, input_name, LOG, lock, lambda step: None))


def run_text(text: str, folder: Path) -> None:
    """Run the text of a deck in this process, in a folder that may be there."""
    folder.mkdir(exist_ok=True)
    (folder / "in.text").write_text(text, encoding="utf-8")
    with locked(folder) as lock:
        run_input(folder, "in.text", lock)


@pytest.fixture(scope="session")
def paper_run(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Record]:
    """Runs of the paper's set-up with values changed, each made once: ``paper_run({"wave.wavenumber": 1.475})``.

    A strip has the rows that the centre hears, which tests/effects/test_effects.py finds to be the same as 201.
    """
    done: dict[str, Record] = {}

    def make(changes: dict[str, Any] | None = None) -> Record:
        scene = PAPER.with_values({"packing.rows": "auto"} | (changes or {}))
        key = scene.to_toml()
        if key not in done:
            done[key] = run(scene, tmp_path_factory.mktemp("paper") / "run")
        return done[key]

    return make


def kernel_lacks() -> str:
    """Return what this machine lacks to build the kernel."""
    try:
        library.headers()
    except LammpsMissingError as missing:
        return str(missing)
    if sys.platform != "linux":
        return "the kernel is tested on Linux only"
    if not has_package("PLUGIN"):
        return "LAMMPS without the package PLUGIN"
    return "" if shutil.which("c++") else "no C++ compiler"


def members(every: Iterable[Any], *more: Any) -> list[Any]:
    """Return the values of a parameter; values of `more` are for `make stability`, as similar values fail with them.

    A tuple holds values of several parameters.
    """
    return [
        pytest.param(*(each if isinstance(each, tuple) else [each]), marks=pytest.mark.more) if each in more else each
        for each in every
    ]


def latin(*lists: Iterable[Any]) -> list[Any]:
    """Return all combinations of the values of several lists, all marked `more` except a Latin square.

    In the square each combination of all lists except the shortest meets one value of the shortest, so any two values
    of three lists meet.
    """
    numbered = [list(enumerate(each)) for each in lists]
    found = []
    for combination in product(*numbered):
        values = [each if isinstance(each, tuple) else (each,) for _, each in combination]
        left = sum(number for number, _ in combination) % min(map(len, numbered))
        found.append(pytest.param(*chain.from_iterable(values), marks=[pytest.mark.more] if left else []))
    return found


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> Path:
    """The kernel of this source, which runs of the test take; it stays in its cache for later tests.

    A test that asks for it is left out where it cannot be built.
    """
    if lack := kernel_lacks():
        pytest.skip(lack)
    monkeypatch.setenv("XDG_CACHE_HOME", str(CACHE / "with_kernel"))
    if not library.is_built():
        monkeypatch.delenv("CXX", raising=False)
        library.build()
    return library.built()


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made and their files are empty, for tests of what a command prints or writes beside its figure.

    To render one takes a fifth of a second. Tests that name the figure render it.
    """
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda self, path, **options: Path(path).touch())


@pytest.fixture
def drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn without their constrained layout, which draws each three times more to measure it.

    Titles stay where they are, which spares the search for what they could cover. For tests that a figure is drawn.
    Those of what is clipped, and one of each way to a file, keep the layout.
    """
    monkeypatch.setattr("matplotlib.figure.Figure.get_layout_engine", lambda self: None)
    from matplotlib import rcParams  # kept out of processes that draw nothing

    monkeypatch.setitem(rcParams, "axes.titley", 1.0)


@pytest.fixture
def fast_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets a run look at its progress each millisecond, so that a short one can be stopped on its way."""
    monkeypatch.setattr(routes, "_POLL", 1e-3)


@pytest.fixture
def stop() -> Callable[..., None]:
    """Stops the run of a scene in a folder after a third of its steps: ``stop(scene, folder, ranks=2)``."""

    def stopped(scene: Scene, folder: Path, **options: Any) -> None:
        with paused(folder), pytest.raises(RunInterrupted):
            run(scene, folder, **options)

    return stopped


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> list[Scene]:
    """Scenes whose speed was asked for, each said to make 1e6 sphere-steps a second and to start in 0.5 s."""
    scenes: list[Scene] = []

    def speed(scene: Scene, kernel: bool = False) -> tuple[float, float]:
        if not kernel:
            scenes.append(scene)
        return 1e6, 0.5

    monkeypatch.setattr(forecast, "speed", speed)
    return scenes


@pytest.fixture
def small() -> Scene:
    """A scene that runs in milliseconds: 8 rows, periodic, 40 steps."""
    return PAPER.with_values(
        {
            "name": "small",
            "packing.rows": 8,
            "packing.ends": "periodic",
            "wave.wavenumber": 0.7853981633974483,
            "time.duration": 2.0,
        }
    )


@pytest.fixture
def small_toml(small: Scene, tmp_path: Path) -> Path:
    """The small scene as a TOML file."""
    path = tmp_path / "small.toml"
    path.write_text(small.to_toml(), encoding="utf-8")
    return path
