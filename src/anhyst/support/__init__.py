"""What every room uses: errors, files, TOML, units, jobs, the parts of a page."""
