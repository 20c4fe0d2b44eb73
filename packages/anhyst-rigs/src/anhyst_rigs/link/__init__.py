"""The link to a controller: frames, client, and the bus of a virtual plant."""
