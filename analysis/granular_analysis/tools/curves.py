"""Figure of a sweep: largest signals of its runs, as dots, over the varied key, with theory as lines."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.signals import SILENT, recorded, signals_of
from granular_analysis.measure.swept import Swept
from granular_analysis.plotting import page
from granular_lmp.runs.record import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
UNITS = {"wavenumber": "rad per row", "direction": "degrees from x", "amplitude": "static overlaps", "frequency": "Hz"}
UNITS |= {"radius": "m", "youngs_modulus": "Pa", "density": "kg/m³", "work_of_adhesion": "J/m²", "contact_force": "N"}


def figure(
    swept: Swept, records: Sequence[Record], signals: Sequence[tuple[Floats, ...] | None], labels: dict[str, str]
) -> "Figure | None":
    """Return the figure of the largest value of each signal, for runs and references, over the key with most values.

    Each signal that is not zero by symmetry has a panel, and each combination of the other keys a colour. Returns None
    if no varied key is a number, or no run has a reference.

    Parameters
    ----------
    swept, records : the sweep, and the records of its finished runs.
    signals : signals of the reference of each run, in the order of `signals_of`; None for a run without one.
    labels : labels of the signals.
    """
    varied = {key: values for key, values in swept.columns(records).items() if key in swept.over}
    axis = max((key for key in varied if _numbers(varied[key])), key=lambda key: len(set(varied[key])), default=None)
    names = signals_of(records[0])
    run, theory = _largest(records, names), np.full((len(records), len(names)), np.nan)
    for number, reference in enumerate(signals):
        if reference is not None:
            theory[number] = [np.max(np.abs(each), initial=0.0) for each in reference]
    worth = [place for place in range(len(names)) if np.nanmax(theory[:, place], initial=0.0) > SILENT]
    if axis is None or not worth:
        return None

    result = page(0.9 + 1.7 * len(worth))
    panels = result.subplots(len(worth), 1, sharex=True, squeeze=False)[:, 0]
    others = [key for key in varied if key != axis]
    groups = [", ".join(f"{_words(key)} {varied[key][n]}" for key in others) for n in range(len(records))]
    x = np.array(varied[axis], dtype=float)
    for colour, group in enumerate(dict.fromkeys(groups)):
        own = np.flatnonzero([each == group for each in groups])
        own = own[np.argsort(x[own], kind="stable")]
        for panel, place in zip(panels, worth, strict=True):
            panel.plot(
                x[own], theory[own, place], color=f"C{colour}", linewidth=1.2, label=f"theory, {group}".rstrip(", ")
            )
            panel.plot(
                x[own], run[own, place], "o", color=f"C{colour}", markersize=4, label=f"LAMMPS, {group}".rstrip(", ")
            )
    for panel, place in zip(panels, worth, strict=True):
        panel.set_ylabel(f"largest {labels[names[place]]}")
    panels[-1].set_xlabel(_words(axis) + _unit(axis))
    panels[0].legend()
    panels[0].set_title(records[0].scene.name.replace("_", " "))
    return result


def _largest(records: Sequence[Record], names: Sequence[str]) -> Floats:
    """Return the largest magnitude of each signal of each run, (runs, signals); nan if it was not recorded."""
    found = [recorded(record) for record in records]
    return np.array([[np.max(np.abs(each[name])) if name in each else np.nan for name in names] for each in found])


def _numbers(values: Sequence[str]) -> bool:
    try:
        return bool(np.isfinite(np.array(values, dtype=float)).all())
    except ValueError:
        return False


def _words(key: str) -> str:
    return key.rpartition(".")[2].replace("_", " ").replace("wavenumber", "wave number").replace("youngs", "Young's")


def _unit(key: str) -> str:
    unit = UNITS.get(key.rpartition(".")[2])
    return f" ({unit})" if unit else ""
