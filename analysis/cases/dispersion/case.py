"""Dispersion by simulation: spectral density of a sheet kicked at random, along Γ–M–K–Γ, with theory drawn over it.

    granular-analysis dispersion SHEET [-o FILE]

SHEET is the folder of a kicked sheet (``granular-lmp kick``). The table gives the distances of the peaks from the three
branches, in units of the resolution 2π/T. ``make dispersion`` runs and draws everything.
"""

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from cases.dispersion.density import Sheet, density, misses, zone_path
from cases.runner import script
from granular_analysis.plotting import page

BRANCHES = ("lower", "middle", "upper")


def table(sheet: Sheet) -> str:
    """Return the distances of each branch from its nearest peaks, and of the peaks from theory."""
    branches, others = misses(sheet, zone_path(sheet.box)[0])
    lines = [f"resolution {sheet.resolution:.4f} rad per tau; distances in units of it"]
    lines.append(f"{'':16}{'number':>7}{'median':>9}{'largest':>9}{'within 1':>10}")
    named = [(f"{name} branch", part[~np.isnan(part)]) for name, part in zip(BRANCHES, branches.T, strict=True)]
    for name, off in [*named, ("peaks", others)]:
        said = f"{np.median(off):9.3f}{off.max():9.3f}{np.mean(off <= 1):10.1%}" if len(off) else f"{'-':>9}" * 2
        lines.append(f"{name:16}{len(off):7}{said}")
    return "\n".join(lines)


def draw(sheet: Sheet) -> Figure:
    """Return the figure: spectral density over its maximum at each wave vector of the path, and theory."""
    wavevectors, corners = zone_path(sheet.box)
    frequencies, power = density(sheet, wavevectors)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(wavevectors, axis=0), axis=1))])
    # The path reaches K at one corner of the zone and leaves it at an equivalent one; that step is drawn as any other
    jump = corners[2]
    along[jump:] += (along[jump - 1] - along[jump - 2]) - (along[jump] - along[jump - 1])
    figure = page(4.6)
    axes = figure.subplots()
    shown = power / power.max(axis=1, keepdims=True)
    mesh = axes.pcolormesh(
        along, frequencies, shown.T, norm=LogNorm(1e-4, 1), cmap="Greys", shading="nearest", rasterized=True
    )
    axes.plot(along, sheet.theory(wavevectors), color="C3", linewidth=0.8, linestyle=(0, (4, 4)))
    axes.set(
        ylabel=r"frequency $\Omega$ (rad per $t_0$)", ylim=(0, 2.05),
        title=rf"a sheet kicked at random, $\tau \leq$ {sheet.tau[-1]:g}: LAMMPS (grey), theory (orange)",
    )  # fmt: skip
    axes.set_xticks([along[corner] for corner in corners], [r"$\Gamma$", "M", "K", r"$\Gamma$"])
    figure.colorbar(mesh, label="spectral density / its maximum at each wave vector")
    return figure


main = script(__name__, Sheet.load, table, draw, ("folder", "folder of a kicked sheet"))
