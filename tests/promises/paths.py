"""The paths: kinds of scenes, each as small as its kind allows, and the ways to run one of them."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import chdir
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp import ImpactScene, Record, Scene
from granular_lmp.accuracy import tolerance
from granular_lmp.lammps.deck import Deck
from granular_lmp.runs.options import Options
from granular_lmp.studies.sweep import sweep
from tests.conftest import PAPER

Signals = dict[str, np.ndarray]
AnyScene = Scene

CELL = {"packing.rows": 12, "packing.ends": "periodic", "wave.wavenumber": np.pi / 3, "time.duration": 12.0}
SHAKEN = {
    "name": "shaken",
    "sphere": PAPER.to_dict()["sphere"],
    "wave": {"mode": "TR", "wavenumber": 1.475, "amplitude": 0.05, "form": "none"},
    "time": {"duration": 12.0, "timestep": 0.05, "allow_echo": True},
}


def _shaken(rows: int, at: int, **tables: Any) -> Scene:
    """Return a strip whose row `at` is shaken, with a monitor of motion and one of flux behind it."""
    behind, near = {"name": "behind", "rows": [at + 3] * 2}, {"name": "near", "rows": [at + 1, at + 3], "what": "flux"}
    source = [{"rows": [at, at], "force": "x", "ramp": 5.0}]
    packing = {"rows": rows, "columns": 3, "ends": "fixed"}
    return Scene.from_dict({**SHAKEN, "packing": packing, "source": source, "monitor": [behind, near], **tables})


@cache
def kinds() -> dict[str, AnyScene]:
    """Return a small scene of each kind by its name."""
    strip = {"packing.rows": 13, "time.duration": 12.0, "time.allow_echo": True, "wave.amplitude": 0.1}
    spread = {"disorder.radius": 5e-5, "disorder.density": 0.1, "disorder.vacancies": 0.03}
    struck = {"packing.rows": 8, "packing.columns": 9, "striker.1.spheres": [[0, 4]], "time.duration": 20.0}
    hit = {"time.timestep": 0.02, "time.sample": 0.25, "time.duration": 5.0}
    watched = {"name": "near", "rows": [2, 2]}, {"name": "through", "rows": [3, 4], "what": "flux"}
    return {
        "running": PAPER.with_values(CELL),
        "standing": PAPER.with_values({**CELL, "wave.form": "standing"}),
        "driven": PAPER.with_values({**strip, "wave.form": "driven", "envelope.ramp": 5.0}),
        "sources and monitors": _shaken(21, 9),
        "quiet ends": _shaken(61, 29, absorb={"rows": "auto", "reflection": 0.1}),
        "imperfect": PAPER.with_values({**CELL, "packing.columns": 8, **spread}),
        "layer": Scene.load("monolayer_rocking").with_values({**CELL, "output.particles": 0.0}),
        "fcc/hcp": Scene.load("hcp_c_axis").with_values({"time.duration": 12.0, "output.particles": 0.0}),
        "JKR": PAPER.with_values({**CELL, "sphere.adhesion_law": "jkr"}),
        "damped": PAPER.with_values({**CELL, "effects.damping": True, "effects.viscosity": 1e-9}),
        "impact": ImpactScene.load("point_impact").with_values({**struck, "monitor": list(watched)}),
        "collision": Scene.load("test4").with_values(hit),
    }


@dataclass(frozen=True)
class Path_:
    """A kind of scene and a way to run it."""

    name: str
    kind: str = "running"
    launcher: str = "module"
    ranks: int = 1
    kernel: bool = False

    def scene(self) -> AnyScene:
        """Return the scene of the kind."""
        return kinds()[self.kind]

    @property
    def impact(self) -> bool:
        """True if the scene is of an impact."""
        return self.kind in ("impact", "collision")

    @property
    def starts_with_a_wave(self) -> bool:
        """True if a plane wave fills a perfect crystal at the beginning."""
        return self.kind in ("running", "standing", "layer", "JKR", "damped")

    @property
    def order(self) -> int:
        """Order of the error in the time step."""
        return 1 if self.kind in ("quiet ends", "damped", "impact", "collision") else 2

    def run(self, what: AnyScene | Deck, folder: Path) -> Path:
        """Run a scene or a deck on this path, and return its run folder."""
        if self.name == "sweep":
            assert isinstance(what, AnyScene)
            table = sweep(what, {"time.sample": [what.time.sample]}, folder, kernel=self.kernel)
            return Path(folder) / table.rows[0]["run"]
        options = Options(self.launcher, self.ranks, kernel=self.kernel)
        if self.name == "thread":
            return _beside_another(lambda place: run_one(what, place, options), folder)
        return run_one(what, folder, options)

    def command(self, scene: Path, setting: str) -> list[str]:
        """Return the words of a command that runs a scene file with a setting."""
        if self.name == "sweep":
            return ["sweep", str(scene), "--over", setting, "-o", str(scene.parent / "runs"), "--no-kernel"]
        switches = [*(["--lmp"] if self.launcher == "lmp" else []), "--kernel" if self.kernel else "--no-kernel"]
        ranks = ["--np", str(self.ranks)] if self.ranks > 1 else []
        return ["run", str(scene), "--set", setting, "-o", str(scene.parent / "run"), *switches, *ranks]


def run_one(what: AnyScene | Deck, folder: Path, options: Options) -> Path:
    """Run a scene or a deck and return its folder."""
    given = {name: getattr(options, name) for name in ("launcher", "ranks", "force", "progress", "kernel")}
    tolerance.run(what, folder, **given)
    return Path(folder)


def _beside_another(run: Callable[[Path], Path], folder: Path) -> Path:
    """Run into a relative folder in one thread while another thread runs another scene beside it."""
    other = PAPER.with_values({**CELL, "wave.amplitude": 0.1})
    with chdir(folder.parent), ThreadPoolExecutor(2) as threads:
        beside = threads.submit(run_one, other, Path(f"{folder.name}_beside"), Options(kernel=False))
        mine = threads.submit(run, Path(folder.name))
        beside.result()
        mine.result()
        assert os.path.samefile(folder.parent, Path.cwd())
    return folder


def resume(folder: Path) -> None:
    """Continue a run."""
    tolerance.resume(folder)


def signals(folder: Path) -> Signals:
    """Return all that a run recorded, by name: p, q, phi and monitors; of an impact velocities and spins."""
    record = Record.load(folder)
    places = ("tau", "row", "column")
    return dict(record.signals) | {
        f"{monitor.name}.{name}": values
        for monitor in record.scene.monitor
        for name, values in record.monitor(monitor.name).columns().items()
        if name not in places
    }


PATHS = {
    each.name: each
    for each in (
        *(Path_(kind, kind) for kind in kinds()),
        Path_("lmp", launcher="lmp"),
        Path_("two ranks", ranks=2),
        Path_("kernel", kernel=True),
        Path_("sweep"),
        Path_("thread"),
    )
}
