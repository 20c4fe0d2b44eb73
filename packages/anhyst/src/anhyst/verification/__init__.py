"""Run the C of ``anhyst compile`` on real instruction sets, and compare it with the host."""

from anhyst.verification.result import TargetResult, Verification
from anhyst.verification.verify import verify

__all__ = ["TargetResult", "Verification", "verify"]
