"""Contact laws of a deck from its ``pair_style``, ``pair_coeff`` and ``fix wall/gran``.

``pair_style granular`` has a normal law, a tangential law and a damping law for each pair of types; the older styles
``gran/hooke``, ``gran/hooke/history`` and ``gran/hertz/history`` have one law for all spheres. Stiffnesses are in units
of the deck.

https://docs.lammps.org/pair_granular.html, https://docs.lammps.org/pair_gran.html
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import dropwhile
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.adhesion_laws import AdhesionLaw, Dmt, Jkr
from granular_lmp.foreign.interpreter import Command
from granular_lmp.frozen import dataclass
from granular_lmp.units import AnyUnits

Floats = NDArray[np.float64]

_NORMAL = {  # names of the coefficients of each law, in LAMMPS's order
    "hooke": ("stiffness", "damping"),
    "hertz": ("stiffness", "damping"),
    "hertz/material": ("young", "damping", "poisson"),
    "dmt": ("young", "damping", "poisson", "gamma"),
    "jkr": ("young", "damping", "poisson", "gamma"),
}
_TANGENTIAL = {
    "linear_nohistory": ("shear_damping", "friction"),
    **dict.fromkeys(
        ("linear_history", "linear_history_classic", "mindlin_classic")
        + ("mindlin", "mindlin/force", "mindlin_rescale", "mindlin_rescale/force"),
        ("shear_stiffness", "shear_damping", "friction"),
    ),
}
_DAMPING = ("velocity", "mass_velocity", "viscoelastic", "tsuji", "coeff_restitution")
_OF_TANGENTIAL = ("tangential", "shear_stiffness", "shear_damping", "friction")
_PARTS = ("tangential", "damping", "rolling", "twisting", "heat")  # keywords that a name of a sub-model follows
_KEYWORDS = (*_PARTS, "cutoff", "limit_damping", "synchronized_verlet")
PLANES = ("xplane", "yplane", "zplane")
_SURFACES = (*PLANES, "zcylinder", "region")  # words of fix wall/gran that end its law
CLASSIC = ("gran/hooke", "gran/hooke/history", "gran/hertz/history")
MATERIAL = ("hertz/material", "dmt", "jkr")


@dataclass(frozen=True)
class Law:
    """The law of the contacts of two types.

    Attributes
    ----------
    command : the command that gives it.
    normal, tangential, damping_law : names of its parts.
    young, poisson, gamma : material of the normal law, if it has one.
    stiffness : coefficient of "hooke" and "hertz".
    damping : coefficient of the damping law.
    shear_stiffness : as written; None if it is NULL.
    shear_damping, friction : of the tangential law.
    mixed : whether LAMMPS mixes the law from those of the two types.
    unread : the first option that this package does not compute, such as "rolling sds"; "" if there is none.
    shear_share : shear stiffness over that of contact mechanics, for a mixed law.
    """

    command: Command
    normal: str
    tangential: str = "none"
    damping_law: str = "viscoelastic"
    young: float = 0.0
    poisson: float = 0.0
    gamma: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    shear_stiffness: float | None = None
    shear_damping: float = 0.0
    friction: float = 0.0
    mixed: bool = False
    unread: str = ""
    shear_share: float = 1.0
    modulus: float = 0.0  # E*, where the law is mixed
    shear_modulus: float = 0.0  # G*, where the law is mixed

    @property
    def has_history(self) -> bool:
        """Return whether the shear force depends on the slip since the contact began."""
        return self.tangential not in ("none", "linear_nohistory")

    @property
    def adhesive(self) -> bool:
        """Return whether the contact pulls."""
        return self.normal in ("dmt", "jkr") and self.gamma > 0

    def effective(self) -> tuple[float, float]:
        """Return E* and G* of a contact of two spheres."""
        if self.mixed:
            return self.modulus, self.shear_modulus
        one = self.young / (1 - self.poisson**2), self.young / (2 * (1 + self.poisson) * (2 - self.poisson))
        return one[0] / 2, one[1] / 2

    def elastic(self, radius: Any) -> AdhesionLaw | None:
        """Return the law of contacts with these effective radii; None if the normal law has no material."""
        if self.normal not in MATERIAL:
            return None
        modulus, shear = self.effective()
        if self.shear_stiffness is not None and self.has_history:
            shear = self.shear_stiffness / 8
        kind = Jkr if self.normal == "jkr" else Dmt
        return kind.between(modulus, shear * self.shear_share, radius, 2 * self.gamma)

    def stiffnesses(self, radius: Floats, overlap: Floats) -> tuple[Floats, Floats]:
        """Return ∂f_N/∂δ and ∂f_S/∂ξ of contacts with these effective radii and overlaps."""
        elastic = self.elastic(radius)
        if elastic is not None:
            inside = np.maximum(elastic.nearest(overlap), 0.0 if self.normal != "jkr" else -np.inf)
            shear = elastic.shear_stiffness(inside)
            normal = elastic.normal_stiffness(inside)
        else:
            root = np.sqrt(radius * np.maximum(overlap, 0.0)) if "hertz" in self.normal else np.ones_like(overlap)
            normal = (1.5 if "hertz" in self.normal else 1.0) * self.stiffness * root
            shear = (self.shear_stiffness or 0.0) * (root if "mindlin" in self.tangential else np.ones_like(overlap))
            if self.normal in CLASSIC:
                shear = (self.shear_stiffness or 0.0) * root
        return normal, shear if self.has_history else np.zeros_like(shear)

    def collision(self, radius: float, mass: float, speed: float) -> float | None:
        """Return the contact time of two spheres that meet head-on without adhesion and damping; None if unknown.

        With the effective mass m, it is 2.943 δmax/v, δmax = (5mv²/4k)^{2/5}, for a law f = k δ^{3/2}, and π √(m/k)
        for f = k δ.
        """
        normal, _ = self.stiffnesses(np.array([radius]), np.array([1.0]))
        if self.normal == "jkr" or not normal[0]:
            return None
        if "hooke" in self.normal:
            return float(np.pi * np.sqrt(mass / normal[0]))
        return float(2.943 * (5 * mass * speed**2 / (4 * normal[0] / 1.5)) ** 0.4 / speed)

    def in_si(self, units: AnyUnits) -> dict[str, Any]:
        """Return the entry of a law in ``run.json``, in SI units (units lj stay); a damping also as written."""
        pressure = {"mass": 1, "length": -1, "time": -2}
        return {
            "normal": self.normal,
            "young": units.si(self.young, **pressure),
            "poisson": self.poisson,
            "gamma": units.si(self.gamma, mass=1, time=-2),
            "tangential": self.tangential,
            "shear_stiffness": None if self.shear_stiffness is None else units.si(self.shear_stiffness, **pressure),
            "shear_damping": self.shear_damping,
            "friction": self.friction,
            "mixed": self.mixed,
            "line": f"{self.command.place}: '{self.command}'",
            "unread": self.unread,
            "damping_law": self.damping_law,
            "damping": self.damping,
            "viscosity": units.si(self.damping, mass=1, time=-1),
        }

    def dashpot(self, radius: Floats, overlap: Floats, mass: Floats) -> Floats:
        """Return the normal force of the dashpot over the approaching velocity; `mass` is the effective mass."""
        if self.damping_law == "velocity":
            return np.full_like(overlap, self.damping)
        if self.damping_law == "mass_velocity" or (self.normal in CLASSIC and "hertz" not in self.normal):
            return self.damping * mass
        if self.damping_law == "viscoelastic":
            return self.damping * mass * np.sqrt(radius * np.maximum(overlap, 0.0))
        normal, _ = self.stiffnesses(radius, overlap)
        share = abs(np.log(max(self.damping, 1e-12)))
        zeta = share / sqrt(np.pi**2 + share**2)  # of a linear contact with this coefficient of restitution
        return 2 * zeta * np.sqrt(mass * normal) * (sqrt(5) / 2 / sqrt(1.5) if self.normal != "hooke" else 1.0)


def laws_of(commands: Sequence[Command], types: int) -> dict[tuple[int, int], Law]:
    """Return the law of each pair of types, the lower type first; empty if a law or a label of a type is not known."""
    styles = [command for command in commands if command.name == "pair_style"]
    if not styles:
        return {}
    style = styles[-1]
    pairs = [(i, j) for j in range(1, types + 1) for i in range(1, j + 1)]
    if style.words[1] in CLASSIC:
        return dict.fromkeys(pairs, _classic(style))
    found: dict[tuple[int, int], Law] = {}
    labels = _labels(commands)
    for command in commands[commands.index(style) :] if style.words[1] == "granular" else ():
        if command.name != "pair_coeff":
            continue
        chosen = _chosen(command.words[1:3], types, labels)
        law = granular(command, command.words[3:])
        if chosen is None or law is None:
            return {}
        cutoff = str(style) if len(style.words) > 2 else ""
        found |= dict.fromkeys(chosen, replace(law, unread=law.unread or cutoff))
    for i, j in pairs:
        if (i, j) not in found and {(i, i), (j, j)} <= found.keys():
            found[i, j] = _mixed(found[i, i], found[j, j])
    return found


def granular(command: Command, words: Sequence[str]) -> Law | None:
    """Return the law that the words of ``pair_coeff`` or ``fix wall/gran granular`` give; None if it is unknown.

    Words are read in their order, as in LAMMPS: of two ``tangential`` or ``damping`` the last one holds. `Law.unread`
    names the first option that is not known; the options after it are read.
    """
    if not words or words[0] not in _NORMAL:
        return None
    values: dict[str, Any] = _numbers(_NORMAL[words[0]], words[1:])
    left = list(words[1 + len(_NORMAL[words[0]]) :])
    while left:
        keyword, style = left[0], "".join(left[1:2])
        if keyword == "tangential" and style in _TANGENTIAL:
            names = _TANGENTIAL[style]
            values = {name: value for name, value in values.items() if name not in _OF_TANGENTIAL}
            values |= {"tangential": style} | _numbers(names, left[2:])
            left = left[2 + len(names) :]
        elif keyword == "damping" and style in _DAMPING:
            values["damping_law"] = style
            left = left[2:]
        elif keyword in ("rolling", "twisting", "heat") and style == "none":
            left = left[2:]
        else:
            values.setdefault("unread", f"{keyword} {style}".strip() if keyword in _PARTS else keyword)
            left = [*dropwhile(lambda word: word not in _KEYWORDS, left[1:])]
    return Law(command, words[0], **values)


def law_of_wall(fix: Command) -> tuple[Law | None, tuple[str, ...]]:
    """Return the law of ``fix wall/gran granular`` (None if it is unknown) and the words after it, the surface."""
    words = fix.words[5:]
    end = next((n for n, word in enumerate(words) if word in _SURFACES), len(words))
    return granular(fix, words[:end]) if fix.words[3:5] == ("wall/gran", "granular") else None, words[end:]


def is_number(word: str) -> bool:
    """Return whether a word is a number, and not a variable or a name."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(names: Iterable[str], words: Sequence[str]) -> dict[str, float | None]:
    return {name: None if word == "NULL" else float(word) for name, word in zip(names, words, strict=False)}


def _classic(style: Command) -> Law:
    stiffness, shear, damping, shear_damping, friction, flag = style.words[2:8]
    unread = " ".join(style.words[8:])
    normal = float(stiffness)
    return Law(
        style,
        style.words[1],
        tangential="linear_history" if style.words[1].endswith("history") else "linear_nohistory",
        stiffness=normal,
        damping=float(damping),
        damping_law="viscoelastic" if "hertz" in style.words[1] else "mass_velocity",
        shear_stiffness=2 / 7 * normal if shear == "NULL" else float(shear),
        shear_damping=(float(damping) / 2 if shear_damping == "NULL" else float(shear_damping)) * (flag != "0"),
        friction=float(friction),
        unread=unread,
    )


def _labels(commands: Sequence[Command]) -> dict[str, int]:
    """Return the types of spheres that ``labelmap`` names."""
    found: dict[str, int] = {}
    for command in commands:
        if command.name == "labelmap" and command.words[1] == "atom":
            found |= {
                label: int(number) for number, label in zip(command.words[2::2], command.words[3::2], strict=True)
            }
    return found


def _chosen(words: Sequence[str], types: int, labels: Mapping[str, int]) -> list[tuple[int, int]] | None:
    """Return the pairs of types that two words of ``pair_coeff`` choose; None if a label is not known.

    LAMMPS puts two single types in order. With an asterisk it takes only pairs whose first type is in the first range
    and is not the larger one.
    """
    if any(not re.fullmatch(r"\d*\*?\d*", word) and word not in labels for word in words):
        return None
    one, other = (_types(str(labels.get(word, word)), types) for word in words)
    if len(one) == len(other) == 1:
        one, other = sorted((one, other), key=min)
    return [(i, j) for i in one for j in other if i <= j]


def _types(word: str, types: int) -> range:
    low, star, high = word.partition("*")
    first = int(low or 1)
    return range(first, int(high or types) + 1) if star else range(first, first + 1)


def _mixed(one: Law, other: Law) -> Law:
    """Return the law that LAMMPS mixes, with E*, G* of contact mechanics and the share of G* that LAMMPS uses.

    With the stiffness NULL of one type or both, LAMMPS computes G* as if both spheres had the mixed E* as modulus, and
    √(ν1 ν2). Two given stiffnesses have their geometric mean.
    """
    same: dict[str, Any] = {
        "mixed": True,
        "unread": one.unread or other.unread,
        "damping": sqrt(max(one.damping * other.damping, 0.0)),
        "shear_damping": sqrt(max(one.shear_damping * other.shear_damping, 0.0)),
        "friction": sqrt(max(one.friction * other.friction, 0.0)),
        "shear_stiffness": None,
    }
    if one.shear_stiffness is not None and other.shear_stiffness is not None:
        same["shear_stiffness"] = sqrt(max(one.shear_stiffness * other.shear_stiffness, 0.0))
    if one.normal not in MATERIAL:
        return replace(one, stiffness=sqrt(one.stiffness * other.stiffness), **same)
    (e, g), (e2, g2) = one.effective(), other.effective()
    modulus, shear = 2 * e * e2 / (e + e2), 2 * g * g2 / (g + g2)
    poisson = sqrt(max(one.poisson * other.poisson, 0.0))
    taken = modulus / (4 * (1 + poisson) * (2 - poisson))
    return replace(
        one,
        **same,
        gamma=sqrt(max(one.gamma * other.gamma, 0.0)),
        poisson=poisson,
        modulus=modulus,
        shear_modulus=shear,
        shear_share=taken / shear if same["shear_stiffness"] is None else 1.0,
    )
