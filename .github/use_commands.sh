#!/usr/bin/env bash
# Uses the commands that run on every system, in a new folder: from measured loops to C, and from a rig
# file to a recording. Usage: use_commands.sh FOLDER
set -euo pipefail
mkdir -p "$1"
cd "$1"

anhyst example electromagnet --out magnet
anhyst inspect magnet/loops.csv
anhyst identify magnet/loops.csv --law effective-field --out model.toml
printf 'F_N,gap_mm\n10,0.4\n80,0.4\n10,0.4\n' > demand.csv
anhyst invert model.toml demand.csv --history demagnetised --out current.csv
anhyst compile model.toml --rate 10000 --out controller
anhyst export model.toml --as fmu --rate 10000 --out magnet.fmu
anhyst report model.toml --out report.html

anhyst example bearing --out bearing
anhyst simulate bearing/rig.toml --out run.csv
test -s current.csv -a -s controller/DROP_IN.md -a -s report.html -a -s run.csv -a -s magnet.fmu
