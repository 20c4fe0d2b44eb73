"""Run the proofs: ``make prove`` those that changed, ``make prove-all`` all of them.

``proofs/proofs.toml`` lists the proofs, ``proofs/proved.toml`` records those that held,
docs/proofs.md explains both. With names as arguments: those proofs, recorded or not.
"""

from __future__ import annotations

import re
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed

from tools.prove.inputs import content_hash
from tools.prove.listing import PROOFS, Proof, read_proofs
from tools.prove.provers import install, version
from tools.prove.record import Entry, entry_of, is_valid, read_record, write_record
from tools.prove.running import Evidence, Outcome, run
from tools.prove.verdict import PROVED, REFUTED

RECORD = PROOFS / "proved.toml"
QUICK = 5  # seconds of processor time, below which a proof is run rather than recorded


def show(proof: Proof, evidence: Evidence) -> None:
    """Print one line of the table, and the tool's last words where it went wrong."""
    real, control = evidence.real, evidence.control
    rejected = "rejected" if control.verdict == REFUTED else control.verdict
    print(
        f"{proof.name:43} {proof.tool:8} {real.verdict:10} {rejected:10} "
        f"{evidence.seconds:6.1f}  {'' if evidence.holds else 'FAILED'}",
        flush=True,
    )
    for outcome, wanted in ((real, PROVED), (control, REFUTED)):
        if outcome.verdict != wanted:
            lines = [x for x in outcome.output.splitlines() if not re.search("PASSED|Valid", x)]
            print("    " + "\n    ".join(lines[-25:]))


def hash_now(proof: Proof) -> str:
    """Return the hash of what a proof depends on, as it stands on the disk."""
    return content_hash(proof, version(proof.tool))


def run_all(proofs: list[Proof], contents: dict[str, str], record: dict[str, Entry]) -> int:
    """Run proofs two at a time, and record each that held; return how many did."""
    runs: dict[str, dict[bool, Outcome]] = {proof.name: {} for proof in proofs}
    good = 0
    with ThreadPoolExecutor(2) as pool:
        pending = {
            pool.submit(run, proof, broken=broken): (proof, broken)
            for proof in proofs
            for broken in (False, True)
        }
        for done in as_completed(pending):
            proof, broken = pending[done]
            runs[proof.name][broken] = done.result()
            if len(runs[proof.name]) < 2:
                continue
            evidence = Evidence(real=runs[proof.name][False], control=runs[proof.name][True])
            show(proof, evidence)
            good += evidence.holds
            record.pop(proof.name, None)
            unmoved = hash_now(proof) == contents[proof.name]  # by an editor meanwhile
            if evidence.holds and evidence.seconds >= QUICK and unmoved:
                record[proof.name] = entry_of(evidence, contents[proof.name])
            write_record(RECORD, record)
    return good


def recorded(contents: dict[str, str]) -> dict[str, Entry]:
    """Return what is still true of the record; name what is not."""
    found = read_record(RECORD)
    true = {n: e for n, e in found.items() if n in contents and is_valid(e, contents[n])}
    for name in sorted(set(found) - set(true)):
        print(f"{name}: what it depends on, or its record, has changed")
    return true


def main() -> int:
    """Return 0 if every proof holds, now or as recorded, and every control is rejected."""
    proofs, wanted = read_proofs(), set(sys.argv[1:])
    names = {proof.name for proof in proofs}
    if unknown := wanted - names - {"--all"}:
        print(f"prove: no such proof: {', '.join(sorted(unknown))}", file=sys.stderr)
        return 2
    if problem := install():
        print(f"prove: {problem}", file=sys.stderr)
        return 2
    start = time.monotonic()
    with ThreadPoolExecutor(2) as pool:
        hashes = pool.map(hash_now, proofs)
        contents = {proof.name: found for proof, found in zip(proofs, hashes, strict=True)}
    record = recorded(contents)
    print(f"{'proof':43} {'tool':8} {'verdict':10} {'control':10} processor seconds")
    chosen = wanted & names or (names if wanted else names - set(record))
    for proof in proofs:
        if proof.name in record and not wanted:
            seconds = record[proof.name].seconds
            print(f"{proof.name:43} {proof.tool:8} {'recorded':21} {seconds:6.1f}")
    good = run_all([proof for proof in proofs if proof.name in chosen], contents, record)
    took = time.monotonic() - start
    kept = f", {len(record.keys() - chosen)} recorded" if not wanted else ""
    print(f"{good} of {len(chosen)} proofs hold{kept}, {took:.0f} s")
    return 0 if good == len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
