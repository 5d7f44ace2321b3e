"""The show: pure computation, the workers that wire it to drivers, and the command line."""
