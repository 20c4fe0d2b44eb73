"""Fuzz the readers of measurement files: damaged recordings of every format.

Usage: ``python tools/fuzz_files.py [--seconds S] [--seed N] [--out FOLDER]``

Good files of each format are damaged: bits, bytes and sizes changed, pieces cut, repeated and
removed. Each is listed and read in a process with bounds, as `anhyst` itself tries a file before it
reads it. It must be read or be refused in one line. What crashes or hangs a library ends that
process alone; it is kept, and must then be refused by the package. The figures are printed; the
exit code is 1 if anything else happened.
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

BATCH = 100
"""Files a process."""
SIZES = (0, 1, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 40, (1 << 64) - 1)


def good_files(folder: Path) -> dict[str, list[bytes]]:
    """Return recordings as each format may hold them."""
    times, current, force = recordings.loop(50.0)
    phase = np.array([f"p{n // 20}" for n in range(times.size)])
    parts = [
        ChannelGroup("bench", Series("t", "s", times), (
            Series("I", "A", current), Series("F", "N", force.astype(np.float32)),
            Series("n", "", np.arange(times.size)), Series("phase", "", phase))),
        ChannelGroup("oven", Series("t", "s", times[::5]), (Series("T", "degC", current[::5]),)),
    ]  # fmt: skip
    made: dict[str, list[Path]] = {}
    for suffix in (".mat", ".mf4", ".tdms", ".h5", ".parquet"):
        made[suffix] = [folder / f"good{suffix}"]
        WRITERS[suffix](made[suffix][0], parts[:1] if suffix == ".parquet" else parts)
    for make in (
        recordings.with_time, recordings.time_series, recordings.matlab_73,
        recordings.control_desk, recordings.object_in_v5,
    ):  # fmt: skip
        made[".mat"].append(make(folder / f"{make.__name__}.mat"))
    rows = zip(times.tolist(), current.tolist(), force.tolist(), strict=True)
    table = [["t", "I", "F"], ["s", "A", "N"], *map(list, rows)]
    made[".xlsx"] = [recordings.workbook(folder / "good.xlsx", table)]
    contents = {suffix: [path.read_bytes() for path in paths] for suffix, paths in made.items()}
    exports = [layout() for layout in logger_layouts.LAYOUTS]
    contents[".csv"] = [export.text.encode(export.encoding) for export in exports]
    return contents


def damaged(content: bytes, chance: random.Random) -> bytes:
    """Damage a file in one to eight places, the first bytes as often as all others."""
    data = bytearray(content)
    for _ in range(chance.choice((1, 1, 1, 2, 4, 8))):
        if not data:
            break
        place = chance.randrange(len(data) if chance.random() < 0.5 else min(len(data), 2048))
        match chance.randrange(6):
            case 0:
                data[place] ^= 1 << chance.randrange(8)
            case 1:
                data[place] = chance.randrange(256)
            case 2:
                width = chance.choice((2, 4, 8))
                number = chance.choice(SIZES) & ((1 << 8 * width) - 1)
                data[place : place + width] = number.to_bytes(width, "little")
            case 3:
                del data[place:]
            case 4:
                other = chance.randrange(len(data))
                data[place : place + chance.randrange(64)] = data[other : other + 64]
            case 5:
                del data[place : place + chance.randrange(1, 64)]
    return bytes(data)


def damaged_archive(content: bytes, chance: random.Random) -> bytes:
    """Damage one member of a zip file, which is then whole again."""
    packed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(packed, "w") as new:
        chosen = chance.choice(old.namelist())
        for name in old.namelist():
            member = old.read(name)
            new.writestr(name, damaged(member, chance) if name == chosen else member)
    return packed.getvalue()


def make(suffix: str, seeds: list[bytes], number: int) -> bytes:
    """Return the damaged file of a number."""
    chance = random.Random(f"{suffix} {number}")
    content = chance.choice(seeds)
    if suffix == ".xlsx" and chance.random() < 0.7:
        return damaged_archive(content, chance)
    return damaged(content, chance)


def look(path: Path) -> str:
    """List the channels of a file, and say how that ended."""
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


def batch(suffix: str, seeds: list[bytes], numbers: range, folder: Path) -> int:
    """Look at some files in a process of its own; return how many came to an end."""
    said = folder / "said"
    said.write_text("")
    child = os.fork()
    if child == 0:
        sys.stderr = (folder / "faults.txt").open("a", encoding="utf-8")
        for stream in (1, 2):  # libraries print what they do not understand
            os.dup2(sys.stderr.fileno(), stream)
        for number in numbers:
            limit_resources(MIN_CPU_TIME_S, 0)
            path = folder / f"damaged{suffix}"
            path.write_bytes(make(suffix, seeds, number))
            result = look(path)
            with said.open("a", encoding="utf-8") as file:
                file.write(result + "\n")
        os._exit(0)
    os.waitpid(child, 0)
    return len(said.read_text().split("\n")) - 1


def main() -> int:
    """Fuzz, print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "fuzz-files")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    seeds = good_files(given.out)
    following = dict.fromkeys(seeds, 1_000_000 * given.seed)
    counts: collections.Counter[str] = collections.Counter()
    bad = 0
    end = time.monotonic() + given.seconds
    while time.monotonic() < end:
        for suffix, files in seeds.items():
            first = following[suffix]
            done = batch(suffix, files, range(first, first + BATCH), given.out)
            results = (given.out / "said").read_text().split("\n")[:-1]
            counts.update(f"{suffix} {result}" for result in results)
            wrong = [
                n for n, one in enumerate(results) if one not in {"read", "refused", "too large"}
            ]
            for place in wrong:
                kept = given.out / f"wrong-{first + place}{suffix}"
                kept.write_bytes(make(suffix, files, first + place))
            bad += len(wrong)
            if done < BATCH:  # the process died of the next one
                kept = given.out / f"crash-{first + done}{suffix}"
                kept.write_bytes(make(suffix, files, first + done))
                result = look(kept)
                counts.update([f"{suffix} crashes a library, then {result}"])
                bad += result != "refused"
                done += 1
            following[suffix] = first + done
    for name, count in sorted(counts.items()):
        print(f"{name}: {count}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
