"""The paper's figure 3: p, q and φ of the centre sphere at three wave numbers, LAMMPS over theory.

    python -m analysis.figure3 runs/tr_nonresonant runs/tr_resonant runs/tr_antiresonant [-o figures/figure3.png]

Upper row: transverse displacement q and rotation φ. Lower row: the longitudinal displacement p that the shear wave
makes. Three curves each: the run; the paper's order of theory with its misprints corrected; the best theory of this
folder for the wave. The numbers are relative L2 errors of the two theories against the run.
"""

import sys

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.compare import errors
from analysis.plotting import load, parser, save
from analysis.theories import THEORIES, Wave, best
from granular_lmp.record import Record


def draw(records: list[Record]) -> Figure:
    """One column a run."""
    figure = Figure(figsize=(4.2 * len(records), 6.4), layout="constrained")
    panels = figure.subplots(2, len(records), sharex="col", squeeze=False)
    for column, record in enumerate(records):
        upper, lower = panels[:, column]
        _column(upper, lower, record, "abcdefgh"[column], "abcdefgh"[len(records) + column])
    panels[0, 0].set_ylabel(r"$q = -u/D_0$,  $\phi = R\theta/D_0$")
    panels[1, 0].set_ylabel("$p = v/D_0$")
    # Outside the panels, where no curve is covered
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=6, frameon=False)
    figure.legend(*panels[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def _column(upper: Axes, lower: Axes, record: Record, first: str, second: str) -> None:
    wave = Wave.of(record)
    ours = best(wave)
    upper.plot(record.tau, record.q, color="black", linewidth=2.5, label="$q$: LAMMPS")
    upper.plot(record.tau, record.phi, color="tab:grey", linewidth=2.5, label=r"$\phi$: LAMMPS")
    lower.plot(record.tau, record.p, color="black", linewidth=2.5, label="LAMMPS")
    titles: dict[str, list[str]] = {"q": [], "phi": [], "p": []}
    for name, label, colour, dashes in (
        ("second-order", "the paper's order", "tab:cyan", "-"),
        (ours, "best theory", "tab:red", "--"),
    ):
        p, q, phi = THEORIES[name](wave, record.tau)
        for axes, values, shown in ((upper, q, label), (upper, phi, None), (lower, p, label)):
            axes.plot(record.tau, values, color=colour, linestyle=dashes, linewidth=1.0, label=shown)
        for component, error in errors(record, (p, q, phi)).items():
            titles[component].append("0" if error is None else f"{error:.1e}")
    upper.set_title(
        rf"({first})  {wave.mode.name}, $\xi$ = {wave.mode.wavenumber:.4g}; best: {ours}"
        "\n"
        rf"error $q$ {' → '.join(titles['q'])},  $\phi$ {' → '.join(titles['phi'])}",
        fontsize="medium",
    )
    lower.set_title(rf"({second})  error $p$ {' → '.join(titles['p'])}", fontsize="medium")
    lower.set_xlabel(r"time $\tau$")
    for axes in (upper, lower):
        axes.margins(x=0)
        axes.ticklabel_format(axis="y", scilimits=(-2, 3))


def main(argv: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    options = parser(__doc__, "figures/figure3.png")
    options.add_argument("runs", nargs="+", metavar="RUN", help="run folders, one a column")
    chosen = options.parse_args(argv)
    save(draw([load(folder) for folder in chosen.runs]), chosen.output)
    print(chosen.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
