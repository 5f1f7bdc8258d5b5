"""The reference of a run: the signals that its record is compared with, p, q and φ, or without a wave all motions.

Most references are theories, functions of a plane wave (`granular_analysis.theory.choice.THEORIES`). Two are made from
the run:

* the *network*: all its spheres, from its first snapshot on, integrated without LAMMPS
  (`granular_analysis.theory.network`). It holds crystals that are not perfect, waves of any shape, and contacts that
  slide, open and form;
* *crystal-second-order*: first and second order in the crystal of its scene, of any lattice, also of layers, and of
  running and standing waves (`granular_analysis.theory.scenes`).

A run without a wave, of strikers and states alone, has the network only, of all spheres that it records; and so has a
run in space, of its recorded sphere.

The rule: the best theory of the wave; where none holds the run, the network, if it is not long (`MOST_UNASKED`); where
that cannot be, the second order of its crystal; where that leaves something out, nothing. The reference says why.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory.catalogue import CRYSTAL, NETWORK, OPENING, REFERENCES, SLIDING, missing
from granular_analysis.theory.choice import (
    Trajectory,
    best,
    holding,
    others_of,
    refuse_less,
    traits,
    trajectory,
)
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.wave import Wave
from granular_lmp.runs.record import GranularError, Record

Floats = NDArray[np.float64]

RTOL = 1e-9  # a thousandth of what LAMMPS's time step leaves
SLIDING_STEP = 1 / 80  # τ; leaves 3e-6 D0, of second order
# Spheres times τ that are integrated unasked: a quarter of a minute. Contacts that slide, or adhere and open, shorten
# the steps of all spheres (docs/network.md), so that each costs as many; Hertz's, whose force has no jump, cost fewer
MOST_UNASKED = 1e6
COSTS_AS_MANY = {"slide": 40, "snap": 40, "open": 8}


@dataclass(frozen=True, eq=False)
class Reference:
    """The signals that a run is compared with.

    Attributes
    ----------
    name : one of `granular_analysis.theory.catalogue.REFERENCES`; None if there is none.
    signals : at the times of the record, those that `granular_analysis.measure.signals.signals_of` says; None if there
    is none.
    reason : why it is neither a theory of a plane wave nor the network.
    """

    name: str | None
    signals: tuple[Floats, ...] | None
    reason: str = ""

    @classmethod
    def named(cls, name: str, record: Record, wave: Wave | None) -> Self:
        """Return the reference of a name.

        Raises TheoryError for a name that is none of `granular_analysis.theory.catalogue.REFERENCES`, a reference that
        leaves out what the run has, and for the network of a run without a first snapshot that it can be read from.
        """
        if name not in REFERENCES:
            raise TheoryError(f"theory = {name!r} is not one of {', '.join(REFERENCES)}")
        if name == NETWORK:
            return cls(name, _network(record, wave))
        if wave is None:
            none = "that has none" if record.scene.wave is None else "in space"
            raise TheoryError(
                f"theory = {name!r} is of a wave in the plane, and this is a run {none}; must be {NETWORK!r}"
            )
        return cls(name, _crystal(record, wave) if name == CRYSTAL else trajectory(name, wave, record.tau))

    @classmethod
    def of(cls, record: Record, wave: Wave | None) -> Self:
        """Return the reference of a run by the rule of this module, one without a name if there is none."""
        if wave is not None and holding(wave):
            return cls.named(best(wave, record.tau), record, wave)
        reasons, others = _against(record, wave), [CRYSTAL] if _holds_crystal(wave) else []
        for name in others if reasons else [NETWORK, *others]:
            try:
                return replace(cls.named(name, record, wave), reason=", and ".join(reasons))
            except TheoryError as error:
                reasons.append(str(error))
        return cls(None, None, ", and ".join(reasons))


def _traits(record: Record, wave: Wave | None) -> frozenset[str]:
    return others_of(record) if wave is None else traits(wave)


def _holds_crystal(wave: Wave | None) -> bool:
    return wave is not None and not missing(CRYSTAL, traits(wave))


def _against(record: Record, wave: Wave | None) -> list[str]:
    """Return all that stands against the network of a run, so that its user sees every reason at once."""
    lacks = missing(NETWORK, _traits(record, wave))
    found = [f"the network leaves out {', '.join(lacks)}"] if lacks else []
    try:
        first_snapshot(record)
    except (TheoryError, OSError, GranularError) as error:
        found += [] if str(error) in found else [str(error)]
    too_long = _too_long(record, wave)
    return [*found, too_long] if too_long else found


def _too_long(record: Record, wave: Wave | None) -> str:
    """Return why the network of a run is not integrated unasked, "" if it may be."""
    spheres, until = record.scene.shape.spheres, record.tau[-1]
    there, adheres = _traits(record, wave), record.scene.sphere.work_of_adhesion > 0
    case = "slide" if SLIDING in there else ("snap" if adheres else "open") if OPENING in there else ""
    most = MOST_UNASKED / COSTS_AS_MANY.get(case, 1)
    if spheres * until <= most:
        return ""
    return (
        f"{spheres} spheres until tau = {until:.6g} are above the {most:.0f} spheres times tau up to which the network "
        "is the default in a run like this; ask with --theory network"
    )


def _network(record: Record, wave: Wave | None) -> tuple[Floats, ...]:
    """Return the signals of a run in its network."""
    refuse_less(NETWORK, _traits(record, wave))
    try:
        first = first_snapshot(record)
        longest = SLIDING_STEP * first.time if np.isfinite(first.network.friction) else np.inf
        spheres = None if record.scene.wave is None else [first.recorded]
        times = record.tau * first.time
        run = integrate(first.network, first.state, times, rtol=RTOL, spheres=spheres, longest_step=longest)
    except (TheoryError, RuntimeError, OSError, GranularError) as error:
        raise TheoryError(f"theory = 'network': {error}") from error
    return first.fields(run) if record.scene.wave is None else first.signals(run)


def _crystal(record: Record, wave: Wave) -> Trajectory:
    """Return p, q, φ of the centre sphere to second order in the crystal of a run's scene."""
    refuse_less(CRYSTAL, traits(wave))
    try:
        first, second = Setting(record.scene).signals(record.tau)
    except TheoryError as error:
        raise TheoryError(f"theory = {CRYSTAL!r}: {error}") from error
    p, q, phi = (one + two for one, two in zip(first, second, strict=True))
    return p, q, phi
