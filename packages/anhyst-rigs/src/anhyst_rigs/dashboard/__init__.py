"""A bench in a browser: server, page and recorder behind ``anhyst live``."""
