"""Coherent second harmonic of the wave of a scene, in a perfect or imperfect crystal, with its error.

    granular-analysis harmonic SCENE_OR_RUN [--by theory|cell|network] [--csv FILE] [--json FILE]
    granular-analysis harmonic SWEEP_OVER_PHASES
    granular-analysis harmonic SCENE --seeds N [-o FOLDER] [--json FILE]

For a scene (a file or the name of a shipped one) or a run, the first of three methods that applies is used:
second-order theory of a perfect crystal or of layers, second order of the cell of its spheres, or their network. The
latter two begin from the first snapshot of a run; for a scene one sample is run to make it. ``--by`` selects a method.
For a sweep over six or more values of ``wave.phase``, or for its runs, the harmonic is measured in snapshots by least
squares. `granular_analysis.measure.harmonic` defines it and its errors.

``--seeds`` runs a disordered scene with N seeds, and its perfect crystal, and prints the mean over the seeds and the
value for equal spheres (`granular_analysis.measure.disordered`).
"""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.disordered import Seeds, over_seeds, whole_strength
from granular_analysis.measure.harmonic import Harmonic, by_cell, by_network, by_runs, by_theory, need_wave
from granular_analysis.measure.runs import begun, load
from granular_analysis.measure.swept import Swept
from granular_analysis.plotting import in_one_line, scene_of, write, write_csv
from granular_lmp.cli.arguments import changes_argument, changes_of
from granular_lmp.runs.record import STATUS, Record, Scene

Floats = NDArray[np.float64]

WAYS = ("along", "across")


def harmonic(targets: Sequence[str], by: str | None = None, changes: Mapping[str, Any] | None = None) -> Harmonic:
    """Return the second harmonic of a scene, a run, a sweep over phases, or the runs of such a sweep.

    targets : a scene or a run; or the folder of a sweep, or its runs.
    by : "theory", "cell" or "network"; None for the first that applies.
    changes : values of the scene by dotted keys, as in `Scene.with_values`; not allowed for runs.

    Raises ValueError or GranularError if no method applies, SystemExit for a run that cannot be read.
    """
    swept = Swept.load(targets[0]) if len(targets) == 1 else None
    folders = swept.folders if swept else [Path(each) for each in targets]
    if changes and any((each / STATUS).is_file() for each in folders):
        raise ValueError(f"--set {next(iter(changes))}: changes a scene, but a run has its own scene")
    if len(folders) > 1:
        if by:
            raise ValueError(f"--by {by} takes one scene or run, not {len(folders)}")
        return by_runs([load(folder) for folder in folders])
    if not (folders[0] / STATUS).is_file():
        return _of_scene(Scene.load(targets[0], changes), by)
    record = load(folders[0])
    return _first(record.scene, by, lambda: record, record.tau)


def _of_scene(scene: Scene, by: str | None) -> Harmonic:
    samples = int(scene.time.duration / scene.time.sample + 1e-9)
    tau: Floats = scene.time.sample * np.arange(samples + 1.0)
    with TemporaryDirectory() as folder:
        found = _first(scene, by, cache(lambda: begun(scene, folder)), tau)
    return replace(found, scene=scene)


def _first(scene: Scene, by: str | None, record: Callable[[], Record], tau: Floats) -> Harmonic:
    """Return the result of the first method that applies, or of the selected one; ValueError if none applies."""
    need_wave(scene)
    ways: dict[str, Callable[[], Harmonic]] = {
        "theory": lambda: by_theory(scene, tau),
        "cell": lambda: by_cell(record(), tau),
        "network": lambda: by_network(record(), tau),
    }
    refusals = []
    for name, way in ways.items():
        if by in (None, name):
            try:
                return way()
            except ValueError as error:
                refusals.append(f"{name}: {error}")
    raise ValueError("; ".join(refusals))


def columns(found: Harmonic) -> dict[str, np.ndarray]:
    """Return the columns of the CSV: τ, and real part, imaginary part and error of C along k and across."""
    result = {"tau": found.tau}
    for number, way in enumerate(WAYS):
        values = found.amplitudes[:, number]
        result |= {f"{way}_re": values.real, f"{way}_im": values.imag, f"{way}_error": found.errors[:, number]}
    return result


def summary(found: Harmonic) -> dict[str, Any]:
    """Return plain values for the JSON; None for an unknown error."""
    scene = found.scene
    wave = {"mode": scene.require_wave().mode, "wavenumber": scene.wavenumber, "direction": scene.direction}
    strengths = {
        way: {"strength": float(value), "error": None if np.isnan(error) else float(error)}
        for way, value, error in zip(WAYS, found.strength, found.strength_error, strict=True)
    }
    return {"name": scene.name, "by": found.by} | wave | {"amplitude": scene.amplitude} | strengths


def table(found: Harmonic) -> str:
    """Return the summary as text."""
    said = summary(found)
    lines = [
        f"{said['name']}: {said['mode']} at xi = {said['wavenumber']:.5g}, {said['direction']:.5g} degrees, "
        f"a = {said['amplitude']:g}; second harmonic by {found.way}, in D0",
        f"{'':8}{f'rms to tau = {found.tau[-1]:g}':>22}{'error':>10}{'at the end':>14}{'error':>10}",
    ]
    for number, way in enumerate(WAYS):
        last, error = abs(found.amplitudes[-1, number]), found.errors[-1, number]
        errors = [f"{'-' if np.isnan(each) else f'{each:.1e}':>10}" for each in (found.strength_error[number], error)]
        lines.append(f"{way:8}{said[way]['strength']:22.5g}{errors[0]}{last:14.5g}{errors[1]}")
    return "\n".join(lines)


def seeds_summary(found: Seeds) -> dict[str, Any]:
    """Return the results of the seeds for the JSON, in D0 except ``left`` and ``s``."""
    mean, left = found.mean, found.mean / found.equal
    return {
        "name": found.scene.name,
        "seeds": len(found.amplitudes),
        "s": found.spread,
        "tau": float(found.tau[-1]),
        "mean": {"strength": mean.value, "error": mean.error},
        "one_crystal": whole_strength(found.amplitudes),
        "equal_spheres": found.equal,
        "left": {"share": left.value, "error": left.error},
    }


def seeds_table(found: Seeds) -> str:
    """Return the summary as text."""
    said = seeds_summary(found)
    return (
        f"{said['name']}: s = {said['s']:.3g}; second harmonic along the wave, rms to tau = {said['tau']:g}, in D0\n"
        f"mean of {said['seeds']} crystals{said['mean']['strength']:12.4g} +- {said['mean']['error']:.1e}\n"
        f"with scattered part{said['one_crystal']:12.4g}\n"
        f"equal spheres{said['equal_spheres']:18.4g}\n"
        f"mean / equal{said['left']['share']:19.3f} +- {said['left']['error']:.3f}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("targets", nargs="+", metavar="SCENE_OR_RUN", help="scene, run, or runs with several phases")
    changes_argument(parser, "wave.amplitude=0.05")
    parser.add_argument("--by", choices=("theory", "cell", "network"), help="method (default: the first that applies)")
    parser.add_argument(
        "--seeds", metavar="N", type=int, help="run a disordered scene with N seeds and print the mean over them"
    )
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", help="for --seeds: folder of the runs (default: seeds/NAME)"
    )
    parser.add_argument("--csv", metavar="FILE", help="write C over tau as CSV")
    parser.add_argument("--json", metavar="FILE", help="write the summary as JSON")
    options = parser.parse_args(arguments)
    if options.seeds is not None and (options.by or options.csv or len(options.targets) > 1):
        parser.error("--seeds takes one scene, without --by and --csv")
    with in_one_line(", ".join(options.targets)):
        if options.seeds is not None:
            scene = scene_of(options.targets[0], options)
            seeds = over_seeds(scene, options.seeds, options.output or Path("seeds", scene.name))
            text, said = seeds_table(seeds), seeds_summary(seeds)
        else:
            found = harmonic(options.targets, options.by, changes_of(options))
            text, said = table(found), summary(found)
    print(text)
    if options.csv:
        held = columns(found)
        write_csv(Path(options.csv), held, np.column_stack(list(held.values())).tolist())
    if options.json:
        write(Path(options.json), json.dumps(said, indent=2) + "\n")
    return 0
