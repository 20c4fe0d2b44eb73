"""What every room uses: errors, files, TOML, units, jobs, the parts of a page."""

from importlib.metadata import PackageNotFoundError, version


def running_version() -> str:
    """Return the version as installed, or ``"0+source"`` when run from a bare source tree."""
    try:
        return version("anhyst")
    except PackageNotFoundError:
        return "0+source"
