"""Many magnets of one type: each identified, compiled and verified, and all of them judged."""
