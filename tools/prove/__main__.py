"""Run the proofs: ``make prove`` runs those whose inputs changed, ``make prove-all`` runs all.

``proofs/proofs.toml`` lists the proofs and ``proofs/proved.toml`` records the proofs that held.
docs/proofs.md explains both files. Arguments are names of proofs, which are run even if they are
recorded.
"""

from __future__ import annotations

import re
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed

from tools.prove.inputs import content_hash
from tools.prove.listing import PROOFS, Proof, read_proofs
from tools.prove.provers import install_provers, version
from tools.prove.record import Entry, is_valid, make_entry, read_record, write_record
from tools.prove.running import Evidence, Outcome, run_prover
from tools.prove.verdict import PROVED, REFUTED

RECORD = PROOFS / "proved.toml"
MIN_RECORDED_S = 5  # processor time below which a proof is always run and not recorded, s


def print_evidence(proof: Proof, evidence: Evidence) -> None:
    """Print one line of the table, and the end of the tool's output if the proof failed."""
    proof_outcome, control = evidence.real, evidence.control
    control_text = "rejected" if control.verdict == REFUTED else control.verdict
    print(
        f"{proof.name:43} {proof.tool:8} {proof_outcome.verdict:10} {control_text:10} "
        f"{evidence.seconds:6.1f}  {'' if evidence.holds else 'FAILED'}",
        flush=True,
    )
    for outcome, expected_verdict in ((proof_outcome, PROVED), (control, REFUTED)):
        if outcome.verdict != expected_verdict:
            lines = [line for line in outcome.output.splitlines() if not re.search("PASSED|Valid", line)]
            print("    " + "\n    ".join(lines[-25:]))


def current_hash(proof: Proof) -> str:
    """Return the hash of the files that a proof depends on, as they are on the disk now."""
    return content_hash(proof, version(proof.tool))


def run_all(proofs: list[Proof], contents: dict[str, str], record: dict[str, Entry]) -> int:
    """Run two proofs at a time and record each proof that held; return the number of these."""
    runs: dict[str, dict[bool, Outcome]] = {proof.name: {} for proof in proofs}
    held_count = 0
    with ThreadPoolExecutor(2) as pool:
        pending = {
            pool.submit(run_prover, proof, broken=has_fault): (proof, has_fault)
            for proof in proofs
            for has_fault in (False, True)
        }
        for finished in as_completed(pending):
            proof, broken = pending[finished]
            runs[proof.name][broken] = finished.result()
            if len(runs[proof.name]) < 2:
                continue
            evidence = Evidence(real=runs[proof.name][False], control=runs[proof.name][True])
            print_evidence(proof, evidence)
            held_count += evidence.holds
            record.pop(proof.name, None)
            # Meanwhile, an editor may have changed the files.
            is_unchanged = current_hash(proof) == contents[proof.name]
            if evidence.holds and evidence.seconds >= MIN_RECORDED_S and is_unchanged:
                record[proof.name] = make_entry(evidence, contents[proof.name])
            write_record(RECORD, record)
    return held_count


def read_valid_record(contents: dict[str, str]) -> dict[str, Entry]:
    """Return the entries of the record that are still valid; print the names of the others."""
    all_entries = read_record(RECORD)
    valid = {
        recorded_name: recorded_entry
        for recorded_name, recorded_entry in all_entries.items()
        if recorded_name in contents and is_valid(recorded_entry, contents[recorded_name])
    }
    for name in sorted(set(all_entries) - set(valid)):
        print(f"{name}: what it depends on, or its record, has changed")
    return valid


def main() -> int:
    """Return 0 if every proof holds, now or as recorded, and rejects the fault of its control."""
    proofs, requested = read_proofs(), set(sys.argv[1:])
    names = {proof.name for proof in proofs}
    if unknown := requested - names - {"--all"}:
        print(f"prove: no such proof: {', '.join(sorted(unknown))}", file=sys.stderr)
        return 2
    if problem := install_provers():
        print(f"prove: {problem}", file=sys.stderr)
        return 2
    start = time.monotonic()
    with ThreadPoolExecutor(2) as pool:
        hashes = pool.map(current_hash, proofs)
        contents = {proof.name: found for proof, found in zip(proofs, hashes, strict=True)}
    record = read_valid_record(contents)
    print(f"{'proof':43} {'tool':8} {'verdict':10} {'control':10} processor seconds")
    chosen = requested & names or (names if requested else names - set(record))
    for proof in proofs:
        if proof.name in record and not requested:
            seconds = record[proof.name].seconds
            print(f"{proof.name:43} {proof.tool:8} {'recorded':21} {seconds:6.1f}")
    held_count = run_all([proof for proof in proofs if proof.name in chosen], contents, record)
    duration_s = time.monotonic() - start
    recorded_text = f", {len(record.keys() - chosen)} recorded" if not requested else ""
    print(f"{held_count} of {len(chosen)} proofs hold{recorded_text}, {duration_s:.0f} s")
    return 0 if held_count == len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
