"""Report a simulated bearing, with figures."""
