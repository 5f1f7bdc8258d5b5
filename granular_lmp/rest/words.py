"""Scene in words, for titles and errors; each function takes the tables that it describes."""

from collections.abc import Sequence

from granular_lmp.crystal.disorder import Disorder, Inclusion
from granular_lmp.crystal.lattices import CHAIN, Shape
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.sphere_table import NO_TABLE, SphereTable
from granular_lmp.scene.sections import Wave
from granular_lmp.scene.sources import Source
from granular_lmp.scene.start import Start
from granular_lmp.scene.strikers import Striker, fastest_striker


def imperfections(disorder: Disorder, inclusions: Sequence[Inclusion], table: SphereTable = NO_TABLE) -> str:
    """Return imperfections in words, such as "radius 0.0001, seed 1, 2 inclusions"; "" in a perfect lattice."""
    spread = {"radius": disorder.radius, "density": disorder.density, "vacancies": disorder.vacancies}
    spread |= {"stiffness": disorder.stiffness}
    words = [f"{name} {value!r}" for name, value in spread.items() if value]
    drawn = bool(words) or any(each.share for each in inclusions)
    words += [f"seed {disorder.seed}"] if drawn else []
    words += ["spheres of a table"] if table else []
    count = len(inclusions)
    words += [f"{count} inclusion{'s' if count > 1 else ''}"] if count else []
    return ", ".join(words)


def shaken(sources: Sequence[Source], strikers: Sequence[Striker], start: Start, wave: Wave | None) -> str:
    """Return words for the number of sources and strikers, to stand before the wave; "" if there are none."""
    counts = {"source": len(sources), "striker": len(strikers), "state": bool(start.state)}
    said = [f"{count:d} {name}{'s' * (count > 1)}" for name, count in counts.items() if count]
    said += ["noise"] if start.noise else []
    return " and ".join(said) + (" beside " if wave and wave.known.waves else ", in units of the ") if said else ""


def across(wave: Wave | None, sources: Sequence[Source], start: Start) -> str:
    """Return the first key, with its value, that moves spheres across y or turns them; "" if there is none."""
    plain = wave is None or not wave.known.waves or wave.mode == "L"
    words = [] if plain or wave is None else [f"wave.mode = {wave.mode!r}"]
    for number, each in enumerate(sources, 1):
        kind = "motion" if each.motion else "force"
        words += [] if getattr(each, kind) == "y" else [f"source {number}: {kind} = {getattr(each, kind)!r}"]
    # Strikers and states that move spheres across a chain are refused in any scene
    words += ["start.state: a spin above 0"] if start.motion[:, 6:].any() else []
    return next(iter(words), "")


def of_strikes(shape: Shape, held: str, strikers: Sequence[Striker], start: Start, sources: Sequence[Source]) -> str:
    """Return size and start of a scene without a wave: "a chain of 60 spheres …, struck at 1 m/s".

    `held` is the result of `held_by`.
    """
    size = (
        f"a chain of {shape.rows} spheres"
        if shape.lattice == CHAIN
        else f"a {shape.lattice.name} sheet of {shape.rows} rows x {shape.columns} columns"
    )
    return f"{size} {held}, {moved(strikers, start, sources)}"


def moved(strikers: Sequence[Striker], start: Start, sources: Sequence[Source]) -> str:
    """Return what moves the spheres of a scene without a wave: "struck at 1 m/s"."""
    struck = [f"struck at {fastest_striker(strikers):.6g} m/s"] if strikers else []
    begins = ["which begins in a given state"] if start.state else []
    begins += [f"with random velocities of up to {start.noise:.6g} m/s"] if start.noise else []
    count = len(sources)
    shaken = [f"shaken by {count} source{'s' * (count > 1)}"] if count else []
    return ", ".join([*struck, *begins, *shaken])


def held_by(sphere: Sphere, gaps: float) -> str:
    """Return words for the hold of spheres: "that adhere", "that just touch"; `gaps` is their disorder."""
    if gaps:
        return f"with gaps (disorder.radius = {gaps:g})"
    pressed = [f"pressed together by {sphere.contact_force:.6g} N"] if sphere.contact_force else []
    adhere = ["that adhere"] if sphere.work_of_adhesion else []
    return " and ".join([*adhere, *pressed]) or "that just touch"
