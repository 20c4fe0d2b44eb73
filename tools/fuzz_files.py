"""Fuzz the readers of measurement files with damaged recordings of every format.

Usage: ``python tools/fuzz_files.py [--seconds S] [--seed N] [--out FOLDER]``

The script damages good files of each format: it changes bits, bytes and sizes, and it cuts, repeats
and removes pieces. A child process with limits on time and memory reads each file, as `anhyst` does
before it reads a file. A file must be read, or be rejected with one line. If a library crashes or
hangs, only the child process ends. The script saves that file and checks that the package rejects
it. The exit code is 1 after any other result.
"""

from __future__ import annotations

import argparse
import collections
import io
import os
import random
import sys
import time
import traceback
import zipfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.extend(map(str, (ROOT, *(ROOT / "packages").iterdir())))

from anhyst.data.formats import WRITERS  # noqa: E402
from anhyst.data.formats.channel_table import MIN_CPU_TIME_S, limit_resources  # noqa: E402
from anhyst.data.formats.channels import ChannelGroup, Series  # noqa: E402
from anhyst.data.table import list_channels  # noqa: E402
from anhyst.support.errors import InputError  # noqa: E402
from tests.data import logger_layouts, recordings  # noqa: E402

FILES_PER_PROCESS = 100
"""Number of files that one process reads."""
EXTREME_SIZES = (0, 1, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 40, (1 << 64) - 1)


def make_good_files(folder: Path) -> dict[str, list[bytes]]:
    """Return undamaged recordings of each format."""
    times, current, force = recordings.loop(50.0)
    phase = np.array([f"p{n // 20}" for n in range(times.size)])
    groups = [
        ChannelGroup("bench", Series("t", "s", times), (
            Series("I", "A", current), Series("F", "N", force.astype(np.float32)),
            Series("n", "", np.arange(times.size)), Series("phase", "", phase))),
        ChannelGroup("oven", Series("t", "s", times[::5]), (Series("T", "degC", current[::5]),)),
    ]  # fmt: skip
    paths_by_suffix: dict[str, list[Path]] = {}
    for suffix in (".mat", ".mf4", ".tdms", ".h5", ".parquet"):
        paths_by_suffix[suffix] = [folder / f"good{suffix}"]
        WRITERS[suffix](paths_by_suffix[suffix][0], groups[:1] if suffix == ".parquet" else groups)
    for write_format in (
        recordings.with_time, recordings.time_series, recordings.matlab_73,
        recordings.control_desk, recordings.object_in_v5,
    ):  # fmt: skip
        paths_by_suffix[".mat"].append(write_format(folder / f"{write_format.__name__}.mat"))
    rows = zip(times.tolist(), current.tolist(), force.tolist(), strict=True)
    table = [["t", "I", "F"], ["s", "A", "N"], *map(list, rows)]
    paths_by_suffix[".xlsx"] = [recordings.workbook(folder / "good.xlsx", table)]
    contents = {suffix: [path.read_bytes() for path in paths] for suffix, paths in paths_by_suffix.items()}
    exports = [layout() for layout in logger_layouts.LAYOUTS]
    contents[".csv"] = [export.text.encode(export.encoding) for export in exports]
    return contents


def damage_content(content: bytes, generator: random.Random) -> bytes:
    """Damage a file at one to eight positions. Half of the positions are in the first 2048 bytes."""
    data = bytearray(content)
    for _ in range(generator.choice((1, 1, 1, 2, 4, 8))):
        if not data:
            break
        position = generator.randrange(len(data) if generator.random() < 0.5 else min(len(data), 2048))
        match generator.randrange(6):
            case 0:
                data[position] ^= 1 << generator.randrange(8)
            case 1:
                data[position] = generator.randrange(256)
            case 2:
                width = generator.choice((2, 4, 8))
                number = generator.choice(EXTREME_SIZES) & ((1 << 8 * width) - 1)
                data[position : position + width] = number.to_bytes(width, "little")
            case 3:
                del data[position:]
            case 4:
                source_position = generator.randrange(len(data))
                data[position : position + generator.randrange(64)] = data[
                    source_position : source_position + 64
                ]
            case 5:
                del data[position : position + generator.randrange(1, 64)]
    return bytes(data)


def damage_archive(content: bytes, generator: random.Random) -> bytes:
    """Damage one member of a zip file; the archive itself stays valid."""
    damaged_bytes = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(content)) as source_archive,
        zipfile.ZipFile(damaged_bytes, "w") as damaged_archive,
    ):
        damaged_name = generator.choice(source_archive.namelist())
        for name in source_archive.namelist():
            member = source_archive.read(name)
            damaged_archive.writestr(
                name, damage_content(member, generator) if name == damaged_name else member
            )
    return damaged_bytes.getvalue()


def make_damaged_file(suffix: str, seeds: list[bytes], number: int) -> bytes:
    """Return the damaged file with a given number."""
    generator = random.Random(f"{suffix} {number}")
    content = generator.choice(seeds)
    if suffix == ".xlsx" and generator.random() < 0.7:
        return damage_archive(content, generator)
    return damage_content(content, generator)


def try_file(path: Path) -> str:
    """Read the channels of a file; return the result as one word."""
    try:
        list_channels(path)
    except InputError as refusal:
        return "refused" if "\n" not in str(refusal) else "in several lines"
    except MemoryError:
        return "too large"
    except Exception:
        traceback.print_exc()
        return "fault"
    return "read"


def run_batch(suffix: str, seeds: list[bytes], numbers: range, folder: Path) -> int:
    """Read files in a child process; return the number of files that it completed."""
    results_file = folder / "said"
    results_file.write_text("")
    child = os.fork()
    if child == 0:
        sys.stderr = (folder / "faults.txt").open("a", encoding="utf-8")
        for stream in (1, 2):  # libraries print warnings about data that they cannot read
            os.dup2(sys.stderr.fileno(), stream)
        for number in numbers:
            limit_resources(MIN_CPU_TIME_S, 0)
            path = folder / f"damaged{suffix}"
            path.write_bytes(make_damaged_file(suffix, seeds, number))
            result = try_file(path)
            with results_file.open("a", encoding="utf-8") as file:
                file.write(result + "\n")
        os._exit(0)
    os.waitpid(child, 0)
    return len(results_file.read_text().split("\n")) - 1


def main() -> int:
    """Run the fuzzer and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "fuzz-files")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    seeds = make_good_files(options.out)
    next_numbers = dict.fromkeys(seeds, 1_000_000 * options.seed)
    counts: collections.Counter[str] = collections.Counter()
    failures = 0
    end_time = time.monotonic() + options.seconds
    while time.monotonic() < end_time:
        for suffix, files in seeds.items():
            first_number = next_numbers[suffix]
            completed = run_batch(
                suffix, files, range(first_number, first_number + FILES_PER_PROCESS), options.out
            )
            results = (options.out / "said").read_text().split("\n")[:-1]
            counts.update(f"{suffix} {result}" for result in results)
            failed_indices = [
                result_index
                for result_index, result in enumerate(results)
                if result not in {"read", "refused", "too large"}
            ]
            for index in failed_indices:
                saved_file = options.out / f"wrong-{first_number + index}{suffix}"
                saved_file.write_bytes(make_damaged_file(suffix, files, first_number + index))
            failures += len(failed_indices)
            if completed < FILES_PER_PROCESS:  # the next file crashed the process
                saved_file = options.out / f"crash-{first_number + completed}{suffix}"
                saved_file.write_bytes(make_damaged_file(suffix, files, first_number + completed))
                result = try_file(saved_file)
                counts.update([f"{suffix} crashes a library, then {result}"])
                failures += result != "refused"
                completed += 1
            next_numbers[suffix] = first_number + completed
    for name, count in sorted(counts.items()):
        print(f"{name}: {count}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
