"""The kernel beside LAMMPS's own pair style: the same numbers, or an error that names what it does not know."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.pull_off import jkr
from granular_lmp import Scene, build, compiled, run
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.cli import main
from granular_lmp.crystal.search import overlapping
from granular_lmp.effects.case import Case
from granular_lmp.effects.reading import Reading
from granular_lmp.errors import EffectError, LammpsMissingError, LaunchError, RunFolderError, RunInterrupted, SceneError
from granular_lmp.lammps.deck import resume_text, written_text
from granular_lmp.lammps.guard_results import judged_contacts
from granular_lmp.lammps.installation import lammps_module
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.outputs import CHECKPOINTS, LOG, MONITOR_CONTACTS, read_snapshots
from granular_lmp.problem import prepare
from granular_lmp.runs.options import core_count
from granular_lmp.runs.record import Record, read_status, write_status
from granular_lmp.runs.simulation import mend
from granular_lmp.scene.collision import Collision
from granular_lmp.scene.shipped import shipped
from granular_lmp.studies import collide, cost
from granular_lmp.studies.sweep import sweep
from tests.conftest import kernel_lacks, members, run_input
from tests.hard.guard_study import FAMILIES, blind_rules, random_scene
from tests.house.test_docs import ROOT
from tests.manual import Measure, Mutant, verifies

# Of the largest signal. A position of 1e5 nm has digits to 1.5e-11 nm, 3e-10 D0, and the sums of two loops differ by
# some of them at a step. The smallest part of the law, δ/2R of the lever arm, makes 5e-5
ROUNDING = 1e-8


pytestmark = pytest.mark.skipif(bool(kernel_lacks()), reason=kernel_lacks())


@pytest.fixture(autouse=True)
def built(kernel: Path) -> Path:
    """The kernel, built for the tests of this file."""
    return kernel


def short(name: str, **values: object) -> Scene:
    return Scene.load(name).with_values({"time.duration": 10.0} | values)


def brief(scene: Scene) -> Scene:
    """Return a scene with at most 3e4 sphere-steps, but for four samples."""
    time, particles = scene.time, scene.output.particles
    duration = max(4 * time.sample, 3e4 / scene.shape.spheres * (time.timestep or 0.05))
    snapshots = {"output.particles": 0.0} if scene.wave is not None and particles > duration else {}
    return scene.with_values({"time.duration": min(time.duration, duration)} | snapshots)


def largest_difference(one: Record, other: Record) -> float:
    """Return the largest difference of two records over their largest signal, of at least 1e-3."""
    scale = max(1e-3, *(float(np.abs(signal).max()) for signal in one.signals.values()))
    return max(float(np.abs(one.signals[name] - other.signals[name]).max()) for name in one.signals) / scale


def both(scene: Scene, folder: Path) -> tuple[Record, Record]:
    """Run a scene without the kernel and as runs are by default; a guard that triggers does so in both."""
    return one(scene, folder / "plain", kernel=False), one(scene, folder / "kernel")


def one(scene: Scene, folder: Path, **options: Any) -> Record:
    try:
        return run(scene, folder, **options)
    except EffectError:
        return Record.load(folder, unfinished=True)


CELL = {"packing.rows": 16, "wave.wavenumber": pi / 4}
SCENES = {
    "contacts that open": short("l_opening", **CELL),
    "contacts that slide": short("tr_sliding", **CELL),
    "contacts that open and slide": short(
        "tr_sliding", **CELL, **{"wave.amplitude": 5.0, "effects.contact_opening": True, "effects.friction": 0.3}
    ),
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
    "the incremental law": short("tr_sliding", **CELL, **{"effects.shear_law": "incremental"}),
    "dashpots that slide": short("tr_sliding", **CELL, **{"effects.damping": True, "effects.viscosity": 2e-8}),
    "a restitution": short("steel_compressed", **CELL, **{"effects.restitution": 0.8}),
    "JKR": short("tr_sliding", **CELL, **{"sphere.adhesion_law": "jkr", "wave.amplitude": 0.3}),
    "JKR without shear": short("l_chain", **{"sphere.adhesion_law": "jkr"}),
    "unequal radii in JKR": short(
        "tr_periodic",
        **{"packing.rows": 16, "packing.columns": 6, "disorder.radius": 3e-5, "sphere.adhesion_law": "jkr"},
    ),
    "in space": short("fcc_transverse", **{"effects.sliding": True, "effects.friction": 0.05}),
    "in space, with JKR and dashpots": short(
        "hcp_c_axis", **{"sphere.adhesion_law": "jkr", "effects.damping": True, "effects.viscosity": 2e-8}
    ),
    "a layer on a substrate": short("monolayer_rocking"),
    "an impact with friction and restitution": Scene.load("point_impact").with_values(
        {"effects.friction": 0.3, "effects.restitution": 0.9, "time.duration": 2.0}
    ),
}


SHIPPED = sorted([*shipped("*/scene.toml"), *shipped("impacts/*/scene.toml")])
RANDOM = {f"{family} {seed}": (family, seed) for seed, family in enumerate(FAMILIES)}
# Their contacts are those of scenes above, in crystals that take longer
MORE = ["point_impact", "two_tones", "tr_burst_scattering", "struck_crystal", "refraction", "multilayer"]
MORE += ["struck_sheet", "tr_pulse", "l_beam", "point_source", "monolayer_vertical", "monolayer_rocking", "hcp_c_axis"]
MORE += ["JKR", "contacts that open and slide", "unequal radii and vacancies", "solitary_chain", "dimer_chain"]
MORE += ["tr_impurity", "tr_grating", "tr_oblique", "tr_damped", "corner_source", "tr_nonresonant", "steel_compressed"]
MORE += ["compressed_chain", "breather", "l_wave", "tr_resonant", "tr_antiresonant", "tr_periodic"]
MORE += [name for name in RANDOM if not name.startswith("walled")]


@pytest.mark.parametrize("name", members([*SCENES, *SHIPPED, *RANDOM], *MORE))
def test_numbers_are_those_of_lammps(name: str, tmp_path: Path) -> None:
    scene = (
        SCENES[name] if name in SCENES else brief(Scene.load(name) if name in SHIPPED else random_scene(*RANDOM[name]))
    )
    plain, kernel = both(scene, tmp_path)
    assert largest_difference(plain, kernel) < ROUNDING
    # LAMMPS's guards refuse within a margin too, in which a random scene may fall
    assert kernel.info["status"] == plain.info["status"] or (name in RANDOM and plain.info["status"] == "failed")
    assert library.STYLE in (tmp_path / "kernel" / LOG).read_text()
    name = f"in.{scene.name}"
    assert (tmp_path / "plain" / name).read_bytes() == (tmp_path / "kernel" / name).read_bytes()


def test_contacts_that_slide_at_the_friction_of_a_deck_are_seen_below_that_of_the_spheres(tmp_path: Path) -> None:
    scene = random_scene("damped", 62)
    with blind_rules(), pytest.raises(EffectError):
        run(scene, tmp_path / "run", kernel=True)
    (friction,) = re.findall(
        r"^variable friction index ([0-9.e+-]+)", (tmp_path / "run" / LOG).read_text(), re.MULTILINE
    )
    assert float(friction) < scene.effects.friction
    assert read_status(tmp_path / "run")["guards"]["largest_slip"]["passed_at"] is not None


def test_another_friction_is_noticed(tmp_path: Path) -> None:
    scene = SCENES["contacts that slide"]
    plain = run(scene, tmp_path / "plain")
    other = run(scene.with_values({"effects.friction": 0.0401}), tmp_path / "other", kernel=True)
    assert largest_difference(plain, other) > 100 * ROUNDING


@verifies(
    "Kernel: contacts that slide, with neighbour lists made anew, over the largest signal",
    reference="other code: pair_style granular of LAMMPS",
    tolerance=1e-08,
    reason="positions of 1e5 nm have digits to 3e-10 D0, and sums of two loops differ by some of them a step",
    mutant=Mutant(
        "granular_lmp/lammps/kernel/contact.cpp",
        "const double inner = radius[i] - 0.5 * push.overlap,",
        "const double inner = radius[i] - 0.4 * push.overlap,",
    ),
)
def test_a_renewed_neighbour_list_keeps_the_slips(tmp_path: Path, measured: Measure) -> None:
    deck = build(short("tr_sliding", **{"time.duration": 20.0})).edited(
        after={"motion": "neigh_modify every 7 delay 0 check no"}
    )
    plain, kernel = run(deck, tmp_path / "plain", kernel=False), run(deck, tmp_path / "kernel")
    log = (tmp_path / "kernel" / "log.lammps").read_text()
    assert "Neighbor list builds = 57" in log  # 400 steps
    measured(largest_difference(plain, kernel))


def at_every_step(scene: Scene, folder: Path) -> tuple[float, float, int]:
    """Return the smallest overlap (Δ0), the largest slip, and the most contacts that are not those at rest.

    They are those of single contacts that LAMMPS's own style writes at every step.
    """
    deck = build(scene)
    how, problem = Reading.of(deck.problem), deck.problem
    lines = f"""compute      each all pair/local dist p4 cutoff {how.law.cutoff}
compute      pair all property/local patom1 patom2 cutoff {how.law.cutoff}
dump         each all local 1 each c_pair[1] c_pair[2] c_each[1] c_each[2]
dump_modify  each format line "%.0f %.0f %.17g %.17g"
"""
    with suppress(EffectError):
        run(deck.edited(after={"guards": lines}), folder)
    i, j, _ = overlapping(problem.rest.atoms)
    rest = {(min(pair), max(pair)) for pair in zip(i + 1, j + 1, strict=True)}
    looks = [look for _, look in judged_contacts(folder / "each", problem, Case(scene, problem.on).friction)]
    slip, least = max(look.slip for look in looks), min(look.overlap for look in looks)
    changed = 0
    for _, _, table in read_snapshots(folder / "each"):
        now = set(map(tuple, np.sort(table[:, :2].astype(int), axis=1).tolist()))
        changed = max(changed, len(now ^ rest))
    return least, slip, changed


SEEN = {name: SCENES[name] for name in ("contacts that open", "contacts that slide", "unequal radii and vacancies")}
SEEN["contacts that would slide"] = short("tr_periodic", **{"packing.rows": 16, "effects.friction": 0.0615})


@pytest.mark.parametrize("name", members(SEEN, "unequal radii and vacancies"))
def test_guards_see_every_contact_at_every_step(name: str, tmp_path: Path) -> None:
    scene = SEEN[name].with_values({"time.duration": 3.0})
    found = one(scene, tmp_path / "kernel", kernel=True).info
    guards = found["guards"]
    least, slip, changed = at_every_step(scene, tmp_path / "plain")
    assert found["smallest_overlap"] == pytest.approx(least, abs=ROUNDING)
    assert guards["largest_slip"]["value"] == pytest.approx(min(slip, 1.0), abs=ROUNDING)
    assert guards["open_contacts"]["value"] == changed


@pytest.mark.parametrize(
    ("name", "values", "refused"),
    [
        ("l_opening", {"wave.amplitude": 1.2, "effects.contact_opening": "auto"}, (False, False)),
        ("l_opening", {"wave.amplitude": 1.26, "effects.contact_opening": "auto"}, (True, False)),
        ("l_opening", {"wave.amplitude": 1.265, "effects.contact_opening": "auto"}, (True, True)),
        ("tr_periodic", {"packing.rows": 16, "effects.friction": 0.07}, (False, False)),
        ("tr_periodic", {"packing.rows": 16, "effects.friction": 0.0617}, (True, False)),
    ],
)
def test_what_opens_or_slides_is_refused_exactly_with_the_kernel_and_within_a_margin_without(
    name: str, values: dict[str, object], refused: tuple[bool, bool], tmp_path: Path
) -> None:
    plain, kernel = both(short(name, **{"time.duration": 4.0, "time.timestep": 0.025}, **values), tmp_path)
    assert (plain.info["status"] == "failed", kernel.info["status"] == "failed") == refused


def test_an_edited_deck_may_take_what_the_guards_of_lammps_compute(tmp_path: Path) -> None:
    """The kernel has other guards, and computes the contacts beside those of LAMMPS here."""
    deck = build(brief(short("tr_periodic")))
    mine = deck.edited(before={"run": 'fix mine all print ${look} "$(f_looks[4])" file mine.txt screen no'})
    plain, kernel = (run(mine, tmp_path / str(each), kernel=each) for each in (False, None))
    assert "kernel" in kernel.info
    assert largest_difference(plain, kernel) < ROUNDING
    written = [np.loadtxt(tmp_path / str(each) / "mine.txt") for each in (False, None)]
    np.testing.assert_allclose(*written, atol=1e-6)  # printed to six digits


def test_monitors_read_the_contacts_of_the_kernel(tmp_path: Path) -> None:
    both(short("quiet_ends"), tmp_path)
    forces = [
        np.array([line.split() for line in path.read_text().splitlines() if len(line.split()) == 7], dtype=float)
        for path in (tmp_path / each / MONITOR_CONTACTS.format("through") for each in ("plain", "kernel"))
    ]
    assert (np.abs(forces[0] - forces[1]) <= 1e-6 * np.abs(forces[0]).max(axis=0)).all()


def test_a_run_to_a_tolerance_takes_the_kernel_at_every_step(tmp_path: Path) -> None:
    scene = short("tr_periodic", **{"time.tolerance": 0.01, "packing.rows": 16})
    record = run(scene, tmp_path / "run")
    assert record.info["kernel"] == library.description()
    runs = list((tmp_path / "run").glob("*_per_sample"))
    assert len(runs) >= 2
    assert all(read_status(each)["kernel"] == library.description() for each in runs)


def test_an_interrupted_tolerance_continues_with_the_kernel(tmp_path: Path) -> None:
    scene = short("tr_periodic", **{"time.tolerance": 0.01, "packing.rows": 16})

    def stop(step: int, steps: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(RunInterrupted):
        run(scene, tmp_path / "run", progress=stop)
    assert resume(tmp_path / "run").info["kernel"] == library.description()
    assert all("kernel" in read_status(each) for each in (tmp_path / "run").glob("*_per_sample"))


def test_a_run_after_one_with_the_kernel_is_without_it(tmp_path: Path) -> None:
    _, kernel = both(SCENES["contacts that open"], tmp_path)
    plain = run(SCENES["contacts that open"], tmp_path / "again", kernel=False)
    assert "kernel" in kernel.info
    assert "kernel" not in plain.info
    assert library.STYLE in (tmp_path / "kernel" / "log.lammps").read_text()
    assert library.STYLE not in (tmp_path / "again" / "log.lammps").read_text()


@pytest.mark.parametrize(
    ("name", "values", "named"),
    [
        ("tr_periodic", {"effects.rolling_stiffness": 1.0, "effects.rolling_friction": 0.1}, "rolling"),
        ("tr_periodic", {"effects.twisting": True}, "twisting"),
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
        ("hooke 1 0.1 tangential mindlin NULL 0 0.5 damping velocity", "hooke"),
        ("dmt 1 0 0.2 3 tangential linear_nohistory 1 0.5 damping velocity", "linear_nohistory must have 0 0"),
        ("hertz/material 1 0.5 0.2 tangential mindlin NULL 0 0.5 damping tsuji", "tsuji"),
        ("dmt 1 0 0.2 3 tangential mindlin_rescale NULL 0 0.5 damping velocity", "mindlin_rescale"),
        ("dmt 1 0 0.2 3 tangential mindlin NULL 0 0.5 damping velocity cutoff 3", "cutoff"),
        ("dmt 1 0 0.2 3 tangential mindlin NULL 0 0.5", "damping"),
        ("dmt", "NULL or empty"),
        ("", "must be one of hertz/material, dmt, jkr"),
    ],
)
def test_the_kernel_itself_refuses_other_laws(words: str, named: str, built: Path) -> None:
    lammps = library.start(lammps_module(), built, ["-log", "none", "-screen", "none"])
    try:
        lammps.commands_list(["dimension 2", "atom_style sphere", "region all block 0 1 0 1 -0.5 0.5"])
        lammps.commands_list(["create_box 1 all", "pair_style granular"])
        with pytest.raises(Exception, match=f"(kernel: |Expected floating point).*{named}"):
            lammps.command(f"pair_coeff * * {words}")
    finally:
        lammps.close()


@pytest.mark.parametrize(
    ("name", "options"),
    members(
        product(
            ("contacts that slide", "unequal radii in JKR", "a layer on a substrate"),
            ({"launcher": "lmp"}, {"ranks": 2}),
        ),
        ("unequal radii in JKR", {"launcher": "lmp"}),
        ("unequal radii in JKR", {"ranks": 2}),
        ("a layer on a substrate", {"ranks": 2}),
    ),
)
def test_the_program_takes_it_on_several_ranks(name: str, options: dict[str, Any], tmp_path: Path) -> None:
    if options.get("ranks", 1) > core_count():
        pytest.skip("one core")
    scene = SCENES[name].with_values({"time.duration": 5.0})  # contacts slide from the first step
    plain, kernel = run(scene, tmp_path / "plain", kernel=False), run(scene, tmp_path / "kernel", **options)
    assert largest_difference(plain, kernel) < ROUNDING
    assert library.STYLE in (tmp_path / "kernel" / LOG).read_text()


def test_a_program_that_does_not_load_it_fails_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / library.NAME).write_bytes(compiled.sealed(b"no library"))
    monkeypatch.setattr(library, "built", lambda: tmp_path / library.NAME)
    with pytest.raises(LammpsMissingError, match="does not load the kernel"):
        run(short("tr_periodic"), tmp_path / "run", kernel=True, launcher="lmp")


@pytest.mark.parametrize(
    "name", members(["contacts that open", "contacts that slide", "unequal radii in JKR"], "unequal radii in JKR")
)
def test_a_checkpoint_is_that_of_lammps(name: str, stop: Callable[..., None], tmp_path: Path) -> None:
    """One that the kernel wrote is continued with it and without it, to the same numbers and the same extremes."""
    scene = SCENES[name].with_values({"time.duration": 300.0, "time.allow_echo": True})  # long enough to be stopped
    whole, cut, other = one(scene, tmp_path / "whole", kernel=True), tmp_path / "cut", tmp_path / "other"
    stop(scene, cut, kernel=True)
    shutil.copytree(cut, other)
    found = resume(cut)
    assert largest_difference(whole, found) < ROUNDING
    assert found.info["smallest_overlap"] == pytest.approx(whole.info["smallest_overlap"], abs=ROUNDING)
    for guard, result in whole.info["guards"].items():
        assert found.info["guards"][guard]["value"] == pytest.approx(result["value"], rel=1e-6, abs=ROUNDING)

    (other / "in.resume").write_text(resume_text(prepare(scene), CHECKPOINTS[0]))
    lock = os.open(other, os.O_RDONLY)
    run_input(other, "in.resume", lock)
    os.close(lock)
    mend(other, prepare(scene))
    assert largest_difference(whole, Record.from_dump(other, scene)) < ROUNDING


@pytest.mark.parametrize("ranks", members([1, 2], 2))
def test_what_opens_far_from_the_record_fails_no_continued_run(
    ranks: int, stop: Callable[..., None], tmp_path: Path
) -> None:
    """At the held rows the strain of the wave doubles, which the centre does not hear of before the end."""
    if ranks > core_count():
        pytest.skip("one core")
    scene = Scene.load("l_opening").with_values(
        {
            **{"packing.ends": "fixed", "packing.rows": 201, "wave.amplitude": 0.9, "effects.contact_opening": "auto"},
            **{"time.duration": 40.0, "time.timestep": 0.025, "output.checkpoint": 3e-4},
            **{"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7},  # under a load all spheres stay
        }
    )
    whole = run(scene, tmp_path / "whole", kernel=True, ranks=ranks)
    stop(scene, tmp_path / "cut", kernel=True, ranks=ranks)
    found = resume(tmp_path / "cut")
    assert found.info["guards"]["open_contacts"] == whole.info["guards"]["open_contacts"]
    assert found.info["smallest_overlap"] == whole.info["smallest_overlap"]


def test_a_run_of_another_kernel_is_not_continued(stop: Callable[..., None], tmp_path: Path) -> None:
    stop(short("tr_periodic", **{"time.duration": 200.0}), tmp_path / "cut", kernel=True)
    status = read_status(tmp_path / "cut")
    write_status(tmp_path / "cut", status | {"kernel": status["kernel"] | {"source_sha256": "another"}})
    with pytest.raises(RunFolderError, match="ran with another kernel or LAMMPS than the present ones"):
        resume(tmp_path / "cut")


@pytest.mark.parametrize("compiler", ["no-such-compiler", "false"])
def test_a_missing_or_failing_compiler_is_named(compiler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CXX", compiler)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(LammpsMissingError, match=compiler):
        library.build()
    assert not list(tmp_path.rglob("*.so"))


def test_a_full_disk_under_the_compiler_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler = tmp_path / "compiler"
    said = "ld: final link failed: No space left on device\\ncollect2: error: ld returned 1 exit status"
    compiler.write_text(f"#!/bin/sh\nprintf '{said}' >&2\nexit 1\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("CXX", str(compiler))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(
        RunFolderError, match=rf"{tmp_path}/granular-lmp/.*: cannot be written: No space left on device"
    ):
        library.build()


def test_a_kernel_that_was_not_built_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(LammpsMissingError, match="build-kernel"):
        run(short("tr_periodic"), tmp_path / "run", kernel=True)
    late = short("tr_periodic", **{"sphere.adhesion_law": "jkr", "effects.parting": "distance"})
    with pytest.raises(
        LammpsMissingError, match=r"parting = .* only the kernel supports it: there is no .* build-kernel"
    ):
        run(late, tmp_path / "run")


@pytest.fixture
def copied(built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The kernel in a cache of its own, in a folder that LAMMPS could not name."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / 'für "uns" & andere'))
    place = library.library()
    place.parent.mkdir(mode=0o755, parents=True)
    shutil.copy(built, place)
    return place


def test_a_kernel_loads_from_any_folder(copied: Path, tmp_path: Path) -> None:
    assert "kernel" in run(short("tr_periodic"), tmp_path / "run").info
    assert library.STYLE in (tmp_path / "run" / "log.lammps").read_text()
    assert not copied.as_posix().isascii()


def give_away(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a place one of another user: root can, and others become another user."""
    if os.geteuid() == 0:
        os.chown(place, 12345, -1)
    else:
        monkeypatch.setattr(compiled.os, "geteuid", lambda: 12345)


def linked(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place.symlink_to(place.rename(place.with_name("other.so")))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda place, _: place.write_bytes(place.read_bytes()[:5000]),
            "kernelplugin.so: is truncated or damaged; delete it, and",
        ),
        (lambda place, _: place.write_bytes(b""), "kernelplugin.so: is truncated or damaged; delete it, and"),
        (lambda place, _: place.write_bytes(place.read_bytes().replace(b"dmt", b"tmd")), "is truncated or damaged"),
        (lambda place, _: place.chmod(0o757), r"kernelplugin.so: is writable by others: must not be \(chmod go-w\)"),
        (lambda place, _: place.parent.chmod(0o777), r"lammps-[^/]*: is writable by others"),
        (lambda place, _: place.parents[1].chmod(0o777), r"granular-lmp: is writable by others"),
        (give_away, "kernelplugin.so: belongs to user .*: must belong to user .* or to root"),
        (lambda place, patch: give_away(place.parent, patch), "belongs to user .*: must belong to user .* or to root"),
        (linked, "kernelplugin.so: must be a file, not a link"),
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
    scene = brief(short("tr_periodic"))
    with pytest.raises(LammpsMissingError, match=message):
        run(scene, tmp_path / "run", kernel=True)
    assert not (tmp_path / "run").exists()
    assert not library.chosen(None, written_text(prepare(scene)))


def test_a_relative_cache_is_no_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    assert library.library().is_relative_to(tmp_path / ".cache" / "granular-lmp")


def test_a_user_without_a_home_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(
        Path, "home", lambda: (_ for _ in ()).throw(RuntimeError("Could not determine home directory."))
    )
    with pytest.raises(LammpsMissingError, match="no home folder for the kernel"):
        library.library()


@pytest.fixture
def fast_compiler(built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A compiler that takes no time, as it has the kernel already, and an empty cache."""
    compiler = tmp_path / "compiler"
    compiler.write_text(f'#!/bin/sh\nfor place; do :; done\ncp "{built}" "$place"\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("CXX", str(compiler))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.mark.usefixtures("fast_compiler")
def test_a_kernel_that_is_built_is_for_its_user_alone_to_write() -> None:
    before = os.umask(0)
    try:
        place = library.build()
    finally:
        os.umask(before)
    assert library.built() == place


def test_a_library_that_does_not_load_is_an_error(tmp_path: Path) -> None:
    (tmp_path / library.NAME).write_bytes(compiled.sealed(b"no library"))
    # In a process of its own, as LAMMPS keeps a library that was loaded
    code = """
import sys
from pathlib import Path
from granular_lmp.lammps.installation import lammps_module
from granular_lmp.lammps.kernel import library
library.start(lammps_module(), Path(sys.argv[1]), ["-log", "none", "-screen", "none"])
"""
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path / library.NAME], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode != 0
    assert "LammpsMissingError: LAMMPS does not load the kernel" in done.stderr


@pytest.mark.usefixtures("fast_compiler")
def test_the_commands_build_it_and_take_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["build-kernel"]) == 0
    assert str(library.built()) in capsys.readouterr().out
    command = ["run", "tr_square", "--set", "time.duration=5", "-o", str(tmp_path / "run")]
    assert main(command) == 0
    assert read_status(tmp_path / "run")["kernel"] == library.description()
    assert [line for line in capsys.readouterr().err.splitlines() if "kernel" in line] == [TAKEN]
    assert main([*command, "--force", "--no-kernel"]) == 0
    assert "kernel" not in read_status(tmp_path / "run")
    assert "kernel" not in capsys.readouterr().err


TAKEN = "note: the kernel computes the contacts that it supports; --no-kernel turns it off"
ROLLING = ["--set", "effects.rolling_stiffness=1.0", "--set", "effects.rolling_friction=0.1"]


def test_what_it_does_not_know_runs_without_it_unless_it_is_demanded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["run", "tr_damped", "--set", "time.duration=5", *ROLLING, "-o", str(tmp_path / "run")]
    assert main([*command, "--kernel"]) == 2
    assert "--kernel: the kernel does not support the contact 'dmt" in capsys.readouterr().err
    assert main(command) == 0
    assert "note: LAMMPS computes the contacts: the kernel does not support the contact 'dmt" in capsys.readouterr().err
    assert "kernel" not in read_status(tmp_path / "run")


def test_where_none_was_built_nothing_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert main(["run", "tr_periodic", "--set", "time.duration=1", "-o", str(tmp_path / "run")]) == 0
    assert "kernel" not in capsys.readouterr().err
    assert "kernel" not in read_status(tmp_path / "run")


def test_a_sweep_takes_it_and_keeps_what_is_finished(small: Scene, tmp_path: Path) -> None:
    first = sweep(small, {"wave.amplitude": [0.1]}, tmp_path, force=True, kernel=False)
    both_runs = sweep(small, {"wave.amplitude": [0.1, 0.2]}, tmp_path, force=True)
    without, with_it = (read_status(tmp_path / row["run"]) for row in both_runs.rows)
    assert "kernel" not in without
    assert with_it["kernel"] == library.description()
    assert both_runs.rows[0] == first.rows[0]


def test_a_sweep_without_a_kernel_is_refused_at_once(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(LammpsMissingError, match="build-kernel"):
        sweep(small, {"wave.amplitude": [0.1]}, tmp_path / "sweep", kernel=True)
    assert not (tmp_path / "sweep").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), " of the time of the LAMMPS loop in a short run just now; about "),
        (ROLLING, "none: the kernel does not support the contact"),
    ],
)
def test_check_says_what_it_saves(words: Sequence[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "tr_periodic", *words]) == 0
    assert said in next(line for line in capsys.readouterr().out.splitlines() if line.startswith("kernel"))


def test_doctor_says_whether_there_is_one(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("granular_lmp.doctor.frequency_error", lambda: 0.0)  # the self-test: tests/cli
    main(["doctor"])
    assert f"kernel       {built}: in tr_periodic it just took " in capsys.readouterr().out
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    main(["doctor"])
    assert "kernel       none; with it the LAMMPS loop takes about half the time" in capsys.readouterr().out


def test_cost_takes_it_and_keeps_its_runs_apart(small: Scene, tmp_path: Path) -> None:
    made = cost.plan(small, tmp_path / "cost", repeats=1)
    fastest = min(made.settings, key=lambda setting: setting.work)
    result = cost.measure(replace(made, settings=[fastest]))
    assert result["kernel"] is True
    runs = list((tmp_path / "cost" / "runs").glob("*/1"))
    assert runs
    assert all(read_status(each)["kernel"] == library.description() for each in runs)
    plain = cost.plan(small, tmp_path / "cost", repeats=1, kernel=False)
    assert len(plain.todo()) == len(plain.settings) + len(plain.references)


def test_a_collision_takes_it(tmp_path: Path) -> None:
    """With the same numbers, and for the run with twice the step too."""
    collision = Collision.load("jkr_pull_off")
    plain, kernel = (collide.run(collision, tmp_path / str(each), kernel=each) for each in (False, None))
    assert read_status(tmp_path / "None")["kernel"] == library.description()
    assert kernel.kernel
    for name, value in plain.numbers().items():
        assert kernel.numbers()[name] == pytest.approx(value, rel=1e-6)


def closed_form(collision: Collision) -> jkr.Contact:
    sphere = collision.sphere
    return jkr.Contact(collision.effective_radius, sphere.effective_modulus, sphere.work_of_adhesion)


@pytest.mark.parametrize("share", [1.02, 2.0])
def test_bodies_that_part_late_lose_the_energy_of_the_closed_form(share: float, tmp_path: Path) -> None:
    late = Collision.load("jkr_pull_off").with_values({"contact.parting": "distance"})
    law, mass = closed_form(late), late.effective_mass
    late = late.with_values({"collision.normal_velocity": share * law.sticking_speed(mass) / 2})
    result = collide.run(late, tmp_path / "run")
    lost = (1 - result.restitution**2) * mass * late.closing_speed**2 / 2
    # LAMMPS's steps miss half of a step's kick at first touch: 2e-3 of the energy at most
    assert lost == pytest.approx(law.loss("distance"), rel=2e-3)
    assert law.loss("distance") == pytest.approx(7.0922 / 3.5026 * law.loss("load"), rel=1e-4)
    assert result.overlap[result.touching - 1] == pytest.approx(-law.pull_off_distance("distance"), rel=2e-2)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({}, 'effects.parting = "distance": only the kernel supports it; run it without kernel=False'),
        ({"sphere.adhesion_law": "dmt"}, 'needs sphere.adhesion_law = "jkr"'),
        ({"effects.rolling_stiffness": 1.0, "effects.rolling_friction": 0.1}, "effects.rolling, which the kernel"),
        ({"disorder.radius": 1e-5}, "is not built for unequal or missing spheres"),
        (
            {"packing.ends": "fixed", "packing.first": "wall", "packing.rows": 95, "time.duration": 5.0},
            "walls and substrates",
        ),
    ],
)
def test_late_parting_is_refused_by_name_without_what_it_needs(
    values: dict[str, Any], named: str, tmp_path: Path
) -> None:
    declared = {"sphere.adhesion_law": "jkr", "effects.parting": "distance", **values}
    with pytest.raises((LaunchError, SceneError), match=named):
        run(Scene.load("tr_periodic").with_values(declared), tmp_path / "run", kernel=False)
    assert not (tmp_path / "run").exists()


def test_a_wave_whose_contacts_do_not_part_is_that_of_early_parting(tmp_path: Path) -> None:
    scene = SCENES["JKR"].with_values({"time.duration": 5.0})
    early, late = (run(scene.with_values({"effects.parting": word}), tmp_path / word) for word in ("load", "distance"))
    assert largest_difference(early, late) == 0
    assert late.info["effects"]["late_parting"]["on"]
    assert not early.info["effects"]["late_parting"]["on"]
