"""Functions that all other packages use: errors, files, TOML, units, parallel jobs, HTML pages."""

from importlib.metadata import PackageNotFoundError, version


def running_version() -> str:
    """Return the installed version, or ``"0+source"`` if anhyst runs from an uninstalled source."""
    try:
        return version("anhyst")
    except PackageNotFoundError:
        return "0+source"
