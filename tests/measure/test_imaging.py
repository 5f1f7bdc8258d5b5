"""Images of a small sheet by LAMMPS's records at another time step, of exact records, and what is refused."""

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from granular_analysis.measure.traces import Traces, rms
from granular_analysis.theory.imaging import NEAR
from granular_analysis.tools import image
from granular_analysis.tools.image import QUANTITIES
from granular_lmp import Scene, run
from granular_lmp.errors import GranularError
from granular_lmp.runs.export import export
from granular_lmp.runs.folder import locked
from granular_lmp.runs.record import Record
from tests.conftest import members

jax = pytest.importorskip("jax")
imaging = pytest.importorskip("granular_analysis.measure.imaging", reason="needs JAX")
kernels = pytest.importorskip("granular_analysis.theory.network_kernels", reason="needs JAX")
gradients = pytest.importorskip("granular_analysis.theory.network_gradient", reason="needs JAX")

SIDE = 8
RIM = [(0, 1), (0, 3), (0, 6), (1, 7), (3, 7), (6, 7), (7, 6), (7, 4), (7, 1), (6, 0), (4, 0), (1, 0)]
SOFT, FACTOR = [[row, column] for row in (3, 4, 5) for column in (3, 4, 5)], 0.6
PUSHED = {(0, 4): "y", (4, 7): "x", (7, 3): "y", (3, 0): "x"}
NOISE = 0.03


def pushes(amplitude: float) -> list[dict[str, object]]:
    burst = {"signal": "burst", "frequency": 1.2, "cycles": 1.5, "amplitude": amplitude}
    return [{"spheres": [list(place)], "force": way, **burst} for place, way in PUSHED.items()]


@cache
def scene() -> Scene:
    """Return a sheet with free faces that is pushed at its four sides, and of which all spheres are watched."""
    everywhere = [[row, column] for row in range(SIDE) for column in range(SIDE)]
    return Scene.from_dict(
        {
            "name": "small",
            "sphere": {
                "radius": 5e-7,
                "youngs_modulus": 73e9,
                "poisson_ratio": 0.17,
                "work_of_adhesion": 0.063,
                "density": 2200.0,
            },
            "packing": {"lattice": "hexagonal", "rows": SIDE, "columns": SIDE}
            | dict.fromkeys(("first", "last", "sides"), "free"),
            "time": {"duration": 24.0, "timestep": 0.15, "sample": 0.45},
            "source": pushes(0.01),
            "monitor": [{"name": "all", "spheres": everywhere}],
        }
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of LAMMPS with a soft patch, at another time step."""
    soft = {
        "time.timestep": 0.09,
        "inclusion": [{"spheres": SOFT, "density": 2200.0}],
        "pair": [{"of": [1, 1], "normal_stiffness": FACTOR * scene().sphere.normal_stiffness}],
    }
    found = tmp_path_factory.mktemp("runs") / "soft"
    run(scene().with_values(soft), found)
    return found


@pytest.fixture(scope="module")
def traces(folder: Path) -> Traces:
    return Traces.read(folder)


def of_rim(traces: Traces, noise: float) -> "imaging.Sought":
    """Return what is sought by the spheres of the rim, with noise; the others measure nothing."""
    rng = np.random.default_rng(1)
    keep = [place in RIM for place in zip(traces.row.tolist(), traces.column.tolist(), strict=True)]
    size = rms({name: each[:, keep] for name, each in traces.motion.items()})
    motion = {
        name: np.where(keep, each + noise * size * rng.normal(size=each.shape), np.nan)
        for name, each in traces.motion.items()
    }
    return imaging.Sought([imaging.Shot.of(replace(traces, motion=motion), scene(), noise)], "contact.normal_stiffness")


def soft_contacts(sought: "imaging.Sought") -> np.ndarray:
    row, column = sought.sites
    own = np.isin(row * SIDE + column, [r * SIDE + c for r, c in SOFT])
    return own[sought.ends].all(axis=1)


def test_a_soft_patch_is_imaged_above_the_noise_by_a_record_of_lammps_at_another_step(
    traces: Traces,
) -> None:
    sought = of_rim(traces, NOISE)
    found = sought.image()
    assert found.chi_squared == pytest.approx(1, abs=NEAR)
    inside = soft_contacts(sought)
    assert np.count_nonzero(inside) == 16
    elsewhere = found.values[~inside]
    # Four times the scatter elsewhere, of 145 contacts of which one in 16000 would be so by chance
    assert found.values[inside].mean() < 1 - 4 * elsewhere.std()
    # To first order it is the patch as the resolution blurs it. A soft contact is stretched more, by at most 1/0.6
    blurred = found.resolution()[0] @ np.where(inside, FACTOR - 1, 0.0)
    assert 1 < (found.values[inside].mean() - 1) / blurred[inside].mean() < 1 / FACTOR
    assert elsewhere.mean() == pytest.approx(1, abs=0.02)
    assert sought.trouble(found.values) == ""


@pytest.mark.parametrize("of", members(QUANTITIES, *QUANTITIES[1:]))  # each compiles for seconds
def test_the_kernels_of_weak_waves_give_the_adjoint_gradient(traces: Traces, of: str) -> None:
    """The wave is 1e-2 of the overlaps at rest."""
    sought = imaging.Sought(of_rim(traces, NOISE).shots, of)
    (shot,) = sought.shots
    motion, expected = gradients.record(shot.run, {}).motion, 0.0
    for row, sphere, slopes in kernels.kernels(shot.run, sought.name, sought.owners, shot.errors):
        left = (motion[:, row, sphere] - shot.measured[:, row, sphere]) / shot.errors[:, row, sphere] ** 2
        expected = expected + 2 * left @ slopes
    slope = sought.misfit(np.ones(len(sought.owners)))[1]
    np.testing.assert_allclose(expected, slope, rtol=0, atol=1e-2 * abs(slope).max())


def test_the_gradient_of_chi_squared_is_its_difference(traces: Traces) -> None:
    sought = of_rim(traces, NOISE)
    rng = np.random.default_rng(2)
    values, way = 1 + 0.1 * rng.normal(size=len(sought.owners)), rng.normal(size=len(sought.owners))
    slope = sought.misfit(values)[1] @ way
    ends = [sought.misfit(values + sign * 1e-5 * way)[0] for sign in (-1, 1)]
    assert slope == pytest.approx((ends[1] - ends[0]) / 2e-5, rel=1e-6)


@pytest.mark.more  # it takes as long as the image above
def test_exact_records_of_all_spheres_give_every_contact_back(traces: Traces) -> None:
    shot = imaging.Shot.of(traces, scene(), 2e-3)
    sought = imaging.Sought([shot], "contact.normal_stiffness")
    truth = np.where(soft_contacts(sought), FACTOR, 1.0)
    exact = np.asarray(gradients.record(shot.run, sought.factors(truth)).motion)
    found = imaging.Sought([replace(shot, measured=exact)], sought.of).image()
    # The weight leaves chi2 = 1 of errors of 2e-3 of the record, which are not there
    np.testing.assert_allclose(found.values, truth, atol=0.05)


def test_a_run_folder_and_its_exported_table_are_one_record(folder: Path, tmp_path: Path) -> None:
    export(Record.load(folder), tmp_path / "all.csv", monitor="all")
    one, other = (imaging.Shot.of(Traces.read(each), scene()) for each in (folder, tmp_path / "all.csv"))
    order = np.lexsort((one.run.spheres,)), np.lexsort((other.run.spheres,))
    assert (one.run.step, one.run.every, one.run.samples) == (other.run.step, other.run.every, other.run.samples)
    for name in ("measured", "errors"):
        found, expected = (getattr(each, name)[..., at] for each, at in zip((other, one), order[::-1], strict=True))
        finite = np.isfinite(expected)
        assert np.array_equal(finite, np.isfinite(found))
        np.testing.assert_allclose(found[finite], expected[finite], rtol=1e-9, atol=1e-12 * abs(expected[finite]).max())


TABLE = [f"{10 * n},0,{column},{n * column}" for n in range(4) for column in (1, 2)]
SPELLINGS = {
    "decimal commas": "t (ns);row;column;u (nm)\n" + "\n".join(TABLE).replace(",", ";").replace(";1;", ";1;0,0"),
    "gaps": "t_ns,row,column,u_nm\n" + "\n".join([*TABLE, "40,0,1,nan", "50,0,1,"]),
    "words": "time_ns,row,column,displacement_x_nm,rotation_deg\n" + "\n".join(f"{line},1" for line in TABLE),
    "before the start": "t_ns,row,column,u_nm\n-10,0,1,5\n-10,0,2,5\n" + "\n".join(TABLE),
}


@pytest.mark.parametrize("name", SPELLINGS)
def test_a_table_of_traces_is_read_as_a_person_reads_it(name: str, tmp_path: Path) -> None:
    (tmp_path / "trace.csv").write_text(SPELLINGS[name])
    found = Traces.read(tmp_path / "trace.csv")
    begun = np.flatnonzero(found.time == 0)[0]
    factor = np.array([0.01, 1.0]) if name == "decimal commas" else 1.0
    values = 1e-9 * factor * np.outer(range(4), (1, 2))
    np.testing.assert_allclose(found.motion["displacement_x"][begun : begun + 4], values, rtol=1e-12, atol=0)
    assert found.column.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("head", "lines", "message"),
    [
        ("t_ns,row,column,u_kg", TABLE, "column 'u_kg': the unit must be one of displacement_x_m"),
        ("t_ns,row,column,height_m", TABLE, "column 'height_m' is unknown"),
        ("t_ns,row,u_m,column", [line + ",0" for line in TABLE], "cells under 4 heads"),
        ("t_ns,row,u_m,v_m", TABLE, "two lines have the same sphere and time"),
        ("t_ns,row,column,theta_rad", TABLE, "holds no displacement_x, displacement_y"),
        ("t_ns,row,column,u_nm", [TABLE[0].replace("1,0", "1,one"), *TABLE[1:]], "must be a finite number"),
        ("t_ns,row,column,u_nm", TABLE + TABLE[:1], "two lines have the same sphere and time"),
        ("t_ns,row,column,u_nm", TABLE[:4], "at least 4 times with equal steps"),
        ("t_ns,row,column,u_nm", [*TABLE, "35,0,1,0"], "at least 4 times with equal steps"),
        ("t_ns,row,column,u_nm", ["0,0.5,1,0", *TABLE], "row = '0.5': must be a row, counted from 0"),
        (
            "t_ns,row,column,u_nm",
            [line.replace(",0,2,", ",30,2,") for line in TABLE],
            "row 30, column 2, layer 0: no sphere",
        ),
        ("t_ns,row,column,u_nm", [f"{n},0,1," for n in range(5)], "holds no displacement_x"),
        (
            "t_ns,row,column,u_nm,error_%",
            [line + ",5" for line in TABLE],
            r"error_%: is not used here; remove it, and give --noise",
        ),
        ("t_ns,row,column,u_nm,error_nm", [line + ",5" for line in TABLE], "column error_nm: is not used here"),
        ("t_ns,row,column,w_nm", TABLE, "has displacement_z, and the spheres of the scene stay in a plane"),
    ],
)
def test_tables_that_cannot_be_understood_are_refused(
    head: str, lines: list[str], message: str, tmp_path: Path
) -> None:
    (tmp_path / "trace.csv").write_text("\n".join([head, *lines]))
    with pytest.raises((GranularError, ValueError), match=message):
        imaging.Shot.of(Traces.read(tmp_path / "trace.csv"), scene())


def test_the_command_prints_how_a_table_was_understood(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "trace.csv").write_text("\n".join(["t_ns,row,column,u_nm", *(f"{10 * n},30,2,1" for n in range(4))]))
    (tmp_path / "sheet.toml").write_text(scene().to_toml())
    with pytest.raises(SystemExit, match="row 30, column 2, layer 0: no sphere"):
        image.main([str(tmp_path / "trace.csv"), str(tmp_path / "sheet.toml"), "--of", "density"])
    expected = f"{tmp_path / 'trace.csv'}: 4 rows: time in ns, row, column, displacement_x in nm"
    assert capsys.readouterr().out.strip() == expected


def test_a_table_at_other_times_is_met_by_a_spline(tmp_path: Path) -> None:
    """Of a sine of 40 samples a period a spline knows what lies between to (π/20)⁴/384, ten times that at its ends."""
    t0 = scene().sphere.time_scale
    times = (0.3 + np.arange(120)) * 0.15 * t0
    lines = [f"{1e9 * t!r},0,3,{float(np.sin(t / t0))!r}" for t in times.tolist()]
    (tmp_path / "late.csv").write_text("\n".join(["time (ns),row,column,velocity_y_mm/s", *lines]))
    shot = imaging.Shot.of(Traces.read(tmp_path / "late.csv"), scene(), 0.1)
    at = np.arange(shot.run.samples + 1) * shot.run.step * shot.run.every / shot.first.time
    rows = np.flatnonzero(np.isfinite(shot.errors).any(axis=(0, 2)))
    assert rows.tolist() == [4]  # the velocity along y
    known = np.isfinite(shot.errors[:, 4, 0])
    assert not known[0]
    assert known[1:].all()
    unit = 1e-3 / (shot.first.scales.metre / shot.first.scales.second)
    np.testing.assert_allclose(shot.measured[1:, 4, 0] / unit, np.sin(at[1:]), atol=2e-5)


def test_a_gap_takes_no_more_of_a_trace_than_what_lies_beside_it(tmp_path: Path) -> None:
    t0 = scene().sphere.time_scale
    times = (0.3 + np.arange(120)) * 0.15
    lines = [f"{1e9 * t * t0!r},0,{column},{float(np.sin(t))!r}" for t in times.tolist() for column in (3, 5)]
    del lines[2 * 60]
    (tmp_path / "gap.csv").write_text("\n".join(["time (ns),row,column,velocity_y_mm/s", *lines]))
    found = Traces.read(tmp_path / "gap.csv")
    grid = (times[:-1] + 0.05) * t0
    gapped, whole = found.at(grid)["velocity_y"].T
    assert np.flatnonzero(np.isnan(gapped)).tolist() == [59, 60]
    assert not np.isnan(whole).any()
    # Ends of a spline are ten times less exact than what lies inside
    np.testing.assert_allclose(
        gapped[np.isfinite(gapped)], 1e-3 * np.delete(np.sin(times[:-1] + 0.05), [59, 60]), atol=2e-8
    )
    shot = imaging.Shot.of(found, scene(), 0.1)
    known = np.isfinite(shot.errors[:, 4])
    assert known.sum(axis=0).tolist() == [known.shape[0] - 1 - 2, known.shape[0] - 1]


def test_a_time_at_which_no_sphere_was_measured_is_a_gap_of_all(tmp_path: Path) -> None:
    lines = [f"{10 * n},0,{column},{'nan' if n == 2 else column}" for n in range(6) for column in (1, 2)]
    (tmp_path / "gap.csv").write_text("\n".join(["t_ns,row,column,u_nm", *lines, "90,0,1,"]))
    found = Traces.read(tmp_path / "gap.csv")
    assert found.time == pytest.approx(1e-8 * np.arange(6), rel=1e-12)
    assert np.isnan(found.motion["displacement_x"]).all(axis=1).tolist() == [n == 2 for n in range(6)]


def test_all_that_the_command_offers_is_known() -> None:
    assert tuple(imaging.OF) == QUANTITIES


def test_what_an_image_is_not_made_of_is_refused(traces: Traces) -> None:
    rim = of_rim(traces, NOISE)
    with pytest.raises(ValueError, match="'stiffness': must be one of contact.normal_stiffness"):
        imaging.Sought(rim.shots, "stiffness")
    with pytest.raises(ValueError, match="must be finite and above 0, the errors over the size of the record"):
        imaging.Shot.of(traces, scene(), 0.0)
    with pytest.raises(ValueError, match="penalty = 'l1': must be one of tikhonov, tv"):
        rim.image("l1")
    with pytest.raises(ValueError, match="bounds 2 and 3: must be below and above 1"):
        rim.image(bounds=(2.0, 3.0))
    other = imaging.Shot.of(traces, scene().with_values({"sphere.radius": 4e-7}))
    with pytest.raises(ValueError, match="must be the same crystal as small"):
        imaging.Sought([*rim.shots, other], rim.of)
    opened = scene().with_values({"source": pushes(5.0)})
    with pytest.raises(imaging.TheoryError, match=r"contacts opened, first pair \d+; an image needs records without"):
        imaging.Sought([imaging.Shot.of(traces, opened)], rim.of)


@pytest.mark.more  # it compiles for seconds
def test_contacts_that_open_on_the_way_are_named(traces: Traces) -> None:
    """A push of four fifths of that which opens contacts does so where they adhere by a third."""
    strong = scene().with_values({"source": pushes(4.0)})
    sought = imaging.Sought([imaging.Shot.of(traces, strong)], "adhesion")
    assert sought.trouble(np.ones(len(sought.owners))) == ""
    assert "contacts opened, first pair" in sought.trouble(np.full(len(sought.owners), 0.3))


def test_the_share_of_the_noise_is_of_the_times_of_the_run(traces: Traces) -> None:
    """Zeros before the start, and motion after the end, change no error; a trace that rests has none."""
    apart, count = traces.time[1], len(traces.time)
    longer = {name: np.concatenate([0 * each, each, 9 * each]) for name, each in traces.motion.items()}
    others = replace(traces, time=apart * np.arange(-count, 2 * count), motion=longer)
    expected, found = (imaging.Shot.of(each, scene(), NOISE).errors for each in (traces, others))
    assert found == pytest.approx(expected, rel=1e-9)
    with pytest.raises(ValueError, match="has no motion between the start and the end of the run"):
        imaging.Shot.of(replace(others, time=others.time + apart * count), scene(), NOISE)


def test_records_of_other_spheres_or_times_are_another_search(traces: Traces) -> None:
    shot = imaging.Shot.of(traces, scene())
    runs = [
        replace(shot.run, spheres=shot.run.spheres[::-1]),
        replace(shot.run, step=2 * shot.run.step),
        replace(shot.run, every=2 * shot.run.every),
    ]
    assert len({image.digest_of([replace(shot, run=run)]) for run in (shot.run, *runs)}) == 4


def test_the_folder_of_a_search_that_runs_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image, "_sought", lambda _: SimpleNamespace(owners=(), points=0, shots=()))
    with locked(tmp_path), pytest.raises(SystemExit, match="another run is in progress there"):
        image.main(["runs/any", "scene.toml", "--of", "density", "-o", str(tmp_path)])


@pytest.mark.more  # it takes as long as the image above
def test_the_command_leaves_map_log_and_picture_and_overwrites_none(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sheet.toml").write_text(scene().to_toml())
    words = [str(folder), str(tmp_path / "sheet.toml"), "--of", "contact.normal_stiffness", "--noise", "0.03"]
    words += ["-o", str(tmp_path / "image")]
    image.main(words)
    said = capsys.readouterr().out
    assert "161 values of contact.normal_stiffness" in said
    assert "lowest factor 0." in said
    with (tmp_path / "image" / "map.csv").open() as stream:
        rows = [*csv.DictReader(stream)]
    soft = [row for row in rows if all([int(row[f"row_{end}"]), int(row[f"column_{end}"])] in SOFT for end in "ij")]
    assert (len(rows), len(soft)) == (161, 16)
    means = [np.mean([float(row["factor"]) for row in of]) for of in (soft, rows)]
    assert means[0] < 0.8 < means[1] < 1
    assert {"error", "share_in_place", "width_spheres", "x_m", "y_m"} < rows[0].keys()
    assert (tmp_path / "image" / "log.csv").read_text().startswith("weight,chi2_a_point,penalty,gradients,kinks")
    assert (tmp_path / "image" / "image.png").stat().st_size > 1e4
    made, kept = (tmp_path / "image" / "map.csv").read_bytes(), tmp_path / "image" / "evaluations.bin"
    kept.write_bytes(kept.read_bytes()[: kept.stat().st_size // 2 - 3])
    (tmp_path / "image" / "map.csv").unlink()
    image.main(words)  # continues what was stopped
    assert (tmp_path / "image" / "map.csv").read_bytes() == made
    with pytest.raises(SystemExit, match="holds another search; give its scene and options again"):
        image.main([*words, "--penalty", "tv"])
    (tmp_path / "image" / "image.json").unlink()
    with pytest.raises(SystemExit, match="holds map.csv without a search; give another folder"):
        image.main(words)


def test_the_command_says_what_it_lacks(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        image.main(["runs/any", "--of", "density"])
    assert "give pairs of RECORDS and SCENE" in capsys.readouterr().err
    monkeypatch.setattr(image, "find_spec", lambda _: None)
    with pytest.raises(SystemExit, match=r"needs JAX: pip install 'granular-lmp\[jax\]'"):
        image.main(["runs/any", "scene.toml", "--of", "density"])
