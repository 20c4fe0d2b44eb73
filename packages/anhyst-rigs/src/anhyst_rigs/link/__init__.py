"""Communicate with a controller: frames, client, XCP, and the bus of a virtual plant."""
