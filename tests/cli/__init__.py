"""Bad input and bad luck through the real command line, each in a process of its own."""
