"""Crystal with random initial velocities: a scene that excites every wave, with snapshots of all spheres.

The case ``dispersion`` reads the branches of a sheet from such a run.
"""

from granular_lmp.problem import prepare
from granular_lmp.rest.scene import Scene


def kicked(scene: Scene, seed: int = 0) -> Scene:
    """Return the scene with noise in place of its wave: ẋ, ẏ and Rθ̇ uniform in ±½ D0/t0, no displacement.

    Every mode gets the same mean energy, and the crystal has no total momentum, so it does not drift. Effects and size
    are those of the declared scene; each sample has a snapshot of all spheres.
    """
    scene = prepare(scene).scene
    return scene.with_values(
        {
            "wave.form": "none",
            "start.noise": scene.displacement_amplitude / scene.sphere.time_scale / 2,
            "start.seed": seed,
            "output.particles": scene.time.sample,
            "time.allow_echo": True,
        }
    )
