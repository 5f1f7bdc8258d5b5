"""Run a collision as a scene, and read off the contact: overlap, force, contact time, restitution."""

import json
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.tolerance import run as run_scene
from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.lammps.outputs import csv_text, writable
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.engine import Engine
from granular_lmp.runs.record import Record
from granular_lmp.scene.collision import Collision

__all__ = ["run"]

DECLARED = "collision.toml"
COURSE = "collision.csv"
RESULT = "collision.json"
FEWEST_RECORDS = 4  # fewest records of a contact for the cubic in `Result.contact_time`


@dataclass(frozen=True, repr=False)
class Result:
    """Course of a collision, in SI units: T records of B = 1 or 2 bodies.

    Attributes
    ----------
    time : (T,) array
        Time since first touch, s.
    overlap : (T,) array
        Overlap δ, m; negative after the bodies have separated, and with the law "jkr" shortly before.
    normal_force, tangential_force : (T,) arrays
        Force on the first sphere, N; repulsion and a push along +y are positive.
    velocity : (T, B, 2) array
        Normal (x) and tangential (y) velocity, m/s.
    spin : (T, B) array
        Angular velocity, rad/s.
    folder : Path
        Run folder.
    kernel : bool
        True if the kernel computed the contact.
    engine : Engine or None
        Engine that took the steps in place of LAMMPS.
    """

    collision: Collision
    time: NDArray[np.float64]
    overlap: NDArray[np.float64]
    normal_force: NDArray[np.float64]
    tangential_force: NDArray[np.float64]
    velocity: NDArray[np.float64]
    spin: NDArray[np.float64]
    folder: Path
    kernel: bool = False
    engine: Engine | None = None

    @cached_property
    def largest_overlap(self) -> float:
        """Largest overlap δ_m, m: the maximum of the parabola through the three highest records."""
        return _peak(self.overlap)

    @cached_property
    def largest_force(self) -> float:
        """Largest repulsion, N."""
        return _peak(self.normal_force)

    @cached_property
    def touching(self) -> int:
        """Number of records before the bodies separate, δ > −`Collision.pull_off_distance`; T if they do not."""
        apart = self.overlap < -self.collision.pull_off_distance
        return int(np.argmax(apart)) if apart.any() else len(apart)

    @cached_property
    def sticks(self) -> bool:
        """True if adhesion holds the bodies together: the overlap has reversed twice, and they touch to the end.

        Without damping they oscillate about the overlap at rest.
        """
        turns = np.count_nonzero(np.diff(np.sign(np.diff(self.overlap))))
        return self.touching == len(self.overlap) and bool(turns > 1)

    @cached_property
    def contact_time(self) -> float:
        """Time from first touch to separation, s: the root of the cubic through the last four records.

        Only records in contact are used, because the acceleration jumps where adhesion ends. The time is infinite for
        bodies that stick.
        """
        if self.sticks:
            return inf
        last = slice(self.touching - FEWEST_RECORDS, self.touching)
        beyond = self.overlap[last] + self.collision.pull_off_distance
        roots = np.polynomial.Polynomial.fit(self.time[last], beyond, 3).roots()
        return float(roots[np.argmin(abs(roots - self.time[self.touching - 1]))].real)

    @property
    def restitution(self) -> float:
        """Coefficient of restitution e: velocity after over velocity before, along x; 0 if the bodies stick."""
        if self.sticks:
            return 0.0
        normal = self.velocity[:, :, 0]
        closing = normal[:, 0] - (normal[:, 1] if normal.shape[1] > 1 else 0.0)
        return float(-closing[-1] / closing[0])

    def numbers(self) -> dict[str, float]:
        """Return the results of the collision, by name with the unit.

        Velocities and spins are those after the collision; bodies that stick have none, and no contact time.
        """
        named = {"largest_overlap_m": self.largest_overlap, "largest_force_N": self.largest_force}
        if self.sticks:
            return named | {"restitution": self.restitution}
        named |= {"contact_time_s": self.contact_time, "restitution": self.restitution}
        for body in range(self.spin.shape[1]):
            x, y = self.velocity[-1, body]
            named |= {f"vx{body + 1}_m_s": float(x), f"vy{body + 1}_m_s": float(y)}
            named[f"spin{body + 1}_rad_s"] = float(self.spin[-1, body])
        return named

    def errors(self) -> dict[str, float]:
        """Return the difference of each of `numbers` from a run with twice the step.

        The difference is three times the error of a number of second order in the step. It equals the error of a number
        of first order (damping, adhesion, the law "incremental"). It fails for the final velocity of adhesive spheres:
        the contact ends abruptly at any moment of a step, so the error may be F Δt/m* although the difference is small.

        Raises
        ------
        SceneError
            If the bodies stick with one of the steps and separate with the other.
        """
        impact = self.collision.collision
        coarse = replace(self.collision, collision=replace(impact, steps=impact.steps // 2))
        with tempfile.TemporaryDirectory() as folder:
            other = run(coarse, Path(folder) / "coarse", kernel=self.kernel, engine=self.engine)
        if other.sticks != self.sticks:
            words = ("part", "stick")
            raise SceneError(
                f"collision.steps = {impact.steps!r}: the bodies {words[self.sticks]}, and {words[other.sticks]} with "
                "half as many; use more steps, or another collision.normal_velocity"
            )
        there = other.numbers()
        return {name: abs(value - there[name]) for name, value in self.numbers().items()}


def _peak(values: NDArray[np.float64]) -> float:
    top = int(np.argmax(values))
    before, here, after = values[top - 1 : top + 2]
    return float(here + (after - before) ** 2 / (8 * (2 * here - before - after)))


def scene_of(collision: Collision) -> Scene:
    """Return the scene in which the bodies of a collision meet."""
    try:
        return Scene.from_dict(collision.scene_tables())
    except SceneError as error:
        raise SceneError(f"collision: as a scene, {error}", because=error.because) from error


def run(
    collision: Collision,
    folder: str | Path,
    *,
    force: bool = False,
    kernel: bool | None = None,
    engine: Engine | None = None,
) -> Result:
    """Run the scene of a collision in `folder`, which is created, and return its course.

    The folder is an ordinary run folder with ``collision.toml`` and ``collision.csv``. `kernel` and `engine` are as in
    `granular_lmp.run`.

    Raises
    ------
    RunFolderError
        If the folder exists (without `force`) or cannot be written.
    SceneError
        If the bodies still touch at the end of the run, or touch for too few steps; the folder is kept.
    LammpsMissingError, LammpsError, EffectError
        As in `granular_lmp.run`.
    """
    folder = absolute(folder)
    record = run_scene(scene_of(collision), folder, force=force, kernel=kernel, engine=engine)
    result = replace(course(collision, record, folder), engine=engine)
    with writable(folder):
        (folder / DECLARED).write_text(collision.to_toml(full=True), encoding="utf-8")
        (folder / COURSE).write_text(_table(result), encoding="utf-8")
    if result.touching == len(result.overlap) and not result.sticks:
        times = collision.collision.duration
        raise SceneError(f"collision.duration = {times!r}: the bodies still touch; use more elastic contact times")
    lasted = result.touching
    if lasted < FEWEST_RECORDS or np.argmax(result.overlap) == 0:
        raise SceneError(
            f"collision.steps = {collision.collision.steps!r}: the bodies touch in {lasted} records only, but peak and "
            f"end need {FEWEST_RECORDS}; use more steps"
        )
    return result


def write_numbers(result: Result, errors: Mapping[str, float]) -> None:
    """Write `Result.numbers` and their errors into ``collision.json`` of the run folder."""
    table = {name: {"value": value, "error": errors[name]} for name, value in result.numbers().items()}
    with writable(result.folder):
        (result.folder / RESULT).write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")


def course(collision: Collision, record: Record, folder: Path) -> Result:
    """Return the course of a collision from the record of its scene, in SI units."""
    scale, radius = record.scale, collision.sphere.radius
    displacement, velocity = (
        _turned(values) * unit
        for values, unit in ((record.displacement, scale.length), (record.velocity, scale.velocity))
    )
    push = _turned(record.signals["force"])[:, 0] * (scale.mass * scale.length / scale.time**2)
    if collision.on_plane:
        normal = np.broadcast_to([1.0, 0.0], push.shape)
        overlap = displacement[:, 0, 0]
    else:
        apart = [2 * radius, 0.0] + displacement[:, 1] - displacement[:, 0]
        distance = np.hypot(*apart.T)
        normal = apart / distance[:, None]
        overlap = 2 * radius - distance
    declared = [collision.collision.spin, collision.collision.partner_spin][: velocity.shape[1]]
    return Result(
        collision=collision,
        time=record.tau * scale.time,
        overlap=overlap,
        normal_force=-np.einsum("ti,ti->t", push, normal),
        tangential_force=normal[:, 0] * push[:, 1] - normal[:, 1] * push[:, 0],
        velocity=velocity,
        spin=record.spin * (scale.velocity / radius) if collision.rubs else np.tile(declared, (len(push), 1)),
        folder=folder,
        kernel="kernel" in record.info,
    )


def _turned(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors of the scene, (..., 2), along the normal and the tangent of the collision: y and −x."""
    return np.stack([vectors[..., 1], -vectors[..., 0] + 0.0], axis=-1)


def _table(result: Result) -> str:
    rows = np.column_stack([result.time, result.overlap, result.normal_force, result.tangential_force])
    return csv_text(["time_s", "overlap_m", "normal_force_N", "tangential_force_N"], rows.tolist())
