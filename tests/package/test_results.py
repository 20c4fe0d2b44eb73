"""Test the common features of all results: table, picture, file, short text."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pyarrow
import pytest

import anhyst
from anhyst.compilation.output import Compiled
from anhyst.model.diff import ModelDiff
from anhyst.support.result import Result
from tests.refusals import refused
from tests.truths import truth

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
LOOPS = EXAMPLES / "electromagnet" / "loops.csv"
GAP = 4e-4


@pytest.fixture(autouse=True)
def _no_window() -> Iterator[None]:
    with mpl.rc_context({"backend": "Agg"}):
        yield
        plt.close("all")


@pytest.fixture(scope="module")
def loops() -> anhyst.Loops:
    return anhyst.read_loops(LOOPS)


@pytest.fixture(scope="module")
def found(loops: anhyst.Loops) -> anhyst.IdentifyResult:
    return anhyst.identify(loops, law="effective-field", gap_map="reluctance")


@pytest.fixture(scope="module")
def results(
    loops: anhyst.Loops, found: anhyst.IdentifyResult, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Result]:
    """One result of each kind that takes less than a minute."""
    folder = tmp_path_factory.mktemp("results")
    model = found.model
    compiled = anhyst.compile(model, folder / "controller", rate=2e4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("anhyst.verification.targets.OPTIMISATIONS", ("-O2",))
        patch.setattr("anhyst.verification.targets.HOST_COMPILERS", {"cc": "gcc"})
        verified = anhyst.verify(folder / "controller", on="host", host_steps=1000)
    return {
        "loops": loops,
        "inspection": anhyst.inspect(loops),
        "identified": found,
        "model": model,
        "prediction": model.predict(np.linspace(0.0, 2.0, 50), GAP),
        "diff": anhyst.diff(model, truth("electromagnet-no-dead-band")),
        "compiled": compiled,
        "verification": verified,
        "piezo": anhyst.simulate(EXAMPLES / "piezo" / "rig.toml"),
    }


def test_every_result_has_a_table(results: dict[str, Result]) -> None:
    for name, result in results.items():
        frame = result.to_dataframe()
        assert isinstance(frame, pd.DataFrame)
        # No time is measured on the host; all other results have rows.
        assert len(frame) > 0 or name == "verification", name


def test_every_result_can_be_plotted_on_given_axes(results: dict[str, Result]) -> None:
    for name, result in results.items():
        figure, mine = plt.subplots()
        assert result.plot(mine) is mine, name
        assert result.plot().figure is not figure, name
        plt.close("all")
    ax = results["model"].plot()
    assert ax.get_xlabel() == "current I [A]"
    assert ax.get_ylabel() == "force F [N]"
    assert len(ax.lines) == 4


def test_every_result_has_a_short_representation(results: dict[str, Result]) -> None:
    for result in results.values():
        text = repr(result)
        assert text.startswith(f"<{type(result).__name__} ")
        assert len(text) < 2000
        page = result._repr_html_()
        assert type(result).__name__ in page
        assert page.count("<tr>") >= len(result.facts())
    assert "gap 0.3 mm" in repr(results["loops"])


def test_text_of_a_result_is_escaped(found: anhyst.IdentifyResult) -> None:
    from dataclasses import replace

    renamed_model = replace(found.model, name="<script>x</script>")
    assert "<script>" not in renamed_model._repr_html_()


def test_every_result_is_saved_whole(results: dict[str, Result], tmp_path: Path) -> None:
    endings = {"loops": ".csv", "identified": ".toml", "model": ".toml", "piezo": ".csv"}
    for name, result in results.items():
        path = tmp_path / f"{name}{endings.get(name, '.json')}"
        assert result.save(path) == path
        assert path.stat().st_size > 100
        with refused("cannot-be-written: nowhere"):
            result.save(tmp_path / "nowhere" / path.name)
    reread_loops = anhyst.read_loops(tmp_path / "loops.csv")
    assert np.array_equal(reread_loops.loops[3].output, results["loops"].loops[3].output)  # type: ignore[attr-defined]
    assert anhyst.read_model(tmp_path / "model.toml") == results["model"]


def test_a_model_is_a_function_and_has_an_inverse(found: anhyst.IdentifyResult) -> None:
    current = np.concatenate([np.linspace(0.0, 2.0, 80), np.linspace(2.0, 0.5, 60)])
    force = found.model(current, GAP)
    assert force[79] > force[40] > force[0]
    # The descending branch is above the ascending branch, so that the loop has an area.
    ascending_force = np.interp(1.0, current[:80], force[:80])
    descending_force = np.interp(-1.0, -current[80:], force[80:])
    assert descending_force > ascending_force
    inverse_current = found.model.inverse(force, GAP)
    assert np.abs(inverse_current - current).max() < 1e-6


def test_the_table_agrees_with_the_fit_metrics(found: anhyst.IdentifyResult) -> None:
    frame = found.to_dataframe()
    fit = found.model.fit
    assert fit is not None
    assert np.isclose(frame["F_N_residual"].abs().max(), fit.worst)
    assert set(frame["loop"]) == {loop.label for loop in found.loops.loops}


def test_loops_come_from_frames_of_any_library(loops: anhyst.Loops) -> None:
    frame = loops.to_dataframe()

    class Interchanged:
        """Data frame that only implements the interchange protocol."""

        def __dataframe__(self, nan_as_null: bool = False, allow_copy: bool = True) -> object:
            return pyarrow.table(frame).__dataframe__(nan_as_null, allow_copy)

    columns = {name: frame[name].to_numpy() for name in frame}
    for columns_or_frame in (frame, columns, pyarrow.Table.from_pandas(frame)):
        read_set = anhyst.read_loops(columns_or_frame)
        assert [loop.label for loop in read_set.loops] == [loop.label for loop in loops.loops]
        assert np.array_equal(read_set.loops[5].output, loops.loops[5].output)
    numbers = frame.drop(columns="loop")[frame["loop"] == "0.30mm-full"]
    frame = numbers.reset_index(drop=True)
    assert np.array_equal(anhyst.read_loops(Interchanged()).loops[0].output, loops.loops[0].output)


@pytest.mark.slow
def test_a_model_in_memory_compiles_as_its_file_does(
    found: anhyst.IdentifyResult, results: dict[str, Result], tmp_path: Path
) -> None:
    path = found.save(tmp_path / "model.toml")
    by_file = anhyst.compile(path, tmp_path / "controller", rate=2e4)
    in_memory = results["compiled"]
    assert isinstance(by_file, Compiled)
    assert isinstance(in_memory, Compiled)
    assert by_file.manifest == in_memory.manifest
    with refused("missing --rate", anhyst.InputError):
        anhyst.compile(path, tmp_path / "controller")


def test_two_models_are_distinguished(results: dict[str, Result]) -> None:
    model_diff = results["diff"]
    assert isinstance(model_diff, ModelDiff)
    assert not model_diff.same
    assert model_diff.to_dataframe()["worst"].max() == pytest.approx(model_diff.worst)
