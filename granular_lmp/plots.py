"""Figures of the package, drawn without pyplot."""

from pathlib import Path

import ase
import numpy as np
from matplotlib.figure import Figure

from granular_lmp.errors import RunFolderError
from granular_lmp.modes import Physics, mode_along_y
from granular_lmp.scene import Scene

# Told apart by colour, and without it by the dashes.
LINES = {
    "L": {"color": "black", "linestyle": "-"},
    "TR": {"color": "tab:blue", "linestyle": "--"},
    "RT": {"color": "tab:red", "linestyle": "-."},
}


def dispersion_figure(packing: ase.Atoms, scene: Scene) -> Figure:
    """Ω(ξ) of the modes along y with the scene's wave marked; a second axis in MHz."""
    wavenumbers = np.linspace(0.01, np.pi, 200)
    figure = Figure(figsize=(5.5, 4.0), layout="constrained")
    axes = figure.subplots()
    physics = Physics.of(scene)
    for name in physics.modes:
        branch = [mode_along_y(packing, scene.sphere, xi, name, physics).frequency for xi in wavenumbers]
        axes.plot(wavenumbers, branch, label=name, **LINES[name])  # type: ignore[arg-type]
    wave = mode_along_y(packing, scene.sphere, scene.wavenumber, scene.wave.mode, physics)
    axes.plot(wave.wavenumber, wave.frequency, "ko", label=f"{wave.name}, $\\xi$ = {wave.wavenumber:.4g}")
    axes.set(xlabel=r"wave number $\xi$ (rad per row)", ylabel=r"frequency $\Omega$ (rad per $t_0$)", xlim=(0, np.pi))
    axes.set_ylim(bottom=0)
    per_mhz = 2e6 * np.pi * scene.sphere.time_scale
    right = axes.secondary_yaxis(
        "right", functions=(lambda x: np.divide(x, per_mhz), lambda x: np.multiply(x, per_mhz))
    )
    right.set_ylabel("frequency (MHz)")
    axes.legend(title=scene.name)
    return figure


def save(figure: Figure, path: str | Path) -> None:
    """Write the figure in the format of the file's ending; its folder is made.

    Raises
    ------
    RunFolderError
        When the ending is none that matplotlib writes, or the file cannot be written.
    """
    path = Path(path)
    known = figure.canvas.get_supported_filetypes()
    if path.suffix[1:].lower() not in known:
        raise RunFolderError(f"{path}: must end in one of {', '.join(sorted(known))}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150)
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be written: {error.strerror or error}") from error
