"""From a measured loop to a linear actuator.

A step is a function, and lives in the module of its name:

- `anhyst.data`: ``read_loops`` reads loops; ``anhyst.data.inspection.inspect`` judges them;
- `anhyst.identify`: ``identify`` finds a model;
- `anhyst.model.actuator`: ``ActuatorModel`` predicts and inverts, whole records or step by step;
- `anhyst.model.file`: ``read_model`` and ``write_model``;
- `anhyst.report`: ``write_report``; `anhyst.model.diff`: ``diff``.
"""
