"""Reference of a run: the signals with which its record is compared.

The signals of a wave are p, q and φ of one sphere; those of a run without a wave are all recorded motions.

Most references are theories, functions of a plane wave (`granular_analysis.theory.choice.THEORIES`). Two are made from
the run:

* the *network*: all spheres of the run, integrated without LAMMPS from the first snapshot on
  (`granular_analysis.theory.network`). It holds imperfect crystals, waves of any shape, and contacts that slide, open
  and form;
* *crystal-second-order*: first and second order in the crystal of the scene, for any lattice, layers included, and for
  running and standing waves (`granular_analysis.theory.scenes`).

A run without a wave (strikers and states alone) can only be compared with the network, in all spheres that it records;
a run in space only with the network, in its recorded sphere.

The default is the best theory of the wave. If no theory holds the run, the default is the network, unless the network
leaves something out, the run lacks a first snapshot, or it is long (`MOST_UNASKED`). Then the default is the second
order of the crystal. If that leaves something out too, there is no reference. `Reference.reason` says why.
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

RTOL = 1e-9  # a thousandth of the error that LAMMPS's time step leaves
SLIDING_STEP = 1 / 80  # longest step, τ, if contacts may slide: leaves an error of 3e-6 D0, of second order in the step
# Spheres times τ that the default integrates, a quarter of a minute. Contacts that slide, or adhere and open, shorten
# the steps of all spheres (docs/network.md): each then counts as 40 spheres. Hertz's contacts that open have a force
# without a jump, and each sphere counts as 8
MOST_UNASKED = 1e6
COSTS_AS_MANY = {"slide": 40, "snap": 40, "open": 8}


@dataclass(frozen=True, eq=False)
class Reference:
    """Signals with which a run is compared.

    Attributes
    ----------
    name : one of `granular_analysis.theory.catalogue.REFERENCES`; None without a reference.
    signals : signals at the times of the record, in the order of `granular_analysis.measure.signals.signals_of`; None
        without a reference.
    reason : why the reference is neither a theory of a plane wave nor the network; "" if it is one of the two.
    """

    name: str | None
    signals: tuple[Floats, ...] | None
    reason: str = ""

    @classmethod
    def named(cls, name: str, record: Record, wave: Wave | None) -> Self:
        """Return the reference with a name.

        Raises TheoryError for a name that is not in `granular_analysis.theory.catalogue.REFERENCES`, for a reference
        that leaves out a feature of the run, and for the network if the run has no readable first snapshot.
        """
        if name not in REFERENCES:
            raise TheoryError(f"theory = {name!r} is not one of {', '.join(REFERENCES)}")
        if name == NETWORK:
            return cls(name, _network(record, wave))
        if wave is None:
            why = "has no wave" if record.scene.wave is None else "is in space"
            raise TheoryError(f"theory = {name!r} needs a wave in the plane, and this run {why}; must be {NETWORK!r}")
        return cls(name, _crystal(record, wave) if name == CRYSTAL else trajectory(name, wave, record.tau))

    @classmethod
    def of(cls, record: Record, wave: Wave | None) -> Self:
        """Return the default reference of a run, see the module; if there is none, its name is None."""
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
    """Return every reason against the network of a run, so that the user sees all of them at once."""
    lacks = missing(NETWORK, _traits(record, wave))
    found = [f"the network leaves out {', '.join(lacks)}"] if lacks else []
    try:
        first_snapshot(record)
    except (TheoryError, OSError, GranularError) as error:
        found += [] if str(error) in found else [str(error)]
    too_long = _too_long(record, wave)
    return [*found, too_long] if too_long else found


def _too_long(record: Record, wave: Wave | None) -> str:
    """Return why the network of a run is too long for a default, "" if it is not."""
    spheres, until = record.scene.shape.spheres, record.tau[-1]
    there, adheres = _traits(record, wave), record.scene.sphere.work_of_adhesion > 0
    case = "slide" if SLIDING in there else ("snap" if adheres else "open") if OPENING in there else ""
    most = MOST_UNASKED / COSTS_AS_MANY.get(case, 1)
    if spheres * until <= most:
        return ""
    return (
        f"{spheres} spheres until tau = {until:.6g} exceed {most:.0f} spheres times tau, above which the network is "
        "not the default for such a run; use --theory network"
    )


def _network(record: Record, wave: Wave | None) -> tuple[Floats, ...]:
    """Return the signals of a run, as its network gives them."""
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
    """Return p, q, φ (T,) of the centre sphere in D0, to second order in the crystal of the scene."""
    refuse_less(CRYSTAL, traits(wave))
    try:
        first, second = Setting(record.scene).signals(record.tau)
    except TheoryError as error:
        raise TheoryError(f"theory = {CRYSTAL!r}: {error}") from error
    p, q, phi = (one + two for one, two in zip(first, second, strict=True))
    return p, q, phi
