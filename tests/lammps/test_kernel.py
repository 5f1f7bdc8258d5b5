"""The kernel beside LAMMPS's own pair style: the same numbers, or an error that names what it does not know."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import Scene, build, run
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.cli import main
from granular_lmp.errors import LammpsMissingError, LaunchError, RunFolderError, RunInterrupted
from granular_lmp.lammps.installation import lammps_module
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.outputs import CHECKPOINTS, MONITOR_CONTACTS
from granular_lmp.runs.record import Record, read_status
from tests.conftest import kernel_lacks
from tests.house.test_docs import ROOT

# In D0 = 0.2 Δ0. A position of 1e5 nm has digits to 1.5e-11 nm, 3e-10 D0, and the sums of two loops differ by some of
# them at a step: 1e-9 after 1000 steps, measured. The smallest part of the law, δ/2R of the lever arm, makes 5e-5
ROUNDING = 1e-8


pytestmark = pytest.mark.skipif(bool(kernel_lacks()), reason=kernel_lacks())


@pytest.fixture(scope="module", autouse=True)
def built(kernel: Path) -> Path:
    """The kernel, built for the tests of this file."""
    return kernel


def short(name: str, **values: object) -> Scene:
    return Scene.load(name).with_values({"time.duration": 20.0} | values)


def largest_difference(one: Record, other: Record) -> float:
    """Return the largest difference of displacements and angles in units of D0."""
    return max(float(np.abs(a - b).max()) for a, b in ((one.p, other.p), (one.q, other.q), (one.phi, other.phi)))


def both(scene: Scene, folder: Path) -> tuple[Record, Record]:
    return run(scene, folder / "plain"), run(scene, folder / "kernel", kernel=True)


SCENES = {
    "contacts that open": short("l_opening"),
    "contacts that slide": short("tr_sliding"),
    "contacts that open and slide": short(
        "tr_sliding", **{"wave.amplitude": 5.0, "effects.contact_opening": True, "effects.friction": 0.3}
    ),
    "Hertz": short("steel_compressed"),
    "two materials": short("tr_impurity"),
    "unequal radii and vacancies": short(
        "tr_periodic",
        **{
            "packing.rows": 16,
            "packing.columns": 12,
            "disorder.radius": 5e-5,
            "disorder.vacancies": 0.02,
            "effects.contact_opening": True,
        },
    ),
    "held rows": short("rt_wave"),
}


@pytest.mark.parametrize("name", SCENES)
def test_numbers_are_those_of_lammps(name: str, tmp_path: Path) -> None:
    plain, kernel = both(SCENES[name], tmp_path)
    assert largest_difference(plain, kernel) < ROUNDING
    assert max(float(np.abs(signal).max()) for signal in (plain.p, plain.q, plain.phi)) > 0.05
    assert kernel.info["smallest_overlap"] == pytest.approx(plain.info["smallest_overlap"], abs=ROUNDING)
    assert (tmp_path / "plain" / f"in.{plain.scene.name}").read_bytes() == (
        tmp_path / "kernel" / f"in.{plain.scene.name}"
    ).read_bytes()


def test_another_friction_is_noticed(tmp_path: Path) -> None:
    scene = SCENES["contacts that slide"]
    plain = run(scene, tmp_path / "plain")
    other = run(scene.with_values({"effects.friction": 0.0401}), tmp_path / "other", kernel=True)
    assert largest_difference(plain, other) > 100 * ROUNDING


def test_a_renewed_neighbour_list_keeps_the_slips(tmp_path: Path) -> None:
    deck = build(SCENES["contacts that slide"]).edited(after={"motion": "neigh_modify every 7 delay 0 check no"})
    plain, kernel = run(deck, tmp_path / "plain"), run(deck, tmp_path / "kernel", kernel=True)
    log = (tmp_path / "kernel" / "log.lammps").read_text()
    assert "Neighbor list builds = 57" in log  # 400 steps
    assert largest_difference(plain, kernel) < ROUNDING


def test_guards_and_monitors_read_the_contacts_of_the_kernel(tmp_path: Path) -> None:
    plain, kernel = both(short("quiet_ends"), tmp_path)
    for name, guard in plain.info["guards"].items():
        # The largest of many differences of positions, whose rounding is compared with that of two loops
        assert kernel.info["guards"][name]["value"] == pytest.approx(guard["value"], rel=1e-6, abs=ROUNDING)
    assert plain.info["guards"]["largest_slip"]["value"] > 1e-3

    forces = [
        np.array([line.split() for line in path.read_text().splitlines() if len(line.split()) == 7], dtype=float)
        for path in (tmp_path / each / MONITOR_CONTACTS.format("through") for each in ("plain", "kernel"))
    ]
    assert (np.abs(forces[0] - forces[1]) <= 1e-6 * np.abs(forces[0]).max(axis=0)).all()


def test_a_run_to_a_tolerance_takes_the_kernel_at_every_step(tmp_path: Path) -> None:
    scene = short("tr_periodic", **{"time.tolerance": 0.01, "packing.rows": 16})
    record = run(scene, tmp_path / "run", kernel=True)
    assert record.info["kernel"] == library.description()
    runs = list((tmp_path / "run").glob("*_per_sample"))
    assert len(runs) >= 2
    assert all(read_status(each)["kernel"] == library.description() for each in runs)


def test_an_interrupted_tolerance_continues_with_the_kernel(tmp_path: Path) -> None:
    scene = short("tr_periodic", **{"time.tolerance": 0.01, "packing.rows": 16})

    def stop(step: int, steps: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(RunInterrupted):
        run(scene, tmp_path / "run", kernel=True, progress=stop)
    assert resume(tmp_path / "run").info["kernel"] == library.description()
    assert all("kernel" in read_status(each) for each in (tmp_path / "run").glob("*_per_sample"))


def test_a_run_after_one_with_the_kernel_is_without_it(tmp_path: Path) -> None:
    _, kernel = both(SCENES["contacts that open"], tmp_path)
    plain = run(SCENES["contacts that open"], tmp_path / "again")
    assert "kernel" in kernel.info
    assert "kernel" not in plain.info
    assert library.STYLE in (tmp_path / "kernel" / "log.lammps").read_text()
    assert library.STYLE not in (tmp_path / "again" / "log.lammps").read_text()


@pytest.mark.parametrize(
    ("name", "values", "named"),
    [
        ("tr_damped", {}, "20000.0"),
        ("l_chain", {}, "linear_nohistory"),
        ("tr_periodic", {"effects.shear_law": "incremental"}, "mindlin/force"),
        ("tr_periodic", {"effects.rolling_stiffness": 1.0, "effects.rolling_friction": 0.1}, "rolling"),
        ("steel_compressed", {"effects.restitution": 0.9}, "coeff_restitution"),
    ],
)
def test_other_contacts_are_refused_before_a_file_is_written(
    name: str, values: dict[str, object], named: str, tmp_path: Path
) -> None:
    with pytest.raises(LaunchError, match=named):
        run(short(name, **values), tmp_path / "run", kernel=True)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("dmt 1 0.1 0.2 3 tangential mindlin NULL 0 0.5 damping velocity", "0.1"),
        ("jkr 1 0 0.2 3 tangential mindlin NULL 0 0.5 damping velocity", "jkr"),
        ("dmt 1 0 0.2 3 tangential mindlin_rescale NULL 0 0.5 damping velocity", "mindlin_rescale"),
        ("dmt 1 0 0.2 3 tangential mindlin NULL 0 0.5 damping velocity cutoff 3", "cutoff"),
        ("dmt 1 0 0.2 3 tangential mindlin NULL 0 0.5", "damping"),
        ("dmt", "NULL or empty"),
        ("", "must be dmt or hertz/material"),
    ],
)
def test_the_kernel_itself_refuses_other_laws(words: str, named: str, built: Path) -> None:
    lammps = lammps_module().lammps(cmdargs=["-log", "none", "-screen", "none"])
    try:
        library.load(lammps, built)
        lammps.commands_list(["dimension 2", "atom_style sphere", "region all block 0 1 0 1 -0.5 0.5"])
        lammps.commands_list(["create_box 1 all", "pair_style granular"])
        with pytest.raises(Exception, match=f"(kernel: |Expected floating point).*{named}"):
            lammps.command(f"pair_coeff * * {words}")
    finally:
        lammps.close()


@pytest.mark.parametrize(("options", "typed"), [({"launcher": "lmp"}, "--lmp"), ({"ranks": 2}, "--np 2")])
def test_the_program_and_several_ranks_are_refused_as_they_were_typed(
    options: dict[str, object], typed: str, tmp_path: Path
) -> None:
    with pytest.raises(LaunchError, match="kernel=True") as caught:
        run(short("tr_periodic"), tmp_path / "run", kernel=True, **options)  # type: ignore[arg-type]
    assert caught.value.in_options().endswith(f"leave out one of --kernel and {typed}")


def test_a_stopped_run_has_no_checkpoint_and_is_not_resumed(tmp_path: Path) -> None:
    def stop(step: int, steps: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(RunInterrupted, match="run it again with force=True"):
        run(short("tr_periodic", **{"time.duration": 2000.0}), tmp_path / "run", kernel=True, progress=stop)
    assert not [name for name in CHECKPOINTS if (tmp_path / "run" / name).exists()]
    with pytest.raises(RunFolderError, match="ran with the kernel"):
        resume(tmp_path / "run")


@pytest.mark.parametrize("compiler", ["no-such-compiler", "false"])
def test_a_missing_or_failing_compiler_is_named(compiler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CXX", compiler)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(LammpsMissingError, match=compiler):
        library.build()
    assert not list(tmp_path.rglob("*.so"))


def test_a_kernel_that_was_not_built_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(LammpsMissingError, match="build-kernel"):
        run(short("tr_periodic"), tmp_path / "run", kernel=True)


@pytest.fixture
def copied(built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The kernel in a cache of its own, in a folder that LAMMPS could not name."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / 'für "uns" & andere'))
    place = library.library()
    place.parent.mkdir(mode=0o755, parents=True)
    place.write_bytes(built.read_bytes())
    place.chmod(0o755)
    return place


def test_a_kernel_loads_from_any_folder(copied: Path, tmp_path: Path) -> None:
    assert "kernel" in run(short("tr_periodic"), tmp_path / "run", kernel=True).info
    assert library.STYLE in (tmp_path / "run" / "log.lammps").read_text()
    assert not copied.as_posix().isascii()


def give_away(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a place one of another user: root can, and others become another user."""
    if os.geteuid() == 0:
        os.chown(place, 12345, -1)
    else:
        monkeypatch.setattr(library.os, "geteuid", lambda: 12345)


def linked(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place.symlink_to(place.rename(place.with_name("other.so")))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda place, _: place.write_bytes(place.read_bytes()[:5000]), "kernel.so: is cut off or damaged; build it"),
        (lambda place, _: place.write_bytes(b""), "kernel.so: is cut off or damaged; build it"),
        (lambda place, _: place.write_bytes(place.read_bytes().replace(b"dmt", b"tmd")), "is cut off or damaged"),
        (lambda place, _: place.chmod(0o757), r"kernel.so: may be written by all users: must not \(chmod o-w\)"),
        (lambda place, _: place.parent.chmod(0o777), r"lammps-[^/]*: may be written by all users"),
        (lambda place, _: place.parents[1].chmod(0o777), r"granular-lmp: may be written by all users"),
        (give_away, "kernel.so: belongs to user .*: must be of user .* or of root"),
        (lambda place, patch: give_away(place.parent, patch), "belongs to user .*: must be of user .* or of root"),
        (linked, "kernel.so: must be a file, and no link"),
    ],
)
def test_a_kernel_that_is_damaged_or_of_others_is_not_loaded(
    change: Callable[[Path, pytest.MonkeyPatch], object],
    message: str,
    copied: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    change(copied, monkeypatch)
    with pytest.raises(LammpsMissingError, match=message):
        run(short("tr_periodic"), tmp_path / "run", kernel=True)
    assert not (tmp_path / "run").exists()


def test_a_relative_cache_is_no_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    assert library.library().is_relative_to(tmp_path / ".cache" / "granular-lmp")


def test_a_kernel_that_is_built_is_for_its_user_alone_to_write(
    built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler = tmp_path / "compiler"  # which takes no time
    compiler.write_text(f'#!/bin/sh\nfor place; do :; done\ncp "{built}" "$place"\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("CXX", str(compiler))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    before = os.umask(0)
    try:
        place = library.build()
    finally:
        os.umask(before)
    assert library.built() == place


def test_a_library_that_does_not_load_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "kernel.so").write_bytes(library.sealed(b"no library"))
    # In a process of its own, as LAMMPS keeps a library that was loaded
    code = """
import sys
from pathlib import Path
from granular_lmp.lammps.installation import lammps_module
from granular_lmp.lammps.kernel import library
library.load(lammps_module().lammps(cmdargs=["-log", "none", "-screen", "none"]), Path(sys.argv[1]))
"""
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "kernel.so"], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode != 0
    assert "LammpsMissingError: LAMMPS does not load the kernel" in done.stderr


def test_the_commands_build_it_and_take_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["build-kernel"]) == 0
    assert str(library.built()) in capsys.readouterr().out
    assert main(["run", "tr_square", "--set", "time.duration=5", "--kernel", "-o", str(tmp_path / "run")]) == 0
    assert read_status(tmp_path / "run")["kernel"] == library.description()


@pytest.mark.parametrize(
    ("words", "named"), [(("tr_damped",), "--kernel: does not know the contact"), (("solitary_chain",), "impacts")]
)
def test_the_command_line_names_the_option(
    words: tuple[str, ...], named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", *words, "--kernel", "-o", str(tmp_path / "run")]) == 2
    assert named in capsys.readouterr().err
