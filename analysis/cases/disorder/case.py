"""Contacts and waves in disordered crystals: contacts left, attenuation, sound speed, and the second harmonic.

    granular-analysis disorder SWEEP... [-o FILE]

Each SWEEP is the folder of a sweep over `disorder.seed` (``granular-lmp sweep``); ``make disorder`` makes all. The
scene of a run decides its use: runs without snapshots give the remaining contacts; runs with `disorder.density` the
attenuation, compared with Born's theory (`cases.defects.born`); L waves with `disorder.radius` the sound speed; TR
waves, run with `wave.phase` 0 and π, the second harmonic. `cases.disorder.measures` defines each quantity.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.defects.born import long_wave, scattered
from cases.disorder.measures import (
    Key,
    Waves,
    attenuation,
    contacts_left,
    fundamentals,
    half,
    measured,
    perfect_strength,
    resonance,
    second_harmonics,
)
from cases.runner import script
from granular_analysis.measure.disordered import Value, refuse, strength, whole_strength
from granular_analysis.plotting import COLOURS, page
from granular_analysis.theory.wave import resonance as perfect_resonance
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]

# Mean contacts per sphere of one crystal of 1020 spheres, by another protocol: the first trial of this study
TRIAL = {0.12: 6.0, 0.4: 5.996, 0.8: 5.737, 1.2: 5.428, 2.0: 5.12, 4.0: 4.714, 12.0: 4.271, 40.0: 3.971}
HOLDS = {0.0: ("adhesion", "C0", "o"), 1.0: ("compression", "C1", "s")}
RESONANCE = 1.8  # TR wave numbers below belong to the resonance (1.476), above to the antiresonance (2.129)
SETTLED = 10.0  # τ before which the scattered field still depends on the start, and does not decay yet
SHORT = 40.0  # shorter duration, τ, for which the half height is printed too


@dataclass(frozen=True)
class Found:
    """Results of the sweeps, by the kinds of runs."""

    contacts: dict[tuple[float, float, float], Floats]
    density: dict[Key, Waves]
    sound: dict[Key, Waves]
    harmonics: dict[Key, Waves]
    amplitude: float  # D0/Δ0 of the TR waves

    @property
    def centre(self) -> float:
        """Return the wave number near the resonance that was run with the most spreads."""
        counts: dict[float, int] = {}
        for key in self.harmonics:
            if key.wavenumber < RESONANCE:
                counts[key.wavenumber] = counts.get(key.wavenumber, 0) + 1
        return max(counts, key=lambda xi: counts[xi])

    def over_spread(self, wavenumber: float, prestress: float) -> dict[float, Waves]:
        """Return the second harmonics of one wave number by s > 0, in the cell with the most seeds."""
        found: dict[float, Waves] = {}
        for key, waves in self.harmonics.items():
            if (key.wavenumber, key.prestress) == (wavenumber, prestress) and key.spread > 0:
                there = found.get(key.spread)
                if there is None or len(there.amplitudes) < len(waves.amplitudes):
                    found[key.spread] = waves
        return dict(sorted(found.items()))

    @property
    def shapes(self) -> dict[float, dict[float, Waves]]:
        """Return the resonances by s, with adhesion, in cells with four wave numbers or more."""
        cells: dict[tuple[float, tuple[int, int]], dict[float, Waves]] = {}
        for key, waves in self.harmonics.items():
            if key.prestress == 0 and key.wavenumber < RESONANCE:
                cells.setdefault((key.spread, key.cell), {})[key.wavenumber] = waves
        return {spread: waves for (spread, _), waves in sorted(cells.items()) if len(waves) >= 4}

    def perfect(self, wavenumber: float) -> Waves:
        """Return the second harmonic of the perfect crystal.

        Raises ValueError if no sweep has it.
        """
        for key, waves in self.harmonics.items():
            if (key.wavenumber, key.spread) == (wavenumber, 0.0):
                return waves
        raise ValueError(f"wave.wavenumber = {wavenumber:g} was not run in a perfect crystal (disorder.radius = 0)")


def read(records: Iterable[Record]) -> Found:
    """Return the results of runs, sorted by their scenes.

    Raises ValueError for runs with other features than disorder, and for incomplete pairs.
    """
    kinds: dict[str, list[Record]] = {name: [] for name in ("contacts", "density", "sound", "harmonics")}
    for record in records:
        refuse(record)
        scene = record.scene
        kind = "sound" if scene.require_wave().mode == "L" else "harmonics"
        if not scene.output.particles:
            kind = "contacts"
        elif scene.disorder.density:
            kind = "density"
        kinds[kind].append(record)
    amplitudes = {record.scene.amplitude for record in kinds["harmonics"]} or {0.0}
    if len(amplitudes) > 1:
        raise ValueError(f"wave.amplitude = {', '.join(map(str, sorted(amplitudes)))}: must be one for all TR waves")
    return Found(
        contacts_left(kinds["contacts"]),
        fundamentals(kinds["density"]),
        fundamentals(kinds["sound"]),
        second_harmonics(kinds["harmonics"]),
        amplitudes.pop(),
    )


def until(waves: Waves, duration: float) -> Waves:
    """Return the samples at τ ≤ duration."""
    early = waves.tau <= duration
    return waves._replace(tau=waves.tau[early], amplitudes=waves.amplitudes[:, early])


def half_height(found: Found, prestress: float, duration: float = np.inf) -> Value | None:
    """Return the s at which the resonance is half as strong as in the perfect crystal, root mean square up to a τ.

    None if the resonance stays above half.
    """
    perfect = strength(until(found.perfect(found.centre), duration).amplitudes)
    heights = {
        spread: measured(until(waves, duration)) for spread, waves in found.over_spread(found.centre, prestress).items()
    }
    if all(each.value >= perfect / 2 for each in heights.values()):
        return None
    return half(list(heights), list(heights.values()), perfect)


def speeds(sound: Mapping[Key, Waves]) -> dict[float, Value]:
    """Return the speed of long waves over that of the perfect crystal under the same force, by s."""
    found = {}
    for key, waves in sound.items():
        _, shift = attenuation(waves)
        found[key.spread] = Value(waves.frequency + shift.value, shift.error) / waves.frequency
    return found


def table(found: Found) -> str:
    """Return all numbers of the figure as text."""
    lines = []
    if found.contacts:
        lines.append("contacts per sphere\n   Delta0/2R friction        s      Z  error  seeds  trial")
    for (ratio, friction, spread), values in found.contacts.items():
        error = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
        trial = next((f"{z:7.3f}" for s, z in TRIAL.items() if np.isclose(s, spread, rtol=0.01)), "")
        lines.append(
            f"{ratio:12.3e}{friction:9.3g}{spread:9.3g}{values.mean():7.3f}{error:7.3f}{len(values):7d}{trial}"
        )
    if found.density:
        lines.append(
            "attenuation\n mode      xi   rate/sigma2      error  of theory  shift/sigma2     error  of theory"
        )
    for key, waves in found.density.items():
        rate, shift = (each / key.variance for each in attenuation(waves, SETTLED))
        theory = scattered(key.mode, key.wavenumber, waves.contact)
        lines.append(
            f"{key.mode:>5}{key.wavenumber:8.4f}{rate.value:14.4e}{rate.error:11.1e}{rate.value / theory.rate:11.3f}"
            f"{shift.value:14.4e}{shift.error:10.1e}{shift.value / theory.shift:11.3f}"
        )
    if found.sound:
        lines.append("sound speed over Hertz's\n       s   ratio    error")
    lines += [f"{spread:8.3g}{each.value:8.4f}{each.error:9.4f}" for spread, each in speeds(found.sound).items()]
    if found.harmonics:
        lines.append("second harmonic in D0\n      xi       s  pressed   coherent      error      whole  seeds")
    for key, waves in found.harmonics.items():
        value, whole = measured(waves), whole_strength(waves.amplitudes)
        lines.append(
            f"{key.wavenumber:8.4f}{key.spread:8.3g}{key.prestress:9.3g}{value.value:11.3e}{value.error:11.1e}"
            f"{whole:11.3e}{len(waves.amplitudes):7d}"
        )
    for spread, shape in found.shapes.items():
        parts = resonance(shape, found.amplitude)._asdict().items()
        text = ", ".join(f"{name} {each.value:.4f} +- {each.error:.4f}" for name, each in parts)
        lines.append(f"resonance at s = {spread:.3g}, beside the closed form: {text}")
    for prestress, (name, *_) in HOLDS.items() if found.harmonics else ():
        if found.over_spread(found.centre, prestress):
            for duration in (SHORT, found.perfect(found.centre).tau[-1]):
                at = half_height(found, prestress, duration)
                said = "beyond the spreads that were run" if at is None else f"s = {at.value:.3f} +- {at.error:.3f}"
                lines.append(f"half height under {name}, tau <= {duration:g}: {said}")
    return "\n".join(lines)


def draw(found: Found) -> Figure:
    """Return the figure with six panels: contacts, attenuation, sound; height, shape, antiresonance."""
    figure = page(8.6)
    panels = figure.subplots(3, 2).flat
    _contacts(panels[0], found)
    _attenuation(panels[1], found)
    _sound(panels[2], found)
    if found.harmonics:
        _heights(panels[3], found)
        _shapes(panels[4], found)
        _antiresonance(panels[5], found)
    for axes, letter in zip(panels, "abcdef", strict=True):
        if axes.has_data():
            axes.set_title(f"({letter}) {axes.get_title('left')}", loc="left")
        else:
            axes.set_axis_off()
    return figure


def _contacts(axes: Axes, found: Found) -> None:
    if not found.contacts:
        return
    axes.set_title("contacts left", loc="left")
    marks = iter([("C0", "o"), ("C1", "s"), ("C2", "^")])
    for crystals in sorted({(friction, ratio) for ratio, friction, _ in found.contacts}):
        rows = [
            (s, z.mean(), z.std() / max(len(z) - 1, 1) ** 0.5)
            for (ratio, friction, s), z in found.contacts.items()
            if (friction, ratio) == crystals
        ]
        friction, ratio = crystals
        rubbed = rf", let go with $\mu$ = {friction:g}" if friction else ""
        colour, mark = next(marks, ("tab:grey", "x"))
        s, z, error = np.transpose(rows)
        axes.errorbar(s, z, error, fmt=mark, color=colour, markersize=4, label=rf"$\Delta_0/2R$ = {ratio:.2g}{rubbed}")
    axes.plot(*np.transpose(list(TRIAL.items())), "k+", markersize=8, label="trial, one crystal")
    axes.axhline(4, color="black", linewidth=0.8, linestyle=":")
    axes.text(0.05, 4.04, "isostatic, no friction", transform=axes.get_yaxis_transform())
    axes.set(
        ylim=(2.9, 6.2),
        xscale="log",
        xlabel=r"spread of radii $s = \sigma\,2R/\Delta_0$",
        ylabel="contacts per sphere $Z$",
    )
    axes.legend(loc="lower left", borderaxespad=0.2)


def _attenuation(axes: Axes, found: Found) -> None:
    if not found.density:
        return
    axes.set_title("attenuation by unequal densities", loc="left")
    for name in ("L", "TR"):
        rows = [
            (key.wavenumber, *attenuation(waves, SETTLED)[0] / key.variance)
            for key, waves in found.density.items()
            if key.mode == name
        ]
        if not rows:
            continue
        contact = next(waves.contact for key, waves in found.density.items() if key.mode == name)
        xi, rate, error = np.transpose(rows)
        fine = np.geomspace(0.25, 2.6, 12)
        axes.errorbar(xi, rate, error, fmt="o", color=COLOURS[name], markersize=4, label=f"{name}, LAMMPS")
        axes.plot(
            fine, [scattered(name, each, contact).rate for each in fine], color=COLOURS[name], label=f"{name}, Born"
        )
        axes.plot(
            fine,
            [long_wave(name, each, contact) for each in fine],
            ":",
            color=COLOURS[name],
            label=rf"{name}, long waves, $q^3$",
        )
    axes.set(
        xscale="log", yscale="log", xlabel=r"wave number $\xi$ (rad per row)", ylabel=r"$\Gamma t_0/\sigma_\rho^2$"
    )
    axes.set_xticks([0.3, 0.5, 1, 2], ["0.3", "0.5", "1", "2"])
    axes.minorticks_off()
    axes.legend()


def _sound(axes: Axes, found: Found) -> None:
    if not found.sound:
        return
    axes.set_title("speed of long L waves, compressed", loc="left")
    rows = sorted((spread**-1.5, *each) for spread, each in speeds(found.sound).items())
    force, ratio, error = np.transpose(rows)
    hertz = force ** (1 / 6)
    axes.errorbar(force, ratio * hertz, error * hertz, fmt="ko", markersize=4, label="LAMMPS")
    line = np.geomspace(force[0], force[-1], 2)
    axes.plot(line, line ** (1 / 6), color="tab:grey", linewidth=1, label="equal spheres, $F^{1/6}$")
    axes.set(xscale="log", yscale="log", xlabel=r"force per contact / that at which $s = 1$")
    axes.set_ylabel("speed / that of equal spheres at $s = 1$")
    ticks = [tick for tick in (0.4, 0.6, 0.8, 1, 1.2, 1.6, 2) if 0.9 * min(ratio * hertz) < tick < 1.1 * hertz[-1]]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.legend()


def _heights(axes: Axes, found: Found) -> None:
    axes.set_title(rf"resonance, $\xi$ = {found.centre:.3f}", loc="left")
    perfect = strength(found.perfect(found.centre).amplitudes)
    for prestress, (name, colour, mark) in HOLDS.items():
        waves = found.over_spread(found.centre, prestress)
        if not waves:
            continue
        value, error = np.transpose([measured(each) / perfect for each in waves.values()])
        # At larger s, contacts that tear open hide the coherent part. If none is left, the error is 0 too
        known = (error > 0) & (error < 0.15)
        whole = [whole_strength(each.amplitudes) / perfect for each in waves.values()]
        marks: dict[str, Any] = {"color": colour, "markersize": 4}
        s = np.array(list(waves))
        axes.errorbar([0, *s[known]], [1, *value[known]], [0, *error[known]], fmt=f"{mark}-", label=name, **marks)
        axes.plot(list(waves), whole, f"{mark}:", markerfacecolor="white", **marks)
        if at := half_height(found, prestress):
            axes.errorbar([at.value], [0.5], xerr=[at.error], fmt="k|", markersize=10)
    axes.axhline(0.5, color="black", linewidth=0.8, linestyle=":")
    axes.set(xlabel=r"spread of radii $s = \sigma\,2R/\Delta_0$", ylabel="second harmonic /\nthat of equal spheres")
    axes.set(xlim=(0, None), ylim=(0, 1.5))
    axes.text(0.98, 0.97, "hollow: with\nincoherent part", transform=axes.transAxes, ha="right", va="top")
    axes.legend(loc="upper left")


def _shapes(axes: Axes, found: Found) -> None:
    if not found.shapes:
        return
    axes.set_title("resonance, adhesion", loc="left")
    for (spread, shape), colour in zip(found.shapes.items(), ("black", "C0", "C1", "C2"), strict=False):
        values = [measured(waves) for waves in shape.values()]
        heights = 1e3 * np.array([each for each in values])
        errors = np.nan_to_num(heights[:, 1])  # a perfect crystal has one seed
        axes.errorbar(
            list(shape), heights[:, 0], errors, fmt="o", color=colour, markersize=4, label=f"$s$ = {spread:.2g}"
        )
        fit = resonance(shape, found.amplitude)
        xi, waves = np.linspace(min(shape), max(shape), 100), next(iter(shape.values()))
        place = perfect_resonance(waves.contact) or np.nan
        stretched = place + (xi - place - fit.shift.value) / fit.width.value
        line = perfect_strength(stretched, waves.contact, found.amplitude, waves.tau)
        axes.plot(xi, 1e3 * fit.height.value * line, color=colour, linewidth=1)
    axes.set(xlabel=r"wave number $\xi$ (rad per row)", ylabel=r"second harmonic ($10^{-3} D_0$)", ylim=(0, None))
    axes.legend()


def _antiresonance(axes: Axes, found: Found) -> None:
    places = sorted({key.wavenumber for key in found.harmonics if key.wavenumber > RESONANCE})
    if not places:
        return
    axes.set_title(rf"antiresonance, $\xi$ = {places[0]:.3f}", loc="left")
    perfect = strength(found.perfect(found.centre).amplitudes)
    for prestress, (name, colour, mark) in HOLDS.items():
        waves = found.over_spread(places[0], prestress)
        if not waves:
            continue
        value, error = np.transpose([measured(each) for each in waves.values()]) / perfect
        seen = value > 3 * error  # smaller coherent parts may be chance, and are not drawn
        marks: dict[str, Any] = {"color": colour, "markersize": 4}
        axes.errorbar(np.array(list(waves))[seen], value[seen], error[seen], fmt=f"{mark}-", **marks, label=name)
        whole = [whole_strength(each.amplitudes) / perfect for each in waves.values()]
        axes.plot(list(waves), whole, f"{mark}:", markerfacecolor="white", **marks)
    floor = strength(found.perfect(places[0]).amplitudes) / perfect
    axes.axhline(floor, color="black", linewidth=0.8, linestyle=":", label="equal spheres")
    axes.set(yscale="log", xlim=(0, None), xlabel=r"spread of radii $s = \sigma\,2R/\Delta_0$")
    axes.set_ylabel("second harmonic /\nresonance of equal spheres")
    axes.legend(loc="upper left")


main = script(__name__, read, table, draw, ("sweeps", "sweeps over disorder.seed"))
