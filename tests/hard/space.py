"""Spheres in space: layers on a substrate, hcp, fcc under load and thin plates, beside the network; loads that buckle.

The network starts from the first snapshot of the run and has no time step. Amplitude and phase of a long run are those
of the linear wave of `analysis`, at the frequency to which the step turns it.
"""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from cases.layer.monolayer import Layer
from granular_analysis.measure.signals import recorded
from granular_analysis.theory.scenes import Setting
from granular_analysis.tools.compare import compare
from granular_lmp import Record, Scene, run
from granular_lmp.errors import CrystalError
from granular_lmp.lammps.deck import deck_of
from granular_lmp.problem import prepare
from granular_lmp.rest.at_rest import contacts_of
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import edited

STEP = 0.02
QUARTER = {"packing.rows": 8, "wave.wavenumber": pi / 4}
_LAYER = Scene.load("monolayer_rocking").with_values({**QUARTER, "output.particles": 0.0})
WAVES: dict[str, tuple[str, dict[str, Any], str]] = {
    "hcp next to a zone edge": (
        "hcp_c_axis",
        {"packing.rows": 18, "wave.wavenumber": 8 * pi / 18, "wave.mode": "6"},
        "two spheres a cell: branches stick together at the edge, and 2k lies in another zone",
    ),
    "fcc under load": (
        "fcc_transverse",
        QUARTER | {"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-6, "wave.amplitude": 0.3},
        "contacts that push and turn push on, sideways",
    ),
    "plate of 12 layers on a substrate": (
        "multilayer",
        {"packing.rows": 4, "packing.layers": 12, "wave.wavenumber": pi / 2, "wave.mode": "5"},
        "72 branches, of which some are close",
    ),
}


def _ran(scene: Scene, edits: Edits) -> Record:
    deck = deck_of(prepare(scene))
    with tempfile.TemporaryDirectory() as folder:
        record = run(replace(deck, input_text=edited(deck.input_text, edits)), Path(folder) / "run")
        return record.with_signals(**_beside_network(record))


def _beside_network(record: Record) -> dict[str, Any]:
    """Return what the recorded components are less those of the network, in D0."""
    found = compare(record, theory="network").signals
    assert found is not None
    return {name: values - expected for (name, values), expected in zip(recorded(record).items(), found, strict=True)}


def _error(record: Record) -> float:
    return float(max(np.abs(values).max() for name, values in record.signals.items() if name in recorded(record)))


def wave(name: str, edits: Edits = (), duration: float = 10.0) -> Cases:
    """A wave in space against the network of all spheres."""
    shipped, values, hard = WAVES[name]
    times = {"time.timestep": STEP, "time.duration": duration, "output.particles": duration}
    scene = Scene.load(shipped).with_values({**values, **times})
    turned = prepare(scene).wave.mode.frequency * STEP
    return [
        Case(
            f"{name}, branch {scene.wave.mode}, ξ = {scene.wavenumber:.4g}, τ ≤ {duration:g}: error in D0",
            hard,
            _error(_ran(scene, edits)),
            "phase (ΩΔτ)²Ωτ/24 and amplitude (ΩΔτ)²/8 of Verlet, half as much again for harmonics",
            most=1.5 * turned**2 * (turned / STEP * duration / 24 + 1 / 8),
        )
    ]


def leaving(edits: Edits = (), step: float = 0.005, duration: float = 15.0) -> Cases:
    """A vertical wave so strong that spheres leave their substrate and come back."""
    a = 3.0
    times = {"time.timestep": step, "time.duration": duration, "output.particles": duration}
    scene = _LAYER.with_values({"wave.mode": "S2", "wave.amplitude": a, **times})
    record, sphere = _ran(scene, edits), scene.sphere
    opened = record.info["guards"]["open_contacts"]["value"]
    events = 2 * prepare(scene).wave.mode.frequency * duration / (2 * pi)  # of each sphere: it leaves, and comes back
    pull = contacts_of(scene).adhesive_force.max() / (sphere.mass * sphere.static_overlap / sphere.time_scale**2)
    where = f"vertical wave, a = {a:g}, τ ≤ {duration:g}"
    return [
        Case(f"{where}: contacts open at once", "the wall pulls until it lets go", opened, "required", least=1),
        Case(
            f"{where}: error in D0",
            "the force jumps by the adhesion of the wall where a sphere leaves it, at no time of a step's",
            _error(record),
            "each event is missed by up to half a step: FΔτ/2m of velocity for the rest of the run, added at random",
            most=float(pull * step / 2 * duration * sqrt(events) / a),
        ),
    ]


def kept(steps: int, edits: Edits = ()) -> Cases:
    """Amplitude and phase of a long run of a rocking wave, so weak that it is linear."""
    step, a = 0.1, 1e-4
    duration = steps * step
    times = {"time.timestep": step, "time.duration": duration, "time.sample": duration, "output.particles": duration}
    scene = _LAYER.with_values({"wave.mode": "S1", "wave.amplitude": a, **times})
    deck = deck_of(prepare(scene))
    with tempfile.TemporaryDirectory() as folder:
        record = run(replace(deck, input_text=edited(deck.input_text, edits)), Path(folder) / "run")
        snapshots = record.snapshots()
        mode, row = Setting(scene).mode(), snapshots.crystal.arrays["row"] - scene.shape.centre_row
        weight = np.exp(-1j * scene.wavenumber * row)[:, None] * mode.shape[0].conj() * [1, 1, 1, 0.4, 0.4, 0.4]
        parts = [
            np.sum(weight * np.hstack([each.displacement, each.rotation])) for each in (snapshots[0], snapshots[1])
        ]
    own = float(mode.frequency) * scene.sphere.time_scale
    turned = 2 * np.arcsin(own * step / 2) / step * duration
    left = parts[1] / parts[0] * np.exp(1j * turned)
    where = f"rocking wave of a layer, a = {a:g}, Δτ = {step:g}, {steps:.0e} steps"
    return [
        Case(
            f"{where}: amplitude lost",
            "turns, walls and shear history of a million steps",
            float(abs(abs(left) - 1)),
            "Verlet takes nothing, but (ΩΔτ)²/8 at each end; rounding is far below",
            most=(own * step) ** 2 / 4,
        ),
        Case(
            f"{where}: phase in rad",
            "an error of the frequency of 1e-6 shows",
            float(abs(np.angle(left))),
            "required: 1e-6 of the phase, where the frequency of Verlet is known",
            most=1e-6 * turned,
        ),
    ]


def buckling(load: Callable[[Layer, np.ndarray], Any] = Layer.buckling_load) -> Cases:
    """The load at which a layer is refused, over the one at which it buckles."""
    smooth = {"effects.shear": False, "effects.rotation": False, "effects.tracking": False, "wave.mode": "1"}

    def scene(force: float) -> Scene:
        return _LAYER.with_values({**smooth, "packing.contact_force": force})

    def refused(force: float) -> bool:
        try:
            prepare(scene(force))
        except CrystalError:
            return True
        return False

    def buckles(force: float) -> bool:
        pressed = scene(force)
        contacts, sphere = contacts_of(pressed), pressed.sphere
        pairs, (wall,) = contacts.vector[~contacts.on_wall, :2], contacts.normal_stiffness[contacts.on_wall]
        layer = Layer(pairs, sphere.mass, sphere.normal_stiffness, 0.0, float(wall), 0.0)
        corner = np.array([[4 * pi / 3, 0.0]]) / sphere.lattice_constant
        return bool(force > np.min(load(layer, corner)))

    # Where a bound is missed, the search ends at an end of the range
    buckling_load = _least(buckles, 1e-5, 1.8e-4)
    refused_load = _least(refused, 0.99 * buckling_load, 1.05 * buckling_load)
    return [
        Case(
            "load at which a layer without shear is refused, over that at which it buckles",
            "spheres leave their layer before any wave is run",
            refused_load / buckling_load,
            "waves are looked at on a grid: a load may pass that is 2 % too large, and none is refused that bears",
            least=0.9999,
            most=1.02,
        )
    ]


def _least(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Return the least force, N, of a range of which something holds, to 2e-5."""
    while high > (1 + 2e-5) * low:
        middle = sqrt(low * high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
