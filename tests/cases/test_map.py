"""The map of the second harmonic over the zone: its panels, its page, and what it refuses."""

import re
from pathlib import Path

import numpy as np
import pytest

from cases import runner
from cases.map import case as zone_map
from granular_analysis import second_harmonic
from granular_analysis.theory.contact import Contact
from tests.conftest import members
from tests.polarisations import modes, second_harmonic_amplitude
from tests.theory.test_directions import SILICA, along_y


@pytest.mark.parametrize(
    ("branch", "poisson_ratio", "names"), [(0, SILICA, "TR"), (1, SILICA, "L"), (2, SILICA, "RT"), (0, -0.5, "TR/L")]
)
def test_panels_carry_the_names_of_the_paper_s_direction(branch, poisson_ratio, names):
    assert zone_map.names_along_y(branch, Contact(poisson_ratio)) == names


def test_the_map_never_meets_gamma():
    assert np.linalg.norm(zone_map.wave_vectors(zone_map.POINTS), axis=-1).min() > 1e-3


@pytest.mark.parametrize("poisson_ratio", members([-1.0, 0.5], -1.0))  # silica's is drawn below
@pytest.mark.usefixtures("drawn_once")
def test_the_map_is_written_for_any_material(tmp_path, poisson_ratio, monkeypatch):
    monkeypatch.setattr(zone_map, "POINTS", 12)
    target = tmp_path / "new folder" / "map.png"
    zone_map.main(["-o", str(target), "--poisson-ratio", str(poisson_ratio)])
    assert target.read_bytes().startswith(b"\x89PNG")


def test_the_map_draws_the_second_harmonic(monkeypatch):
    monkeypatch.setattr(zone_map, "POINTS", 16)
    drawn = []
    monkeypatch.setattr(runner, "save", lambda figure, path: drawn.append(figure))
    zone_map.main([])
    k = zone_map.wave_vectors(16)
    for branch, panel in enumerate(drawn[0].axes[:3]):
        expected = np.linalg.norm(second_harmonic_amplitude(k, branch, Contact(SILICA)), axis=-1)
        # Here ε is divided out before the norm is taken: a rounding or two apart
        np.testing.assert_allclose(panel.images[0].get_array(), expected, rtol=1e-14)


def locations_on_the_page() -> list[tuple[float, float, float, float]]:
    """Return overlap ratio, prestress, resonance and antiresonance of each row of the table below the map."""
    lines = (Path(__file__).parents[2] / "docs/studies.md").read_text("utf-8").splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("| η |")) + 2
    rows = []
    while lines[first].startswith("|"):
        rows.append(tuple(float(cell) for cell in lines[first].strip("|").split("|")))
        first += 1
    return rows


@pytest.mark.parametrize(("overlap_ratio", "prestress", "resonance", "antiresonance"), locations_on_the_page())
def test_the_map_has_the_resonance_and_the_antiresonance_of_its_page(
    overlap_ratio, prestress, resonance, antiresonance
):
    contact = Contact(SILICA, overlap_ratio=overlap_ratio, prestress=prestress)

    def detuning(xi):
        return 2 * modes(along_y(xi), contact)[0][0] - modes(2 * along_y(xi), contact)[0][1]

    def amplitude(xi):
        return second_harmonic_amplitude(along_y(xi), 0, contact)[1].imag

    half = 5e-4  # half of the last digit shown
    assert detuning(resonance - half) * detuning(resonance + half) < 0
    assert amplitude(antiresonance - half) * amplitude(antiresonance + half) < 0
    # The page's numbers are not those of the paper's lattice, and the closed form agrees where it holds the contact
    if not contact.departures:
        assert second_harmonic.resonance(contact.closed) == pytest.approx(resonance, abs=half)
        assert second_harmonic.antiresonance(contact.closed) == pytest.approx(antiresonance, abs=half)


def test_the_map_refuses_a_lattice_that_is_none():
    with pytest.raises(SystemExit, match=re.escape("poisson_ratio = 0.7 is outside [-1, 0.5]")):
        zone_map.main(["--poisson-ratio", "0.7"])
