"""The command ``granular-lmp doctor``: a report on this machine, and a self-test of one second."""

import platform
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from granular_lmp import __version__
from granular_lmp.accuracy.tolerance import run
from granular_lmp.errors import GranularError
from granular_lmp.lammps.installation import REQUIRED_PACKAGES, lammps_module, lmp_command, wheel_mpi
from granular_lmp.problem import prepare
from granular_lmp.runs.launch import core_count
from granular_lmp.runs.routes import check_machine
from granular_lmp.scene.scene import Scene

# A TR wave of the paper's spheres, one wavelength in a periodic cell of 12 rows, for three periods.
SELF_TEST = """
name = "doctor"
[sphere]
radius = 0.5e-6
youngs_modulus = 73e9
poisson_ratio = 0.17
work_of_adhesion = 0.063
density = 2200.0
[packing]
rows = 12
ends = "periodic"
[wave]
mode = "TR"
wavenumber = 0.5235987755982988
amplitude = 0.01
[time]
duration = 100.0
timestep = 0.05
"""
# At D0/Δ0 = 0.01 the amplitude shifts the frequency by 1e-7, and Verlet's step by (Ω Δτ)²/24 = 3.5e-6
TOLERANCE = 1e-5


def report(say: Callable[[str], object]) -> int:
    """Report on this machine line by line, and return 0 if a deck runs here, else the exit status of the failure.

    Parameters
    ----------
    say : callable
        Called with each line of the report.
    """
    say(f"granular-lmp {__version__}, Python {platform.python_version()}, {platform.system()} {platform.machine()}")
    say(f"cores        {core_count()}")
    try:
        check_machine()
        module = lammps_module()
        with TemporaryDirectory() as scratch:
            version, packages, mpi = _lammps_facts(module, Path(scratch))
        say(f"LAMMPS       {version} (module lammps {module.__version__})")
        say(
            f"packages     {', '.join(REQUIRED_PACKAGES)} (needed), and {len(packages) - len(REQUIRED_PACKAGES)} others"
        )
        say(f"MPI          {mpi}; library of the wheel: {wheel_mpi() or 'none, the system MPI is used'}")
        say(f"programs     {lmp_command(1)[0]}; {lmp_command(2)[0]}")
        error = frequency_error()
    except GranularError as failure:
        say(f"FAILED       {failure}")
        return failure.exit_status
    passed = abs(error) <= TOLERANCE
    say(
        f"self-test    {'passed' if passed else 'FAILED'}: frequency of a small TR wave through LAMMPS differs from "
        f"its Bloch mode by {error:.1e} (at most {TOLERANCE:.0e})"
    )
    return 0 if passed else 1


def frequency_error() -> float:
    """Return the relative difference between the frequency of a small TR wave in LAMMPS and that of its Bloch mode.

    With q = Q cos Ωτ and φ = f sin Ωτ the phase of the wave is atan2(φ/f, q/Q); its slope is the frequency.
    """
    scene = Scene.loads(SELF_TEST)
    mode = prepare(scene).mode
    with TemporaryDirectory() as scratch:
        record = run(scene, Path(scratch) / "run")
    phase = np.unwrap(np.arctan2(record.phi / mode.f, record.q / -mode.ux))
    slope = np.polynomial.Polynomial.fit(record.tau, phase, 1).convert().coef[1]
    return float(slope / mode.frequency - 1)


def _lammps_facts(module: object, scratch: Path) -> tuple[str, list[str], str]:
    """Return version, packages and MPI of the library, from a short-lived instance."""
    lmp = module.lammps(cmdargs=["-log", str(scratch / "log"), "-screen", "none"])  # type: ignore[attr-defined]
    try:
        packages = sorted(lmp.installed_packages)
        mpi = "yes" if lmp.has_mpi_support else "no"
        try:
            mpi += f", mpich {metadata.version('mpich')}"
        except metadata.PackageNotFoundError:
            mpi += ", of the system"
        return str(lmp.version()), packages, mpi
    finally:
        lmp.close()
