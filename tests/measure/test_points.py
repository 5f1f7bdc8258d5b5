"""Tables of measured points: units of their heads, and one clear line for what they do not hold."""

from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure.points import DataError, Point, read


def table(folder: Path, text: str) -> list[Point]:
    file = folder / "data.csv"
    file.write_text(text, encoding="utf-8")
    return read(file)


def test_units_of_heads_become_si(tmp_path: Path) -> None:
    text = "# a layer\nbranch,wavenumber_rad/um,direction_deg,frequency [MHz],error_kHz\nL,1.2,30,100,250\n,,,7,1\n"
    first, second = table(tmp_path, text)
    assert first == Point("frequency", 1e8, 2.5e5, 3, "L", 1.2e6, "rad/m", 30.0, first.amplitude, first.time)
    assert (second.branch, second.wavenumber, second.direction, second.line) == ("", 0.0, None, 4)


def test_a_wavelength_is_a_wave_number_and_a_percent_a_share_of_the_value(tmp_path: Path) -> None:
    (point,) = table(tmp_path, "wavelength_um,frequency_GHz,error_%\n2,0.2,5\n")
    assert point.wavenumber == pytest.approx(np.pi * 1e6, rel=1e-12)
    assert point.error == pytest.approx(1e7, rel=1e-12)


def test_kinds_stand_in_one_table(tmp_path: Path) -> None:
    text = "row,to_row,arrival_us,speed_m/s,error_%\n20,,350,,1\n10,50,,590,2\n"
    assert [(each.kind, each.row, each.to_row) for each in table(tmp_path, text)] == [
        ("arrival", 20, -1),
        ("speed", 10, 50),
    ]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "has no head"),
        ("frequency_MHz\n", "has a head and no points"),
        ("row\n1\n", "has no measured column"),
        ("colour,frequency_MHz\n1,2\n", "column 'colour' is unknown"),
        ("frequency_THz\n1\n", "column 'frequency_THz': the unit must be one of frequency_GHz"),
        ("wavenumber,frequency_MHz\n1,2\n", "the unit must be one of wavenumber_rad/m"),
        ("frequency_MHz,frequency_Hz\n1,1\n", "two columns hold frequency"),
        ("frequency_MHz,row\n1,2\n", "line 2: a frequency takes no row"),
        ("arrival_us,row\n1,\n", "line 2: a arrival needs row"),
        ("arrival_us,row\n1,1.5\n", "must be a row, counted from 0"),
        ("frequency_MHz\n-1\n", "frequency = -1: must be above 0"),
        ("frequency_MHz\nnan\n", "must be a finite number"),
        ("frequency_MHz,error_us\n1,2\n", "the error of a frequency must be in one of"),
        ("frequency_MHz,error_%\n1,0\n", "error = '0': must be a finite number above 0"),
        ("frequency_MHz,error_%\n1\n", "line 2: 1 cells under 2 heads"),
        ("frequency_MHz,arrival_s,row\n1,1,1\n", "line 2: must have one value of"),
        ("wavenumber_rad/m,wavelength_m,frequency_Hz\n1,1,1\n", "give one of the two"),
    ],
)
def test_a_bad_table_gets_one_line_that_names_its_file_and_place(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(DataError) as refusal:
        table(tmp_path, text)
    assert says in str(refusal.value)
    assert str(refusal.value).startswith(str(tmp_path))
    assert "\n" not in str(refusal.value)


def test_a_file_that_is_no_text_is_said(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="not a text file"):
        read(tmp_path / "data.csv")
