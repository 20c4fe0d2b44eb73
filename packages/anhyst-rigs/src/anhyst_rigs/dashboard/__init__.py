"""Operate a rig in a browser: the server, the page and the recorder of ``anhyst live``."""
