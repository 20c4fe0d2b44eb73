"""An open benchmark of hysteresis models: tasks with frozen splits, models of many kinds, one table."""
