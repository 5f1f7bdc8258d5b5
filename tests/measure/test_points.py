"""Tables of measured points: units of their heads, and one clear line for what they do not hold."""

from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure import points
from granular_analysis.measure.points import Point, read
from granular_lmp.runs.record import GranularError
from granular_lmp.scene.spreadsheets import TableError, value_of
from tests.scene.test_files import endless


def table(folder: Path, text: str) -> list[Point]:
    file = folder / "data.csv"
    file.write_text(text, encoding="utf-8")
    return read(file)[0]


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


def test_the_table_of_a_monitor_and_of_recorded_spheres_is_one_of_traces(tmp_path: Path) -> None:
    text = "t_s,row,column,u_m,v_m,theta_rad,u_t_m_s,v_t_m_s,theta_t_rad_s\n0,2,1,-1e-11,0,1e-5,0.1,0.2,8\n"
    assert [(each.kind, each.value) for each in table(tmp_path, text)] == [
        ("displacement_x", -1e-11),
        ("displacement_y", 0.0),
        ("rotation_z", 1e-5),
        ("velocity_x", 0.1),
        ("velocity_y", 0.2),
        ("spin_z", 8.0),
    ]
    text = "t_s,row,column,layer,ux_m,uz_m,vy_m_s,spin_rad_s,spinx_rad_s\n1e-9,2,1,3,1,2,3,4,5\n"
    found = table(tmp_path, text)
    kinds = ["displacement_x", "displacement_z", "velocity_y", "spin_z", "spin_x"]
    assert [(each.kind, each.layer) for each in found] == [(each, 3) for each in kinds]


def test_a_row_of_traces_has_the_error_of_each_in_its_unit_and_some_may_be_taken(tmp_path: Path) -> None:
    text = "time_ns,row,displacement_x_nm,velocity_x_mm/s,error_nm,error_mm/s\n2,1,3,4,0.5,0.25\n"
    found = [(each.kind, each.time, each.error) for each in table(tmp_path, text)]
    assert found == [("displacement_x", 2e-9, 0.5e-9), ("velocity_x", 2e-9, 0.25e-3)]
    (only,) = read(tmp_path / "data.csv", ["velocity_x"])[0]
    assert (only.kind, only.error) == ("velocity_x", 0.25e-3)
    with pytest.raises(TableError, match="holds no spin_z"):
        read(tmp_path / "data.csv", ["spin_z"])


def test_an_error_of_a_trace_with_a_gap_is_not_of_another_in_its_row(tmp_path: Path) -> None:
    text = "time_ns,row,displacement_y_nm,velocity_y_mm/s,error_nm,error_mm/s\n2,1,,4,0.5,0.25\n3,1,5,,0.5,0.25\n"
    expected = [("velocity_y", 0.25e-3), ("displacement_y", 0.5e-9)]
    assert [(each.kind, each.error) for each in table(tmp_path, text)] == expected
    found = read(tmp_path / "data.csv", ["velocity_y"])[0]
    assert [(each.kind, each.error) for each in found] == expected[:1]


def test_each_cell_that_is_needed_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read_cells: list[str] = []

    def counted(cell: str) -> float:
        read_cells.append(cell)
        return value_of(cell)

    monkeypatch.setattr(points, "value_of", counted)
    text = "time_ns,row,u_nm,v_nm,u_t_mm/s,v_t_mm/s\n2,1,3,4,5,6\n"
    assert len(table(tmp_path, text)) == 4
    assert read_cells == ["2", "1", "3", "4", "5", "6"]
    read_cells.clear()
    assert len(read(tmp_path / "data.csv", ["displacement_x"], ["velocity_x"])[0]) == 1
    assert read_cells == ["2", "1", "3"]
    assert [each.kind for each in read(tmp_path / "data.csv", ["spin_z"], ["velocity_x"])[0]] == ["velocity_x"]


def test_a_trace_has_gaps_beside_points_of_other_kinds(tmp_path: Path) -> None:
    text = "time_ns,row,displacement_x_nm,branch,frequency_MHz\n2,1,3,,\n3,1,,,\n4,1,nan,,\n,,,L,5\n"
    assert [(each.kind, each.line) for each in table(tmp_path, text)] == [("displacement_x", 2), ("frequency", 5)]
    for line in (",,,TR,", ",1,,,"):
        with pytest.raises(TableError, match="line 6: must have one value of"):
            table(tmp_path, text + line)


HEAD = "branch,wavenumber_rad/um,frequency_MHz,error_MHz\n"
ROWS = "L,1.0,152.6,1.5\nTR,2.0,207.7,2.1\n"
SPELLINGS = {
    "semicolons": (HEAD + ROWS).replace(",", ";"),
    "decimal commas": HEAD.replace(",", ";") + ROWS.replace(",", ";").replace(".", ","),
    "tabs": (HEAD + ROWS).replace(",", "\t"),
    "tabs and decimal commas": HEAD.replace(",", "\t") + ROWS.replace(",", "\t").replace(".", ","),
    "spaces": (HEAD + ROWS).replace(",", "  "),
    "byte order mark": "\ufeff" + HEAD + ROWS,
    "DOS": (HEAD + ROWS).replace("\n", "\r\n"),
    "empty lines": HEAD + "\n" + ROWS + "\n,,,\n\n",
    "separators at the end": (HEAD + ROWS).replace("\n", ",\n"),
    "separators at the end of rows": HEAD + ROWS.replace("\n", ",,\n"),
    "round brackets": "Branch,Wave number (rad/um),Frequency (MHz),Error (MHz)\n" + ROWS,
    "symbols": "branch,k [1/µm],f [MHz],error [MHz]\n" + ROWS,
    "decimal commas in quotes": HEAD + '"L","1,0","152,6","1,5"\n"TR","2,0","207,7","2,1"\n',
    "units below": "Branch,Wave number,Frequency,Error\n,(rad/um),(MHz),(MHz)\n" + ROWS,
    "slashes": "branch,k/(rad/µm),f/MHz,error/MHz\n" + ROWS,
    "quotes": HEAD + ROWS.replace("L,", '"L",').replace("1.5", '"1.5"'),
    "comments": "# a layer\n" + HEAD + "# first run\n" + ROWS + "% end\n",
    "head of numpy.savetxt": "# " + (HEAD + ROWS).replace(",", " "),
    "preamble": "Instrument;XYZ\nRecord length;2\n\n" + (HEAD + ROWS).replace(",", ";"),
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
@pytest.mark.parametrize("name", SPELLINGS)
def test_a_table_is_read_as_a_person_reads_it(name: str, encoding: str, tmp_path: Path) -> None:
    def told(text: str) -> list[tuple[object, ...]]:
        (tmp_path / "data.csv").write_bytes(text.encode(encoding, errors="ignore"))
        return [(each.branch, each.wavenumber, each.value, each.error) for each in read(tmp_path / "data.csv")[0]]

    assert told(SPELLINGS[name]) == told(HEAD + ROWS)


def test_what_was_understood_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("Gerät;XYZ\nk (1/m);f (kHz)\n1,5;3\n", encoding="utf-8")
    assert read(tmp_path / "data.csv")[1].understood == (
        f"{tmp_path / 'data.csv'}: 1 row: wavenumber in rad/m, frequency in kHz; head to line 2; "
        "cells parted by semicolons; decimals with commas"
    )


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "large"])
def test_a_file_without_an_end_is_not_read(kind: str, tmp_path: Path) -> None:
    with pytest.raises(GranularError, match=r"must be a regular file|is too large"):
        read(endless(kind, tmp_path))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD + ROWS.replace("152.6", "4_51.3"), "line 2: frequency = '4_51.3': must be a finite number"),
        (HEAD + ROWS.replace("152.6", "inf"), "line 2: frequency = 'inf': must be a finite number"),
        (HEAD + ROWS.replace("152.6", '"152,6"'), "1.0 has a point, and 152,6 in line 2 a comma; write points"),
        ('frequency_MHz,row\n"1,526",\n', "line 2: 1,526 may mean thousands or decimals"),
        (HEAD + ROWS.replace("152.6", "152,6"), "line 2: 5 cells under 4 heads; decimals need points where cells"),
        ((HEAD + ROWS).replace(",", ";").replace("152.6", "152,6"), "1.0 has a point, and 152,6 in line 2 a comma"),
        ("frequency_MHz\trow\n1,526\t\n", "line 2: 1,526 may mean thousands or decimals"),
        (HEAD.replace("frequency", "frequncy") + ROWS, "'frequncy_MHz' is unknown; did you mean frequency_MHz?"),
        ("Instrument,XYZ\nfreqency (MHz)\n1\n", "'freqency (MHz)' is unknown; did you mean frequency_MHz?"),
        ("1,2\n3,4\n", "has no head; must have a line of"),
        ("frequency_MHz,\n1,2\n", "line 2: 2 cells under 1 heads"),
        (",frequency_MHz\n1,2\n", "line 2: '1' stands in a column without a head"),
        ("", "has no head"),
        ("frequency_MHz\n", "has a head and no points"),
        ("row\n1\n", "has no measured column"),
        ("colour,frequency_MHz\n1,2\n", "column 'colour' is unknown"),
        ("frequency_THz\n1\n", "column 'frequency_THz': the unit must be one of frequency_GHz"),
        ("frequency_mHz\n1\n", "column 'frequency_mHz': the unit must be one of frequency_GHz"),
        ("wavenumber,frequency_MHz\n1,2\n", "the unit must be one of wavenumber_rad/m"),
        ("frequency_MHz,frequency_Hz\n1,1\n", "2 columns hold frequency; must be one"),
        ("frequency_MHz,row\n1,2\n", "line 2: a frequency takes no row"),
        ("arrival_us,row\n1,\n", "line 2: a arrival needs row"),
        ("arrival_us,row\n1,1e999\n", "must be a row, counted from 0"),
        ("arrival_us,row\n1,1.5\n", "must be a row, counted from 0"),
        ("frequency_MHz\n-1\n", "frequency = -1: must be above 0"),
        ("frequency_MHz\nnan\n", "must be a finite number"),
        ("frequency_MHz,error_us\n1,2\n", "the error of a frequency must be in one of"),
        ("frequency_MHz,error_%\n1,0\n", "error = '0': must be a finite number above 0"),
        ("frequency_MHz,error_%\n1\n", "line 2: 1 cells under 2 heads"),
        ("frequency_MHz,arrival_s,row\n1,1,1\n", "line 2: must have one value of"),
        ("time_s,displacement_x_m\n1,1\n", "line 2: a displacement_x needs row"),
        ("row,displacement_x_m\n1,1\n", "line 2: a displacement_x needs time"),
        ("time_s,row,displacement_x_m\ninf,1,1\n", "line 2: time = 'inf': must be a finite number"),
        ("time_s,row,displacement_x_m\n1,1,\n", "holds no value"),
        ("time_s,row,displacement_m\n1,1,1\n", "column 'displacement_m' is unknown; did you mean displacement_"),
        ("time_s,row,displacement_x_m,error_%\n1,1,1,5\n", "error_%: a displacement_x passes through 0"),
        ("time_s,row,displacement_x_m,arrival_s\n1,1,1,1\n", "line 2: must have one value of"),
        ("wavenumber_rad/m,wavelength_m,frequency_Hz\n1,1,1\n", "give one of the two"),
    ],
)
def test_a_bad_table_gets_one_line_that_names_its_file_and_place(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(TableError) as refusal:
        table(tmp_path, text)
    assert says in str(refusal.value)
    assert str(refusal.value).startswith(str(tmp_path))
    assert "\n" not in str(refusal.value)


def test_a_file_that_is_no_text_is_said(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(TableError, match="not a text file"):
        read(tmp_path / "data.csv")
