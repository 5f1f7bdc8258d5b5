"""The bar of a run or a study: what it shows, and that what is fast has none."""

import pytest

from granular_lmp import ProgressBar, progress


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "DELAY", 0.0)


def test_a_bar_shows_steps_and_of_a_study_the_seconds_that_are_left(
    at_once: None, capsys: pytest.CaptureFixture[str]
) -> None:
    steps, runs = ProgressBar(), ProgressBar()
    steps(30, 120)
    runs(1, 4, 12.3)
    shown = capsys.readouterr().err
    assert " 25%|" in shown
    assert "30 of 120 steps" in shown
    assert "1 of 4 runs, 12 s left" in shown
    steps(60, 240)  # a tolerance needs more runs
    assert "60 of 240 steps" in capsys.readouterr().err
    steps.close()
    runs.close()


def test_a_bar_is_gone_at_the_end(at_once: None, capsys: pytest.CaptureFixture[str]) -> None:
    bar = ProgressBar()
    bar(1, 2)
    bar(2, 2)
    assert capsys.readouterr().err.endswith("\r")
    bar.close()


def test_what_is_fast_has_no_bar(capsys: pytest.CaptureFixture[str]) -> None:
    ProgressBar()(1, 2)
    assert capsys.readouterr().err == ""
