"""Communicate with a controller over a link or XCP, and with a virtual plant over its bus."""
