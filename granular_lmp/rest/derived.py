"""Properties derived from the tables of a scene: spheres at rest, units, shape, wave vector, words, echo times."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from granular_lmp.crystal.lattices import ENDS_OF_Y, FREE, QUIET, WALL, Lattice, Shape
from granular_lmp.crystal.mode import Physics
from granular_lmp.crystal.scale import Scale
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.stiffnesses import measured_factors
from granular_lmp.crystal.walls import Wall
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property
from granular_lmp.rest import remarks, words
from granular_lmp.rest.echo import echo_at
from granular_lmp.rest.frequency import hertz_of, wavenumbers_at
from granular_lmp.rest.holding import AT_REST, LOOSE, HeldAtRest, Holding
from granular_lmp.rest.pattern import patterned
from granular_lmp.rest.shape import Room, decide, declared_shape
from granular_lmp.rest.space import lattice_of, remarks_on_space, space_of, wall_of
from granular_lmp.scene.declaration import Declaration
from granular_lmp.scene.forms import NO_WAVE, Form
from granular_lmp.scene.sections import Wave
from granular_lmp.scene.sources import Source
from granular_lmp.scene.strikers import stretch
from granular_lmp.scene.without_wave import holds
from granular_lmp.units import AnyUnits, OwnUnits, units_for

DEVIATIONS = 10.0  # standard deviations of an envelope that fit into an "auto" packing, which cuts it off below 4e-6


class Derived(Declaration):
    """Values of a scene that are not declared (`granular_lmp.rest.scene.Scene`)."""

    @cached_property
    def sphere(self) -> Sphere:
        """Sphere of the lattice at rest, with its contact force, adhesion and measured stiffnesses."""
        material = self.material.unloaded if self.start.touching and self.wave is None else self.material
        adhesion = 0.0 if self.effects.adhesion is False else material.work_of_adhesion
        sphere = replace(material, work_of_adhesion=adhesion, contact_force=self.packing.contact_force)
        if not sphere.static_overlap:  # the check of the sphere reports the value with which nothing presses a contact
            return sphere
        return replace(sphere, factors=measured_factors(self.contact, sphere.contact_law, sphere.contact_force))

    @cached_property
    def scale(self) -> Scale:
        """Units of the scene: m, Δ0 and t0 of spheres held at rest, else the units of the impact."""
        return self.holding.scale(self)

    @cached_property
    def space(self) -> int:
        """Dimensions in which the spheres move: 2, the plane, or 3."""
        return space_of(self.packing, self.lattice, self.substrate)

    @cached_property
    def wall(self) -> Wall | None:
        """Law of the contacts with the substrate; None without a substrate."""
        return wall_of(self.material, self.substrate, self.effects)

    @cached_property
    def rigid(self) -> Wall | None:
        """Law of the contacts with rigid planes at the faces of a crystal at rest; None without planes."""
        return self.holding.rigid(self) if WALL in self.shape.faces.values() else None

    @property
    def physics(self) -> Physics:
        """Degrees of freedom of the lattice; any that is still "auto" counts as present."""
        return replace(self.effects.physics, space=self.space == 3)

    @property
    def quiet(self) -> tuple[str, ...]:
        """Ends before which rows absorb, "first" and "last": the ends declared as quiet, or all held ends."""
        if self.absorb.rows == 0:
            return ()
        faces = {name: getattr(self.packing, name) for name in ENDS_OF_Y}
        declared = tuple(name for name, face in faces.items() if face == QUIET)
        return declared or tuple(name for name, face in faces.items() if face not in (FREE, WALL))

    @property
    def absorbing(self) -> tuple[str, ...]:
        """Quiet ends that absorb: all that are not a source of waves themselves."""
        ends = {"first": 0, "last": self.shape.rows - 1}
        driven = ("first",) if self.form.driven else ()
        moved = {name for name, row in ends.items() if any(each.is_in_row(row) for each in self.source)}
        return tuple(name for name in self.quiet if name not in {*driven, *moved})

    @cached_property
    def holding(self) -> Holding:
        """Return what holds the spheres at rest: adhesion or a load, or nothing."""
        sheet = lattice_of(self.packing, self.substrate).sheet
        adhesion, force, touching = self.material.work_of_adhesion, self.packing.contact_force, self.start.touching
        held = self.wave is not None or holds(adhesion, force, sheet=sheet, touching=touching)
        return AT_REST if held else LOOSE

    @property
    def held_at_rest(self) -> bool:
        """True if adhesion or a load holds the spheres at rest, as in every scene with a wave."""
        return isinstance(self.holding, HeldAtRest)

    @property
    def units(self) -> AnyUnits:
        """Units of the deck: the units of an impact, else a metric style of LAMMPS."""
        scale, radius = self.scale, self.material.radius
        return OwnUnits(scale.mass, radius, scale.time) if scale.of_impact else units_for(radius)

    @property
    def displacement_amplitude(self) -> float:
        """D0 = a Δ0, m: displacement amplitude of the wave; without a wave, the unit of displacement."""
        return self.amplitude * self.scale.length

    @property
    def amplitude(self) -> float:
        """Amplitude a = D0/Δ0 of the wave; 1 without a wave."""
        return 1.0 if self.wave is None else self.wave.amplitude

    @cached_property
    def drives(self) -> tuple[Source, ...]:
        """Sources, with the samples of measured drives in the units of the scene."""
        found = []
        for number, each in enumerate(self.source, 1):
            try:
                found.append(each.in_units(self))
            except SceneError as error:
                raise SceneError(f"source {number}: {error}", because=error.because) from error
        return tuple(found)

    def require_wave(self, why: str = "and no wave with a mode") -> Wave:
        """Return the wave of the scene.

        Raises
        ------
        SceneError
            If the scene has no wave; `why` ends the sentence.
        """
        if self.wave is None:
            raise SceneError(f"wave: missing table; this scene has sources, strikers or a [start] alone, {why}")
        return self.wave

    @cached_property
    def form(self) -> Form:
        """Form of the wave; also "none" without a wave."""
        return NO_WAVE if self.wave is None else self.wave.known

    @cached_property
    def lattice(self) -> Lattice:
        """Lattice of the packing."""
        return self.holding.stiff(lattice_of(self.packing, self.substrate), self)

    @cached_property
    def wave_lattice(self) -> Lattice:
        """Lattice in whose mode the wave starts.

        It is the lattice without inclusions. Only if the mode is the number of a branch, in a lattice whose waves are
        L, TR and RT, do its rows differ in a pattern.
        """
        wave, lattice = self.wave, self.lattice
        if wave is None or not (wave.mode.isdecimal() and self.inclusion) or lattice.cell_size > 1 or self.space == 3:
            return lattice
        return patterned(lattice, self.packing, self.material.density, self.inclusion, self.pair, wave.mode)

    @cached_property
    def wavenumbers(self) -> tuple[float, ...]:
        """Wave numbers at which the mode has the declared frequency, ascending, rad per row; () if none is declared."""
        wave = self.wave
        if wave is None or wave.frequency is None:
            return ()
        wanted = wave.frequency, self.sphere, self.physics, wave.mode, wave.degrees
        return wavenumbers_at(*wanted, self.wave_lattice, self.wall)

    @cached_property
    def declared_vector(self) -> WaveVector:
        """Wave vector as declared."""
        return self.require_wave().vector(self.lattice)

    @cached_property
    def shape(self) -> Shape:
        """Rows, columns and faces of the packing with every "auto" decided."""
        packing = self.packing
        if self.wave is None:
            return declared_shape(packing, self.lattice)
        return decide(
            packing.rows,
            packing.columns,
            packing.ends,
            self.declared_vector,
            self.time.duration,
            room=self._room,
            driven=self.form.driven,
            lattice=self.lattice,
            first=packing.first,
            last=packing.last,
            sides=packing.sides,
            layers=packing.layers,
        )

    @property
    def _room(self) -> Room:
        """Room for the envelope, including its offset between walls, or its travelled distance in a periodic cell."""
        envelope, (x, y) = self.envelope, self.declared_vector.unit
        rows, columns = (DEVIATIONS * deviation for deviation in envelope.spread(self.declared_vector))
        way = self.lattice.fastest * self.time.duration if envelope.length else 0.0
        way *= max(1, self.form.halves)  # the two halves separate and must not meet again
        return Room(
            strip=rows + 2 * abs(envelope.offset),
            rows=rows + way * abs(y),
            columns=columns + way * abs(x) * self.lattice.row_spacing,
            along=envelope.length > 0,
        )

    @cached_property
    def vector(self) -> WaveVector:
        """Wave vector of the run: along periodic axes the nearest one that fits the cell.

        In a crystal at rest it is the declared one, as no wave has to fit the cell.
        """
        if not self.form.waves:
            return self.declared_vector
        shape = self.shape
        return self.declared_vector.snapped(
            shape.rows if shape.along_y else None, shape.columns if shape.along_x else None
        )

    @property
    def wavenumber(self) -> float:
        """Wave number ξ of the run, rad per row."""
        return self.vector.wavenumber

    @property
    def direction(self) -> float:
        """Direction of the wave in the run, degrees from x towards y."""
        return self.vector.direction

    @property
    def used(self) -> dict[str, Any]:
        """Values that replace declared ones because a periodic cell or a sample rounds them, by dotted key."""
        if self.wave is None:
            return remarks.used_step(self.time)
        hertz = partial(
            hertz_of,
            self.vector,
            self.sphere,
            self.physics,
            self.wave.mode,
            self.wave_lattice,
            self.wall,
        )
        return remarks.used_vector(self.declared_vector, self.vector, hertz) | remarks.used_step(self.time)

    @property
    def perfect(self) -> bool:
        """True if all spheres are equal and none is missing: each contact at rest is that of the infinite lattice.

        Spheres at a face have fewer contacts, and spheres at a rigid plane have another one with it.
        """
        return not self.inclusion and not self._differ and self.rigid is None

    @property
    def _differ(self) -> bool:
        """True if spheres differ one by one, at random or by a table."""
        disorder = self.disorder
        return any(
            (self.packing.table, disorder.radius, disorder.density, disorder.vacancies, disorder.stiffness),
        )

    @property
    def imperfections(self) -> str:
        """Imperfections in words, "" in a perfect lattice."""
        return words.imperfections(self.disorder, self.inclusion, self.packing.table)

    @property
    def layered(self) -> bool:
        """True if all spheres of a row are equal and none is at a side, so a plane wave along y moves them alike.

        In a film this holds for each layer; without faces along z a row includes all layers.
        """
        layers_alike = not (self.shape.along_z and any(each.layers for each in self.inclusion))
        alike = not self._differ and all(each.whole_rows for each in self.inclusion) and layers_alike
        return not self.lattice.sheet or self.shape.along_x and alike

    @property
    def along(self) -> str:
        """Direction of the wave in words: "y", "x", "-y", or "49.1066 degrees"."""
        return {0.0: "x", 90.0: "y", -90.0: "-y", 180.0: "-x"}.get(self.direction, f"{self.direction:.6g} degrees")

    @property
    def label(self) -> str:
        """Short name of the scene, for its repr: "TR xi=0.802 a=0.2"; without a wave `words`."""
        if self.wave is None:
            return self.words
        along = "" if self.along == "y" else f" along {self.along}"
        return f"{self._shaken}{self.wave.words} xi={self.wavenumber:g}{along} a={self.wave.amplitude:g}"

    @cached_property
    def struck(self) -> bool:
        """True if strikers or a state move spheres at the beginning, apart from the wave."""
        return bool(self.striker or self.start.moves)

    @property
    def strike(self) -> float:
        """Bound on stretch and slip due to strikers and a state, Δ0 (`granular_lmp.scene.strikers.stretch`)."""
        return stretch(self.striker, self.start, self.sphere) if self.struck else 0.0

    @property
    def _moved(self) -> float:
        """Bound on stretch and slip due to strikers, a state and sources, Δ0."""
        return self.strike + max((each.largest for each in self.drives), default=0.0) * self.amplitude

    @property
    def _shaken(self) -> str:
        """Words for the number of sources and strikers, to stand before the wave; "" if there are none."""
        return words.shaken(self.source, self.striker, self.start, self.wave)

    @property
    def words(self) -> str:
        """Title of the scene: size and strikers, or its wave.

        "TR wave along y, xi = 0.802 rad per row, D0 = 0.2 Delta0"
        """
        if self.wave is not None:
            return (
                f"{self._shaken}{self.wave.words} {self.envelope.kind} along {self.along}, "
                f"xi = {self.wavenumber!r} rad per row, D0 = {self.wave.amplitude!r} Delta0"
            )
        held = words.held_by(self.sphere, self.disorder.radius if self.scale.of_impact and self.lattice.sheet else 0.0)
        return words.of_strikes(self.shape, held, self.striker, self.start, self.source)

    def remarks(self) -> list[str]:
        """Return sentences on changes that made the scene fit, on disorder, and on a more suitable adhesion law."""
        physics = remarks.on_law(self.material, self.effects)
        physics += remarks.on_disorder(self.disorder, self.sphere, self.packing, self.wave)
        if self.wave is None:
            return physics + remarks.on_step(self.time)
        said = remarks.on_packing(self.packing, self.shape) + remarks.on_vector(self.wave, self.shape, self.vector)
        if self.wavenumbers:
            said = remarks.on_frequency(self.wave, self.wavenumbers) + said
        said += physics + remarks_on_space(self.lattice, self.substrate, self.space)
        return said + remarks.on_step(self.time)

    @property
    def echo_time(self) -> float:
        """Time τ at which the echo of the faces reaches the centre sphere; infinite if there is no echo."""
        row, column = self.shape.centre_row, self.shape.columns // 2
        return self.echo_at((row, row), (column, column))

    def echo_at(self, rows: Sequence[int], columns: Sequence[int]) -> float:
        """Return the time τ at which the echo of the faces reaches a block of spheres in a perfect lattice.

        `rows` and `columns` of the block are (first, last).
        """
        pushed = (*self.source, *self.striker, *self.start.at())
        return echo_at((rows, columns), pushed, self.shape, form=self.form, quiet=self.quiet)
