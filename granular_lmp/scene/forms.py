"""The forms of a wave: how it begins, and all that scenes, quiet ends, decks and studies know of that.

A form that is made of running waves is one entry here. One that moves spheres in another way has its fields in
`granular_lmp.rest.initial_fields` and its lines in `granular_lmp.lammps.start`, too.
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
        How the key says it.
    forward : float
        Amplitude at τ = 0 of the wave that runs along k, in D0.
    backward : float
        Amplitude at τ = 0 of its time reversal, which has the same displacements and runs back.
    driven : bool
        True if all is at rest at τ = 0, and the first row is moved from then on.
    words : str
        How it is said beside the mode; "" if it is not.
    """

    name: str
    meaning: str
    forward: float = 0.0
    backward: float = 0.0
    driven: bool = False
    words: str = ""

    @property
    def fills(self) -> bool:
        """True if the crystal is filled with the wave at τ = 0, or its envelope is."""
        return self.halves > 0

    @property
    def waves(self) -> bool:
        """True if there is a wave; otherwise it is only the unit of what shakes or strikes the crystal."""
        return self.fills or self.driven

    @property
    def runs(self) -> bool:
        """True if it begins as the wave that runs along k alone."""
        return self.forward == 1.0 and not self.backward

    @property
    def halves(self) -> int:
        """Number of waves of which it is made, which run apart."""
        return bool(self.forward) + bool(self.backward)

    @property
    def displacement(self) -> float:
        """Displacements at τ = 0, in those of the running wave."""
        return self.forward + self.backward

    @property
    def velocity(self) -> float:
        """Velocities at τ = 0, in those of the running wave."""
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
NO_WAVE = FORMS["none"]  # that of a scene without [wave], too
