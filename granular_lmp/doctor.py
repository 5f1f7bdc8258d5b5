"""Command ``granular-lmp doctor``: a report on this machine, and a self-test of one second."""

import platform
from collections.abc import Callable
from dataclasses import field, replace
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from granular_lmp.accuracy.tolerance import run
from granular_lmp.errors import GranularError
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.installation import (
    PACKAGE_IN_SPACE,
    REQUIRED_PACKAGES,
    has_package,
    lammps_module,
    lmp_command,
    wheel_mpi,
)
from granular_lmp.lammps.kernel import library
from granular_lmp.problem import prepare
from granular_lmp.rest.linear import mode_of
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.options import core_count
from granular_lmp.runs.routes import check_machine
from granular_lmp.studies.forecast import speed
from granular_lmp.version import __version__

# TR wave in the spheres of the paper, one wavelength in a periodic cell of 12 rows, for three periods.
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
# At D0/Δ0 = 0.01 the amplitude shifts the frequency by 1e-7, and the Verlet step by (Ω Δτ)²/24 = 3.5e-6
TOLERANCE = 1e-5
# Releases of LAMMPS with which all tests were run
TESTED = ("20250722",)


@dataclass(frozen=True)
class Findings:
    """Findings on this machine; findings after a failure are unknown.

    Attributes
    ----------
    software : dict of str to str
        Versions of this package and Python, and the system.
    cores : int
    lammps : dict
        ``version``, ``module``, number of ``packages``, ``space`` if spheres may move in space, ``mpi``, the
        ``mpi_library`` of the wheel, and the programs for one rank and for several.
    frequency_error : float or None
        Relative error of the self-test.
    kernel : str
        Place of the kernel, or the reason why there is none.
    warnings : list of str
    failure : str
        Reason why no deck can run here; "" if decks can run.
    exit_status : int
        0 if a deck can run here and the self-test passed.
    """

    software: dict[str, str]
    cores: int
    lammps: dict[str, Any] = field(default_factory=dict)
    frequency_error: float | None = None
    kernel: str = ""
    warnings: list[str] = field(default_factory=list)
    failure: str = ""
    exit_status: int = 0


def examine() -> Findings:
    """Examine this machine and run the self-test."""
    system = f"{platform.system()} {platform.machine()}"
    software = {"granular_lmp": __version__, "python": platform.python_version(), "system": system}
    found = Findings(software, core_count())
    try:
        check_machine()
        module = lammps_module()
        with TemporaryDirectory() as scratch:
            lammps = _lammps_facts(module, Path(scratch))
        lammps |= {"mpi_library": str(wheel_mpi() or ""), "programs": [lmp_command(1)[0], lmp_command(2)[0]]}
        warnings = _warnings(lammps["version"], lammps["space"])
        found = replace(found, lammps=lammps, warnings=warnings, kernel=_kernel())
        error = frequency_error()
    except GranularError as failure:
        return replace(found, failure=str(failure), exit_status=failure.exit_status)
    return replace(found, frequency_error=error, exit_status=0 if abs(error) <= TOLERANCE else 1)


def report(say: Callable[[str], object]) -> int:
    """Print the findings; return 0 if a deck can run here, else the exit status of the failure."""
    found = examine()
    software, lammps = found.software, found.lammps
    say(f"granular-lmp {software['granular_lmp']}, Python {software['python']}, {software['system']}")
    say(f"cores        {found.cores}")
    if lammps:
        say(f"LAMMPS       {lammps['version']} (module lammps {lammps['module']})")
        others = lammps["packages"] - len(REQUIRED_PACKAGES) - lammps["space"]
        in_space = f"{PACKAGE_IN_SPACE} (for spheres in space)" if lammps["space"] else f"no {PACKAGE_IN_SPACE}"
        say(f"packages     {', '.join(REQUIRED_PACKAGES)} (needed), {in_space}, and {others} others")
        library = lammps["mpi_library"] or "none, the system MPI is used"
        say(f"MPI          {lammps['mpi']}; library of the wheel: {library}")
        say(f"programs     {'; '.join(lammps['programs'])}")
        say(f"kernel       {found.kernel}")
    for warning in found.warnings:
        say(f"warning      {warning}")
    if found.failure:
        say(f"FAILED       {found.failure}")
    elif found.frequency_error is not None:
        say(
            f"self-test    {'passed' if found.exit_status == 0 else 'FAILED'}: the frequency of a small TR wave in "
            f"LAMMPS differs from its Bloch mode by {found.frequency_error:.1e} (at most {TOLERANCE:.0e})"
        )
    return found.exit_status


def _kernel() -> str:
    """Return the measured time of the kernel over that of the LAMMPS loop, or why there is no kernel."""
    scene = Scene.load("tr_periodic")
    try:
        place = library.built()
        share = min(speed(scene)[0] / speed(scene, kernel=True)[0] for _ in range(2))
    except GranularError as missing:
        return f"none; with it the LAMMPS loop takes about half the time: {missing}"
    return f"{place}: in {scene.name} it just took {share:.2f} of the time of the LAMMPS loop"


def _warnings(version: str, space: bool) -> list[str]:
    """Return warnings for an untested release of LAMMPS, and for one that cannot run spheres in space."""
    untested = (
        f"LAMMPS {version} was not tested, only {', '.join(TESTED)}; run the tests of the package with it before you "
        "use its numbers"
    )
    plane = f"this LAMMPS was built without the package {PACKAGE_IN_SPACE}; only scenes in space need it"
    return [untested] * (version not in TESTED) + [plane] * (not space)


def frequency_error() -> float:
    """Return the relative difference between the frequency of a small TR wave in LAMMPS and its Bloch mode.

    With q = Q cos Ωτ and φ = f sin Ωτ the phase of the wave is atan2(φ/f, q/Q), and its slope is the frequency.
    """
    scene = Scene.loads(SELF_TEST)
    mode = mode_of(prepare(scene).scene)
    with TemporaryDirectory() as scratch:
        record = run(scene, Path(scratch) / "run", kernel=False)
    phase = np.unwrap(np.arctan2(record.phi / mode.f, record.q / -mode.ux))
    slope = np.polynomial.Polynomial.fit(record.tau, phase, 1).convert().coef[1]
    return float(slope / mode.frequency - 1)


def _lammps_facts(module: Any, scratch: Path) -> dict[str, Any]:
    """Return version, packages and MPI of the library, from a short-lived instance."""
    lmp = library.start(module, None, ["-log", str(scratch / "log"), "-screen", "none"])
    try:
        mpi = "yes" if lmp.has_mpi_support else "no"
        try:
            mpi += f", mpich {metadata.version('mpich')}"
        except metadata.PackageNotFoundError:
            mpi += ", of the system"
        packages = len(lmp.installed_packages)
        facts = {"version": str(lmp.version()), "module": module.__version__, "packages": packages, "mpi": mpi}
        return facts | {"space": has_package(PACKAGE_IN_SPACE)}
    finally:
        lmp.close()
