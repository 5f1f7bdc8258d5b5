"""Lines of a deck that shake spheres: the driven row of a wave, and the sources of a crystal at rest.

Spheres are moved by ``fix move variable``. When LAMMPS computes contact forces, all other spheres have their velocities
of half a step earlier. A moved sphere therefore gets its last displacement divided by the step as its velocity; with
its present velocity the error would be of first order in the step (page Waves of any form).

A prescribed rotation uses ``fix set``, which sets spins and dipoles at the end of a step. The spin is the rotation of
the dipole during the next step, when contacts use it.

A torque uses ``fix efield`` on a dipole. In the plane the dipole also tracks the angle θ of a sphere: a field f along y
exerts the torque f cos θ on a dipole of length 1 along x. Scenes refuse torques that would turn spheres by more than
about 2e-3, where 1 − cos θ is 2e-6. In space a quaternion tracks the angle, and the dipole keeps its direction: normal
to the axis of the torque, with the field normal to both.

Samples are four vectors with the coefficients of a cubic polynomial in each interval; LAMMPS keeps the lists, and a
variable selects the entry. A deck needs no file beside its own two.
"""

from collections.abc import Callable
from dataclasses import replace

from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.blocks import apart
from granular_lmp.lammps.datafile import id_ranges
from granular_lmp.problem import Problem
from granular_lmp.scene.samples import pieces
from granular_lmp.scene.signals import SAMPLES
from granular_lmp.scene.sources import ROTATIONS, TORQUES, PlacedSource, Source

# LAMMPS evaluates a variable again wherever it is named, at every step, so constants are written as numbers
_STEP = "$(v_step/v_t0:%.17g)"
_NUMBERS_A_LINE = 5


@dataclass(frozen=True)
class _Signal:
    """Signal in the variable language of LAMMPS.

    It holds its kind, the suffix of its names, its factor, the duration of its ramp or burst, its phase and sweep, and
    the names of the variables for the time since it began, now and a step ago (or ahead). Samples also have their
    number of intervals, and their delay in intervals.
    """

    kind: str
    tag: str
    unit: str
    length: str
    phase: str
    sweep: str
    now: str
    beside: str
    intervals: int = 0
    late: float = 0.0

    def at(self, time: str, name: str, s: str) -> list[str]:
        """Return the lines that define s and the signal `name` at a time.

        Raises
        ------
        SceneError
            If the signal has no formula here.
        """
        if self.kind not in FORMULAS:
            raise SceneError(f'signal = "{self.kind}": has no formula in a deck; must be one of {", ".join(FORMULAS)}')
        if self.intervals:
            return self._of_samples(time, name, s)
        share, text = FORMULAS[self.kind](self, time, f"v_{s}{self.tag}[1]")
        return [self._kept(s, share), _line(name + self.tag, f"{self.unit}*{text}")]

    def _kept(self, name: str, expression: str) -> str:
        """Return the line of a value read more than once, as a vector of one entry, computed once per step."""
        return f"variable     {name + self.tag:6} vector v_once{self.tag}*({expression})"

    def share(self, time: str) -> str:
        """Return the time since the beginning over the duration of the ramp or burst."""
        begun = "" if time == "tau" else f"(v_{time}>0)*"  # the time of the run is never negative
        return f"ternary(v_{time}<{self.length},{begun}v_{time}/{self.length},1.0)"

    def carrier(self, time: str, faster: str = "") -> str:
        """Return cos(Ωt − phase), perhaps with a factor of Ω."""
        return f"cos(v_Omega{self.tag}*v_{time}{faster}-{self.phase})"

    def _of_samples(self, time: str, name: str, s: str) -> list[str]:
        """Return the lines for the interval i (1 before the first sample), the share s of it, and the signal."""
        steps, i = {"was": "(step-1)", "next": "(step+1)"}.get(name, "step"), s.replace("s", "i", 1) + self.tag
        way = f"{steps}*$(v_advance{self.tag}:%.17g)" + (f"-{self.late!r}" if self.late else "")
        inside = f"({way}>=0)*(1+floor({way}))" if self.late or time != self.now else f"1+floor({way})"
        _, text = _samples(self, i, f"v_{s}{self.tag}[1]")
        return [
            _line(i, f"1+ternary({way}<{self.intervals},{inside},{self.intervals + 1})"),
            self._kept(s, f"({way})%1" if self.late else f"{way}%1"),
            _line(name + self.tag, f"{self.unit}*{text}"),
        ]

    def moved(self, step: str, *, ahead: bool = False) -> list[str]:
        """Return the lines for the displacement `swing` of moved spheres, and the `speed` half a step ago or `ahead`.

        `step` is in the unit of the times.
        """
        name, sign, tag = ("next", "+", self.tag) if ahead else ("was", "-", self.tag)
        later, sooner = (f"v_next{tag}", f"v_swing{tag}") if ahead else (f"v_swing{tag}", f"v_was{tag}")
        return [
            *self.at(self.now, "swing", "s"),
            *([] if self.intervals else [_line(self.beside, f"v_{self.now}{sign}{step}")]),
            *self.at(self.beside, name, f"s_{name}"),
            _line(f"speed{tag}", f"({later}-{sooner})/v_step"),
        ]


# --- the variable s of each signal at a time, and the signal as a function of s


def _rise(s: str) -> str:
    return f"{s}^3*(10-15*{s}+6*{s}^2)"


def _tone(signal: _Signal, time: str, s: str) -> tuple[str, str]:
    return signal.share(time), f"{_rise(s)}*{signal.carrier(time)}"


def _burst(signal: _Signal, time: str, s: str) -> tuple[str, str]:
    return signal.share(time), f"sin(PI*{s})^2*{signal.carrier(time)}"


def _chirp(signal: _Signal, time: str, s: str) -> tuple[str, str]:
    return signal.share(time), f"sin(PI*{s})^2*{signal.carrier(time, f'*(1+$(0.5*({signal.sweep}-1):%.17g)*{s})')}"


def _step(signal: _Signal, time: str, s: str) -> tuple[str, str]:
    return signal.share(time), _rise(s)


def _ricker(signal: _Signal, time: str, s: str) -> tuple[str, str]:
    """Return the signal; s is y of the wavelet, −12 at t = 0, where it is 71 e^{-36} = 2e-14 of its maximum."""
    return f"v_Omega{signal.tag}*v_{time}-12.0", f"(1-0.5*{s}^2)*exp(-0.25*{s}^2)"


def _samples(signal: _Signal, i: str, s: str) -> tuple[str, str]:
    """Return the signal in interval i, at the share s of the interval."""
    c0, c1, c2, c3 = (f"v_c{power}_{signal.tag}[v_{i}]" for power in range(4))
    return "", f"({c0}+{s}*({c1}+{s}*({c2}+{s}*{c3})))"


FORMULAS: dict[str, Callable[[_Signal, str, str], tuple[str, str]]] = {
    "tone": _tone,
    "burst": _burst,
    "chirp": _chirp,
    "step": _step,
    "ricker": _ricker,
    SAMPLES: _samples,
}


def _line(name: str, expression: str, comment: str = "") -> str:
    return f"variable     {name:6} equal {expression}" + (f"  # {comment}" if comment else "")


def _once(tag: str) -> str:
    return f"variable     once{tag} vector [1]  # a factor that makes LAMMPS compute products once per step"


def driven_row(problem: Problem) -> list[str]:
    """Return the block of the driven row of a wave; [] if no row is driven."""
    wave = problem.wave
    if wave is None or not wave.declared.known.driven:
        return []
    along_z = "NULL" if problem.scene.space == 2 else "v_rest"  # with NULL forces would move spheres along z
    return [
        "# --- drive: from rest, the first row is moved by D0 r cos(Omega tau - phase) along the d_u of its spheres, "
        "r = 0 to 1.",
        "#     Contacts use velocities of half a step ago: that of the row is its last displacement over the step",
        f"group        driven id 1:{problem.scene.shape.spheres // problem.scene.shape.rows}",
        _once(""),
        _line("Omega", repr(wave.mode.frequency), "rad per tau"),
        *_Signal("tone", "", "v_D0", "v_ramp", repr(wave.declared.phase), "", "tau", "before").moved("v_step/v_t0"),
        "variable     swing_x atom v_swing*d_ux",
        "variable     swing_y atom v_swing*d_uy",
        "variable     speed_x atom v_speed*d_ux",
        "variable     speed_y atom v_speed*d_uy",
        *(["variable     rest   equal 0.0"] if along_z != "NULL" else []),
        f"fix          drive driven move variable v_swing_x v_swing_y {along_z} v_speed_x v_speed_y {along_z} "
        "units box",
    ]


def sources(problem: Problem) -> list[str]:
    """Return the blocks of all sources of a problem."""
    return apart(_source(str(number), each, problem) for number, each in enumerate(problem.sources, 1))


def _source(tag: str, placed: PlacedSource, problem: Problem) -> list[str]:
    source, sphere, name = placed.source, problem.scene.sphere, f"source{tag}"
    stiffness = problem.units.number(sphere.normal_stiffness, mass=1, time=-2)
    unit = f"{source.amplitude if source.motion else source.amplitude * stiffness!r}*v_D0"
    unit = f"$({unit}{'*v_R' if source.force in TORQUES else ''}:%.17g)"
    beside = f"t_next{tag}" if source.motion in ROTATIONS else f"t_was{tag}"
    lasts, phase, sweep = (repr(each) for each in (placed.lasts, source.phase, source.sweep))
    signal = _Signal(source.kind, tag, unit, lasts, phase, sweep, f"t{tag}", beside)
    head = [f"group        {name} id {id_ranges(placed.spheres)}", _once(tag)]
    if source.sampled:
        intervals = len(source.sampled) - 1
        interval = source.sampled[-1][0] / intervals
        signal = replace(signal, intervals=intervals, late=source.delay / interval)
        head += [*_tables(tag, source), _line(f"advance{tag}", f"v_step/v_t0/{interval!r}", "samples in a step")]
    else:
        pitch = any("Omega" in line for line in signal.at(signal.now, "push", "s"))
        head += [_line(f"Omega{tag}", repr(placed.frequency), "rad per tau")] if pitch else []
        head += [_line(f"t{tag}", f"step*{_STEP}-{source.delay!r}", "tau since it began")]
    if source.motion in ROTATIONS:
        return [
            f"# --- {name}: {source.words}, with the spin of the next step, as fix set acts at the end of a step",
            *head,
            f"group        mobile subtract mobile {name}",
            *signal.moved(_STEP, ahead=True),
            _line("still", "0.0"),
            "variable     nil    atom 0.0",
            *_turned(tag, source, problem),
        ]
    if source.motion:
        return [
            f"# --- {name}: {source.words}, with the velocity of half a step ago, as contacts use it",
            *head,
            f"group        mobile subtract mobile {name}",
            *signal.moved(_STEP),
            _line("still", "0.0"),
            f"fix          {name} {name} move variable {_moved(problem, source, tag)} units box",
        ]
    push = f"v_push{tag}"
    dipole = []
    if not source.turns:
        pushed = f"addforce {_vector(source.axis, push, '0.0')}"
    elif problem.scene.space == 2:
        pushed = f"efield 0.0 {push} 0.0  # turns the dipole of length 1 that tracks the angle"
    else:
        across, field = (_NEXT[source.axis], _NEXT[_NEXT[source.axis]])
        dipole = [f"set          group {name} dipole {_vector(across, '1.0', '0.0')}"]
        pushed = f"efield {_vector(field, push, '0.0')}  # turns the dipole of length 1 about {source.axis}"
    return [
        f"# --- {name}: {source.words}",
        *head,
        *dipole,
        *signal.at(signal.now, "push", "s"),
        f"fix          {name} {name} {pushed}",
    ]


_NEXT = {"x": "y", "y": "z", "z": "x"}  # the first axis × the second is the third


def _vector(axis: str, along: str, across: str) -> str:
    """Return the three words of a vector along an axis."""
    return " ".join(along if each == axis else across for each in "xyz")


def _moved(problem: Problem, source: Source, tag: str) -> str:
    """Return the displacements and velocities of ``fix move``: spheres move along one axis only."""
    none = ["v_still"] * problem.scene.space + ["NULL"] * (3 - problem.scene.space)
    return " ".join(
        f"v_{name}{tag}" if axis == source.axis and not source.turns else still
        for name in ("swing", "speed")
        for axis, still in zip("xyz", none, strict=True)
    )


def _turned(tag: str, source: Source, problem: Problem) -> list[str]:
    """Return the lines that hold spheres and turn them: spins, and dipoles or, in space, quaternions."""
    name, fix = f"source{tag}", "fix          "
    spins = _vector(source.axis, f"v_spin{tag}", "v_nil")
    held = f"{fix}{name} {name} move variable {_moved(problem, source, tag)} units box"
    spin = f"variable     spin{tag}  atom v_speed{tag}/v_R"
    if problem.scene.space == 2:
        return [
            spin,
            f"variable     mux{tag}   atom cos(v_swing{tag}/v_R)",
            f"variable     muy{tag}   atom sin(v_swing{tag}/v_R)",
            held,
            f"{fix}{name}_turn all set 1 0 group {name} omega {spins} dipole v_mux{tag} v_muy{tag} v_nil",
        ]
    return [
        spin,
        f"variable     degrees{tag} atom v_swing{tag}/v_R*180/PI",
        held,
        f"{fix}{name}_turn all set 1 0 group {name} omega {spins} "
        f"quat {_vector(source.axis, '1.0', '0.0')} v_degrees{tag}",
    ]


def _tables(tag: str, source: Source) -> list[str]:
    """Return the vectors of the coefficients between samples, with a few numbers per line."""
    lines = []
    for number, row in enumerate(pieces(source.sampled)):
        numbers = [repr(float(each)) for each in row]
        parts = [",".join(numbers[at : at + _NUMBERS_A_LINE]) for at in range(0, len(numbers), _NUMBERS_A_LINE)]
        lines += f"variable     c{number}_{tag} vector [{',&|'.join(parts)}]".split("|")
    return lines
