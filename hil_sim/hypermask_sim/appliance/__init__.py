"""A Debian 13 in a virtual machine that the drivers are tried in."""
