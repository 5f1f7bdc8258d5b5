"""`compare` judges every shipped scene, of waves and of impacts: by a theory, or by the network of its spheres."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.runs import load
from granular_analysis.measure.signals import COMPONENTS
from granular_analysis.tools import compare
from granular_lmp import Scene, run
from granular_lmp.scene.shipped import SHIPPED
from tests.conftest import members

SCENES = sorted(path.parent for path in SHIPPED.rglob("scene.toml"))
# Times, t0: long enough for the centre to hear what shakes the crystal, a few of the others
LONGER = {"corner_source": 40.0, "point_source": 30.0, "l_beam": 50.0, "two_tones": 110.0, "tr_burst_scattering": 95.0}
LONGER |= {"tr_driven": 220.0, "quiet_ends": 60.0}
# Errors that a step of 0.05 leaves, (ΩΔτ)² Ωτ/24 in the phase: up to 2e-2 of p, q and φ at the fastest waves of a
# source, Ω = 1.6, and the latest times; velocities of a struck chain 1.4e-4 to 1e-3 (case "impact"). Components below
# 1e-4 of the largest are what the step's error leaves there
BOUND = 2e-2
FAINT = 1e-4
# Of each, a scene with the same kind of source, interface or strike stands beside it; test_reference.py has sliding
MORE = ("tr_driven", "tr_sliding", "l_beam", "corner_source", "refraction", "point_impact", "tr_burst_scattering")
MORE += (
    "two_tones",
    "tr_resonant",
    "tr_antiresonant",
    "hcp_c_axis",
    "compressed_chain",
    "l_wave",
    "monolayer_vertical",
)
MORE += ("rt_wave", "steel_compressed", "struck_sheet")


@pytest.mark.parametrize(
    "folder", members(SCENES, *(path for path in SCENES if path.name in MORE)), ids=lambda path: path.name
)
def test_a_shipped_scene_is_judged(folder: Path, tmp_path: Path) -> None:
    scene = Scene.load(folder)
    duration = LONGER.get(scene.name, 6.0)
    changes: dict[str, Any] = {"time.duration": duration, "time.sample": 0.5}
    changes |= {"time.timestep": min(scene.time.timestep, 0.05)}
    if scene.wave is not None:
        changes |= {"output.particles": duration}
    run(scene.with_values(changes), tmp_path / "run")
    found = compare.compare(load(tmp_path / "run"))
    assert found.theory is not None, found.notes
    assert found.signals is not None
    largest = [float(np.abs(values).max()) for values in found.signals]
    heard = [name for name, size in zip(compare.names_of(found), largest, strict=True) if size > FAINT * max(largest)]
    assert heard
    assert all((found.error.get(name) or 0.0) < BOUND for name in heard), found.error
    # The table has a place for each, and the figure for each that is not zero by symmetry
    assert (found.theory or "-") in compare.table([found])
    drawn = [name for name in compare.names_of(found) if found.error.get(name, 0.0) is not None]
    assert set(heard) <= set(drawn)
    if set(drawn) != set(COMPONENTS):  # that of all three is drawn in test_compare.py
        assert len(compare.figure(found.record, found).axes) == 2 * len(drawn)


def test_there_are_scenes_of_every_kind() -> None:
    assert {path.parent.name for path in SCENES} >= {"impacts"}
    assert len(SCENES) >= 29
