"""Test ``anhyst verify`` with missing tools: other targets run, and all missing tools are listed."""

from __future__ import annotations

import json
import shutil
from functools import partial
from pathlib import Path

import pytest

from anhyst.cli.app import main
from anhyst.verification import verify
from tests.refusals import says
from tests.verification.conftest import Compile

LINKING = ("as", "ld", "ld.bfd", "ld.lld", "sh")
"""Programs that compilers call."""

STEPS = 200


@pytest.fixture
def folder(compiled: Compile, tmp_path: Path) -> Path:
    place = tmp_path / "compiled"
    shutil.copytree(compiled("full", "q31"), place)
    return place


@pytest.fixture(autouse=True)
def little_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use few steps and builds; the missing tools do not depend on their number."""
    monkeypatch.setattr("anhyst.verification.targets.OPTIMISATIONS", ("-O2",))
    short = partial(verify, host_steps=STEPS, target_steps=STEPS)
    monkeypatch.setattr("anhyst.verification.verify", short)


def only(*tools: str, at: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Remove all programs from the path except these and those that compilers call."""
    place = at / "path"
    place.mkdir()
    for name in (*tools, *LINKING):
        found = shutil.which(name)
        if found is None:
            if name in tools:
                pytest.skip(f"{name} is missing here too")
            continue
        (place / name).symlink_to(found)
    monkeypatch.setenv("PATH", str(place))
    return place


def command(folder: Path, *arguments: str) -> int:
    return main(["verify", str(folder), *arguments])


def kept(folder: Path) -> dict[str, object]:
    found: dict[str, object] = json.loads((folder / "verify.json").read_text(encoding="utf-8"))
    return found


@pytest.mark.parametrize("compiler", [pytest.param("gcc", marks=pytest.mark.slow), "cc"])
def test_the_default_runs_with_one_compiler_and_lists_the_other(
    folder: Path,
    compiler: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    only(compiler, at=tmp_path, monkeypatch=monkeypatch)
    assert command(folder, "--verbose") == 0
    printed = capsys.readouterr().out
    for label in (f"host ({compiler} -O2)", "cortex-m4 (portable)"):
        assert label in printed
    assert "missing tools" in printed
    assert "apt install clang" in printed
    missing = kept(folder)["missing"]
    assert {"target": "host", "tool": "clang", "install": "apt install clang"} in missing  # type: ignore[operator]
    assert kept(folder)["not_run"] == []
    assert "Missing tools" in (folder / "verify.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_host_may_be_named_with_one_compiler_alone(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    only("gcc", at=tmp_path, monkeypatch=monkeypatch)
    assert command(folder, "--on", "host") == 0


@pytest.mark.slow
def test_all_that_is_missing_is_listed_at_once_and_a_named_target_that_did_not_run_fails(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    only("cc", at=tmp_path, monkeypatch=monkeypatch)
    assert command(folder, "--on", "host,avr,msp430,cortex-m3-qemu") == 2
    message = capsys.readouterr()
    assert "host (cc -O2)" in message.out
    for tool, package in (
        ("avr-gcc", "gcc-avr avr-libc"),
        ("mspdebug", "mspdebug"),
        ("qemu-system-arm", "qemu-system-arm"),
    ):
        assert f"apt install {package}" in message.out
        assert f"{tool} (apt install {package})" in message.err
    assert message.err.count("\n") == 1
    assert "clang" not in message.err  # the host ran
    found = kept(folder)
    assert found["passed"] is True
    assert found["not_run"] == ["avr", "msp430", "cortex-m3-qemu"]


@pytest.mark.slow
def test_a_difference_counts_more_than_a_missing_tool(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = only("cc", at=tmp_path, monkeypatch=monkeypatch)
    monkeypatch.setattr("anhyst.verification.targets.OPTIMISATIONS", ("-O1",))
    real_compiler = (place / "cc").resolve()
    (place / "cc").unlink()
    (place / "cc").write_text(
        f'#!/bin/sh\ncase "$*" in *-O1*) echo "x.c:1: error: none of it" >&2; exit 1;; esac\n'
        f'exec {real_compiler} "$@"\n',
        encoding="ascii",
    )
    (place / "cc").chmod(0o755)
    assert command(folder, "--on", "host,msp430") == 1


@pytest.mark.slow
def test_json_lists_missing_tools(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    only("cc", at=tmp_path, monkeypatch=monkeypatch)
    assert command(folder, "--on", "host", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert [one["tool"] for one in found["missing"]] == ["gcc", "clang"]


@pytest.mark.slow
def test_without_a_python_package_its_targets_do_not_run_and_the_others_do(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    only("cc", at=tmp_path, monkeypatch=monkeypatch)
    monkeypatch.setattr("anhyst.compilation.toolchain.importlib.util.find_spec", lambda name: None)
    assert command(folder) == 0
    found = kept(folder)
    assert found["not_run"] == ["cortex-m4"]
    assert "pip install 'anhyst[verify]'" in json.dumps(found["missing"])


def test_without_any_tool_verify_writes_nothing_and_names_all_missing_tools(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    only(at=tmp_path, monkeypatch=monkeypatch)
    monkeypatch.setattr("anhyst.compilation.toolchain.importlib.util.find_spec", lambda name: None)
    assert command(folder) == 2
    message = capsys.readouterr()
    assert message.out == ""
    assert says(message.err, "no-target")
    for tool in ("clang (apt install clang)", "unicorn (pip install 'anhyst[verify]')"):
        assert tool in message.err
    assert not (folder / "verify.json").exists()


@pytest.mark.slow
def test_a_compiler_without_its_sanitizers_runs_without_them(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = only("cc", at=tmp_path, monkeypatch=monkeypatch)
    (place / "gcc").write_text(
        '#!/bin/sh\ncase "$*" in *fsanitize*) echo "ld: error: cannot find -lasan" >&2; exit 1;;'
        ' esac\nexec cc "$@"\n',
        encoding="ascii",
    )
    (place / "gcc").chmod(0o755)
    assert command(folder, "--on", "host") == 0
    found = kept(folder)
    tools = [one["tool"] for one in found["missing"]]  # type: ignore[attr-defined]
    assert tools == ["clang", "sanitizers of gcc"]
    builds = [one["build"] for one in found["results"]]  # type: ignore[attr-defined]
    assert builds == ["gcc -O2"]
