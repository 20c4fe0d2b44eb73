"""Results of a run: scores by task and model, their file, and the comparison with the record."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from .scores import Scores

RECORD_FILE = Path(__file__).with_name("record") / "results.json"
"""Results that were measured with the sources of this checkout."""


@dataclass
class Results:
    """Scores by task and model.

    Parameters
    ----------
    machine
        Description of the machine in sentences.
    scores
        Scores by the name of the task, then by the name of the model.
    skipped
        Reason by the name of a task that was not run.
    """

    machine: list[str] = field(default_factory=list)
    scores: dict[str, dict[str, Scores]] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)

    @classmethod
    def read(cls, file: Path = RECORD_FILE) -> Results:
        """Read results; a file that does not exist gives empty results."""
        if not file.exists():
            return cls()
        table = json.loads(file.read_text(encoding="utf-8"))
        scores = {
            task: {model: Scores(**values) for model, values in models.items()}
            for task, models in table["scores"].items()
        }
        return cls(table["machine"], scores, table["skipped"])

    def write(self, file: Path) -> None:
        """Write the results as JSON; all digits are kept."""
        table = {
            "machine": self.machine,
            "skipped": self.skipped,
            "scores": {
                task: {model: scores.to_dict() for model, scores in models.items()}
                for task, models in self.scores.items()
            },
        }
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(table, indent=1, sort_keys=True, ensure_ascii=False) + "\n", "utf-8")

    def updated(self, other: Results) -> Results:
        """Return these results, replaced by others where both have a task and a model."""
        tasks = dict.fromkeys([*self.scores, *other.scores])
        scores = {task: {**self.scores.get(task, {}), **other.scores.get(task, {})} for task in tasks}
        return Results(other.machine or self.machine, scores, {**self.skipped, **other.skipped})

    def models(self) -> list[str]:
        """Return the names of all models."""
        return sorted({model for models in self.scores.values() for model in models})

    def differences(self, record: Results, models: Iterable[str]) -> list[str]:
        """List the scores of models that differ from a record in any digit; times may differ."""
        texts = []
        for model in models:
            for task, scores in self.scores.items():
                known = record.scores.get(task, {}).get(model)
                if known is None or model not in scores:
                    continue
                values, known_values = scores[model].to_dict(), known.to_dict()
                texts += [
                    f"{task}, {model}: {name} is {value!r}, in the record {known_values[name]!r}"
                    for name, value in values.items()
                    if name not in ("fit_s", "step_us") and value != known_values[name]
                ]
        return texts
