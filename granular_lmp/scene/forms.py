"""Forms of a wave: how it begins, and all that scenes, quiet ends, decks and studies know about its form.

A form that consists of running waves is one entry here. A form that moves spheres in another way also has its fields in
`granular_lmp.rest.initial_fields` and its lines in `granular_lmp.lammps.start`.
"""

from granular_lmp.frozen import dataclass


@dataclass(frozen=True)
class Form:
    """Form of a wave: how it starts.

    Attributes
    ----------
    name : str
        Value of the key.
    meaning : str
        Explanation of the form in the note of the key.
    forward : float
        Amplitude at τ = 0, in D0, of the wave that runs along k.
    backward : float
        Amplitude at τ = 0, in D0, of its time reversal: it has the same displacements and runs back.
    driven : bool
        True if all is at rest at τ = 0, and the first row is moved afterwards.
    words : str
        Words beside the mode; "" if none are needed.
    """

    name: str
    meaning: str
    forward: float = 0.0
    backward: float = 0.0
    driven: bool = False
    words: str = ""

    @property
    def fills(self) -> bool:
        """True if the wave fills the crystal, or its envelope, at τ = 0."""
        return self.halves > 0

    @property
    def waves(self) -> bool:
        """True if there is a wave; otherwise it only sets the units of what shakes or strikes the crystal."""
        return self.fills or self.driven

    @property
    def runs(self) -> bool:
        """True if it begins only as the wave that runs along k."""
        return self.forward == 1.0 and not self.backward

    @property
    def halves(self) -> int:
        """Number of running waves that make up the form and separate later."""
        return bool(self.forward) + bool(self.backward)

    @property
    def displacement(self) -> float:
        """Displacements at τ = 0 over those of the running wave."""
        return self.forward + self.backward

    @property
    def velocity(self) -> float:
        """Velocities at τ = 0 over those of the running wave."""
        return self.forward - self.backward


FORMS = {
    form.name: form
    for form in (
        Form("running", "running", forward=1.0),
        Form("standing", "standing", forward=0.5, backward=0.5, words="standing"),
        Form("driven", "driven by the first row", driven=True, words="driven"),
        Form("none", "none: at rest"),
    )
}
*_OTHERS, _LAST = (form.meaning for form in FORMS.values())
MEANING = f"{', '.join(_OTHERS)}, or {_LAST}"  # of the key
STILL = tuple(name for name, form in FORMS.items() if not form.waves)  # the crystal is shaken or struck
DRIVEN = tuple(name for name, form in FORMS.items() if form.driven)
NO_WAVE = FORMS["none"]  # also the form of a scene without [wave]
