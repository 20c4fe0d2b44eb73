"""Models of the benchmark. Each file lists its models in ``MODELS``."""
