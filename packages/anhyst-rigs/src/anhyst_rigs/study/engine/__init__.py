"""Many plants behind many methods: drawn, run, compared, one verdict."""
