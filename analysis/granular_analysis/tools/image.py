"""Image contacts or spheres of a crystal that differ from its scene, from the recorded motion of a few spheres.

    granular-analysis image RECORDS SCENE [RECORDS SCENE ...] --of QUANTITY [--noise SHARE] [-o DIR]

RECORDS are a run folder with monitors, or a table of traces (`granular_analysis.measure.traces`). SCENE is the crystal
as it is assumed to be, with the sources that made the record. Each record has a scene of its own, and all scenes have
the same crystal. DIR holds map.csv, with the factor of each contact or sphere, its error from noise and the width of
the image of a single changed value; image.png; and log.csv, with a line for each weight. The same command continues a
search that was stopped.
"""

import argparse
import csv
import hashlib
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.stepping import NetworkEngine
from granular_analysis.measure.traces import Traces
from granular_analysis.plotting import in_one_line, letter, page, save, scene_of, write_csv
from granular_analysis.theory.imaging import WEIGHTS, Image, Trial, widths
from granular_analysis.tools.kept import begun
from granular_lmp.cli.arguments import changes_argument
from granular_lmp.cli.output import interruptible
from granular_lmp.runs.folder import locked

if TYPE_CHECKING:  # slow to import, and the last needs JAX
    from matplotlib.axes import Axes
    from matplotlib.collections import Collection
    from matplotlib.figure import Figure

    from granular_analysis.measure.imaging import Shot, Sought

Floats = NDArray[np.float64]
MAP, LOG, PICTURE, ASKED = "map.csv", "log.csv", "image.png", "image.json"
QUANTITIES = ("contact.normal_stiffness", "contact.shear_stiffness", "adhesion", "density")
MICRO = 1e6
LEAST = 0.05  # least range of the colours, as a difference from 1
_SEEN = 0.1  # a value is resolved if the image of a change of it alone has this share in its own place


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "shots",
        nargs="+",
        metavar="RECORDS SCENE",
        help="run folder or table of traces, and scene of the crystal as it is assumed to be; one or more pairs",
    )
    changes_argument(parser, "time.duration=60.0")
    parser.add_argument("--of", required=True, choices=QUANTITIES, help="quantity to image")
    parser.add_argument(
        "--noise",
        type=float,
        metavar="SHARE",
        help="standard deviation of the errors over the root mean square of the record; chooses the weight of the "
        "penalty (default: unknown; the corner of the L-curve chooses it)",
    )
    parser.add_argument(
        "--penalty",
        choices=["tikhonov", "tv"],
        default="tikhonov",
        help="tikhonov: small differences everywhere; tv: few edges, by total variation (default: tikhonov)",
    )
    parser.add_argument(
        "--within",
        nargs=2,
        type=float,
        default=[0.1, 5.0],
        metavar=("LOW", "HIGH"),
        help="bounds of the factors (default: 0.1 5)",
    )
    parser.add_argument("--device", choices=["jax", "gpu"], default="jax", help="all cores of this machine, or a GPU")
    parser.add_argument("-o", "--output", default="image", metavar="DIR", help="folder (default: image)")
    options = parser.parse_args(argv)
    if len(options.shots) % 2:
        parser.error("give pairs of RECORDS and SCENE")
    if find_spec("jax") is None:
        raise SystemExit("image: needs JAX: pip install 'granular-lmp[jax]'")
    folder = Path(options.output)
    with in_one_line():
        NetworkEngine.on(options.device)
        sought = _sought(options)
        print(f"{len(sought.owners)} values of {options.of}, {sought.points} points in {len(sought.shots)} records")
        with locked(folder, make=True, force=True):
            found = _searched(sought, options, folder)
            _write(sought, found, folder)
    return 0


def _write(sought: "Sought", found: Image, folder: Path) -> None:
    """Print the report, and write map and picture."""
    resolved, errors = found.resolution()
    width = widths(resolved, len(sought.owners) / len(sought.first.network.position), sought.first.network.dimension)
    print(said(sought, found, resolved, errors, width))
    head, rows = table(sought, found, resolved, errors, width)
    write_csv(folder / MAP, head, rows)
    save(figure(sought, found), folder / PICTURE)


def _sought(options: argparse.Namespace) -> "Sought":
    from granular_analysis.measure.imaging import Shot, Sought  # needs JAX

    noise, shots = 1.0 if options.noise is None else options.noise, []
    for records, scene in zip(options.shots[::2], options.shots[1::2], strict=True):
        traces = Traces.read(records)
        if traces.understood:
            print(traces.understood)
        shots.append(Shot.of(traces, scene_of(scene, options), noise))
    return Sought(shots, options.of)


def _searched(sought: "Sought", options: argparse.Namespace, folder: Path) -> Image:
    """Return the image; write each trial and its line of the log as soon as it is known."""
    count = len(sought.owners)
    row = np.dtype([("weight", "<f8"), ("values", "<f8", count), ("rest", "<f8", 3)])
    asked = {name: getattr(options, name) for name in ("of", "noise", "penalty", "within")}
    path, found = begun(folder, ASKED, asked | {"shots_sha256": digest_of(sought.shots)}, row, (MAP, LOG, PICTURE))
    kept = [
        Trial(float(each["weight"]), each["values"], float(misfit), float(penalty), int(gradients))
        for each in found
        for misfit, penalty, gradients in [each["rest"]]
    ]
    rows: list[list[object]] = []
    log = folder / LOG
    seen = [*csv.DictReader(log.read_text(encoding="utf-8").splitlines())] if log.is_file() else []
    kinks = [each["kinks"] for each in seen[: len(kept)]]
    with interruptible() as progress:

        def told(trial: Trial) -> None:
            trouble = kinks[len(rows)] if len(rows) < len(kinks) else sought.trouble(trial.values)
            rows.append([trial.weight, trial.misfit / sought.points, trial.penalty, trial.gradients, trouble])
            write_csv(log, ["weight", "chi2_a_point", "penalty", "gradients", "kinks"], rows)
            if len(rows) > len(kept):
                with path.open("ab") as stream:
                    numbers = [trial.weight], trial.values, [trial.misfit, trial.penalty, trial.gradients]
                    np.concatenate(numbers).astype("<f8").tofile(stream)
            if progress:
                progress(len(rows), max(WEIGHTS, len(rows)), None)

        known = options.noise is not None
        return sought.image(options.penalty, known=known, bounds=tuple(options.within), told=told, kept=kept)


def digest_of(shots: "Sequence[Shot]") -> str:
    """Return the SHA-256 digest of scenes and records: measured values and errors, their spheres and time steps."""
    digest = hashlib.sha256()
    for shot in shots:
        run = shot.run
        digest.update(shot.scene.to_toml().encode())
        for part in (run.spheres, [run.step, run.every], shot.measured, shot.errors):
            digest.update(np.asarray(part, dtype="<f8").tobytes())
    return digest.hexdigest()


def said(sought: "Sought", found: Image, resolved: Floats, errors: Floats, width: Floats) -> str:
    """Return the report on an image: fit, extreme factors, and resolution."""
    values, seen = found.values, np.diag(resolved) > _SEEN
    ends = {name: int(at(values)) for name, at in (("lowest", np.argmin), ("highest", np.argmax))}
    places = {name: ", ".join(f"{1e6 * each:.3g}" for each in sought.places[at]) for name, at in ends.items()}
    lines = [
        f"chi2 = {found.chi_squared:.4g} a point at the weight {found.best.weight:.4g}: {found.reason}",
        *(f"{name} factor {values[at]:.3f} ± {errors[at]:.2g} at ({places[name]}) µm" for name, at in ends.items()),
        f"{np.count_nonzero(seen)} of {len(values)} values are resolved: more than {_SEEN:.0%} of a change of one "
        "value appears in its place",
    ]
    if seen.any():
        lines.append(
            f"there the image of such a change is {np.median(width[seen]):.2g} spheres wide, and the error of a "
            f"factor from noise is {np.median(errors[seen]):.2g} (medians)"
        )
    if trouble := sought.trouble(values):
        lines.append(f"in the run of the image {trouble}: its records have kinks, and the image may be wrong there")
    return "\n".join(lines)


def table(
    sought: "Sought", found: Image, resolved: Floats, errors: Floats, width: Floats
) -> tuple[list[str], list[list[object]]]:
    """Return the head and the rows of the map: row and column, place in m, factor, error, and resolution."""
    row, column = sought.sites
    ends = sought.ends
    of_spheres = (ends[:, 0] == ends[:, 1]).all()
    which = ["row", "column"] if of_spheres else ["row_i", "column_i", "row_j", "column_j"]
    axes = [f"{axis}_m" for _, axis in zip(range(sought.places.shape[1]), "xyz", strict=False)]
    columns: list[list[object]] = []
    for end in ends.T[:1] if of_spheres else ends.T:
        columns += [row[end].tolist(), column[end].tolist()]
    columns += [*sought.places.T.tolist(), found.values.tolist(), errors.tolist()]
    columns += [np.diag(resolved).tolist(), width.tolist()]
    head = [*which, *axes, "factor", "error", "share_in_place", "width_spheres"]
    return head, [list(each) for each in zip(*columns, strict=True)]


def draw_map(axes: "Axes", sought: "Sought", values: Floats) -> "Collection":
    """Draw the values on contacts or spheres, and the measured spheres; return the coloured collection."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import CenteredNorm

    network, unit = sought.first.network, sought.first.scales.metre * MICRO
    middle, place = sought.places[:, :2] * MICRO, network.position[:, :2] * unit
    norm = CenteredNorm(1.0, max(float(np.abs(values - 1).max()), LEAST))
    if (sought.ends[:, 0] == sought.ends[:, 1]).all():
        drawn: Collection = axes.scatter(middle[:, 0], middle[:, 1], c=values, cmap="RdBu_r", norm=norm, s=12)
    else:
        half = place[sought.ends[:, 0]] - middle
        lines = np.stack([middle + half, middle - half], axis=1)
        drawn = LineCollection([*lines], array=values, cmap="RdBu_r", norm=norm, linewidths=2)
        axes.add_collection(drawn)
    axes.plot(*place[np.unique(np.concatenate([each.run.spheres for each in sought.shots]))].T, "^k", markersize=4)
    axes.set(xlabel="x, µm", ylabel="y, µm", aspect="equal")
    return drawn


def figure(sought: "Sought", found: Image) -> "Figure":
    """Return the figure of the map with its measured spheres, and of the penalty over χ²."""
    drawing = page(3.3)
    left, right = drawing.subplots(1, 2, width_ratios=[1.4, 1])
    drawing.colorbar(draw_map(left, sought, found.values), ax=left, label=f"factor of {sought.of}")
    chi = [each.misfit / sought.points for each in found.trials]
    penalties = [max(each.penalty, 1e-12) for each in found.trials]
    right.loglog(chi, penalties, "o", color="0.5", markersize=4)
    right.loglog(chi[found.chosen], penalties[found.chosen], "o", color="C3", label="the image")
    right.set(xlabel="chi² a point", ylabel="penalty")
    right.legend()
    letter((left, right))
    return drawing
